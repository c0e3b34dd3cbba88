"""What a rig file says: structure, damping, contact, excitation and channels."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from models.assembly import MORE_MODES, Assembly, Attachments, Layout, assembled
from models.beam import Beam
from models.bounds import bounded
from models.elements import Element, ElementRows, LiftOff, Reading, element_rows, gauss_points
from models.friction import FrictionLaw, check_parameters, parameters
from models.reduction import Dampers, Reduction, Switches
from models.structure import Array, ModalStructure, SpringPort, modal_damping

Quantity = Literal["force", "acceleration", "velocity", "displacement"]
QUANTITIES: tuple[str, ...] = get_args(Quantity)
Numbers = npt.NDArray[np.intp]
UNITS: dict[str, str] = {"force": "N", "acceleration": "m/s2", "velocity": "m/s", "displacement": "m"}

RIGID = 1e10
"""Stiffness of a support that does not yield, in units of E I / L^3, where a tip can lift off it."""


@dataclass(frozen=True)
class ModalBody:
    """Any structure given by its mass-normalised modes instead of a beam's geometry.

    Attributes
    ----------
    frequencies_hz : tuple of float, (n,)
        Natural frequencies with the contact sliding freely [Hz].
    shapes : tuple of tuple of float, (channels, n)
        Mode shapes at each of the rig's channels, in their order.
    contact_shape : tuple of float, (n,)
        du/dq of each mode.
    excitation_shape : tuple of float, (n,)
        Mode shapes at the excitation.
    """

    frequencies_hz: tuple[float, ...]
    shapes: tuple[tuple[float, ...], ...]
    contact_shape: tuple[float, ...]
    excitation_shape: tuple[float, ...]

    def __post_init__(self) -> None:
        """Refuse frequencies that are none, and shapes of other numbers of modes."""
        for i, hz in enumerate(self.frequencies_hz):
            bounded(f"ModalBody: frequencies_hz[{i}]", hz, 0.0, strict=True)
        n = len(self.frequencies_hz)
        rows = {"contact_shape": self.contact_shape, "excitation_shape": self.excitation_shape}
        rows |= {f"shapes[{i}]": row for i, row in enumerate(self.shapes)}
        for name, row in rows.items():
            if len(row) != n:
                raise ValueError(f"ModalBody: {name} has {len(row)} entries; must have {n}, one for each frequency")

    def __str__(self) -> str:
        """Its modes in a few words."""
        hz = sorted(self.frequencies_hz)
        return f"{len(hz)} modes given, {hz[0]:.6g} to {hz[-1]:.6g} Hz"


@dataclass(frozen=True)
class Damping:
    """Damping of the modes; see :func:`models.structure.modal_damping`.

    Attributes
    ----------
    mass_proportional : float
        alpha [1/s] (25).
    modal_ratios : tuple of float or None
        Ratios that replace alpha and the high-mode ratio.
    stiffness_proportional : float
        beta [s].
    high_mode_ratio, high_mode_from : float, int
        Ratio of the modes from this one (counted from 1) up; 0 leaves alpha there too.
    """

    mass_proportional: float = 0.0
    modal_ratios: tuple[float, ...] | None = None
    stiffness_proportional: float = 0.0
    high_mode_ratio: float = 0.02
    high_mode_from: int = 6

    def __post_init__(self) -> None:
        """Refuse damping that is negative."""
        for name in ("mass_proportional", "stiffness_proportional", "high_mode_ratio"):
            bounded(f"Damping: {name}", getattr(self, name), 0.0)
        for i, ratio in enumerate(self.modal_ratios or ()):
            bounded(f"Damping: modal_ratios[{i}]", ratio, 0.0)
        bounded("Damping: high_mode_from", self.high_mode_from, 1)

    def dampers(self, omega_n: Array, numbers: Numbers) -> Dampers:
        """Damping of modes that count as modes `numbers` (n,) of the beam."""
        viscous = self._viscous(omega_n, numbers)
        # what is not alpha is a ratio, 2 zeta omega_n
        slope = replace(self, mass_proportional=0.0)._viscous(omega_n, numbers) / (2 * omega_n**2)
        return Dampers(viscous, slope, self.stiffness_proportional)

    def dampers_change(self, name: str, omega_n: Array, numbers: Numbers) -> Dampers:
        """Derivative of :meth:`dampers` to one of its fields, at held frequencies."""
        settings: list[dict[str, Any]] = [{name: 1.0}, {name: 2.0}]  # it is linear
        one, two = (replace(self, **setting).dampers(omega_n, numbers) for setting in settings)
        return Dampers(two.viscous - one.viscous, two.slope - one.slope, two.strain_rate - one.strain_rate)

    def _viscous(self, omega_n: Array, numbers: Numbers) -> Array:
        return modal_damping(
            omega_n, self.mass_proportional, self.modal_ratios, self.high_mode_ratio, self.high_mode_from, numbers
        )


@dataclass(frozen=True, eq=False)
class Contact:
    """The support and the friction on it.

    Attributes
    ----------
    normal_load : float
        P [N].
    law : FrictionLaw
        Friction law with its parameters.
    radius : float
        Half-cylinder radius r [m]; used by a beam only, like what follows.
    load_variation : float
        Scale on R(t) - P as the friction sees it: 1 as in physics.md section 2, 0 for a constant load.
    residual_compliance, foreshortening : bool
        Keep C_res and the T G q coupling of physics.md section 2.
    lift_off : bool
        Whether the tip leaves its support where the reaction would turn negative, :class:`models.elements.LiftOff`; of
        a beam whose reaction varies, with its residual compliance.
    """

    normal_load: float
    law: FrictionLaw
    radius: float = 0.0
    load_variation: float = 1.0
    residual_compliance: bool = True
    foreshortening: bool = True
    lift_off: bool = False

    def __post_init__(self) -> None:
        """Refuse numbers that no contact has."""
        bounded("Contact: normal_load", self.normal_load, 0.0)
        bounded("Contact: radius", self.radius, 0.0)
        check_parameters(self.law)


@dataclass(frozen=True)
class Excitation:
    """Shaker force: cosine of the fundamental, `amplitude` [N], at `position` [m] of a beam.

    Its distortion is given by `harmonics`: numbers k >= 2 with the coefficients of cos and sin k Omega t, relative to
    the amplitude of the fundamental. With `measured_harmonics` the harmonics of a simulated record are those that were
    measured of its force; and unless `settled`, its records were taken before the transient of a start had died out.
    Nothing but the diagnosis, which has records, minds these two.

    >>> round(float(Excitation(2.0, harmonics=((3, 0.0, 0.1),)).force(np.pi / 2)), 9)
    -0.2
    """

    amplitude: float
    position: float = 0.0
    harmonics: tuple[tuple[int, float, float], ...] = ()
    measured_harmonics: bool = False
    settled: bool = True

    def __post_init__(self) -> None:
        """Refuse a negative force, and numbers of harmonics that are not."""
        bounded("Excitation: amplitude", self.amplitude, 0.0)
        bounded("Excitation: position", self.position, 0.0)
        numbers = [k for k, _, _ in self.harmonics]
        if any(k < 2 for k in numbers) or len(set(numbers)) < len(numbers):
            raise ValueError(f"excitation.harmonics: numbers {numbers}; must be 2 or more, each once")

    @property
    def tones(self) -> tuple[tuple[int, float, float], ...]:
        """Number and coefficients of every harmonic, the fundamental's first, for a unit amplitude."""
        return ((1, 1.0, 0.0), *self.harmonics)

    def force(self, theta: npt.ArrayLike, derivative: int = 0) -> Array:
        """Force at phases [N], or its derivative to the phase."""
        theta, turned = np.asarray(theta, dtype=float), derivative * np.pi / 2
        force = np.zeros(theta.shape)
        for k, a, b in self.tones:
            force += float(k) ** derivative * (a * np.cos(k * theta + turned) + b * np.sin(k * theta + turned))
        return np.asarray(self.amplitude * force)


