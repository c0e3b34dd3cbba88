"""Balances of one rig with one contact at several frequencies and forces, solved together.

What is worked out for each of them alone takes some hundred small operations; here records stand on a leading axis, and
the same operations serve all. The equations are those of :class:`hbm.balance.equations.Balance`. Rigs with elements all
along the beam, and those whose tip lifts off, are solved one by one.
"""

from collections.abc import Iterable, Sequence
from typing import Any, Generic, NamedTuple, TypeGuard, TypeVar

import numpy as np
import numpy.typing as npt

from hbm.aft.force import ContactForce, InputChange
from hbm.balance.clamp import ClampChange
from hbm.balance.jointed import JointBalance
from hbm.balance.places import Given, Places
from hbm.balance.problem import HarmonicBalance, Kinematics
from hbm.balance.slipping import slipping
from hbm.channels import factor
from hbm.fourier import Array
from models.change import is_of_contact
from models.elements import Reading
from models.jointed import AnyRig
from models.parts import Channel
from models.rig import Rig

Which = npt.NDArray[np.intp]

MOST_ELEMENTS = 4
"""Rigs with more elements are solved one by one: what places add to a system grows with the square of their number."""


def is_batched(rig: AnyRig) -> TypeGuard[Rig]:
    """Whether records of a rig can be solved together: nonlinear at single places, where alone it may drift."""
    if not isinstance(rig, Rig) or rig.excitation.measured_harmonics:
        return False
    at_places = len(rig.acting) <= MOST_ELEMENTS and all(e.reads is Reading.POINT for e in rig.acting)
    return at_places and all(is_of_contact(drift.parameter) for drift in rig.drift)


def some(values: Array, which: Which | None) -> Array:
    """Those of some records, of all where None; large ones are not copied where all are meant."""
    return values if which is None or len(which) == len(values) else values[which]


def put(values: Iterable[Array | None], which: Which, others: Iterable[Array | None]) -> None:
    """Put others in the place of those of some records."""
    for mine, theirs in zip(values, others, strict=True):
        if mine is not None and theirs is not None:
            mine[which] = theirs


def amplitudes(coefficients: Array) -> npt.NDArray[np.complex128]:
    """Amplitudes (R, H+1, ...) of coefficients (R, 2H+1, ...), as :meth:`hbm.fourier.FourierBasis.complex`."""
    H = coefficients.shape[1] // 2
    found = coefficients[:, : H + 1].astype(complex, order="C")  # in the order of its axes, so that rows are views
    found[:, 1:].imag = -coefficients[:, H + 1 :]
    return found


def real(amplitudes: npt.NDArray[np.complex128]) -> Array:
    """Coefficients (R, 2H+1, ...), inverse of :func:`amplitudes`."""
    return np.concatenate([amplitudes.real, -amplitudes.imag[:, 1:]], axis=1)


class Motions(NamedTuple):
    """States of some balances: Q (R, 2H+1, n) and T (R, 2H+1), of joints (R, 2H+1, m)."""

    Q: Array
    T: Array

    def of(self, which: Any) -> "Motions":
        """Some of them."""
        return Motions(self.Q[which], self.T[which])


class Seen(NamedTuple):
    """What states do at the contact, and what they leave of their balances.

    Attributes
    ----------
    Gq, pull : (R, 2H+1, n) array
        As of :class:`hbm.balance.equations.Kinematics`: zeros and None where the structure is not drawn in.
    signals : (R, 2H+1, 4) array
        Coefficients of u, v, rho, eta.
    modal, contact : (R, 2H+1, n) and (R, 2H+1) array
        Balance of forces on each mode, and on the contact [N].
    norm : (R,) array
        The largest of these in the units of the residual.
    given : (R, 2H+1, j) array
        What places give that give way.
    """

    Gq: Array
    pull: Array | None
    signals: Array
    modal: Array
    contact: Array
    norm: Array
    given: Array

    def of(self, which: Any) -> "Seen":
        """What some of them do."""
        pull = None if self.pull is None else self.pull[which]
        parts = self.signals, self.modal, self.contact, self.norm, self.given
        return Seen(self.Gq[which], pull, *(part[which] for part in parts))


class Slopes(NamedTuple):
    """Derivatives (R, 2H+1, 2H+1) of the law's force coefficients to those of u, rho, eta; None where there is none."""

    by_u: Array | None
    by_rho: Array | None
    by_eta: Array | None

    def at(self, which: Any) -> "Slopes":
        """Those of some records."""
        return Slopes(*(None if slope is None else slope[which] for slope in self))

    def of(self, u: Array, rho: Array, eta: Array) -> Array:
        """Change (R, 2H+1, p) of the force coefficients with those of the three."""
        out = np.zeros_like(u)
        for slope, signal in zip(self, (u, rho, eta), strict=True):
            if slope is not None:
                out += slope @ signal
        return out


AnyProblem = TypeVar("AnyProblem", HarmonicBalance, JointBalance)


