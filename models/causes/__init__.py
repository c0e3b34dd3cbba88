"""The catalogue of causes: what may be missing in a rig that does not agree with its measurements.

:class:`~models.causes.cause.Cause` says what a cause is; each is one small class that extends a rig, and its parameters
are numbers of the extended rig, so that simulation and exact derivatives need to know nothing of it. :data:`CAUSES` has
them by name, :func:`all_candidates` what may be wrong with one rig.

A cause's unknowns are those of a rig that it has not extended yet: ``cause.extend(rig, {u.name: u.starts[0] for u in
cause.unknowns(rig)})``.
"""

from collections.abc import Iterator

from models.causes.cause import Cause, Unknown, candidates_of
from models.causes.clamp import ClampFriction
from models.causes.elements import ImpactStopCause, MidplaneStretchingCause, QuadraticDragCause
from models.causes.friction import (
    AsymmetricFriction,
    BristleMemory,
    DistributedMicroslip,
    StribeckWeakening,
    VariableNormalLoad,
    ViscousContact,
)
from models.causes.joints import JOINT_CAUSES
from models.causes.parameter import WrongParameter
from models.causes.pressing import NormalContact
from models.causes.records import ForceDistortion, NotSteady, ParameterDrift
from models.causes.sensors import SensorDelay, SensorGain, SensorPosition, SwappedChannels
from models.causes.structure import (
    AddedMass,
    AddedSpring,
    AttachedResonator,
    ClampRotation,
    ContactLoss,
    StiffnessDamping,
    SupportFlexibility,
    SupportRotationSpring,
)
from models.jointed import AnyRig

EVERY: tuple[type[Cause], ...] = (
    StribeckWeakening,
    DistributedMicroslip,
    ViscousContact,
    AsymmetricFriction,
    BristleMemory,
    VariableNormalLoad,
    ClampRotation,
    ClampFriction,
    SupportRotationSpring,
    SupportFlexibility,
    ContactLoss,
    StiffnessDamping,
    AddedMass,
    AddedSpring,
    AttachedResonator,
    MidplaneStretchingCause,
    QuadraticDragCause,
    ImpactStopCause,
    SensorGain,
    SensorDelay,
    SensorPosition,
    SwappedChannels,
    ForceDistortion,
    NotSteady,
    ParameterDrift,
    WrongParameter,
    *JOINT_CAUSES,
    NormalContact,
)

CAUSES = {cause.name: cause for cause in EVERY}
"""Every cause by its name, docs/reference/causes.md; ``parameter`` stands for every ``parameter:<key>``."""


def all_candidates(rig: AnyRig) -> Iterator[Cause]:
    """Everything of the catalogue that may be wrong with a rig."""
    for cause in CAUSES.values():
        yield from candidates_of(cause, rig)


__all__ = ["CAUSES", "Cause", "Unknown", "all_candidates", "candidates_of"]
