"""The order in which candidates are tried: that of the score test, then what it cannot see, what takes long last."""

from collections.abc import Sequence

from hbm.diagnosis.otherstarts import is_joint, scanned
from hbm.diagnosis.screen import Screening, small
from hbm.diagnosis.signatures import Score
from hbm.outputerror.evaluation import Evaluation
from models.causes.addedjoint import AddedJoint
from models.causes.cause import Cause
from models.causes.parameter import FREQUENCIES, STIFFNESSES
from models.causes.sensors import OfChannel, SensorGain
from models.jointed import AnyRig

RUNNING, HOPELESS = 20, 0.15
"""So many candidates run first, at most, and none whose predicted fall of chi2 is less than this share of the best."""

NEARLY = 0.3
"""What is simpler runs first where it promises this share of the other's fall of chi2."""

JOINTS = "joints."
"""Beginning of the keys of numbers of joints."""

OF_JOINTS = f"parameter:{JOINTS}"
"""Beginning of the labels of numbers of the joints of a rig file."""

OF_BODIES = tuple(f"parameter:{key}" for key in STIFFNESSES)
"""Labels of the stiffness of a whole body."""

DRIFTS, SHOWN = tuple(f"drift {key}" for key in (*STIFFNESSES, FREQUENCIES)), 0.05
"""Labels of its drift, which runs before joints where it promises this share of what no joint promises most of."""


def in_order(screening: Screening, base: Evaluation) -> list[Score]:
    """Candidates in the order of the score test: what it favours first, what takes long last.

    A large misfit leaves that test no say over whether a force is missing: all of these run, but for a second cause,
    and for joints, which were scanned at the size that they have, and promise a share of what calibration leaves: they
    are compared with each other, after the stiffness of the whole body and its drift, which the smallest spring beside
    it, or a friction, stands in for, and every number of the joints of the rig file, which many other joints do. Nor
    does that test foresee what a sensor reads that sits far from its place: of a channel that it favours every number
    runs. A joint of one's own was not scanned, and runs too. What the force channel reads runs before all others, for a
    first small effect says nothing of a wrong polarity.
    """
    best: dict[bool, float] = {}
    for s in screening.scores:
        best[is_joint(s)] = max(best.get(is_joint(s), 0.0), s.drop)
    first = _simplest_first([s for s in screening.scores if s.drop > HOPELESS * best[is_joint(s)]])[:RUNNING]
    far = not (small(base) or base.model.causes)
    if far and scanned(base):
        shown = SHOWN * best.get(False, 0.0)
        drifts = [s for s in screening.scores if s.cause.label in DRIFTS and s.drop > shown]
        ahead = [*drifts, *(s for s in screening.scores if of_the_rig(s.cause))]
        first = [*ahead, *(s for s in first if s not in ahead)]
    if far:
        of_force = [s for s in screening.scores if _is_of_force(s.cause, base.model.nominal)]
        first = [*of_force, *(s for s in first if s not in of_force)]
    others = [s for s in screening.scores if s not in first]
    if not far:
        tried = []
    elif scanned(base):
        tried = _own_joints(others, base)
    else:
        forces = [s for s in others if not hasattr(s.cause, "channel") and s.cause.unknowns(base.model.nominal)]
        tried = [*_of_channels(first, others), *(s for s in forces if not unseen(s))]
    return [*first, *tried, *(s for s in others if unseen(s))]


def _is_of_force(cause: Cause, rig: AnyRig) -> bool:
    return isinstance(cause, SensorGain) and cause.of_force(rig)


def _own_joints(scores: Sequence[Score], base: Evaluation) -> list[Score]:
    """Joints that the rig file has not, and that were scored by their first small effect all the same."""
    nominal = base.model.nominal
    known = nominal.numbers
    keys = {s.cause.label: [u.key for u in s.cause.unknowns(nominal)] for s in scores if not is_joint(s)}
    new = {label for label, own in keys.items() if any(key.startswith(JOINTS) and key not in known for key in own)}
    return [s for s in scores if s.cause.label in new]


def of_the_rig(cause: Cause) -> bool:
    """Whether it is a number that many a joint stands in for: of a joint of the rig file, or of its whole body."""
    return cause.label in OF_BODIES or cause.label.startswith(OF_JOINTS)


def _simplest_first(scores: Sequence[Score]) -> list[Score]:
    """The same, each joint after those of fewer numbers at its place that promise nearly as much.

    Motion that is small there, beside what its error is, takes more from those that are in proportion to it.
    """
    ordered: list[Score] = []
    for s in scores:
        ordered += [
            o for o in scores if o not in ordered and o.drop >= NEARLY * s.drop and simpler_there(o.cause, s.cause)
        ]
        ordered += [s] if s not in ordered else []
    return ordered


def _of_channels(first: Sequence[Score], others: Sequence[Score]) -> list[Score]:
    """Those of the others that are numbers of the same channels as the first."""
    blamed = {s.cause.channel for s in first if isinstance(s.cause, OfChannel)}
    return [s for s in others if isinstance(s.cause, OfChannel) and s.cause.channel in blamed]


def simpler_joint(cause: Cause, other: Cause) -> bool:
    """Whether a joint has fewer numbers than another one."""
    return isinstance(cause, AddedJoint) and isinstance(other, AddedJoint) and len(cause.numbers) < len(other.numbers)


def simpler_there(cause: Cause, other: Cause) -> bool:
    """Whether it is at the same place too."""
    if not (isinstance(cause, AddedJoint) and isinstance(other, AddedJoint)):
        return False
    return simpler_joint(cause, other) and other.way((cause.at, cause.to)) != 0.0


def unseen(score: Score) -> bool:
    """Whether the first small effect of a cause says little: it sets in at a threshold, or is seen by its force.

    A joint was scored by that force, at the size that it has.
    """
    return not is_joint(score) and bool(getattr(score.cause, "abrupt", False) or score.starts)
