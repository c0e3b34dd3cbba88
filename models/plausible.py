"""Plausible ranges of the numbers of a rig: impossible values are refused, likely slips of units are warned of.

One table, :data:`RANGES`, for rig files and for rigs made in Python alike. What is possible is drawn wide, from the
laboratory on a chip to a bridge; what is unusual is more likely a number in millimetres, grams or GPa.
What is not a plain number passes, as in :mod:`models.bounds`.
"""

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from math import inf
from multiprocessing import parent_process
from numbers import Real
from typing import Any, NamedTuple, Protocol


class PlausibilityWarning(UserWarning):
    """A number that is possible, and more likely in another unit than it must be."""


class Range(NamedTuple):
    """Possible and usual magnitudes of a quantity; zero and signs are left to its other bounds.

    Attributes
    ----------
    unit : str
    possible, usual : (float, float)
        Smallest and largest: refused beyond the first, doubted beyond the second.
    reason : str
        Why nothing real lies beyond.
    mistaken : tuple of (str, float)
        Units that are written in its place, and their factors to `unit`.
    """

    unit: str
    possible: tuple[float, float]
    usual: tuple[float, float]
    reason: str
    mistaken: tuple[tuple[str, float], ...] = ()


class Doubtful(Protocol):
    """Something about numbers of a rig that may look wrong."""

    @property
    def key(self) -> str:
        """Key of the rig file."""
        ...

    @property
    def doubt(self) -> str | None:
        """What looks wrong, in words; None where nothing does."""
        ...


class Proportion(NamedTuple):
    """A number that is usually less than another one of the same rig.

    Attributes
    ----------
    key, unit : str
        Key of the rig file, and the unit of both.
    value : float
    most : float
        What it is usually less than.
    named : str
        What that is.
    """

    key: str
    value: Any
    unit: str
    most: Any
    named: str

    @property
    def doubt(self) -> str | None:
        """Doubt about the number, in words; none where one of the two is no plain number.

        >>> Proportion("beam.thickness", 0.6, "m", 0.5, "beam.length").doubt
        'beam.thickness = 0.6 m; usual are less than beam.length (0.5 m); check both'
        """
        if not (plain(self.value) and plain(self.most)) or self.value < self.most:
            return None
        value, most = (f"{float(x):.6g} {self.unit}" for x in (self.value, self.most))
        return f"{self.key} = {value}; usual are less than {self.named} ({most}); check both"


ANY = (0.0, inf)
MM_OR_UM = (("mm", 1e-3), ("um", 1e-6))
ATOM = "an atom is 1e-10 m wide, and no structure longer than 100 km"

