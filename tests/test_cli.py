"""The command: what it prints, what it writes, and the one line and status with which it refuses or fails."""

import io
import re
import subprocess
import sys
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import typer
from rich.console import Console
from rich.text import Text
from typer.core import TyperGroup
from typer.testing import CliRunner, Result

import hbm
import hbm.integration.integrate
import hbm.response.accuracy
from continuation import ConvergenceError, End
from hbm.cli import app
from hbm.commands.tables import print_laws
from hbm.errors import InputError
from hbm.files.curves import read_curves
from hbm.modes.linear import contact_stiffness, linear_modes
from hbm.response.curve import ResponseCurve
from hbm.rigfiles.lawchoice import choose_law
from models import LAWS, FrictionLaw, Jenkins, describe
from models.joints import JOINT_LAWS
from models.published import (
    ASSUMED_IWAN,
    ASSUMED_VLFM,
    PAPER_COULOMB,
    PAPER_DAHL,
    PAPER_LUGRE,
    PAPER_PENALTY,
    PAPER_STRIBECK,
    paper_rig,
)

ROOT = Path(__file__).parents[1]
PAPER = str(ROOT / "examples" / "paper_beam.toml")
ONE_MODE = str(ROOT / "examples" / "one_mode.toml")
QUICK = ["--from", "40", "--to", "40.5", "--harmonics", "3"]


def run(*args: str) -> Result:
    return CliRunner().invoke(app, list(args), prog_name="hbm")


