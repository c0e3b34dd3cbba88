"""Blind cases: repeatable, without the answer in their files, as strong as they say; every cause can be made."""

import csv
import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.truth import TrueRig
from tests.truth.blind import (
    Case,
    Scene,
    draw,
    draw_cause,
    draw_records,
    draw_rig,
    kind_of,
    measured_again,
    run,
    seen_of,
    set_up,
    truth_beside,
    write_case,
    write_measured,
)
from tests.truth.hidden import CATALOGUE, MAKERS, OUTSIDE, Unfit
from tests.truth.measure import read
from tests.truth.simulate import batch_of, force_over, ramp

RIG = 3


@pytest.fixture(scope="module")
def null() -> Case:
    return draw(1, "E", None, RIG, quick=True)


@pytest.fixture(scope="module")
def case() -> Case:
    return draw(2, "E", "added-mass", RIG, rho=(100.0, 100.1), quick=True)


def test_same_seed_same_case() -> None:
    case, again, other = (draw(seed, "E", "sensor-gain", RIG, (50, 90), quick=True) for seed in (7, 7, 8))
    assert again.answer == case.answer
    np.testing.assert_array_equal(again.spectra.cos, case.spectra.cos)
    assert other.answer != case.answer
    assert case.rho == pytest.approx(case.answer["rho_target"], rel=0.1)
    assert [draw_cause(np.random.default_rng([n, 17])) for n in range(9)] != [None] * 9


def test_a_null_is_null(null: Case) -> None:
    assert (null.answer["verdict"], null.answer["cause"], null.rho) == ("consistent", None, 0.0)
    bench = set_up(RIG, "E", "coulomb", False, True, None)
    assert null.truth is bench.truth
    assert null.truth.rig == null.nominal
    scores = ((null.spectra.cos - null.spectra.true_cos) / null.spectra.std)[:, 1:, 1:]
    assert 0.85 < scores.std() < 1.15


