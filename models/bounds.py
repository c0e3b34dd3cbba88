"""Bounds of numbers: what cannot be is refused where it is made.

Anything but a plain number or text passes: laws and bodies are also made of CasADi expressions, to be differentiated.
"""

from math import inf, isfinite
from numbers import Integral, Real
from typing import Any


def refuse_text(where: str, value: Any) -> None:
    """Refuse text in place of a number.

    Raises
    ------
    ValueError
        With the text.
    """
    if isinstance(value, str):
        raise ValueError(f'{where} = "{value}"; must be a number')


def whole(where: str, value: Any, least: int) -> None:
    """Refuse what is no whole number from the least on.

    Raises
    ------
    ValueError
        With what was given.
    """
    if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
        raise ValueError(f"{where} = {value}; must be a whole number >= {least}")


def several(where: str, value: Any, kind: type) -> None:
    """Refuse one of a kind in place of a tuple of them.

    Raises
    ------
    ValueError
        With what to write.
    """
    if isinstance(value, kind):
        raise ValueError(f"{where} is one {kind.__name__}; must be a tuple, ({kind.__name__}(...),)")


def bounded(where: str, value: Any, lower: float = -inf, upper: float = inf, strict: bool = False) -> None:
    """Refuse a number that is not finite or not within its bounds, and text.

    Parameters
    ----------
    where : str
        Beginning of the message, such as ``Beam: length``.
    value : float, or anything else but text, which passes
    lower, upper : float
    strict : bool
        Whether the lower bound itself is excluded.

    Raises
    ------
    ValueError
        With the number and its bounds.

    Examples
    --------
    >>> bounded("Beam: length", -1.0, 0.0, strict=True)
    Traceback (most recent call last):
    ValueError: Beam: length = -1; must be > 0
    """
    refuse_text(where, value)
    if type(value) is not float and (not isinstance(value, Real) or isinstance(value, bool)):
        return
    number = float(value)
    if isfinite(number) and number <= upper and (number > lower if strict else number >= lower):
        return
    bounds = [] if lower == -inf else [f"{'>' if strict else '>='} {lower:g}"]
    bounds += [] if upper == inf else [f"<= {upper:g}"]
    raise ValueError(f"{where} = {number:g}; must be {' and '.join(bounds) or 'finite'}")
