"""Placement of sensors that leaves the friction force least uncertain."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from hbm.channels import DERIVATIVES
from hbm.errors import InputError, expect_rig
from hbm.fourier import Array
from hbm.inverse.sensing import MOST_MODES, STATIC_FROM, UNKNOWN_FORCE, Complex, dynamic_stiffness
from models.parts import UNITS, Channel
from models.rig import Rig, beam_of

Indices = npt.NDArray[np.intp]

STARTS = 8
"""Layouts from which exchanges start: the greedy one, and others drawn at random."""

ORDER = 2.0
"""Friction is expected to fall with the harmonic k like k^-2, as a force with corners does."""

FREQUENCIES = 25
"""Frequencies of the range over which the variance is averaged."""


@dataclass(frozen=True, eq=False)
class Placement:
    """Positions for sensors, and the friction that is to be expected of them beside the rig's present ones.

    Attributes
    ----------
    positions : (c,) array
        Along the beam, ascending [m].
    std : float
        Expected standard deviation of friction at any instant, rms over the frequencies [N].
    by_harmonic : (H,) array
        Standard deviation of each cosine and sine of friction [N].
    condition : (H,) array
        Condition number of telling friction from the excitation by the sensors alone, median over the frequencies.
    noise : float
        Standard deviation of each cosine and sine of a sensor that was assumed, in `unit`.
    unit : str
    hz : (float, float)
    before : Placement or None
        The same of the rig's present sensors.
    """

    positions: Array
    std: float
    by_harmonic: Array
    condition: Array
    noise: float
    unit: str
    hz: tuple[float, float]
    before: "Placement | None" = None

    @property
    def gain(self) -> float:
        """How many times less uncertain friction is than by the present sensors; nan where there are none."""
        return self.before.std / self.std if self.before else float("nan")

    def rig(self, rig: Rig) -> Rig:
        """The rig with sensors at these positions in place of its own; the force channel stays."""
        kept = tuple(c for c in rig.channels if c.quantity == "force")
        quantity = next(name for name, unit in UNITS.items() if unit == self.unit)
        placed = (Channel(f"a{i}", quantity, float(x)) for i, x in enumerate(self.positions, 1))
        return replace(rig, channels=kept + tuple(placed))

    def __repr__(self) -> str:
        per_noise = f"for {self.noise:g} {self.unit} per sensor, {self.hz[0]:g} to {self.hz[1]:g} Hz"
        lines = [
            f"sensors at {_listed(1e3 * self.positions, '.0f')} mm: friction to {self.std:.2g} N rms, {per_noise}",
            f"  harmonics 1..{len(self.by_harmonic)} to {_listed(self.by_harmonic, '.2g')} N; "
            f"condition {_listed(self.condition, '.2g')}",
        ]
        if self.before:
            lines += [
                f"present sensors at {_listed(1e3 * self.before.positions, '.0f')} mm: {self.before.std:.2g} N rms",
                f"  harmonics 1..{len(self.by_harmonic)} to {_listed(self.before.by_harmonic, '.2g')} N; "
                f"condition {_listed(self.before.condition, '.2g')}",
                f"gain: {self.gain:.2f} times less uncertain",
            ]
        return "\n".join(lines)


def place_sensors(
    rig: Rig,
    *,
    count: int = 6,
    hz: tuple[float, float],
    harmonics: int = 9,
    noise: float = 0.05,
    quantity: str = "acceleration",
    force_noise: float | None = 1e-3,
    spacing: float = 0.02,
    step: float = 0.005,
    tip: float = 0.02,
) -> Placement:
    """Positions of sensors at which the friction force is expected to be known best.

    Parameters
    ----------
    rig : Rig
        With a beam; its friction law is not used.
    count : int
        How many sensors.
    hz : (float, float)
        Range of excitation frequencies.
    harmonics : int
        Harmonics measured.
    noise : float
        Standard deviation of each cosine and sine, equal for all sensors.
    quantity : str
        Quantity that they measure.
    force_noise : float or None
        The same of the force [N]; None where the force is not measured.
    spacing : float
        Least distance between two sensors [m].
    step : float
        Distance of the candidate positions [m].
    tip : float
        Length at the clamp and at the tip where no sensor can be mounted [m].

    Returns
    -------
    Placement

    Raises
    ------
    InputError
        If the rig has no beam, or so many sensors do not fit.
    """
    expect_rig(rig, "place_sensors")
    if rig.beam is None:
        raise InputError(f"{rig.name}: positions of sensors need a [beam]; this rig is given by its modes")
    if quantity not in DERIVATIVES:
        raise InputError(f'place_sensors: quantity = "{quantity}"; must be one of {", ".join(DERIVATIVES)}')
    length = rig.beam.length
    fit = int((length - 2 * tip) / spacing + 1e-9) + 1 if length > 2 * tip else 0
    if not 1 <= count <= fit:
        raise InputError(
            f"place_sensors: count = {count}; must be 1 to {fit}: {1e3 * length:g} mm of beam, "
            f"{1e3 * tip:g} mm left free at each end, {1e3 * spacing:g} mm apart"
        )
    expected = _Expected(rig, hz, harmonics, noise, quantity, force_noise)
    grid = np.linspace(tip, length - tip, round((length - 2 * tip) / step) + 1)
    information = expected.information(grid)
    present = np.array([c.position for c in rig.response_channels if c.quantity == quantity])
    before = expected.placement(present) if len(present) else None
    return replace(expected.placement(grid[_best(expected, information, grid, count, spacing)]), before=before)


@dataclass(frozen=True, eq=False)
class _Expected:
    """Expected signals and noise of sensors: frequencies f of the range, harmonics 1..H."""

    rig: Rig
    hz: tuple[float, float]
    H: int
    noise: float
    quantity: str
    force_noise: float | None

    @property
    def _i_omega(self) -> Complex:
        fundamental = 2j * np.pi * np.linspace(*self.hz, FREQUENCIES)
        return np.asarray(fundamental[:, None] * np.arange(1, self.H + 1))

    def rows(self, positions: Array) -> Complex:
        """Readings per friction and per force in units of the noise, (f, H, c, 2)."""
        body = beam_of(self.rig)
        dynamic = (
            replace(body, modes=MOST_MODES).natural_frequencies() < STATIC_FROM * 2 * np.pi * max(self.hz) * self.H
        )
        tried = tuple(Channel(f"x{i}", self.quantity, float(x)) for i, x in enumerate(positions))
        s = replace(self.rig, channels=tried).with_modes(max(body.modes, int(dynamic.sum()))).structure
        i_omega = self._i_omega
        shapes = np.array([s.channel_rows[c.name] for c in tried]).reshape(len(tried), s.n)
        static = np.array([s.residual.channels.get(c.name, (0.0, 0.0)) for c in tried]).reshape(len(tried), 2)
        mobile = 1.0 / dynamic_stiffness(s, i_omega)
        by = [(push * mobile) @ shapes.T + static[:, i] for i, push in ((1, s.slip_row), (0, s.excitation))]
        return np.asarray(np.stack(by, axis=3) * i_omega[..., None, None] ** DERIVATIVES[self.quantity] / self.noise)

    def information(self, positions: Array) -> Complex:
        """Information on (friction, force) of each position, (c, f, H, 2, 2)."""
        rows = self.rows(positions)
        return np.asarray(np.einsum("fkci,fkcj->cfkij", rows.conj(), rows))

    @property
    def known(self) -> Complex:
        """Information before any sensor: the expected friction, and the force as it is measured, (H, 2, 2)."""
        k = np.arange(1, self.H + 1)
        friction = self.rig.contact.normal_load * k**-ORDER
        unmeasured = np.where(k == 1, UNKNOWN_FORCE * self.rig.excitation.amplitude, 1e-6)
        force = np.full(self.H, self.force_noise) if self.force_noise is not None else unmeasured
        both = np.stack([friction**-2.0, force**-2.0], axis=1)
        return np.asarray(both[:, :, None] * np.eye(2), dtype=complex)

    def variance(self, information: Complex) -> Array:
        """Variance of each cosine and sine of friction (..., f, H) [N2], the force marginalised."""
        J = information + self.known
        return np.asarray(1.0 / (J[..., 0, 0].real - np.abs(J[..., 0, 1]) ** 2 / J[..., 1, 1].real))

    def placement(self, positions: Array) -> Placement:
        """Information that sensors at these positions are expected to give."""
        positions = np.sort(positions)
        information = self.information(positions).sum(axis=0)
        variance = self.variance(information)
        own = information + self.known * np.diag([0.0, 1.0])  # sensors and force alone
        scale = 1.0 / np.sqrt(np.einsum("...ii->...i", own).real)
        condition = np.sqrt(np.linalg.cond(scale[..., :, None] * scale[..., None, :] * own))
        return Placement(
            positions=positions,
            std=float(np.sqrt(variance.sum(axis=1).mean())),
            by_harmonic=np.sqrt(variance.mean(axis=0)),
            condition=np.median(condition, axis=0),
            noise=self.noise,
            unit=UNITS[self.quantity],
            hz=self.hz,
        )


def _best(expected: _Expected, information: Complex, grid: Array, count: int, spacing: float) -> Indices:
    """Places in the grid: greedy and random starts, then exchanges of one sensor until none is better."""
    rng = np.random.default_rng(0)
    best, least = np.empty(0, dtype=np.intp), np.inf
    for start in range(STARTS):
        chosen = list[int]()
        for _ in range(count):
            allowed = _allowed(grid, chosen, spacing, count - len(chosen))
            cost = _cost(expected, information, chosen, allowed)
            chosen.append(int(allowed[cost.argmin()] if start == 0 else rng.choice(allowed)))
        cost_now, improved = np.inf, True
        while improved:
            improved = False
            for i in range(count):
                rest = chosen[:i] + chosen[i + 1 :]
                allowed = _allowed(grid, rest, spacing, 1)
                cost = _cost(expected, information, rest, allowed)
                if cost.min() < cost_now * (1.0 - 1e-9):
                    cost_now, improved = float(cost.min()), True
                    chosen[i] = int(allowed[cost.argmin()])
        if cost_now < least:
            best, least = np.array(chosen, dtype=np.intp), cost_now
    return best


def _cost(expected: _Expected, information: Complex, chosen: list[int], candidates: Indices) -> Array:
    """Variance of friction with each candidate beside the sensors chosen, mean over the frequencies."""
    return np.asarray(
        expected.variance(information[chosen].sum(axis=0) + information[candidates]).sum(axis=2).mean(axis=1)
    )


def _allowed(grid: Array, chosen: list[int], spacing: float, missing: int) -> Indices:
    """Places far enough from those chosen to leave room for all sensors that are still to be placed."""
    free = np.all(np.abs(grid[:, None] - grid[chosen]) > spacing - 1e-9, axis=1)
    places = np.flatnonzero(free)
    if missing == 1:
        return places
    fits = [i for i in places if _room(grid, [*chosen, int(i)], spacing) >= missing - 1]
    return np.array(fits, dtype=np.intp)


def _room(grid: Array, chosen: list[int], spacing: float) -> int:
    """How many more fit beside those chosen."""
    room, last = 0, -np.inf
    for x in grid[np.all(np.abs(grid[:, None] - grid[chosen]) > spacing - 1e-9, axis=1)]:
        if x - last > spacing - 1e-9:
            room, last = room + 1, x
    return room


def _listed(values: Array, form: str) -> str:
    return ", ".join(f"{v:{form}}" for v in values)
