"""Causes in the friction and the load on it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import nan
from typing import Any, ClassVar

from models.causes.cause import Cause, Unknown
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
from models.rig import Rig

LAW = "contact.friction."
HARDLY = 1e-5
"""Relative size of a start that changes hardly anything, where at nothing at all other parameters would have no say."""


@dataclass(frozen=True)
class StribeckWeakening(Cause):
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
    def candidates(cls, rig: Rig) -> Iterator["StribeckWeakening"]:
        """Where a Jenkins element rubs."""
        if type(rig.contact.law) is Jenkins:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Friction at rest and at high speed, both the nominal one at first, and the speed between."""
        mu = _jenkins(rig).mu
        low, high = 1e-3 * mu, 1e2 * mu
        return (
            Unknown("mu_static", "1", LAW + "mu_static", low, high, mu, (mu,), least="mu"),
            Unknown("mu", "1", LAW + "mu", low, high, mu, ((1 - HARDLY) * mu, 0.9 * mu, 0.6 * mu)),
            Unknown("stribeck_velocity", "m/s", LAW + "stribeck_velocity", 1e-6, 1.0, nan, (1e-3, 1e-4, 1e-2)),
        )

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Put the law in the place of the Jenkins element."""
        nominal = _jenkins(rig)
        stiffness = nominal.mu * rig.contact.normal_load / nominal.critical_slip
        return _with_law(rig, WeakeningJenkins(stiffness=stiffness, exponent=self.exponent, **values))


@dataclass(frozen=True)
class DistributedMicroslip(Cause):
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
    def candidates(cls, rig: Rig) -> Iterator["DistributedMicroslip"]:
        """Where a Jenkins element rubs."""
        if type(rig.contact.law) is Jenkins:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Half width of the limits' distribution.

        Its effect grows with its square: at none there is no derivative, and the first start is one at which the
        samples of a period see the elements slip one after the other.
        """
        return (Unknown("spread", "1", LAW + "spread", 0.0, 1.0, 0.0, (0.05, 0.3, 0.8)),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Put the elements in the place of the one."""
        return _with_law(rig, DistributedJenkins(**parameters(_jenkins(rig)), elements=self.elements, **values))


@dataclass(frozen=True)
class ViscousContact(Cause):
    """A dashpot beside the friction."""

    name: ClassVar[str] = "viscous-contact"
    meaning: ClassVar[str] = "the contact damps in proportion to its velocity, beside its friction"
    looks_like: ClassVar[str] = "1st harmonic, in phase with the slip velocity; needs gross slip"
    confused_with: ClassVar[str] = "parameter:damping.mass_proportional, stiffness-damping"
    check: ClassVar[str] = (
        "lift the tip off its support and let the beam ring down: damping that is still there is not in the contact"
    )

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["ViscousContact"]:
        """Beside laws that take a dashpot, and where there is none."""
        law = rig.contact.law
        if (isinstance(law, BESIDE_DASHPOT) and not hasattr(law, "coefficient")) or type(law) is Frictionless:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Coefficient of the dashpot."""
        return (Unknown("coefficient", "N s/m", LAW + "coefficient", 0.0, 1e7, 0.0, (0.0, 10.0, 100.0, 1e3)),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Put the dashpot beside the law."""
        if type(rig.contact.law) is Frictionless:
            return _with_law(rig, Viscous(**values))
        return _with_law(rig, _remade(beside_dashpot, rig.contact.law, values))


@dataclass(frozen=True)
class AsymmetricFriction(Cause):
    """Friction coefficients that differ with the direction, at the same mean."""

    name: ClassVar[str] = "asymmetric-friction"
    meaning: ClassVar[str] = "friction depends on the direction"
    looks_like: ClassVar[str] = "odd and even harmonics, the slip is off centre; alike at all levels"
    confused_with: ClassVar[str] = "variable-normal-load, second harmonic of the force"
    check: ClassVar[str] = (
        "turn the half cylinder round and repeat the records missed most: the even harmonics must change their sign"
    )

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["AsymmetricFriction"]:
        """Offer it for laws with a limit."""
        law = rig.contact.law
        if isinstance(law, ASYMMETRIC) and law.ratio == 1.0 and "ratio" not in parameters(law):
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Forward over backward."""
        return (Unknown("ratio", "1", LAW + "ratio", 0.01, 100.0, 1.0, (1.0, 1.2, 0.8, 2.0, 0.5)),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Make the law asymmetric."""
        return _with_law(rig, _remade(asymmetric, rig.contact.law, values))


@dataclass(frozen=True)
class BristleMemory(Cause):
    """Damping of the bristles of Dahl's law, as in LuGre."""

    name: ClassVar[str] = "bristle-memory"
    meaning: ClassVar[str] = "sticking friction depends on the rate"
    looks_like: ClassVar[str] = "odd harmonics, in phase with the velocity, growing with frequency; alike at all levels"
    confused_with: ClassVar[str] = "stiffness-damping"
    check: ClassVar[str] = (
        "reach the same slip at a low and at a high frequency: the loss per cycle must grow with the frequency"
    )

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["BristleMemory"]:
        """Offer it for Dahl's law."""
        if type(rig.contact.law) is Dahl:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Damping of the bristles."""
        return (Unknown("sigma1", "N s/m", LAW + "bristle_damping", 0.0, 1e7, 0.0, (0.0, 10.0, 300.0, 1e4)),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Damp the bristles."""
        return _with_law(rig, DampedDahl(**parameters(rig.contact.law), bristle_damping=values["sigma1"]))


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


def _jenkins(rig: Rig) -> Jenkins:
    law = rig.contact.law
    assert isinstance(law, Jenkins)
    return law


def _with_law(rig: Rig, law: FrictionLaw) -> Rig:
    return replace(rig, contact=replace(rig.contact, law=law))


def _remade(maker: Any, law: FrictionLaw, values: Mapping[str, float]) -> FrictionLaw:
    """The law as one of another class, with one more parameter."""
    made: FrictionLaw = maker(type(law))(**parameters(law), **chosen(law), **values)
    return made
