"""A rig, as a rig file describes it: structure, damping, contact, excitation and channels."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from models.assembly import MORE_MODES, Assembly, Layout, assembled
from models.attachments import Attachments
from models.beam import Beam
from models.bounds import bounded
from models.elements import Element, ElementRows, LiftOff, Reading, element_rows, gauss_points
from models.friction import describe, parameters, quantities_of
from models.friction.law import Parameter
from models.numbers import Described, Numbered
from models.parts import Channel, Contact, Damping, Drift, Excitation, ModalBody, Numbers, check_names
from models.plausible import Proportion, warn_of
from models.reduction import Reduction, Switches
from models.structure import Array, ModalStructure, SpringPort

RIGID = 1e10
"""Stiffness of a support that does not yield, in units of E I / L^3, where a tip can lift off it."""

DAMPING = ("mass_proportional", "stiffness_proportional", "high_mode_ratio")
UNITS = {
    "beam.length": "m",
    "beam.width": "m",
    "beam.thickness": "m",
    "beam.youngs_modulus": "Pa",
    "beam.density": "kg/m3",
    "contact.radius": "m",
    "contact.load_variation": "1",
    "attachments.clamp_stiffness": "N m/rad",
    "attachments.clamp_limit": "N m",
    "attachments.support_stiffness": "N/m",
    "attachments.tip_stiffness": "N m/rad",
    "damping.mass_proportional": "1/s",
    "damping.stiffness_proportional": "s",
    "damping.high_mode_ratio": "1",
}
"""Units of keys; those of entries of lists, by their last part, in `ENTRY_UNITS`."""

ENTRY_UNITS = {"position": "m", "mass": "kg", "stiffness": "N/m", "frequency_hz": "Hz"}


@dataclass(frozen=True, eq=False)
class Rig(Numbered):
    """A structure on its support: everything a simulation needs.

    Change it with :func:`dataclasses.replace`; `structure` follows.

    Attributes
    ----------
    computed : tuple of str
        Names of the signals that a simulation gives beside the channels; no channel has such a name.
    motions, forces, units : tuples
        Of these the relative displacement and the force where it touches, and their units.
    limits : (str, str)
        What its linear modes are called with all that touches held, and free.
    name : str
        Title of plots and reports.
    body : Beam or ModalBody
        Structure that vibrates.
    damping : Damping
    contact : Contact
    excitation : Excitation
    channels : tuple of Channel
    attachments : Attachments
        Springs, masses and resonators attached to a beam.
    elements : tuple of Element
        Nonlinear elements along a beam; for all that act, see :attr:`acting`.
    drift : tuple of Drift
        Numbers that change from record to record; the rig is that of record 1, see :meth:`at_record`.
    """

    computed: ClassVar[tuple[str, ...]] = ("drive", "slip", "slip_velocity", "friction", "normal")
    motions: ClassVar[tuple[str, ...]] = ("slip",)
    forces: ClassVar[tuple[str, ...]] = ("friction",)
    units: ClassVar[tuple[tuple[str, str], ...]] = (("m", "N"),)
    limits: ClassVar[tuple[str, str]] = ("stuck", "sliding")

    name: str
    body: Beam | ModalBody
    damping: Damping
    contact: Contact
    excitation: Excitation
    channels: tuple[Channel, ...] = field(default=())
    attachments: Attachments = field(default=Attachments())
    elements: tuple[Element, ...] = ()
    drift: tuple[Drift, ...] = ()

    def __post_init__(self) -> None:
        """Refuse places beyond the beam, and names that are given twice or taken."""
        check_names("Rig", self.channels, self.computed)
        if self.beam is not None and isinstance(self.beam.length, float):
            length = self.beam.length
            bounded("Excitation: position", self.excitation.position, 0.0, length, strict=True)
            held = self.attachments.support_stiffness is None and not self.contact.lift_off
            if held and self.excitation.position == length:
                raise ValueError(f"Excitation: position = {length:g}; must be < {length:g}, the tip is held there")
            for c in self.response_channels:
                bounded(f"Channel {c.name}: position", c.position, 0.0, length)
        warn_of(self.quantities, self.proportions)

    def __str__(self) -> str:
        """In words."""
        contact, law = self.contact, self.contact.law
        numbers = ", ".join(f"{name} {value:.6g}" for name, value in parameters(law).items())
        where = "" if self.beam is None else f" at {self.excitation.position:g} m"
        lines = [
            f"{self.name}: {self.body}",
            f"contact: {law.name}{f' ({numbers})' if numbers else ''} under {contact.normal_load:g} N"
            + (", may lift off" if contact.lift_off else ""),
            f"excitation: {self.excitation.amplitude:g} N{where}",
        ]
        if self.channels:
            lines.append("channels: " + ", ".join(f"{c.name} ({c.quantity})" for c in self.channels))
        more = [type(e).__name__ for e in self.elements]
        if more or self.attachments:
            lines.append("also: " + ", ".join([*more, *(["attachments"] if self.attachments else [])]))
        return "\n  ".join(lines)

    @property
    def beam(self) -> Beam | None:
        """Its body where that is a beam, with places along it; None where it is given by its modes."""
        return self.body if isinstance(self.body, Beam) else None

    @property
    def modal(self) -> ModalBody | None:
        """Its body where that is given by its modes."""
        return self.body if isinstance(self.body, ModalBody) else None

    @property
    def quantities(self) -> Iterator[tuple[str, str, Any]]:
        """Numbers with a usual range: key of the rig file, quantity of :mod:`models.plausible`, value."""
        if self.beam is not None:
            yield from self.beam.quantities
        yield from self.damping.quantities
        yield from ((f"contact.{name}", name, getattr(self.contact, name)) for name in ("normal_load", "radius"))
        yield from quantities_of(self.contact.law, "contact.friction")
        yield "excitation.amplitude", "amplitude", self.excitation.amplitude

    @property
    def proportions(self) -> Iterator[Proportion]:
        """Numbers that are usually less than others of it."""
        body, alpha = self.body, self.damping.mass_proportional
        critical = None if body.fundamental is None else 2 * body.fundamental
        yield Proportion("damping.mass_proportional", alpha, "1/s", critical, "critical damping of the first mode")
        if (beam := self.beam) is not None:
            yield from beam.proportions
            yield Proportion("contact.radius", self.contact.radius, "m", beam.length, "beam.length")
            slip = getattr(self.contact.law, "critical_slip", 0.0)
            yield Proportion("contact.friction.critical_slip", slip, "m", beam.thickness, "beam.thickness")

    @property
    def law_name(self) -> str:
        """Name of its friction law."""
        return self.contact.law.name

    @property
    def lift_off(self) -> bool:
        """Whether its tip leaves the support."""
        return self.contact.lift_off

    @property
    def laws(self) -> tuple[type, ...]:
        """Kind of its friction law."""
        return (type(self.contact.law),)

    @property
    def kind(self) -> tuple[Any, ...]:
        """What it has that takes long to simulate or may have no steady state: resonators, elements, transients."""
        return len(self.attachments.resonators), len(self.elements), self.excitation.settled

    @property
    def pressed(self) -> list[tuple[float, slice]]:
        """Static load [N] of all that touches, with its ports: of the contact."""
        return [(self.contact.normal_load, slice(0, 1))]

    @property
    def holds(self) -> float:
        """Largest mean friction force that its contact holds [N]."""
        known = parameters(self.contact.law)
        return max((float(known[n]) for n in ("mu", "mu_static") if n in known), default=0.0) * self.contact.normal_load

    @property
    def ports(self) -> int:
        """Where a force follows a law: the contact."""
        return 1

    @property
    def resonators(self) -> int:
        """How many are attached; each is a coordinate more."""
        return len(self.attachments.resonators)

    @cached_property
    def numbers(self) -> Described:
        """All its numbers by the keys of its rig file, with unit and bounds."""
        return {
            **_described(self.contact.law, "contact.friction"),
            "contact.normal_load": (self.contact.normal_load, Parameter("N", "static load", "")),
            "excitation.amplitude": (self.excitation.amplitude, Parameter("N", "force amplitude", "")),
            **self.of_elements,
            **self.structural,
            **self.of_measuring,
        }

    @property
    def of_elements(self) -> Described:
        """Parameters of the nonlinear elements, as :attr:`numbers`."""
        each = [_described(e, f"elements[{i}]") for i, e in enumerate(self.elements)]
        return {key: number for own in each for key, number in own.items()}

    @property
    def structural(self) -> Described:
        """Numbers that decide the linear structure, as :attr:`numbers`."""
        values = {f"damping.{name}": getattr(self.damping, name) for name in DAMPING}
        if self.beam is not None:
            values |= dict(zip(self.layout_keys, self.layout.scalars().values(), strict=True))
            if self.attachments.support_stiffness is None:  # what stands in for a rigid one is no number of the rig
                values.pop("attachments.support_stiffness", None)
            values["contact.load_variation"] = self.contact.load_variation
        return {key: (value, self._accepted(key)) for key, value in values.items()}

    @property
    def layout_keys(self) -> list[str]:
        """Keys of the scalars of the layout, channels by their names."""
        places = {
            f"channels[{i}].position": f"channels.{c.name}.position" for i, c in enumerate(self.response_channels)
        }
        pointed = [i for i, e in enumerate(self.elements) if e.reads is Reading.POINT]
        places |= {f"points[{j}]": f"elements[{i}].position" for j, i in enumerate(pointed)}
        return [places.get(key, key) for key in self.layout.scalars()]

    def _accepted(self, key: str) -> Parameter:
        """Unit and bounds of a number of the structure: everything stays on the beam."""
        unit = UNITS.get(key) or ENTRY_UNITS[key.rpartition(".")[2]]
        if key == "beam.length":
            furthest = max(self.excitation.position, *(c.position for c in self.channels))
            return Parameter(unit, "", "", lower=furthest, strict=False)
        upper = float(self.layout.beam.length) if key.endswith(".position") else float("inf")
        return Parameter(unit, "", "", upper=upper, strict=key.startswith("beam."))

    @cached_property
    def structure(self) -> ModalStructure:
        """The linear structure in modes, with the rows that couple it to the contact."""
        return self.reduction.structure([c.name for c in self.response_channels])

    @cached_property
    def reduction(self) -> Reduction:
        """Assembly that the structure is reduced from: mass and stiffness on more shapes than are kept.

        Raises
        ------
        ValueError
            If something is attached to a body given by its modes, linear or not.
        """
        contact, numbers = self.contact, self.mode_numbers
        if self.modal is not None:
            if self.attachments or self.acting:
                found = "attachments" if self.attachments else "elements" if self.elements else "lift_off = true"
                raise ValueError(f"{self.name}: has {found} and is given by its modes; must be a beam")
            assembly = _of_modes(self, self.modal)
        else:
            assembly = assembled(self.layout, residual=contact.residual_compliance)
        switches = Switches(contact.load_variation, contact.residual_compliance, contact.foreshortening)
        return Reduction(assembly, len(numbers), lambda omega_n: self.damping.dampers(omega_n, numbers), switches)

    @property
    def mode_numbers(self) -> Numbers:
        """Number of the mode of the bare structure that each mode counts as where damping goes by mode number."""
        if self.modal is not None:
            return np.arange(1, len(self.modal.frequencies_hz) + 1)
        return self.attachments.mode_numbers(beam_of(self).natural_frequencies())

    @cached_property
    def layout(self) -> Layout:
        """Geometry of a beam rig.

        Raises
        ------
        ValueError
            If the rig is given by its modes.
        """
        own = beam_of(self)
        attachments = self._attached(own)
        more = MORE_MODES if attachments else 0
        positions = tuple(c.position for c in self.response_channels)
        beam = replace(own, modes=own.modes + more)
        points = tuple(e.position for e in self.elements if e.reads is Reading.POINT)  # type: ignore[attr-defined]
        spans = any(e.reads is Reading.SPAN for e in self.elements)
        fractions = tuple(gauss_points(own.modes)[0].tolist()) if spans else ()
        radius, excitation = self.contact.radius, self.excitation.position
        return Layout(beam, radius, excitation, positions, points, fractions, attachments)

    def _attached(self, beam: Beam) -> Attachments:
        """Attachments; with a support all but rigid where it is rigid and the tip can lift off it."""
        if not self.contact.lift_off or self.attachments.support_stiffness is not None:
            return self.attachments
        return replace(self.attachments, support_stiffness=RIGID * beam.bending_stiffness / beam.length**3)

    @property
    def followed_modes(self) -> Array | None:
        """Modes on the shapes they are reduced from, which tell their signs; None where these are the same always."""
        return self.reduction.kept if self.attachments and self.beam is not None else None

    @cached_property
    def element_rows(self) -> list[ElementRows]:
        """Modal shapes at the place where each element touches the beam."""
        if self.beam is None or not self.acting:
            return []
        ports = self.reduction.ports(self.beam.length)._replace(support=self.support, load=self.contact.normal_load)
        return element_rows(self.acting, ports, self.beam.modes)

    @property
    def acting(self) -> tuple[Element, ...]:
        """The nonlinear elements, and last the lift of the tip where it can lift off."""
        return (*self.elements, LiftOff()) if self.contact.lift_off else self.elements

    @cached_property
    def support(self) -> SpringPort | None:
        """Port of the gap under the tip; None where the tip is kept on its support.

        Raises
        ------
        ValueError
            If the rig is given by its modes, its reaction is constant, its residual compliance is left out, or its
            clamp slips.
        """
        contact = self.contact
        if not contact.lift_off:
            return None
        needed = {
            "variable_normal_load = true": contact.load_variation > 0.0,
            "residual_compliance = true": contact.residual_compliance,
            "no clamp_limit": self.attachments.clamp_limit is None,
        }
        for what, given in needed.items():
            if not given:
                raise ValueError(f"{self.name}: has lift_off = true; must have {what} with it, or lift_off = false")
        layout = self.layout
        return self.reduction.port(layout.at_support, float(layout.attachments.support_stiffness or 0.0))

    @cached_property
    def clamp(self) -> SpringPort | None:
        """Port of the friction in the clamp; None where the clamp does not slip.

        Raises
        ------
        ValueError
            If there is no spring to limit.
        """
        ends = self.attachments
        if ends.clamp_limit is None:
            return None
        if ends.clamp_stiffness is None:
            raise ValueError(f"{self.name}: has a clamp_limit and no clamp_stiffness; must have both, or no limit")
        return self.reduction.port(self.layout.at_clamp, ends.clamp_stiffness)

    def with_modes(self, modes: int) -> "Rig":
        """Return the same beam rig on another number of modes; a modal rig is returned as it is."""
        if self.beam is None:
            return self
        return replace(self, body=replace(self.beam, modes=modes), damping=self.damping.on_modes(modes))


def beam_of(rig: Rig) -> Beam:
    """The beam of a rig.

    Raises
    ------
    ValueError
        If it is given by its modes.
    """
    if rig.beam is None:
        raise ValueError(f"{rig.name}: is given by its modes; must be a beam")
    return rig.beam


def _described(law: object, table: str) -> Described:
    """Parameters of a friction law or an element, with their bounds."""
    known = describe(type(law))
    return {f"{table}.{name}": (value, known[name]) for name, value in parameters(law).items()}


def _of_modes(rig: Rig, body: ModalBody) -> Assembly:
    squares = (2 * np.pi * np.asarray(body.frequencies_hz)) ** 2
    n = len(squares)
    shapes = dict(zip((c.name for c in rig.channels), body.shapes, strict=True))
    seen = [shapes[c.name] for c in rig.response_channels]
    rows = np.array([body.contact_shape, body.excitation_shape, *seen, np.zeros(n)])
    none = np.zeros((1, n))
    return Assembly(
        np.eye(n), np.diag(squares), np.zeros((n, n)), rows, np.zeros((len(rows), 2)), none, none, np.zeros((0, 1))
    )
