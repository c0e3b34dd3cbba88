"""Marching a friction law by itself, and the motions to march it along."""

from collections.abc import Callable

import casadi as ca
import numpy as np
from scipy.optimize import brentq

from models.friction import ContactSample, FrictionLaw

P = 83.0
SAMPLE = ("u", "v", "rho", "eta", "T")


def one_sample(law: FrictionLaw) -> tuple[ca.Function, bool]:
    """Function (T, z, before (5,), now (4,), (C, dt)) -> (force, new z); and whether the force depends on T."""
    T, z, before, now = ca.SX.sym("T"), ca.SX.sym("z", law.states), ca.SX.sym("before", 5), ca.SX.sym("now", 4)
    C, dt = ca.SX.sym("C"), ca.SX.sym("dt")
    u, v, rho, eta, T_before = ca.vertsplit(before)
    z_new, force = law.advance(
        z, ContactSample(u, v, rho, eta, C, P, dt, T_before), ContactSample(*ca.vertsplit(now), C, P, dt, T)
    )
    force = ca.SX(force)
    outputs = [ca.densify(force), ca.densify(ca.SX(z_new))]
    function = ca.Function("sample", [T, z, before, now, ca.vertcat(C, dt)], outputs)
    return function, bool(ca.jacobian(force, T).nnz())


def closed(law: Callable[[float], float], guess: float) -> float:
    """T = law(T) by bracketing: law(T) - T falls from +infinity to -infinity."""
    reach = 1.0
    while not law(guess - reach) - (guess - reach) > 0.0 > law(guess + reach) - (guess + reach):
        reach *= 4.0
        if reach > 1e12:
            raise ArithmeticError("T = law(T) has no bracket")
    return float(brentq(lambda T: law(T) - T, guess - reach, guess + reach, xtol=1e-14, rtol=1e-15, maxiter=300))


def march(law, u, v, *, R=P, eta=0.0, C=5e-9, dt=1e-4, z0=None, before=None):
    """Force (N,) and states (states, N) along a history from rest; R, the reaction at T = 0, and eta may vary.

    `before` holds what differs from rest, under the first reaction, at the instant before the first sample.
    """
    function, implicit = one_sample(law)
    inputs = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
    outputs = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
    buffer, evaluate = function.buffer()  # a tenth of the time of an ordinary call
    for i, array in enumerate(inputs):
        buffer.set_arg(i, array.data)
    for i, array in enumerate(outputs):
        buffer.set_res(i, array.data)

    def force(T: float) -> float:
        inputs[0][0] = T
        evaluate()
        return float(outputs[0][0])

    rows = np.vstack(np.broadcast_arrays(u, v, R, eta)).T
    start = {"u": 0.0, "v": 0.0, "rho": rows[0, 2], "eta": rows[0, 3], "T": 0.0} | (before or {})
    _, z, earlier, now, constants = inputs
    earlier[:], constants[:] = [start[name] for name in SAMPLE], [C, dt]
    if z0 is not None:
        z[:] = z0
    forces, states = [], []
    for row in rows:
        now[:] = row
        T = closed(force, earlier[4]) if implicit else force(0.0)
        force(T)
        z[:] = outputs[1]
        earlier[:] = *row, T
        forces.append(T)
        states.append(outputs[1].copy())
    return np.array(forces), np.array(states).T


def history(seed: int, n: int = 400, scale: float = 4e-5):
    """Random walk of the slip with its velocity, and a reaction that swings between 0.2 and 1.8 P."""
    rng = np.random.default_rng(seed)
    u = scale * np.cumsum(rng.standard_normal(n)) / 10
    R = P * (1.0 + 0.8 * np.sin(np.cumsum(0.3 * rng.random(n))))
    return u, np.gradient(u, 1e-4), R


def cycle(seed: int, n: int = 512, scale: float = 2e-5, omega: float = 300.0):
    """One period of a random smooth motion of five harmonics, its velocity, a reaction within 0.2..1.8 P, and dt."""
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * np.arange(1, n + 1) / n
    k = np.arange(1, 6)
    amplitudes = rng.standard_normal(5) / k
    shift = 2 * np.pi * rng.random(5)
    u = scale * np.cos(np.outer(phase, k) + shift) @ amplitudes
    v = -scale * omega * np.sin(np.outer(phase, k) + shift) @ (k * amplitudes)
    R = np.cos(np.outer(phase, k) + 2 * np.pi * rng.random(5)) @ (rng.standard_normal(5) / k)
    return u, v, P * (1.0 + 0.8 * R / np.abs(R).max()), 2 * np.pi / (omega * n)


def triangle(U: float, n: int) -> np.ndarray:
    """Slip 0, U, -U, U: n samples per quarter, corners on samples."""
    return U * np.concatenate(
        [np.linspace(0, 1, n + 1), np.linspace(1, -1, 2 * n + 1)[1:], np.linspace(-1, 1, 2 * n + 1)[1:]]
    )
