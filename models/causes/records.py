"""Causes in what differs from record to record."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from models.causes.cause import EITHER, Cause, Unknown
from models.causes.parameter import FREQUENCIES, STIFFNESSES
from models.friction import parameters
from models.jointed import AnyRig, JointedRig
from models.parts import Drift
from models.rig import Rig

STIFFNESS, ALPHA, LOAD, LAW = (
    "beam.youngs_modulus",
    "damping.mass_proportional",
    "contact.normal_load",
    "contact.friction.",
)
RATIOS = "damping.modal_ratios"
MOST_RATE, RATES = 1.0, (1e-3, 1e-2)
MOST_DECAY = 100.0


@dataclass(frozen=True)
class ForceDistortion(Cause):
    """A force that is no pure cosine; its harmonics are those that were measured."""

    name: ClassVar[str] = "force-distortion"
    meaning: ClassVar[str] = "the force has harmonics the simulation leaves out"
    looks_like: ClassVar[str] = "harmonics that follow those of the measured force, even ones among them"
    confused_with: ClassVar[str] = "variable-normal-load where the force's harmonics were not measured"
    check: ClassVar[str] = (
        "read the harmonics of the measured force in every record: those of the response must follow them"
    )
    rigs: ClassVar[tuple[type, ...]] = EITHER

    @classmethod
    def candidates(cls, rig: AnyRig) -> Iterator["ForceDistortion"]:
        """Where the force is measured."""
        if any(c.quantity == "force" for c in rig.channels) and not rig.excitation.measured_harmonics:
            yield cls()

    def unknowns(self, rig: AnyRig) -> tuple[Unknown, ...]:
        """None."""
        return ()

    def extend(self, rig: AnyRig, values: Mapping[str, float]) -> AnyRig:
        """Have the measured harmonics applied."""
        return replace(rig, excitation=replace(rig.excitation, measured_harmonics=True))


@dataclass(frozen=True)
class NotSteady(Cause):
    """Transients in the records, of any size and phase in each: only how they decay is a number of the rig.

    With damping proportional to the mass every mode decays at half that coefficient, but for what friction takes. A rig
    with joints decays as its modes are damped, which calibration moves in any case.
    """

    name: ClassVar[str] = "not-steady"
    meaning: ClassVar[str] = "records were taken before the transient died out"
    looks_like: ClassVar[str] = "most near resonances and at low levels, of another size and phase in each record"
    confused_with: ClassVar[str] = "damping.mass_proportional, friction"
    check: ClassVar[str] = (
        "repeat one of the records missed most and hold its frequency five decay times longer before recording: it "
        "must come out otherwise"
    )
    abrupt: ClassVar[bool] = True
    free: ClassVar[bool] = True
    rigs: ClassVar[tuple[type, ...]] = EITHER

    @classmethod
    def candidates(cls, rig: AnyRig) -> Iterator["NotSteady"]:
        """Where transients are none yet; with a clamp that slips or a tip that lifts off they are not known."""
        known = isinstance(rig, JointedRig) or (rig.attachments.clamp_limit is None and not rig.contact.lift_off)
        if rig.excitation.settled and known:
            yield cls()

    def unknowns(self, rig: AnyRig) -> tuple[Unknown, ...]:
        """The rate of decay, where it is not that of damping ratios."""
        if isinstance(rig, JointedRig) or rig.damping.modal_ratios is not None:
            return ()
        now = rig.damping.mass_proportional / 2.0
        return (Unknown("decay_rate", "1/s", ALPHA, 0.0, MOST_DECAY, now, (now,), times=2.0, known=True),)

    def extend(self, rig: AnyRig, values: Mapping[str, float]) -> AnyRig:
        """Let the records have transients that decay so."""
        rig = replace(rig, excitation=replace(rig.excitation, settled=False))
        return rig.with_number(ALPHA, 2.0 * values["decay_rate"]) if values else rig


@dataclass(frozen=True)
class ParameterDrift(Cause):
    """A property that changes in the order of the records, evenly.

    Attributes
    ----------
    parameter : str
        Dotted key of the rig file.
    """

    name: ClassVar[str] = "drift"
    meaning: ClassVar[str] = "a property changes from record to record"
    looks_like: ClassVar[str] = "a misfit ordered by the number of the record, not by level or frequency"
    confused_with: ClassVar[str] = "the same value wrong from the start, where levels were measured one after the other"
    check: ClassVar[str] = "repeat the first record at the end: the two must differ as the drift predicts"

    rigs: ClassVar[tuple[type, ...]] = EITHER

    parameter: str

    @classmethod
    def candidates(cls, rig: AnyRig) -> Iterator["ParameterDrift"]:
        """Offer stiffness, damping, load and friction, where they are positive and do not drift yet."""
        drifting = {drift.parameter for drift in rig.drift}
        keys = _of_joints(rig) if isinstance(rig, JointedRig) else _of_contact(rig)
        yield from (cls(key) for key in keys if key not in drifting)

    @property
    def label(self) -> str:
        """Name and key."""
        return f"{self.name} {self.parameter}"

    def unknowns(self, rig: AnyRig) -> tuple[Unknown, ...]:
        """The rate."""
        key = f"drift[{len(rig.drift)}].rate"
        return (Unknown("rate", "1", key, -MOST_RATE, MOST_RATE, 0.0, (0.0, *RATES, *(-r for r in RATES))),)

    def extend(self, rig: AnyRig, values: Mapping[str, float]) -> AnyRig:
        """Let it drift."""
        return replace(rig, drift=(*rig.drift, Drift(self.parameter, values["rate"])))


def _of_contact(rig: Rig) -> list[str]:
    """Positive numbers of a rig with one contact that may drift."""
    keys = [*([STIFFNESS] if rig.beam is not None else []), *([] if rig.damping.modal_ratios else [ALPHA])]
    keys += [LOAD, *(LAW + name for name in parameters(rig.contact.law))]
    return [key for key in keys if rig.number(key) > 0.0]


def _of_joints(rig: JointedRig) -> list[str]:
    """Positive numbers of a rig with joints that may drift, of its modes all frequencies, or ratios, as one."""
    known = rig.numbers
    positive = [key for key, (value, _) in known.items() if value > 0.0]
    lists = [key for key in (FREQUENCIES, RATIOS) if any(name.startswith(f"{key}[") for name in positive)]
    single = (*STIFFNESSES, ALPHA)
    return [*lists, *(key for key in positive if key in single or key.startswith("joints."))]