def test_rho_is_what_the_files_say(tmp_path: Path, null: Case, case: Case) -> None:
    """From the measured spectra against those of the bench without a cause: chi2 - dof = rho^2."""
    write_case(tmp_path / "data", tmp_path / "hidden" / "answer.json", case)
    with (tmp_path / "data" / "spectra.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["channel"] != "force" and int(row["harmonic"]) > 0]
    names, plain = read(null.truth, 9)
    chi2 = 0.0
    for row in rows:
        there = plain[int(row["record"]) - 1, names.index(row["channel"]), int(row["harmonic"])]
        chi2 += abs(float(row["cos"]) + 1j * float(row["sin"]) - there) ** 2 / float(row["std"]) ** 2
    assert np.sqrt(chi2 - 2 * len(rows)) == pytest.approx(case.rho, rel=0.1)


def test_answers_stay_out_of_the_data(tmp_path: Path, case: Case) -> None:
    with pytest.raises(ValueError, match="would lie with the data"):
        write_case(tmp_path / "a", tmp_path / "a" / "answer.json", case)
    write_case(tmp_path / "a", tmp_path / "b" / "answer.json", case)
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["rig.toml", "spectra.csv"]
    seen = (tmp_path / "a" / "rig.toml").read_text() + (tmp_path / "a" / "spectra.csv").read_text()[:2000]
    for name in MAKERS:
        assert name not in seen or "parameter" in name
    assert not re.search(r"effect|hidden|added|mass =|cause", seen)
    answer = json.loads((tmp_path / "b" / "answer.json").read_text())
    assert answer["cause"] == "added-mass"
    assert set(answer["parameters"]) == {"mass", "position"}
    read_back = tomllib.loads((tmp_path / "a" / "rig.toml").read_text())
    assert read_back["beam"]["youngs_modulus"] == case.nominal.youngs_modulus
    assert f"{answer['parameters']['mass']:.6g}" not in seen


def test_tolerances_and_special_laws(tmp_path: Path) -> None:
    """A rig built off its file still has that file, and a fault of a sensor comes on top of its tolerance."""
    case = draw(9, "A", "sensor-delay", RIG, (50, 90), tolerances=True, quick=True)
    assert case.spectra.cos.shape[1:] == (2, 2)
    assert case.truth.rig.youngs_modulus != case.nominal.youngs_modulus
    assert case.nominal.sensors[0].gain == 1.0
    assert case.answer["tolerances"]
    write_case(tmp_path / "data", tmp_path / "a.json", case)
    with pytest.raises(Unfit, match="exchanged"):
        draw(9, "A", "swapped-channels", RIG, tolerances=True, quick=True)
    assert [kind_of(name) for name in ("bristle-memory", "added-mass")] == ["dahl", "coulomb"]


def test_poorer_sets_hold_less() -> None:
    rng = np.random.default_rng(5)
    rig = draw_rig(rng)
    levels = {which: {level for level, _ in draw_records(rig, which, np.random.default_rng(1))} for which in "ACDE"}
    assert [len(levels[which]) for which in "ACDE"] == [1, 3, 3, 5]
    counts = [len(draw_records(rig, "E", np.random.default_rng(n))) for n in range(8)]
    assert min(counts) >= 40
    assert max(counts) <= 69


@pytest.mark.parametrize("name", MAKERS)
def test_every_cause_can_be_made(name: str) -> None:
    """It marches, and what is seen depends on its strength."""
    bench = set_up(RIG, "E", "coulomb", False, True, None)
    hidden = MAKERS[name](Scene(bench.built, bench.records, bench.truth, np.random.default_rng(4)))
    answer = hidden.parameters(hidden.typical)
    json.dumps(answer)
    assert (
        hidden.cause is None if name in OUTSIDE else hidden.cause in ({name} if name in CATALOGUE else {"sensor-gain"})
    )

    def seen(strength: float) -> np.ndarray:
        """Two periods from rest, or what the sensors make of the truth."""
        rigs = hidden.rigs(strength)
        if not hidden.simulated:
            return read(hidden.afterwards(replace(bench.truth, rig=rigs, steps=48), strength), 3)[1]
        asked = (bench.records if hidden.records is None else hidden.records(strength))[-1:]
        rig = rigs if isinstance(rigs, TrueRig) else rigs[-1]
        batch = batch_of([rig], asked, 48, tolerance=1e-8)
        end, _ = ramp(batch, force_over(rig, asked, 48), batch.rest_state(), 1, 1)
        return (end.q @ batch.m["sensors"].swapaxes(1, 2)) / bench.truth.u.max()

    strong = min(5 * hidden.typical, hidden.upper)
    changed = seen(strong)
    assert np.isfinite(changed).all()
    assert (
        not np.array_equal(changed, seen(min(hidden.typical, 0.1 * strong)))
        or hidden.lower == hidden.upper
        or name == "impact-stop"
    )


@pytest.mark.parametrize(("times", "cause"), [(1e-3, "clamp-friction"), (1e3, "clamp-rotation")])
def test_a_clamp_that_never_slips_is_an_elastic_one(times: float, cause: str) -> None:
    """In the answer: what no record can show was not hidden."""
    bench = set_up(RIG, "E", "coulomb", False, True, None)
    slips = MAKERS["clamp-friction"](Scene(bench.built, bench.records, bench.truth, np.random.default_rng(1)))

    def rigs(strength: float) -> TrueRig:
        (clamp,) = (rig := slips.rigs(strength)).effects
        return replace(rig, effects=(replace(clamp, limit=times * clamp.limit),))

    hidden, everyone = replace(slips, rigs=rigs), np.arange(len(bench.records))
    seen = seen_of(bench, hidden, slips.typical, run(bench, hidden, slips.typical, everyone, bench.steps))
    assert seen.cause == cause
    assert set(seen.parameters(slips.typical)) == {"stiffness"} | ({"limit"} if cause == "clamp-friction" else set())


def test_a_null_is_measured_again(tmp_path: Path, null: Case, case: Case) -> None:
    """By the same dice the same spectra, by others the same truth; causes leave no truth behind."""
    answer = tmp_path / "answers" / "0001.json"
    write_case(tmp_path / "data", answer, null)
    kept = truth_beside(answer)
    same, numbers = measured_again(kept, np.random.default_rng([null.seed, 23]))
    other, _ = measured_again(kept, np.random.default_rng(5))
    assert numbers == null.numbers
    np.testing.assert_array_equal(same.cos, null.spectra.cos)
    np.testing.assert_array_equal(other.true_sin, null.spectra.true_sin)
    scores = ((other.cos - null.spectra.cos) / null.spectra.std)[:, 1:, 1:]
    assert 0.85 < scores.std() / np.sqrt(2) < 1.15
    write_measured(tmp_path / "again.csv", same, numbers)
    assert (tmp_path / "again.csv").read_text() == (tmp_path / "data" / "spectra.csv").read_text()
    write_case(tmp_path / "more", tmp_path / "answers" / "0002.json", case)
    assert sorted(p.name for p in answer.parent.iterdir()) == ["0001.json", "0001.truth.npz", "0002.json"]
