"""Causes in the structure: what is attached to it, how it is held, how it damps."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import nan
from typing import Any, ClassVar

import numpy as np

from models.attachments import PointMass, PointSpring, Resonator
from models.beam import Beam
from models.causes.cause import Cause, Unknown
from models.rig import Rig, beam_of

TUNED = (1.2, 0.6, 0.8, 0.95, 1.1, 1.35, 1.6, 2.0, 3.2)
"""Starts of the frequency of a resonator, in units of the beam's own: dense where it is driven, for its effect changes
sign there."""

RIGID = (1e8, 1e5, 1e4, 1e3, 1e2, 1e1)
"""Starts of a stiffness that is infinite nominally, in units of the beam's own; the first changes hardly anything."""

ALONG = (0.5, 0.25, 0.75, 0.95)
"""Starts of positions, in lengths of the beam."""

SMALL = 1e-7
"""Start of a mass or a stiffness that changes hardly anything, in units of the beam's own: at none at all its place
would have no say."""


@dataclass(frozen=True)
class ClampRotation(Cause):
    """A clamp that turns on a spring."""

    name: ClassVar[str] = "clamp-rotation"
    meaning: ClassVar[str] = "the clamp is a rotational spring, not rigid"
    looks_like: ClassVar[str] = "linear, alike at all levels; lowers the frequencies of modes unequally"
    confused_with: ClassVar[str] = "parameter:beam.youngs_modulus, clamp-friction"
    check: ClassVar[str] = (
        "measure about modes 2 and 3, or the beam hung free: a wrong Young's modulus lowers all frequencies by the "
        "same factor, a clamp that turns does not"
    )

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["ClampRotation"]:
        """Offer it for a beam whose clamp is rigid."""
        if rig.beam is not None and rig.attachments.clamp_stiffness is None:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Stiffness of the clamp."""
        return (_rigid("N m/rad", "attachments.clamp_stiffness", _turning(beam_of(rig))),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Let the clamp turn."""
        return _attached(rig, clamp_stiffness=values["stiffness"])


@dataclass(frozen=True)
class SupportRotationSpring(Cause):
    """A rotational spring at the support."""

    name: ClassVar[str] = "support-rotation-spring"
    meaning: ClassVar[str] = "the support resists the rotation of the tip elastically"
    looks_like: ClassVar[str] = "linear; raises the frequencies as an end moment does"
    confused_with: ClassVar[str] = "added-spring, clamp-rotation"
    check: ClassVar[str] = (
        "measure three records about the second mode: an end moment shifts it by another share than a spring along "
        "the beam"
    )

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["SupportRotationSpring"]:
        """Offer it for a beam whose tip turns freely."""
        if rig.beam is not None and rig.attachments.tip_stiffness is None:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Stiffness of the spring."""
        k = _turning(beam_of(rig))
        starts = (0.0, 0.01 * k, k)
        return (Unknown("stiffness", "N m/rad", "attachments.tip_stiffness", 0.0, 1e6 * k, 0.0, starts),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Attach the spring."""
        return _attached(rig, tip_stiffness=values["stiffness"])


@dataclass(frozen=True)
class SupportFlexibility(Cause):
    """A support that yields vertically."""

    name: ClassVar[str] = "support-flexibility"
    meaning: ClassVar[str] = "the support yields vertically"
    looks_like: ClassVar[str] = "linear; the tip moves vertically"
    confused_with: ClassVar[str] = "clamp-rotation, added-mass"
    check: ClassVar[str] = "put an accelerometer on the support: it must move with the tip"

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["SupportFlexibility"]:
        """Offer it for a beam whose support is rigid."""
        if rig.beam is not None and rig.attachments.support_stiffness is None:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Stiffness of the support."""
        return (_rigid("N/m", "attachments.support_stiffness", _bending(beam_of(rig))),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Let the support yield."""
        return _attached(rig, support_stiffness=values["stiffness"])


