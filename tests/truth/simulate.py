"""Periodic steady states of the true rig: a slow ramp of the force from rest, then shooting, all records at once."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from tests.truth.march import Batch, Instant, State, pairs
from tests.truth.rig import TrueRig
from tests.truth.shooting import Settings, Shooting

Array = np.ndarray
CLOSE_ENOUGH = 1e-3  # of the coarse steps: so far off is their answer in the fine ones anyway


@dataclass(frozen=True)
class Record:
    """One steady state: force `amplitude` cos(Omega t - phase), level its nominal amplitude [N]."""

    level: float
    hz: float
    phase: float = 0.0
    amplitude: float | None = None

    @property
    def force(self) -> float:
        return self.level if self.amplitude is None else self.amplitude


@dataclass(frozen=True)
class Truth:
    """Steady states over one period at N samples, time origin that of the force; (records, N) unless stated.

    acceleration (records, sensors, N) as each sensor reads it but for gain and delay; v is du/dt; `energy` the balance
    of a period's work relative to the work of the force (or of the dissipation, where that is larger); `rigs` those
    that the records were simulated with.
    """

    rig: TrueRig
    records: tuple[Record, ...]
    steps: int
    converged: Array
    stable: Array
    multiplier: Array
    residual: Array
    min_R: Array
    energy: Array
    force: Array
    acceleration: Array
    T: Array
    R: Array
    u: Array
    v: Array
    state: State
    rigs: Array

    @property
    def lifted(self) -> Array:
        """Records in which the tip would lift off."""
        return self.min_R <= 0.0

    @property
    def usable(self) -> Array:
        """Converged, stable, in contact."""
        return self.converged & self.stable & ~self.lifted

    def where(self, keep: Array) -> "Truth":
        """Some of the records."""
        picked = {
            f.name: getattr(self, f.name)[keep] for f in fields(self) if isinstance(getattr(self, f.name), np.ndarray)
        }
        records = tuple(r for r, k in zip(self.records, keep, strict=True) if k)
        return replace(self, records=records, state=self.state.map(lambda a: a[keep]), **picked)


def scattered(records: Sequence[tuple[float, float]], rng: np.random.Generator, scatter: float = 0.02) -> list[Record]:
    """Records (level, hz) whose force misses its level by `scatter`, at any phase."""
    return [
        Record(level, hz, rng.uniform(0, 2 * np.pi), level * (1 + scatter * rng.standard_normal()))
        for level, hz in records
    ]


def force_over(rig: TrueRig, records: Sequence[Record], steps: int) -> Array:
    """Force at the instants of a period, both ends included (records, steps + 1)."""
    theta = 2 * np.pi * np.arange(steps + 1) / steps
    rows = []
    for r in records:
        tones = sum(t.ratio * np.cos(t.harmonic * (theta - r.phase) - t.phase) for t in rig.distortion)
        rows.append(r.force * (np.cos(theta - r.phase) + tones))
    return np.array(rows)


def batch_of(
    rigs: Sequence[TrueRig],
    records: Sequence[Record],
    steps: int,
    tolerance: float = 1e-12,
    reduced: dict[str, Array] | None = None,
) -> Batch:
    """Records ready to march."""
    omega = 2 * np.pi * np.array([r.hz for r in records])
    lag = np.array([r.phase for r in records]) / (2 * np.pi)
    return Batch(rigs, omega, lag, steps, tolerance, reduced)


def ramp(batch: Batch, force: Array, start: State, periods: int, hold: int) -> tuple[State, State]:
    """March under a force that grows to its full size; the state, and the largest size of each part in the end."""
    now, N = batch.begin(start, 0 * force[:, :1]), batch.steps
    largest = start.map(np.abs)
    for k in range(periods + hold):
        for i in range(1, N + 1):
            grown = min(1.0, (k + i / N) / max(periods, 1))
            now = batch.advance(now, np.sin(np.pi / 2 * grown) ** 2 * force[:, i : i + 1], i / N)
            if k == periods + hold - 1:
                pairs = [(getattr(largest, f.name), getattr(now.state, f.name)) for f in fields(State)]
                largest = State(*(np.maximum(a, np.abs(b)) for a, b in pairs))
    return now.state, largest


def simulate_records(
    rig: TrueRig | Sequence[TrueRig],
    records: Sequence[Record | tuple[float, ...]],
    steps: int = 1024,
    settings: Settings | None = None,
) -> Truth:
    """Steady states of the rig under each record: (level, hz[, phase[, amplitude]]).

    A sequence of rigs, one per record, is for properties that drift: the rigs may differ in numbers only, and in those
    of nonlinear effects, of sensors' faults and of the force's distortion not at all: the first rig's count.
    """
    settings = settings or Settings()
    rigs = [rig] if isinstance(rig, TrueRig) else list(rig)
    asked = tuple(r if isinstance(r, Record) else Record(*r) for r in records)
    coarse = batch_of(rigs, asked, settings.coarse)
    fine = batch_of(rigs, asked, steps, reduced=coarse.m)
    rough, exact = force_over(rigs[0], asked, settings.coarse), force_over(rigs[0], asked, steps)
    rising = batch_of(rigs, asked, settings.coarse // 2, 1e-6, coarse.m)
    growing = force_over(rigs[0], asked, settings.coarse // 2)
    state, size = ramp(rising, growing, rising.rest_state(), settings.ramp, settings.hold)
    first = Shooting(coarse, rough, size, replace(settings, tolerance=CLOSE_ENOUGH))
    everyone = todo = np.ones(len(asked), bool)
    for _ in range(settings.retries + 1):
        found, residual = first.solve(state, todo)
        todo = todo & (residual > CLOSE_ENOUGH)
        if not todo.any():
            state = found
            break
        before = state.map(lambda a, those=todo: a[those])
        marched, _ = ramp(coarse.select(todo), rough[todo], before, 0, settings.again)
        for ours, other in pairs(found, marched):
            ours[todo] = other
        state, first.jacobian[todo] = found, np.nan
    last = Shooting(fine, exact, size, settings)
    state, residual = last.solve(state, everyone, last.widened(first) if settings.chord else None)
    multiplier = last.multipliers(state, residual)
    return observe(fine, asked, state, exact, residual, multiplier, settings)


def observe(
    batch: Batch,
    records: tuple[Record, ...],
    state: State,
    force: Array,
    residual: Array,
    multiplier: Array,
    settings: Settings,
) -> Truth:
    """One period of the steady states, sample by sample."""
    seen = period_from(batch, batch.begin(state, force[:, :1]), force)
    seen = seen[-1:] + seen[:-1]  # the end of the period is its beginning
    over = {name: np.array([getattr(s, name)[:, 0] for s in seen]).swapaxes(0, 1) for name in ("T", "R", "u")}
    rest_rate = derivative(np.array([s.rest[:, 0] for s in seen]).T, batch.omega)
    v = np.array([s.v_slip[:, 0] for s in seen]).T + rest_rate
    return Truth(
        rig=batch.rig,
        records=records,
        steps=batch.steps,
        converged=residual <= settings.tolerance,
        stable=multiplier <= 1.0 + settings.growth,
        multiplier=multiplier,
        residual=residual,
        min_R=over["R"].min(axis=1),
        energy=energy_balance(batch, seen, force[:, :-1]),
        force=force[:, :-1],
        acceleration=accelerations(batch, seen),
        v=v,
        state=state,
        rigs=np.array([*batch.rigs] * (len(records) // len(batch.rigs)), dtype=object),
        **over,
    )


def period_from(batch: Batch, now: Instant, force: Array) -> list[Instant]:
    """The instants of the period after one."""
    seen = []
    for i in range(1, batch.steps + 1):
        now = batch.advance(now, force[:, i : i + 1], i / batch.steps)
        seen.append(now)
    return seen


def accelerations(batch: Batch, seen: Sequence[Instant]) -> Array:
    """What the sensors feel over a period (records, sensors, N)."""
    sensors = np.broadcast_to(batch.m["sensors"], (len(batch.omega), *batch.m["sensors"].shape[1:]))
    still = np.where(batch.dynamic, 0.0, np.array([s.state.q[:, 0] for s in seen]))
    moving = np.array([batch.acceleration(s)[:, 0] for s in seen])
    felt = np.einsum("nri,rsi->rsn", moving, sensors)
    return felt + second_derivative(np.einsum("nri,rsi->rsn", still, sensors), batch.omega)


def taken_early(truth: Truth, share: float, wait: int, periods: int) -> Truth:
    """Records whose force grew by a share of its size so many periods before; accelerations are means over `periods`.

    What lasts of the transient is in these: the harmonics of a record of whole periods are those of its mean period.
    """
    one = all(rig is truth.rigs[0] for rig in truth.rigs)
    batch = batch_of([truth.rig] if one else list(truth.rigs), truth.records, truth.steps)
    force = force_over(truth.rig, truth.records, truth.steps)
    now, mean = batch.begin(truth.state.map(lambda a: (1.0 - share) * a), force[:, :1]), 0.0
    for period in range(wait + periods):
        before, seen = now, period_from(batch, now, force)
        now = seen[-1]
        if period >= wait:
            mean = mean + accelerations(batch, [before, *seen[:-1]]) / periods
    return replace(truth, acceleration=mean)


def derivative(x: Array, omega: Array) -> Array:
    """Central difference of periodic samples along the last axis."""
    dt = 2 * np.pi / omega / x.shape[-1]
    return (np.roll(x, -1, -1) - np.roll(x, 1, -1)) / (2 * dt[:, None])


def second_derivative(x: Array, omega: Array, harmonics: int = 40) -> Array:
    """Spectral second derivative of what follows the forces statically, to a finite harmonic."""
    N = x.shape[-1]
    k = np.arange(N // 2 + 1)
    keep = np.where(k <= harmonics, -(k**2.0), 0.0)
    return np.fft.irfft(np.fft.rfft(x) * keep, n=N) * omega[:, None, None] ** 2


def energy_balance(batch: Batch, seen: list[Instant], force: Array) -> Array:
    """Work of the force less what damping, friction and hidden effects take, relative to the larger side."""
    q, v = (np.array([getattr(s.state, name)[:, 0] for s in seen]) for name in ("q", "v"))
    T, u = np.array([s.T[:, 0] for s in seen]), np.array([s.u[:, 0] for s in seen])
    y = np.einsum("nri,ri->nr", q, batch.m["drive"] * np.ones((q.shape[1], 1)))

    def work(load: Array, motion: Array) -> Array:
        return ((load + np.roll(load, -1, 0)) / 2 * (np.roll(motion, -1, 0) - motion)).sum(axis=0)

    given = work(force.T, y)
    lost = (batch.m["damping"] * np.where(batch.dynamic, v, 0.0) ** 2).sum(axis=2).sum(axis=0) * batch.dt[:, 0]
    known = force.T[..., None] * batch.m["drive"] + T[..., None] * batch.m["contact"]
    p, Gq = np.array([s.p[:, 0] for s in seen]), (q.swapaxes(0, 1) @ batch.m["G"]).swapaxes(0, 1)
    hidden = (p - known + T[..., None] * Gq) if batch.hidden else 0.0 * p
    taken = -work(hidden, q).sum(axis=1) if batch.hidden else 0.0
    rubbed = -work(T, u)
    scale = np.maximum(np.abs(given), np.abs(lost) + np.abs(rubbed) + np.abs(taken))
    return (given - lost - rubbed - taken) / scale
