"""Damaged files: rigs, spectra and histories with one or a few things wrong in each, the same for the same seed.

A mutant keeps the bytes of the file it was made of, its twin. Where nothing was changed that a reader may mind
(line ends, a byte order mark, blanks, comments), it is `neutral`: whatever is computed of it is what its twin gives.
"""

import io
import random
import re
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
SHARED = ROOT.parent / "shared" / "data" / "examples"

ABSURD = (
    *("0", "-1", "0.0", "-0.0", "nan", "inf", "-inf", "1e300", "-1e300", "1e308", "1e-300", "1e-320", "1e30", "1e-30"),
    *("1e10", "1e-12", "800", "70", "1e6", "1e-6", "3", "1000", "1001", "100000000000000000000", "0x10", "1_000"),
    *("true", '""', '"text"', "[]", "[1.0]", "[[1.0, 2.0], [3.0]]", "{}", "{ a = 1 }", "1979-05-27", "'''a\nb'''"),
    *("[" + "1.0, " * 2000 + "]", '"' + "x" * 5000 + '"', "[[[[[[1]]]]]]", "9" * 400),
)
"""Values of a rig file in place of others."""

NAMES = (
    *("[/nope]", "[bold]a[/bold]", r"a\u0000b", r"\u001b[31mred", r"a\nb", r"a\r\nb", "<script>alert(1)</script>"),
    *(
        "a&b",
        "../../etc/passwd",
        "/etc/passwd",
        "nul",
        r"\u202Eabc",
        "a,b",
        "a;b",
        " a",
        r"a\"b",
        "é",
        "名",
        "=1+1",
        ".",
    ),
    *("", "a" * 3000, "%s%n", "${HOME}", "{0}", "own\\u0000.py:Law", "../own.py:Law", "/tmp/own.py:Law"),
)
"""Texts of a rig file in place of others, as TOML writes them."""

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
        rig, spectra or history.
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


# ------------------------------------------------------------------------------------------------------------- rigs


ENTRY = re.compile(r"^(?P<key>[A-Za-z_]\w*)(?P<is>\s*=\s*)(?P<value>[^#\n]*?)(?P<rest>\s*(?:#.*)?)$", re.MULTILINE)
TABLE = re.compile(r"^\[\[?[\w.]+\]\]?", re.MULTILINE)


def _replaced(text: str, span: tuple[int, int], by: str) -> str:
    return text[: span[0]] + by + text[span[1] :]


def value_replaced(text: str, rng: random.Random) -> Change:
    entry = rng.choice(list(ENTRY.finditer(text)))
    value = rng.choice(ABSURD)
    return f"{entry['key']} = {value[:40]}", _replaced(text, entry.span("value"), value).encode()


def number_scaled(text: str, rng: random.Random) -> Change:
    entries = [e for e in ENTRY.finditer(text) if re.fullmatch(r"[-+\d.eE]+", e["value"])]
    entry, factor = rng.choice(entries), 10.0 ** rng.choice((-30, -12, -9, -6, -3, 3, 6, 9, 12, 30))
    value = float(entry["value"]) * factor
    return f"{entry['key']} = {value:g}", _replaced(text, entry.span("value"), repr(value)).encode()


def text_replaced(text: str, rng: random.Random) -> Change:
    entries = [e for e in ENTRY.finditer(text) if e["value"].startswith('"')]
    entry, name = rng.choice(entries), rng.choice(NAMES)
    return f'{entry["key"]} = "{name[:40]}"', _replaced(text, entry.span("value"), f'"{name}"').encode()


def entry_in_array(text: str, rng: random.Random) -> Change:
    entries = [e for e in ENTRY.finditer(text) if e["value"].startswith("[")]
    if not entries:
        return value_replaced(text, rng)
    entry = rng.choice(entries)
    numbers = list(re.finditer(r'[-+\d.eE]+|"[^"]*"', entry["value"]))
    if not numbers:
        return value_replaced(text, rng)
    number, value = rng.choice(numbers), rng.choice(ABSURD)
    begin = entry.start("value")
    span = begin + number.start(), begin + number.end()
    return f"an entry of {entry['key']} = {value[:40]}", _replaced(text, span, value).encode()


def key_deleted(text: str, rng: random.Random) -> Change:
    entry = rng.choice(list(ENTRY.finditer(text)))
    return f"{entry['key']} deleted", _replaced(text, entry.span(), "").encode()