def command(*args: str) -> subprocess.CompletedProcess[str]:
    """The real thing, in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "hbm.cli", *args],
        cwd=ROOT,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )


def python(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout


# ----------------------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("args", "line"),
    [
        (["frf"], "hbm frf: missing argument 'RIG'; see hbm frf --help"),
        (["nope"], "hbm: no such command 'nope'; see hbm --help"),
        (["frf", PAPER, "--xyzzy"], "hbm frf: no such option: --xyzzy; see hbm frf --help"),
        (["frf", "no.toml"], "no.toml: no such file; must be a rig file (TOML)"),
        (["modes", "no.toml"], "no.toml: no such file; must be a rig file (TOML)"),
        (["frf", PAPER, "--from", "5", "--to", "5.0"], "frf: --to = 5.0; must differ from --from = 5"),
        (["frf", PAPER, "--from", "5"], "frf: --from without --to; must have both or neither"),
        (["frf", PAPER, "--to", "5"], "frf: --to without --from; must have both or neither"),
        (["frf", PAPER, "--from", "x", "--to", "5"], 'frf: --from = "x"; must be a number > 0 [Hz]'),
        (["frf", PAPER, "--from", "-5", "--to", "5"], "frf: --from = -5; must be a number > 0 [Hz]"),
        (["frf", PAPER, "--from", "5", "--to", "inf"], "frf: --to = inf; must be a number > 0 [Hz]"),
        (["frf", PAPER, "--level", "0"], "frf: --level = 0; must be a number > 0 [N]"),
        (["frf", PAPER, "--level", "2", "-1"], "frf: --level = -1; must be a number > 0 [N]"),
        (["frf", PAPER, "--level", "nan"], "frf: --level = nan; must be a number > 0 [N]"),
        (["frf", PAPER, "--level", "two"], 'frf: --level = "two"; must be a number > 0 [N]'),
        (["frf", PAPER, "--level", "2", "2.0"], "frf: --level = 2 twice; must be different forces"),
        (["frf", PAPER, "--harmonics", "0"], "frf: --harmonics = 0; must be auto or a whole number from 1 to 200"),
        (["frf", PAPER, "--harmonics", "x"], 'frf: --harmonics = "x"; must be auto or a whole number from 1 to 200'),
        (["frf", PAPER, "--harmonics", "2.5"], "frf: --harmonics = 2.5; must be auto or a whole number from 1 to 200"),
        (
            ["frf", PAPER, "--law", "xyz"],
            f'frf: --law = "xyz"; must be one of {", ".join(LAWS)}, or file.py:Class',
        ),
        (
            ["frf", PAPER, "--law", "viscous"],
            'frf: --law = "viscous"; no parameters are known of it; write the law with its parameters in the rig file',
        ),
        (["frf", PAPER, "--out", "c.txt"], 'frf: --out = "c.txt"; must end in .csv'),
        (["frf", PAPER, "--out", "no/c.csv"], "frf: --out = \"no/c.csv\"; there is no directory 'no', create it first"),
        (["frf", PAPER, "--plot", "c.jpg"], 'frf: --plot = "c.jpg"; must end in .png or .pdf or .svg'),
        (
            ["laws", "dahl", "lugree"],
            f'laws: "lugree"; must be one of {", ".join(LAWS | JOINT_LAWS)}, or file.py:Class; did you mean lugre?',
        ),
        (
            ["laws", "impact-stop", "--plot", "l.png"],
            f'laws: --plot of "impact-stop"; must be one of {", ".join(LAWS)}, or file.py:Class',
        ),
        (["laws", "--slip", "1e-5"], "laws: --slip without --plot; must have both"),
        (["laws", "--load", "80"], "laws: --load without --plot; must have both"),
        (["laws", "--plot", "l.png", "--slip", "0"], "laws: --slip = 0; must be a number > 0 [m]"),
        (["laws", "--plot", "l.png", "--frequency", "x"], 'laws: --frequency = "x"; must be a number > 0 [Hz]'),
        (["laws", "--plot", "l.txt"], 'laws: --plot = "l.txt"; must end in .png or .pdf or .svg'),
        (
            ["laws", "viscous", "--plot", "l.png"],
            "laws: --plot of viscous; no parameters are known of it to draw its loops with",
        ),
        (["simulate", PAPER], "hbm simulate: missing option '--frequency'; see hbm simulate --help"),
        (["simulate", PAPER, "--frequency", "0"], "simulate: --frequency = 0; must be a number > 0 [Hz]"),
        (
            ["simulate", PAPER, "--frequency", "50", "--duration", "x"],
            'simulate: --duration = "x"; must be a number > 0 [s]',
        ),
        (
            ["simulate", PAPER, "--frequency", "50", "--duration", "1e9"],
            "simulate: --duration = 1e+09; must be <= 781.25 s at 50 Hz, for memory's sake",
        ),
        (
            ["simulate", PAPER, "--frequency", "50", "--duration", "1e-9"],
            "simulate: --duration = 1e-09; must be at least a step, 3.91e-05 s here",
        ),
        (
            ["simulate", PAPER, "--frequency", "50", "--contact"],
            "simulate: --contact without --out; must have both",
        ),
        (["simulate", PAPER, "--frequency", "50", "--out", "c"], 'simulate: --out = "c"; must end in .csv'),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    args: list[str], line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(*args)
    assert (result.stderr, result.stdout, result.exit_code) == (f"{line}\n", "", 2)
    assert list(tmp_path.iterdir()) == []


def test_bad_input_in_a_real_process() -> None:
    done = command("frf", PAPER, "--level", "-1")
    assert (done.stderr, done.stdout, done.returncode) == ("frf: --level = -1; must be a number > 0 [N]\n", "", 2)


def test_a_bad_rig_file_is_one_line_and_nothing_is_written(tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text(Path(PAPER).read_text().replace("mu = 0.52", "mu = -0.2"))
    done = command("frf", str(bad), "--out", str(tmp_path / "c.csv"), "--plot", str(tmp_path / "c.png"))
    assert done.stderr == f"{bad}: contact.friction.mu = -0.2; must be > 0\n"
    assert done.returncode == 2
    assert list(tmp_path.iterdir()) == [bad]


# --------------------------------------------------------------------------------------------------------------- modes


def test_modes_prints_sliding_and_stuck() -> None:
    done = command("modes", PAPER)
    assert (done.returncode, done.stderr) == (0, "")
    lines = [line.split() for line in done.stdout.splitlines()]
    assert ["1", "47.842", "56.005", "0.00998"] in lines
    assert "residual compliance at the contact: 3.118e-08 m/N" in done.stdout


def test_stuck_frequencies_of_the_reference() -> None:
    """k_t = 1.04e7 N/m, 5 modes: 57.728 Hz without, 56.004 Hz with C_res (docs/theory/equations.md)."""
    rig = paper_rig()
    bare = replace(rig, contact=replace(rig.contact, residual_compliance=False))
    assert contact_stiffness(bare) == pytest.approx(1.04e7, rel=1e-6)
    assert linear_modes(bare).stuck_hz[0] == pytest.approx(57.728, abs=1e-3)
    assert linear_modes(rig).stuck_hz[0] == pytest.approx(56.004, abs=1e-3)


def test_a_rigid_contact_takes_a_mode_away() -> None:
    rig = paper_rig(PAPER_COULOMB)
    rigid = linear_modes(replace(rig, contact=replace(rig.contact, residual_compliance=False)))
    assert np.isinf(rigid.stiffness)
    assert np.isnan(rigid.stuck_hz[-1])
    assert np.all(rigid.stuck_hz[:-1] > rigid.sliding_hz[:-1])
    assert np.all(rigid.stuck_hz[:-1] < rigid.sliding_hz[1:])


def test_without_friction_stuck_is_sliding() -> None:
    done = run("modes", ONE_MODE)
    assert ["1", "50.000", "50.000", "1"] in [line.split() for line in done.stdout.splitlines()]


# ----------------------------------------------------------------------------------------------------------------- frf


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """Two levels after one flag, to a file and a figure."""
    folder = tmp_path_factory.mktemp("swept")
    out, plot = str(folder / "c.csv"), str(folder / "c.png")
    return run("frf", PAPER, *QUICK, "--level", "2", "4", "--out", out, "--plot", plot), folder


def test_frf_writes_every_level_its_companion_and_the_figure(swept: tuple[Result, Path]) -> None:
    result, folder = swept
    assert (result.exit_code, result.stderr) == (0, "")
    assert sorted(p.name for p in folder.iterdir()) == ["c.csv", "c.json", "c.png"]
    saved = read_curves(folder / "c.csv")
    assert [curve.level for curve in saved] == [2.0, 4.0]
    for curve in saved:
        assert curve.hz[[0, -1]] == pytest.approx([40.0, 40.5])
        assert curve.summary["complete"] is True
    assert (folder / "c.png").read_bytes().startswith(b"\x89PNG")
    assert result.stdout.splitlines()[-3:] == [f"wrote {folder / name}" for name in ("c.csv", "c.json", "c.png")]


def test_frf_table_holds_the_numbers_of_the_file(swept: tuple[Result, Path]) -> None:
    result, folder = swept
    rows = [line.split() for line in result.stdout.splitlines()]
    for curve in read_curves(folder / "c.csv"):
        drive = curve["drive"].peak
        top = int(np.argmax(drive))
        mine = next(row for row in rows if row[:2] == [f"{curve.level:g}", str(len(curve.hz))])
        assert mine[2:6] == [
            f"{1e3 * drive[top]:.4g}",
            f"{curve.hz[top]:.2f}",
            f"{1e6 * curve['slip'].peak.max():.3g}",
            f"{curve['friction'].peak.max():.3g}",
        ]
        error = curve.summary["numerical_error"]
        numerics = next(row for row in rows if row[:4] == [f"{curve.level:g}", "3", "256", "5"])
        assert numerics[4] == f"{100 * error['at_peak']['total']:.2f}"
    assert "2 N: H = 3 as asked for" in result.stdout


def test_piped_output_is_plain_and_narrow(swept: tuple[Result, Path]) -> None:
    assert "\x1b" not in swept[0].stdout
    table = swept[0].stdout.split("as asked for")[0].splitlines()
    assert max(map(len, table)) <= 90
    assert "…" not in swept[0].stdout


def test_linear_rig_peaks_at_its_closed_form(tmp_path: Path) -> None:
    out = str(tmp_path / "c.csv")
    result = run("frf", ONE_MODE, "--from", "49", "--to", "48", "--harmonics", "1", "--out", out)
    assert result.exit_code == 0
    (curve,) = read_curves(out)
    assert curve.hz[0] > curve.hz[-1]  # a downward sweep
    omega, omega_n = 2 * np.pi * curve.hz, 2 * np.pi * 50.0
    exact = 1.0 / np.hypot(omega_n**2 - omega**2, 0.02 * omega_n * omega)
    assert curve["drive"].amplitude[:, 1] == pytest.approx(exact, rel=1e-8)


def test_frf_says_what_is_stable(swept: tuple[Result, Path], tmp_path: Path) -> None:
    result, folder = swept
    assert "2 N: stable everywhere" in result.stdout.splitlines()
    assert all(np.all(curve.stable == 1.0) for curve in read_curves(folder / "c.csv"))
    out = str(tmp_path / "c.csv")
    result = run("frf", PAPER, *QUICK, "--no-stability", "--out", out)
    assert (result.exit_code, "stable everywhere" in result.stdout) == (0, False)
    assert np.isnan(read_curves(out)[0].stable).all()


def test_frf_says_where_stability_cannot_be_told(tmp_path: Path) -> None:
    out = str(tmp_path / "c.csv")
    quick = ["--from", "40", "--to", "40.5", "--harmonics", "3", "--law", "coulomb-lagrange"]
    result = run("frf", ONE_MODE, *quick, "--out", out)
    assert (result.exit_code, result.stderr) == (0, "")
    refusal = "1 N: stability: one mode is rigid where coulomb-lagrange sticks; "
    assert refusal + "must have residual_compliance = true, or a law that yields" in result.stdout.splitlines()
    assert np.isnan(read_curves(out)[0].stable).all()


def test_levels_may_be_repeated_or_listed() -> None:
    from hbm.commands.options import spread

    assert spread("--level", ["--level", "2", "--level", "4"]) == ["--level", "2", "--level", "4"]
    assert spread("--level", ["--level", "2", "4", "-1", "rig.toml", "5"]) == [
        *("--level", "2", "--level", "4", "--level", "-1"),
        *("rig.toml", "5"),
    ]


def test_another_law_says_where_its_parameters_come_from() -> None:
    result = run("frf", PAPER, *QUICK, "--law", "coulomb-lagrange")
    assert result.exit_code == 0
    first = "law coulomb-lagrange, the paper's parameters (models.published.PAPER_COULOMB): mu = 0.52"
    assert result.stdout.splitlines()[0] == first
    assert "Table 1, coulomb-lagrange" in result.stdout


@pytest.mark.parametrize(
    ("name", "published"),
    [
        ("stribeck", PAPER_STRIBECK),
        ("dahl", PAPER_DAHL),
        ("lugre", PAPER_LUGRE),  # not the printed one, whose stiffness contradicts itself
        ("vlfm", ASSUMED_VLFM),
        ("iwan", ASSUMED_IWAN),
    ],
)
def test_another_law_comes_with_its_whole_published_set(name: str, published: FrictionLaw) -> None:
    """The rig's own mu = 0.52 means nothing beside a fitted mu_static = 0.492."""
    choice = choose_law(paper_rig(), name)
    assert choice.rig.contact.law is published