@dataclass(frozen=True)
class Drift:
    """A number of a rig that changes from record to record: in record n it is 1 + `rate` (n - 1) times the rig's.

    Attributes
    ----------
    parameter : str
        Key of :func:`models.numbers.number`.
    rate : float
        Per record.
    """

    parameter: str
    rate: float


@dataclass(frozen=True)
class Channel:
    """What is, or would be, measured.

    Attributes
    ----------
    name : str
    quantity : str
        One of `QUANTITIES`.
    position : float
        On a beam [m].
    gain, delay : float
        The channel reads gain times what was there a delay [s] ago; of motion only.
    repeatability : float
        Share of its response that differs from one mounting of the structure to the next.
    """

    name: str
    quantity: str
    position: float = 0.0
    gain: float = 1.0
    delay: float = 0.0
    repeatability: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what nothing measures."""
        if self.quantity not in QUANTITIES:
            raise ValueError(f'Channel: quantity = "{self.quantity}"; must be one of {", ".join(QUANTITIES)}')
        bounded(f"Channel {self.name}: position", self.position, 0.0)
        bounded(f"Channel {self.name}: gain", self.gain)
        bounded(f"Channel {self.name}: delay", self.delay)
        bounded(f"Channel {self.name}: repeatability", self.repeatability, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Rig:
    """A structure on its support: everything a simulation needs.

    Change it with :func:`dataclasses.replace`; `structure` follows.

    Attributes
    ----------
    name : str
        Title of plots and reports.
    body : Beam or ModalBody
        What vibrates.
    damping : Damping
    contact : Contact
    excitation : Excitation
    channels : tuple of Channel
    attachments : Attachments
        What is attached to a beam.
    elements : tuple of Element
        Nonlinear elements along a beam; for all that act, see :attr:`acting`.
    drift : tuple of Drift
        What changes from record to record; the rig itself is that of record 1, see :func:`models.numbers.at_record`.
    """

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
        """Refuse places beyond the beam, and names that are given twice."""
        names = [c.name for c in self.channels]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f'Rig: channel "{twice}" is there twice; names must differ')
        if isinstance(self.body, Beam) and isinstance(self.body.length, float):
            length = self.body.length
            bounded("Excitation: position", self.excitation.position, 0.0, length)
            for c in self.response_channels:
                bounded(f"Channel {c.name}: position", c.position, 0.0, length)

    def __str__(self) -> str:
        """In words."""
        body, contact, law = self.body, self.contact, self.contact.law
        numbers = ", ".join(f"{name} {value:.6g}" for name, value in parameters(law).items())
        where = f" at {self.excitation.position:g} m" if isinstance(body, Beam) else ""
        lines = [
            f"{self.name}: {body}",
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
    def response_channels(self) -> tuple[Channel, ...]:
        """Channels that measure motion (all but force)."""
        return tuple(c for c in self.channels if c.quantity != "force")

    @cached_property
    def structure(self) -> ModalStructure:
        """The linear structure in modes, with the rows that couple it to the contact."""
        return self.reduction.structure([c.name for c in self.response_channels])

    @cached_property
    def reduction(self) -> Reduction:
        """Where the structure comes from: mass and stiffness on more shapes than are kept.

        Raises
        ------
        ValueError
            If something is attached to a body given by its modes, linear or not.
        """
        contact, numbers = self.contact, self.mode_numbers
        if isinstance(self.body, ModalBody):
            if self.attachments or self.acting:
                found = "attachments" if self.attachments else "elements" if self.elements else "lift_off = true"
                raise ValueError(f"{self.name}: has {found} and is given by its modes; must be a beam")
            assembly = _of_modes(self, self.body)
        else:
            assembly = assembled(self.layout, residual=contact.residual_compliance)
        switches = Switches(contact.load_variation, contact.residual_compliance, contact.foreshortening)
        return Reduction(assembly, len(numbers), lambda omega_n: self.damping.dampers(omega_n, numbers), switches)

    @property
    def mode_numbers(self) -> Numbers:
        """Which mode of the bare structure each mode counts as where modes are damped by number."""
        if isinstance(self.body, ModalBody):
            return np.arange(1, len(self.body.frequencies_hz) + 1)
        return _numbers(self.body, self.attachments)

    @property
    def layout(self) -> Layout:
        """Geometry of a beam rig.

        Raises
        ------
        ValueError
            If the rig is given by its modes.
        """
        if isinstance(self.body, ModalBody):
            raise ValueError(f"{self.name}: is given by its modes; must be a beam")
        attachments = self._attached(self.body)
        more = MORE_MODES if attachments else 0
        positions = tuple(c.position for c in self.response_channels)
        beam = replace(self.body, modes=self.body.modes + more)
        points = tuple(e.position for e in self.elements if e.reads is Reading.POINT)  # type: ignore[attr-defined]
        spans = any(e.reads is Reading.SPAN for e in self.elements)
        fractions = tuple(gauss_points(self.body.modes)[0].tolist()) if spans else ()
        radius, excitation = self.contact.radius, self.excitation.position
        return Layout(beam, radius, excitation, positions, points, fractions, attachments)

    def _attached(self, beam: Beam) -> Attachments:
        """What is attached; with a support all but rigid where it is rigid and the tip can lift off it."""
        if not self.contact.lift_off or self.attachments.support_stiffness is not None:
            return self.attachments
        return replace(self.attachments, support_stiffness=RIGID * beam.bending_stiffness / beam.length**3)

    @cached_property
    def element_rows(self) -> list[ElementRows]:
        """Where each element touches the beam, in its modes."""
        if isinstance(self.body, ModalBody) or not self.acting:
            return []
        ports = self.reduction.ports(self.body.length)._replace(support=self.support, load=self.contact.normal_load)
        return element_rows(self.acting, ports, self.body.modes)

    @property
    def acting(self) -> tuple[Element, ...]:
        """The nonlinear elements, and last the lift of the tip where it can lift off."""
        return (*self.elements, LiftOff()) if self.contact.lift_off else self.elements

    @cached_property
    def support(self) -> SpringPort | None:
        """Where a gap under the tip acts; None where the tip is kept on its support.

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
        """Where friction in the clamp acts; None where the clamp does not slip.

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
        """Return the same beam rig on another number of modes; a modal rig is returned as it is.

        Where each mode has a damping ratio of its own, modes beyond those listed have that of the last.
        """
        if not isinstance(self.body, Beam):
            return self
        damping, ratios = self.damping, self.damping.modal_ratios
        if ratios is not None and len(ratios) > 1:
            damping = replace(damping, modal_ratios=(ratios + ratios[-1:] * modes)[:modes])
        return replace(self, body=replace(self.body, modes=modes), damping=damping)


def _numbers(beam: Beam, attachments: Attachments) -> Numbers:
    """Which mode of the bare beam each mode kept counts as, so that a resonator of no mass changes nothing.

    The mode that a resonator adds among them counts as the first.
    """
    omega_n = beam.natural_frequencies()
    swinging = 2 * np.pi * np.array([float(r.frequency_hz) for r in attachments.resonators])
    added = swinging[swinging < omega_n[-1]]
    numbers = np.concatenate([np.arange(1, beam.modes + 1), np.ones(len(added), dtype=int)])
    return np.asarray(numbers[np.argsort(np.concatenate([omega_n, added]), kind="stable")])


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
