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


SENSITIVITY = re.compile(r"\s*(\d+\.?\d*(?:[eE][+-]?\d+)?)\s*([mun\u00b5\u03bc]?V)\s*/\s*(?:\((.+)\)|([^()]+))")
"""Of a sensor: a number, volts, and what they are of, as ``100 mV/g`` or ``10.2 mV/(m/s2)``."""

AT = " at "
"""Between the unit of a channel and the sensitivity of its sensor: ``mV at 100 mV/g``."""


def to_si(source: str, name: str, unit: str, *, drives: bool = False) -> tuple[float, str]:
    """Factor to SI and SI unit of a channel; without a unit the values are in SI. One that drives may be a voltage.

    Volts may be those of a sensor, whose sensitivity is told: ``mV at 100 mV/g``.

    Raises
    ------
    InputError
        If it is no unit of force, acceleration, velocity or displacement, nor of a voltage that drives.
    """
    if not unit.strip():
        return 1.0, ""
    read, _, sensitivity = unit.partition(AT)
    if sensitivity and (sensor := SENSITIVITY.fullmatch(sensitivity)) and _is_voltage(read):
        per, volts, *of = sensor.groups()
        if float(per) == 0.0:
            raise InputError(f'{source}: unit of {name} is "{unit}"; its sensitivity must be > 0')
        factor, meant = to_si(source, name, next(filter(None, of)))
        return factor * _factor(_parsed(read)) / (float(per) * _factor(_parsed(volts))), meant
    parsed = _parsed(unit)
    for meant in (*SI, VOLT) if drives else SI:
        if parsed is not None and parsed.dimensionality == _parsed(meant).dimensionality:
            return _factor(parsed), meant
    way = '; volts of a sensor with its sensitivity, as "mV at 100 mV/g"' if _is_voltage(read) else ""
    raise InputError(f'{source}: unit of {name} is "{unit}"; must be one of {", ".join(COMMON)}{way}')


def with_sensitivity(unit: str, given: str) -> str | None:
    """Unit of a channel with a sensitivity that is given for it, in volts where it has none; None where it is not one.

    >>> with_sensitivity("mV", "100 mV/g"), with_sensitivity("", "100 mV/g"), with_sensitivity("mV", "V")
    ('mV at 100 mV/g', 'V at 100 mV/g', None)
    """
    told = unit.strip() or VOLT
    return f"{told}{AT}{given.strip()}" if SENSITIVITY.fullmatch(given) and _is_voltage(told) else None


def _is_voltage(unit: str) -> bool:
    parsed = _parsed(unit)
    return parsed is not None and parsed.dimensionality == _parsed(VOLT).dimensionality


def seconds(unit: str) -> float | None:
    """Seconds in a unit of time; None where it is none."""
    parsed = _parsed(unit)
    return None if parsed is None or parsed.dimensionality != _parsed("s").dimensionality else _factor(parsed)


def is_unit(text: str) -> bool:
    """Whether a text is a unit of anything; ``a1``, which could be an area, is more likely a sensor."""
    read, _, sensitivity = text.partition(AT)
    unit = (read if SENSITIVITY.fullmatch(sensitivity) else text).strip()
    return re.fullmatch(r"[A-Za-z]+[0-9]+", unit) is None and bool(unit) and _parsed(unit) is not None


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
