"""Friction in the clamp over one period: coefficients of the moment if nothing had slid in, of the slid rotation out.

It is a friction law as that of the contact is, with another motion: the same march closes its loop and differentiates.
"""

from dataclasses import dataclass

import numpy as np

from hbm.aft.force import Environment, InputChange, LawOverPeriod
from hbm.fourier import Array, FourierBasis
from models.clamp import SlippingClamp
from models.structure import SpringPort


@dataclass(frozen=True, eq=False)
class ClampMotion:
    """A clamp over one period.

    Attributes
    ----------
    signals : (2H+1, 4) array
        What the law is shown: the rotation M_held / stiffness [rad], M_held the moment if nothing had slid; a velocity
        and a load that it does not look at.
    slid : (2H+1,) array
        Coefficients of the slid rotation [rad].
    moment : (2H+1,) array
        Coefficients of the moment [N m].
    closure : float
        How far the loop is from closed.
    """

    signals: Array
    slid: Array
    moment: Array
    closure: float

    @property
    def taken(self) -> float:
        """Energy that friction takes in one period [J], the area of the loop of the moment over what is slid."""
        H = len(self.slid) // 2
        a, b = slice(1, H + 1), slice(H + 1, None)
        k = np.arange(1, H + 1)
        return float(np.pi * k @ (self.moment[a] * self.slid[b] - self.moment[b] * self.slid[a]))


@dataclass(frozen=True, eq=False)
class ClampChange:
    """Derivatives to p parameters of what decides a clamp's motion.

    Attributes
    ----------
    held : (2H+1, p) array
        Derivative of the moment if nothing had slid.
    stiffness, limit : (p,) array
        Derivatives of the moment that a slid rotation takes back, and of the largest moment.
    """

    held: Array
    stiffness: Array
    limit: Array


class ClampOverPeriod:
    """The clamp of a rig that slips, on a Fourier basis.

    One object serves one thread: it owns the buffers that CasADi reads and fills.
    """

    def __init__(self, port: SpringPort, limit: float, basis: FourierBasis) -> None:
        self.port, self.basis = port, basis
        self._law = LawOverPeriod(SlippingClamp(limit, port.stiffness), basis)
        self._environment = Environment(0.0, 0.0, np.array([limit, port.stiffness]))

    def held(self, Q: Array, T: Array, force: Array) -> Array:
        """Moment if nothing had slid (2H+1, ...), of coefficients of modes (2H+1, n, ...), friction and excitation."""
        by_modes = np.einsum("kn...,n->k...", Q, self.port.row)
        return np.asarray(by_modes + self.port.residual[0] * T + self.port.residual[1] * force)

    def change(self, d: SpringPort, limit: Array, d_force: Array, Q: Array, T: Array, force: Array) -> ClampChange:
        """Derivatives to p parameters that change the port, the limit (p,) and the excitation (2H+1, p), in a state."""
        held = Q @ d.row.T + np.outer(T, d.residual[:, 0])
        held += self.port.residual[1] * d_force + np.outer(force, d.residual[:, 1])
        return ClampChange(held, d.stiffness, limit)

    def motion(self, held: Array, Omega: float) -> ClampMotion:
        """The clamp under a moment if nothing had slid (2H+1,)."""
        signals = np.zeros((self.basis.size, 4))
        signals[:, 0] = held / self.port.stiffness
        T, closure = self._law.force(signals, Omega, self._environment)
        moment = -self.basis.analysis @ T
        return ClampMotion(signals, (held - moment) / self.port.stiffness, moment, closure)

    def slope(self, motion: ClampMotion, Omega: float) -> Array:
        """Derivative of what is slid to the moment if nothing had slid, (2H+1, 2H+1)."""
        force = self._law.linearize(motion.signals, Omega, self._environment)
        slope = np.eye(self.basis.size)
        if force.by_u is not None:
            slope += force.by_u / self.port.stiffness
        return np.asarray(slope / self.port.stiffness)

    def along(self, motion: ClampMotion, Omega: float, change: ClampChange) -> Array:
        """Derivatives of what is slid, (2H+1, p)."""
        k, none = self.port.stiffness, np.zeros_like(change.limit)
        u = (change.held - np.outer(motion.signals[:, 0], change.stiffness)) / k
        signals = np.stack([u, 0 * u, 0 * u], axis=1)
        law = np.array([change.limit, change.stiffness, none])
        T = self._law.along(motion.signals, Omega, self._environment, InputChange(signals, none, law))
        return np.asarray(u + (self.basis.analysis @ T + np.outer(motion.moment, change.stiffness) / k) / k)
