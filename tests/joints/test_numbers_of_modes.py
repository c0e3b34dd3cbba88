"""Frequencies, damping ratios, shapes, gains and delays as numbers: exact derivatives, rigs without a joint."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hbm.balance.solution import PeriodicSolution
from hbm.cli import app
from hbm.errors import InputError
from hbm.integration.integrate import simulate
from hbm.modes.linear import linear_modes
from hbm.outputerror.nominal import tolerances
from hbm.response.trace import steady_state
from hbm.rigfiles.load import load_rig
from hbm.sensitivity.jointed import joint_sensitivities
from hbm.sensitivity.jointforces import motion_between, pushed
from hbm.tracking.parameterresponse import parameter_response
from models.jointed import JointedRig
from models.parts import Channel, Damping, Excitation
from tests.joints.rigs import made_up

HZ = 1.3
RIG = replace(
    made_up(damped=False, rigid=True),
    damping=Damping(modal_ratios=(0.0, 0.04, 0.05, 0.03), stiffness_proportional=2e-3),
    excitation=Excitation(1.0, at="d", harmonics=((3, 0.05, -0.02),)),
    channels=(Channel("x", "acceleration", gain=1.1, delay=0.02, at="e"), Channel("f", "force")),
)
ALPHA = replace(RIG, damping=Damping(0.3))
KEYS = (
    *("modal.frequencies_hz[2]", "modal.frequencies_hz[4]", "damping.modal_ratios[3]"),
    *("modal.ports.a[2]", "modal.ports.d[3]", "modal.ports.e[1]", "channels.x.gain", "channels.x.delay"),
    *("modal.flexibility[1][1]", "modal.flexibility[3][5]", "modal.flexibility[1][4]"),
)
FILE = """
name = "three modes"
[modal]
frequencies_hz = [0.0, 20.0, 50.0]
shapes = [[0.5, 1.0, 1.0], [0.0, 0.0, 0.0]]
excitation_shape = [0.5, 0.3, 0.5]
[damping]
modal_ratios = [0.01]
[excitation]
amplitude = 2.0
[[channels]]
name = "tip"
quantity = "acceleration"
[[channels]]
name = "f"
quantity = "force"
"""


def solved(rig: JointedRig, start: PeriodicSolution | None = None) -> PeriodicSolution:
    return steady_state(rig, HZ, harmonics=7, samples=256, start=start)


@pytest.mark.parametrize(
    ("rig", "key"),
    [
        *((RIG, key) for key in KEYS),
        *((RIG, f"excitation.harmonics[0].{part}") for part in ("cos", "sin")),
        *((ALPHA, key) for key in ("damping.mass_proportional", "modal.frequencies_hz[3]")),
    ],
    ids=str,
)
def test_derivatives_are_those_of_solutions_nearby(rig: JointedRig, key: str) -> None:
    here = solved(rig)
    found = joint_sensitivities(rig, here, [key])
    step = 1e-6

    def at(value: float) -> PeriodicSolution:
        if not key.startswith("excitation.harmonics"):
            return solved(rig.with_number(key, value), here)
        (k, *tone) = rig.excitation.harmonics[0]
        tone[("cos", "sin").index(key.rpartition(".")[2])] = value
        return solved(replace(rig, excitation=replace(rig.excitation, harmonics=((k, *tone),))), here)

    up, down = (at(float(found.values[0]) + x) for x in (step, -step))
    moved = False
    for name in ("drive", "x", "rub.force", "spring.motion", "plane.force.3"):
        apart = (up[name].coefficients - down[name].coefficients) / (2 * step)
        size = max(np.abs(apart).max(), 1e-6 * np.abs(here[name].coefficients).max())
        assert np.abs(found[name].coefficients[:, 0] - apart).max() < 1e-4 * size, name
        apart_at = (up[name].samples - down[name].samples) / (2 * step)  # forces of laws have more than H harmonics
        size = max(np.abs(apart_at).max(), 1e-6 * np.abs(here[name].samples).max())
        assert np.abs(found[name].samples[:, 0] - apart_at).max() < 1e-4 * size, name
        moved |= bool(np.abs(apart).max() > 1e-3 * np.abs(here[name].coefficients).max())
    assert moved


def test_residual_flexibility_is_calibrated_as_far_as_the_rig_file_states_it(tmp_path: Path) -> None:
    def stated(rows: str) -> JointedRig:
        flexible = FILE.replace("[damping]", f"flexibility = [[4e-6, 0.0], [0.0, 2e-6]]\n{rows}[damping]")
        flexible = flexible.replace("shapes = ", "ports = {tip = [0.5, 1.0, 1.0], f = [0.5, 0.3, 0.5]}\n# ")
        flexible = flexible.replace("excitation_shape", "# ").replace("amplitude", 'at = "f"\namplitude')
        flexible = flexible.replace('name = "tip"', 'name = "tip"\nat = "tip"')
        (tmp_path / "rig.toml").write_text(flexible)
        rig = load_rig(tmp_path / "rig.toml")
        assert isinstance(rig, JointedRig)
        return rig

    held = stated("")
    assert not [key for key in tolerances(held) if "flexibility" in key]
    assert held.with_number("modal.flexibility[1][2]", 1e-6).body.flexibility == ((4e-6, 1e-6), (1e-6, 2e-6))
    rows = "[modal.tolerances]\nflexibility = {}\n"
    known = tolerances(stated(rows.format("[[1e-6, 3e-7], [3e-7, 0.0]]")))
    of_ports = {key: std for key, std in known.items() if "flexibility" in key}
    assert of_ports == pytest.approx({"modal.flexibility[1][1]": 0.25, "modal.flexibility[1][2]": 3e-7})
    for wrong, said in (
        ("[[1e-6, 0.0]]", "flexibility has 1 rows; must have 2, one per port"),
        ("[[1e-6], [0.0, 0.0]]", r"flexibility\[1\] has 1 entries; must have 2, one per port"),
        ("[[1e-6, 1e-7], [0.0, 0.0]]", r"flexibility\[2\]\[1\] = 0; must be as \[1\]\[2\], it is symmetric"),
    ):
        with pytest.raises(InputError, match=said):
            stated(rows.format(wrong))


@pytest.fixture
def linear(tmp_path: Path) -> JointedRig:
    file = tmp_path / "rig.toml"
    file.write_text(FILE)
    rig = load_rig(file)
    assert isinstance(rig, JointedRig)
    return rig


def test_modes_without_a_contact_are_a_linear_rig(linear: JointedRig) -> None:
    assert linear.joints == () and linear.law_name == ""
    omega, omega_n = 2 * np.pi * 21.0, 2 * np.pi * np.array([0.0, 20.0, 50.0])
    shares = np.array([0.5, 1.0, 1.0]) * np.array([0.5, 0.3, 0.5])
    receptance = np.sum(shares / (omega_n**2 - omega**2 + 0.02j * omega_n * omega))
    found = steady_state(linear, 21.0, harmonics=3)
    assert found["tip"].peak == pytest.approx(2.0 * omega**2 * abs(receptance), rel=1e-9)
    assert abs(found.energy_error) < 1e-12 and found.friction_loss == 0.0
    assert linear_modes(linear).sliding_hz == pytest.approx([0.0, 20.0, 50.0])


def test_a_curve_along_a_frequency_ends_where_a_single_solution_is(linear: JointedRig) -> None:
    key = "modal.frequencies_hz[2]"
    curve = parameter_response(linear, key, (20.0, 22.0), hz=21.0, harmonics=3)
    last = steady_state(linear.with_number(key, 22.0), 21.0, harmonics=3)
    assert curve.complete
    assert np.allclose(curve.points[-1]["tip"].coefficients, last["tip"].coefficients, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "command",
    [
        ("frf", "--from", "19", "--to", "21"),
        ("continue", "--parameter", "modal.frequencies_hz[2]", "--from", "19.9", "--to", "20.1", "--frequency", "20"),
        ("simulate", "--frequency", "20", "--duration", "0.2"),
    ],
    ids=lambda command: command[0],
)
def test_commands_take_a_rig_without_a_joint(command: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(FILE)
    out, plot = tmp_path / "out.csv", tmp_path / "out.png"
    name, *rest = command
    done = CliRunner().invoke(app, [name, str(tmp_path / "rig.toml"), *rest, "--out", str(out), "--plot", str(plot)])
    assert done.exit_code == 0, done.output
    assert out.exists() and plot.exists()


def test_a_march_of_a_rig_without_a_joint_ends_where_the_balance_is(linear: JointedRig) -> None:
    rig = replace(
        linear,
        body=replace(linear.body, frequencies_hz=(8.0, 20.0, 50.0)),
        damping=Damping(modal_ratios=(0.05,)),
    )
    there = steady_state(rig, 21.0, harmonics=1)
    march = simulate(rig, 21.0, duration=4.0)
    assert np.abs(march.channels["tip"].values[-march.samples_per_period :]).max() == pytest.approx(
        there["tip"].peak, rel=2e-3
    )


def test_shapes_must_be_as_many_as_channels(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(FILE.replace(", [0.0, 0.0, 0.0]]", "]"))
    with pytest.raises(InputError, match=r"modal.shapes has 1 rows; must have 2, one per \[\[channels\]\] entry"):
        load_rig(file)


@pytest.mark.parametrize("k", [1, 3])
def test_a_force_where_the_excitation_is_does_what_a_change_of_that_does(k: int) -> None:
    here, H = solved(RIG), 3
    found = pushed(RIG, here, [("d", ""), ("a", "c")], H)
    key = "excitation.amplitude" if k == 1 else "excitation.harmonics[0].cos"
    by = joint_sensitivities(RIG, here, [key])
    steady = RIG.excitation.harmonics[0][1:]
    for name in ("x",):
        change = by[name].coefficients[:, 0] / (1.0 if k == 1 else here.level)
        cosine, third, sine_of_third = (found.channels[name][:, i] for i in (0, 2, H + 2))
        own = cosine + steady[0] * third + steady[1] * sine_of_third if k == 1 else third  # its harmonics grow with it
        assert np.abs(own - change).max() < 1e-9 * np.abs(change).max()
    # reciprocal only where linear; but what is moved is what a probe there would read
    probe = replace(RIG, channels=(*RIG.channels, Channel("probe", "displacement", at="d")))
    seen = pushed(probe, here, [("d", ""), ("a", "c")], H)
    assert np.allclose(seen.channels["probe"].reshape(-1, 2, 2 * H)[:, 1], found.moved[0, :, 1], rtol=0, atol=1e-12)
    assert np.allclose(motion_between(RIG, here, [("d", "")])[0], here["drive"].coefficients, rtol=0, atol=1e-12)


TOLERANCES = """[modal.tolerances]
frequencies_hz = [0.0, 0.02, 0.0]
modal_ratios = [0.0, 0.001, 0.002]
[modal.tolerances.ports]
tip = [0.05, 0.02, 0.03]
[damping]"""


def test_tolerances_of_the_file_go_before_those_of_the_diagnosis(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(FILE)
    usual = tolerances(load_rig(file), ["tip"])
    file.write_text(FILE.replace("[damping]", TOLERANCES))
    stated = {
        "modal.frequencies_hz[2]": 0.001,
        **{f"damping.modal_ratios[{i}]": std for i, std in ((2, 0.1), (3, 0.2))},
        **{f"modal.ports.tip[{i}]": std for i, std in ((1, 0.1), (2, 0.02), (3, 0.03))},
    }
    held = {"modal.frequencies_hz[3]", "damping.modal_ratios[1]"}
    expected = {key: std for key, std in (usual | stated).items() if key not in held}
    assert tolerances(load_rig(file), ["tip"]) == pytest.approx(expected)


RUBS = """
[[joints]]
name = "pad"
law = "iwan"
mu = 0.4
stiffness = 1e5
normal_load = 20.0
at = "tip"
"""


def test_a_load_and_a_coefficient_of_a_joint_are_as_well_known_as_those_of_a_contact(tmp_path: Path) -> None:
    """docs/theory/diagnosis.md, Tolerances."""
    file = tmp_path / "rig.toml"
    file.write_text(FILE + RUBS)
    found = tolerances(load_rig(file), ["tip"])
    named = {key: std for key, std in found.items() if key.startswith("joints.pad.")}
    stated = {"mu": 0.02, "normal_load": 0.02, "stiffness": 0.05, "spread": 0.05}
    assert named == {f"joints.pad.{name}": std for name, std in stated.items()}


def test_one_tolerance_that_is_stated_leaves_the_others_as_they_are(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(FILE)
    rig = load_rig(file)
    usual = tolerances(rig, ["tip"])
    looser, exact = "modal.frequencies_hz[2]", "damping.modal_ratios[1]"
    found = tolerances(rig, ["tip"], {looser: 0.1, exact: 0.0})
    assert found == {key: 0.1 if key == looser else std for key, std in usual.items() if key != exact}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("0.0, 0.02, 0.0", "0.0, 0.02", "modal.tolerances.frequencies_hz has 2 entries; must have 3, one per mode"),
        (
            "0.0, 0.02, 0.0",
            "0.1, 0.0, 0.0",
            r"frequencies_hz\[1\] = 0.1; must be 0, for modal",
        ),
        (
            "tip = ",
            "top = ",
            "modal.tolerances.ports.top is unknown; ports are tip, excitation",
        ),
        ("0.001,", "-0.001,", r"modal.tolerances.modal_ratios\[2\] = -0.001; must be >= 0"),
        (
            "modal_ratios = [0.0",
            "ratios = [0.0",
            "modal.tolerances.ratios is unknown; accepted keys are f",
        ),
    ],
)
def test_tolerances_that_are_none_are_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(FILE.replace("[damping]", TOLERANCES.replace(old, new)))
    with pytest.raises(InputError, match=said):
        load_rig(file)


@pytest.mark.parametrize(
    ("gains", "said"),
    [
        ("[[0.2, 1.0], [0.2, 1.1]]", r"excitation.force_gain\[2\]: level 0.2; must be there once"),
        ("[[0.2, 0.0]]", r"excitation.force_gain\[1\]\[2\] = 0.0; must be > 0"),
        ("[[0.2]]", r"excitation.force_gain\[1\]"),
    ],
)
def test_forces_per_unit_that_are_none_are_refused(tmp_path: Path, gains: str, said: str) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(FILE.replace("amplitude = 2.0", f"amplitude = 2.0\nforce_gain = {gains}"))
    with pytest.raises(InputError, match=said):
        load_rig(file)