def key_doubled(text: str, rng: random.Random) -> Change:
    entry = rng.choice(list(ENTRY.finditer(text)))
    return f"{entry['key']} twice", _replaced(text, entry.span(), f"{entry[0]}\n{entry[0]}").encode()


def key_renamed(text: str, rng: random.Random) -> Change:
    entry = rng.choice(list(ENTRY.finditer(text)))
    name = rng.choice((entry["key"] + "s", "x", '"[/nope]"', '"\\u0000"', '"<b>"', '""', "a.b", '"\\u001b[31m"'))
    return f"{entry['key']} renamed {name}", _replaced(text, entry.span("key"), name).encode()


def tables(text: str) -> list[str]:
    """The head of a rig file and its tables."""
    starts = [0, *(m.start() for m in TABLE.finditer(text)), len(text)]
    return [text[a:b] for a, b in pairwise(starts)]


def table_deleted(text: str, rng: random.Random) -> Change:
    parts = tables(text)
    gone = parts.pop(rng.randrange(len(parts)))
    return f"{gone.splitlines()[0] if gone else 'head'} deleted", "".join(parts).encode()


def table_doubled(text: str, rng: random.Random) -> Change:
    parts = tables(text)
    at = rng.randrange(1, len(parts))
    return f"{parts[at].splitlines()[0]} twice", "".join([*parts[: at + 1], "\n", *parts[at:]]).encode()


def tables_swapped(text: str, rng: random.Random) -> Change:
    parts = tables(text)
    heads = [i for i in range(1, len(parts)) if TABLE.match(parts[i])]
    a, b = rng.sample(heads, 2)
    names = TABLE.match(parts[a])[0], TABLE.match(parts[b])[0]  # type: ignore[index]
    parts[a], parts[b] = names[1] + parts[a][len(names[0]) :], names[0] + parts[b][len(names[1]) :]
    return f"{names[0]} and {names[1]} swapped", "".join(parts).encode()


EXTENSIONS = (
    ('cause = "stribeck-weakening"', "mu_static = 0.6\nmu = 0.5\nstribeck_velocity = 0.01"),
    ('cause = "clamp-rotation"', "stiffness = 1e5"),
    ('cause = "added-mass"', "mass = 0.1\nposition = 0.3"),
    ('cause = "added-spring"', "stiffness = 1e4\nposition = 0.3"),
    ('cause = "attached-resonator"', "mass = 0.1\nfrequency_hz = 60.0\nposition = 0.3"),
    ('cause = "impact-stop"', "gap = 1e-4\nstiffness = 1e5\nposition = 0.3"),
    ('cause = "midplane-stretching"', "axial_stiffness = 1e6"),
    ('cause = "parameter:beam.length"', "value = 0.61"),
    ('cause = "drift"', 'parameter = "contact.friction.mu"\nrate = 0.01'),
    ('cause = "sensor-gain"', 'channel = "a1"\ngain = 1.1'),
    ('cause = "own.py:Cause"', "value = 1.0"),
)


def extension_added(text: str, rng: random.Random) -> Change:
    cause, values = rng.choice(EXTENSIONS)
    change, table = value_replaced(values, rng)
    return f"{cause}, {change}", f"{text}\n[[extensions]]\n{cause}\n".encode() + table


RIG: TextChanges = (
    *(value_replaced,) * 5,
    *(number_scaled,) * 3,
    *(text_replaced,) * 3,
    *(entry_in_array, key_deleted, key_doubled, key_renamed, table_deleted, table_doubled, tables_swapped),
    extension_added,
)


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


def rigs(seed: int, count: int) -> Iterator[Mutant]:
    """Damaged rig files.

    Parameters
    ----------
    seed : int
    count : int
    """
    files = sorted([*ROOT.glob("examples/**/*.toml"), *SHARED.glob("*/rig.toml")])
    for i in range(count):
        rng = random.Random(f"rig {seed} {i}")
        file = rng.choice(files)
        yield _mutant("rig", file, rng, RIG, comments=True)


def _mutant(kind: str, file: Path, rng: random.Random, changes: TextChanges, comments: bool) -> Mutant:
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
            yield _mutant("spectra", file, rng, (*CSV, rows_kept, rows_kept), comments=False)


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
