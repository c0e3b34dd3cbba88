"""Rig files with ``[[joints]]``: any body, any number of joints; a checked :class:`models.jointed.JointedRig` out."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, Discriminator, Field, Tag, create_model
from pydantic_core import PydanticCustomError

from hbm.errors import InputError, visible
from hbm.rigfiles.damping import damped_twice, damping_of
from hbm.rigfiles.laws import Consent, accepted_laws, find_law
from hbm.rigfiles.matrixbody import MatrixTable, Shown, in_its_file, matrix_body
from hbm.rigfiles.quantities import Force, NonNegative, Positive, Shape, possible
from hbm.rigfiles.schema import (
    MOST_CHANNELS,
    MOST_MODES,
    PRINTABLE,
    BeamTable,
    ChannelName,
    Complaint,
    DampingTable,
    Key,
    Table,
    complaints_of,
    dotted,
    found,
    law_table,
    ranked,
)
from models import LAWS, Beam, Channel, Excitation
from models.bodies.finite import End, FiniteBeam
from models.bodies.laden import LumpedMass
from models.bodies.modal import ModalModel
from models.bodies.ported import Body
from models.jointed import AnyRig, JointedRig, places_of
from models.joints import JOINT_LAWS, Friction, Joint
from models.parts import Quantity

AnyKind = TypeVar("AnyKind", bound=AnyRig)

BODIES = ("beam", "modal", "matrix")
"""Tables that say what vibrates."""

EVERY_LAW = {**LAWS, **JOINT_LAWS}
"""Laws that a joint may have by their names."""

FreeFrequency = Annotated[NonNegative, possible("frequencies_hz")]
Place = Annotated[str, Field(min_length=1, pattern=PRINTABLE)]
Places = Annotated[
    Annotated[Place, Tag("text")] | Annotated[list[Place], Field(min_length=1), Tag("array")],
    Discriminator(lambda found: "array" if isinstance(found, list) else "text"),
]


class HeldBeamTable(BeamTable):
    """``[beam]`` with joints: how its ends are held."""

    root: End = "clamped"
    tip: End = "supported"


Deviations = Annotated[list[NonNegative], Field(max_length=MOST_MODES)]
MATRICES = {"damping_matrix": "mode", "flexibility": "port"}
"""Symmetric matrices of ``[modal]``, and what they have a row for each of."""


class TolerancesTable(Table):
    """``[modal.tolerances]``: one standard deviation of each number of each mode, in its unit; 0 of what is exact."""

    frequencies_hz: Deviations = Field(default_factory=list)
    modal_ratios: Deviations = Field(default_factory=list)
    damping_matrix: Annotated[list[Deviations], Field(max_length=MOST_MODES)] = Field(default_factory=list)
    flexibility: list[list[NonNegative]] = Field(default_factory=list)
    ports: dict[Shown, Deviations] = Field(default_factory=dict)

    @property
    def rows(self) -> dict[Key, list[float]]:
        """Deviations by mode, or by port of a flexibility, under the key of each row that is given."""
        rows: dict[Key, list[float]] = {("ports", port): row for port, row in self.ports.items()}
        rows |= {(name, i): row for name in MATRICES for i, row in enumerate(getattr(self, name))}
        rows |= {("frequencies_hz",): self.frequencies_hz, ("modal_ratios",): self.modal_ratios}
        return {key: row for key, row in rows.items() if row}


class PortedModalTable(Table):
    """``[modal]`` with joints, the arguments of :class:`models.bodies.modal.ModalModel`."""

    frequencies_hz: Annotated[list[FreeFrequency], Field(min_length=1, max_length=MOST_MODES)]
    ports: dict[Shown, list[Shape]] = Field(default_factory=dict)
    shapes: list[list[Shape]] = Field(default_factory=list)
    excitation_shape: list[Shape] | None = None
    flexibility: list[list[float]] | None = None
    damping_matrix: list[list[float]] | None = None
    reactions: dict[Shown, list[Shape]] = Field(default_factory=dict)
    shares: dict[Shown, list[Shape]] = Field(default_factory=dict)
    tolerances: TolerancesTable | None = None


def _pair(row: list[float]) -> list[float]:
    if len(row) != 2:
        raise PydanticCustomError("pair", "must be two numbers, a level and the force per unit there")
    return row


class PlacedExcitationTable(Table):
    """``[excitation]`` of a rig with joints: its place, or its position on a beam."""

    amplitude: Force
    at: Place | None = None
    position: NonNegative | None = None
    force_gain: list[Annotated[list[Positive], AfterValidator(_pair)]] = Field(default_factory=list)


class PlacedChannelTable(Table):
    """An entry of ``[[channels]]`` of a rig with joints."""

    name: ChannelName
    quantity: Quantity
    at: Place | None = None
    position: NonNegative | None = None
    repeatability: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class MassTable(Table):
    """An entry of ``[[masses]]`` of a rig with joints, the arguments of :class:`models.bodies.laden.LumpedMass`."""

    at: Place
    mass: Annotated[NonNegative, possible("kg")]


class JointedRigTable(Table):
    """A rig file with ``[[joints]]``."""

    name: str
    beam: HeldBeamTable | None = None
    modal: PortedModalTable | None = None
    matrix: MatrixTable | None = None
    damping: DampingTable = DampingTable()
    joints: list[dict[str, Any]] = Field(default_factory=list)
    masses: list[MassTable] = Field(default_factory=list)
    excitation: PlacedExcitationTable
    channels: list[PlacedChannelTable] = Field(default_factory=list, max_length=MOST_CHANNELS)
    extensions: list[dict[str, Any]] = Field(default_factory=list)


DRIVE = "excitation"
"""Port of the excitation where its shape is given beside those of the channels."""

PRESSED = ("normal_load", "normal_stiffness", "reference_load")
"""Keys of what presses a friction law."""


@cache
def joint_table(law: type) -> type[Table]:
    """Schema of an entry of ``[[joints]]`` for one law: a law of joints, or of friction with what presses it."""
    entries: dict[str, Any] = {"name": (ChannelName, ...), "at": (Places, ...), "to": (Places | None, None)}
    if law not in JOINT_LAWS.values():
        entries |= {
            "normal_load": (Annotated[float, Field(allow_inf_nan=False), possible("normal_load")], ...),
            "normal_stiffness": (Annotated[Positive, possible("N/m")] | None, None),
            "reference_load": (Annotated[Positive, possible("normal_load")] | None, None),
            "loaded_by": (str, ""),
        }
    return create_model(f"{law.__name__}JointTable", __base__=law_table(law), **entries)


def is_jointed(table: Mapping[str, Any]) -> bool:
    """Whether a rig file is of a rig with joints, of any number of them, rather than with one contact."""
    return "joints" in table or "matrix" in table or ("modal" in table and not {"contact", "beam"} & table.keys())


def with_extensions(rig: AnyKind, tables: Sequence[Mapping[str, Any]], folder: Path, consent: Consent) -> AnyKind:
    """As :func:`hbm.rigfiles.extensions.rig_of_tables`, whose catalogue of causes few files need."""
    if not tables:
        return rig
    from hbm.rigfiles.extensions import rig_of_tables

    return rig_of_tables(rig, tables, folder, consent)


def jointed_rig(table: Mapping[str, Any], source: str, consent: Consent = Consent.NONE) -> JointedRig:
    """Make a rig with joints of the tables of a rig file.

    Parameters
    ----------
    table : mapping
        Tables of a rig file, as :func:`tomllib.load` returns them.
    source : str
        Name of the file, for messages; files that it names are looked for beside it.
    consent : Consent
        Which Python files that it names may be run.

    Raises
    ------
    InputError
        If something in the tables, or in a file that they name, is not accepted.
    """
    folder = Path(source).parent
    complaint = min(_complaints(table, folder, consent), key=lambda c: ranked(table, c.key), default=None)
    if complaint is not None:
        raise InputError(f"{source}: {complaint}")
    file = _at_ports(JointedRigTable.model_validate(table))
    for complaint in (*descents(file.modal.frequencies_hz if file.modal else ()), *damped_twice(file.damping)):
        raise InputError(f"{source}: {complaint}")
    try:
        joints = tuple(_joint(entry, folder, consent) for entry in file.joints)
        force = Excitation(**_placed(file.excitation, "force_gain"), force_gain=_pairs(file.excitation.force_gain))
        channels = tuple(Channel(**_placed(channel)) for channel in file.channels)
        masses = tuple(LumpedMass(**lump.model_dump()) for lump in file.masses)
        places = places_of(joints, force, [c for c in channels if c.quantity != "force"], masses)
        body = _body(file, folder, places)
        rig = JointedRig(visible(file.name), body, damping_of(file.damping), joints, force, channels, masses=masses)
        if file.modal is not None and file.modal.tolerances is not None:
            rig = replace(rig, tolerances=_tolerances(rig, file.modal.ports, file.modal.tolerances))
        return with_extensions(rig, file.extensions, folder, consent)
    except ValueError as refused:
        raise InputError(f"{source}: {in_its_file(str(refused), file.matrix)}") from None


def _at_ports(file: JointedRigTable) -> JointedRigTable:
    """The same where rows of shapes are ports: each of its channel's name, that of the force of "excitation"."""
    if file.modal is None:
        return file
    ports, excitation, channels = dict(file.modal.ports), file.excitation, list(file.channels)
    for i, row in enumerate(file.modal.shapes):
        channel = channels[i]
        if channel.at is None and channel.quantity != "force":
            ports.setdefault(channel.name, row)
            channels[i] = channel.model_copy(update={"at": channel.name})
    if file.modal.excitation_shape is not None and excitation.at is None:
        ports.setdefault(DRIVE, file.modal.excitation_shape)
        excitation = excitation.model_copy(update={"at": DRIVE})
    modal = file.modal.model_copy(update={"ports": ports})
    return file.model_copy(update={"modal": modal, "excitation": excitation, "channels": channels})