RANGES: dict[str, Range] = {
    "weight": Range("1", (1e-12, 1e5), ANY, "a lever is between 1e-12 m and 100 km long"),
    # geometry and material of a beam
    "length": Range("m", (1e-9, 1e5), (1e-3, 100.0), ATOM, MM_OR_UM),
    "width": Range("m", (1e-10, 1e5), (1e-4, 20.0), ATOM, MM_OR_UM),
    "thickness": Range("m", (1e-10, 1e5), (1e-5, 10.0), ATOM, MM_OR_UM),
    "radius": Range("m", (1e-10, 1e5), (1e-6, 1.0), ATOM, MM_OR_UM),
    "position": Range("m", (0.0, 1e5), ANY, ATOM),
    "youngs_modulus": Range(
        "Pa", (1.0, 1e14), (1e6, 2e12), "the softest gels have 1 Pa, diamond 1.2e12", (("GPa", 1e9), ("MPa", 1e6))
    ),
    "density": Range(
        "kg/m3",
        (1e-2, 1e6),
        (10.0, 2.5e4),
        "aerogels have 0.2 kg/m3, osmium 2.26e4",
        (("g/cm3", 1e3), ("t/mm3", 1e12), ("kg/mm3", 1e9)),
    ),
    # modes
    "frequencies_hz": Range("Hz", (1e-9, 1e13), ANY, "lattices of atoms vibrate at 1e13 Hz, no structure beyond"),
    "shape": Range("1/sqrt(kg)", (0.0, 1e15), ANY, "a mode with a mass of 1e-30 kg, that of an electron"),
    "entry": Range("SI", (0.0, 1e30), ANY, "an entry of a matrix of any structure is smaller"),
    "inertia": Range("kg or kg m2", (1e-50, 1e30), ANY, "an electron has 1e-30 kg, an atom is 1e-10 m wide"),
    "mass_proportional": Range("1/s", (0.0, 1e13), (0.0, 1e6), "nothing decays faster than a lattice vibrates"),
    "stiffness_proportional": Range("s", (0.0, 1e6), (0.0, 10.0), "a relaxation of days is a creep, not a vibration"),
    "damping_ratio": Range("1", (0.0, 1e3), (0.0, 0.2), "a ratio of 1 is critical", (("%", 1e-2),)),
    # forces
    "normal_load": Range("N", (1e-18, 1e12), (0.0, 1e8), "single bonds carry 1e-12 N, the largest presses 1e9", ()),
    "amplitude": Range("N", (1e-18, 1e12), (0.0, 1e8), "single bonds carry 1e-12 N, the largest presses 1e9", ()),
    # what is measured, of channels by their quantity
    "level": Range("N", (1e-18, 1e12), ANY, "single bonds carry 1e-12 N, the largest presses 1e9"),
    "force": Range("N", (0.0, 1e12), ANY, "the largest presses have 1e9 N"),
    "acceleration": Range("m/s2", (0.0, 1e15), ANY, "particles in a collider have more, no structure"),
    "velocity": Range("m/s", (0.0, 3e8), ANY, "faster than light"),
    "displacement": Range("m", (0.0, 1e5), ANY, "no structure is longer than 100 km"),
    "reading": Range("in any unit", (0.0, 1e30), ANY, "no sensor reads more"),
    "signal": Range("in any unit", (1e-30, 1e30), ANY, "no sensor reads so little, or more"),
    "sampling_step": Range("s", (1e-18, 1e10), ANY, "light crosses an atom in 1e-18 s; 300 years"),
    "time": Range("s", (0.0, 1e10), ANY, "300 years"),
    # numbers of laws and causes by name, then by unit
    "mu": Range("1", (1e-12, 1e6), (1e-4, 10.0), "superlubricity has 1e-5, rubber on rubber 4"),
    "critical_slip": Range("m", (1e-18, 1e5), (0.0, 0.01), "less than a nucleus, or longer than a bridge", MM_OR_UM),
    "exponent": Range("1", (1e-3, 100.0), (0.05, 20.0), "a step in all but name, which has no derivative"),
    "1": Range("1", (0.0, 1e9), ANY, "a pure number"),
    "m": Range("m", (0.0, 1e5), ANY, "no structure is longer than 100 km"),
    "m/s": Range("m/s", (1e-18, 3e8), (0.0, 1e3), "less than a nucleus a second, or faster than light"),
    "N": Range("N", (0.0, 1e15), ANY, "the largest presses have 1e9 N"),
    "N m": Range("N m", (0.0, 1e18), ANY, "the largest presses have 1e9 N"),
    "kg": Range("kg", (0.0, 1e12), ANY, "the largest dams have 1e11 kg"),
    "Hz": Range("Hz", (0.0, 1e13), ANY, "lattices of atoms vibrate at 1e13 Hz, no structure beyond"),
    "s": Range("s", (0.0, 1e9), ANY, "30 years"),
    "1/s": Range("1/s", (0.0, 1e13), ANY, "nothing decays faster than a lattice vibrates"),
    "N/m": Range("N/m", (0.0, 1e20), ANY, "a cube of diamond 10 m wide has 1e13 N/m"),
    "N m/rad": Range("N m/rad", (0.0, 1e20), ANY, "a cube of diamond 10 m wide has 1e15 N m/rad"),
    "N s/m": Range("N s/m", (0.0, 1e20), ANY, "the largest dampers have 1e9 N s/m"),
    "N s2/m2": Range("N s2/m2", (0.0, 1e20), ANY, "as a damper at 1 m/s"),
    "N s2/m2 per m": Range("N s2/m3", (0.0, 1e20), ANY, "as a damper at 1 m/s"),
    "N/m2": Range("N/m2", (0.0, 1e25), ANY, "1e19 N/m at a slip of 1 um"),
    "N/m3": Range("N/m3", (0.0, 1e30), ANY, "1e18 N/m at a slip of 1 um"),
    "N/m4": Range("N/m4", (0.0, 1e36), ANY, "1e18 N/m at a slip of 1 um"),
    "N/m5": Range("N/m5", (0.0, 1e42), ANY, "1e18 N/m at a slip of 1 um"),
}
"""Possible and usual ranges by the name of a quantity; those of a law go by its name or unit."""

_quiet: ContextVar[bool] = ContextVar("quiet", default=False)
_said: set[str] = set()


def of_parameter(name: str, unit: str) -> str:
    """Key of :data:`RANGES` for a number of a law or a cause; empty where there is none.

    >>> of_parameter("mu_static", "1"), of_parameter("stiffness", "N/m"), of_parameter("gap", "?")
    ('mu', 'N/m', '')
    """
    stem = "mu" if name.startswith("mu") else name
    known = RANGES.get(stem)
    return stem if known is not None and known.unit == unit else unit if unit in RANGES else ""


