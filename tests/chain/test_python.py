"""What a notebook shows of results, and the extended rig written by Python."""

import re
from pathlib import Path

import pytest

from hbm import InputError, diagnose, linear_modes, load_rig, load_spectra, sensitivities, steady_state, write_extended
from hbm.diagnosis.verdict import Diagnosis

EXAMPLES = Path(__file__).parents[2] / "examples"
RIG = EXAMPLES / "one_mode.toml"


def cells(html: str) -> list[list[str]]:
    return [re.findall(r"<td>(.*?)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", html)]


def test_results_are_tables_in_a_notebook() -> None:
    rig = load_rig(RIG)
    solution = steady_state(rig, 45.0, harmonics=3)
    shown = dict(cells(solution._repr_html_()))
    assert shown["a1"] == f"{solution['a1'].peak:.6g} m/s2"
    modes = cells(linear_modes(rig)._repr_html_())
    assert modes[0] == ["", "sliding [Hz]", "stuck [Hz]", "damping"]
    assert {len(row) for row in modes} == {4}


def test_numbers_without_a_unit_have_none() -> None:
    rig = load_rig(EXAMPLES / "paper_beam.toml")
    found = sensitivities(rig, steady_state(rig, 50.0, harmonics=5))
    rows = {name: value for name, value, _ in cells(found._repr_html_())}
    assert rows["contact.friction.mu"] == "0.52"
    assert rows["contact.normal_load"] == "83 N"


def test_words_are_escaped() -> None:
    from dataclasses import replace

    html = replace(load_rig(RIG), name="<b>a & b</b>")._repr_html_()
    assert "&lt;b&gt;a &amp; b&lt;/b&gt;" in html


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    """Of one candidate, for speed: the one that is hidden in the example."""
    from models.causes import CAUSES

    folder = EXAMPLES / "diagnosed_beam"
    rig = load_rig(folder / "rig.toml")
    spectra = load_spectra(folder / "spectra.csv", rig).select(levels=[6.5], hz=(40.0, 70.0))
    return diagnose(rig, spectra, causes=[CAUSES["asymmetric-friction"]], held_out=[spectra.records[2]])


def test_the_extended_rig_is_written_and_read_back(found: Diagnosis, tmp_path: Path) -> None:
    assert found.extended is not None
    path = write_extended(tmp_path / "extended.toml", EXAMPLES / "diagnosed_beam" / "rig.toml", found)
    again = load_rig(path)
    a, b = (steady_state(rig, 50.0, harmonics=5)["drive"].peak for rig in (found.extended, again))
    assert a == pytest.approx(b, rel=1e-9)


def test_without_a_cause_there_is_nothing_to_write(found: Diagnosis, tmp_path: Path) -> None:
    from dataclasses import replace

    none = replace(found, extended=None, verdict="consistent")
    with pytest.raises(InputError, match="write_extended: the verdict is consistent; must name a cause"):
        write_extended(tmp_path / "extended.toml", RIG, none)
    with pytest.raises(
        InputError, match=r"write_extended: .*nothing\.toml: no such file or directory; must be a rig file"
    ):
        write_extended(tmp_path / "extended.toml", tmp_path / "nothing.toml", found)
    assert not list(tmp_path.iterdir())
