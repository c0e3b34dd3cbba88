"""Causes in the friction of a contact or of a joint, and in the load on it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import nan
from typing import Any, ClassVar, Self

from models.causes.cause import EITHER, Cause, Unknown
from models.causes.rubbing import Rubbing, Sizes, rubbing, rubbing_at, sizes_at, with_friction
from models.friction import Dahl, FrictionLaw, Frictionless, Jenkins, Viscous, chosen, parameters
from models.friction.extended import (
    ASYMMETRIC,
    BESIDE_DASHPOT,
    DampedDahl,
    DistributedJenkins,
    WeakeningJenkins,
    asymmetric,
    beside_dashpot,
)
from models.jointed import AnyRig
from models.rig import Rig

HARDLY = 1e-5
"""Relative size of a start that changes hardly anything, where at nothing at all other parameters would have no say."""


@dataclass(frozen=True)
class OtherFriction(Cause):
    """Base of causes that put another friction law in the place of the one that is there.

    Attributes
    ----------
    joint : str
        Name of the joint that rubs so; empty for the contact of a rig that has one.
    """

    rigs: ClassVar[tuple[type, ...]] = EITHER

    joint: str = field(default="", kw_only=True)

    @classmethod
    def candidates(cls, rig: AnyRig) -> Iterator[Self]:
        """Offer it wherever the rig has a law that it extends."""
        yield from (cls(joint=r.joint) for r in rubbing(rig) if cls.extends(r.law))

    @classmethod
    def extends(cls, law: FrictionLaw) -> bool:
        """Whether it is known for a law."""
        raise NotImplementedError

    @property
    def label(self) -> str:
        """Name, and the joint."""
        return f"{self.name} {self.joint}".rstrip()

    def unknowns(self, rig: AnyRig) -> tuple[Unknown, ...]:
        """Numbers of the law in its place."""
        return self.asked(rubbing_at(rig, self.joint), sizes_at(rig, self.joint))

    def extend(self, rig: AnyRig, values: Mapping[str, float]) -> AnyRig:
        """Put the law in its place."""
        return with_friction(rig, self.joint, self.law(rubbing_at(rig, self.joint), values))

    def asked(self, there: Rubbing, sizes: Sizes) -> tuple[Unknown, ...]:
        """Parameters, for the friction that is there, of these sizes."""
        raise NotImplementedError

    def law(self, there: Rubbing, values: Mapping[str, float]) -> FrictionLaw:
        """The law in the place of the one that is there."""
        raise NotImplementedError


@dataclass(frozen=True)
class StribeckWeakening(OtherFriction):
    """Friction that falls with the sliding speed; the stiffness of the contact stays.

    Attributes
    ----------
    exponent : float
        Exponent of the fall; 1 is the decay law.
    """

    name: ClassVar[str] = "stribeck-weakening"
    meaning: ClassVar[str] = "friction falls with the sliding speed"
    looks_like: ClassVar[str] = "odd harmonics, the 7th as strong as the 1st; less loss the faster it slides"
    confused_with: ClassVar[str] = "asymmetric-friction with one sensor and one level"
    check: ClassVar[str] = (
        "measure at the lowest and at the highest level at which the tip slides, harmonics 1 to 9: the loss per cycle "
        "must grow less than in proportion to the slip"
    )

    exponent: float = 2.0

    @classmethod
    def extends(cls, law: FrictionLaw) -> bool:
        """A Jenkins element."""
        return type(law) is Jenkins

    def asked(self, there: Rubbing, sizes: Sizes) -> tuple[Unknown, ...]:
        """Friction at rest and at high speed, both the nominal one at first, and the speed between."""
        mu = _jenkins(there).mu
        low, high, v = 1e-3 * mu, 1e2 * mu, sizes.speed
        return (
            Unknown("mu_static", "1", there.key + "mu_static", low, high, mu, (mu,), least="mu"),
            Unknown("mu", "1", there.key + "mu", low, high, mu, ((1 - HARDLY) * mu, 0.9 * mu, 0.6 * mu)),
            Unknown(
                "stribeck_velocity", "m/s", there.key + "stribeck_velocity", 1e-3 * v, 1e3 * v, nan, (v, v / 10, 10 * v)
            ),
        )

    def law(self, there: Rubbing, values: Mapping[str, float]) -> FrictionLaw:
        """The law with the stiffness of the Jenkins element."""
        nominal = _jenkins(there)
        stiffness = nominal.mu * there.load / nominal.critical_slip
        return WeakeningJenkins(stiffness=stiffness, exponent=self.exponent, **values)


@dataclass(frozen=True)
class DistributedMicroslip(OtherFriction):
    """Many Jenkins elements of different limits instead of one.

    Attributes
    ----------
    elements : int
        How many.
    """

    name: ClassVar[str] = "distributed-microslip"
    meaning: ClassVar[str] = "parts of the contact slip before the whole does"
    looks_like: ClassVar[str] = "odd harmonics, largest at low level; loss grows with amplitude to the power 2 to 3"
    confused_with: ClassVar[str] = "parameter:contact.friction.critical_slip, bristle-memory"
    check: ClassVar[str] = (
        "add three levels below the onset of full slip: the contact must lose energy there too, with the slip to the "
        "power 2 to 3"
    )

    elements: int = 10

    @classmethod
    def extends(cls, law: FrictionLaw) -> bool:
        """A Jenkins element."""
        return type(law) is Jenkins

    def asked(self, there: Rubbing, sizes: Sizes) -> tuple[Unknown, ...]:
        """Half width of the limits' distribution.

        Its effect grows with its square: at none there is no derivative, and the first start is one at which the
        samples of a period see the elements slip one after the other.
        """
        return (Unknown("spread", "1", there.key + "spread", 0.0, 1.0, 0.0, (0.05, 0.3, 0.8)),)

    def law(self, there: Rubbing, values: Mapping[str, float]) -> FrictionLaw:
        """The elements in the place of the one."""
        return DistributedJenkins(**parameters(_jenkins(there)), elements=self.elements, **values)


@dataclass(frozen=True)
class ViscousContact(OtherFriction):
    """A dashpot beside the friction."""

    name: ClassVar[str] = "viscous-contact"
    meaning: ClassVar[str] = "the contact damps in proportion to its velocity, beside its friction"
    looks_like: ClassVar[str] = "1st harmonic, in phase with the slip velocity; needs gross slip"
    confused_with: ClassVar[str] = "parameter:damping.mass_proportional, stiffness-damping"
    check: ClassVar[str] = (
        "lift the tip off its support and let the beam ring down: damping that is still there is not in the contact"
    )

    @classmethod
    def extends(cls, law: FrictionLaw) -> bool:
        """Laws that take a dashpot beside them, and none at all."""
        return (isinstance(law, BESIDE_DASHPOT) and not hasattr(law, "coefficient")) or type(law) is Frictionless

    def asked(self, there: Rubbing, sizes: Sizes) -> tuple[Unknown, ...]:
        """Coefficient of the dashpot."""
        c = sizes.damper
        return (
            Unknown("coefficient", "N s/m", there.key + "coefficient", 0.0, 1e5 * c, 0.0, (0.0, c / 10, c, 10 * c)),
        )

    def law(self, there: Rubbing, values: Mapping[str, float]) -> FrictionLaw:
        """The law beside the dashpot."""
        return Viscous(**values) if type(there.law) is Frictionless else _remade(beside_dashpot, there.law, values)


@dataclass(frozen=True)
class AsymmetricFriction(OtherFriction):
    """Friction coefficients that differ with the direction, at the same mean."""

    name: ClassVar[str] = "asymmetric-friction"
    meaning: ClassVar[str] = "friction depends on the direction"
    looks_like: ClassVar[str] = "odd and even harmonics, the slip is off centre; alike at all levels"
    confused_with: ClassVar[str] = "variable-normal-load, second harmonic of the force"
    check: ClassVar[str] = (
        "turn the half cylinder round and repeat the records missed most: the even harmonics must change their sign"
    )

    @classmethod
    def extends(cls, law: FrictionLaw) -> bool:
        """Laws with a limit."""
        return isinstance(law, ASYMMETRIC) and law.ratio == 1.0 and "ratio" not in parameters(law)

    def asked(self, there: Rubbing, sizes: Sizes) -> tuple[Unknown, ...]:
        """Forward over backward."""
        return (Unknown("ratio", "1", there.key + "ratio", 0.01, 100.0, 1.0, (1.0, 1.2, 0.8, 2.0, 0.5)),)

    def law(self, there: Rubbing, values: Mapping[str, float]) -> FrictionLaw:
        """The law, asymmetric."""
        return _remade(asymmetric, there.law, values)


@dataclass(frozen=True)
class BristleMemory(OtherFriction):
    """Damping of the bristles of Dahl's law, as in LuGre."""

    name: ClassVar[str] = "bristle-memory"
    meaning: ClassVar[str] = "sticking friction depends on the rate"
    looks_like: ClassVar[str] = "odd harmonics, in phase with the velocity, growing with frequency; alike at all levels"
    confused_with: ClassVar[str] = "stiffness-damping"
    check: ClassVar[str] = (
        "reach the same slip at a low and at a high frequency: the loss per cycle must grow with the frequency"
    )

    @classmethod
    def extends(cls, law: FrictionLaw) -> bool:
        """Dahl's."""
        return type(law) is Dahl

    def asked(self, there: Rubbing, sizes: Sizes) -> tuple[Unknown, ...]:
        """Damping of the bristles."""
        c, key = sizes.damper, there.key + "bristle_damping"
        return (Unknown("sigma1", "N s/m", key, 0.0, 1e5 * c, 0.0, (0.0, c / 10, 3 * c, 100 * c)),)

    def law(self, there: Rubbing, values: Mapping[str, float]) -> FrictionLaw:
        """The law with damped bristles."""
        return DampedDahl(**parameters(there.law), bristle_damping=values["sigma1"])


