"""A friction law from a file of one's own: how it is found, refused, and used like any other."""

import os
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from continuation import ConvergenceError
from hbm.cli import app
from hbm.errors import InputError
from hbm.integration.handover import state_at_phase_zero
from hbm.integration.integrate import simulate
from hbm.integration.integrate import steady_state as shoot
from hbm.parallel import Helped
from hbm.response import start
from hbm.response.loop import friction_loop
from hbm.response.trace import steady_state
from hbm.rigfiles.lawchoice import choose_law
from hbm.rigfiles.laws import files_run, find_law, run_files
from hbm.rigfiles.load import load_rig
from models import LAWS, Dahl, Damping
from models.friction import parameters
from models.friction.extended import beside_dashpot
from models.joints import JOINT_LAWS
from models.published import paper_rig

ROOT = Path(__file__).parents[1]
RIG = ROOT / "examples" / "paper_beam_bouc_wen.toml"
FILE = ROOT / "examples" / "bouc_wen.py"
BoucWen: Any = find_law("bouc_wen.py:BoucWen", FILE.parent)

LAW = """\
from dataclasses import dataclass, field
from typing import ClassVar
from models.friction import parameter

@dataclass(frozen=True, eq=False)
class Spring:
    "A spring."
    name: ClassVar[str] = "spring"
    states: ClassVar[int] = 0
    set_valued: ClassVar[bool] = False
    stiffness: float = field(metadata=parameter("N/m", "stiffness", "Hooke 1678"))

    def advance(self, z, before, now):
        return z, -self.stiffness * now.displacement
"""
RETURNS = "return z, -self.stiffness * now.displacement"


def run(*args: str) -> Any:
    return CliRunner().invoke(app, list(args), prog_name="hbm")


# ------------------------------------------------------------------------------------------------------ the example


def test_the_page_shows_the_file_verbatim() -> None:
    page = (ROOT / "docs" / "howto" / "own_law.md").read_text(encoding="utf-8")
    first = re.search(r"```python\n(.*?)```", page, re.DOTALL)
    assert first is not None
    assert first[1] == FILE.read_text(encoding="utf-8")


def test_the_check_of_the_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "docs" / "howto" / "own_law.md").read_text(encoding="utf-8")
    code = re.findall(r"```python\n(.*?)```", page, re.DOTALL)[1]
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))  # as a script or an interpreter started there has it
    exec(code, scope := {})
    dahl, ours = scope["loops"]
    assert ours.T == pytest.approx(dahl.T, abs=1e-9)
    theirs, mine = map(float, capsys.readouterr().out.splitlines()[-2:])
    assert 0.5 * theirs < mine < 0.6 * theirs
    assert (tmp_path / "loops.png").exists()


@pytest.mark.parametrize("amplitude", [1e-6, 1e-5, 1e-3])
@pytest.mark.parametrize("compliance", [0.0, 3e-8])
def test_exponent_1_and_beta_1_is_dahl_under_a_constant_load(amplitude: float, compliance: float) -> None:
    dahl, ours = Dahl(0.5, 1e7), BoucWen(0.5, 1e7, exponent=1.0, beta=1.0)
    theirs, mine = (
        friction_loop(law, amplitude, 50.0, load=83.0, compliance=compliance, samples=256) for law in (dahl, ours)
    )
    assert mine.T == pytest.approx(theirs.T, abs=1e-9)


def test_under_a_load_that_swings_it_is_another_law() -> None:
    """A contact that sticks: dT = -k dx of Dahl's law; of this one T = -R z, dz = k dx / R, by quadrature."""
    swinging, hz, x = [80.0, 0.0, 0.0, 0.0, 40.0], 50.0, 1e-9
    laws = Dahl(0.5, 1e7), BoucWen(0.5, 1e7, exponent=1.0, beta=1.0)
    dahl, ours = (friction_loop(law, x, hz, load=80.0, reaction=swinging) for law in laws)
    theta = 2 * np.pi * np.arange(1024) / 1024
    R = 80.0 + 40.0 * np.sin(2 * theta)
    rate = -1e7 * x * np.sin(theta) / R
    z = np.cumsum((rate + np.roll(rate, 1)) / 2) * (theta[1] - theta[0])
    assert dahl.T == pytest.approx(-1e7 * x * np.cos(theta), abs=1e-5)
    assert ours.T == pytest.approx(-R * (z - z.mean()), abs=1e-5)
    assert np.ptp(ours.T) > 1.3 * np.ptp(dahl.T)
    lost = [friction_loop(law, 1e-6, hz, load=80.0, reaction=swinging).dissipated for law in laws]
    assert lost[0] > 0.0 > lost[1]  # as the page says