def test_assumed_values_are_called_so() -> None:
    assert str(choose_law(paper_rig(), "iwan")) == (
        "law iwan, assumed parameters (models.published.ASSUMED_IWAN): "
        "mu = 0.52, stiffness = 1.04e7, spread = 1, elements = 10, distribution = uniform"
    )


def test_the_rigs_own_law_stays_as_it_is() -> None:
    rig = paper_rig(Jenkins(mu=0.4, critical_slip=1e-6))
    choice = choose_law(rig, "coulomb-penalty")
    assert choice.rig is rig
    assert str(choice) == "law coulomb-penalty, the rig file's parameters: mu = 0.4, critical_slip = 1e-6"


def test_a_law_without_parameters_needs_none() -> None:
    assert str(choose_law(paper_rig(), "none")) == "law none: no parameters"


def test_a_law_without_values_is_refused() -> None:
    with pytest.raises(InputError, match="no parameters are known of it"):
        choose_law(paper_rig(), "viscous")


# ---------------------------------------------------------------------------------------------------------------- laws


def test_laws_lists_every_law_and_parameter_with_everything_known_of_it() -> None:
    result = run("laws")
    assert (result.exit_code, result.stderr) == (0, "")
    text = " ".join(result.stdout.split())
    for name, law in (LAWS | JOINT_LAWS).items():
        assert any(line.split()[:1] == [name] for line in result.stdout.splitlines())
        for key, p in describe(law).items():
            bound = f">= {p.at_least}" if p.at_least else p.bound
            pattern = (
                rf"{key} \S+ {'' if p.unit == '1' else p.unit + ' '}{re.escape(f'{bound} {p.meaning}; {p.source}')}"
            )
            assert re.search(pattern, text), (name, key)
    assert "elements 10 1 to 200 number of Jenkins elements" in text
    assert "array of > 0 limit of each element" in text
    assert "bristle_damping 347.03 N s/m" in text


