"""Units of recordings: what a sensor or a data logger calls them, converted to SI by pint.

Pint belongs to the core, not to an extra: every recording has units, whatever its file format.
"""

import re
from functools import cache
from typing import Any

from hbm.errors import InputError

COMMON = ("N", "kN", "mN", "lbf", "m/s2", "mm/s2", "g", "mg", "m/s", "mm/s", "in/s", "m", "mm", "um", "nm", "in")
"""Units named in messages; pint knows more."""

SI = ("N", "m/s2", "m/s", "m")
"""Units that are accepted for a channel."""

VOLT = "V"
"""Unit of what drives a shaker, which may stand for a force that is not measured."""

GRAVITY = re.compile(r"([mu]?)g(?:_?n)?")
"""In a recording g is the standard gravity, never the gram."""


def to_si(source: str, name: str, unit: str, *, drives: bool = False) -> tuple[float, str]:
    """Factor to SI and SI unit of a channel; without a unit the values are in SI. One that drives may be a voltage.

    Raises
    ------
    InputError
        If it is no unit of force, acceleration, velocity or displacement, nor of a voltage that drives.
    """
    if not unit.strip():
        return 1.0, ""
    parsed = _parsed(unit)
    for meant in (*SI, VOLT) if drives else SI:
        if parsed is not None and parsed.dimensionality == _parsed(meant).dimensionality:
            return _factor(parsed), meant
    volts = parsed is not None and parsed.dimensionality == _parsed(VOLT).dimensionality
    way = "; divide what is in volts by the sensitivity of its sensor" if volts else ""
    raise InputError(f'{source}: unit of {name} is "{unit}"; must be one of {", ".join(COMMON)}{way}')


def seconds(unit: str) -> float | None:
    """Seconds in a unit of time; None where it is none."""
    parsed = _parsed(unit)
    return None if parsed is None or parsed.dimensionality != _parsed("s").dimensionality else _factor(parsed)


def is_unit(text: str) -> bool:
    """Whether a text is a unit of anything; ``a1``, which could be an area, is more likely a sensor."""
    return re.fullmatch(r"[A-Za-z]+[0-9]+", text.strip()) is None and bool(text.strip()) and _parsed(text) is not None


@cache
def _parsed(unit: str) -> Any:
    """The unit as pint has it, None where pint does not know it."""
    plain = unit.strip().replace("²", "2").replace("µ", "u").replace("μ", "u").replace("·", "*")
    gravity = GRAVITY.fullmatch(plain)
    if gravity:
        plain = f"{gravity[1]}g_0"
    try:
        return _registry().parse_units(re.sub(r"(?<=[a-z])(?=\d)", "**", plain) if not gravity else plain)
    except Exception:  # pint lets through whatever its parser raises of a text that is no unit
        return None


def _factor(parsed: Any) -> float:
    return float((1.0 * parsed).to_base_units().magnitude)


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()
