"""One mode that a joint, or whatever is not linear, makes stiffer or softer: its equivalent frequency and damping.

The rig is one mode, fitted to a record of low level; the force T on its coordinate is everything that mode leaves out,
reconstructed by inverse harmonic balance (fundamental only). Of T over the modal displacement q the part in phase
is stiffness, the part in quadrature damping:

    omega_eq^2 = omega_0^2 - Re(T/q),   2 zeta_eq omega_eq Omega = d Omega - Im(T/q)

so that T need not be small, and what is found does not depend on the mode it was referred to.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.optimize import least_squares

from hbm.diagnosis.diagnose import diagnose
from hbm.diagnosis.discrepancy import discrepancy
from hbm.inverse.reconstruct import reconstruct
from hbm.inverse.reconstruction import Reconstruction
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from hbm.parallel import all_cores
from models.friction import Frictionless
from models.parts import Channel, Contact, Damping, Excitation, ModalBody
from models.rig import Rig

from .common import Sweep

RIGID_HZ = 1e-3
"""The remaining modes' mobility is that of a mass: a mode far below the band, which the joint does not move."""


@dataclass(frozen=True)
class Mode:
    """Mode of a drive-point response: r^2 per mass, and mass line of all that is rigid (0: none).

    `turn` [rad] is the phase by which the force leads what stands for it in the file.
    """

    hz: float
    ratio: float
    shape: float
    rigid: float = 0.0
    turn: float = 0.0

    def accelerance(self, hz: np.ndarray) -> np.ndarray:
        """Acceleration per force."""
        omega, omega_n = 2 * np.pi * hz, 2 * np.pi * self.hz
        own = -(self.shape**2) * omega**2 / (omega_n**2 - omega**2 + 2j * self.ratio * omega_n * omega)
        return (own + self.rigid**2) * np.exp(1j * self.turn)

    def rig(self, name: str, quantity: str, amplitude: float) -> Rig:
        """Rig whose contact is the modal coordinate itself."""
        rows = (self.shape, self.rigid)
        return Rig(
            name,
            ModalBody((self.hz, RIGID_HZ), (rows, rows), (1.0, 0.0), rows),
            Damping(modal_ratios=(self.ratio, 0.0)),
            Contact(1e-3, Frictionless()),
            Excitation(amplitude),
            (Channel("force", "force"), Channel("response", quantity)),
        )


@dataclass(frozen=True)
class ModeFit:
    """A mode with the standard deviations of its frequency and damping ratio, inflated by the misfit."""

    mode: Mode
    hz_std: float
    ratio_std: float
    chi2: float


@dataclass(frozen=True)
class Reference:
    """A mode with the standard deviations of its shape, mass line (r^2) and turn, inflated by the misfit."""

    mode: Mode
    shape_std: float
    rigid_std: float
    turn_std: float
    chi2: float


def reference(sweeps: Sequence[Sweep], order: int, degree: int, *, rigid: bool, turn: bool) -> "Reference":
    """Find the mode whose stiffness and damping in each sweep depend on amplitude alone.

    A sweep through a resonance meets each amplitude twice, above and below it. Shape, mass line and phase of the force
    are those that make both meetings agree: stiffness and damping are polynomials of the amplitude, of a sweep each.
    The frequency and damping ratio of the mode are those of the first sweep at its smallest amplitude.
    """
    free = np.array([True, rigid, turn])
    start, scale = np.zeros(3), np.array([1.0, 1.0, 0.1])

    def left(x: np.ndarray) -> np.ndarray:
        full = start.copy()
        full[free] += x * scale[free]
        return np.concatenate([_beside_amplitude(s, order, degree, scaled, *full)[0] for s in sweeps])

    # the first guess of r^2, which scales everything: half-power width and height of the largest response
    top, width = _start(sweeps[0].hz, sweeps[0].response / sweeps[0].drive)
    omega = 2 * np.pi * top
    height = np.abs(sweeps[0].response / sweeps[0].drive).max() / omega**order
    scaled = height * 2 * width / top * omega**2
    fit = least_squares(left, np.array([1.0, 0.01, 0.01])[free], x_scale="jac")
    full = start.copy()
    full[free] += fit.x * scale[free]
    _, stiffness, damping = _beside_amplitude(sweeps[0], order, degree, scaled, *full)
    chi2 = 2 * fit.cost / (len(fit.fun) - 2 * (degree + 1) * len(sweeps) - free.sum())
    omega_n = float(np.sqrt(stiffness))
    mode = Mode(
        omega_n / 2 / np.pi,
        float(damping / (2 * omega_n)),
        float(np.sqrt(full[0] * scaled)),
        float(np.sqrt(max(full[1], 0.0))),
        float(full[2]),
    )
    cov = np.linalg.inv(fit.jac.T @ fit.jac) * max(chi2, 1.0)
    std = np.zeros(3)
    std[free] = np.sqrt(np.diag(cov)) * scale[free]
    shape_std = std[0] * scaled / 2 / mode.shape
    return Reference(mode, shape_std, std[1], std[2], float(chi2))


