"""Shooting: Newton on the map of a period of the true rig, all records at once."""

from dataclasses import dataclass, replace

import numpy as np

from tests.truth.march import Batch, State, pairs

Array = np.ndarray
NEAR = 1e-4  # residual at which a derivative says how stable the solution is
PATIENCE = 6  # evaluations without progress after which a record is given up


@dataclass(frozen=True)
class Settings:
    """How a steady state is found. Newton is given the slow modes; the others forget within a period."""

    ramp: int = 40
    hold: int = 10
    coarse: int = 256
    slow_modes: int = 10
    perturbation: float = 1e-6
    tolerance: float = 1e-9
    iterations: int = 12
    retries: int = 2
    again: int = 60  # periods marched on where Newton failed
    chord: bool = False  # the derivatives of the coarse steps serve the fine ones too, for as long as they converge
    growth: float = 1e-5  # of a Floquet multiplier over one that is still called stable (a stuck contact has one at 1)


@dataclass
class Progress:
    """The best states so far, what they leave to close, the step taken from them and the share of it."""

    state: State
    residual: Array
    step: Array
    damping: Array


@dataclass
class Shooting:
    """Newton on the map of a period, for the records that still need it."""

    batch: Batch
    force: Array
    size: State
    settings: Settings

    def __post_init__(self) -> None:
        self.K = int(min(self.settings.slow_modes, self.batch.dynamic.sum(axis=1).min()))
        # in units of the largest modal energy a period of a conserving system turns its state and stretches nothing
        omega = np.sqrt(np.where(self.batch.dynamic, self.batch.m["omega2"], np.inf))[:, None]
        speed = np.maximum(np.where(np.isfinite(omega), omega * self.size.q, 0.0), self.size.v).max(-1, keepdims=True)
        size = replace(self.size, q=speed / np.where(np.isfinite(omega), omega, 1.0), v=speed + 0 * self.size.v)
        self.floor = size.map(lambda a: np.maximum(a, 1e-3 * a.max(axis=0, keepdims=True) + 1e-30))
        self.unit = self._slow(self.floor)[:, 0]
        self.jacobian = np.full((len(self.unit), self.unit.shape[1], self.unit.shape[1]), np.nan)

    def _slow(self, s: State) -> Array:
        return np.concatenate([s.q[..., : self.K], s.v[..., : self.K], s.law, s.hidden], axis=-1)

    def _with(self, s: State, slow: Array, records: Array | int = 0) -> State:
        """Copies of a state with their slow parts replaced; the fast modes follow the friction force statically."""
        copies = s.map(lambda a: np.repeat(a[:, :1], slow.shape[1], axis=1).copy())
        K, L = self.K, s.law.shape[-1]
        copies.q[..., :K], copies.v[..., :K] = slow[..., :K], slow[..., K : 2 * K]
        copies.law[...], copies.hidden[...] = slow[..., 2 * K : 2 * K + L], slow[..., 2 * K + L :]
        law, m = self.batch.law, self.batch.m
        soft = (m["contact"] / m["omega2"])[:, None, K:]
        more = law.force(copies.law) - law.force(s.law[:, :1])
        copies.q[..., K:] += more[..., None] * (soft if len(soft) == 1 else soft[records])
        return copies

    def after_period(self, state: State, todo: Array, derivative: bool) -> tuple[State, Array, Array, Array]:
        """State after a period, the largest gap to its beginning, the gap and derivative of the slow part, in units."""
        batch = self.batch if todo.all() else self.batch.select(todo)
        start, unit = state.map(lambda a: a[todo]), self.unit[todo]
        slow, eps = self._slow(start), self.settings.perturbation
        width = slow.shape[-1]
        shifts = np.concatenate([np.zeros((1, width)), eps * np.eye(width)])[: None if derivative else 1]
        with np.errstate(over="ignore", invalid="ignore"):  # what runs away is told by its gap, and tried again nearer
            after = batch.period(self._with(start, slow + shifts * unit[:, None], todo), self.force[todo])
            mapped = self._slow(after) / unit[:, None]
            end = after.map(lambda a: a[:, :1])
            gaps = State(*(e - s for e, s in pairs(end, start)))
        moving = batch.dynamic[:, None]
        gaps = replace(gaps, q=np.where(moving, gaps.q, 0.0), v=np.where(moving, gaps.v, 0.0))
        floor = self.floor.map(lambda a: a[todo])
        worst = np.max([np.abs(g / f).max(axis=(1, 2)) for g, f in pairs(gaps, floor) if g.size], axis=0)
        return end, worst, mapped[:, 0] - slow[:, 0] / unit, ((mapped[:, 1:] - mapped[:, :1]) / eps).swapaxes(1, 2)

    def widened(self, coarse: "Shooting") -> Array:
        """Derivatives of coarser steps, which have fewer slow modes: to begin with, the others move freely."""
        (records, width), K, less = self.unit.shape, self.K, coarse.K
        free = np.moveaxis(self.batch.kept[0][:, :, 0], 0, -1), np.moveaxis(self.batch.kept[1][:, :, 0], 0, -1)
        period = np.linalg.matrix_power(np.stack(free, axis=-1), self.batch.steps)  # (records, n, q and v, q and v)
        known, place = np.zeros((records, width, width)), np.arange(2 * K).reshape(2, K)
        for i, j in np.ndindex(2, 2):
            known[:, place[i], place[j]] = period[:, :K, i, j] * self.unit[:, place[j]] / self.unit[:, place[i]]
        same = np.concatenate([place[:, :less].ravel(), np.arange(2 * K, width)])
        known[:, same[:, None], same] = coarse.jacobian
        return known

    def solve(self, state: State, todo: Array, known: Array | None = None) -> tuple[State, Array]:
        """State and residual of each record, those to do solved for; `known` derivatives to begin with, or NaN.

        A derivative serves for as long as it brings the residual down fivefold; the last is taken near the solution.
        """
        records, width = len(self.batch.omega), self.unit.shape[1]
        last = Progress(state.map(np.copy), np.full(records, np.inf), np.zeros((records, width)), np.ones(records))
        trial, best, idle = state.map(np.copy), np.full(records, np.inf), np.zeros(records, int)
        if known is not None:
            self.jacobian = known
        jacobian = self.jacobian
        self.taken_at, renew = np.full(records, np.inf), np.isnan(jacobian).any(axis=(1, 2))
        for _ in range(self.settings.iterations):
            for derivative in (True, False):
                now = todo & (renew == derivative)
                if not now.any():
                    continue
                end, worst, gap, J = self.after_period(trial, now, derivative)
                for i, r in enumerate(np.flatnonzero(now)):
                    runs_away = not np.isfinite([worst[i], *gap[i], *J[i].flat]).all()
                    if derivative and not runs_away:
                        jacobian[r], self.taken_at[r] = J[i], worst[i]
                    slow = worst[i] > 0.2 * last.residual[r]
                    renew[r] = not derivative and (slow or (self.taken_at[r] > NEAR and worst[i] < 10 * NEAR))
                    if worst[i] > last.residual[r] and np.isinf(self.taken_at[r]):  # that of coarser steps led astray
                        self._put(trial, r, last.state, r)
                        best[r] = np.inf
                        continue
                    too_long = runs_away or worst[i] > 4 * last.residual[r]
                    if too_long and last.damping[r] > 0.05:  # halve the step
                        last.damping[r] /= 2
                        self._put(trial, r, last.state, r, last.damping[r] * last.step[r])
                        renew[r] = True
                        continue
                    if runs_away:
                        continue
                    idle[r] = idle[r] + 1 if worst[i] > 0.7 * best[r] else 0
                    best[r] = min(best[r], worst[i])
                    last.residual[r] = worst[i]  # full steps may go back and forth across a corner for ever
                    last.damping[r] = 0.5 if idle[r] % 2 else min(1.0, 2 * last.damping[r])
                    last.step[r] = np.linalg.lstsq(np.eye(width) - jacobian[r], gap[i], rcond=5e-5)[0]
                    self._put(last.state, r, trial, r)
                    self._put(trial, r, end, i)  # the fast modes take the place they have after a period
                    moved = self._slow(last.state)[r] + last.damping[r] * last.step[r] * self.unit[r]
                    self._put(trial, r, self._with(trial.map(lambda a, r=r: a[r : r + 1]), moved[None], [r]), 0)
            todo = todo & (last.residual > self.settings.tolerance) & (idle < PATIENCE)
            if not todo.any():
                break
        return last.state, last.residual

    def multipliers(self, state: State, residual: Array) -> Array:
        """Largest Floquet multiplier of each record, of a derivative taken near the solution."""
        stale = (self.taken_at > NEAR) & (residual <= self.settings.tolerance)
        if stale.any():
            self.jacobian[stale] = self.after_period(state, stale, True)[3]
        return np.abs(np.linalg.eigvals(np.nan_to_num(self.jacobian))).max(axis=1)

    def _put(self, into: State, r: int, source: State, i: int, step: Array | None = None) -> None:
        """Copy record i of source to record r, its slow part moved by step."""
        one = source.map(lambda a: a[i : i + 1])
        if step is not None:
            one = self._with(one, self._slow(one) + step * self.unit[r], [r])
        for a, b in pairs(into, one):
            a[r] = b[0]
