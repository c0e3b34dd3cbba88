"""The catalogue of joints that may not have been modelled, each a law and its numbers."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import pi
from typing import Self

from models.bodies.laden import LumpedMass
from models.causes.addedjoint import AddedJoint, Number, moving_most, places_apart
from models.friction import Dahl, Iwan, Jenkins, LuGre
from models.jointed import ROTATION, JointedRig
from models.joints import (
    Backlash,
    Clearance,
    CubicSpring,
    Dashpot,
    Friction,
    HystereticDamping,
    JointLaw,
    PolynomialSpring,
    Separation,
    Stop,
)

ONSETS = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9)
"""Starts of displacements at which something sets in, in units of the largest motion there; and of the limits at which
springs slide, in units of their force at that."""

SLIPS = (0.002, 0.005, 0.01, *ONSETS)
"""The same of friction that sticks in no record near the resonance, and in some far from it."""


HARDLY = 1e-3
"""Of how far a point moves along the direction in which it moves most."""


class LocalSpring(AddedJoint):
    """A linear spring."""

    name = "local-spring"
    meaning = "a linear spring acts between two places, or a place and the ground"
    looks_like = "linear, in phase; shifts the frequencies of modes unequally, alike at all levels"
    confused_with = "parameter:modal.frequencies_hz[i]; where it is negative local-mass"
    check = "look for what touches the structure there, free it and repeat the records missed most"
    numbers = (Number("stiffness", "N/m", "linear", (1, -1, 0), signed=True),)
    made = PolynomialSpring


class LocalMass(AddedJoint):
    """A lumped mass on the body, rather than a law: its force is that of its inertia."""

    name = "local-mass"
    meaning = "a lumped mass sits on the structure"
    looks_like = "linear, in phase, growing with the square of the frequency; lowers the frequencies of modes unequally"
    confused_with = "a negative local-spring, parameter:modal.frequencies_hz[i]"
    check = "weigh what is mounted there, or add a known mass at that place and repeat the records missed most"
    numbers = (Number("mass", "kg", "mass", (1, -1, -2)),)

    @classmethod
    def candidates(cls, rig: JointedRig) -> Iterator[Self]:
        """Offer it at every point with no mass yet, by that of its translations which moves most."""
        there = {place for lump in rig.masses for place in rig.body.translations(lump.at)}
        points: dict[tuple[str, ...], str] = {}
        for place in moving_most(rig, places_apart(rig)):
            if not ROTATION.search(place) and place not in there:
                points.setdefault(rig.body.translations(place), place)
        yield from (cls(place) for place in points.values())

    @classmethod
    def law(cls, values: Mapping[str, float]) -> JointLaw:
        """No force but that of its inertia."""
        return PolynomialSpring()

    def beside(self, rig: JointedRig) -> tuple[str, ...]:
        """The other translations of its point, but those that hardly move."""
        size = moving_most(rig, rig.body.translations(self.at))
        return tuple(place for place, moved in size.items() if place != self.at and moved > HARDLY * max(size.values()))

    @staticmethod
    def inertia(values: Mapping[str, float]) -> float:
        """Its mass."""
        return values["mass"]

    def key(self, rig: JointedRig, number: Number) -> str:
        """Key of the next mass."""
        return f"masses[{len(rig.masses) + 1}].{number.key}"

    def extend(self, rig: JointedRig, values: Mapping[str, float]) -> JointedRig:
        """Put the mass there."""
        return replace(rig, masses=(*rig.masses, LumpedMass(self.at, values["mass"])))


class LocalDamper(AddedJoint):
    """A linear dashpot."""

    name = "local-damper"
    meaning = "a viscous damper acts between two places, or a place and the ground"
    looks_like = "linear, in quadrature; damps modes unequally, alike at all levels"
    confused_with = "parameter:damping.modal_ratios[i]"
    check = "look for what rubs or shears there, take it away and let the structure ring down"
    numbers = (Number("coefficient", "N s/m", "linear", (1, -1, -1)),)
    made = Dashpot


class LocalHysteresis(AddedJoint):
    """Damping by a loss factor."""

    name = "hysteretic-damping"
    meaning = "a material between two places loses a fixed share of its energy per cycle (loss factor)"
    looks_like = "linear, in quadrature; damps low modes more than a viscous damper that damps high ones as much"
    confused_with = "local-damper where one mode was measured, parameter:damping.modal_ratios[i]"
    check = "compare the damping of two modes far apart: the loss per cycle must not grow with the frequency"
    numbers = (
        Number("loss", "N/m", "loss", (1, -1, 0)),
        Number("frequency", "Hz", "frequency", (0, 0, 1), (0.5 / pi,)),
    )
    made = HystereticDamping


class QuadraticDamping(AddedJoint):
    """A dashpot whose force grows with the square of the velocity."""

    name = "quadratic-damping"
    meaning = "a force against the motion grows with the square of the velocity"
    looks_like = "in quadrature; loss with the cube of the amplitude, frequencies stay; odd harmonics"
    confused_with = "local-damper at one level, local-microslip"
    check = "let the structure ring down from a high level: the damping ratio must fall with the amplitude"
    numbers = (Number("coefficient", "N s2/m2", "quadratic", (1, -2, -2)),)
    made = Dashpot


class CubicStiffness(AddedJoint):
    """A cubic spring."""

    name = "cubic-stiffness"
    meaning = "a spring whose force grows with the cube of the displacement"
    looks_like = "in phase; frequencies rise (or fall) with the square of the amplitude; a third harmonic"
    confused_with = "two-sided-stop, quintic-stiffness"
    check = "measure the resonance at three levels: its frequency must move with the square of the amplitude"
    numbers = (Number("cubic", "N/m3", "cubic", (1, -3, 0), signed=True),)
    made = CubicSpring


class PolynomialStiffness(AddedJoint):
    """A quadratic and cubic spring."""

    name = "polynomial-stiffness"
    meaning = "a spring with a quadratic and a cubic term: it is stiffer one way than the other"
    looks_like = "in phase; even and odd harmonics, the second first; frequencies move with the amplitude squared"
    confused_with = "cubic-stiffness, one-sided-stop"
    check = "read the second harmonic: it must grow with the square of the amplitude"
    contains = ("cubic-stiffness",)
    numbers = (
        Number("quadratic", "N/m2", "quadratic", (1, -2, 0), signed=True),
        Number("cubic", "N/m3", "cubic", (1, -3, 0), signed=True),
    )
    made = PolynomialSpring


class QuinticStiffness(AddedJoint):
    """A cubic and quintic spring."""

    name = "quintic-stiffness"
    meaning = "a spring with a cubic and a quintic term"
    looks_like = "as cubic-stiffness at low level, stronger or weaker than that at high level; a fifth harmonic"
    confused_with = "cubic-stiffness, two-sided-stop"
    check = "measure the resonance at five levels: its shift over the amplitude squared must bend"
    contains = ("cubic-stiffness",)
    numbers = (
        Number("cubic", "N/m3", "cubic", (1, -3, 0), signed=True),
        Number("quintic", "N/m5", "quintic", (1, -5, 0), signed=True),
    )
    made = PolynomialSpring


class OneSidedStop(AddedJoint):
    """A stop on one side, behind a gap; pressed at rest where that is negative."""

    name = "one-sided-stop"
    meaning = "a place strikes a stop on one side"
    looks_like = "nothing below a threshold of the amplitude; then even and odd harmonics, frequencies rise"
    confused_with = (
        "two-sided-stop, polynomial-stiffness; pressed at rest and never open: local-spring, "
        "parameter:modal.frequencies_hz[i]"
    )
    check = "look for what can be struck there, move it away, or measure just below and above where it sets in"
    contains = ("local-spring",)
    numbers = (
        Number("stiffness", "N/m", "stiffness", (1, -1, 0)),
        Number("gap", "m", "gap", (0, 1, 0), (*ONSETS, *(-s for s in ONSETS), 0.0), signed=True),
    )
    made = Stop
    one_sided = True


class TwoSidedStop(AddedJoint):
    """Stops on both sides, behind equal gaps."""

    name = "two-sided-stop"
    meaning = "a place strikes stops on both sides, or a joint has play"
    looks_like = "nothing below a threshold of the amplitude; then odd harmonics, frequencies rise"
    confused_with = "cubic-stiffness, quintic-stiffness"
    check = "measure at five levels about where it sets in: below, nothing changes with the level"
    contains = ("local-spring",)
    numbers = (
        Number("stiffness", "N/m", "stiffness", (1, -1, 0)),
        Number("gap", "m", "gap", (0, 1, 0), ONSETS),
    )
    made = Clearance


class LocalFriction(AddedJoint):
    """A Jenkins element."""

    name = "local-friction"
    meaning = "one Jenkins element: a spring that slides once its force reaches a limit"
    looks_like = (
        "a spring up to a level, then a loss that grows with the amplitude and frequencies that fall; odd harmonics"
    )
    confused_with = "local-microslip, local-dahl"
    check = "measure three levels below its onset: there it must be a spring without a loss"
    numbers = (
        Number("limit", "N", "normal_load", (1, 0, 0)),
        Number("critical_slip", "m", "critical_slip", (0, 1, 0), SLIPS),
    )

    @classmethod
    def law(cls, values: Mapping[str, float]) -> JointLaw:
        """Friction whose limit is its load: the coefficient is one."""
        return Friction(Jenkins(1.0, values["critical_slip"]), values["normal_load"])


class LocalMicroslip(AddedJoint):
    """An Iwan element with limits from zero to twice their mean."""

    name = "local-microslip"
    meaning = "an Iwan element: a joint whose parts slip one after the other"
    looks_like = "loss with the cube of the amplitude from the lowest level on, frequencies fall with it; odd harmonics"
    confused_with = "local-friction, local-dahl, quadratic-damping"
    check = "let the structure ring down: damping ratio and frequency must change in proportion to the amplitude"
    numbers = (
        Number("stiffness", "N/m", "stiffness", (1, -1, 0)),
        Number("limit", "N", "normal_load", (1, 0, 0), SLIPS),
    )

    @classmethod
    def law(cls, values: Mapping[str, float]) -> JointLaw:
        """Friction whose limit is its load."""
        return Friction(Iwan(1.0, values["stiffness"]), values["normal_load"])


class LocalBacklash(AddedJoint):
    """A slider behind a play."""

    name = "backlash"
    meaning = "a joint has play before it rubs: a spring that slides at a limit, behind a lost motion"
    looks_like = (
        "nothing while the motion is within the play; then a loss, frequencies that rise and fall; odd harmonics"
    )
    confused_with = "local-friction, two-sided-stop"
    check = "move it slowly back and forth by hand: a part of the way must need no force"
    contains = ("local-friction",)
    numbers = (
        Number("stiffness", "N/m", "stiffness", (1, -1, 0)),
        Number("limit", "N", "limit", (1, 0, 0), ONSETS[::2]),
        Number("play", "m", "play", (0, 1, 0), (0.2, 0.5, 1.0, 1.5)),
    )
    made = Backlash

    def plainly(self, rig: JointedRig, values: Mapping[str, float]) -> dict[str, float]:
        """Numbers of the Jenkins element that it is without a play."""
        return {"critical_slip": values["limit"] / values["stiffness"]}


class JointSlip(LocalFriction):
    """A Jenkins element that the modes hold, and that slips."""

    name = "joint-slip"
    meaning = "a joint that holds in the modes as they were identified slips: one Jenkins element"
    looks_like = "frequencies fall with the level and the loss rises, from an onset on; odd harmonics"
    confused_with = "joint-microslip, local-friction"
    check = "measure three levels below its onset: there frequency and damping must not change with the level"

    @staticmethod
    def held(values: Mapping[str, float]) -> float:
        """Its stiffness while it sticks."""
        return values["normal_load"] / values["critical_slip"]


class JointMicroslip(LocalMicroslip):
    """An Iwan element that the modes hold, and whose parts slip one after the other."""

    name = "joint-microslip"
    meaning = "a joint that holds in the modes as they were identified slips in parts: an Iwan element"
    looks_like = "frequencies fall and damping ratios rise in proportion to the amplitude from the lowest level on"
    confused_with = "joint-slip, local-microslip"
    check = "let the structure ring down: frequency and damping ratio must change in proportion to the amplitude"

    @staticmethod
    def held(values: Mapping[str, float]) -> float:
        """Its stiffness while it sticks."""
        return values["stiffness"]


class JointOpening(AddedJoint):
    """A contact, pressed at rest, that the modes hold, and that opens."""

    name = "joint-opening"
    meaning = "a contact that is closed in the modes as they were identified opens, one way"
    looks_like = "nothing below a threshold of the amplitude; then even and odd harmonics, frequencies fall"
    confused_with = "polynomial-stiffness, one-sided-stop, joint-slip"
    check = "press it harder and repeat the records missed most, or measure just below and above where it sets in"
    numbers = TwoSidedStop.numbers
    made = Separation
    one_sided = True


class LocalDahl(AddedJoint):
    """Dahl's bristles."""

    name = "local-dahl"
    meaning = "a bristle that bends and slides gradually (Dahl)"
    looks_like = "as local-friction, its onset smooth"
    confused_with = "local-friction, local-microslip"
    check = "measure the loop at the onset: it must be smooth, and open from the lowest level on"
    numbers = (
        Number("stiffness", "N/m", "stiffness", (1, -1, 0)),
        Number("limit", "N", "normal_load", (1, 0, 0), SLIPS),
    )

    @classmethod
    def law(cls, values: Mapping[str, float]) -> JointLaw:
        """Friction whose limit is its load."""
        return Friction(Dahl(1.0, values["stiffness"]), values["normal_load"])


