"""What touches at rest, under small motions: the stiffness and the loss of joints, and the modes with them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.linalg import null_space

from hbm.aft.joint import JointOverPeriod
from hbm.balance.rest import at_rest
from hbm.errors import InputError
from hbm.fourier import FourierBasis
from models.jointed import AnyRig, JointedRig
from models.joints import Friction, JointLaw, PlaneFriction
from models.structure import Array

Complex = npt.NDArray[np.complex128]

SAMPLES = 64
"""Per period of the small motions that laws are asked at."""

ROUNDS, SETTLED = 10, 1e-9
"""Times a mode is found anew with what touches as stiff as at its frequency, at most, and when that is settled."""


AT_REST = 1e-6
"""A rigid motion, that has no frequency, asks for stiffnesses at this share of the first elastic one."""

STILL = 1e-7
"""A root is zero, or real, to within this share of the first elastic frequency, or of itself."""

RIGID = 1e-6
"""Of the highest natural frequency: a lower one is that of a rigid motion, by rounding."""


def first_sliding(rig: AnyRig) -> float:
    """The first natural frequency with all that can slide sliding [rad/s]; rigid motions have one on springs alone.

    Raises
    ------
    InputError
        If there is none.
    """
    omega = rig.structure.omega_n
    if isinstance(rig, JointedRig) and not omega.all():
        omega = Touching(replace(rig, joints=tuple(j for j in rig.joints if not j.law.drifting))).modes()[0]
    first = first_of(omega)
    if np.isnan(first):
        raise InputError(f"{rig.name}: no spring holds it, so there is no resonance; must have a range of frequencies")
    return first


def first_of(omega: Array) -> float:
    """The first of ascending natural frequencies that is of no rigid motion; nan where all are."""
    elastic = omega[omega > RIGID * omega.max(initial=0.0)]
    return float(elastic[0]) if elastic.size else np.nan


class Touching:
    """All that touches at rest, under small motions of the ports.

    Attributes
    ----------
    ports : list of slice
        Of each joint.
    rigid : list of int
        Ports that are held rigidly.
    sliding : list of int
        Ports along which nothing acts: their joints are open at rest.
    """

    def __init__(self, rig: AnyRig) -> None:
        self.rig, basis, rest = rig, FourierBasis(1, SAMPLES), at_rest(rig)
        laws: list[JointLaw]
        if isinstance(rig, JointedRig):
            laws, flexibility = [j.law for j in rig.joints], rig.structure.flexibility
            moved = rig.structure.joints @ rest.Q[0] + flexibility @ rest.T[0]
        else:  # the contact of a beam is one
            laws = [Friction(rig.contact.law, rig.contact.normal_load)]
            flexibility, moved = np.array([[rig.structure.compliance]]), np.zeros(1)
        first = np.cumsum([0, *(law.ports for law in laws)])
        self.ports = [slice(int(a), int(b)) for a, b in pairwise(first)]
        own = np.zeros(len(moved))
        open_ = [_open(law, rest.T[:, at]) for law, at in zip(laws, self.ports, strict=True)]
        for law, at in zip(laws, self.ports, strict=True):
            moved[at][: law.drifting] = 0.0  # what sticks does so where it is at rest
            own[at.start] = flexibility[at.start, at.start] * law.set_valued
        touching = [(law, at) for law, at, loose in zip(laws, self.ports, open_, strict=True) if not loose]
        holding = [at.start for law, at in touching if law.set_valued]
        self.sliding = [
            port
            for law, at, loose in zip(laws, self.ports, open_, strict=True)
            for port in range(at.start, at.start + law.drifting * loose)
        ]
        self.rigid = [port for port in holding if not own[port]]
        self.yielding = flexibility - np.diag(own)
        self.laws = [
            (JointOverPeriod(law, basis, self._lent(at.start, own), loaded=False), moved[at])
            for law, at in zip(laws, self.ports, strict=True)
        ]

    def _lent(self, port: int, own: Array) -> float:
        """Compliance that a set-valued law needs, its own or, where it is held rigidly, any: it does not move."""
        return 1.0 if port in self.rigid else float(own[port])

    def stiffness(self, omega: float) -> Complex:
        """Force per displacement, seen by the modes, (m, m) [N/m]: in series with what the modes leave out.

        The imaginary part is what is lost. Ports that are held rigidly do not move, whatever it is there. A rigid
        motion is as slow as none.
        """
        m, slow = len(self.yielding), AT_REST * self._first_elastic
        K = np.zeros((m, m), dtype=complex)
        for (period, mean), at in zip(self.laws, self.ports, strict=True):
            K[at, at] = _small(period, max(omega, slow), mean)
        K[self.sliding] = 0.0  # within limits that are zero laws have no one slope
        return np.asarray(K @ np.linalg.inv(np.eye(m) + self.yielding @ K))

    @property
    def at_contact(self) -> float:
        """Stiffness of a single contact at the first sliding resonance [N/m], inf where it is held rigidly."""
        return np.inf if self.rigid else float(self.stiffness(self._first_elastic).real[0, 0])

    def modes(self) -> tuple[Array, Array]:
        """Natural frequencies (m,) [rad/s] and mass-normalised shapes (n, m) with what touches held by its stiffness.

        Each mode feels the stiffness at its own frequency. Where ports are held rigidly they are those of the motions
        without slip, m = n less these.
        """
        K = self.stiffness(self._first_elastic).real
        omega, shapes = self._held(K)
        ends = [self.stiffness(float(w)).real for w in (*omega[:1], *omega[-1:]) if w > 0.0]
        if all(np.allclose(end, K, rtol=SETTLED, atol=0.0) for end in ends):
            return omega, shapes
        for i in np.flatnonzero(omega):
            for _ in range(ROUNDS):
                before = omega[i]
                again, there = self._held(self.stiffness(float(before)).real)
                omega[i], shapes[:, i] = again[i], there[:, i]
                if abs(omega[i] - before) <= SETTLED * omega[i]:
                    break
        return omega, shapes

    def damping(self, omega: float, shape: Array) -> float:
        """Damping 2 zeta omega of a mode with what touches held, of the structure and of what touches [1/s].

        What touches damps to first order; where that would be beyond critical it holds rather than damps, and does not
        count.
        """
        s, K = self.rig.structure, self.stiffness(omega)
        moved = s.joints @ shape
        lost = float(moved @ K.imag @ moved) / omega
        return s.damps(shape) + (lost if lost < 2.0 * omega else 0.0)

    def damped(self) -> tuple[Array, Array]:
        """Natural frequencies (m,) [rad/s] and damping ratios (m,) with what touches, the lowest first.

        Those of :meth:`modes` where nothing damps one mode through another; else of complex modes, each of which feels
        stiffness and damping at its own natural frequency.
        """
        omega, shapes = self.modes()
        moving = omega[omega > 0.0]
        forces = np.array([self.stiffness(float(w)) for w in moving]).reshape(len(moving), *self.yielding.shape)
        small = SETTLED * np.abs(forces).max(initial=0.0)
        if np.all(np.abs(forces.imag) <= small) and _diagonal(self.rig.structure.damping):
            held = [self.rig.structure.damps(shape) for shape in shapes.T]
            return omega, np.array(held) / (2 * elastic(omega))
        rates = forces.imag / moving[:, None, None]
        off = [np.abs(values - values[:1]).max(initial=0.0) for values in (forces.real, rates)]
        if moving.size and off[0] <= small and off[1] <= SETTLED * np.abs(rates).max(initial=0.0):  # at all frequencies
            return self._complex(float(moving[0]))
        ratio = np.zeros(len(omega))
        for i in range(len(omega)):
            for _ in range(ROUNDS):
                before = omega[i] or self._first_elastic
                omegas, ratios = self._complex(float(before))
                omega[i], ratio[i] = omegas[i], ratios[i]
                if abs(omega[i] - before) <= SETTLED * before:
                    break
        ascending = np.argsort(omega, kind="stable")
        return omega[ascending], ratio[ascending]

    def _complex(self, omega: float) -> tuple[Array, Array]:
        """Natural frequencies and damping ratios with stiffness and damping of what touches at one frequency."""
        s, K, free = self.rig.structure, self.stiffness(omega), self._free
        damping = s.damping if np.ndim(s.damping) == 2 else np.diag(s.damping)
        stiffness = free.T @ (np.diag(s.omega_n**2) + s.joints.T @ K.real @ s.joints) @ free
        damping = free.T @ (damping + s.joints.T @ (K.imag / omega) @ s.joints) @ free
        m = len(stiffness)
        roots = np.linalg.eigvals(np.block([[np.zeros((m, m)), np.eye(m)], [-stiffness, -damping]]))
        unit, sizes = self._first_elastic, np.linalg.svd(stiffness, compute_uv=False)
        least = max((STILL * unit) ** 2, m * np.finfo(float).eps * sizes.max(initial=0.0))
        return _natural(roots, unit, int(np.count_nonzero(sizes <= least)))

    @property
    def _free(self) -> Array:
        """Motions (n, m) of the modes in which no port that is held rigidly moves."""
        s = self.rig.structure
        return np.asarray(null_space(s.joints[self.rigid]) if self.rigid else np.eye(s.n))

    @property
    def _first_elastic(self) -> float:
        """The lowest natural frequency without what touches that is none of a rigid motion [rad/s]."""
        omega = self.rig.structure.omega_n
        return float(omega[omega > 0.0][0]) if omega.any() else 2 * np.pi

    def _held(self, K: Array) -> tuple[Array, Array]:
        """Modes with a stiffness between the ports, those that are held rigidly held."""
        s, free = self.rig.structure, self._free
        squares, shapes = np.linalg.eigh(free.T @ (np.diag(s.omega_n**2) + s.joints.T @ K @ s.joints) @ free)
        return np.sqrt(np.maximum(squares, 0.0)), np.asarray(free @ shapes)


def elastic(omega: Array) -> Array:
    """Frequencies, infinite those of rigid motions."""
    return np.where(omega > 0.0, omega, np.inf)


def _diagonal(damping: Array) -> bool:
    """Whether damping, of each mode or between them, damps each mode alone."""
    return np.ndim(damping) == 1 or not np.any(damping - np.diag(np.diag(damping)))


def _natural(roots: Complex, unit: float, unheld: int) -> tuple[Array, Array]:
    """Natural frequencies and damping ratios of roots in pairs, the lowest first.

    Of motions that no stiffness holds, `unheld` of them, one root is zero, and both where nothing damps them. Real ones
    make a pair with what is as far from the end of their row: of several modes that do not oscillate the slowest root
    and the fastest are one.
    """
    still = np.abs(roots) <= STILL * unit
    turning = roots[~still & (roots.imag > STILL * np.abs(roots))]
    decaying = np.sort(-roots[~still & (np.abs(roots.imag) <= STILL * np.abs(roots))].real)
    zeros = int(np.count_nonzero(still))
    alone = max(2 * unheld - zeros, zeros % 2)
    rigid = (zeros - alone) // 2
    slow, fast = decaying[alone:][: (len(decaying) - alone) // 2], decaying[::-1]
    between = np.sqrt(np.abs(slow * fast[: len(slow)]))
    omega = np.concatenate([np.zeros(rigid + alone), np.abs(turning), between])
    ratio = np.concatenate(
        [
            np.zeros(rigid),
            np.full(alone, np.inf),
            -turning.real / np.abs(turning),
            (slow + fast[: len(slow)]) / (2 * between),
        ]
    )
    ascending = np.argsort(omega, kind="stable")
    return omega[ascending], ratio[ascending]


def _open(law: JointLaw, forces: Array) -> bool:
    """Whether a joint that may separate does so at rest, by its forces there (1, ports)."""
    return isinstance(law, Friction | PlaneFriction) and bool(law.separated(forces).all())


def _small(period: JointOverPeriod, omega: float, mean: Array) -> Complex:
    """Complex amplitudes of the forces of a joint per displacement of its ports about means, (ports, ports) [N/m]."""
    m, K = period.ports, np.zeros((period.ports, period.ports), dtype=complex)
    signals = np.zeros((period.basis.size, 2 * m + 1))
    signals[0, :m] = mean
    found = period.linearize(signals, omega)
    for signal, by in zip(found.used, found.by_used, strict=True):
        if signal < 2 * m:  # a displacement, or one whose rate is the velocity
            K[:, signal % m] -= by[:, 1, 1] - 1j * by[:, 2, 1]
    return K