@dataclass(frozen=True)
class VariableNormalLoad(Cause):
    """A reaction that varies where the model holds it constant, or more or less than the model says."""

    name: ClassVar[str] = "variable-normal-load"
    meaning: ClassVar[str] = "the normal force on the friction varies more or less than in the model"
    looks_like: ClassVar[str] = "even and odd harmonics, growing with level"
    confused_with: ClassVar[str] = "parameter:contact.normal_load, asymmetric-friction, second harmonic of the force"
    check: ClassVar[str] = "put a load cell under the support: it shows by how much the reaction varies"

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["VariableNormalLoad"]:
        """Offer it for a beam on dry friction."""
        if rig.beam is not None and not isinstance(rig.contact.law, Frictionless | Viscous):
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Scale on what varies."""
        now = rig.contact.load_variation
        starts = (now, 1.0 if now < 0.5 else 0.5)
        return (Unknown("scale", "1", "contact.load_variation", 0.0, 10.0, now, starts),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Scale the variation."""
        return rig.with_number("contact.load_variation", values["scale"])


def _jenkins(there: Rubbing) -> Jenkins:
    assert isinstance(there.law, Jenkins)
    return there.law


def _remade(maker: Any, law: FrictionLaw, values: Mapping[str, float]) -> FrictionLaw:
    """The law as one of another class, with one more parameter."""
    made: FrictionLaw = maker(type(law))(**parameters(law), **chosen(law), **values)
    return made
