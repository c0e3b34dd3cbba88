"""Another friction law on the same rig, its parameters taken from where they are known."""

from dataclasses import MISSING, dataclass, fields, replace
from typing import cast

from hbm.errors import InputError
from models import LAWS, FrictionLaw, Rig, describe, published
from models.friction import parameters

RIG_FILE = "the rig file"
DEFAULT = "the default"


@dataclass(frozen=True, eq=False)
class LawChoice:
    """A rig on another friction law.

    Attributes
    ----------
    rig : Rig
    sources : dict of str to str
        Where each parameter of the law comes from.
    """

    rig: Rig
    sources: dict[str, str]

    def __str__(self) -> str:
        """Say which values are used and where they come from."""
        values = parameters(self.rig.contact.law)
        text = ", ".join(f"{name} = {value:g} ({self.sources[name]})" for name, value in values.items())
        return f"law {self.rig.contact.law.name}: {text or 'no parameters'}"


def choose_law(rig: Rig, name: str) -> LawChoice:
    """Put a friction law on a rig.

    Parameters of the same name keep the rig's values; the others are those of the first set in
    :mod:`models.published`, or the law's defaults. Where a kept value contradicts a filled one (a sliding
    coefficient above the static one), both are the published ones.

    Parameters
    ----------
    rig : Rig
    name : str
        Key of :data:`models.LAWS`.

    Returns
    -------
    LawChoice

    Raises
    ------
    InputError
        If there is no such law, or a parameter has no value anywhere.
    """
    if name not in LAWS:
        raise InputError(f'--law = "{name}"; must be one of {", ".join(LAWS)}')
    own = parameters(rig.contact.law)
    if rig.contact.law.name == name:
        return LawChoice(rig, dict.fromkeys(own, RIG_FILE))
    found, source = _published(name)
    values = _defaults(LAWS[name]) | found
    sources = dict.fromkeys(values, DEFAULT) | dict.fromkeys(found, source)
    for parameter in describe(LAWS[name]).keys() & own.keys():
        values[parameter], sources[parameter] = own[parameter], RIG_FILE
    for parameter, other in _contradictions(name, values):
        for end in (parameter, other):
            if end in found:
                values[end], sources[end] = found[end], source
    return LawChoice(replace(rig, contact=replace(rig.contact, law=_made(name, values))), sources)


def _published(name: str) -> tuple[dict[str, float], str]:
    """Parameters of the first published set of a law, and its name."""
    for variable, law in vars(published).items():
        if type(law) is LAWS[name]:
            return parameters(cast(FrictionLaw, law)), f"models.published.{variable}"
    return {}, ""


def _defaults(law: type) -> dict[str, float]:
    return {f.name: f.default for f in fields(law) if f.default is not MISSING}


def _contradictions(name: str, values: dict[str, float]) -> list[tuple[str, str]]:
    """Pairs of parameters that are the wrong way round."""
    return [
        (parameter, p.at_least)
        for parameter, p in describe(LAWS[name]).items()
        if p.at_least and parameter in values and p.at_least in values and values[parameter] < values[p.at_least]
    ]


def _made(name: str, values: dict[str, float]) -> FrictionLaw:
    missing = [parameter for parameter in describe(LAWS[name]) if parameter not in values]
    if missing:
        raise InputError(
            f'--law = "{name}"; neither the rig file nor a published set has its {", ".join(missing)}; '
            "write the law with its parameters in the rig file"
        )
    for parameter, other in _contradictions(name, values):
        raise InputError(
            f'--law = "{name}"; {parameter} = {values[parameter]:g} would be below {other} = {values[other]:g}; '
            "write the law with its parameters in the rig file"
        )
    made: FrictionLaw = LAWS[name](**{parameter: values[parameter] for parameter in describe(LAWS[name])})
    return made
