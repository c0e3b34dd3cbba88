"""Where a structure given by its matrices lacks a joint, of all its degrees of freedom."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbm.diagnosis.discrepancy import ALIKE
from hbm.diagnosis.freeforces import NEARLY, free_forces, sensors_of
from hbm.fourier import MANY
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.measured import measured
from models.bodies import MatrixBody
from models.causes.addedjoint import AddedJoint, naming
from models.causes.joints import JOINT_CAUSES
from models.jointed import ROTATION, AnyRig, JointedRig


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
    data, fixed = measured(rig, spectra)[1], set(body.fixed)
    names = [name for name in body.dofs if name not in fixed and not ROTATION.search(name)]
    found = free_forces(rig, data, *body.everywhere(names, sensors_of(rig, data)))
    known = [i for i, name in enumerate(names) if name in rig.places]
    if found is None or not known:
        return None
    best, named = int(np.argmin(found.left)), min(known, key=lambda i: float(found.left[i]))
    if found.shares[best] < NEARLY or ALIKE * found.left[best] >= found.left[named]:
        return None
    at = names[best]
    return UnnamedPlace(at, float(found.left[best]), names[named], float(found.left[named]), naming(rig, [at]))
