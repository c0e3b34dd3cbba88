"""Whatever is in a file, reading it ends in a result or in one line that names the file."""

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.mutants import Mutant, histories, spectra
from benchmarks.rigmutants import matrices, rigs
from hbm.errors import InputError, visible
from hbm.measurement.historyfile import load_history
from hbm.measurement.recording import recording
from hbm.measurement.spectrafile import COLUMNS, load_spectra
from hbm.rigfiles.joints import jointed_rig
from hbm.rigfiles.load import load_rig, rig_from_dict
from hbm.rigfiles.matrices import read_abaqus, read_matrix

ROOT = Path(__file__).parents[2]
TABLES = [tomllib.loads(path.read_text(encoding="utf-8")) for path in sorted((ROOT / "examples").glob("*.toml"))]
RIG = load_rig(ROOT / "examples" / "undecided_beam" / "rig.toml")
ROWS = (ROOT / "examples" / "undecided_beam" / "spectra.csv").read_text(encoding="utf-8").splitlines()

seeds = st.integers(0, 2**32)
values = st.recursive(
    st.one_of(st.floats(), st.integers(), st.text(max_size=20), st.booleans(), st.none().map(lambda _: math.nan)),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=5), inner, max_size=2)),
    max_leaves=5,
)


def one_line(refused: pytest.ExceptionInfo[InputError] | InputError, where: str) -> None:
    said = str(refused)
    assert said.startswith(where) and said.isprintable(), said


def replaced(table: Any, keys: list[int], value: Any) -> Any:
    """A copy of nested tables with one entry replaced, found by counting."""
    if not keys or not isinstance(table, dict | list) or not table:
        return value
    if isinstance(table, list):
        at = keys[0] % len(table)
        return [replaced(entry, keys[1:], value) if i == at else entry for i, entry in enumerate(table)]
    at = keys[0] % len(table)
    return {k: replaced(entry, keys[1:], value) if i == at else entry for i, (k, entry) in enumerate(table.items())}


@given(st.sampled_from(TABLES), st.lists(st.integers(0, 20), min_size=1, max_size=3), values)
def test_any_value_in_place_of_another_in_a_rig(table: dict[str, Any], keys: list[int], value: Any) -> None:
    changed = replaced(table, keys, value)
    make = jointed_rig if "joints" in changed else rig_from_dict
    try:
        rig = make(changed, "rig.toml")
    except InputError as refused:
        one_line(refused, "rig.toml: ")
    else:
        assert str(rig).replace("\n", "").isprintable()


@given(
    st.sampled_from(range(1, len(ROWS))),
    st.sampled_from(range(len(COLUMNS))),
    st.text(max_size=20) | st.floats().map(repr),
)
def test_any_entry_in_place_of_another_in_spectra(tmp_path: Path, line: int, column: int, entry: str) -> None:
    cells = ROWS[line].split(",")
    cells[column] = entry
    file = tmp_path / "spectra.csv"
    file.write_text("\n".join([*ROWS[:line], ",".join(cells), *ROWS[line + 1 :]]), encoding="utf-8", errors="replace")
    try:
        found = load_spectra(file, RIG)
    except InputError as refused:
        one_line(refused, str(file))
    else:
        assert np.isfinite(found.std[found.measured]).all() and (found.std[found.measured] > 0.0).all()


@given(st.text(max_size=200))
def test_any_text_is_no_reason_to_fail(tmp_path: Path, text: str) -> None:
    for name, read in (("a.toml", load_rig), ("a.csv", lambda path: load_spectra(path, RIG)), ("a.csv", load_history)):
        file = tmp_path / name
        file.write_text(text, encoding="utf-8", errors="replace")
        with pytest.raises(InputError) as refused:
            read(file)
        one_line(refused.value, str(file))


@given(seeds)
def test_damaged_files(tmp_path: Path, seed: int) -> None:
    mutants: list[Mutant] = [next(made(seed, 1)) for made in (rigs, matrices, spectra, histories)]
    for mutant in mutants:
        file = tmp_path / f"mutant{mutant.ending}"
        file.write_bytes(mutant.content)
        beside = Path(mutant.twin).with_name("rig.toml")
        try:
            if mutant.kind == "rig":
                load_rig(file)
            elif mutant.kind == "matrix":
                read_abaqus(file) if mutant.ending == ".inp" else read_matrix(file)
            elif mutant.kind == "spectra":
                load_spectra(file, load_rig(beside))
            else:
                load_history(file)
        except InputError as refused:
            one_line(refused, str(file))


@given(st.lists(st.floats(), min_size=3, max_size=6))
def test_readings_are_finite_and_possible_or_refused(readings: list[float]) -> None:
    try:
        found = recording("source", np.arange(len(readings)) * 1e-3, {"a": readings})
    except InputError as refused:
        one_line(refused, "source: a is ")
        assert not all(math.isfinite(r) and abs(r) <= 1e30 for r in readings)
    else:
        assert np.array_equal(found.channels["a"], readings)


@given(st.text())
def test_what_is_shown_is_one_line_and_plain_text_is_shown_as_it_is(text: str) -> None:
    assert visible(text).isprintable()
    assert visible(visible(text)) == visible(text)
    if text.isprintable():
        assert visible(text) == text
