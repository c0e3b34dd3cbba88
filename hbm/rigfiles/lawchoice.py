"""Another friction law on the same rig, with the parameters that are known of it."""

import sys
from collections.abc import Iterator
from dataclasses import MISSING, dataclass, fields, replace
from pathlib import Path
from types import ModuleType
from typing import Any

from hbm.errors import InputError, expect_rig
from hbm.rigfiles.laws import find_law
from models import FrictionLaw, Rig, published
from models.friction import chosen, parameters


@dataclass(frozen=True, eq=False)
class KnownLaw:
    """A friction law with parameters that are known of it.

    Attributes
    ----------
    law : FrictionLaw
    name : str
        Name of the parameter set: ``PAPER_DAHL``, ``ASSUMED_VLFM``.
    source : str
        Where the parameters come from, in words.
    """

    law: FrictionLaw
    name: str
    source: str


@dataclass(frozen=True, eq=False)
class LawChoice:
    """A rig on another friction law.

    Attributes
    ----------
    rig : Rig
    source : str
        Where the law's parameters come from, in words.
    """

    rig: Rig
    source: str

    def __repr__(self) -> str:
        """Say which values are used and where they come from."""
        law = self.rig.contact.law
        values = parameters(law) | {name: value for name, value in chosen(law).items() if value != ()}
        text = ", ".join(f"{name} = {plain(value)}" for name, value in values.items())
        return f"law {law.name}, {self.source}: {text}" if text else f"law {law.name}: no parameters"


def choose_law(rig: Rig, name: str) -> LawChoice:
    """Put a friction law on a rig.

    The rig's own law stays as it is. Any other comes with the whole set of parameters that is known of it
    (:func:`known_law`): one law's friction coefficient means nothing in another, where it is fitted together with
    others.

    Parameters
    ----------
    rig : Rig
    name : str
        Key of :data:`models.LAWS`, or ``file.py:Class``, relative to the working directory; the file is run.

    Returns
    -------
    LawChoice

    Raises
    ------
    InputError
        If there is no such law, nothing is known of its parameters, or the rig has no contact.
    """
    expect_rig(rig, "choose_law")
    try:
        law = find_law(name, Path())
    except InputError as refused:
        raise InputError(f'--law = "{name}"; {refused}') from None
    if type(rig.contact.law) is law:
        return LawChoice(rig, "the rig file's parameters")
    known = known_law(law)
    if known is None:
        raise InputError(
            f'--law = "{name}"; no parameters are known of it; write the law with its parameters in the rig file'
        )
    return LawChoice(replace(rig, contact=replace(rig.contact, law=known.law)), known.source)


def known_law(law: type) -> KnownLaw | None:
    """First set of parameters of a law: published, assumed, beside the law in its own file, or its defaults.

    >>> from hbm.models import Dahl, VelocityLimited
    >>> known_law(Dahl).source
    "the paper's parameters (models.published.PAPER_DAHL)"
    >>> known_law(VelocityLimited).source
    'assumed parameters (models.published.ASSUMED_VLFM)'
    """
    for name, found in _instances(law, published):
        kind = "the paper's" if name.startswith("PAPER") else "assumed"
        return KnownLaw(found, name, f"{kind} parameters (models.published.{name})")
    for name, found in _instances(law, sys.modules[law.__module__]):
        return KnownLaw(found, name, f"parameters {name} of its file")
    if all(f.default is not MISSING for f in fields(law)):
        return KnownLaw(law(), "defaults", "its default parameters")
    return None


def _instances(law: type, module: ModuleType) -> Iterator[tuple[str, Any]]:
    return ((name, value) for name, value in vars(module).items() if type(value) is law)


def plain(value: Any) -> str:
    """Value of a parameter or setting as one would write it: ``0.52``, ``1.04e7``, ``uniform``.

    >>> plain(1.04e7), plain(4.15e-6), plain(10), plain((1.0, 2.0))
    ('1.04e7', '4.15e-6', '10', '[1, 2]')
    """
    if isinstance(value, tuple):
        return f"[{', '.join(map(plain, value))}]"
    if not isinstance(value, float):
        return str(value)
    text = f"{value:.6g}" if value == 0.0 or 1e-3 <= abs(value) < 1e6 else f"{value:.5e}"
    digits, _, exponent = text.partition("e")
    return f"{digits.rstrip('0').rstrip('.')}e{int(exponent)}" if exponent else digits
