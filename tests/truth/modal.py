"""Any structure by its modes with one hidden force between two places, marched in time: independent of the solver.

All records are marched at once. The modes are linear: over a step each moves exactly under a force that changes on a
straight line; the hidden force at the end of the step follows from the motion there by a few fixed-point iterations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm

Array = np.ndarray

Hidden = Callable[[Array, Array, Array], tuple[Array, Array]]
"""From displacement, velocity and memory before, the force on the body and the memory after."""

Tones = tuple[tuple[int, float, float], ...]

ITERATIONS = 3


@dataclass(frozen=True, eq=False)
class Modes:
    """Mass-normalised modes: frequencies [Hz], damping ratios (n,), and shapes by place.

    Frequencies may be those of each record, (r, n).
    """

    hz: Array
    ratio: Array
    rows: dict[str, Array]

    def disturbed(self, rng: np.random.Generator, hz: float, ratio: float, shape: float) -> "Modes":
        """The same where all that is identified of it is a little off, relative standard deviations."""

        def off(values: Array, size: float) -> Array:
            return values * (1.0 + size * rng.standard_normal(values.shape))

        return replace(
            self,
            hz=off(self.hz, hz),
            ratio=off(self.ratio, ratio),
            rows={name: off(row, shape) for name, row in self.rows.items()},
        )


def nothing(u: Array, v: Array, z: Array) -> tuple[Array, Array]:
    """No hidden force."""
    return 0.0 * u, z


def cubic(k3: float) -> Hidden:
    """A cubic spring."""
    return lambda u, v, z: (-k3 * u**3, z)


def gap(k: float, clearance: float) -> Hidden:
    """A one-sided stop."""
    return lambda u, v, z: (-k * np.maximum(u - clearance, 0.0), z)


def jenkins(k: float, limit: float) -> Hidden:
    """A spring that slides at a limit; its memory is where it is anchored."""

    def force(u: Array, v: Array, z: Array) -> tuple[Array, Array]:
        f = np.minimum(np.maximum(k * (z - u), -limit), limit)  # as clip, which costs thrice as much on few numbers
        return f, u + f / k

    return force


def parts(k: float, limit: float, spread: float, elements: int = 10) -> Hidden:
    """So many springs side by side that slide one after the other, limits evenly spread about their mean."""
    middle = 1.0 + spread * (2.0 * np.arange(elements) + 1.0 - elements) / elements
    limits, one = (limit / elements * middle)[:, None], k / elements

    def force(u: Array, v: Array, z: Array) -> tuple[Array, Array]:
        f = np.minimum(np.maximum(one * (z - u), -limits), limits)
        return f.sum(axis=0), u + f / one

    return force


def falling(k: float, static: float, limit: float, speed: float) -> Hidden:
    """A spring that slides at a limit which falls from that at rest over a speed."""

    def force(u: Array, v: Array, z: Array) -> tuple[Array, Array]:
        most = limit + (static - limit) * np.exp(-((v / speed) ** 2))
        f = np.minimum(np.maximum(k * (z - u), -most), most)
        return f, u + f / k

    return force


def slack(k: float, limit: float, play: float) -> Hidden:
    """A spring that slides at a limit, behind a play; its memory is where the middle of the play is."""

    def force(u: Array, v: Array, z: Array) -> tuple[Array, Array]:
        beyond = np.maximum(np.abs(u - z) - play / 2.0, 0.0)
        f = -np.sign(u - z) * np.minimum(k * beyond, limit)
        return f, z + np.sign(u - z) * np.maximum(beyond - limit / k, 0.0)

    return force


def quadratic(c: float) -> Hidden:
    """A dashpot whose force grows with the square of the velocity."""
    return lambda u, v, z: (-c * v * np.abs(v), z)


def steady(
    modes: Modes,
    hidden: Hidden,
    at: Array,
    drive: str,
    hz: Array,
    force: Array,
    periods: int = 150,
    steps: int = 256,
    H: int = 5,
    tones: Tones = (),
) -> Array:
    """Modal harmonics a_0, a_1..a_H, b_1..b_H of every record, (r, 2H+1, n), over the last period.

    `at` (n,) is the row of the relative displacement that the hidden force sees and acts along; `tones` are harmonics
    of the drive beside its cosine: numbers with coefficients of cos and sin relative to it. Steps are coarse at first:
    what the coarse ones err by dies out over the last three tenths, as what is left of the start does.
    """
    coarse, finer = periods // 2, periods // 5
    parts = ((coarse, max(steps // 8, 32)), (finer, max(steps // 4, 32)), (periods - coarse - finer, steps))
    return last_periods(modes, hidden, at, drive, hz, force, parts, H, 1, tones)[0]


def last_periods(
    modes: Modes,
    hidden: Hidden,
    at: Array,
    drive: str,
    hz: Array,
    force: Array,
    parts: Sequence[tuple[int, int]],
    H: int,
    kept: int,
    tones: Tones = (),
) -> Array:
    """As :func:`steady`, of each of the last periods, (kept, r, 2H+1, n): not every motion repeats.

    The march from rest has parts of so many periods with so many steps each; those kept are of the last part.
    """
    r, n = len(hz), len(modes.ratio)
    x, z, f = np.zeros((2, n, r)), np.zeros(r), np.zeros(r)
    row = at[None, None, :]
    for periods, steps in parts:
        through, first, second = _exact(modes, 1.0 / (hz * steps))
        phase = 2 * np.pi * np.arange(steps + 1) / steps
        wave = np.cos(phase) + sum(a * np.cos(k * phase) + b * np.sin(k * phase) for k, a, b in tones)
        wave = wave[:, None, None, None]
        pushed = (wave[:-1] * first + wave[1:] * second) * (force * modes.rows[drive][:, None])
        first, second = first * at[:, None], second * at[:, None]  # of the hidden force
        seen = (row @ second)[:, 0]  # displacement and velocity that it feels of itself
        last = np.empty((kept, steps, n, r))
        for step in range(periods * steps):
            free = through[:, 0] * x[0]
            free += through[:, 1] * x[1]
            free += pushed[step % steps]
            free += first * f
            felt = (row @ free)[:, 0]
            u, v = felt + seen * f
            used, (new, after) = f, hidden(u, v, z)
            for _ in range(ITERATIONS - 1):
                u, v = felt + seen * new
                used, (new, after) = new, hidden(u, v, z)
            free += second * used
            x, f, z = free, new, after
            if step >= (periods - kept) * steps:
                last[step // steps - periods + kept, (step + 1) % steps] = x[0]
    spectrum = np.fft.rfft(last, axis=1)[:, : H + 1] * 2 / steps
    spectrum[:, 0] /= 2
    return np.concatenate([spectrum.real, -spectrum.imag[:, 1:]], axis=1).transpose(0, 3, 1, 2)


def _exact(modes: Modes, dt: Array) -> tuple[Array, Array, Array]:
    """How a step moves displacement and velocity (2, 2, n, r), and a force before and after it does, (2, n, r)."""
    omega_n, r, n = 2 * np.pi * modes.hz, len(dt), len(modes.ratio)
    A = np.zeros((r, n, 4, 4))  # (q, q', p, p') with a force p on the mode that changes evenly
    A[..., 0, 1] = A[..., 2, 3] = 1.0
    A[..., 1, 0], A[..., 1, 1], A[..., 1, 2] = -(omega_n**2), -2 * modes.ratio * omega_n, 1.0
    E = np.ascontiguousarray(expm(A * dt[:, None, None, None]).transpose(2, 3, 1, 0))
    second = E[:2, 3] / dt
    return np.ascontiguousarray(E[:2, :2]), E[:2, 2] - second, second


def accelerations(modes: Modes, q: Array, place: str, hz: Array) -> Array:
    """Harmonics of the acceleration at a place, (r, 2H+1)."""
    H = q.shape[1] // 2
    k = np.concatenate([np.arange(H + 1), np.arange(1, H + 1)])
    return -((2 * np.pi * hz[:, None] * k) ** 2) * (q @ modes.rows[place])
