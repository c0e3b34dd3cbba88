"""Where a structure given by its matrices lacks a force, of all its degrees of freedom, whatever the force.

What is not linear of it are the joints of its rig file. Where a force at each of their ports is free, harmonic by
harmonic, all the rest answers linearly however large the motion is: what a free force at one more place then leaves of
the records says whether a joint is missing there, before anything is known of its law.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbm.channels import factor
from hbm.diagnosis.discrepancy import ALIKE, LEFT_OVER
from hbm.fourier import MANY, Array
from hbm.inverse.sensing import Readings, readings
from hbm.measurement.spectra import MeasuredSpectra
from models.bodies import MatrixBody
from models.causes.addedjoint import AddedJoint, naming
from models.causes.joints import JOINT_CAUSES
from models.jointed import ROTATION, AnyRig, JointedRig

NEARLY = 0.99
"""Share of what exceeds noise that a force at a place must explain."""


@dataclass(frozen=True)
class UnnamedPlace:
    """A degree of freedom that the rig file does not name, where a free force explains what none explains that it does.

    Attributes
    ----------
    at : str
    left : float
        Noise variances that it leaves.
    named, left_there : str and float
        The best place of the rig file, and what a force there leaves.
    probed : JointedRig
        The rig with a sensor there that no record has: joints are looked for at what a rig names.
    """

    at: str
    left: float
    named: str
    left_there: float
    probed: JointedRig

    def __str__(self) -> str:
        """In a sentence."""
        return (
            f"Whatever its law, a force at {self.at}, which the rig file does not name, leaves {self.left:.3g} noise "
            f"variances; at {self.named}, the best place that it names, {self.left_there:.3g}."
        )

    def joints(self, causes: Sequence[object] | None) -> list[AddedJoint]:
        """Joints that may be missing there, to the ground and to what the rig file names: of all laws, or of some."""
        kinds = [kind for kind in JOINT_CAUSES if causes is None or kind in causes or kind.name in causes]
        offered = [c for kind in kinds for c in kind.candidates(self.probed)]
        return [c for c in offered if self.at in (c.at.removeprefix("-1*"), c.to)]


def unnamed_place(rig: AnyRig, spectra: MeasuredSpectra) -> UnnamedPlace | None:
    """Where a force is missing that the rig file does not name; None where records do not tell it from what it names.

    Of structures given by their matrices without lumped masses, under a sine, and of forces from the ground.
    """
    if not isinstance(rig, JointedRig) or not isinstance(rig.body, MatrixBody):
        return None
    body = rig.body
    if body.reduction != "modes" or rig.masses or spectra.H > MANY:
        return None
    fixed = set(body.fixed)
    names = [name for name in body.dofs if name not in fixed and not ROTATION.search(name)]
    seen = readings(rig, spectra)
    before, left, points = _left(rig, body, seen, names)
    known = [i for i, name in enumerate(names) if name in rig.places]
    if not known or points - _unknowns(seen) <= LEFT_OVER * points:
        return None
    best, named = int(np.argmin(left)), min(known, key=lambda i: float(left[i]))
    share = 1.0 - (left[best] - 1.0) / max(before - 1.0, 1e-300)
    if share < NEARLY or ALIKE * left[best] >= left[named]:
        return None
    at = names[best]
    return UnnamedPlace(at, float(left[best]), names[named], float(left[named]), naming(rig, [at]))


def _unknowns(seen: Readings) -> int:
    """Real amplitudes of a free force."""
    return 2 * int((seen.weight > 0.0).any(axis=2).sum())


def _left(rig: JointedRig, body: MatrixBody, seen: Readings, names: list[str]) -> tuple[float, Array, int]:
    """Noise variances left with free forces at the joints, and with one more at each place; coefficients beyond those.

    The rig as it is in each record; forces as they were measured.
    """
    to = [i for i, c in enumerate(rig.response_channels) if c.name in seen.channels]
    sensors = [rig.response_channels[i] for i in to]
    rows, flexibility = body.everywhere(names, [c.at for c in sensors])
    chi2, gain, points = 0.0, np.zeros(len(names)), 0
    for i, k in np.argwhere((seen.weight > 0.0).any(axis=2)):
        s, rate = rig.at_record(int(seen.spectra.records[i])).structure, seen.i_omega[i, k]
        through = np.linalg.inv(np.diag(s.omega_n**2 + rate**2) + rate * s.damping)
        weight = seen.weight[i, k] * np.array([factor(c, rate) for c in sensors])
        by = s.channels[to] @ through
        missed = seen.weight[i, k] * seen.measured[i, k]
        missed = missed - weight * (by @ s.excitation + s.channels_by_force[to]) * _force(rig, seen, i, k)
        Q = np.linalg.qr(weight[:, None] * (by @ s.joints.T + s.channels_by_joints[to]))[0]
        of_places = weight[:, None] * (by @ rows.T + flexibility.T)
        missed, of_places = (part - Q @ (Q.conj().T @ part) for part in (missed, of_places))
        size = np.sum(np.abs(of_places) ** 2, axis=0)
        chi2 += float(np.vdot(missed, missed).real)
        gain += np.abs(of_places.conj().T @ missed) ** 2 / np.where(size > 0.0, size, np.inf)
        points += 2 * max(int(np.sum(weight != 0.0)) - Q.shape[1], 0)
    own = max(points - _unknowns(seen), 1)
    return chi2 / max(points, 1), (chi2 - gain) / own, points


def _force(rig: JointedRig, seen: Readings, i: int, k: int) -> complex:
    """Amplitude of the force of a record [N]; without a force channel the level stands for it."""
    level = float(seen.spectra.level[i])
    measured = complex(seen.force[i, k]) if seen.force[i].any() else level * float(k == 1)
    return measured * rig.excitation.gain(level)
