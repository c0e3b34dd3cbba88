"""Damaged spectra and histories, with one or a few things wrong in each, the same for the same seed.

A mutant keeps the bytes of the file it was made of, its twin. Where nothing was changed that a reader may mind
(line ends, a byte order mark, blanks, comments), it is `neutral`: whatever is computed of it is what its twin gives.
"""

import io
import random
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
SHARED = ROOT.parent / "shared" / "data" / "examples"

CELLS = (
    *("0", "-1", "nan", "inf", "-inf", "1e308", "-1e308", "1e300", "1e-300", "1e-320", "1e30", "1e-30", "1e6", "1e-6"),
    *("", " ", "text", "1,2", '"', '"a', "1e", "0x10", "1_0", "9" * 400, "1.5", "1000", "1001", "[/nope]", "\x00"),
    *("\x1b[31m", "<b>", "a\nb", "é", "+1", " 1 ", "1d3", "True", "None"),
)
"""Entries of a CSV file in place of others."""


@dataclass(frozen=True)
class Mutant:
    """A damaged file.

    Attributes
    ----------
    kind : str
        rig, matrix, spectra or history.
    twin : str
        Path of what it was made of, or its name where it is made here.
    what : str
        What was done to it, in words.
    content : bytes
    ending : str
        Of its file name.
    neutral : bool
        Whether it must give what its twin gives.
    cut : bool
        Whether it is a beginning of its twin.
    """

    kind: str
    twin: str
    what: str
    content: bytes
    ending: str
    neutral: bool = False
    cut: bool = False


Change = tuple[str, bytes]
TextChanges = tuple[Callable[[str, random.Random], Change], ...]


# ------------------------------------------------------------------------------------------------------- any bytes


def flipped(content: bytes, rng: random.Random) -> Change:
    damaged = bytearray(content)
    for _ in range(rng.choice((1, 1, 3, 20))):
        damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
    return "bits flipped", bytes(damaged)


def truncated(content: bytes, rng: random.Random) -> Change:
    kept = rng.choice((0, 1, rng.randrange(len(content)), rng.randrange(len(content)), len(content) - 1))
    return f"cut after {kept} bytes", content[:kept]


def repeated(content: bytes, rng: random.Random) -> Change:
    at, size = rng.randrange(len(content)), rng.choice((1, 100, 5000))
    return f"{size} bytes a second time", content[:at] + content[at : at + size] + content[at:]


def blanked(content: bytes, rng: random.Random) -> Change:
    at, size = rng.randrange(len(content)), rng.choice((1, 8, 200))
    return f"{size} bytes of zero", content[:at] + bytes(min(size, len(content) - at)) + content[at + size :]


def encoded(content: bytes, rng: random.Random) -> Change:
    coding = rng.choice(("utf-16", "utf-16-le", "utf-32", "cp037", "utf-7"))
    return f"written as {coding}", content.decode().encode(coding)


BYTES: tuple[Callable[[bytes, random.Random], Change], ...] = (flipped, truncated, repeated, blanked)


# ------------------------------------------------------------------------------------------------------------- text


def neutral(text: str, rng: random.Random, comments: bool) -> Change:
    """What a reader must not mind."""
    changes = {
        "byte order mark": b"\xef\xbb\xbf" + text.encode(),
        "CRLF": text.replace("\n", "\r\n").encode(),
        "blank lines": text.replace("\n", "\n\n").encode(),
        "no newline at the end": text.rstrip("\n").encode(),
    }
    if comments:
        changes["a comment"] = ("# [/nope] \u202e\n" + text).encode()
    what = rng.choice(sorted(changes))
    return what, changes[what]


