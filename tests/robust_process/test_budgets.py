"""A curve that costs too much, or leads nowhere, ends with the reason, and what was found of it is kept."""

import csv
import json
import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from continuation import Branch, ConvergenceError, DenseProblem, End, Point, Settings
from hbm import frequency_response, load_rig
from hbm.balance.problem import HarmonicBalance
from hbm.fourier import FourierBasis
from hbm.modes.backbone import nonlinear_mode
from hbm.response import accuracy, start, trace
from hbm.response.accuracy import estimate_error
from hbm.response.assessment import NumericalError
from hbm.response.budget import CRAWL, FOLDS, Along, Budget, Watch, continue_within, in_units
from hbm.response.curve import ResponseCurve
from hbm.response.trace import trace_frequency
from hbm.tracking.parameterresponse import parameter_response

EXAMPLES = Path(__file__).parents[2] / "examples"
PAPER = EXAMPLES / "paper_beam.toml"
MEASURED, DIAGNOSED = (
    [str(EXAMPLES / folder / name) for name in ("rig.toml", "spectra.csv")]
    for folder in ("measured_beam", "diagnosed_beam")
)


def point(lam: float, *, fold: bool = False, size: float = 1.0) -> Point:
    return Point(np.array([size]), lam, np.zeros(1), 1.0, 0.0, 0.1, 3, 0.0, fold=fold)


def first_end(points: list[Point], budget: Budget, most_folds: int = FOLDS) -> tuple[int, str]:
    """Number of the point that ends a trace over a sweep of length 1, and why; 0 where none does."""
    watch = Watch(budget, 1.0, most_folds)
    for number, p in enumerate(points, start=1):
        if said := watch.spent(p):
            return number, said
    return 0, ""


def test_the_budget_of_points_ends_a_curve_and_keeps_it() -> None:
    curve = trace_frequency(load_rig(PAPER), (45.0, 55.0), harmonics=1, samples=32, budget=Budget(points=7))
    assert (len(curve.branch.points), curve.complete, curve.branch.end) == (7, False, End.STOPPED_BY_CALLER)
    assert curve.branch.message.startswith(
        f"stopped at {curve.branch.lam[-1] / curve.branch.lam[0] * 45:.6g} Hz (point 7"
    )
    assert "7 points are its budget; try" in curve.branch.message


def test_where_a_curve_ended_is_told_as_the_user_knows_it() -> None:
    curve = trace_frequency(load_rig(PAPER), (45.0, 46.0), harmonics=1, samples=32)
    assert curve.branch.message == f"continuation: reached its end at 46 Hz (point {len(curve.branch.points)})"


@pytest.mark.parametrize(("unit", "said"), [("N", " N"), ("1/s", " 1/s"), ("1", ""), ("", "")])
def test_where_it_ended_has_the_unit_of_the_number(unit: str, said: str) -> None:
    line = "fold curve: left the interval of mu at mu = 0.5 (point 3)"
    assert in_units(line, "mu", lambda mu: 4.0 * mu, unit) == f"fold curve: left the interval at 2{said} (point 3)"


def test_a_sweep_on_a_closed_curve_has_not_come_to_its_end() -> None:
    """From 40 on a circle about 40 of radius 1 no sweep comes to 90: it says how far it came, and is not complete."""
    circle = DenseProblem(
        lambda x, lam: x**2 + (lam - 40.0) ** 2 - 1.0,
        lambda x, lam: (np.diag(2.0 * x), np.array([2.0 * (lam - 40.0)])),
    )
    settings = Settings(lam_end=90.0, lam_min=30.0, step=0.1, step_max=0.1)
    branch = continue_within(None, Along(lambda lam: lam, "Hz"), circle, np.array([1.0]), 40.0, settings)
    assert (branch.end, branch.complete, branch.closed) == (End.MISSED_END, False, False)
    spans = re.fullmatch(
        r"the curve is closed, back at its start: ([\d.]+) to ([\d.]+) Hz, and does not come to 90 Hz, where another "
        r"answers; start there or elsewhere, or with more harmonics",
        branch.message,
    )
    assert spans is not None
    assert [float(hz) for hz in spans.groups()] == pytest.approx([39.0, 41.0], abs=0.01)


