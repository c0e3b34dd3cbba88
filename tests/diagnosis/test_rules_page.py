"""The page on the diagnosis states the rules that the code has."""

import re
from importlib import import_module
from pathlib import Path

from hbm.diagnosis.confidence import FORETOLD, RELIABLE
from hbm.diagnosis.deviations import TRUSTED
from hbm.diagnosis.verdict import BELIEF
from hbm.outputerror.background import SIZES
from hbm.outputerror.nominal import TOLERANCES

ROOMS = Path(__file__).parents[2] / "hbm"
PAGE = (Path(__file__).parents[2] / "docs" / "theory" / "diagnosis.md").read_text(encoding="utf-8")


def test_every_rule_of_the_table_is_a_constant_of_the_code() -> None:
    rows = re.findall(r"^\| .* \| ([\d.]+) \| `(\w+)\.([A-Z_]+)` \|$", PAGE, re.M)
    assert len(rows) > 15
    for number, module, name in rows:
        room = "outputerror" if (ROOMS / "outputerror" / f"{module}.py").exists() else "diagnosis"
        assert float(number) == getattr(import_module(f"hbm.{room}.{module}"), name), f"{module}.{name}"


def test_sizes_of_a_background_are_those_that_are_compared() -> None:
    listed = re.search(r"It is chosen among ([^,]*(?:, [^,]*)+?) and (\S+), so", " ".join(PAGE.split()))
    assert listed is not None
    assert [float(size) for size in (*listed[1].split(", "), listed[2])] == list(SIZES)


def test_words_of_a_belief_are_those_of_a_verdict() -> None:
    *words, (_, lowest) = BELIEF
    page = " ".join(PAGE.split())
    assert re.findall(r"\*([a-z ]+)\* from ([\d.]+)", page) == [(word, f"{least:g}") for least, word in words]
    assert f"*{lowest}* below" in page


def test_tolerances_are_those_of_calibration() -> None:
    table = dict(re.findall(r"^\| ([^|`]*) \| (\d[^|]*) \|$", PAGE, re.M))
    percent = {key: f"{100.0 * std:g} %" for key, std in TOLERANCES.items()}
    assert table["Young's modulus"] == percent["beam.youngs_modulus"]
    assert table["normal load, friction coefficients"] == percent["contact.normal_load"]
    assert table["other parameters of the friction law, mass-proportional damping"] == percent["friction"]
    delay, position = f"{1e6 * TOLERANCES['delay']:g} µs", f"{1e3 * TOLERANCES['position']:g} mm"
    assert table["gain, delay and position of each sensor"] == f"{percent['gain']}, {delay}, {position}"
    assert table["position of the excitation"] == position


def test_shares_of_right_verdicts_are_those_of_the_confidence() -> None:
    table = PAGE[PAGE.index("| verdict | right |") :].split("\n\n")[0]
    assert [float(right) for right in re.findall(r"\| ([\d.]+) \|$", table, re.M)] == list(RELIABLE.values())
    assert f"at least {FORETOLD:g} of the misfit held out" in table


def test_shares_of_tolerances_are_those_that_are_averaged() -> None:
    *shares, last = (f"{share:g}" for share in TRUSTED)
    assert f"over {', '.join(shares)} and {last} of their tolerances" in " ".join(PAGE.split())