@pytest.mark.parametrize("width", [80, 120])
def test_laws_cut_nothing_at_any_width(width: int) -> None:
    wide, narrow = (Console(width=columns, record=True, file=io.StringIO()) for columns in (400, width))
    for console in (wide, narrow):
        print_laws(console, list((LAWS | JOINT_LAWS).values()), detailed=False)
    text = narrow.export_text(clear=False)
    assert max(map(len, text.splitlines())) <= width
    assert sorted(text.split()) == sorted(wide.export_text().split())  # every word, where the lines are broken aside


def test_one_law_is_told_in_full() -> None:
    result = run("laws", "lugre")
    assert "g = R [mu + (mu_static - mu) exp(-(v / v_s)^2)]." in result.stdout
    assert "the paper's parameters (models.published.PAPER_LUGRE)" in result.stdout
    assert "dahl" not in result.stdout


def test_a_law_of_joints_is_told_in_full() -> None:
    result = run("laws", "impact-stop")
    assert result.exit_code == 0
    lines = [" ".join(line.split()) for line in result.stdout.splitlines()]
    assert lines[0] == "impact-stop in [[joints]] only"
    assert "gap 0 m any clearance; catalogue of causes; 0 if left out" in lines


def test_laws_draws_loops_and_prints_what_they_lose(tmp_path: Path) -> None:
    plot = tmp_path / "l.png"
    result = run("laws", "coulomb-penalty", "none", "--plot", str(plot), "--slip", "2e-5", "--load", "100")
    assert (result.exit_code, result.stderr) == (0, "")
    rows = [line.split() for line in result.stdout.splitlines()]
    u_crit = PAPER_PENALTY.critical_slip  # at the load given: k_t = mu P / u_crit
    lost = 4 * 0.52 * 100.0 * (2e-5 - u_crit)
    assert ["coulomb-penalty", "52", f"{1e3 * lost:.4g}", "PAPER_PENALTY"] in rows
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert result.stdout.splitlines()[-1] == f"wrote {plot}"