@dataclass(frozen=True)
class ContactLoss(Cause):
    """A tip that leaves its support, :class:`models.elements.LiftOff`."""

    name: ClassVar[str] = "contact-loss"
    meaning: ClassVar[str] = "the tip lifts off where the model keeps contact"
    looks_like: ClassVar[str] = "nothing while the reaction stays positive; then all harmonics"
    confused_with: ClassVar[str] = "impact-stop"
    check: ClassVar[str] = (
        "raise the normal load by a known amount: the level at which all harmonics set in must rise with it"
    )
    abrupt: ClassVar[bool] = True

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["ContactLoss"]:
        """Offer it for a beam; with a clamp that slips, or transients, it is not known."""
        contact = rig.contact
        known = contact.residual_compliance and rig.attachments.clamp_limit is None and rig.excitation.settled
        if rig.beam is not None and known and not contact.lift_off:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """None: what holds the tip is the load."""
        return ()

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Let the tip lift off; a load that the model holds constant then varies as the reaction does."""
        varies = rig.contact.load_variation or 1.0
        return replace(rig, contact=replace(rig.contact, lift_off=True, load_variation=varies))


@dataclass(frozen=True)
class StiffnessDamping(Cause):
    """Damping in proportion to the stiffness."""

    name: ClassVar[str] = "stiffness-damping"
    meaning: ClassVar[str] = "damping beta omega_i^2 beside the mass-proportional one"
    looks_like: ClassVar[str] = "in phase with the velocity, growing with the frequency; upper modes and harmonics"
    confused_with: ClassVar[str] = "bristle-memory, viscous-contact"
    check: ClassVar[str] = (
        "lift the tip off its support and let modes 1 to 3 ring down: their damping ratios must grow with their "
        "frequencies"
    )

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["StiffnessDamping"]:
        """Offer it for any rig."""
        yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Beta of the damping."""
        now = rig.damping.stiffness_proportional
        starts = tuple(now + more for more in (0.0, 1e-6, 1e-5, 1e-4))
        return (Unknown("beta", "s", "damping.stiffness_proportional", 0.0, 1.0, now, starts),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Set beta."""
        return rig.with_number("damping.stiffness_proportional", values["beta"])


@dataclass(frozen=True)
class AddedMass(Cause):
    """A lumped mass that was not modelled."""

    name: ClassVar[str] = "added-mass"
    meaning: ClassVar[str] = "a lumped mass sits on the beam"
    looks_like: ClassVar[str] = "linear, in phase, growing with the square of the frequency"
    confused_with: ClassVar[str] = "added-spring, attached-resonator below its frequency"
    check: ClassVar[str] = (
        "weigh what is mounted there, or add a known mass at that place and repeat the records missed most"
    )

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["AddedMass"]:
        """On a beam."""
        if rig.beam is not None:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Mass and place."""
        key, m = f"attachments.masses[{len(rig.attachments.masses)}].", _mass(beam_of(rig))
        mass = Unknown("mass", "kg", key + "mass", 0.0, 10 * m, 0.0, (SMALL * m, 0.01 * m))
        return mass, _place(beam_of(rig), key)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Put the mass on the beam."""
        return _attached(rig, masses=(*rig.attachments.masses, PointMass(**values)))


@dataclass(frozen=True)
class AddedSpring(Cause):
    """A spring to the ground that was not modelled."""

    name: ClassVar[str] = "added-spring"
    meaning: ClassVar[str] = "a spring holds the beam to the ground"
    looks_like: ClassVar[str] = "linear, in phase, whatever the frequency"
    confused_with: ClassVar[str] = "support-rotation-spring, added-mass, attached-resonator above its frequency"
    check: ClassVar[str] = (
        "look for what touches the beam there, such as a cable, free it and repeat the records missed most"
    )
    contains: ClassVar[tuple[str, ...]] = ("support-rotation-spring",)  # stiff and close to the support

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["AddedSpring"]:
        """On a beam."""
        if rig.beam is not None:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Stiffness and place."""
        key, k = f"attachments.springs[{len(rig.attachments.springs)}].", _bending(beam_of(rig))
        stiffness = Unknown("stiffness", "N/m", key + "stiffness", 0.0, 1e6 * k, 0.0, (SMALL * k, 0.1 * k, k))
        return stiffness, _place(beam_of(rig), key)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Attach the spring."""
        return _attached(rig, springs=(*rig.attachments.springs, PointSpring(**values)))

    def plainly(self, rig: Rig, values: Mapping[str, float]) -> dict[str, float]:
        """Stiffness against rotation of the support, by the lever from there."""
        return {"stiffness": values["stiffness"] * (beam_of(rig).length - values["position"]) ** 2}


@dataclass(frozen=True)
class AttachedResonator(Cause):
    """A small oscillator that was not modelled."""

    name: ClassVar[str] = "attached-resonator"
    meaning: ClassVar[str] = "something small swings on the beam"
    looks_like: ClassVar[str] = "linear; changes its sign at its frequency, with a peak near it"
    confused_with: ClassVar[str] = "added-mass below its frequency, added-spring above"
    check: ClassVar[str] = (
        "look for what can swing there, such as a cable or a loose part, hold it still and repeat the records about "
        "its frequency"
    )
    contains: ClassVar[tuple[str, ...]] = ("added-mass", "added-spring")

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["AttachedResonator"]:
        """On a beam."""
        if rig.beam is not None:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Mass, frequency when held at its foot, and place."""
        beam = beam_of(rig)
        key, m = f"attachments.resonators[{len(rig.attachments.resonators)}].", _mass(beam)
        hz = float(beam.natural_frequencies()[0] / (2 * np.pi))
        starts = tuple(share * hz for share in TUNED)
        return (
            Unknown("mass", "kg", key + "mass", 0.0, m, 0.0, (SMALL * m, 1e-3 * m, 4e-3 * m, 0.02 * m)),
            Unknown("frequency_hz", "Hz", key + "frequency_hz", 0.05 * hz, 100 * hz, nan, starts),
            _place(beam, key),
        )

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Attach the oscillator."""
        return _attached(rig, resonators=(*rig.attachments.resonators, Resonator(**values)))


def _mass(beam: Beam) -> float:
    return float(beam.mass_per_length * beam.length)


def _turning(beam: Beam) -> float:
    """Its own stiffness against rotation, E I / L [N m/rad]."""
    return float(beam.bending_stiffness / beam.length)


def _bending(beam: Beam) -> float:
    """Its own stiffness against bending, 3 E I / L^3 [N/m]."""
    return float(3 * beam.bending_stiffness / beam.length**3)


def _rigid(unit: str, key: str, own: float) -> Unknown:
    """Stiffness of what is rigid nominally, beside a beam's own."""
    infinite = float("inf")
    return Unknown("stiffness", unit, key, 1e-3 * own, infinite, infinite, tuple(k * own for k in RIGID))


def _place(beam: Beam, key: str) -> Unknown:
    starts = tuple(share * beam.length for share in ALONG)
    return Unknown("position", "m", key + "position", 1e-6 * beam.length, beam.length, nan, starts)


def _attached(rig: Rig, **more: Any) -> Rig:
    return replace(rig, attachments=replace(rig.attachments, **more))