def _beside_amplitude(
    sweep: Sweep, order: int, degree: int, unit: float, square: float, rigid: float, turn: float
) -> tuple[np.ndarray, float, float]:
    """Stiffness and damping less what the amplitude explains of them, in std; and both at the smallest amplitude."""
    omega, F = 2 * np.pi * sweep.hz, sweep.drive * np.exp(1j * turn)
    factor = (1j * omega) ** order
    q = sweep.response / factor + rigid * F / omega**2
    Z = square * unit * F / q + omega**2
    relative = np.hypot(sweep.response_std / np.abs(sweep.response), sweep.drive_std / np.abs(sweep.drive))
    std = np.abs(square * unit * F / q) * relative
    powers = np.vander(np.abs(q) / np.abs(q).max(), degree + 1, increasing=True)
    k = np.linalg.lstsq(powers / std[:, None], Z.real / std, rcond=None)[0]
    c = np.linalg.lstsq(powers * (omega / std)[:, None], Z.imag / std, rcond=None)[0]
    least = powers[np.abs(q).argmin()]
    left = np.concatenate([(Z.real - powers @ k) / std, (Z.imag - omega * (powers @ c)) / std])
    return left, float(least @ k), float(least @ c)


def fit_mode(sweep: Sweep, order: int, *, rigid: bool, turn: bool, near: float = 0.0) -> ModeFit:
    """Fit one mode to a sweep; `order` differentiates displacement to the response, `near` keeps points with

    a response of at least this share of the largest.
    """
    kept = np.abs(sweep.response) >= near * np.abs(sweep.response).max()
    hz, F, y = sweep.hz[kept], sweep.drive[kept], sweep.response[kept]
    factor = (2j * np.pi * hz) ** (order - 2)
    h = y / F
    std = np.hypot(sweep.response_std[kept], np.abs(h) * sweep.drive_std[kept]) / np.abs(F)
    start, width = _start(hz, h)
    shape = np.sqrt(np.abs(h).max() * 2 * width / hz.max() * (2 * np.pi * hz.max()) ** (2 - order))
    free = [True, True, True, rigid, turn]
    scale = np.array([width, width / start, shape, shape, 0.1])
    at = np.array([start, width / start, shape, 0.0, 0.0])

    def mode(x: np.ndarray) -> Mode:
        full = at.copy()
        full[free] += x * scale[free]
        return Mode(*full)

    def misfit(x: np.ndarray) -> np.ndarray:
        e = (mode(x).accelerance(hz) * factor - h) / std
        return np.concatenate([e.real, e.imag])

    fit = least_squares(misfit, np.full(sum(free), 1e-3), x_scale="jac")
    chi2 = 2 * fit.cost / (2 * len(hz) - sum(free))
    cov = np.linalg.inv(fit.jac.T @ fit.jac) * max(chi2, 1.0)
    s = np.sqrt(np.diag(cov)) * scale[free]
    return ModeFit(mode(fit.x), float(s[0]), float(s[1]), float(chi2))


def _start(hz: np.ndarray, h: np.ndarray) -> tuple[float, float]:
    """Frequency of the largest response, and half its width at half power [Hz]."""
    top = int(np.abs(h).argmax())
    inside = hz[np.abs(h) > np.abs(h).max() / np.sqrt(2.0)]
    return float(hz[top]), max(float(np.ptp(inside)) / 2, float(np.diff(hz).min()))


@dataclass(frozen=True, eq=False)
class Equivalent:
    """Equivalent frequency [Hz] and damping ratio at each point, by displacement amplitude at the sensor [m]."""

    name: str
    hz: np.ndarray
    amplitude: np.ndarray
    frequency: np.ndarray
    frequency_std: np.ndarray
    ratio: np.ndarray
    ratio_std: np.ndarray
    energy: np.ndarray
    energy_std: np.ndarray