# ---------------------------------------------------------------------------------------------- failures of computation


@pytest.fixture(scope="module")
def found() -> ResponseCurve:
    return hbm.response.accuracy.frequency_response(paper_rig(), (40.0, 40.5), harmonics=1)


@pytest.fixture
def failing(
    found: ResponseCurve, monkeypatch: pytest.MonkeyPatch
) -> Callable[[dict[float, Callable[[ResponseCurve], ResponseCurve]]], None]:
    """Make the levels given go wrong as given; the others give a curve."""

    def arrange(wrong: dict[float, Callable[[ResponseCurve], ResponseCurve]]) -> None:
        def response(*_: Any, level: float, **__: Any) -> ResponseCurve:
            curve = replace(found, problem=copy(found.problem))
            curve.problem.level = level
            return wrong.get(level, lambda found: found)(curve)

        monkeypatch.setattr(hbm.response.accuracy, "frequency_response", response)

    return arrange


def stopped(found: ResponseCurve) -> ResponseCurve:
    curve = found
    branch = replace(
        curve.branch, points=curve.branch.points[:3], end=End.STEP_BELOW_MINIMUM, message="step below the minimum"
    )
    return replace(curve, points=curve.points[:3], branch=branch)


def lost(found: ResponseCurve) -> ResponseCurve:
    raise ConvergenceError("first solution: none at 40 Hz", found.branch)


