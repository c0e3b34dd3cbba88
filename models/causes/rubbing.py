"""Where a rig rubs: the friction law of its contact or of each joint that rubs, and another law in its place."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from models.causes.addedjoint import reach
from models.friction.law import FrictionLaw, Value
from models.jointed import AnyRig, JointedRig
from models.joints import Friction

SLOW = 1e-3
"""Sliding speed of a tip that moves by micrometres some fifty times a second, with room [m/s]."""

DAMPER = 100.0
"""Dashpot beside such a contact that is seen [N s/m]."""

SHARE = 0.1
"""Of the largest speed without friction: that at which a joint slides."""


class Sizes(NamedTuple):
    """Sizes of a sliding speed [m/s] and of a dashpot that is seen beside the friction [N s/m]."""

    speed: float
    damper: float


class Rubbing(NamedTuple):
    """Friction of a rig.

    Attributes
    ----------
    joint : str
        Name of the joint; empty for that of a contact.
    law : FrictionLaw
    load : Value
        Normal load that stiffnesses of the law refer to [N].
    key : str
        Beginning of the keys of its numbers.
    """

    joint: str
    law: FrictionLaw
    load: Value
    key: str


def rubbing(rig: AnyRig) -> Iterator[Rubbing]:
    """Every friction of a rig."""
    if not isinstance(rig, JointedRig):
        yield Rubbing("", rig.contact.law, rig.contact.normal_load, "contact.friction.")
        return
    for j in rig.joints:
        if isinstance(j.law, Friction):
            load = j.law.normal_load if j.law.reference_load is None else j.law.reference_load
            yield Rubbing(j.name, j.law.law, load, f"joints.{j.name}.")


def sizes_at(rig: AnyRig, joint: str) -> Sizes:
    """Sizes at one joint, of the motion that the excitation makes there, or at the contact where that has no name."""
    if not isinstance(rig, JointedRig):
        return Sizes(SLOW, DAMPER)
    motion, omega = reach(rig, *next(j.ends[0] for j in rig.joints if j.name == joint))
    return Sizes(SHARE * motion * omega, rig.excitation.amplitude / (motion * omega))


def rubbing_at(rig: AnyRig, joint: str) -> Rubbing:
    """The friction of one joint, or of the contact where that has no name."""
    return next(r for r in rubbing(rig) if r.joint == joint)


def with_friction(rig: AnyRig, joint: str, law: FrictionLaw) -> AnyRig:
    """The rig with another friction law there."""
    if not isinstance(rig, JointedRig):
        return replace(rig, contact=replace(rig.contact, law=law))
    old: Any = next(j.law for j in rig.joints if j.name == joint)
    return rig.with_joint(joint, replace(old, law=law))