@pytest.mark.parametrize(("exponent", "beta"), [(1.0, 0.5), (2.0, 0.5), (2.0, 0.8), (5.0, 1.0)])
def test_error_of_the_step_falls_with_its_square(exponent: float, beta: float) -> None:
    law = BoucWen(0.5, 1e7, exponent=exponent, beta=beta)
    lost = [friction_loop(law, 1e-5, 50.0, load=83.0, samples=n).dissipated for n in (128, 512, 4096)]
    assert abs(lost[1] - lost[2]) < abs(lost[0] - lost[2]) / 8
    assert lost[2] > 0.0


def test_bouc_wen_never_exceeds_its_limit_however_long_the_step() -> None:
    loop = friction_loop(BoucWen(0.5, 1e7, exponent=2.0), 0.01, 50.0, load=83.0, samples=16)
    assert np.abs(loop.T).max() == pytest.approx(0.5 * 83.0)


@pytest.mark.parametrize("hz", [49.0, 56.0])
def test_harmonic_balance_agrees_with_time_integration(hz: float) -> None:
    """Ten times the paper's damping, so that transients end; 1e-4 of each channel's peak, harmonics 1..5."""
    rig = replace(load_rig(RIG, allow_code=True), damping=Damping(mass_proportional=0.6))
    solution = steady_state(rig, hz, harmonics=25, samples=1024)
    motion = shoot(rig, hz, start=state_at_phase_zero(solution), steps_per_period=1024)
    assert motion.converged
    for name in ("drive", "slip", "friction", "normal"):
        values = motion.history.channels[name].values
        a, H = solution.channels[name].coefficients, solution.basis.H
        ours = np.concatenate([a[1:6], a[H + 1 : H + 6]])
        difference = np.abs(ours - motion.history.coefficients(name, 5)[1:]).max()
        assert difference < 1e-4 * np.abs(values - values.mean()).max(), name


