"""Lengths, angles and tangents in the space of y = (x, lam)."""

import math
from dataclasses import dataclass

import numpy as np

from .problem import Array, Linearization
from .settings import Settings


@dataclass(frozen=True, slots=True, eq=False)
class Metric:
    """Inner product sum(weights a b) over the N + 1 entries of y."""

    weights: Array

    @classmethod
    def of(cls, settings: Settings, size: int) -> "Metric":
        """Metric of the settings for `size` unknowns.

        Raises
        ------
        ValueError
            If the weights have another size.
        """
        weights = np.ones(size) if settings.weights is None else np.asarray(settings.weights, dtype=np.float64)
        if weights.size != size:
            raise ValueError(f"trace: settings.weights has {weights.size} entries; x0 has {size}")
        return cls(np.append(weights, settings.lam_weight))

    def inner(self, a: Array, b: Array) -> float:
        """Inner product."""
        return float(a @ (self.weights * b))

    def norm(self, a: Array) -> float:
        """Length."""
        return math.sqrt(float(a @ (self.weights * a)))

    def motion(self, state: Array) -> float:
        """Size of the unknowns of a state (x, lam)."""
        return self.norm(np.append(state[:-1], 0.0))

    def unit(self, a: Array) -> Array:
        """Vector of length 1 along a."""
        return a / self.norm(a)

    def angle(self, a: Array, b: Array) -> float:
        """Angle between two unit vectors [rad], accurate for small angles too."""
        return 2.0 * math.asin(min(1.0, 0.5 * self.norm(a - b)))


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A solution with its unit tangent.

    Attributes
    ----------
    state, tangent : (N + 1,) array
        The solution (x, lam) and the direction of travel.
    row : (N + 1,) array
        The tangent times the weights of the metric: row . a is the inner product with the tangent.
    sign : int
        Sign of the determinant of [J; row]: constant along a curve, corners and folds included,
        changed by simple branch points (Allgower & Georg, Numerical Continuation Methods, ch. 2 and 8).
    """

    state: Array
    tangent: Array
    row: Array
    sign: int

    def reversed(self) -> "Frame":
        """Return the same solution, travelled in the other direction."""
        return Frame(self.state, -self.tangent, -self.row, -self.sign)


def frame_along(metric: Metric, state: Array, linearization: Linearization, row: Array) -> Frame | None:
    """Frame whose tangent has row . tangent > 0, or None where there is no unique tangent."""
    try:
        dx, dlam = linearization.solve_bordered(row[:-1], float(row[-1]), np.zeros(state.size - 1), 1.0)
    except np.linalg.LinAlgError:
        return None
    tangent = np.empty(state.size)
    tangent[:-1] = dx
    tangent[-1] = dlam
    length = metric.norm(tangent)
    if not (math.isfinite(length) and length > 0.0):
        return None
    tangent /= length
    sign = linearization.determinant_sign(row[:-1], float(row[-1]))
    return Frame(state, tangent, metric.weights * tangent, sign)


def meeting(metric: Metric, first: Frame, second: Frame) -> tuple[float, float]:
    """Lengths (a, b) with first.state + a first.tangent closest to second.state - b second.tangent.

    Both positive where the path runs from the first point straight to a corner and straight on to the second.
    """
    chord = second.state - first.state
    cosine = float(first.row @ second.tangent)
    along_first, along_second = float(first.row @ chord), float(second.row @ chord)
    sine_squared = max(1.0 - cosine**2, 1e-300)
    return (
        (along_first - cosine * along_second) / sine_squared,
        (along_second - cosine * along_first) / sine_squared,
    )


def arc_length(chord: float, angle: float) -> float:
    """Length of the circular arc over a chord along which the tangent turns by `angle`."""
    half = 0.5 * angle
    return chord if half < 1e-8 else chord * half / math.sin(half)


class Stretch:
    """The cubic between two solutions that has their tangents (Hermite), a curve in the space of (x, lam).

    Parameters
    ----------
    ends, tangents : pair of (N + 1,) array
        States, and unit tangents in the direction of travel.
    length : float
        Of the path from one end to the other, > 0.
    """

    def __init__(self, ends: tuple[Array, Array], tangents: tuple[Array, Array], length: float) -> None:
        self.ends, self.tangents, self.length = ends, tangents, length
        self.chord = ends[1] - ends[0]

    @classmethod
    def between(cls, before: Frame, behind: Frame, length: float) -> "Stretch":
        """The cubic between two frames."""
        return cls((before.state, behind.state), (before.tangent, behind.tangent), length)

    def at(self, u: float) -> Array:
        """State at a fraction u of the way, (N + 1,)."""
        s, t = self.tangents
        turn = (1.0 - u) * (self.length * s - self.chord) - u * (self.length * t - self.chord)
        return np.asarray(self.ends[0] + u * self.chord + u * (1.0 - u) * turn)

    def slope(self, u: float) -> Array:
        """Derivative to the length there, (N + 1,); about a unit vector."""
        s, t = self.tangents
        mean = self.chord / self.length
        return np.asarray(mean + (1.0 - u) * (1.0 - 3.0 * u) * (s - mean) + u * (3.0 * u - 2.0) * (t - mean))

    @property
    def fold(self) -> float:
        """Fraction at which the parameter turns; its slopes at the ends must have opposite signs."""
        rise, m0, m1 = float(self.chord[-1]), *(self.length * float(t[-1]) for t in self.tangents)
        a, b, c = 3.0 * (m0 + m1 - 2.0 * rise), 2.0 * (3.0 * rise - 2.0 * m0 - m1), m0
        q = -0.5 * (b + math.copysign(math.sqrt(max(b * b - 4.0 * a * c, 0.0)), b))
        roots = [numerator / denominator for numerator, denominator in ((q, a), (c, q)) if denominator != 0.0]
        return min(roots, key=lambda root: abs(root - 0.5))
