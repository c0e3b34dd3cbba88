"""Rig files: TOML in, a complete and checked :class:`models.Rig` out.

A file may have several faults. The first is told: first the departures from the tables of
:mod:`hbm.rigfiles.schema`, in the order of the file, then the entries that contradict each other.
"""

import re
import tomllib
import warnings
from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from hbm.errors import InputError, visible
from hbm.rigfiles.damping import damped_twice, damping_of
from hbm.rigfiles.joints import descents, is_jointed, jointed_rig, with_extensions
from hbm.rigfiles.laws import Consent, find_law
from hbm.rigfiles.schema import (
    BeamContactTable,
    BeamRig,
    Complaint,
    ContactTable,
    DampingTable,
    Key,
    ModalRig,
    ModalTable,
    Table,
    dotted,
    first_complaint,
    found,
    law_table,
    root_schema,
)
from models import Beam, Channel, Contact, Excitation, FrictionLaw, ModalBody, Rig, describe
from models.friction import settings
from models.jointed import AnyRig
from models.plausible import PlausibilityWarning, doubts, quiet, told

MOST_BYTES = 4_000_000
"""Of a rig file; one of this size has shapes of some hundred modes at some hundred places."""


def load_rig(path: str | PathLike[str], *, allow_code: bool | None = None) -> AnyRig:
    """Read a rig file.

    Parameters
    ----------
    path : str or path
        TOML file, docs/reference/rig_files.md.
    allow_code : bool, optional
        Whether the Python files that it names, ``file.py:Class``, may be run, of those in its folder. Where omitted,
        only if the environment variable ``HBM_ALLOW_CODE`` is 1: reading a file that somebody sent must not run
        what they wrote.

    Returns
    -------
    Rig or JointedRig
        JointedRig if the file has ``[[joints]]``, ``[matrix]``, or ``[modal]`` without ``[contact]``.

    Raises
    ------
    InputError
        If the file cannot be read or says something that is not accepted.

    Warns
    -----
    models.plausible.PlausibilityWarning
        Of numbers that look like another unit, or out of proportion to others.
    """
    source = str(path)
    table = _parse(_read(Path(path), source), source)
    with quiet():
        rig = rig_of_table(table, source, Consent.of_data(allow_code))
    doubtful = doubts(rig.quantities, rig.proportions)
    told(doubtful)
    for said in doubtful.values():
        warnings.warn(f"{source}: {said}", PlausibilityWarning, stacklevel=2)
    return rig


def rig_of_table(table: Mapping[str, Any], source: str, consent: Consent = Consent.NONE) -> AnyRig:
    """Make a rig of either kind of the tables of a rig file; arguments and errors as of :func:`rig_from_dict`."""
    return (jointed_rig if is_jointed(table) else rig_from_dict)(table, source, consent)


def load_contact_rig(path: str | PathLike[str], where: str, *, allow_code: bool | None = None) -> Rig:
    """Read a rig file with ``[contact]``, for what knows no other joints.

    Raises
    ------
    InputError
        As :func:`load_rig`, and if the file has no ``[contact]``.
    """
    rig = load_rig(path, allow_code=allow_code)
    if not isinstance(rig, Rig):
        found = "has [[joints]]" if rig.joints else "has no [contact]"
        raise InputError(f"{path}: {found}; {where} needs a rig with [contact]")
    return rig


def rig_from_dict(table: Mapping[str, Any], source: str, consent: Consent = Consent.NONE) -> Rig:
    """Make a rig of the tables of a rig file.

    Parameters
    ----------
    table : mapping
        Tables of a rig file, as :func:`tomllib.load` returns them.
    source : str
        Name of the file, for messages; the file of a law of one's own is looked for beside it.
    consent : Consent
        Which Python files that it names may be run.

    Raises
    ------
    InputError
        If something in the tables is not accepted.
    """
    table = dict(table)
    if not table:
        raise InputError(f"{source}: is empty; must have name, beam or modal, damping, contact, excitation")
    folder = Path(source).parent
    if complaint := first_complaint(table, folder, consent):
        raise InputError(f"{source}: {complaint}")
    file = root_schema(table).model_validate(table)
    kind = find_law(file.contact.friction["law"], folder, consent)
    law = law_table(kind).model_validate(file.contact.friction)
    for complaint in _contradictions(file, kind, law):
        raise InputError(f"{source}: {complaint}")
    try:
        return with_extensions(_rig(file, _law(kind, law)), file.extensions, folder, consent)
    except InputError as refused:
        raise InputError(f"{source}: {refused}") from None


def _read(path: Path, source: str) -> str:
    try:
        if (size := path.stat().st_size) > MOST_BYTES:
            accepted = f"must be <= {MOST_BYTES / 1e6:g} MB, a rig file (TOML); matrices stand in files of their own"
            raise InputError(f"{source}: {size / 1e6:.3g} MB; {accepted}")
        content = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{source}: no such file; must be a rig file (TOML)") from None
    except IsADirectoryError:
        raise InputError(f"{source}: is a directory; must be a rig file (TOML)") from None
    except OSError as refused:
        raise InputError(f"{source}: cannot be read ({refused.strerror}); must be a rig file (TOML)") from None
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as bad:
        line = content.count(b"\n", 0, bad.start) + 1
        raise InputError(f"{source} line {line}: byte 0x{content[bad.start]:02x}; must be UTF-8 text") from None


