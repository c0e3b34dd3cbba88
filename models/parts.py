"""Parts of a rig: given modes, damping, contact, excitation, drift and channels."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isclose
from numbers import Integral
from typing import Any, ClassVar, Literal, get_args

import numpy as np
import numpy.typing as npt

from models.bounds import bounded, several
from models.friction import FrictionLaw, check_parameters
from models.plausible import plain, plausible
from models.reduction import Dampers
from models.structure import Array, modal_damping

Quantity = Literal["force", "acceleration", "velocity", "displacement"]


QUANTITIES: tuple[str, ...] = get_args(Quantity)


Numbers = npt.NDArray[np.intp]


UNITS: dict[str, str] = {"force": "N", "acceleration": "m/s2", "velocity": "m/s", "displacement": "m"}


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

    MODES: ClassVar[str] = ""

    @property
    def modes(self) -> int:
        """How many are kept."""
        return len(self.frequencies_hz)

    def __post_init__(self) -> None:
        """Refuse frequencies that are none, and shapes of other numbers of modes."""
        for i, hz in enumerate(self.frequencies_hz):
            bounded(f"ModalBody: frequencies_hz[{i}]", hz, 0.0, strict=True)
            plausible(f"ModalBody: frequencies_hz[{i}]", hz, "frequencies_hz")
        n = len(self.frequencies_hz)
        rows = {"contact_shape": self.contact_shape, "excitation_shape": self.excitation_shape}
        rows |= {f"shapes[{i}]": row for i, row in enumerate(self.shapes)}
        for name, row in rows.items():
            if len(row) != n:
                raise ValueError(f"ModalBody: {name} has {len(row)} entries; must have {n}, one for each frequency")
            for i, entry in enumerate(row):
                bounded(f"ModalBody: {name}[{i}]", entry)
                plausible(f"ModalBody: {name}[{i}]", entry, "shape")
        for name in ("contact_shape", "excitation_shape"):
            if all(plain(entry) and entry == 0.0 for entry in rows[name]):
                raise ValueError(f"ModalBody: {name} is 0 in every mode; must not be, nothing moves there")

    def __str__(self) -> str:
        """Modes in a few words."""
        hz = sorted(self.frequencies_hz)
        return f"{len(hz)} modes given, {hz[0]:.6g} to {hz[-1]:.6g} Hz"

    @property
    def fundamental(self) -> float | None:
        """Lowest natural frequency [rad/s]; None where a number is a symbol."""
        hz = self.frequencies_hz
        return float(2 * np.pi * min(hz)) if all(map(plain, hz)) else None


@dataclass(frozen=True)
class Damping:
    """Damping of the modes; see :func:`models.structure.modal_damping`.

    Attributes
    ----------
    mass_proportional : float
        alpha [1/s] (25).
    modal_ratios : tuple of float or None
        Ratios in place of alpha and the high-mode ratio; fractions of critical damping, 0.01 for 1 %.
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
        """Refuse damping that is negative or given twice, and one number in place of a sequence of ratios."""
        for name in ("mass_proportional", "stiffness_proportional", "high_mode_ratio"):
            bounded(f"Damping: {name}", getattr(self, name), 0.0)
            plausible(f"Damping: {name}", getattr(self, name), "damping_ratio" if name == "high_mode_ratio" else name)
        if self.modal_ratios is not None:
            if isinstance(self.modal_ratios, str) or not isinstance(self.modal_ratios, Iterable):
                accepted = "must be a sequence, of one ratio for all modes or one for each, such as (0.005,)"
                raise ValueError(f"Damping: modal_ratios = {self.modal_ratios!r}; {accepted}")
            object.__setattr__(self, "modal_ratios", tuple(self.modal_ratios))
            if not plain(self.mass_proportional) or self.mass_proportional != 0.0:
                raise ValueError("Damping: modal_ratios and mass_proportional are both given; must have one of them")
        for i, ratio in enumerate(self.modal_ratios or ()):
            bounded(f"Damping: modal_ratios[{i}]", ratio, 0.0)
            plausible(f"Damping: modal_ratios[{i}]", ratio, "damping_ratio")
        bounded("Damping: high_mode_from", self.high_mode_from, 1)

    @property
    def quantities(self) -> Iterator[tuple[str, str, Any]]:
        """Key of the rig file, quantity of :mod:`models.plausible`, value."""
        for name in ("mass_proportional", "stiffness_proportional"):
            yield f"damping.{name}", name, getattr(self, name)
        yield "damping.high_mode_ratio", "damping_ratio", self.high_mode_ratio
        for i, ratio in enumerate(self.modal_ratios or (), start=1):
            yield f"damping.modal_ratios[{i}]", "damping_ratio", ratio

    @property
    def key(self) -> str:
        """Its table in a rig file."""
        return "damping"

    @property
    def doubt(self) -> str | None:
        """Doubt, in words, about a damping of nothing but high modes: it is forgotten more often than it is meant."""
        if self.modal_ratios is not None or self.mass_proportional != 0.0 or self.stiffness_proportional != 0.0:
            return None
        if self.high_mode_ratio > 0.0 and self.high_mode_from == 1:
            return None
        accepted = "usual are modal_ratios, mass_proportional or stiffness_proportional"
        return f"damping is 0 in the lowest modes, only joints damp them; {accepted}"

    @property
    def proportional(self) -> tuple[float, float]:
        """Of every mode however high: alpha [1/s], where no ratio is in its place, and beta [s]."""
        by_ratio = self.modal_ratios is not None or self.high_mode_ratio > 0.0
        return 0.0 if by_ratio else self.mass_proportional, self.stiffness_proportional

    def dampers(self, omega_n: Array, numbers: Numbers) -> Dampers:
        """Damping of modes that count as modes `numbers` (n,) of the beam."""
        viscous = self._viscous(omega_n, numbers)
        # what is not alpha is a ratio, 2 zeta omega_n; rigid motion has no slope
        by_ratio = replace(self, mass_proportional=0.0)._viscous(omega_n, numbers)
        slope = np.divide(by_ratio, 2 * omega_n**2, out=np.zeros_like(by_ratio), where=omega_n > 0.0)
        return Dampers(viscous, slope, self.stiffness_proportional)

    def dampers_change(self, name: str, omega_n: Array, numbers: Numbers) -> Dampers:
        """Derivative of :meth:`dampers` to one of its fields, at held frequencies."""
        replaced = name == "mass_proportional" and self.modal_ratios is not None
        settings: list[dict[str, Any]] = [{}, {}] if replaced else [{name: 1.0}, {name: 2.0}]  # it is linear
        one, two = (replace(self, **setting).dampers(omega_n, numbers) for setting in settings)
        return Dampers(two.viscous - one.viscous, two.slope - one.slope, two.strain_rate - one.strain_rate)

    def on_modes(self, modes: int) -> "Damping":
        """The same of another number of modes: those beyond the ratios listed have that of the last."""
        ratios = self.modal_ratios
        if ratios is None or len(ratios) == 1:
            return self
        return replace(self, modal_ratios=(ratios + ratios[-1:] * modes)[:modes])

    def _viscous(self, omega_n: Array, numbers: Numbers) -> Array:
        return modal_damping(
            omega_n, self.mass_proportional, self.modal_ratios, self.high_mode_ratio, self.high_mode_from, numbers
        )


