"""Reference tables made from the code, in Markdown: keys of rig files, laws, causes, commands.

Types, defaults and bounds come from the schema that files are held against, parameters of laws and causes from their
classes. What a schema does not say, unit and meaning of a key, is in ``keys.toml``; a key that is missing there, or
there alone, fails the build.
"""

import re
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, fields
from functools import partial
from math import inf, isinf, isnan
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

import typer
from typer.cli import get_docs_for_click

from hbm.cli import app
from hbm.rigfiles import joints, schema
from models import LAWS, describe
from models.causes import CAUSES, candidates_of
from models.causes.addedjoint import WIDEST, Number
from models.causes.joints import JOINT_CAUSES
from models.friction import defaults, settings
from models.joints import JOINT_LAWS
from models.published import paper_rig

Row = tuple[str, ...]

SCHEMAS: dict[str, type[schema.Table]] = {
    "beam": joints.HeldBeamTable,
    "modal": schema.ModalTable,
    "modal with joints": joints.PortedModalTable,
    "modal tolerances": joints.TolerancesTable,
    "matrix": joints.MatrixTable,
    "damping": schema.DampingTable,
    "contact": schema.BeamContactTable,
    "excitation": schema.BeamExcitationTable,
    "excitation with joints": joints.PlacedExcitationTable,
    "channels": schema.BeamChannelTable,
    "channels with joints": joints.PlacedChannelTable,
    "masses": joints.MassTable,
    "joints": joints.joint_table(LAWS["coulomb-penalty"]),
}
"""Tables of a rig file; the last without the parameters of its law."""

WORDS = {float: "number", int: "whole number", bool: "true or false", str: "text", dict: "table"}
SIGNS = {"gt": ">", "ge": "≥", "le": "≤"}
SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹"