class Together(Generic[AnyProblem]):
    """Balances of one rig, as many as there are records.

    Parameters
    ----------
    problems : sequence of HarmonicBalance or JointBalance
        Of one rig; they differ in their level, and in what a contact is like.
    hz : (R,) array
        Frequency of each.
    """

    def __init__(self, problems: Sequence[AnyProblem], hz: Array) -> None:
        first = problems[0]
        self.problems: Sequence[AnyProblem] = problems
        self.first: AnyProblem = first
        self.structure: Any = first.structure
        self.basis, self.hz = first.basis, hz
        self.Omega = 2 * np.pi * hz[:, None]
        self.force = np.array([p.level for p in problems])[:, None] * first.force_shape
        self.modal_unit = np.array([p.modal_force_ref for p in problems])

    def turning(self, series: Array) -> Array:
        """Derivatives to the phase of series (R, 2H+1, ...)."""
        factor = self.basis.signed_k.reshape(-1, *(1,) * (series.ndim - 2))
        return np.asarray(factor * series[:, self.basis.swapped])

    def read(self, sensor: Channel, displacement: Array) -> Array:
        """What a sensor reads of displacements (R, 2H+1, ...) at its place."""
        factors = factor(sensor, 1j * self.Omega * np.arange(self.basis.H + 1))
        return real(amplitudes(displacement) * factors.reshape(*factors.shape, *(1,) * (displacement.ndim - 2)))