def test_a_budget_of_one_point_is_in_the_singular() -> None:
    assert first_end([point(0.5)], Budget(points=1)) == (1, "1 point is its budget")


def test_the_budget_of_seconds_ends_a_curve() -> None:
    curve = trace_frequency(load_rig(PAPER), (45.0, 55.0), harmonics=1, samples=32, budget=Budget(seconds=1e-9))
    assert "1e-09 s are its budget" in curve.branch.message
    assert not curve.complete


def test_what_goes_before_a_trace_is_of_its_budget_but_for_half() -> None:
    assert Budget(seconds=10.0).after(3.0).left == 7.0
    assert Budget(seconds=10.0).after(3.0).after(9.0).left == 5.0


def test_the_choice_of_harmonics_and_the_first_solution_share_the_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[Budget] = []

    def within(budget: Budget, *rest: object, **more: object) -> Branch:
        given.append(budget)
        return continue_within(budget, *rest, **more)

    def estimated(curve: ResponseCurve, seconds: float) -> NumericalError:
        estimates.append(seconds)
        return estimate_error(curve, seconds)

    estimates: list[float] = []
    monkeypatch.setattr(trace, "continue_within", within)
    monkeypatch.setattr(accuracy, "estimate_error", estimated)
    frequency_response(load_rig(PAPER), (48.0, 52.0), budget=Budget(seconds=200.0))
    scout, curve = given
    assert (scout.seconds, scout.points, curve.seconds) == (100.0, Budget().points, 200.0)
    assert estimates == [20.0]
    assert 0.0 < scout.spent < 50.0 and scout.spent < curve.spent <= 100.0


def test_a_first_solution_that_takes_too_long_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start, "_directly", lambda *_, **__: None)
    problem = HarmonicBalance(load_rig(PAPER), FourierBasis(3, 32))
    assert np.isfinite(start.first_solution(problem, problem.lam_at(50.0))).all()
    with pytest.raises(ConvergenceError, match=r"none at 50 Hz and 6\.5 N in its time; allow more seconds"):
        start.first_solution(problem, problem.lam_at(50.0), 0.0)


def test_hundreds_of_folds_in_a_tenth_of_the_sweep_turn_in_place() -> None:
    winding = [point(0.5 + 0.04 * math.sin(i), fold=True) for i in range(3 * FOLDS)]
    number, said = first_end(winding, Budget(points=10**6))
    assert number == FOLDS
    assert said.startswith(f"the curve turns in place: {FOLDS} folds within 0.08 of the sweep")


def test_what_is_traced_says_how_many_folds_are_too_many() -> None:
    winding = [point(0.5 + 0.04 * math.sin(i), fold=True) for i in range(3 * FOLDS)]
    assert first_end(winding, Budget(points=10**6), 40)[0] == 40


def test_as_many_folds_over_the_whole_sweep_do_not() -> None:
    spread = [point(i / (3 * FOLDS), fold=i % 3 == 0) for i in range(3 * FOLDS)]
    assert first_end(spread, Budget(points=10**6)) == (0, "")


@pytest.mark.parametrize(("advance", "ended_at"), [(1e-6, CRAWL), (1e-5, 0)])
def test_a_curve_that_hardly_advances_creeps(advance: float, ended_at: int) -> None:
    number, said = first_end([point(advance * i) for i in range(2 * CRAWL)], Budget(points=10**6))
    assert number == ended_at
    assert said.startswith("the curve creeps") is bool(ended_at)


def test_a_resonance_however_sharp_does_not_creep() -> None:
    sharp = [point(1e-7 * i, size=1.0 / (1e-4 + abs(i - CRAWL) / CRAWL)) for i in range(2 * CRAWL)]
    assert first_end(sharp, Budget(points=10**6)) == (0, "")


