"""What a rig with joints, its file, its measurements and its functions refuse, in one line."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hbm import (
    follow_peak,
    force_response,
    frequency_response,
    joint_steady_state,
    load_rig,
    load_spectra,
    parameter_response,
    sensitivities,
    simulate,
    steady_state,
    trace_frequency,
)
from hbm.cli import app
from hbm.errors import InputError
from hbm.figures import plot_contact, plot_loop
from hbm.inverse.jointed import reconstruct_joints
from hbm.inverse.sensing import readings
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.measured import measured
from hbm.outputerror.records import expect_fundamental
from hbm.sensitivity.jointed import joint_sensitivities
from hbm.sensitivity.moving import Disturbance
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import Joint, Stop
from models.parts import Channel, Damping, Excitation
from tests.joints.rigs import TWO_MODES, loaded

FILE = (
    TWO_MODES
    + """[[channels]]
name = "f"
quantity = "force"
[[channels]]
name = "a1"
quantity = "acceleration"
at = "one"
[[joints]]
name = "pad"
law = "impact-stop"
stiffness = 1e4
gap = 1e-5
at = "two"
"""
)
MATRIX = "damping_matrix = [[{}, 0.0], [0.0, 1.0]]\n[excitation]"
PAD = 'law = "impact-stop"\nstiffness = 1e4\ngap = 1e-5\nat = "two"'
RUB = 'law = "coulomb-penalty"\nmu = 0.3\ncritical_slip = 1e-5\nnormal_load = 5.0\n'
LINEAR = FILE.partition("[[joints]]")[0]
TAKEN = "must not be one of the computed drive, pad.motion, pad.force"


@pytest.fixture
def rig(tmp_path: Path) -> JointedRig:
    return loaded(tmp_path, FILE)


def spectra_of(rig: JointedRig, force: np.ndarray) -> MeasuredSpectra:
    """Two records of two harmonics, of which the force is given."""
    response = np.array([[0.0, 1.0, 0.1, 0.2, 0.0]] * 2)
    std = np.where(np.isnan(force[:, :3]), np.nan, 0.01)
    return MeasuredSpectra(
        "s.csv",
        np.array([1, 2]),
        np.ones(2),
        np.array([15.0, 16.0]),
        ("f", "a1"),
        np.stack([force, response], axis=1),
        np.stack([std, np.full((2, 3), 0.01)], axis=1),
    )


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"a1"', '"drive"', f'two modes: channels[2].name = "drive"; {TAKEN}'),
        ('"a1"', '"pad.force"', f'two modes: channels[2].name = "pad.force"; {TAKEN}'),
        ("16.0, 45.0", "16, 45, 39, 66, 55, 3", "modal.frequencies_hz[3] = 39.0; must be >= the one before, 45.0"),
        (
            "[damping]",
            "damping_matrix = [[1.0, 0.0], [0.0, 1.0]]\n[damping]",
            "damping and modal.damping_matrix are both present; must have one of them",
        ),
        (
            "modal_ratios = [0.01]",
            "modal_ratios = [0.01]\nmass_proportional = 3.0",
            "damping.modal_ratios and damping.mass_proportional are both present; must have one of them",
        ),
        (
            "[damping]\nmodal_ratios = [0.01]\n[excitation]",
            MATRIX.format(-2.0),
            "modal.damping_matrix has the eigenvalue -2; must have none below 0",
        ),
        ("[damping]\nmodal_ratios = [0.01]\n[excitation]", MATRIX.format(0.0), ""),
        (
            "[damping]",
            "flexibility = [[1e-8, 2e-9], [1e-9, 1e-8]]\n[damping]",
            "modal.flexibility[1][2] = 2e-09 and [2][1] = 1e-09; must be the same, the matrix is symmetric",
        ),
        (
            "two = [0.4, -0.6]",
            "two = [0.4]",
            "modal.ports.two has 1 entries; must have 2",
        ),
        *(
            (
                "[damping]",
                f"[modal.tolerances.ports]\ntow = {row}\n[damping]",
                "modal.tolerances.ports.tow is unknown; ports are one, two",
            )
            for row in ("[0.1, 0.1]", "[0.0, 0.0]", "[]")
        ),
        (
            "amplitude = 1.0",
            "amplitude = 1.0\nforce_gain = [[0.45, 1.0], [1.0]]",
            "excitation.force_gain[2] is an array; must be two numbers, a level and the force per unit there",
        ),
        (
            "[excitation]",
            "[contact]\nnormal_load = 83.0\n[excitation]",
            "contact and joints are both present; must have one of them; a contact is a joint",
        ),
        (
            "[excitation]",
            "[shaker]\n[excitation]",
            "shaker is unknown; accepted keys are name, beam, modal, matrix, damping, joints, masses, excitation, "
            "channels, extensions",
        ),
        (
            'quantity = "acceleration"\nat = "one"',
            'quantity = "acceleration"\nat = "one - 2*two"',
            'two modes: channels[2].at = "one - 2*two"; must be one place, sums and multiples of places are for joints',
        ),
        (
            'quantity = "acceleration"\nat = "one"',
            'quantity = "acceleration"\nposition = 0.1\nat = "one"',
            "channels[2].position and at are both present; must have one of them",
        ),
        (
            "[excitation]",
            "[excitation]\nposition = 0.1",
            "excitation.position and at are both present; must have one of them",
        ),
        ('at = "two"', 'at = ["two", 3]', "joints[1].at[2] = 3; must be a text in quotes"),
        ('at = "two"', "at = []", "joints[1].at is an empty array; must have at least one entry"),
        ('at = "two"', "at = 0.3", "joints[1].at = 0.3; must be a text in quotes"),
        ('at = "two"', 'at = "tow"', 'two modes: joint pad: at = "tow"; ports are one, two; did you mean two?'),
        (
            'at = "two"',
            'at = "one-two"',
            'two modes: joint pad: at = "one-two"; ports are one, two; in a sum, signs stand between blanks',
        ),
        (
            PAD,
            f'{RUB}at = ["one", "two"]',
            "joint pad: at has 2 places; must have 1 for friction; with normal_stiffness it has 2, the second along "
            "the normal",
        ),
        (
            PAD,
            f'{RUB}normal_stiffness = 1e5\nat = "one"',
            "joint pad: at has 1 places; must have 2 for friction, the second along the normal, where its "
            "normal_stiffness acts",
        ),
        ('at = "two"', 'at = "two"\nto = "1*two"', 'joint pad: at and to are both "two"; must differ, or leave out to'),
    ],
)
def test_a_rig_file_that_contradicts_itself_is_refused(old: str, new: str, said: str, tmp_path: Path) -> None:
    assert FILE.count(old) == 1
    path = tmp_path / "rig.toml"
    path.write_text(FILE.replace(old, new))
    if not said:
        load_rig(path)
        return
    with pytest.raises(InputError) as refused:
        load_rig(path)
    assert str(refused.value) == f"{path}: {said}"


def test_names_that_a_rig_computes_are_refused_at_birth() -> None:
    body = ModalModel((16.0,), {"one": (1.0,)})
    joints = tuple(Joint(f"j{i}", Stop(1e4, 1e-5), ("one",)) for i in range(9))
    with pytest.raises(ValueError, match=r'x: channels\[1\].name = "j3.force"; must not be .* drive, .*, \.\.\.$'):
        JointedRig(
            *("x", body, Damping(), joints, Excitation(1.0, at="one")), (Channel("j3.force", "velocity", at="one"),)
        )


def test_frequencies_that_do_not_ascend_are_named() -> None:
    with pytest.raises(ValueError, match=r"^modal\.frequencies_hz\[3\] = 39 after 45; must ascend"):
        ModalModel((16.0, 45.0, 39.0), {})


def test_a_rig_that_touches_nothing_has_no_forces_to_find(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rig.toml").write_text(LINEAR)
    Path("s.csv").write_text("record,level,frequency_hz,channel,harmonic,cos,sin,std\n1,1,15,a1,1,1,0,0.1\n")
    refused = CliRunner().invoke(app, ["inverse", "rig.toml", "s.csv", "--out", "out"])
    line = "inverse: rig.toml has no [contact] and no [[joints]]; must have one, whose forces are found\n"
    assert (refused.exit_code, refused.stderr) == (2, line)
    refused = CliRunner().invoke(app, ["identify", "rig.toml", "s.csv", "--out", "out"])
    line = "rig.toml: has no [contact]; this command needs a rig with [contact]\n"
    assert (refused.exit_code, refused.stderr) == (2, line)
    rig = load_rig("rig.toml")
    assert isinstance(rig, JointedRig)
    with pytest.raises(InputError, match="reconstruct_joints: two modes has no joints; must have some"):
        reconstruct_joints(rig, load_spectra("s.csv", rig))
    assert rig.headline == "two modes"


def test_sensitivities_take_rigs_of_both_kinds(rig: JointedRig) -> None:
    solution, keys = steady_state(rig, 15.0, harmonics=3), ["joints.pad.gap", "modal.frequencies_hz[1]"]
    found, same = sensitivities(rig, solution, keys), joint_sensitivities(rig, solution, keys)
    assert found.logarithmic("a1") == same.logarithmic("a1")
    with pytest.raises(ValueError, match=r"beside, and two modes has no \[contact\]"):
        sensitivities(rig, solution, keys, Disturbance(*[np.zeros(0)] * 4, {}))


def test_a_force_without_its_fundamental_is_refused(rig: JointedRig) -> None:
    force = np.array([[0.0, 1.0, 0.1, 0.0, 0.1], [0.0, np.nan, 0.1, np.nan, 0.1]])
    line = 's.csv: record 2: channel "f" has harmonics and not the fundamental; must have harmonic 1, or none'
    with pytest.raises(InputError) as refused:
        measured(rig, spectra_of(rig, force))
    assert str(refused.value) == line
    force[1] = np.nan  # the level stands for a force that was not measured
    expect_fundamental(rig, readings(rig, spectra_of(rig, force)))


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (lambda rig: simulate(rig, 18.0, duration=-1.0), ValueError, "simulate: duration = -1; must be > 0 and finite"),
        (
            lambda rig: simulate(rig, 18.0, start=np.zeros(3)),
            InputError,
            "simulate: start has 3 values; this rig and its joints need 4",
        ),
        (
            lambda rig: simulate(rig, 18.0, steps_per_period=0),
            InputError,
            "simulate: steps_per_period = 0; must be a whole number >= 8",
        ),
        (
            lambda rig: simulate(rig, 18.0, last_periods=0),
            InputError,
            "simulate: last_periods = 0; must be a whole number 1 to 50",
        ),
        (
            lambda rig: simulate(rig, 18.0, last_periods=1000),
            InputError,
            "simulate: last_periods = 1000; must be a whole number 1 to 50",
        ),
        (
            lambda rig: joint_steady_state(rig, -20.0),
            InputError,
            "joint_steady_state: hz = -20; must be > 0 and finite",
        ),
        (lambda rig: steady_state(rig, "18"), InputError, "steady_state: hz = '18'; must be > 0 and finite"),
        (
            lambda rig: steady_state(rig, 18.0, level=-1.0),
            InputError,
            "steady_state: level = -1; must be > 0 and finite",
        ),
        (
            lambda rig: trace_frequency(rig, (15.0, 18.0), level=np.nan),
            InputError,
            "trace_frequency: level = nan; must be > 0 and finite",
        ),
        (
            lambda rig: frequency_response(rig, (15.0, 18.0), level=0.0),
            InputError,
            "frequency_response: level = 0; must be > 0 and finite",
        ),
        (
            lambda rig: frequency_response(rig, (18.0,)),
            InputError,
            r"frequency_response: hz = \(18.0,\); must be two numbers",
        ),
        (
            lambda rig: parameter_response(rig, "modal.ports.one[1]", (0.7, 0.8), hz=18.0, level=-1.0),
            InputError,
            "parameter_response: level = -1; must be > 0 and finite",
        ),
        (
            lambda rig: parameter_response(rig, "modal.ports.one[1]", (0.7,), hz=18.0),
            InputError,
            r"parameter_response: values = \(0.7,\); must be two numbers",
        ),
        (
            lambda rig: trace_frequency(rig, (15.0, 18.0), step_hz=-1.0),
            InputError,
            "trace_frequency: step_hz = -1; must be > 0 and finite",
        ),
        (
            lambda rig: force_response(rig, 18.0, (0.0, 1.0)),
            InputError,
            "force_response: force = 0; must be > 0 and finite",
        ),
        (
            lambda rig: force_response(rig, 18.0, (1.0, 1.0)),
            InputError,
            r"force_response: force = \(1, 1\); must be two different numbers > 0",
        ),
        (
            lambda rig: rig.with_number("joints.stop.gap", 1.0),
            ValueError,
            r"joints.stop.gap is not a number of the rig two modes; must be one of joints.pad.*mean joints.pad.gap\?",
        ),
        (
            lambda rig: steady_state(rig, 18.0, harmonics=2.5),
            ValueError,
            "steady_state: harmonics = 2.5; must be a whole number >= 1",
        ),
        (
            lambda rig: follow_peak(rig, [1.0, 2.0], channel="a9"),
            InputError,
            'follow_peak: channel = "a9"; must be one of f, a1, drive, pad.motion, pad.force',
        ),
        (lambda rig: steady_state(rig, 18.0, harmonics=1)["a9"], KeyError, 'no channel "a9"; there are f, a1, drive'),
        (
            lambda rig: plot_contact(trace_frequency(rig, (18.0, 18.1), harmonics=1)),
            InputError,
            r"plot_contact: a rig with joints has no slip of its own; must have \[contact\]; plot_channel draws",
        ),
        (
            lambda rig: plot_loop(steady_state(rig, 18.0, harmonics=1)),
            InputError,
            "plot_loop: a rig with joints has no slip of its own",
        ),
        (
            lambda rig: trace_frequency(rig, (18.0, 18.1), harmonics=1)["a9"],
            KeyError,
            'no channel "a9"; there are f, a1, drive',
        ),
        (
            lambda rig: sensitivities(rig, steady_state(rig, 18.0, harmonics=1))["a9"],
            KeyError,
            'no channel "a9"; there are f, a1, drive',
        ),
    ],
)
def test_what_python_is_asked_wrongly_is_said(
    call: Callable[[JointedRig], object], error: type[Exception], said: str, rig: JointedRig
) -> None:
    linear = replace(rig, joints=())
    with pytest.raises(error, match=said):
        call(rig if "pad" in said else linear)
