"""Responses of a beam to a prescribed friction force, on equations typed anew: modes, balance (4), slip and reaction.

No law and no harmonic balance solver: the force is given, the motion is one linear system for all harmonics at once.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from models import Beam, Rig
from models.parts import Channel
from models.published import paper_rig

POSITIONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.58)
CHANNELS = (
    Channel("force", "force", 0.555),
    *(Channel(f"a{i}", "acceleration", x) for i, x in enumerate(POSITIONS, start=1)),
)
RIG = replace(paper_rig(), channels=CHANNELS)
"""The paper's rig with six accelerometers."""

H_TRUE = 12
MODES = 40
SAMPLES = 256


@dataclass(frozen=True)
class Truth:
    """Signals at the contact over a period, (SAMPLES,), and the channels' amplitudes, (H+1,)."""

    friction: np.ndarray
    slip: np.ndarray
    normal: np.ndarray
    channels: dict[str, np.ndarray]


@cache
def beam_modes(beam: Beam, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Roots of tan b = tanh b by bisection, and the mass that normalises sin, sinh, cos, cosh shapes."""
    roots = []
    for i in range(1, n + 1):
        low, high = i * np.pi + 1e-9, i * np.pi + np.pi / 2 - 1e-9
        for _ in range(200):
            middle = (low + high) / 2
            low, high = (middle, high) if np.tan(middle) < np.tanh(middle) else (low, middle)
        roots.append((low + high) / 2)
    b = np.array(roots) / beam.length
    EI = beam.youngs_modulus * beam.width * beam.thickness**3 / 12
    return b, b**2 * np.sqrt(EI / (beam.density * beam.width * beam.thickness))


def shapes(beam: Beam, b: np.ndarray, x: np.ndarray, order: int = 0) -> np.ndarray:
    """Clamped-pinned shapes cosh - cos - s (sinh - sin) of the textbook, mass-normalised; (m, n)."""
    L = beam.length
    z, zL = np.outer(np.atleast_1d(x), b), b * L
    s = (np.cosh(zL) - np.cos(zL)) / (np.sinh(zL) - np.sin(zL))
    # 1 - s in a form that large arguments do not spoil: cosh z - s sinh z = e^-z + (1 - s) sinh z
    one_less_s = (np.sinh(zL) - np.sin(zL) - np.cosh(zL) + np.cos(zL)) / (np.sinh(zL) - np.sin(zL))
    hyperbolic = [np.exp(-z) + one_less_s * np.sinh(z), -np.exp(-z) + one_less_s * np.cosh(z)][order % 2]
    circular = [-np.cos(z) + s * np.sin(z), np.sin(z) + s * np.cos(z)][order]
    return (hyperbolic + circular) * b**order / np.sqrt(beam.density * beam.width * beam.thickness * L)


@cache
def integrals(beam: Beam, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Along the beam: slopes squared (n, n), and what modes that accelerate and that turn add to the reaction, (n,)."""
    L, rhoA = beam.length, beam.density * beam.width * beam.thickness
    b, _ = beam_modes(beam, n)
    x = np.linspace(0.0, L, 20001)
    weight = np.full(len(x), x[1])
    weight[[0, -1]] /= 2
    phi, slope = shapes(beam, b, x), shapes(beam, b, x, 1)
    s, s1 = (3 * L * x**2 - x**3) / (2 * L**3), (6 * L * x - 3 * x**2) / (2 * L**3)
    return (slope.T * weight) @ slope, rhoA * (weight * s) @ phi, (weight * s1) @ slope


def respond(rig: Rig, hz: float, force: complex, friction: np.ndarray) -> Truth:
    """Steady motion under a force (amplitude of the fundamental) and a friction force (SAMPLES,)."""
    beam = rig.body
    assert isinstance(beam, Beam)
    n, K, L = 14, H_TRUE, beam.length  # 14 dynamic modes; what is above answers statically, in closed form
    b, omega = beam_modes(beam, n)
    EI, h = beam.youngs_modulus * beam.width * beam.thickness**3 / 12, rig.contact.radius + beam.thickness / 2
    G, inertia, stretch = integrals(beam, n)
    c = h * shapes(beam, b, np.array([L]), 1)[0]
    drive = shapes(beam, b, np.array([rig.excitation.position]))[0]
    alpha = np.full(n, rig.damping.mass_proportional)
    alpha[5:] = 2 * 0.02 * omega[5:]
    Omega, k = 2 * np.pi * hz, np.arange(-K, K + 1)
    T = np.fft.fft(friction) / SAMPLES
    toeplitz = T[(k[:, None] - k[None, :]) % SAMPLES]
    toeplitz[np.abs(k[:, None] - k[None, :]) > K] = 0.0
    F = np.zeros(2 * K + 1, dtype=complex)
    F[K + 1], F[K - 1] = force / 2, np.conj(force) / 2
    A = np.kron(toeplitz, G)
    A += np.diag((omega**2 - (k[:, None] * Omega) ** 2 + 1j * k[:, None] * Omega * alpha).ravel())
    right = np.outer(F, drive) + np.outer(T[k % SAMPLES], c)
    q = np.linalg.solve(A, right.ravel()).reshape(2 * K + 1, n)

    def series(two_sided: np.ndarray) -> np.ndarray:
        return (np.exp(2j * np.pi * np.outer(np.arange(SAMPLES) / SAMPLES, k)) @ two_sided).real

    compliance = L / (beam.youngs_modulus * beam.width * beam.thickness)
    compliance += h**2 * (L / (4 * EI) - np.sum((c / h / omega) ** 2))
    at_drive = h * moment_shape(rig.excitation.position, L, EI) - np.sum(c * drive / omega**2)
    motion, F_t = series(q), series(F)
    drawn = 0.5 * np.einsum("ti,ij,tj->t", motion, G, motion)
    slip = motion @ c - drawn + compliance * friction + at_drive * F_t
    q_tt, q_t = series(-((k * Omega) ** 2)[:, None] * q), series((1j * k * Omega)[:, None] * q)
    X = rig.excitation.position
    normal = rig.contact.normal_load + q_tt @ inertia + q_t @ (alpha * inertia) + friction * (motion @ stretch)
    normal = normal - F_t * (3 * L * X**2 - X**3) / (2 * L**3) - friction * h * 1.5 / L
    channels = {}
    for channel in rig.response_channels:
        y = shapes(beam, b, np.array([channel.position]))[0]
        static = h * moment_shape(channel.position, L, EI) - np.sum(c * y / omega**2)
        by_force = force_shape(channel.position, X, L, EI) - np.sum(drive * y / omega**2)
        whole = q @ y + static * T[k % SAMPLES] + by_force * F
        channels[channel.name] = -((k * Omega) ** 2 * whole)[K:] * np.where(k[K:] > 0, 2, 1)
    channels["force"] = F[K:] * np.where(k[K:] > 0, 2, 1)
    return Truth(friction, slip, normal, channels)


def moment_shape(x: float, L: float, EI: float) -> float:
    """Static deflection per unit moment at the pinned end; docs/theory/equations.md section 5."""
    return (x**3 - L * x**2) / (4 * EI * L)


def force_shape(x: float, a: float, L: float, EI: float) -> float:
    """Static deflection at x of a propped cantilever (clamped at 0) per unit force at a: a textbook's formula."""
    R = a**2 * (3 * L - a) / (2 * L**3)
    moment, shear = a - R * L, 1 - R
    bend = lambda z: moment * z**2 / 2 - shear * z**3 / 6  # noqa: E731
    return (bend(x) + (max(x - a, 0.0) ** 3) / 6) / EI


def measured(rig: Rig, truths: list[tuple[float, Truth]], std: dict[str, float], H: int) -> MeasuredSpectra:
    """Spectra of the channels of some (hz, Truth), harmonics 0..H, without noise."""
    hz = np.array([f for f, _ in truths])
    coefficients, stds = {}, {}
    for name, value in std.items():
        c = np.array([truth.channels[name][: H + 1] for _, truth in truths])
        coefficients[name] = np.concatenate([c.real, -c.imag[:, 1:]], axis=1)
        stds[name] = np.full((len(hz), H + 1), value)
    return spectra_of(rig, hz, np.full(len(hz), rig.excitation.amplitude), coefficients, stds)


def with_noise(spectra: MeasuredSpectra, rng: np.random.Generator) -> MeasuredSpectra:
    """The same with a draw of the noise that its standard deviations state."""
    std = np.concatenate([spectra.std, spectra.std[:, :, 1:]], axis=2)
    return replace(spectra, coefficients=spectra.coefficients + std * rng.normal(size=std.shape))
