"""Tables of a rig file as pydantic models, and what is wrong with a file in words.

The parameters of a friction law are not listed here: they are read from the law's own fields
(:func:`models.describe`). Entries of arrays are counted from 1, as modes and harmonics are:
``channels[2].position``.
"""

import difflib
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model
from pydantic_core import ErrorDetails

from hbm.errors import InputError
from hbm.rigfiles.laws import Consent, accepted_laws, find_law
from hbm.rigfiles.quantities import (
    Alpha,
    Beta,
    Density,
    Force,
    Frequency,
    Length,
    Load,
    Modulus,
    Positive,
    Radius,
    Ratio,
    Shape,
    Thickness,
    Width,
    possible,
)
from models import LAWS, Beam, Contact, Damping, Parameter, describe
from models.friction import defaults
from models.parts import Quantity
from models.plausible import of_parameter

Key = tuple[str | int, ...]
PRINTABLE = r"^[^\p{C}\p{Zl}\p{Zp}]*$"
# names become columns and cells of CSV files
ChannelName = Annotated[str, Field(pattern=r'^[^\s\p{C},;"](?:[^\p{C}\p{Zl}\p{Zp},;"]*[^\s\p{C},;"])?$')]


MOST_ENTRIES = 200
"""Elements of a law, of which each costs a state."""

MOST_MODES = 1000

MOST_CHANNELS = 1000
"""Of a rig; what their correlations take grows with the square of their number."""


class Table(BaseModel):
    """A table of a rig file: exact types, no unknown keys, no infinities."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)


class BeamTable(Table):
    """``[beam]``, the arguments of :class:`models.Beam`."""

    length: Length
    width: Width
    thickness: Thickness
    youngs_modulus: Modulus
    density: Density
    modes: Annotated[int, Field(ge=1, le=MOST_MODES)] = Beam.modes


class ModalTable(Table):
    """``[modal]``, the arguments of :class:`models.ModalBody`."""

    frequencies_hz: Annotated[list[Frequency], Field(min_length=1, max_length=MOST_MODES)]
    shapes: list[list[Shape]]
    contact_shape: list[Shape]
    excitation_shape: list[Shape]


class DampingTable(Table):
    """``[damping]``: mass_proportional or modal_ratios, and the high modes."""

    mass_proportional: Alpha | None = None
    modal_ratios: Annotated[list[Ratio], Field(min_length=1)] | None = None
    stiffness_proportional: Beta = Damping.stiffness_proportional
    high_mode_ratio: Ratio = Damping.high_mode_ratio
    high_mode_from: Annotated[int, Field(ge=1)] = Damping.high_mode_from


class ContactTable(Table):
    """``[contact]`` of a modal rig."""

    normal_load: Load
    friction: dict[str, Any]  # checked against the law it names, see law_table


class BeamContactTable(ContactTable):
    """``[contact]`` of a beam."""

    radius: Radius
    variable_normal_load: bool = bool(Contact.load_variation)
    residual_compliance: bool = Contact.residual_compliance
    foreshortening: bool = Contact.foreshortening
    lift_off: bool = Contact.lift_off


class ExcitationTable(Table):
    """``[excitation]`` of a modal rig."""

    amplitude: Force


class BeamExcitationTable(ExcitationTable):
    """``[excitation]`` of a beam."""

    position: Positive


class ChannelTable(Table):
    """An entry of ``[[channels]]`` of a modal rig."""

    name: ChannelName
    quantity: Quantity
    repeatability: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class BeamChannelTable(ChannelTable):
    """An entry of ``[[channels]]`` of a beam."""

    position: Positive


class BeamRig(Table):
    """A rig file with ``[beam]``."""

    name: str
    beam: BeamTable
    damping: DampingTable
    contact: BeamContactTable
    excitation: BeamExcitationTable
    channels: Annotated[list[BeamChannelTable], Field(max_length=MOST_CHANNELS)] = []
    extensions: list[dict[str, Any]] = []  # checked against the causes they name, see hbm.rigfiles.extensions


class ModalRig(Table):
    """A rig file with ``[modal]``."""

    name: str
    modal: ModalTable
    damping: DampingTable
    contact: ContactTable
    excitation: ExcitationTable
    channels: Annotated[list[ChannelTable], Field(max_length=MOST_CHANNELS)] = []
    extensions: list[dict[str, Any]] = []


@cache
def law_table(law: type) -> type[Table]:
    """Schema of ``[contact.friction]`` for one law, made from the law's fields."""
    known, hints, optional = describe(law), get_type_hints(law), defaults(law)
    entries: dict[str, Any] = {"law": (str, ...)}
    for f in fields(law):
        accepted = _number(f.name, known[f.name]) if f.name in known else _choice(hints[f.name])
        default = optional.get(f.name, ...)
        entries[f.name] = (accepted, list(default) if isinstance(default, tuple) else default)
    return create_model(f"{law.__name__}Table", __base__=Table, **entries)