def mutant_of(kind: str, file: Path, rng: random.Random, changes: TextChanges, comments: bool) -> Mutant:
    """A text file with one or two changes, other bytes, or changes that a reader must not mind."""
    text = file.read_text(encoding="utf-8")
    sort, twin = rng.random(), str(file)
    if sort < 0.05:
        return Mutant(kind, twin, *neutral(text, rng, comments), file.suffix, neutral=True)
    if sort < 0.20:
        change = rng.choice((*BYTES, encoded))
        return Mutant(kind, twin, *change(text.encode(), rng), file.suffix, cut=change is truncated)
    said = []
    for _ in range(rng.choice((1, 1, 1, 2))):
        try:
            what, content = rng.choice(changes)(text, rng)
        except (IndexError, ValueError):  # nothing of that sort is left in it
            continue
        said.append(what)
        text = content.decode()
    return Mutant(kind, twin, ", ".join(said) or "nothing", text.encode(), file.suffix)


# ---------------------------------------------------------------------------------------------------------- spectra


def cell_replaced(text: str, rng: random.Random) -> Change:
    lines = text.split("\n")
    at = rng.randrange(len(lines))
    cells, entry = lines[at].split(","), rng.choice(CELLS)
    column = rng.randrange(len(cells))
    cells[column] = entry
    lines[at] = ",".join(cells)
    return f"line {at + 1} column {column + 1} = {entry[:20]!r}", "\n".join(lines).encode()


def column_replaced(text: str, rng: random.Random) -> Change:
    lines, entry = text.split("\n"), rng.choice(CELLS)
    column = rng.randrange(len(lines[0].split(",")))
    for i, line in enumerate(lines[1:], start=1):
        cells = line.split(",")
        if column < len(cells) > 1:
            cells[column] = entry
            lines[i] = ",".join(cells)
    return f"column {column + 1} = {entry[:20]!r}", "\n".join(lines).encode()


def line_deleted(text: str, rng: random.Random) -> Change:
    lines = text.split("\n")
    at = rng.randrange(len(lines))
    return f"line {at + 1} deleted", "\n".join([*lines[:at], *lines[at + 1 :]]).encode()


def line_doubled(text: str, rng: random.Random) -> Change:
    lines = text.split("\n")
    at = rng.randrange(len(lines))
    return f"line {at + 1} twice", "\n".join([*lines[: at + 1], *lines[at:]]).encode()


def columns_swapped(text: str, rng: random.Random) -> Change:
    lines = [line.split(",") for line in text.split("\n")]
    a, b = rng.sample(range(len(lines[0])), 2)
    for cells in lines:
        if max(a, b) < len(cells):
            cells[a], cells[b] = cells[b], cells[a]
    return f"columns {a + 1} and {b + 1} swapped", "\n".join(map(",".join, lines)).encode()


def rows_kept(text: str, rng: random.Random) -> Change:
    """Only rows of one channel, or of one harmonic, or of one record."""
    heading, *lines = text.rstrip("\n").split("\n")
    column = rng.choice((0, 3, 4))
    value = rng.choice([line.split(",")[column] for line in lines])
    kept = [line for line in lines if line.split(",")[column] == value]
    return f"only rows of {heading.split(',')[column]} {value}", "\n".join([heading, *kept, ""]).encode()


def separated(text: str, rng: random.Random) -> Change:
    mark = rng.choice((";", "\t", "|", " "))
    return f"separated by {mark!r}", text.replace(",", mark).encode()


CSV: TextChanges = (
    *(cell_replaced,) * 5,
    *(column_replaced,) * 4,
    *(line_deleted, line_doubled, columns_swapped, separated),
)


@cache
def _packed(file: Path, ending: str) -> bytes:
    """A spectra file in another format."""
    from hbm.measurement.exchange import mat_bytes, netcdf_bytes
    from hbm.measurement.spectrafile import load_spectra
    from hbm.rigfiles.load import load_rig

    read = load_spectra(file, load_rig(file.with_name("rig.toml")))
    return (mat_bytes if ending == ".mat" else netcdf_bytes)(file.name, read, {})