def interrupted(found: ResponseCurve) -> ResponseCurve:
    raise KeyboardInterrupt


def test_a_partial_curve_is_written_and_marked(failing: Any, tmp_path: Path) -> None:
    failing({4.0: stopped})
    out, plot = tmp_path / "c.csv", tmp_path / "c.png"
    result = run("frf", PAPER, *QUICK, "--level", "2", "4", "--out", str(out), "--plot", str(plot))
    assert result.exit_code == 1
    whole, part = read_curves(out)
    assert result.stderr == f"frf: 4 N: partial curve, 40 to {part.hz[-1]:.5g} Hz; step below the minimum\n"
    assert (whole.summary["complete"], part.summary["complete"]) == (True, False)
    assert (len(part.hz), part.summary["message"]) == (3, "step below the minimum")
    assert plot.exists()


def test_a_lost_level_is_said_and_the_others_are_kept(failing: Any, tmp_path: Path) -> None:
    failing({2.0: lost})
    result = run("frf", PAPER, *QUICK, "--level", "2", "4", "--out", str(tmp_path / "c.csv"))
    assert (result.exit_code, result.stderr) == (1, "frf: 2 N: first solution: none at 40 Hz\n")
    assert [curve.level for curve in read_curves(tmp_path / "c.csv")] == [4.0]


def test_nothing_found_writes_nothing(failing: Any, tmp_path: Path) -> None:
    failing({2.0: lost})
    result = run("frf", PAPER, *QUICK, "--level", "2", "--out", str(tmp_path / "c.csv"))
    assert (result.exit_code, result.stdout) == (1, "")
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_keeps_the_levels_that_were_done(failing: Any, tmp_path: Path) -> None:
    failing({4.0: interrupted})
    result = run("frf", PAPER, *QUICK, "--level", "2", "4", "6", "--out", str(tmp_path / "c.csv"))
    assert (result.exit_code, result.stderr) == (130, "frf: interrupted at 4 N; 2 of 3 levels not computed\n")
    assert [curve.level for curve in read_curves(tmp_path / "c.csv")] == [2.0]


