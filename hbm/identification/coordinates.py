"""Coordinates in which parameters are fitted: scaled, and free of constraints other than bounds.

Positive parameters by their logarithm; those that may be zero by asinh, linear near zero and logarithmic far off; a
parameter that must not fall below another by the logarithm of their ratio.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hbm.fourier import Array
from models.friction import Parameter
from models.plausible import RANGES, of_parameter

REACH = np.log(1e4)
"""A positive parameter is looked for within a factor of 1e4 of its physical scale."""

ROUNDING = 1e-12
"""Relative tolerance of a bound that goes through a logarithm and back."""

LARGEST_RATIO = np.log(20.0)
"""A parameter that is at least another, up to 20 times that."""


class Coordinate(Protocol):
    """Maps a coordinate to a parameter; `low` and `high` bound the coordinate."""

    @property
    def low(self) -> float:
        """Least coordinate."""
        ...

    @property
    def high(self) -> float:
        """Largest coordinate."""
        ...

    def value(self, x: float) -> float:
        """Parameter at a coordinate."""
        ...

    def slope(self, x: float) -> float:
        """Its derivative."""
        ...

    def of(self, value: float) -> float:
        """Coordinate of a parameter."""
        ...


@dataclass(frozen=True)
class Logarithmic:
    """value = scale exp(x), within REACH of the scale and between `lower` and `upper`."""

    scale: float
    lower: float = 0.0
    upper: float = np.inf

    @property
    def low(self) -> float:
        """Least coordinate."""
        return float(max(-REACH, np.log(self.lower / self.scale))) if self.lower > 0.0 else -float(REACH)

    @property
    def high(self) -> float:
        """Largest coordinate."""
        return float(min(REACH, np.log(self.upper / self.scale)))

    def value(self, x: float) -> float:
        """Parameter at a coordinate."""
        return float(self.scale * np.exp(x))

    def slope(self, x: float) -> float:
        """Its derivative."""
        return self.value(x)

    def of(self, value: float) -> float:
        """Coordinate of a parameter."""
        return float(np.log(value / self.scale))


@dataclass(frozen=True)
class FromZero:
    """value = scale sinh(x), x >= 0."""

    scale: float

    @property
    def low(self) -> float:
        """Least coordinate."""
        return 0.0

    @property
    def high(self) -> float:
        """Largest coordinate."""
        return float(REACH)

    def value(self, x: float) -> float:
        """Parameter at a coordinate."""
        return float(self.scale * np.sinh(x))

    def slope(self, x: float) -> float:
        """Its derivative."""
        return float(self.scale * np.cosh(x))

    def of(self, value: float) -> float:
        """Coordinate of a parameter."""
        return float(np.arcsinh(value / self.scale))


@dataclass(frozen=True)
class Linear:
    """value = scale x, between `lower` and `upper`."""

    scale: float
    lower: float
    upper: float

    @property
    def low(self) -> float:
        """Least coordinate."""
        return self.lower / self.scale

    @property
    def high(self) -> float:
        """Largest coordinate."""
        return self.upper / self.scale

    def value(self, x: float) -> float:
        """Parameter at a coordinate."""
        return self.scale * x

    def slope(self, x: float) -> float:
        """Its derivative."""
        return self.scale

    def of(self, value: float) -> float:
        """Coordinate of a parameter."""
        return value / self.scale


@dataclass(frozen=True)
class Ratio:
    """value = exp(x) times the parameter that it must not fall below, x >= 0; its slope is per unit of that one."""

    @property
    def low(self) -> float:
        """Least coordinate."""
        return 0.0

    @property
    def high(self) -> float:
        """Largest coordinate."""
        return float(LARGEST_RATIO)

    def value(self, x: float) -> float:
        """Ratio at a coordinate."""
        return float(np.exp(x))

    def slope(self, x: float) -> float:
        """Its derivative."""
        return float(np.exp(x))

    def of(self, value: float) -> float:
        """Coordinate of a ratio."""
        return float(np.log(max(value, 1.0)))


def coordinate_of(name: str, known: Parameter, scale: float) -> Coordinate:
    """Coordinate that suits a parameter of a physical scale; of positive ones, to what is possible.

    >>> from hbm.models import Jenkins
    >>> from hbm.models.friction import describe
    >>> coordinate_of("mu", describe(Jenkins)["mu"], 0.5)
    Logarithmic(scale=0.5, lower=1.000000000001e-12, upper=999999.999999)
    """
    if known.at_least is not None:
        return Ratio()
    if np.isinf(known.upper) and known.lower == 0.0:
        return Logarithmic(scale, *_possible(name, known)) if known.strict else FromZero(scale)
    return Linear(scale, known.lower, known.upper)


def _possible(name: str, known: Parameter) -> tuple[float, float]:
    """Range in which a law accepts a positive parameter, a rounding within its ends."""
    least, most = RANGES[quantity].possible if (quantity := of_parameter(name, known.unit)) else (0.0, known.upper)
    return least * (1.0 + ROUNDING), most * (1.0 - ROUNDING)


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Coordinates of the free parameters of a law; the others are held.

    Attributes
    ----------
    parameters : dict of str to Parameter
        All of the law's, in its order.
    free : dict of str to Coordinate
        Coordinates that are fitted, in the law's order.
    held : dict of str to float
        Values of the others.
    """

    parameters: Mapping[str, Parameter]
    free: Mapping[str, Coordinate]
    held: Mapping[str, float]

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Least and largest coordinates."""
        return np.array([c.low for c in self.free.values()]), np.array([c.high for c in self.free.values()])

    def values(self, x: Array) -> Array:
        """All parameters of the law at coordinates (n,), in the law's order."""
        found = self._of_free(x)
        return np.array([found[name] for name in self.parameters])

    def slopes(self, x: Array) -> Array:
        """Derivatives of all parameters (p, n) to the coordinates."""
        values, names = self._of_free(x), list(self.free)
        rows = {name: np.zeros(len(x)) for name in self.parameters}
        for i, (name, coordinate) in enumerate(self.free.items()):
            if not isinstance(coordinate, Ratio):
                rows[name][i] = coordinate.slope(x[i])
        for name, base in self._tied():
            i = names.index(name)
            rows[name] = rows[base] * self.free[name].value(x[i])
            rows[name][i] += values[base] * self.free[name].slope(x[i])
        return np.array([rows[name] for name in self.parameters])

    def of(self, values: Mapping[str, float]) -> Array:
        """Coordinates of parameters by name, within the bounds."""
        tied = dict(self._tied())
        x = [c.of(values[name] / values[tied[name]] if name in tied else values[name]) for name, c in self.free.items()]
        return np.asarray(np.clip(np.array(x), *self.bounds))

    def _of_free(self, x: Array) -> dict[str, float]:
        values = dict(self.held)
        for (name, coordinate), at in zip(self.free.items(), x, strict=True):
            values[name] = coordinate.value(float(at))
        for name, base in self._tied():
            values[name] *= values[base]
        return values

    def _tied(self) -> list[tuple[str, str]]:
        """Free parameters that must not fall below another, with that other."""
        return [(name, str(self.parameters[name].at_least)) for name, c in self.free.items() if isinstance(c, Ratio)]
