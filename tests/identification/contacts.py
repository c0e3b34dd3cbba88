"""Contacts made up for identification: slip of a few harmonics, the law's own force, and noise of a known covariance.

The structure has no motion above the harmonics measured (one stiff mode), so that what a law is shown is exact.
"""

from dataclasses import replace

import numpy as np

from hbm.aft.force import Environment, LawOverPeriod
from hbm.fourier import FourierBasis
from hbm.identification.start import Scales
from hbm.inverse.observed import Observed, ObservedRecord
from models.friction import FrictionLaw, parameters

P, C, OMEGA = 83.0, 2e-8, 300.0
H = 9
BASIS = FourierBasis(H + 16, 256)
SCALES = Scales(mu=0.5, stiffness=9e6, load=P, speed=4e-3, slowest=1e-3, fastest=8e-3, Omega=OMEGA)


def motions(count: int, seed: int) -> list[np.ndarray]:
    """Coefficients (2H+1, 3) of u, rho, eta: three harmonics of slip of rising size, a reaction that swings."""
    rng = np.random.default_rng(seed)
    out = []
    for size in np.geomspace(2e-6, 2.5e-5, count):
        signals = np.zeros((BASIS.size, 3))
        for k, share in ((1, 1.0), (2, 0.2), (3, 0.3)):
            a, b = size * share * rng.standard_normal(2) / np.sqrt(2.0)
            signals[[k, BASIS.H + k], 0] = a, b
        signals[[1, BASIS.H + 1], 0] = size, 0.0
        signals[0, 1], signals[0, 2] = P, -0.01
        signals[[1, BASIS.H + 2], 1] = 0.15 * P * rng.standard_normal(2)
        out.append(signals)
    return out


def jenkins(signals: np.ndarray, mu: float, critical_slip: float, N: int = 4096) -> np.ndarray:
    """Coefficients of the force of a Jenkins element in series with C under R = rho + eta T, marched in NumPy.

    Typed anew: spring k_t P-scaled, limits mu (rho + eta T) solved for T, two periods from rest.
    """
    basis = FourierBasis(BASIS.H, N)
    u, rho, eta = (basis.synthesis @ signals).T
    k = 1.0 / (critical_slip / (mu * P) + C)
    T = np.zeros(N)
    anchor = 0.0
    for _ in range(2):
        for i in range(N):
            high, low = mu * rho[i] / (1 - mu * eta[i]), -mu * rho[i] / (1 + mu * eta[i])
            T[i] = min(max(k * (anchor - u[i]), low), high)
            anchor = u[i] + T[i] / k
    return basis.analysis @ T


def of_law(law: FrictionLaw, signals: np.ndarray) -> np.ndarray:
    """Coefficients of the force of any law."""
    u, rho, eta = signals.T
    shown = np.stack([u, OMEGA * BASIS.derivative(u), rho, eta], axis=1)
    values = np.array(list(parameters(law).values()))
    return LawOverPeriod(law, BASIS).linearize(shown, OMEGA, Environment(C, P, values)).coefficients


def record(number: int, signals: np.ndarray, force: np.ndarray, std: float, rng=None) -> ObservedRecord:
    """A record whose harmonics 1..H of friction and slip have independent noise: `std` N, and 1e-4 of the slip."""
    compared = np.concatenate([np.arange(1, H + 1), BASIS.H + np.arange(1, H + 1)])
    n = len(compared)
    noise = np.zeros((4, BASIS.size, 2 * n))
    noise[0, compared, np.arange(n)] = std
    noise[1, compared, n + np.arange(n)] = 1e-4 * np.abs(signals[:, 0]).max() * min(std / 0.02, 1.0)
    friction, shown = force.copy(), signals.copy()
    friction[np.setdiff1d(np.arange(1, BASIS.size), compared)] = 0.0
    if rng is not None:
        xi = rng.standard_normal(2 * n)
        friction += noise[0] @ xi
        shown[:, 0] += noise[1] @ xi
    return ObservedRecord(
        number=number,
        name=str(number),
        level=float(number),
        hz=OMEGA / (2 * np.pi),
        slips=True,
        friction=friction,
        signals=shown,
        gains=np.zeros((3, BASIS.H + 1), dtype=complex),
        by_mean=np.zeros(BASIS.size),
        noise=noise,
        numerical=0,
        informed=float(n),
    )


def observed(forces: list[np.ndarray], signals: list[np.ndarray], std: float, rng=None) -> Observed:
    """Records numbered from 1."""
    pairs = enumerate(zip(signals, forces, strict=True), start=1)
    return Observed(tuple(record(i, s, f, std, rng) for i, (s, f) in pairs), H, BASIS, C, P)


def fed_back(made: Observed, gain: complex) -> Observed:
    """The same records on a structure that moves by `gain` per force above the harmonics measured."""
    gains = np.zeros((3, BASIS.H + 1), dtype=complex)
    gains[0, H + 1 :] = gain
    gains[0, 0] = abs(gain)
    by_mean = np.zeros(BASIS.size)
    by_mean[1:4] = 0.05
    return replace(made, records=tuple(replace(r, gains=gains, by_mean=by_mean) for r in made.records))
