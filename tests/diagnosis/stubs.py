"""A small catalogue: causes that are attachments of the beam."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from models import PointMass, PointSpring, Rig, Stribeck
from models.causes.cause import Cause, Unknown


def _places(rig: Rig) -> tuple[float, ...]:
    return tuple(rig.body.length * f for f in (0.3, 0.5, 0.7, 0.87))


@dataclass(frozen=True)
class AddedMass:
    name: ClassVar[str] = "added-mass"
    meaning: ClassVar[str] = "a lumped mass"
    looks_like: ClassVar[str] = ""
    confused_with: ClassVar[str] = ""

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator[Cause]:
        yield cls()

    @property
    def label(self) -> str:
        return self.name

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        i, L = len(rig.attachments.masses), rig.body.length
        return (
            Unknown("mass", "kg", f"attachments.masses[{i}].mass", 0.0, 0.5, 0.0, (1e-6, 5e-3, 3e-2)),
            Unknown("position", "m", f"attachments.masses[{i}].position", 0.05 * L, 0.98 * L, L / 2, _places(rig)),
        )

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        more = (*rig.attachments.masses, PointMass(values["mass"], values["position"]))
        return replace(rig, attachments=replace(rig.attachments, masses=more))


@dataclass(frozen=True)
class AddedSpring:
    name: ClassVar[str] = "added-spring"
    meaning: ClassVar[str] = "a spring to the ground"
    looks_like: ClassVar[str] = ""
    confused_with: ClassVar[str] = ""

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator[Cause]:
        yield cls()

    @property
    def label(self) -> str:
        return self.name

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        i, L = len(rig.attachments.springs), rig.body.length
        return (
            Unknown("stiffness", "N/m", f"attachments.springs[{i}].stiffness", 0.0, 1e5, 0.0, (1.0, 500.0, 5e3)),
            Unknown("position", "m", f"attachments.springs[{i}].position", 0.05 * L, 0.98 * L, L / 2, _places(rig)),
        )

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        more = (*rig.attachments.springs, PointSpring(values["stiffness"], values["position"]))
        return replace(rig, attachments=replace(rig.attachments, springs=more))


@dataclass(frozen=True)
class ClampRotation:
    name: ClassVar[str] = "clamp-rotation"
    meaning: ClassVar[str] = "the clamp is a rotational spring"
    looks_like: ClassVar[str] = ""
    confused_with: ClassVar[str] = ""

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator[Cause]:
        yield cls()

    @property
    def label(self) -> str:
        return self.name

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        starts = (1e7, 1e6, 1e5, 2e4)
        key = "attachments.clamp_stiffness"
        return (Unknown("stiffness", "N m/rad", key, 1e3, 1e8, np.inf, starts),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        return replace(rig, attachments=replace(rig.attachments, clamp_stiffness=values["stiffness"]))


@dataclass(frozen=True)
class SupportRotationSpring:
    name: ClassVar[str] = "support-rotation-spring"
    meaning: ClassVar[str] = "a rotational spring at the tip"
    looks_like: ClassVar[str] = ""
    confused_with: ClassVar[str] = ""

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator[Cause]:
        yield cls()

    @property
    def label(self) -> str:
        return self.name

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        return (Unknown("stiffness", "N m/rad", "attachments.tip_stiffness", 0.0, 1e4, 0.0, (1e-3, 1.0, 20.0)),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        return replace(rig, attachments=replace(rig.attachments, tip_stiffness=values["stiffness"]))


STUBS = (AddedMass, AddedSpring, ClampRotation, SupportRotationSpring)


@dataclass(frozen=True)
class StribeckWeakening:
    name: ClassVar[str] = "stribeck-weakening"
    meaning: ClassVar[str] = "friction falls with sliding speed"
    looks_like: ClassVar[str] = ""
    confused_with: ClassVar[str] = ""

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator[Cause]:
        yield cls()

    @property
    def label(self) -> str:
        return self.name

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        mu, law = rig.contact.law.mu, "contact.friction."
        return (
            Unknown("mu", "1", law + "mu", 0.1 * mu, mu, mu, (0.999 * mu, 0.9 * mu, 0.7 * mu)),
            Unknown("mu_static", "1", law + "mu_static", 0.2 * mu, 3.0 * mu, mu, (mu,)),
            Unknown("stribeck_velocity", "m/s", law + "stribeck_velocity", 1e-5, 1.0, np.nan, (1e-3, 1e-2)),
        )

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        nominal = rig.contact.law
        critical_slip = nominal.critical_slip * values["mu_static"] / nominal.mu
        law = Stribeck(**values, exponent=2.0, critical_slip=critical_slip)
        return replace(rig, contact=replace(rig.contact, law=law))