def impossible(quantity: str, value: Any) -> str | None:
    """Accepted range, in words, for a value that is impossible.

    >>> impossible("thickness", 1e-12)
    'must be between 1e-10 and 100000 m: an atom is 1e-10 m wide, and no structure longer than 100 km'
    >>> impossible("thickness", 0.005)
    """
    known = RANGES.get(quantity)
    if known is None or _within(value, known.possible):
        return None
    least, most = known.possible
    bounds = f"of magnitude <= {most:g}" if least == 0.0 else f"between {least:g} and {most:g}"
    said = f"must be {bounds} {known.unit}".replace(" 1:", ":").removesuffix(" 1")
    return f"{said}: {known.reason}"


def doubt(quantity: str, value: Any) -> str | None:
    """Doubt about a value that is possible, in words.

    >>> doubt("youngs_modulus", 70.0)
    '= 70 Pa; usual are 1e+06 to 2e+12 Pa; is it meant in GPa (7e+10 Pa)?'
    >>> doubt("youngs_modulus", 70e9)
    """
    known = RANGES.get(quantity)
    if known is None or _within(value, known.usual):
        return None
    unit = "" if known.unit == "1" else f" {known.unit}"
    least, most = known.usual
    usual = f"<= {most:g}" if least == 0.0 else f"{least:g} to {most:g}"
    said = f"= {float(value):.6g}{unit}; usual are {usual}{unit}"
    for other, factor in known.mistaken:
        if _within(factor * float(value), known.usual):
            return f"{said}; is it meant in {other} ({factor * float(value):.6g}{unit})?"
    return f"{said}; check it"


def plausible(where: str, value: Any, quantity: str) -> None:
    """Refuse a number that nothing real has.

    Parameters
    ----------
    where : str
        What the message begins with, such as ``Beam: length``.
    value : float, or anything else, which passes
    quantity : str
        Key of :data:`RANGES`; one that is not there has no range.

    Raises
    ------
    ValueError
        With the number, what is possible, and why.
    """
    if (accepted := impossible(quantity, value)) is not None:
        raise ValueError(f"{where} = {float(value)!r}; {accepted}")


def doubts(numbers: Iterable[tuple[str, str, Any]], proportions: Iterable[Doubtful] = ()) -> dict[str, str]:
    """Doubts about numbers, by their keys; about proportions only where each number alone is usual.

    Parameters
    ----------
    numbers : iterable of (str, str, float)
        Key, such as ``beam.length``, quantity and value.
    proportions : iterable of Doubtful

    >>> doubts([("beam.length", "length", 800.0), ("contact.radius", "radius", 0.005)])
    {'beam.length': 'beam.length = 800 m; usual are 0.001 to 100 m; is it meant in mm (0.8 m)?'}
    """
    found = ((key, doubt(quantity, value)) for key, quantity, value in numbers)
    alone = {key: f"{key} {against}" for key, against in found if against is not None}
    return alone or {p.key: said for p in proportions if (said := p.doubt) is not None}


def warn_of(numbers: Iterable[tuple[str, str, Any]], proportions: Iterable[Doubtful] = ()) -> None:
    """Warn of numbers that look wrong, once per key and process, since a search makes many rigs.

    Warns
    -----
    PlausibilityWarning
    """
    if _quiet.get() or parent_process() is not None:  # workers know the rig from their parent
        return
    for key, said in doubts(numbers, proportions).items():
        if key not in _said:
            _said.add(key)
            warnings.warn(said, PlausibilityWarning, stacklevel=1)  # no line of a caller is to blame for a number


def told(keys: Iterable[str]) -> None:
    """Take numbers, by their keys, for those that have been warned of: with the name of a file, say."""
    _said.update(keys)


@contextmanager
def quiet() -> Iterator[None]:
    """Warn of nothing: whoever asks says it with the name of a file, or tries numbers that nobody has given."""
    token = _quiet.set(True)
    try:
        yield
    finally:
        _quiet.reset(token)


def _within(value: Any, bounds: tuple[float, float]) -> bool:
    """Whether a value is zero, no plain number, or of a magnitude within bounds."""
    if not plain(value):
        return True
    size = abs(float(value))
    return size == 0.0 or bounds[0] <= size <= bounds[1]


def plain(value: Any) -> bool:
    """Whether a value is a number, no symbol."""
    return isinstance(value, Real) and not isinstance(value, bool)
