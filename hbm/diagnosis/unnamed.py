"""Where a structure lacks a joint: at any place of it, whether or not the rig file names that."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import minimize_scalar

from hbm.diagnosis.discrepancy import ALIKE
from hbm.diagnosis.freeforces import NEARLY, FreeForces, free_forces, sensors_of
from hbm.fourier import MANY
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.measured import measured
from hbm.outputerror.records import Measurement
from models.bodies import Everywhere
from models.causes.addedjoint import AddedJoint, naming
from models.causes.joints import JOINT_CAUSES
from models.jointed import ROTATION, AnyRig, JointedRig

CLOSELY, ASIDE = 1e-4, 0.05
"""To what share of the way between two places one between them is found, and how far from there what a free force
leaves tells how well."""

AtEach = Callable[[Sequence[str]], FreeForces | None]


@dataclass(frozen=True)
class UnnamedPlace:
    """A place that the rig file does not name, where a free force explains what none explains that it does.

    Attributes
    ----------
    at : str
    std : float
        Its standard deviation along a continuum [m]; 0 where places are points.
    left : float
        Noise variances that it leaves.
    named, left_there : str and float
        The best place of the rig file, and what a force there leaves.
    probed : JointedRig
        The rig with a sensor there that no record has: joints are looked for at what a rig names.
    """

    at: str
    std: float
    left: float
    named: str
    left_there: float
    probed: JointedRig

    def __str__(self) -> str:
        """In a sentence."""
        within = (
            f" (known to {1e3 * self.std:.2g} mm, one standard deviation; numbers of a joint hold for exactly there)"
        )
        known = within if self.std else ""
        return (
            f"Whatever its law, a force at {self.at}, which the rig file does not name, leaves {self.left:.3g} noise "
            f"variances{known}; at {self.named}, the best place that it names, {self.left_there:.3g}."
        )

    def joints(self, causes: Sequence[object] | None) -> list[AddedJoint]:
        """Joints that may be missing there, to the ground and to what the rig file names: of all laws, or of some."""
        kinds = [kind for kind in JOINT_CAUSES if causes is None or kind in causes or kind.name in causes]
        offered = [c for kind in kinds for c in kind.candidates(self.probed)]
        return [c for c in offered if self.at in (c.at.removeprefix("-1*"), c.to)]


def unnamed_place(rig: AnyRig, spectra: MeasuredSpectra) -> UnnamedPlace | None:
    """Where a force is missing that the rig file does not name; None where records do not tell it from what it names.

    Of structures without lumped masses that have more places than are named, under a sine, and of forces from the
    ground.
    """
    if not isinstance(rig, JointedRig) or not isinstance(rig.body, Everywhere) or rig.masses or spectra.H > MANY:
        return None
    named, others = (
        [p for p in places if not ROTATION.search(p)] for places in (rig.places, rig.body.elsewhere(rig.places))
    )
    at_each = partial(_free_forces, rig, rig.body, measured(rig, spectra)[1])
    found = at_each([*named, *others]) if named and others else None
    if found is None:
        return None
    there, elsewhere = np.split(found.left, [len(named)])
    known, at = float(there.min()), others[int(np.argmin(elsewhere))]
    at, std = _closer(at_each, rig.body, at) if rig.body.spacing else (at, 0.0)
    finer = at_each([at])
    if finer is None or finer.shares[0] < NEARLY or ALIKE * finer.left[0] >= known:
        return None
    return UnnamedPlace(at, std, float(finer.left[0]), named[int(np.argmin(there))], known, naming(rig, [at]))


def _free_forces(rig: JointedRig, body: Everywhere, data: Measurement, names: Sequence[str]) -> FreeForces | None:
    """Free forces at places of a body."""
    rows, flexibility = body.everywhere(names, rig.places)
    to = [rig.places.index(place) for place in sensors_of(rig, data)]
    return free_forces(rig, data, rows, flexibility[:, to])


def _closer(at_each: AtEach, body: Everywhere, place: str) -> tuple[str, float]:
    """The place about one of a continuum where a free force leaves least, and its standard deviation [m]."""

    def chi2(aside: float) -> float:
        try:
            found = at_each([body.along(place, aside)])
        except ValueError:  # too near to a place that is known
            found = None
        return np.inf if found is None else float(found.left[0] * found.spare)

    within = (-body.spacing, body.spacing)
    least = minimize_scalar(chi2, bounds=within, method="bounded", options={"xatol": CLOSELY * body.spacing})
    step = ASIDE * body.spacing
    bend = chi2(least.x + step) + chi2(least.x - step) - 2.0 * least.fun
    if not 0.0 < bend < np.inf:
        return body.along(place, float(least.x)), 0.0
    std = float(step * np.sqrt(2.0 / bend))
    digits = 1 - int(np.floor(np.log10(std)))  # more say nothing
    return body.along(place, round(float(least.x), digits)), std
