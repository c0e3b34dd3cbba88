"""Extended rigs: the ``[[extensions]]`` tables of a rig file, each a cause of the catalogue and its parameters.

Applied in their order, each to the rig that the ones before it made.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, NoReturn, TypeVar, get_type_hints

from hbm.errors import InputError
from hbm.rigfiles.causes import ONE_VALUE, accepted_causes, find_cause
from hbm.rigfiles.laws import Consent
from hbm.rigfiles.schema import MOST_ENTRIES, Complaint, found
from models.causes import Cause, Unknown, candidates_of
from models.causes.addedjoint import AddedJoint, naming
from models.causes.parameter import WrongParameter
from models.jointed import AnyRig, JointedRig
from models.plausible import impossible, of_parameter

CHOICES: dict[Any, tuple[Any, str]] = {
    float: ((float, int), "a number"),
    int: (int, "a whole number"),
    str: (str, "a text in quotes"),
}
"""Types that a field of a cause may have."""

AnyKind = TypeVar("AnyKind", bound=AnyRig)

MOST_NAMED = 40
"""So many candidates are listed in a message."""


@dataclass(frozen=True)
class Extension:
    """One cause with its parameters.

    Attributes
    ----------
    named : str
        The cause as rig files name it: of docs/reference/causes.md, or ``file.py:Class``.
    cause : Cause
    values : mapping of str to float
        By the names of the cause's unknowns.
    """

    named: str
    cause: Cause
    values: Mapping[str, float]

    @staticmethod
    def of(cause: Cause, values: Mapping[str, float], named: str = "") -> "Extension":
        """An extension by a cause, of the catalogue unless `named` says otherwise."""
        return Extension(named or (cause.label if cause.name == "parameter" else cause.name), cause, dict(values))

    def table(self) -> dict[str, Any]:
        """Its table in a rig file; choices that are as they are by default are left out."""
        chosen = {} if self.named.startswith(ONE_VALUE) else _choices(self.cause)
        return {"cause": self.named, **chosen, **self.values}


def _choices(cause: Cause) -> dict[str, Any]:
    """Fields of a cause, such as its channel."""
    every = {f.name: (getattr(cause, f.name), f.default) for f in fields(cause)}  # type: ignore[arg-type]
    return {name: value for name, (value, default) in every.items() if value != default}


def extended(rig: AnyRig, extensions: Sequence[Extension]) -> AnyRig:
    """A rig with extensions, one after the other."""
    for extension in extensions:
        rig = extension.cause.extend(rig, extension.values)
    return rig


def rig_of_tables(
    rig: AnyKind, tables: Sequence[Mapping[str, Any]], folder: Path, consent: Consent = Consent.NAMED
) -> AnyKind:
    """The rig that the ``[[extensions]]`` tables of its file make of a nominal one.

    Parameters
    ----------
    rig : Rig
        Nominal.
    tables : sequence of mappings
    folder : Path
        Where the file of a cause of one's own is looked for.
    consent : Consent
        Whether it may be run.

    Raises
    ------
    InputError
        If a table is not accepted; the message does not say in which file.
    """
    stages = [rig]
    for i, table in enumerate(tables):
        extension = _read(stages, table, i, folder, consent)
        rig = extension.cause.extend(rig, extension.values)
        stages.append(rig)
        for low, other in rig.too_low:
            name, least = (key.rpartition(".")[2] for key in (low, other))
            _refuse(i, name, found(rig.number(low)), f"must be >= {least} = {rig.number(other)}")
    return rig


def _read(stages: Sequence[AnyRig], table: Mapping[str, Any], i: int, folder: Path, consent: Consent) -> Extension:
    """One table as an extension of the last of the rigs that those before it made."""
    rig, named = stages[-1], table.get("cause")
    if not isinstance(named, str):
        _refuse(i, "cause", found(named) if "cause" in table else "is missing", f"must be {accepted_causes()}")
    try:
        kind = find_cause(named, folder, consent)
    except InputError as refused:
        _refuse(i, "cause", found(named), str(refused))
    chosen = {"key": named.removeprefix(ONE_VALUE)} if named.startswith(ONE_VALUE) else _chosen(kind, table, i)
    cause = kind(**chosen)
    unknowns = _of_joints(rig, cause)
    if not unknowns:
        _check_candidate(stages, cause, i, named)
        unknowns = cause.unknowns(rig)
    known = ["cause", *(f.name for f in fields(kind) if not named.startswith(ONE_VALUE)), *(u.name for u in unknowns)]
    for name in table:
        if name not in known:
            _refuse(i, name, "is unknown", f"accepted keys are {', '.join(known)}")
    return Extension(named, cause, {u.name: _value(u, table, i) for u in unknowns})


def _of_joints(rig: AnyRig, cause: Cause) -> tuple[Unknown, ...]:
    """The value of a number of a rig with joints: any, whatever it was.

    Calibration moves shapes that are hardly known through zero, and those of a place that only a cause touches.
    """
    if not (isinstance(cause, WrongParameter) and isinstance(rig, JointedRig) and cause.key in rig.numbers):
        return ()
    now, accepted = rig.numbers[cause.key]
    return (Unknown("value", accepted.unit, cause.key, accepted.lower, accepted.upper, now, (now,)),)


def _chosen(kind: type, table: Mapping[str, Any], i: int) -> dict[str, Any]:
    """Fields of a cause, such as its channel, as its table gives them."""
    chosen, hints = {}, get_type_hints(kind)
    for f in fields(kind):
        if f.name in table:
            value, (accepted, words) = table[f.name], CHOICES[hints[f.name]]
            if isinstance(value, bool) or not isinstance(value, accepted):
                _refuse(i, f.name, found(value), f"must be {words}")
            if not isinstance(value, str) and not (math.isfinite(value) and 0 < value <= MOST_ENTRIES):
                _refuse(i, f.name, found(value), f"must be > 0 and <= {MOST_ENTRIES}")
            chosen[f.name] = value
        elif f.default is MISSING:
            _refuse(i, f.name, "is missing", f"{table['cause']} needs it")
    return chosen


def _check_candidate(stages: Sequence[AnyRig], cause: Cause, i: int, named: str) -> None:
    """Whether a cause can be one of a rig: a second joint at a place, of that before the first was there."""
    possible = list[Cause]()
    for rig in stages if isinstance(cause, AddedJoint) else stages[-1:]:
        possible = list(candidates_of(type(cause), rig))
        if any(_alike(cause, other) for other in (*possible, *_elsewhere(cause, rig))):
            return
    listed = ", ".join(other.label for other in possible[:MOST_NAMED]) + ", ..." * (len(possible) > MOST_NAMED)
    accepted = f"must be one of {listed}" if possible else "there is nothing in this rig that it can act on"
    _refuse(i, "cause", f"{found(named)} ({cause.label}) does not apply", accepted)


def _elsewhere(cause: Cause, rig: AnyRig) -> Iterable[Cause]:
    """A joint and others of its kind at places of the body that the rig does not name."""
    if isinstance(cause, AddedJoint) and isinstance(rig, JointedRig):
        with suppress(ValueError):
            return type(cause).candidates(naming(rig, (cause.at.removeprefix("-1*"), cause.to)))
    return ()


def _alike(cause: Cause, other: Cause) -> bool:
    """Whether a cause is another one of its kind; a joint is the same either way round."""
    if isinstance(cause, AddedJoint) and isinstance(other, AddedJoint):
        return other.way((cause.at, cause.to)) != 0.0
    return cause.label == other.label


def _value(unknown: Unknown, table: Mapping[str, Any], i: int) -> float:
    """Value of a parameter, within its bounds."""
    bounds = f"must be >= {unknown.lower:g}" + f" and <= {unknown.upper:g}" * math.isfinite(unknown.upper)
    if unknown.name not in table:
        _refuse(i, unknown.name, "is missing", bounds)
    value = table[unknown.name]
    if isinstance(value, bool) or not isinstance(value, int | float):
        _refuse(i, unknown.name, found(value), "must be a number")
    if isinstance(value, int):
        value = _real(value)
    if not (math.isfinite(value) and unknown.lower <= value <= unknown.upper):
        _refuse(i, unknown.name, found(value), bounds if math.isfinite(value) else "must be finite")
    if (accepted := impossible(of_parameter(unknown.name, unknown.unit), value)) is not None:
        _refuse(i, unknown.name, found(value), accepted)
    return float(value)


def _real(whole: int) -> float:
    """A whole number of any length as a real one, infinite beyond the largest."""
    try:
        return float(whole)
    except OverflowError:
        return math.inf if whole > 0 else -math.inf


def _refuse(i: int, name: str, what: str, accepted: str) -> NoReturn:
    raise InputError(str(Complaint(("extensions", i, name), what, accepted)))