def _number(name: str, p: Parameter) -> Any:
    bounds: dict[str, Any] = {"gt" if p.strict else "ge": p.lower, "le": p.upper}
    within = Field(**{sign: bound for sign, bound in bounds.items() if isfinite(bound)})
    return Annotated[float, within, possible(of_parameter(name, p.unit))]


def _choice(hint: Any) -> Any:
    """Schema of a setting of the type `hint`: counts and arrays of positive numbers are limited."""
    if hint is int:
        return Annotated[int, Field(ge=1, le=MOST_ENTRIES)]
    if get_origin(hint) is tuple:
        return Annotated[list[Positive], Field(min_length=1, max_length=MOST_ENTRIES)]
    return hint


def accepted_setting(law: type, name: str) -> str:
    """Values that a rig file may hold for a setting of a law, in a few words.

    >>> from hbm.models import Iwan
    >>> [accepted_setting(Iwan, name) for name in ("elements", "distribution", "limits")]
    ['1 to 200', '"uniform"', 'array of > 0']
    """
    hint = get_type_hints(law)[name]
    if hint is int:
        return f"1 to {MOST_ENTRIES}"
    if get_origin(hint) is tuple:
        return "array of > 0"
    return " or ".join(json.dumps(choice) for choice in get_args(hint)) or getattr(hint, "__name__", str(hint))


class Complaint(NamedTuple):
    """One thing wrong: where, what was found, what is accepted."""

    key: Key
    found: str
    accepted: str

    def __str__(self) -> str:
        return f"{dotted(self.key)} {self.found}; {self.accepted}".strip()


def root_schema(table: dict[str, Any]) -> type[BeamRig] | type[ModalRig]:
    """Schema that a file is held against: that of a beam unless it has ``[modal]`` alone."""
    return ModalRig if "modal" in table and "beam" not in table else BeamRig


def first_complaint(table: dict[str, Any], folder: Path, consent: Consent) -> Complaint | None:
    """First departure from the schema in the order of the file, a missing key at the end of its table.

    `folder` is where the file of a law of one's own is looked for, `consent` whether it may be run.
    """
    contact = table.get("contact")
    friction = contact.get("friction") if isinstance(contact, dict) else None
    complaints = [*complaints_of(root_schema(table), table, ())]
    if isinstance(friction, dict):
        complaints += _of_friction(friction, folder, consent)
    if "beam" not in table and "modal" not in table:  # what the other tables may hold depends on it
        complaints = [c for c in complaints if len(c.key) == 1]
    return min(complaints, key=lambda c: ranked(table, c.key), default=None)


def ranked(table: Any, key: Key) -> list[int]:
    """Position of a key in the file, level by level."""
    rank = []
    for part in key:
        if isinstance(part, int):
            place, below = part, table[part] if isinstance(table, list) and part < len(table) else None
        else:
            names = list(table) if isinstance(table, dict) else []
            place = names.index(part) if part in names else len(names)
            below = table.get(part) if isinstance(table, dict) else None
        rank.append(place)
        table = below
    return rank


def complaints_of(schema: type[Table], table: Mapping[str, Any], prefix: Key) -> Iterator[Complaint]:
    """Every departure of a table from a schema; `prefix` is its key."""
    try:
        schema.model_validate(table)
    except ValidationError as invalid:
        for error in invalid.errors(include_url=False):
            yield _complaint(schema, error, prefix)


def _of_friction(friction: dict[str, Any], folder: Path, consent: Consent) -> Iterator[Complaint]:
    key, name = ("contact", "friction", "law"), friction.get("law")
    if "law" not in friction:
        yield Complaint(key, "is missing", f"must be {accepted_laws()}")
    elif not isinstance(name, str):
        yield Complaint(key, found(name), f"must be {accepted_laws()}")
    else:
        try:
            law = find_law(name, folder, consent)
        except InputError as refused:
            yield Complaint(key, found(name), str(refused))
        else:
            yield from complaints_of(law_table(law), friction, key[:-1])


def _complaint(schema: type[Table], error: ErrorDetails, prefix: Key) -> Complaint:
    key = tuple(part for part in error["loc"] if part not in _OF_PYDANTIC)
    if error["type"] == "missing":
        words = _missing(schema, key)
    elif error["type"] == "extra_forbidden" and prefix:
        words = _foreign_parameter(schema, str(key[-1]), error["input"])
    elif error["type"] == "extra_forbidden":
        words = _unknown(schema, key)
    else:
        words = found(error["input"]), _accepted(schema, error)
    return Complaint(prefix + key, *words)