def _complaints(table: Mapping[str, Any], folder: Path, consent: Consent) -> Iterator[Complaint]:
    if "contact" in table:  # before the schema, which knows no such key
        what = f"and {'joints' if 'joints' in table else 'matrix'} are both present"
        yield Complaint(("contact",), what, "must have one of them; a contact is a joint")
    yield from complaints_of(JointedRigTable, table, ())
    given = [name for name in BODIES if name in table]
    if len(given) != 1:
        what = "is missing" if not given else f"and {given[1]} are both present"
        yield Complaint((given[0] if given else "beam",), what, "must have one of [beam], [modal], [matrix]")
    for body, matrix in (("matrix", "damping"), ("modal", "damping_matrix")):
        if "damping" in table and isinstance(own := table.get(body), dict) and matrix in own:
            what = f"and {body}.{matrix} are both present"
            yield Complaint(("damping",), what, "must have one of them")
    joints = table.get("joints")
    for i, entry in enumerate(joints if isinstance(joints, list) else []):
        if isinstance(entry, dict):
            yield from _of_joint(entry, i, folder, consent)
    yield from _placed_twice(table)
    if "matrix" in table or "modal" in table:
        yield from _of_places(table)
    if isinstance(modal := table.get("modal"), dict) and "shapes" in modal:
        yield from _of_shapes(modal, table.get("channels"))