def spectra(seed: int, count: int) -> Iterator[Mutant]:
    """Damaged spectra files, each to be read with the ``rig.toml`` beside its twin."""
    folders = [*ROOT.glob("examples/*/"), *SHARED.glob("*/")]
    files = sorted(folder / "spectra.csv" for folder in folders if (folder / "spectra.csv").exists())
    for i in range(count):
        rng = random.Random(f"spectra {seed} {i}")
        file = rng.choice(files)
        if rng.random() < 0.15:
            ending = rng.choice((".mat", ".nc"))
            yield Mutant("spectra", str(file), *rng.choice(BYTES)(_packed(file, ending), rng), ending)
        else:
            yield mutant_of("spectra", file, rng, (*CSV, rows_kept, rows_kept), comments=False)


# --------------------------------------------------------------------------------------------------------- histories


HZ = 20.0
RATE = 1024.0


def _signals() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    t = np.arange(512) / RATE
    phase, noise = 2 * np.pi * HZ * t, np.random.default_rng(7)
    force = 4.0 * np.cos(phase) + 1e-3 * noise.standard_normal(len(t))
    a1 = 2.0 * np.cos(phase - 0.3) + 0.2 * np.cos(3 * phase) + 1e-2 * noise.standard_normal(len(t))
    return t, {"force": force, "a1": a1}


@cache
def history_twins() -> dict[str, bytes]:
    """Histories of one steady state by file name, in every format that is read."""
    import h5py
    import nptdms
    from scipy.io import savemat

    from hbm.measurement.exchange import write_recording
    from hbm.measurement.recording import recording

    t, channels = _signals()
    table = np.column_stack([t, *channels.values()]).tolist()
    rows = "\n".join(",".join(map(repr, row)) for row in table)
    made = {"steady.csv": ("time_s," + ",".join(channels) + "\n" + rows + "\n").encode()}
    for packed in (False, True):
        mat = io.BytesIO()
        savemat(mat, {"time_s": t, **channels, "units": {"force": "N", "a1": "m/s2"}}, do_compression=packed)
        made["packed.mat" if packed else "plain.mat"] = mat.getvalue()
    with tempfile.TemporaryDirectory() as folder:
        uff, tdms, hdf5 = (Path(folder) / name for name in ("steady.uff", "steady.tdms", "hdf5.mat"))
        write_recording(uff, recording("twin", t, channels, {"force": "N", "a1": "m/s2"}))
        with nptdms.TdmsWriter(str(tdms)) as writer:
            said = {"wf_increment": 1.0 / RATE}
            writer.write_segment(
                [nptdms.ChannelObject("run", name, v, properties=said) for name, v in channels.items()]
            )
        with h5py.File(hdf5, "w", userblock_size=512) as file:
            for name, values in {"time_s": t, **channels}.items():
                file.create_dataset(name, data=values[None, :])
                file[name].attrs["MATLAB_class"] = np.bytes_("double")
        content = bytearray(hdf5.read_bytes())
        head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
        content[: len(head)] = head
        hdf5.write_bytes(content)
        for file in (uff, tdms, hdf5):
            made[file.name] = file.read_bytes()
    return made


def histories(seed: int, count: int) -> Iterator[Mutant]:
    """Damaged histories."""
    made = history_twins()
    for i in range(count):
        rng = random.Random(f"history {seed} {i}")
        name = rng.choice(sorted(made))
        content, ending = made[name], Path(name).suffix
        if ending in (".csv", ".uff") and rng.random() < 0.1:
            text = content.decode()
            if ending == ".csv":
                yield Mutant("history", name, *neutral(text, rng, comments=False), ending, neutral=True)
            else:
                yield Mutant("history", name, "CRLF", text.replace("\n", "\r\n").encode(), ending, neutral=True)
        elif ending == ".csv" and rng.random() < 0.6:
            yield Mutant("history", name, *rng.choice(CSV)(content.decode(), rng), ending)
        else:
            change = rng.choice((*BYTES, truncated))
            yield Mutant("history", name, *change(content, rng), ending, cut=change is truncated)