class LocalLuGre(AddedJoint):
    """LuGre's bristles: as Dahl's, with friction that falls with the speed."""

    name = "local-lugre"
    meaning = "a bristle whose friction falls with the speed (LuGre)"
    looks_like = "as local-dahl, with less loss the faster it slides"
    confused_with = "local-dahl, local-friction"
    check = "slide it by the same amount at two frequencies: the loss per cycle must fall with the frequency"
    contains = ("local-dahl",)
    numbers = (
        Number("stiffness", "N/m", "stiffness", (1, -1, 0)),
        Number("limit", "N", "normal_load", (1, 0, 0), ONSETS[::2]),
        Number("static_ratio", "1", "mu_static", (0, 0, 0), (1.5,)),
        Number("stribeck_velocity", "m/s", "stribeck_velocity", (0, 1, 1), (0.05, 0.3)),
    )

    @classmethod
    def law(cls, values: Mapping[str, float]) -> JointLaw:
        """Friction whose limit is its load."""
        v = dict(values)
        load = v.pop("normal_load")
        return Friction(LuGre(mu=1.0, **v, bristle_damping=0.0, viscous=0.0), load)


JOINT_CAUSES: tuple[type[AddedJoint], ...] = (
    LocalSpring,
    LocalMass,
    LocalDamper,
    LocalHysteresis,
    QuadraticDamping,
    CubicStiffness,
    PolynomialStiffness,
    QuinticStiffness,
    OneSidedStop,
    TwoSidedStop,
    LocalFriction,
    LocalMicroslip,
    LocalDahl,
    LocalLuGre,
    LocalBacklash,
    JointSlip,
    JointMicroslip,
    JointOpening,
)
"""Joints, and masses, that may not have been modelled."""