def test_budgets_end_responses_along_a_number_and_backbones() -> None:
    rig, few = load_rig(PAPER), Budget(points=4)
    along = parameter_response(rig, "contact.friction.mu", (0.3, 0.6), hz=50.0, harmonics=1, budget=few)
    mode = nonlinear_mode(rig, amplitudes=(1e-6, 1e-4), harmonics=1, budget=few)
    for found, value, unit in ((along, along.values[-1], ""), (mode, mode.amplitude[-1], " m")):
        assert (len(found.points), found.complete) == (4, False)
        assert found.branch.message.startswith(f"stopped at {value:.6g}{unit} (point 4, ")
        assert "): 4 points are its budget; " in found.branch.message


# ---------------------------------------------------------------------------------------------------------- commands


def ended(folder: Path, *arguments: str) -> tuple[int, str]:
    """Exit status and last line on stderr of a command that runs in a folder."""
    done = subprocess.run(
        [sys.executable, "-m", "hbm.cli", *arguments], cwd=folder, capture_output=True, text=True, timeout=120
    )
    return done.returncode, done.stderr.strip().splitlines()[-1] if done.stderr else ""


@pytest.mark.parametrize(
    "arguments",
    [
        ("continue", str(PAPER), "--parameter", "contact.friction.mu", "--from", "0.3", "--to", "0.6",
         "--frequency", "50", "--harmonics", "1", "--no-stability"),
        ("backbone", str(PAPER), "--harmonics", "1"),
    ],
    ids=lambda a: a[0],
)  # fmt: skip
def test_what_a_curve_s_budget_leaves_is_kept_and_marked(arguments: tuple[str, ...], tmp_path: Path) -> None:
    status, said = ended(tmp_path, *arguments, "--max-points", "5", "--out", "a.csv")
    assert status == 1
    assert re.match(rf"{arguments[0]}: .*partial.*5 points are its budget; ", said)
    known = json.dumps(json.loads((tmp_path / "a.json").read_text()))
    assert "5 points are its budget" in known
    with open(tmp_path / "a.csv") as file:
        assert max(int(row["point"]) for row in csv.DictReader(file)) == 5


@pytest.mark.parametrize(
    ("seconds", "arguments"),
    [
        ("1", ("simulate", str(PAPER), "--frequency", "50", "--duration", "600", "--out", "a.csv")),
        (
            "0.01",
            (
                "synthesize",
                str(PAPER),
                "--levels",
                "4",
                "6.5",
                "--frequencies",
                "46",
                "48",
                "50",
                "52",
                "--out",
                "a.csv",
            ),
        ),
        ("1", ("identify", *MEASURED, "--out", "a")),
        ("3", ("diagnose", *DIAGNOSED, "--out", "a")),
        ("0.01", ("inverse", *MEASURED, "--out", "a")),
        ("0.01", ("modal", MEASURED[1], "--out", "a.toml")),
    ],
    ids=lambda a: a[0] if isinstance(a, tuple) else "",
)
def test_what_makes_no_sense_by_half_ends_without_a_file(
    seconds: str, arguments: tuple[str, ...], tmp_path: Path
) -> None:
    status, said = ended(tmp_path, *arguments, "--max-seconds", seconds)
    assert status == 1
    assert said.startswith(f"{arguments[0]}: stopped after {seconds} s, its budget, at ")
    assert "; nothing written; " in said
    assert said.endswith(", or a larger --max-seconds")
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_said_of_what_a_command_that_ends_at_once_leaves_behind() -> None:
    """A semaphore of its workers: the tracker of the standard library cleans it up, and had the last word."""
    script = (
        "import multiprocessing, os, sys; from hbm.cli import main\n"
        "sys.argv = ['hbm', '--version']\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "left = multiprocessing.get_context('spawn').Semaphore()\n"
        "os._exit(0)"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)
    assert ended.stderr == ""