def descents(frequencies_hz: Sequence[float]) -> Iterator[Complaint]:
    """Complaints about natural frequencies of ``[modal]`` that are below the one before."""
    for i, (lower, upper) in enumerate(pairwise(frequencies_hz)):
        if upper < lower:
            yield Complaint(("modal", "frequencies_hz", i + 1), found(upper), f"must be >= the one before, {lower}")


def _of_joint(entry: dict[str, Any], i: int, folder: Path, consent: Consent) -> Iterator[Complaint]:
    key, name = ("joints", i, "law"), entry.get("law")
    if not isinstance(name, str):
        yield Complaint(key, "is missing" if name is None else found(name), f"must be {accepted_laws(EVERY_LAW)}")
        return
    try:
        law = _law_of(name, folder, consent)
    except InputError as refused:
        yield Complaint(key, found(name), str(refused))
        return
    yield from complaints_of(joint_table(law), entry, ("joints", i))


def _placed_twice(table: Mapping[str, Any]) -> Iterator[Complaint]:
    for what, entries in (("excitation", [table.get("excitation")]), ("channels", table.get("channels"))):
        for i, entry in enumerate(entries if isinstance(entries, list) else []):
            if isinstance(entry, dict) and {"at", "position"} <= entry.keys():
                key = (what, "position") if what == "excitation" else (what, i, "position")
                yield Complaint(key, "and at are both present", "must have one of them")


def _of_places(table: Mapping[str, Any]) -> Iterator[Complaint]:
    """Complaints about places that are missing, on a body that names its places."""
    excitation, channels, modal = table.get("excitation"), table.get("channels"), table.get("modal", {})
    own = modal if isinstance(modal, dict) else {}
    if isinstance(excitation, dict) and "at" not in excitation and "excitation_shape" not in own:
        yield Complaint(("excitation", "at"), "is missing", "must name a place of the body")
    for i, channel in enumerate(channels if isinstance(channels, list) and "shapes" not in own else []):
        if isinstance(channel, dict) and channel.get("quantity") != "force" and "at" not in channel:
            yield Complaint(("channels", i, "at"), "is missing", "must name a place of the body")


def _of_shapes(modal: dict[str, Any], channels: Any) -> Iterator[Complaint]:
    """Complaints about rows of shapes that are not one per channel."""
    shapes, n = modal["shapes"], len(channels) if isinstance(channels, list) else 0
    if isinstance(shapes, list) and len(shapes) != n:
        yield Complaint(("modal", "shapes"), f"has {len(shapes)} rows", f"must have {n}, one per [[channels]] entry")


