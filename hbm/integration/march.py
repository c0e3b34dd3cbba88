"""A march: step after step from a state, with what is to be kept of it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hbm.integration.history import State, TimeHistory, differences, normal_reaction
from hbm.integration.timestep import Stepper
from models.structure import Array


def march(
    stepper: Stepper,
    start: State,
    steps: int,
    *,
    first: int = 0,
    every: int = 1,
    progress: Callable[[float], None] | None = None,
) -> TimeHistory:
    """Motion over so many steps from a state, kept from step `first` on, every so many; see :func:`simulate`."""
    recorder, x, period = Recorder(stepper, start, first, every), start.flat, stepper.steps_per_period
    for done in range(0, steps, period):
        X, T, residual = stepper.march(x, min(period, steps - done))
        recorder.add(X, T, residual)
        x = X[-1]
        if progress is not None:
            progress(start.time + (done + len(T)) * stepper.dt)
    return recorder.history()


class Recorder:
    """Collects the chunks of a march; keeps of them what was asked for."""

    def __init__(self, stepper: Stepper, start: State, first: int, every: int) -> None:
        self.stepper, self.start, self.first, self.every = stepper, start, first, every
        self.steps, self.residual = 0, 0.0
        self.lift_off: float | None = None
        self.state = start.flat
        self.friction = [np.array([start.friction])]
        self.kept: list[Array] = []
        self._keep(self.state[None], 0)

    def _keep(self, X: Array, at: int) -> None:
        steps = np.arange(at, at + len(X))
        wanted = (steps >= self.first) & ((steps - self.first) % self.every == 0)
        if wanted.any():
            self.kept.append(X[wanted, : 2 * self.stepper.rig.structure.n])

    def add(self, X: Array, T: Array, residual: float) -> None:
        """Take the states and friction forces of the next steps."""
        self._keep(X, self.steps + 1)
        self.friction.append(T)
        self.residual = max(self.residual, residual)
        if self.lift_off is None and not self.stepper.rig.contact.lift_off:
            self.lift_off = self._lift_off(X, T)
        self.steps += len(T)
        self.state = X[-1]

    def _lift_off(self, X: Array, T: Array) -> float | None:
        s, n = self.stepper, self.stepper.rig.structure.n
        time = self.start.time + s.dt * np.arange(self.steps + 1, self.steps + 1 + len(T))
        F = replace(s.rig.excitation, amplitude=s.level).force(2 * np.pi * s.hz * time)
        lifted = np.flatnonzero(normal_reaction(s.rig, X[:, :n], X[:, n : 2 * n], T, F) < 0.0)
        return float(time[lifted[0]]) if lifted.size else None

    def history(self) -> TimeHistory:
        """Samples that were kept."""
        s, n = self.stepper, self.stepper.rig.structure.n
        friction = np.concatenate(self.friction)
        rate, curvature = differences(friction, s.dt)
        motion = np.concatenate(self.kept)
        steps = np.arange(self.first, self.steps + 1, self.every)
        return TimeHistory(
            rig=s.rig,
            hz=s.hz,
            level=s.level,
            time=np.asarray(self.start.time + s.dt * steps, dtype=float),
            q=motion[:, :n],
            qdot=motion[:, n:],
            friction=friction[steps],
            friction_rate=rate[steps],
            friction_curvature=curvature[steps],
            samples_per_period=s.steps_per_period // self.every,
            state=State.from_flat(self.state, n, self.start.time + s.dt * self.steps),
            lift_off=self.lift_off,
            largest_residual=self.residual,
        )