@pytest.mark.parametrize(
    ("error", "line", "status"),
    [
        (ArithmeticError("step 3 cannot be solved"), "hbm: step 3 cannot be solved", 1),
        (KeyboardInterrupt(), "hbm: interrupted, nothing half written", 130),
        (MemoryError(), "hbm: out of memory", 1),
    ],
)
def test_a_failed_simulation_is_one_line_and_its_status(
    error: BaseException, line: str, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(hbm.integration.integrate, "simulate", fail)
    result = run("simulate", PAPER, "--frequency", "50", "--out", str(tmp_path / "h.csv"))
    assert (result.stderr, result.stdout, result.exit_code) == (f"{line}\n", "", status)
    assert list(tmp_path.iterdir()) == []


# ------------------------------------------------------------------------------------------------------------ simulate


def test_simulate_writes_the_history_and_the_figure(tmp_path: Path) -> None:
    out, plot = tmp_path / "h.csv", tmp_path / "h.svg"
    done = command(
        *("simulate", ONE_MODE, "--frequency", "40", "--duration", "0.1", "--level", "1.5"),
        *("--out", str(out), "--plot", str(plot)),
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert out.read_text().splitlines()[0] == "time_s,force,a1"
    time, force, _ = np.loadtxt(out, delimiter=",", skiprows=1).T
    assert time[-1] == pytest.approx(0.1)
    assert force == pytest.approx(1.5 * np.cos(2 * np.pi * 40.0 * time))
    assert plot.read_text().startswith("<?xml")
    assert done.stdout.splitlines()[-2:] == [f"wrote {out}", f"wrote {plot}"]


def test_simulate_lasts_50_periods_unless_told() -> None:
    assert "50 periods, 1 s" in run("simulate", ONE_MODE, "--frequency", "50").stdout


def test_simulate_says_how_settled_a_motion_is() -> None:
    said = "drive displacement {} from one period to the next"
    assert said.format("still changes by 0.31%") in run("simulate", ONE_MODE, "--frequency", "50").stdout
    settled = run("simulate", ONE_MODE, "--frequency", "40", "--duration", "5")
    assert said.format("changes by less than 0.01%") in settled.stdout


def test_simulate_says_of_one_period_that_it_is_one() -> None:
    assert (
        "513 samples, 1 period, 0.02 s" in run("simulate", ONE_MODE, "--frequency", "50", "--duration", "0.02").stdout
    )


def test_simulate_at_a_level_of_ones_own(tmp_path: Path) -> None:
    out = tmp_path / "h.csv"
    done = run("simulate", ONE_MODE, "--frequency", "40", "--level", "3", "--duration", "0.1", "--out", str(out))
    assert done.exit_code == 0
    time, force, _ = np.loadtxt(out, delimiter=",", skiprows=1).T
    assert force == pytest.approx(3.0 * np.cos(2 * np.pi * 40.0 * time))


# ---------------------------------------------------------------------------------------------------------------- help


@pytest.mark.parametrize("name", [c.name or c.callback.__name__ for c in app.registered_commands if c.callback])
def test_help_shows_every_word_that_it_is_made_of(name: str) -> None:
    command = cast(TyperGroup, typer.main.get_command(app)).commands[name]
    for text in [command.help, *(getattr(p, "help", None) for p in command.params)]:
        assert text is None or Text.from_markup(text).plain == text  # square brackets are Rich's markup


# ------------------------------------------------------------------------------------------------- light on its feet


@pytest.mark.parametrize("args", [["--version"], ["--help"], ["frf", "--help"], ["nope"]])
def test_help_and_version_load_nothing_heavy(args: list[str]) -> None:
    code = (
        "import sys; from hbm.cli import app\n"
        f"try: app({args!r})\n"
        "except SystemExit: pass\n"
        "print([m for m in ('casadi', 'scipy', 'numpy', 'matplotlib') if m in sys.modules])"
    )
    assert python(code).splitlines()[-1] == "[]"


def test_only_figures_load_matplotlib_and_curves_no_statistics() -> None:
    modules = "sys, hbm, hbm.files.curves, hbm.commands.tables, hbm.commands.progress, hbm.response.bifurcations"
    unwanted = "('matplotlib', 'scipy.stats', 'scipy.signal', 'scipy.optimize')"
    code = f"import {modules}\nhbm.simulate\nprint([m for m in {unwanted} if m in sys.modules])"
    assert python(code) == "[]\n"


def test_version() -> None:
    done = command("--version")
    assert (done.stdout, done.returncode) == (f"hbm {hbm.__version__}\n", 0)


def test_the_help_of_laws_has_an_example() -> None:
    assert "Example:  hbm laws dahl iwan --plot loops.png" in run("laws", "--help").stdout


@pytest.mark.parametrize("name", ["modes", "frf", "simulate"])
def test_every_help_has_an_example(name: str) -> None:
    result = run(name, "--help")
    assert result.exit_code == 0
    assert f"Example:  hbm {name} examples/paper_beam.toml" in result.stdout


def test_every_public_name_is_there() -> None:
    for name in hbm.__all__:
        assert getattr(hbm, name).__name__ == name
    assert set(hbm.__all__) <= set(dir(hbm))
    with pytest.raises(AttributeError, match="module 'hbm' has no attribute 'nope'"):
        _ = hbm.nope