def _tolerances(rig: JointedRig, ports: Collection[str], stated: TolerancesTable) -> dict[str, float]:
    """What is stated, by the keys of numbers of the rig; relative, but of numbers that are 0."""
    known, out = rig.numbers, dict[str, float]()
    if foreign := next((port for port in stated.ports if port not in ports), None):
        unknown = dotted(("modal", "tolerances", "ports", foreign))
        raise ValueError(f"{unknown} is unknown; ports are {', '.join(ports) or 'none'}")
    sizes = {"mode": rig.structure.n, "port": len(ports)}
    for name, each in MATRICES.items():
        matrix: list[list[float]] = getattr(stated, name)
        if matrix and len(matrix) != sizes[each]:
            rows = f"has {len(matrix)} rows"
            raise ValueError(f"modal.tolerances.{name} {rows}; must have {sizes[each]}, one per {each}")
    for key, row in stated.rows.items():
        where = dotted(("modal", "tolerances", *key))
        each = MATRICES.get(str(key[0]), "mode")
        if len(row) != sizes[each]:
            raise ValueError(f"{where} has {len(row)} entries; must have {sizes[each]}, one per {each}")
        table = "damping" if key == ("modal_ratios",) else "modal"
        of_row = "".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in key)
        for i, std in enumerate(row, 1):
            number = f"{table}{of_row}[{i}]"
            if key[0] in MATRICES and i <= int(key[1]):  # below the diagonal
                if std != getattr(stated, key[0])[i - 1][int(key[1])]:
                    raise ValueError(f"{where}[{i}] = {std:g}; must be as [{i}][{int(key[1]) + 1}], it is symmetric")
            elif number in known:
                out[number] = std / (abs(known[number][0]) or 1.0)
            elif std > 0.0:
                raise ValueError(f"{where}[{i}] = {std:g}; must be 0, for {number} is no number of the rig")
    return out


def _law_of(name: str, folder: Path, consent: Consent) -> type:
    return find_law(name, folder, consent, EVERY_LAW)


def _joint(entry: dict[str, Any], folder: Path, consent: Consent) -> Joint:
    kind = _law_of(entry["law"], folder, consent)
    values = joint_table(kind).model_validate(entry).model_dump(exclude={"law"})
    name, at, to = values.pop("name"), _listed(values.pop("at")), _listed(values.pop("to"))
    loaded_by = values.pop("loaded_by", "")
    own = kind in JOINT_LAWS.values()
    pressed = {} if own else {key: values.pop(key) for key in PRESSED}
    law = kind(**{key: tuple(v) if isinstance(v, list) else v for key, v in values.items()})
    return Joint(name, law if own else _friction(name, law, pressed), at, to, loaded_by)


def _friction(name: str, law: Any, pressed: Mapping[str, float | None]) -> Friction:
    try:
        return Friction(law, **pressed)
    except ValueError as refused:
        raise ValueError(f"joint {name}: {refused}") from None


def _listed(places: str | list[str] | None) -> tuple[str, ...]:
    return () if places is None else (places,) if isinstance(places, str) else tuple(places)


def _pairs(rows: list[list[float]]) -> tuple[tuple[float, float], ...]:
    return tuple((one, other) for one, other in rows)


def _placed(what: PlacedExcitationTable | PlacedChannelTable, *but: str) -> dict[str, Any]:
    values = what.model_dump(exclude=set(but))
    return values | {"at": values["at"] or "", "position": values["position"] or 0.0}


def _body(file: JointedRigTable, folder: Path, places: Sequence[str]) -> Body:
    if file.beam is not None:
        values = file.beam.model_dump()
        root, tip = values.pop("root"), values.pop("tip")
        return FiniteBeam(Beam(**values), root, tip)
    if file.modal is not None:
        return _modal(file.modal)
    if file.matrix is None:
        raise ValueError("no body")
    return matrix_body(file.matrix, folder, places)


def _modal(modal: PortedModalTable) -> ModalModel:
    def rows(values: list[list[float]] | None) -> tuple[tuple[float, ...], ...] | None:
        return None if values is None else tuple(map(tuple, values))

    return ModalModel(
        frequencies_hz=tuple(modal.frequencies_hz),
        ports={name: tuple(row) for name, row in modal.ports.items()},
        flexibility=rows(modal.flexibility),
        damping_matrix=rows(modal.damping_matrix),
        reactions={name: tuple(row) for name, row in modal.reactions.items()},
        shares={name: tuple(row) for name, row in modal.shares.items()},
    )