def _parse(text: str, source: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as malformed:
        what, _, at = str(malformed).rpartition(" (at ")
        line = re.search(r"line (\d+)", at)
        number = line[1] if line else text.rstrip().count("\n") + 1
        raise InputError(f"{source} line {number}: {what[:1].lower()}{what[1:]}; must be TOML") from None
    except (ValueError, RecursionError):  # integers of thousands of digits, arrays nested thousands deep
        raise InputError(f"{source}: a number too long or arrays too deep to read; must be a rig file (TOML)") from None


# ------------------------------------------------------------------------------ entries that contradict each other


def _contradictions(file: BeamRig | ModalRig, kind: type, law: Table) -> Iterator[Complaint]:
    if isinstance(file, ModalRig):
        yield from _of_modes(file.modal, channels=len(file.channels))
    modes = file.beam.modes if isinstance(file, BeamRig) else len(file.modal.frequencies_hz)
    yield from _of_damping(file.damping, modes)
    yield from _of_law(kind, law)
    if isinstance(file, BeamRig):
        yield from _of_positions(file)
        yield from _of_lift(file.contact)
    yield from _of_channels(file.channels)


def _of_modes(modal: ModalTable, channels: int) -> Iterator[Complaint]:
    n = len(modal.frequencies_hz)
    yield from descents(modal.frequencies_hz)
    yield from _of_length(("modal", "shapes"), modal.shapes, channels, "one row per [[channels]] entry in order")
    for i, row in enumerate(modal.shapes):
        yield from _of_length(("modal", "shapes", i), row, n, "one per mode")
    yield from _of_length(("modal", "contact_shape"), modal.contact_shape, n, "one per mode")
    yield from _of_length(("modal", "excitation_shape"), modal.excitation_shape, n, "one per mode")


def _of_length(key: Key, entries: list[Any], n: int, why: str) -> Iterator[Complaint]:
    if len(entries) != n:
        yield Complaint(key, _has(entries), f"must have {n}, {why}")


def _has(entries: list[Any]) -> str:
    return f"has {len(entries)} {'entry' if len(entries) == 1 else 'entries'}"


def _of_damping(damping: DampingTable, modes: int) -> Iterator[Complaint]:
    if damping.modal_ratios is None:
        if damping.mass_proportional is None:
            yield Complaint(("damping", "mass_proportional"), "is missing", "must have it or modal_ratios")
        return
    yield from damped_twice(damping)
    if len(damping.modal_ratios) not in (1, modes):
        accepted = f"must have 1{f', or {modes}, one per mode' * (modes > 1)}"
        yield Complaint(("damping", "modal_ratios"), _has(damping.modal_ratios), accepted)


def _of_law(kind: type, law: Table) -> Iterator[Complaint]:
    table, values = ("contact", "friction"), law.model_dump()
    for name, p in describe(kind).items():
        if p.at_least and values[name] < values[p.at_least]:
            accepted = f"must be >= {p.at_least} = {values[p.at_least]}"
            yield Complaint((*table, name), found(values[name]), accepted)
    for name, f in settings(kind).items():
        for other in f.metadata["setting"].instead_of:
            if {name, other} <= law.model_fields_set:
                both = f"and {dotted((*table, other))} are both present"
                yield Complaint((*table, name), both, "must have one of them")


def _of_positions(file: BeamRig) -> Iterator[Complaint]:
    positions: dict[Key, float] = {("excitation", "position"): file.excitation.position}
    positions |= {("channels", i, "position"): channel.position for i, channel in enumerate(file.channels)}
    for key, x in positions.items():
        if x > file.beam.length:
            yield Complaint(key, found(x), f"must be > 0 and <= beam.length = {file.beam.length}")


def _of_lift(contact: BeamContactTable) -> Iterator[Complaint]:
    for name in ("variable_normal_load", "residual_compliance"):
        if contact.lift_off and not getattr(contact, name):
            yield Complaint(("contact", "lift_off"), found(True), f"must be false, or contact.{name} = true")


def _of_channels(channels: list[Any]) -> Iterator[Complaint]:
    names = [channel.name for channel in channels]
    forces = [i for i, channel in enumerate(channels) if channel.quantity == "force"]
    for i, name in enumerate(names):
        key: Key = ("channels", i, "name")
        if name in Rig.computed:
            yield Complaint(key, found(name), f"must not be one of the computed {', '.join(Rig.computed)}")
        if name in names[:i]:
            yield Complaint(key, found(name), f"must be unique, channels[{names.index(name) + 1}] has it too")
        if i in forces[1:]:
            accepted = f"must not be a second force, channels[{forces[0] + 1}] is the first"
            yield Complaint(("channels", i, "quantity"), found("force"), accepted)


# ------------------------------------------------------------------------------------------------ the rig itself


def _rig(file: BeamRig | ModalRig, law: FrictionLaw) -> Rig:
    return Rig(
        name=visible(file.name),
        body=Beam(**file.beam.model_dump()) if isinstance(file, BeamRig) else _modal_body(file.modal),
        damping=damping_of(file.damping),
        contact=_contact(file.contact, law),
        excitation=Excitation(**file.excitation.model_dump()),
        channels=tuple(Channel(**channel.model_dump()) for channel in file.channels),
    )


def _contact(contact: ContactTable, law: FrictionLaw) -> Contact:
    entries = contact.model_dump(exclude={"friction", "variable_normal_load"})
    return Contact(law=law, load_variation=float(getattr(contact, "variable_normal_load", True)), **entries)


def _modal_body(modal: ModalTable) -> ModalBody:
    return ModalBody(
        frequencies_hz=tuple(modal.frequencies_hz),
        shapes=tuple(map(tuple, modal.shapes)),
        contact_shape=tuple(modal.contact_shape),
        excitation_shape=tuple(modal.excitation_shape),
    )


def _law(kind: type, law: Table) -> FrictionLaw:
    values = law.model_dump(exclude={"law"})
    made: FrictionLaw = kind(**{name: tuple(v) if isinstance(v, list) else v for name, v in values.items()})
    return made
