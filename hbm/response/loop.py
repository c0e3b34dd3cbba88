"""Loops of a friction law under a prescribed periodic slip: what the law does, with no structure around it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hbm.aft.force import Environment, LawOverPeriod
from hbm.balance.solution import path_work
from hbm.fourier import Array, FourierBasis
from models import FrictionLaw, parameters

RIGID = 1e-5
"""Share of the slip by which the static load would stretch the compliance given to a set-valued law that has none."""


@dataclass(frozen=True, eq=False)
class FrictionLoop:
    """One steady period of a law.

    Attributes
    ----------
    law : FrictionLaw
    hz, load, compliance : float
        Frequency [Hz], static normal load P [N] and series compliance C [m/N].
    time : (N_t,) array
        Instants of the samples [s].
    u, v : (N_t,) array
        Prescribed slip [m] and slip velocity [m/s].
    w : (N_t,) array
        Displacement of the contact itself, u + C T [m].
    T, R : (N_t,) array
        Friction force [N], against the slip, and normal reaction [N].
    dissipated : float
        Energy lost per period [J], the area of the loop.
    closure : float
        Change of the force from one period to the next, relative to its peak.
    """

    law: FrictionLaw
    hz: float
    load: float
    compliance: float
    time: Array
    u: Array
    v: Array
    w: Array
    T: Array
    R: Array
    dissipated: float
    closure: float

    def __repr__(self) -> str:
        """Law, peak force, energy lost and closure."""
        return (
            f"friction loop of {self.law.name} at {self.hz:.6g} Hz under {self.load:g} N: "
            f"slip up to {np.abs(self.u).max():.4g} m, force up to {np.abs(self.T).max():.4g} N, "
            f"{self.dissipated:.4g} J a period, closed to {self.closure:.1g}"
        )


def friction_loop(
    law: FrictionLaw,
    slip: npt.ArrayLike,
    hz: float,
    *,
    load: float,
    compliance: float = 0.0,
    reaction: npt.ArrayLike | None = None,
    samples: int = 1024,
) -> FrictionLoop:
    """Steady friction force of a law under a prescribed slip.

    Parameters
    ----------
    law : FrictionLaw
    slip : float or (2H+1,) array
        Amplitude of a cosine [m], or Fourier coefficients a_0, a_1..a_H, b_1..b_H of the slip [m].
    hz : float
        Fundamental frequency [Hz].
    load : float
        Static normal load P [N], to which nominal stiffnesses refer.
    compliance : float
        Series compliance C [m/N]; the slip prescribed is then that of its far end. A set-valued law needs some: where
        0, it is given so little that the load would stretch it by 1e-5 of the slip.
    reaction : (2H+1,) array, optional
        Fourier coefficients of the normal reaction R(t) [N]; the load where omitted.
    samples : int
        Samples per period.

    Returns
    -------
    FrictionLoop

    Raises
    ------
    ValueError
        If an argument is out of range.

    Examples
    --------
    >>> from hbm.models import Jenkins
    >>> loop = friction_loop(Jenkins(mu=0.5, critical_slip=4e-6), 1e-5, 50.0, load=80.0)
    >>> f"{loop.T.max():.6g} N, {loop.dissipated:.3g} J"  # mu P, and 4 mu P (amplitude - critical slip)
    '40 N, 0.00096 J'
    """
    if isinstance(law, type) or not hasattr(law, "set_valued") or hasattr(law, "ports"):
        raise ValueError(f"friction_loop: law = {law!r:.80}; must be a friction law, such as Jenkins(0.5, 4e-6)")
    u, R = _coefficients(slip), np.atleast_1d(np.asarray(load if reaction is None else reaction, dtype=float))
    _check(u, R, hz, load, compliance, samples)
    basis = FourierBasis(max(len(u), len(R), 3) // 2, samples)
    signals = np.zeros((basis.size, 4))
    Omega = 2 * np.pi * hz
    signals[:, 0] = _padded(u, basis)
    signals[:, 1] = Omega * basis.derivative(signals[:, 0])
    signals[:, 2] = _padded(R, basis)
    if law.set_valued and compliance == 0.0:
        compliance = RIGID * float(np.ptp(basis.synthesis @ signals[:, 0])) / 2.0 / load
    known = Environment(compliance, load, np.array(list(parameters(law).values()), dtype=float))
    T, closure = LawOverPeriod(law, basis).force(signals, Omega, known)
    T = T.copy()
    u, v, R, _ = (basis.synthesis @ signals).T
    w = u + compliance * T
    return FrictionLoop(
        law,
        hz,
        load,
        compliance,
        basis.theta / Omega,
        u,
        v,
        w,
        T,
        R,
        dissipated=-path_work(np.asarray, T, w),
        closure=closure,
    )


def _coefficients(slip: npt.ArrayLike) -> Array:
    values = np.asarray(slip, dtype=float)
    return np.array([0.0, float(values), 0.0]) if values.ndim == 0 else values


def _padded(coefficients: Array, basis: FourierBasis) -> Array:
    """Coefficients with zeros for the harmonics they leave out."""
    H, padded = len(coefficients) // 2, np.zeros(basis.size)
    padded[: H + 1], padded[basis.H + 1 : basis.H + 1 + H] = coefficients[: H + 1], coefficients[H + 1 :]
    return padded


def _check(u: Array, R: Array, hz: float, load: float, compliance: float, samples: int) -> None:
    for name, values in {"slip": u, "reaction": R}.items():
        if values.ndim != 1 or len(values) % 2 == 0 or not np.isfinite(values).all():
            raise ValueError(f"friction_loop: {name} of shape {values.shape}; must be 2H+1 finite coefficients")
    if not u[1:].any():
        raise ValueError("friction_loop: slip is constant; must move")
    bounds: dict[str, tuple[Any, bool]] = {
        "hz": (hz, hz > 0.0),
        "load": (load, load > 0.0),
        "compliance": (compliance, compliance >= 0.0),
    }
    for name, (value, within) in bounds.items():
        if not (within and np.isfinite(value)):
            raise ValueError(f"friction_loop: {name} = {value}; must be {'>=' if name == 'compliance' else '>'} 0")
    if samples < 16:
        raise ValueError(f"friction_loop: samples = {samples}; must be >= 16")