def markdown_table(head: Row, rows: Sequence[Row]) -> str:
    """A Markdown table; bars within cells are escaped."""
    lines = [head, ("---",) * len(head), *(tuple(cell.replace("|", r"\|") for cell in row) for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


# ---------------------------------------------------------------------------------------------------------- rig files


def known_keys() -> dict[str, dict[str, list[str]]]:
    """Unit and meaning of each key of each table."""
    return tomllib.loads(Path(__file__).with_name("keys.toml").read_text(encoding="utf-8"))


def keys(name: str) -> str:
    """Every key of a table of a rig file."""
    said, model = known_keys()[name], SCHEMAS[name]
    own = set(model.model_fields) - ({"law", *describe(LAWS["coulomb-penalty"])} if name == "joints" else set())
    if own != set(said):
        raise ValueError(f"keys.toml [{name}]: differs from the schema in {', '.join(sorted(own ^ set(said)))}")
    rows = []
    for key, (unit, meaning) in said.items():
        entry = model.model_fields[key]
        default = "required" if entry.is_required() else shown(entry.get_default(call_default_factory=True))
        kind, bounds = accepted(entry.annotation, entry.metadata)
        rows.append((f"`{key}`", kind, unit, default, bounds, meaning))
    return markdown_table(("key", "type", "unit", "default", "accepted", "meaning"), rows)


def shown(default: Any) -> str:
    """A default as a rig file would have it."""
    if default is None or default in ({}, [], ""):
        return "none"
    return f"`{str(default).lower() if isinstance(default, bool) else default}`"


def accepted(hint: Any, metadata: Sequence[Any] = ()) -> tuple[str, str]:
    """Type and bounds of a key, in words."""
    origin, args = get_origin(hint), get_args(hint)
    if hasattr(hint, "__metadata__"):
        return accepted(args[0], (*hint.__metadata__, *metadata))
    if isinstance(hint, type) and issubclass(hint, schema.Table):
        return "table", ""
    if origin is Literal:
        return "text", " or ".join(f"`{choice}`" for choice in args)
    if origin in (Union, UnionType):
        kinds = [accepted(choice, metadata) for choice in args if choice is not type(None)]
        return " or ".join(kind for kind, _ in kinds), next((bounds for _, bounds in kinds if bounds), "")
    if origin is list:
        kind, bounds = accepted(args[0])
        return f"array of {several(kind)}", bounds
    if origin is dict:
        return ("table" if args[1] is Any else f"table of {several(accepted(args[1])[0])}"), ""
    return WORDS[hint], ", ".join(limits(metadata))


def several(kind: str) -> str:
    """The plural of a type: arrays of numbers, whole numbers."""
    first, of, rest = kind.partition(" of ")
    return f"{first}s{of}{rest}"


def limits(metadata: Sequence[Any]) -> Iterator[str]:
    """Bounds of a number."""
    for entry in metadata:
        for part in getattr(entry, "metadata", None) or [entry]:
            for sign, word in SIGNS.items():
                if getattr(part, sign, None) is not None:
                    yield f"{word} {getattr(part, sign):g}"


# --------------------------------------------------------------------------------------------------------------- laws


def laws(known: dict[str, type]) -> str:
    """Parameters and settings of every law."""
    return "\n\n".join(law(name, kind) for name, kind in known.items())


def law(name: str, kind: type) -> str:
    """One law: what it is, and its parameters."""
    optional = defaults(kind)
    rows = [
        (f"`{key}`", p.unit, shown(optional[key]) if key in optional else "required", bound(p), p.meaning, p.source)
        for key, p in described(kind).items()
    ]
    for key, field in settings(kind).items():
        chosen = field.metadata["setting"]
        default = "required" if field.default is MISSING else shown(field.default)
        rows.append((f"`{key}`", "", default, schema.accepted_setting(kind, key), chosen.meaning, chosen.source))
    first = (kind.__doc__ or "").strip().partition("\n\n")[0].replace("\n", " ")
    head = ("parameter", "unit", "default", "accepted", "meaning", "source")
    return f"### `{name}`\n\n{first}\n\n" + (markdown_table(head, rows) if rows else "No parameters.")


def described(kind: type) -> dict[str, Any]:
    """Parameters that are numbers; a law of joints may hold other things, such as a law of friction."""
    own = {f.name for f in fields(kind) if "parameter" in f.metadata}
    return {key: p for key, p in describe(kind).items() if key in own}


def bound(p: Any) -> str:
    """Bounds of a parameter in words."""
    words = [] if p.lower == -inf else [f"{'>' if p.strict else '≥'} {p.lower:g}"]
    words += [] if p.upper == inf else [f"≤ {p.upper:g}"]
    words += [f"≥ `{p.at_least}`"] if p.at_least else []
    return ", ".join(words) or "any"


# ------------------------------------------------------------------------------------------------------------- causes


def causes() -> str:
    """Parameters of every cause, with bounds and the value that changes nothing, on the paper's beam."""
    rig, rows = paper_rig(), []
    for name, kind in CAUSES.items():
        candidate = next(iter(candidates_of(kind, rig)), None)
        for unknown in () if candidate is None else candidate.unknowns(rig):
            neutral = "shapes the effect" if isnan(unknown.neutral) else number(unknown.neutral)
            span = f"{number(unknown.lower)} to {number(unknown.upper)}"
            rows.append((f"`{name}`", f"`{unknown.name}`", unknown.unit, neutral, span))
    return markdown_table(("cause", "parameter", "unit", "neutral value", "bounds"), rows)


def causes_of_joints() -> str:
    """Parameters of every joint that may be missing, with bounds in the sizes that a rig gives them."""
    rows = []
    for kind in JOINT_CAUSES:
        for n in kind.numbers:
            lower = -WIDEST if n.signed else 1.0 / WIDEST if n.shapes else 0.0
            neutral = "shapes the effect" if n.shapes else "0"
            size = size_of(n)
            span = f"{number(lower)} to {number(WIDEST)}" + f" times {size}" * (size != "1")
            rows.append((f"`{kind.name}`", f"`{n.name}`", n.unit, neutral, span))
    return markdown_table(("cause", "parameter", "unit", "neutral value", "bounds"), rows)


def size_of(n: Number) -> str:
    """The unit that force, amplitude and frequency give a number of a joint.

    >>> from models.causes.joints import LocalDamper
    >>> size_of(LocalDamper.numbers[0])
    'F/(A ω)'
    """
    powers = dict(zip("FAω", n.powers, strict=True))
    above, below = (
        [symbol + (SUPERSCRIPTS[abs(p)] if abs(p) > 1 else "") for symbol, p in powers.items() if sign * p > 0]
        for sign in (1, -1)
    )
    under = f"({' '.join(below)})" if len(below) > 1 else "".join(below)
    return (" ".join(above) or "1") + f"/{under}" * bool(below)


def number(value: float) -> str:
    """A number with four digits."""
    return ("∞" if value > 0 else "-∞") if isinf(value) else f"{value:.4g}"


# ----------------------------------------------------------------------------------------------------------- commands


def commands() -> str:
    """Help of every command, its example as code."""
    group = typer.main.get_command(app)
    text = get_docs_for_click(obj=group, ctx=group.make_context("hbm", [], resilient_parsing=True), name="hbm")
    every = text[text.index("\n## ") :]  # what comes before it lists them, cut short
    return re.sub(r"^Example:  (.*)$", r"Example: `\1`", every, flags=re.M)


TABLES: dict[str, Callable[[], str]] = {f"keys of {name}": partial(keys, name) for name in SCHEMAS}
TABLES |= {
    "friction laws": partial(laws, LAWS),
    "joint laws": partial(laws, JOINT_LAWS),
    "causes": causes,
    "causes of joints": causes_of_joints,
    "commands": commands,
}
"""What the markers of pages stand for."""