@pytest.mark.parametrize(("hz", "level", "way"), [(88.0, 0.1, ""), (76.0, 1.0, "_by_time"), (76.0, 10.0, "_by_time")])
def test_a_mean_that_motion_decides_is_found(
    hz: float, level: float, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """R swings with the motion u, and so the integral of v / R over a period is none: z drifts until |z|^2 holds it.

    Its mean is that of the root of the motion, which no slope at rest tells. Marched from rest it is the same. It is
    found in time and, without that, from the linear motion.
    """
    if way:
        monkeypatch.setattr(start, way, lambda *_, **__: None)
    paper = load_rig(RIG, allow_code=True)
    body = replace(paper.body, length=0.45, width=0.03, thickness=0.004)
    damping, force = Damping(mass_proportional=6.0), replace(paper.excitation, position=0.225)
    contact = replace(paper.contact, normal_load=60.0)
    rig = replace(paper, body=body, damping=damping, contact=contact, excitation=force, channels=())
    found = steady_state(rig, hz, level=level, samples=256)["friction"]
    marched = simulate(rig, hz, level=level, duration=200 / hz, steps_per_period=256, last_periods=1)
    mean, cosine, sine = marched.coefficients("friction", 1)
    assert found.coefficients[0] == pytest.approx(mean, rel=2e-3)
    assert found.amplitude[1] == pytest.approx(np.hypot(cosine, sine), rel=2e-3)


def test_frf_of_the_example(tmp_path: Path) -> None:
    out = tmp_path / "c.csv"
    result = run("frf", str(RIG), "--allow-code", "--from", "40", "--to", "40.5", "--harmonics", "3", "--out", str(out))
    assert (result.exit_code, result.stderr) == (0, "")
    assert "clamped-supported beam, Table 1, bouc-wen" in result.stdout
    assert out.exists()


def test_law_option_takes_the_set_of_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(FILE.parent)
    choice = choose_law(paper_rig(), "bouc_wen.py:BoucWen")
    assert parameters(choice.rig.contact.law) == parameters(load_rig(RIG, allow_code=True).contact.law)
    assert str(choice) == (
        "law bouc-wen, parameters PAPER_BEAM of its file: mu = 0.52, stiffness = 1.04e7, exponent = 2, beta = 0.5"
    )
    assert choose_law(load_rig(RIG, allow_code=True), "bouc_wen.py:BoucWen").source == "the rig file's parameters"


def test_laws_describes_it() -> None:
    result = run("laws", f"{FILE}:BoucWen")
    assert result.exit_code == 0
    assert "parameters PAPER_BEAM of its file" in result.stdout
    row = "beta 0.5 >= 0.5 and <= 1 share that opposes sliding; Wen 1976; 0.5 if left out"
    assert row in [" ".join(line.split()) for line in result.stdout.splitlines()]


def test_its_parameters_are_checked_like_any_others(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    (tmp_path / "bouc_wen.py").write_bytes(FILE.read_bytes())
    for old, new, message in (
        ("beta = 0.5 ", "beta = 0.4 ", "contact.friction.beta = 0.4; must be >= 0.5 and <= 1"),
        ("stiffness = 1.04e7", "", "contact.friction.stiffness is missing; required keys are law, mu, stiffness"),
        (
            "beta = 0.5 ",
            "betta = 0.5 ",
            "contact.friction.betta is unknown; accepted keys are law, mu, stiffness, exponent, beta; "
            "did you mean beta?",
        ),
    ):
        rig.write_text(RIG.read_text().replace(old, new))
        with pytest.raises(InputError) as refused:
            load_rig(rig, allow_code=True)
        assert str(refused.value) == f"{rig}: {message}"


def test_a_law_is_sent_to_another_process_that_ran_its_file() -> None:
    law = load_rig(RIG, allow_code=True).contact.law
    damped = beside_dashpot(type(law))(**parameters(law), coefficient=0.1)
    with Helped(1, partial(run_files, [FILE])) as process:
        for one in (law, damped):
            assert process.submit(parameters, one).result() == parameters(one)


# -------------------------------------------------------------------------------------------------- found or refused


def found(tmp_path: Path, code: str, name: str = "own.py:Spring") -> type:
    (tmp_path / "own.py").write_text(code)
    return find_law(name, tmp_path)


def test_a_file_is_run_once_and_again_when_it_changes(tmp_path: Path) -> None:
    first = found(tmp_path, LAW)
    assert find_law("own.py:Spring", tmp_path) is first
    again = found(tmp_path, LAW + "# longer\n")
    assert again is not first
    assert tmp_path / "own.py" in files_run()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["own.py"]  # no __pycache__


def test_a_law_without_values_is_refused_by_law_and_plot(tmp_path: Path) -> None:
    found(tmp_path, LAW)
    name = f"{tmp_path / 'own.py'}:Spring"
    assert run("frf", str(RIG), "--allow-code", "--law", name).stderr == (
        f'frf: --law = "{name}"; no parameters are known of it; write the law with its parameters in the rig file\n'
    )
    assert "NAME = " in run("laws", name, "--plot", str(tmp_path / "l.png")).stderr
    assert not (tmp_path / "l.png").exists()


NO_LAW = "Spring in {path} is no friction law: "
REFUSED = {
    "no class named": (LAW, "own.py", "must name a class too, own.py:Class"),
    "no such file": (LAW, "nowhere.py:Spring", "there is no file {folder}nowhere.py"),
    "no such class": (LAW, "own.py:Sprung", "{path} has no class Sprung; it has Spring"),
    "no class at all": ("x = 1\n", "own.py:x", "{path} has no class x; it has none"),
    "bad syntax": ("x = 1\ndef f(:\n", "own.py:f", "{path} line 2: SyntaxError: invalid syntax"),
    "fails to import": ("\nimport nope\n", "own.py:f", "{path} line 2: ModuleNotFoundError: No module named 'nope'"),
    "exits": ("raise SystemExit(3)\n", "own.py:f", "{path} line 1: SystemExit: 3"),
    "no name": (LAW.replace("    name:", "    title:"), "", NO_LAW + 'it needs name: ClassVar[str] = "..."'),
    "no states": (LAW.replace("    states:", "    state:"), "", NO_LAW + "it needs states: ClassVar[int] = ..."),
    "no kind": (
        LAW.replace("    set_valued:", "    kind:"),
        "",
        NO_LAW + "it needs set_valued: ClassVar[bool] = False",
    ),
    "no advance": (
        LAW.replace("advance", "march"),
        "",
        NO_LAW + "it needs a method advance(self, z, before, now)",
    ),
    "not frozen": (
        LAW.replace("@dataclass(frozen=True, eq=False)", "@dataclass"),
        "",
        NO_LAW + "it must be decorated with @dataclass(frozen=True, eq=False)",
    ),
    "not a dataclass": (
        LAW.replace("@dataclass(frozen=True, eq=False)", ""),
        "",
        NO_LAW + "it must be decorated with @dataclass(frozen=True, eq=False)",
    ),
    "bare field": (
        re.sub(r"field\(.*\)", "1.0", LAW),
        "",
        NO_LAW + "its field stiffness needs metadata=parameter(unit, meaning, source), of models.friction",
    ),
    "setting without default": (
        LAW.replace('parameter("N/m", "stiffness", "Hooke 1678")', 'setting("a", "b")').replace(
            "import parameter", "import setting"
        ),
        "",
        NO_LAW + "its setting stiffness needs a default",
    ),
    "refers to nothing": (
        LAW.replace('"Hooke 1678"', '"Hooke 1678", at_least="mu"'),
        "",
        NO_LAW + "its field stiffness refers to mu, which it does not have",
    ),
    "name taken": (
        LAW.replace('"spring"', '"dahl"'),
        "",
        NO_LAW + 'its name "dahl" is taken by a law that comes with the package',
    ),
    "misspelt attribute": (
        LAW.replace("now.displacement", "now.displacment"),
        "",
        "{path} line 14: AttributeError: 'ContactSample' object has no attribute 'displacment'",
    ),
    "no pair": (
        LAW.replace("return z, ", "return "),
        "",
        NO_LAW + "advance must return the new states and the force, (z, T)",
    ),
    "wrong size": (
        LAW.replace("return z,", "return now.u,"),
        "",
        NO_LAW + "advance must return 0 states and one force, not 1 and 1",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_law_is_refused_in_one_line(case: str, tmp_path: Path) -> None:
    code, name, message = REFUSED[case]
    name = name or "own.py:Spring"
    message = message.format(path=tmp_path / "own.py", folder=f"{tmp_path}{os.sep}")
    with pytest.raises(InputError) as refused:
        found(tmp_path, code, name)
    assert str(refused.value) == message
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG.read_text().replace("bouc_wen.py:BoucWen", name))
    with pytest.raises(InputError) as refused:
        load_rig(rig, allow_code=True)
    assert str(refused.value) == f'{rig}: contact.friction.law = "{name}"; {message}'
    assert "\n" not in str(refused.value)


MODES = """\
name = "two modes"
[modal]
frequencies_hz = [31.0, 74.5]
[modal.ports]
left = [0.8, 1.1]
right = [0.9, -1.2]
[damping]
modal_ratios = [0.003]
[[joints]]
name = "bolt"
law = "own.py:Spring"
stiffness = 1e3
normal_load = 50.0
at = "left"
[excitation]
amplitude = 3.0
at = "right"
"""


def test_a_law_without_a_force_where_it_moves_back_is_named(tmp_path: Path) -> None:
    """The root of a displacement below zero is no number: no way can find a motion both ways."""
    root = "return z, -self.stiffness * now.displacement**0.5"
    (tmp_path / "own.py").write_text(LAW.replace(RETURNS, root))
    rig = tmp_path / "rig.toml"
    rig.write_text(MODES)
    with pytest.raises(ConvergenceError) as failed:
        steady_state(load_rig(rig, allow_code=True), 28.0, harmonics=3)
    said = "first solution: none at 28 Hz and 3 N: {} (spring): force not finite; must be for every motion"
    assert str(failed.value) == said.format("joint bolt")
    own = find_law("own.py:Spring", tmp_path)(1e3)
    contact = replace(paper_rig().contact, law=own)
    with pytest.raises(ConvergenceError) as failed:
        steady_state(replace(paper_rig(), contact=contact), 28.0, level=3.0, harmonics=3)
    assert str(failed.value) == said.format("contact")


def test_messages_about_a_law_of_a_joint_end_with_what_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(LAW)
    rig = tmp_path / "rig.toml"
    every = ", ".join([*LAWS, *JOINT_LAWS])
    for name, said in {
        "own.py:Sprung": f"{tmp_path / 'own.py'} has no class Sprung; it has Spring",
        "cubic-sprin": f"must be one of {every}, or file.py:Class; did you mean cubic-spring?",
    }.items():
        rig.write_text(MODES.replace("own.py:Spring", name))
        with pytest.raises(InputError) as refused:
            load_rig(rig, allow_code=True)
        assert str(refused.value) == f'{rig}: joints[1].law = "{name}"; {said}'


def test_a_truth_value_of_a_symbol_is_told_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"own\.py line 14: RuntimeError: .*truth value of a CasADi"):
        found(tmp_path, LAW.replace("        return z", "        if now.v > 0: return z, 0.0\n        return z"))


def test_names_that_are_no_files_are_held_against_the_catalogue(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        find_law("dhal", tmp_path)
    assert str(refused.value) == f"must be one of {', '.join(LAWS)}, or file.py:Class; did you mean dahl?"
