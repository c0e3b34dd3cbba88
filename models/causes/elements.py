"""Causes made of nonlinear elements along the beam."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import nan
from typing import ClassVar

import numpy as np

from models.causes.cause import Cause, Unknown
from models.causes.structure import ALONG, SMALL
from models.elements import Element, ImpactStop, MidplaneStretching, QuadraticDrag
from models.rig import Rig, beam_of

AMPLIFIED = 10.0
"""Dynamic amplification of the first mode's static deflection at which the scales of strengths and gaps are set."""

GAPS = (0.05, 0.2, 0.5, 1.0)
"""Starts of gaps, in units of that deflection."""

SHARES = (0.0, 0.1, 1.0)
"""Starts of strengths that have no shape beside them, in units at which they matter."""


@dataclass(frozen=True)
class MidplaneStretchingCause(Cause):
    """An axial restraint that hardens the beam."""

    name: ClassVar[str] = "midplane-stretching"
    meaning: ClassVar[str] = "the ends hold the beam axially, so that it stiffens as it bends"
    looks_like: ClassVar[str] = "in phase, with the cube of the amplitude; frequencies rise with the level"
    confused_with: ClassVar[str] = "impact-stop, support-rotation-spring"
    check: ClassVar[str] = (
        "measure the resonance at three levels: its frequency must rise with the square of the amplitude"
    )

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["MidplaneStretchingCause"]:
        """Offer it for a beam that is free to shorten."""
        if rig.beam is not None and not _has(rig, MidplaneStretching):
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Stiffness of the restraint, beside that of the beam, E A / L."""
        beam = beam_of(rig)
        k = float(beam.youngs_modulus * beam.area / beam.length)
        starts = tuple(share * 10 * k for share in SHARES)
        return (Unknown("axial_stiffness", "N/m", _key(rig, "axial_stiffness"), 0.0, 1e4 * k, 0.0, starts),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Hold the ends."""
        return _with_element(rig, MidplaneStretching(**values))


@dataclass(frozen=True)
class QuadraticDragCause(Cause):
    """Drag along the beam."""

    name: ClassVar[str] = "quadratic-drag"
    meaning: ClassVar[str] = "a distributed force against the motion grows with the square of the velocity"
    looks_like: ClassVar[str] = "in quadrature; loss with the cube of the amplitude"
    confused_with: ClassVar[str] = "parameter:damping.mass_proportional, viscous-contact"
    check: ClassVar[str] = (
        "fix a card to the beam so that it moves more air, and repeat the records missed most: the loss must grow"
    )

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["QuadraticDragCause"]:
        """Offer it for a beam that has none yet."""
        if rig.beam is not None and not _has(rig, QuadraticDrag):
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Drag, in units of what takes the whole excitation at the velocity of the amplified deflection."""
        beam = beam_of(rig)
        velocity = float(beam.natural_frequencies()[0]) * deflection(rig)
        c = rig.excitation.amplitude / (beam.length * velocity**2)
        starts = tuple(share * c for share in SHARES)
        key = _key(rig, "coefficient")
        return (Unknown("coefficient", "N s2/m2 per m", key, 0.0, 1e4 * c, 0.0, starts),)

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Let the drag act."""
        return _with_element(rig, QuadraticDrag(**values))


@dataclass(frozen=True)
class ImpactStopCause(Cause):
    """A one-sided stop beside the beam."""

    name: ClassVar[str] = "impact-stop"
    meaning: ClassVar[str] = "the beam strikes a one-sided stop"
    looks_like: ClassVar[str] = "nothing below a threshold of the amplitude; then even and odd harmonics"
    confused_with: ClassVar[str] = "midplane-stretching"
    check: ClassVar[str] = (
        "look for what the beam can strike there and move it away, or measure just below and just above the level at "
        "which it sets in"
    )
    contains: ClassVar[tuple[str, ...]] = ("added-spring",)  # pressed so hard that it never opens
    abrupt: ClassVar[bool] = True

    @classmethod
    def candidates(cls, rig: Rig) -> Iterator["ImpactStopCause"]:
        """On a beam."""
        if rig.beam is not None:
            yield cls()

    def unknowns(self, rig: Rig) -> tuple[Unknown, ...]:
        """Stiffness, gap and place; a stop may press at rest, with a gap below zero."""
        beam, reach = beam_of(rig), deflection(rig)
        k = float(3 * beam.bending_stiffness / beam.length**3)
        gaps, places = tuple(share * reach for share in GAPS), tuple(share * beam.length for share in ALONG)
        widest = 0.1 * beam.length
        return (
            Unknown("stiffness", "N/m", _key(rig, "stiffness"), 0.0, 1e6 * k, 0.0, (SMALL * k, k, 20 * k)),
            Unknown("gap", "m", _key(rig, "gap"), -widest, widest, nan, gaps),
            Unknown("position", "m", _key(rig, "position"), 1e-6 * beam.length, beam.length, nan, places),
        )

    def extend(self, rig: Rig, values: Mapping[str, float]) -> Rig:
        """Put up the stop."""
        return _with_element(rig, ImpactStop(**values))


def deflection(rig: Rig) -> float:
    """Largest deflection of a beam's first mode under the excitation, ten times the static one [m].

    >>> from hbm.models.published import paper_rig
    >>> round(1e3 * deflection(paper_rig()), 2)
    0.58
    """
    beam = beam_of(rig)
    along = np.append(np.linspace(0.0, beam.length, 101), rig.excitation.position)
    first = np.abs(beam.shapes(along)[:, 0])
    drive = max(first[-1], 0.01 * first.max())
    return float(AMPLIFIED * first.max() * drive * rig.excitation.amplitude / beam.natural_frequencies()[0] ** 2)


def _has(rig: Rig, kind: type) -> bool:
    return any(isinstance(element, kind) for element in rig.elements)


def _key(rig: Rig, name: str) -> str:
    """Key of a number of the next element."""
    return f"elements[{len(rig.elements)}].{name}"


def _with_element(rig: Rig, element: Element) -> Rig:
    return replace(rig, elements=(*rig.elements, element))