def spectra(rig: Rig, sweep: Sweep, turn: float) -> MeasuredSpectra:
    """Fundamentals of a sweep; every frequency is a record."""
    n = len(sweep.hz)

    def arrays(c: np.ndarray, std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        coefficients, by_harmonic = np.full((n, 3), np.nan), np.full((n, 2), np.nan)
        coefficients[:, 1], coefficients[:, 2], by_harmonic[:, 1] = c.real, -c.imag, std
        return coefficients, by_harmonic

    force, force_std = arrays(sweep.drive * np.exp(1j * turn), sweep.drive_std)
    response, response_std = arrays(sweep.response, sweep.response_std)
    both = {"force": force, "response": response}, {"force": force_std, "response": response_std}
    return spectra_of(rig, sweep.hz, np.abs(sweep.drive), *both, source=sweep.name)


def equivalent(mode: Mode, sweep: Sweep, quantity: str, name: str) -> tuple[Equivalent, Reconstruction]:
    """Reconstruct what the mode leaves out of a sweep, and read it as stiffness and damping."""
    rig = mode.rig(name, quantity, sweep.level)
    found = reconstruct(rig, spectra(rig, sweep, mode.turn))
    T, q = found["friction"].complex[:, 1], found["slip"].complex[:, 1]
    omega, omega_n = 2 * np.pi * sweep.hz, 2 * np.pi * mode.hz
    ratio = T / q
    # T and q share the noise of the response: T = Z q - r F, Z the stiffness of the mode, so that T/q = Z - r F/q
    share = np.hypot(
        sweep.response_std / np.abs(sweep.response), sweep.drive_std / np.abs(sweep.drive)
    )  # of F/q, each of real and imaginary part
    std = np.abs(mode.shape * sweep.drive / q) * share
    stiffness = omega_n**2 - ratio.real
    damping = 2 * mode.ratio * omega_n * omega - ratio.imag
    frequency = np.sqrt(stiffness) / 2 / np.pi
    linear = np.pi * 2 * mode.ratio * omega_n * omega * np.abs(q) ** 2
    energy = found.energy_per_cycle
    return (
        Equivalent(
            name=sweep.name,
            hz=sweep.hz,
            amplitude=np.abs(mode.shape * q),
            frequency=frequency,
            frequency_std=std / (8 * np.pi**2 * frequency),
            ratio=damping / (2 * np.sqrt(stiffness) * omega),
            ratio_std=std / (2 * np.sqrt(stiffness) * omega),
            energy=energy.value + linear,
            energy_std=energy.std,
        ),
        found,
    )


def diagnosed(mode: Mode, sweeps: Sequence[Sweep], quantity: str, name: str) -> str:
    """What the diagnosis says of the linear mode beside all sweeps, and of the force that it lacks."""
    rig = mode.rig(name, quantity, sweeps[0].level)
    levels = np.concatenate([np.full(len(s.hz), s.level) for s in sweeps])
    with all_cores() as executor:
        found = diagnose(rig, replace(spectra(rig, _joined(sweeps), mode.turn), level=levels), executor=executor)
    said = f"Diagnosis of the linear mode: {found.cause or found.verdict}."
    if found.calibrated is None or found.campaign is None:
        return said
    return " ".join([said, *discrepancy(found.calibrated, found.campaign).sentences()])


def _joined(sweeps: Sequence[Sweep]) -> Sweep:
    """Records of several sweeps, one after the other."""
    arrays = [f.name for f in fields(Sweep) if f.name not in ("name", "level")]
    return replace(sweeps[0], **{a: np.concatenate([getattr(s, a) for s in sweeps]) for a in arrays})


def exponent(amplitude: np.ndarray, energy: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Exponent n of E = E_2 A^2 + E_n A^n with its standard deviation: what is linear costs A^2, friction the rest.

    Every point weighs alike relative to its energy: what scatters is the structure, not the sensors. Returns n, its
    standard deviation and the fitted energies.
    """
    x = amplitude / amplitude.max()

    def shares(n: float) -> tuple[np.ndarray, np.ndarray]:
        powers = np.column_stack([x**2, x**n]) / energy[:, None]
        return powers, np.linalg.lstsq(powers, np.ones(len(x)), rcond=None)[0]

    def left(p: np.ndarray) -> np.ndarray:
        powers, share = shares(p[0])
        return powers @ share - 1.0

    fit = least_squares(left, [3.0], bounds=([2.1], [6.0]))
    variance = 2 * fit.cost / (len(x) - 3) / float(fit.jac[:, 0] @ fit.jac[:, 0])
    powers, share = shares(fit.x[0])
    return float(fit.x[0]), float(np.sqrt(variance)), (powers @ share) * energy


def slope(amplitude: np.ndarray, energy: np.ndarray) -> tuple[float, float]:
    """Exponent of E = E_n A^n over all amplitudes, with its standard deviation by the scatter."""
    (n, _), cov = np.polyfit(np.log(amplitude), np.log(energy), 1, cov=True)
    return float(n), float(np.sqrt(cov[0, 0]))