class Batch(Together[HarmonicBalance]):
    """Balances of one rig with one contact, as many as there are records.

    Parameters
    ----------
    problems : sequence of HarmonicBalance
        Of one rig; they differ in their level, and in what their contact is like.
    hz : (R,) array
        Frequency of each.
    """

    def __init__(self, problems: Sequence[HarmonicBalance], hz: Array) -> None:
        super().__init__(problems, hz)
        first, s, basis = self.first, self.structure, self.basis
        self.load = np.array([p.environment.load for p in problems])
        self.q_unit = np.array([p.q_ref for p in problems])
        self.contact_unit = np.array([p.F_ref for p in problems])
        rate = self.Omega[:, :, None]
        self.direct = s.omega_n**2 - (rate * basis.k[:, None]) ** 2
        self._marched: list[Array] = [np.empty(0)] * len(problems)
        self.places = Places.of(first)
        self._given = [Given(np.empty((0, 0)), None, None)] * len(problems)
        self.crossed = rate * (basis.signed_k[:, None] * s.damping)

    def of(self, which: Which) -> "Batch":
        """Those of some records."""
        others = Batch([self.problems[i] for i in which], self.hz[which])
        others._marched, others._given = ([known[i] for i in which] for known in (self._marched, self._given))
        return others

    # ---- the equations

    def along(self, i: int, change: InputChange) -> Array:
        """Change of the friction of record `i`, where it was marched last, at the samples (N_t, p)."""
        problem = self.problems[i]
        return problem.law.along(self._marched[i], float(self.Omega[i, 0]), problem.environment, change)

    def slid_along(self, i: int, change: ClampChange) -> Array:
        """Derivatives (2H+1, p) of what is slid in the clamp of record `i`, where it was looked at last."""
        clamp, motion = slipping(self.problems[i], self._given[i].clamp)
        return clamp.along(motion, float(self.Omega[i, 0]), change)

    def turned(self, Q: Array, which: Which | None = None) -> Array:
        """Dynamic stiffness times motions (R, 2H+1, n) or (R, 2H+1, n, p)."""
        other = Q[:, self.basis.swapped]
        direct, crossed = some(self.direct, which), some(self.crossed, which)
        if Q.ndim == 3:
            return np.asarray(direct * Q + crossed * other)
        return np.asarray(direct[..., None] * Q + crossed[..., None] * other)

    def reaction_of(self, rows: Array, which: Which | None = None) -> Array:
        """Coefficients (R, 2H+1, ...) of the reaction's part from the modes, of rows (R, 2H+1, 3, ...) times these."""
        basis, trailing = self.basis, (1,) * (rows.ndim - 3)
        Omega = some(self.Omega, which)
        inertia, damping, stiffness = rows[:, :, 0], rows[:, :, 1], rows[:, :, 2]
        turning = (Omega * basis.signed_k).reshape(len(Omega), -1, *trailing)
        squared = ((Omega * basis.k) ** 2).reshape(len(Omega), -1, *trailing)
        return np.asarray(turning * damping[:, basis.swapped] - squared * inertia + stiffness)

    def seen(self, motions: Motions, which: Which) -> Seen:
        """What motions of some of the records do, and leave."""
        first, s, basis, (Q, T) = self.first, self.structure, self.basis, motions
        force, Omega = some(self.force, which), some(self.Omega, which)
        rows = Q @ first.rows
        signals = np.zeros((*T.shape, 4))
        u = signals[..., 0]
        u[:] = rows[..., 0]
        Gq, pull = np.zeros_like(Q), None
        if first.coupled:
            Gq = Q @ s.shortening
            shorter, pull = self._drawn_in(Q, Gq, T)
            u -= shorter
        if first.dynamic_lagrangian:
            u -= first.dynamic_lagrangian * T
        u += s.residual.slip_by_force * force
        if first.varies:
            signals[..., 2] = self.reaction_of(rows[..., 1:4], which) - s.reaction.force_share * force
            signals[..., 3] = rows[..., 4]
            signals[:, 0, 3] -= s.reaction.friction_lever
        signals[:, 0, 2] += some(self.load, which)
        modal = self.turned(Q, which) - T[..., None] * s.slip_row - force[..., None] * s.excitation
        if pull is not None:
            modal += pull
        given = self._gives(motions, which)
        if self.places:
            pushed = given[..., None]
            u += self.places.onto(0, pushed)[..., 0]
            signals[..., 2] += self.places.onto(-1, pushed)[..., 0]
            modal -= self.places.onto_modes(pushed)[..., 0]
        signals[..., 1] = Omega * basis.signed_k * u[:, basis.swapped]
        # record by record, as all products here: what one is does not depend on the others, to the last bit
        marched = [basis.analysis @ self.law(i, signals[at]) for at, i in enumerate(which)]
        contact = T - np.stack(marched)
        norm = np.maximum(
            np.abs(modal).max(axis=(1, 2)) / some(self.modal_unit, which),
            np.abs(contact).max(axis=1) / some(self.contact_unit, which),
        )
        return Seen(Gq, pull, signals, modal, contact, norm, given)

    def _gives(self, motions: Motions, which: Which) -> Array:
        """What the places of some records give, (R, 2H+1, j)."""
        if not self.places:
            return np.zeros((*motions.T.shape, 0))
        for at, i in enumerate(which):
            self._given[i] = self._at(i, motions.Q[at], motions.T[at])
        return np.stack([self._given[i].series for i in which])

    def _at(self, i: int, Q: Array, T: Array) -> Given:
        return self.places.given(self.problems[i], Q, T, self.force[i], float(self.Omega[i, 0]))

    def yielding(self, which: Which, motions: Motions, seen: Seen) -> Array:
        """Derivative (R, 2H+1, j, 2H+1, j) of what places give to what they read."""
        if not self.places:
            return np.zeros((*motions.T.shape, 0, self.basis.size, 0))
        slopes = []
        for at, (i, Q) in enumerate(zip(which, motions.Q, strict=True)):
            given = self._given[i]
            if not np.array_equal(given.series, seen.given[at]):
                given = self._at(i, Q, motions.T[at])
            slopes.append(self.places.slope(self.problems[i], given, Q, self.force[i], float(self.Omega[i, 0])))
        return np.stack(slopes)

    def law(self, i: int, signals: Array) -> Array:
        """Friction of record `i` at the samples (N_t,), for signals (2H+1, 4)."""
        problem, self._marched[i] = self.problems[i], signals
        return problem.law.force(signals, float(self.Omega[i, 0]), problem.environment)[0]

    def kinematics(self, i: int, seen: Seen) -> Kinematics:
        """Of record `i`, whose law was marched there last."""
        pull, given = None if seen.pull is None else seen.pull[i], self._given[i]
        return Kinematics(seen.Gq[i], pull, self._marched[i], given.elements, given.clamp)

    def slopes(self, signals: Array, which: Which) -> tuple[Slopes, Array]:
        """Derivatives of the friction of some records to their signals (R, 2H+1, 4), and to Omega, (R, 2H+1)."""
        found = [self.linearized(i, signals[at]) for at, i in enumerate(which)]
        by_signals = ([getattr(c, name) for c in found] for name in ("by_u", "by_rho", "by_eta"))
        slopes = Slopes(*(None if values[0] is None else np.stack(values) for values in by_signals))
        return slopes, np.stack([c.by_Omega for c in found])

    def linearized(self, i: int, signals: Array) -> ContactForce:
        """Friction of record `i` with its derivatives."""
        problem, marched = self.problems[i], self._marched[i]
        if np.array_equal(signals, marched):  # the law knows its last period by the array it was shown
            signals = marched
        return problem.law.linearize(signals, float(self.Omega[i, 0]), problem.environment)

    def _drawn_in(self, Q: Array, Gq: Array, T: Array) -> tuple[Array, Array]:
        """By how much motions shorten the structure, q' G q / 2 (R, 2H+1), and T G q (R, 2H+1, n)."""
        fine, n = self.basis.exact_products, self.structure.n
        samples = fine.synthesis @ np.concatenate([T[..., None], Q, Gq], axis=2)
        drawn = samples[..., 1 + n :]
        shorter = np.einsum("rti,rti->rt", drawn, samples[..., 1 : 1 + n])
        products = fine.analysis @ np.concatenate([shorter[..., None], samples[..., :1] * drawn], axis=2)
        return 0.5 * products[..., 0], products[..., 1:]