ALIKE = 1e-3
"""Levels are one that differ by less than this share."""


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
        Scale on R(t) - P as the friction sees it: 1 as in docs/theory/equations.md section 2, 0 for a constant load.
    residual_compliance, foreshortening : bool
        Keep C_res and the T G q coupling of docs/theory/equations.md section 2.
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
        for name in ("normal_load", "radius"):
            bounded(f"Contact: {name}", getattr(self, name), 0.0)
            plausible(f"Contact: {name}", getattr(self, name), name)
        check_parameters(self.law)


def alike(one: float, other: float) -> bool:
    """Whether two levels are one, written with fewer digits."""
    return isclose(one, other, rel_tol=ALIKE)


@dataclass(frozen=True)
class Excitation:
    """Shaker force: cosine of the fundamental, `amplitude` [N], at `position` [m] of a beam.

    Its distortion is given by `harmonics`: numbers k >= 2 with the coefficients of cos and sin k Omega t, relative to
    the amplitude of the fundamental. With `measured_harmonics` the harmonics of a simulated record are those that were
    measured of its force; and unless `settled`, its records were taken before the transient of a start had died out.
    `force_gain` pairs levels with the force per unit of what was measured in its place, such as the voltage of a
    shaker; it is 1 at levels that are not among them. The force channel of records reads `channel_gain` times the force
    at every level; None where it is not asked what it reads. Nothing but the diagnosis, which has records, minds these
    four. `at` is a place of a body that names its places.

    >>> round(float(Excitation(2.0, harmonics=((3, 0.0, 0.1),)).force(np.pi / 2)), 9)
    -0.2
    """

    amplitude: float
    position: float = 0.0
    harmonics: tuple[tuple[int, float, float], ...] = ()
    measured_harmonics: bool = False
    settled: bool = True
    at: str = ""
    force_gain: tuple[tuple[float, float], ...] = ()
    channel_gain: float | None = None

    def __post_init__(self) -> None:
        """Refuse a negative force, numbers of harmonics that are not, and levels that are given twice."""
        for name in ("amplitude", "position"):
            bounded(f"Excitation: {name}", getattr(self, name), 0.0)
            plausible(f"Excitation: {name}", getattr(self, name), name)
        numbers = [k for k, _, _ in self.harmonics]
        whole = all(isinstance(k, Integral) and k >= 2 for k in numbers)
        if not whole or len(set(numbers)) < len(numbers):
            raise ValueError(f"excitation.harmonics: numbers {numbers}; must be whole, 2 or more, each once")
        for i, (level, gain) in enumerate(self.force_gain, 1):
            bounded(f"Excitation: force_gain[{i}]", gain, 0.0, strict=True)
            if any(alike(level, other) for other, _ in self.force_gain[: i - 1]):
                raise ValueError(f"excitation.force_gain[{i}]: level {level:g}; must be there once")
        if self.channel_gain is not None:
            bounded("Excitation: channel_gain", self.channel_gain)
            if not self.channel_gain:
                raise ValueError("Excitation: channel_gain = 0; must be a number > 0, or < 0 for a wrong polarity")

    def gain(self, level: float) -> float:
        """Force per unit of what was measured in its place, at a level."""
        per_unit = next((gain for own, gain in self.force_gain if alike(own, level)), 1.0)
        return per_unit / (self.channel_gain or 1.0)

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
        Key of :meth:`models.numbers.Numbered.number`; or of a list, such as ``modal.frequencies_hz``, all of it.
    rate : float
        Per record.
    """

    parameter: str
    rate: float


@dataclass(frozen=True)
class Channel:
    """A quantity that is, or would be, measured.

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
    at : str
        Place, on a body that names its places.
    """

    name: str
    quantity: str
    position: float = 0.0
    gain: float = 1.0
    delay: float = 0.0
    repeatability: float = 0.0
    at: str = ""

    def __post_init__(self) -> None:
        """Refuse what nothing measures."""
        if self.quantity not in QUANTITIES:
            raise ValueError(f'Channel: quantity = "{self.quantity}"; must be one of {", ".join(QUANTITIES)}')
        bounded(f"Channel {self.name}: position", self.position, 0.0)
        bounded(f"Channel {self.name}: gain", self.gain)
        bounded(f"Channel {self.name}: delay", self.delay)
        bounded(f"Channel {self.name}: repeatability", self.repeatability, 0.0, 1.0)


MOST_LISTED = 9
"""Names in a message."""


def check_names(where: str, channels: Sequence[Channel], computed: Sequence[str]) -> None:
    """Refuse channels that could not be told from each other, or from what a simulation computes beside them.

    Raises
    ------
    ValueError
        With the name, and those that are taken; or if it is one channel.
    """
    several(f"{where}: channels", channels, Channel)
    names = [c.name for c in channels]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise ValueError(f'{where}: channel "{name}" is there twice; names must differ')
        if name in computed:
            taken = ", ".join(computed[:MOST_LISTED]) + ", ..." * (len(computed) > MOST_LISTED)
            raise ValueError(f'{where}: channels[{i + 1}].name = "{name}"; must not be one of the computed {taken}')
