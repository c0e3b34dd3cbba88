"""What free forces leave of the records of a rig, and what moves with them, whatever the law of a missing joint.

What is not linear of a rig are its joints. With a force at each of their ports free, harmonic by harmonic, all the rest
answers linearly however large the motion is. So a joint at a place leaves no less of the records than a free force
there does; and if it alone is missing, the motion there is that with this force.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hbm.channels import factor
from hbm.diagnosis.discrepancy import LEFT_OVER
from hbm.fourier import Array
from hbm.inverse.sensing import Complex
from hbm.outputerror.records import Measurement, Record
from hbm.sensitivity.jointforces import Ends, between, probed_at
from models.jointed import JointedRig, place_of

NEARLY = 0.99
"""Share of what exceeds noise that a free force at a place must explain, for a joint there to be what is missing."""


class Line(NamedTuple):
    """A harmonic of a record, in standard deviations; c channels, m ports of joints.

    Attributes
    ----------
    through : (n, n) array
        Receptance of the modes.
    read : (c,) array
        What each channel makes of a displacement; 0 where it was not measured.
    missed : (c,) array
        What the linear structure without joints misses.
    by_joints : (c, m) array
        By a unit force at each port.
    force : complex
        Of the excitation [N].
    """

    through: Complex
    read: Complex
    missed: Complex
    by_joints: Complex
    force: complex


def lines(rig: JointedRig, data: Measurement, record: Record) -> Iterator[Line]:
    """Harmonics 1..H of a record beside a rig as it is in it."""
    to, s = _to(rig, data), rig.at_record(record.number).structure
    listed = record.listed.all(axis=0)
    std = record.std if record.std.ndim == 2 else record.std[0]
    weight = np.where(listed, 1.0 / np.where(listed, std, 1.0), 0.0)
    amplitudes = np.where(listed, record.measured[0] + 1j * record.measured[1], 0.0)
    others = np.nan_to_num(record.distortion[0] - 1j * record.distortion[1])
    forces = np.concatenate([[record.force], others]) * rig.excitation.gain(record.level)
    for k in range(data.H):
        rate = np.array(2j * np.pi * record.hz * (k + 1))
        through = np.linalg.inv(np.diag(s.omega_n**2 + rate**2) + rate * s.damping)
        read = weight[:, k] * np.array([factor(rig.response_channels[i], rate) for i in to])
        by = s.channels[to] @ through
        linear = (by @ s.excitation + s.channels_by_force[to]) * forces[k]
        by_joints = read[:, None] * (by @ s.joints.T + s.channels_by_joints[to])
        yield Line(
            np.asarray(through, dtype=complex),
            read,
            weight[:, k] * amplitudes[:, k] - read * linear,
            by_joints,
            complex(forces[k]),
        )


@dataclass(frozen=True, eq=False)
class FreeForces:
    """Noise variances before, and left by a free force at each of p places.

    Attributes
    ----------
    before : float
    left : (p,) array
    spare : int
        Coefficients beyond the unknowns: of so many these are the mean.
    """

    before: float
    left: Array
    spare: int

    @property
    def shares(self) -> Array:
        """Of what exceeds noise, what a force at each place explains, (p,)."""
        return np.asarray(1.0 - (self.left - 1.0) / max(self.before - 1.0, np.finfo(float).tiny))


def free_forces(rig: JointedRig, data: Measurement, rows: Array, flexibility: Array) -> FreeForces | None:
    """Free forces at places of a rig beside records; None where there are hardly more sensors than forces.

    Parameters
    ----------
    rig : JointedRig
    data : Measurement
    rows : (p, n) array
        Of the places, in its modes.
    flexibility : (p, c) array
        Of them to the places of the c channels that were measured.
    """
    s, to = rig.structure, _to(rig, data)
    chi2, gain, points, unknowns = 0.0, np.zeros(len(rows)), 0, 0
    for record in data.records:
        for line in lines(rig, data, record):
            if not line.read.any():
                continue
            of_places = line.read[:, None] * (s.channels[to] @ line.through @ rows.T + flexibility.T)
            missed, of_places = across(line.by_joints, line.missed, of_places)
            size = np.sum(np.abs(of_places) ** 2, axis=0)
            chi2 += float(np.vdot(missed, missed).real)
            gain += np.abs(of_places.conj().T @ missed) ** 2 / np.where(size > 0.0, size, np.inf)
            points += 2 * max(int(np.count_nonzero(line.read)) - line.by_joints.shape[1], 0)
            unknowns += 2
    if points - unknowns <= LEFT_OVER * points:
        return None
    return FreeForces(chi2 / points, (chi2 - gain) / (points - unknowns), points - unknowns)


def _to(rig: JointedRig, data: Measurement) -> list[int]:
    """Which of the response channels were measured, in turn."""
    named = {c.name: i for i, c in enumerate(rig.response_channels)}
    return [named[name] for name in data.channels]


def sensors_of(rig: JointedRig, data: Measurement) -> list[str]:
    """Places of the channels that were measured, in turn."""
    return [place_of(rig.response_channels[i]) for i in _to(rig, data)]


def across(by_joints: Complex, *parts: Complex) -> Iterator[Complex]:
    """Parts (c, ...) of readings that free forces at joints do not make, by what unit ones do, (c, m)."""
    Q = np.linalg.qr(by_joints)[0]
    return (np.asarray(part - Q @ (Q.conj().T @ part)) for part in parts)


class EndsOfRig:
    """Pairs of places of a rig, or places and the ground, beside records: forces there, and the motion.

    Parameters
    ----------
    rig : JointedRig
    data : Measurement
    ends : sequence of Ends, (p,)
    """

    def __init__(self, rig: JointedRig, data: Measurement, ends: Sequence[Ends]) -> None:
        self.rig, self.data = rig, data
        places, self.probed = probed_at(rig, ends)
        first, p = len(places), rig.laden_at([*places, *sensors_of(rig, data)]).modes
        self.signs = between(places, ends)
        self.rows = self.signs @ p.rows[:first]
        self.to_sensors = self.signs @ p.flexibility[:first, first:]
        self.own = np.einsum("pe,ef,pf->p", self.signs, p.flexibility[:first, :first], self.signs)

    @cached_property
    def _found(self) -> FreeForces | None:
        return free_forces(self.rig, self.data, self.rows, self.to_sensors)

    @property
    def told(self) -> bool:
        """Whether a free force at one of them explains nearly all."""
        return self._found is not None and bool(self._found.shares.max(initial=0.0) >= NEARLY)

    def told_by_joints(self, left: float) -> bool:
        """Whether forces at the joints alone explain nearly all of what a model leaves, in noise variances."""
        return self._found is not None and self._found.before - 1.0 <= (1.0 - NEARLY) * (left - 1.0)

    def of_record(self, record: Record) -> tuple[Array, Array, Complex]:
        """What a record misses, what cosines and sines of a force at each of the ends do, and the motion there.

        With free forces at the joints of the rig; the motion with the free force at the same ends.

        Returns
        -------
        (2, c, H) array
            Real and imaginary parts, in standard deviations.
        (2, c, H, p, 2 H) array
        (p, H) complex array
        """
        rig, H, m = self.rig, self.data.H, self.rig.ports
        s, probes = self.probed.at_record(record.number).structure, len(rig.response_channels)
        to, p = _to(rig, self.data), len(self.rows)
        missed, columns = np.zeros((len(to), H), dtype=complex), np.zeros((len(to), H, p, 2 * H), dtype=complex)
        motion = np.zeros((p, H), dtype=complex)
        for k, line in enumerate(lines(rig, self.data, record)):
            by = self.rows @ line.through
            of_ends = line.read[:, None] * (s.channels[to] @ line.through @ self.rows.T + self.to_sensors.T)
            missed[:, k], seen = across(line.by_joints, line.missed, of_ends)
            columns[:, k, :, k], columns[:, k, :, H + k] = seen, -1j * seen
            moved = (by @ s.excitation + self.signs @ s.channels_by_force[probes:]) * line.force
            of_joints = by @ s.joints.T + self.signs @ s.channels_by_joints[probes:]
            for i in range(p if line.read.any() else 0):
                A = np.column_stack([line.by_joints, of_ends[:, i]])
                found = np.linalg.lstsq(A, line.missed, rcond=None)[0]
                own = by[i] @ self.rows[i] + self.own[i]
                motion[i, k] = moved[i] + of_joints[i] @ found[:m] + own * found[m]
        return np.array([missed.real, missed.imag]), np.array([columns.real, columns.imag]), motion
