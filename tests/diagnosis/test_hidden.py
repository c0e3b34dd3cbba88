"""Effects hidden by a simulator that shares no code with the diagnosis; drawn anew with HBM_BLIND_SEED=n.

The diagnosis sees the files alone. benchmarks/diagnosis.py scores it over many more, of a larger set.
"""

import os

import numpy as np

from hbm import load_rig, load_spectra
from hbm.diagnosis.diagnose import diagnose
from hbm.diagnosis.verdict import NAMED
from models.causes import CAUSES
from tests.truth.blind import Case, draw, write_case
from tests.truth.hidden import CATALOGUE, OUTSIDE

SEED = int(os.environ.get("HBM_BLIND_SEED", "2"))
RHO, SIZES = (200.0, 1500.0), (0.001, 0.006)
"""Of the effects in noise units, and of the background of imperfections beside them, relative to the response."""

SOME = (CAUSES["added-mass"], CAUSES["viscous-contact"])


def diagnosed(case: Case, folder, causes=None):
    write_case(folder / "data", folder / "answer.json", case)
    rig = load_rig(folder / "data" / "rig.toml")
    return diagnose(rig, load_spectra(folder / "data" / "spectra.csv", rig), causes=causes)


def drawn(names, seed: int) -> Case:
    name = str(np.random.default_rng([SEED, seed]).choice(sorted(names)))
    print(f"HBM_BLIND_SEED={SEED}")
    return draw(1000 * SEED + seed, "F", name, 1000 * SEED, RHO, background=SIZES)


def test_nothing_hidden_is_consistent(tmp_path):
    found = diagnosed(draw(1000 * SEED, "F", None, 1000 * SEED, background=SIZES), tmp_path)
    assert found.verdict == "consistent", found


def test_hidden_cause_is_found_with_its_parameters_and_predicts_better(tmp_path):
    case = drawn(set(CATALOGUE), 1)
    found = diagnosed(case, tmp_path)
    named = {found.cause, *found.not_separable}
    assert found.verdict in NAMED and case.answer["cause"] in named, (case.answer["what"], found)
    if found.cause == case.answer["cause"]:
        for name, true in case.answer["parameters"].items():
            told = found.parameters[name]
            assert told.value == true if isinstance(true, str) else abs(told.value - true) < 4 * told.std
    if not found.cause.startswith("parameter:"):
        assert found.gain["held_out_chi2_ratio"] < 1.05


def test_effect_that_no_catalogue_holds_is_not_explained_away(tmp_path):
    """With little of the catalogue, all of it takes minutes where nothing explains; and one that is soon simulated.

    A look-alike may be named for most of it, if it says that more is left than a background.
    """
    case = drawn(set(OUTSIDE), 7)
    found = diagnosed(case, tmp_path, SOME)
    if found.verdict != "unexplained":
        assert found.verdict == "main-cause" and found.remainder.structured, (case.answer["what"], found)
        assert found.remainder.size > case.answer["background"]
