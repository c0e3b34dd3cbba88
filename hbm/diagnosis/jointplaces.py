"""Where a rig with joints may lack a force: between its places, and between each of them and the ground."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hbm.balance.solution import PeriodicSolution
from hbm.diagnosis.places import Complex, Kind
from hbm.sensitivity.jointforces import Ends, motion_between
from models.causes.addedjoint import ends_of
from models.jointed import JointedRig


@dataclass(frozen=True, eq=False)
class JointPlace:
    """A pair of places, or a place and the ground, as :class:`hbm.diagnosis.places.Place`."""

    rig: JointedRig
    ends: Ends
    kind: Kind = "force"
    unit: str = "N"
    against: str = "m"

    @property
    def name(self) -> str:
        """In words."""
        at, to = self.ends
        return f"{at} to {to}" if to else at

    def seen(self, solution: PeriodicSolution) -> Complex:
        """Amplitudes (H+1,) of the motion there."""
        return np.asarray(solution.basis.complex(motion_between(self.rig, solution, [self.ends])[0]))


def joint_places_of(rig: JointedRig) -> Sequence[JointPlace]:
    """Where a rig may lack a force."""
    return [JointPlace(rig, ends) for ends in ends_of(rig)]