def _missing(schema: type[Table], key: Key) -> tuple[str, str]:
    if key in (("beam",), ("modal",)):
        return "is missing", "must have [beam] or [modal]"
    table = _table_at(schema, key[:-1])
    required = [name for name, entry in table.model_fields.items() if entry.is_required()]
    return "is missing", f"required keys are {', '.join(required)}"


def _unknown(schema: type[Table], key: Key) -> tuple[str, str]:
    name, accepted = str(key[-1]), list(_table_at(schema, key[:-1]).model_fields)
    if key == ("modal",):
        return "and beam are both present", "must have one of them"
    if schema is ModalRig and key[0] in BeamRig.model_fields and name in _table_at(BeamRig, key[:-1]).model_fields:
        return "does not go with [modal]", f"accepted keys are {', '.join(accepted)}"
    if len(key) == 1:
        accepted += {BeamRig: ["modal (instead of beam)"], ModalRig: ["beam"]}.get(schema, [])
    return "is unknown", f"accepted keys are {', '.join(accepted)}" + _did_you_mean(name, accepted)


def _foreign_parameter(schema: type[Table], name: str, value: Any) -> tuple[str, str]:
    accepted = list(schema.model_fields)
    accepts = f"accepted keys are {', '.join(accepted)}"
    *others, last = [law for law, kind in LAWS.items() if name in {f.name for f in fields(kind)}] or [""]
    if last:
        owners = f"{', '.join(others)} and {last}" if others else last
        return f"{found(value)} is a parameter of {owners}", accepts
    return "is unknown", accepts + _did_you_mean(name, accepted)


def _table_at(schema: type[Table], key: Key) -> type[Table]:
    """Model of the table under `key`."""
    for part in key:
        if isinstance(part, str):
            annotation = schema.model_fields[part].annotation
            schema = (get_args(annotation) or (annotation,))[0]
    return schema


def _accepted(schema: type[Table], error: ErrorDetails) -> str:
    """Values that are accepted where pydantic found something else."""
    kind, context = error["type"], error.get("ctx", {})
    if kind == "list_type" and isinstance(error["input"], dict):
        return f"must be an array of tables, [[{error['loc'][-1]}]]"
    if kind == "string_pattern_mismatch":
        if context["pattern"] == PRINTABLE:
            return "must be a name without control characters"
        return "must be a name without , ; quotes, control characters or surrounding blanks"
    if kind == "literal_error":
        return one_of(re.findall("'([^']*)'", context["expected"]))
    if kind in _BOUNDS and (bounds := _bounds(schema, error["loc"])):
        return f"must be {' and '.join(bounds)}"
    return _WORDS.get(kind, error["msg"]).format(**context)


def _bounds(schema: type[Table], key: Key) -> list[str]:
    """Every bound of the number under `key`, not only the one it exceeds."""
    if not isinstance(key[-1], str):
        return []
    known = _table_at(schema, key[:-1]).model_fields[key[-1]].metadata
    limits = [(sign, getattr(bound, name)) for bound in known for name, sign in _SIGNS.items() if hasattr(bound, name)]
    return [f"{sign} {limit:g}" for sign, limit in limits]


_OF_PYDANTIC = ("text", "array", "[key]")
_BOUNDS = ("greater_than", "greater_than_equal", "less_than_equal")
_SIGNS = {"gt": ">", "ge": ">=", "le": "<="}
_WORDS = {
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "bool_type": "must be true or false",
    "string_type": "must be a text in quotes",
    "string_too_short": "must not be empty",
    "list_type": "must be an array",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "finite_number": "must be finite",
    "greater_than": "must be > {gt:g}",
    "greater_than_equal": "must be >= {ge:g}",
    "less_than_equal": "must be <= {le:g}",
    "too_short": "must have at least one entry",
    "too_long": "must have at most {max_length} entries",
}


def found(value: Any) -> str:
    """Say what a key holds: ``= -0.2``, ``= "text"``, ``is a table``."""
    if isinstance(value, dict):
        return "is a table"
    if isinstance(value, list):
        return "is an array" if value else "is an empty array"
    text = json.dumps(value) if isinstance(value, str | bool) else str(value)
    return f"= {text if len(text) <= 80 else text[:77] + '...'}"


def one_of(accepted: Iterable[str]) -> str:
    """``must be one of a, b, c``."""
    return f"must be one of {', '.join(accepted)}"


def dotted(key: Key) -> str:
    """Key as the reader would write it, ``contact.friction.mu`` or ``channels[2].name``."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part + 1}]"
        else:
            text += "." * bool(text) + (part if re.fullmatch(r"[\w-]+", part) else json.dumps(part))
    return text


def _did_you_mean(word: Any, accepted: Iterable[str]) -> str:
    close = difflib.get_close_matches(str(word), [name.split()[0] for name in accepted], n=1)
    return f"; did you mean {close[0]}?" if close else ""
