"""Damaged rigs, and damaged matrices of a rig: see :mod:`benchmarks.mutants`."""

import io
import random
import re
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path

from benchmarks.mutants import BYTES, ROOT, SHARED, Change, Mutant, TextChanges, mutant_of, truncated

TWINS = Path(__file__).with_name("twins")
"""Rigs of modes and of matrices, as the guides have them."""

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


def rigs(seed: int, count: int) -> Iterator[Mutant]:
    """Damaged rig files.

    Parameters
    ----------
    seed : int
    count : int
    """
    files = sorted([*ROOT.glob("examples/**/*.toml"), *SHARED.glob("*/rig.toml"), *TWINS.glob("*.toml")])
    for i in range(count):
        rng = random.Random(f"rig {seed} {i}")
        file = rng.choice(files)
        yield mutant_of("rig", file, rng, RIG, comments=True)


@cache
def _matrix_twins() -> dict[str, bytes]:
    """The stiffness of the bar in every format that is read, by file name; ``.inp`` is the text of Abaqus."""
    import numpy as np
    from scipy import sparse
    from scipy.io import mmread, savemat

    text = (TWINS / "K.mtx").read_bytes()
    K = sparse.csc_array(mmread(io.BytesIO(text), spmatrix=False))
    whole, packed, mat = io.BytesIO(), io.BytesIO(), io.BytesIO()
    np.savez(whole, K=K.toarray())
    sparse.save_npz(packed, K, compressed=False)
    savemat(mat, {"K": K})
    coo = K.tocoo()
    lines = (f"{i + 1},1, {j + 1},1, {v!r}\n" for i, j, v in zip(*coo.coords, coo.data.tolist(), strict=True))
    made = {"text.mtx": text, "whole.npz": whole.getvalue(), "packed.npz": packed.getvalue(), "K.mat": mat.getvalue()}
    return made | {"abaqus.inp": "".join(lines).encode()}


def number_replaced(text: str, rng: random.Random) -> Change:
    """One number of a text is another."""
    number, value = rng.choice(list(re.finditer(r"[-+\d.eE]+", text))), rng.choice(ABSURD)
    return f"{number[0]} = {value[:40]}", _replaced(text, number.span(), value).encode()


def matrices(seed: int, count: int) -> Iterator[Mutant]:
    """Damaged stiffness matrices of ``twins/matrix.toml``."""
    made = _matrix_twins()
    for i in range(count):
        rng = random.Random(f"matrix {seed} {i}")
        name = rng.choice(sorted(made))
        if name.endswith((".mtx", ".inp")) and rng.random() < 0.7:
            change = number_replaced(made[name].decode(), rng)
        else:
            change = rng.choice((*BYTES, truncated))(made[name], rng)
        yield Mutant("matrix", name, *change, Path(name).suffix)
