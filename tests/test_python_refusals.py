"""What functions refuse in one line, before they compute anything; and causes by their names."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from hbm import (
    InputError,
    diagnose,
    follow_peak,
    frequency_response,
    friction_loop,
    identify,
    joint_sensitivities,
    joint_steady_state,
    load_rig,
    load_spectra,
    nonlinear_mode,
    reconstruct_joints,
    steady_state,
    synthesize,
    with_stability,
)
from hbm.diagnosis.diagnose import candidates_among
from hbm.figures import plot_curves, plot_phase, plot_sensors
from hbm.figures.backbone import plot_backbones
from hbm.files.curves import write_curves
from hbm.rigfiles.lawchoice import choose_law
from models import Jenkins
from models.bodies.matrix import MatrixBody
from models.causes import CAUSES
from models.causes.parameter import WrongParameter
from models.jointed import JointedRig
from models.joints import CubicSpring, Friction, Joint
from models.parts import Channel, Damping, Excitation
from models.published import paper_rig

EXAMPLES = Path(__file__).parents[1] / "examples"
RIG: Any = paper_rig()
SPECTRA = load_spectra(EXAMPLES / "diagnosed_beam" / "spectra.csv")
RECONSTRUCTION = "must be a Reconstruction, as reconstruct returns"
NO_JOINTS = f"{RIG.name} has [contact]; must be a rig with [[joints]]"


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: joint_sensitivities(RIG, steady_state(RIG, 50.0, harmonics=3)), f"joint_sensitivities: {NO_JOINTS}"),
        (lambda: joint_steady_state(RIG, 50.0), f"joint_steady_state: {NO_JOINTS}"),
        (lambda: reconstruct_joints(RIG, SPECTRA), f"reconstruct_joints: {NO_JOINTS}"),
        (lambda: follow_peak(RIG, []), "follow_peak: no values; must be at least one"),
        (lambda: follow_peak(RIG, np.array([])), "follow_peak: no values; must be at least one"),
        (lambda: synthesize(RIG, [3.0], [50.0], seed=-1), "synthesize: seed = -1; must be a whole number >= 0"),
        (lambda: synthesize(RIG, [3.0], [50.0], snr=-1e9), "synthesize: snr = -1e+09; must be -20 to 200 [dB]"),
        (lambda: synthesize(RIG, [3.0], [50.0], harmonics=0), "synthesize: harmonics = 0; must be a whole number >= 1"),
        (
            lambda: frequency_response(RIG, (50.0, 51.0), tolerance=-1),
            "frequency_response: tolerance = -1; must be > 0 and finite [relative]",
        ),
        (
            lambda: diagnose(RIG, SPECTRA, causes=["bristle-memory"]),
            'diagnose: causes has "bristle-memory"; there is nothing in this rig it can act on',
        ),
        (
            lambda: load_spectra(EXAMPLES / "diagnosed_beam" / "spectra.csv", "rig.toml"),  # type: ignore[arg-type]
            "load_spectra: rig = 'rig.toml'; must be a Rig, as load_rig(path) returns",
        ),
        (
            lambda: diagnose(RIG, "spectra.csv"),  # type: ignore[arg-type]
            'diagnose: spectra = "spectra.csv"; must be MeasuredSpectra, as load_spectra(file, rig) returns; '
            "a decay is for diagnose_backbone",
        ),
        (lambda: identify(RIG, SPECTRA), f"identify: reconstruction is a MeasuredSpectra; {RECONSTRUCTION}"),
        (
            lambda: identify(jointed(), SPECTRA),
            "identify: three has [[joints]]; must be a rig with [contact] alone",
        ),
        (lambda: nonlinear_mode(RIG, 1.5), "backbone: mode = 1.5; must be a whole number >= 1"),
        (lambda: nonlinear_mode(RIG, "1"), "backbone: mode = '1'; must be a whole number >= 1"),
        (lambda: nonlinear_mode(RIG, amplitudes=(1e-6,)), "backbone: amplitudes = (1e-06,); must be two numbers"),
        (
            lambda: nonlinear_mode(RIG, amplitudes=("a", "b")),
            "backbone: amplitudes = 'a'; must be > 0 and finite [m]",
        ),
        (
            lambda: with_stability(steady_state(RIG, 50.0, harmonics=3)),
            "with_stability: curve is a PeriodicSolution; must be a curve, such as trace_frequency returns; "
            "stability_of judges one point",
        ),
        (
            lambda: synthesize(RIG, 20.0, [50.0]),
            "synthesize: levels = 20.0; must be a sequence of numbers, such as [20.0]",
        ),
        (
            lambda: synthesize(RIG, [3.0], 50.0),
            "synthesize: frequencies = 50.0; must be a sequence of numbers, such as [50.0]",
        ),
        (lambda: write_curves("x.csv", []), "write_curves: curves is empty; must have one at least"),
        (lambda: plot_curves([]), "plot_curves: curves is empty; must have one at least"),
        (lambda: plot_phase([]), "plot_phase: curves is empty; must have one at least"),
        (lambda: plot_sensors([]), "plot_sensors: curves is empty; must have one at least"),
        (lambda: plot_backbones([]), "plot_backbones: backbones is empty; must have one at least"),
    ],
)
def test_what_no_rig_has_and_numbers_that_are_none_are_refused(call: Callable[[], object], said: str) -> None:
    with pytest.raises(InputError) as refused:
        call()
    assert str(refused.value) == said


MASSES = sparse.csc_array(np.diag([1.0, 2.0, 1.0]))
SPRINGS = sparse.csc_array(1e4 * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]]))
RUB = Friction(Jenkins(0.3, 1e-5), 5.0)


def masses(**changed: Any) -> MatrixBody:
    return MatrixBody(**{"mass": MASSES, "stiffness": SPRINGS, "dofs": ("a", "b", "c"), "modes": 3, **changed})


def jointed(**changed: Any) -> JointedRig:
    parts = {"body": masses(), "damping": Damping(0.5), "joints": (Joint("j", RUB, ("a",)),)}
    return JointedRig(**{"name": "three", "excitation": Excitation(1.0, at="b"), **parts, **changed})


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: choose_law(jointed(), "dahl"), "choose_law: three has [[joints]]; must be a rig with [contact] alone"),
        (
            lambda: Excitation(1.0, harmonics=((2.5, 0.1, 0.1),)),  # type: ignore[arg-type]
            "excitation.harmonics: numbers [2.5]; must be whole, 2 or more, each once",
        ),
        (
            lambda: friction_loop(CubicSpring(1e9), 1e-5, 50.0, load=20.0),
            "friction_loop: law = CubicSpring(cubic=1000000000.0); must be a friction law, such as Jenkins(0.5, 4e-6)",
        ),
        (
            lambda: masses(stiffness=[[1.0, 2.0], [3.0]]),
            "MatrixBody: stiffness = [[1.0, 2.0], [3.0]]; must be a square matrix",
        ),
        (lambda: jointed(joints=Joint("j", RUB, ("a",))), "three: joints is one Joint; must be a tuple, (Joint(...),)"),
        (
            lambda: jointed(channels=Channel("v", "velocity", at="c")),
            "three: channels is one Channel; must be a tuple, (Channel(...),)",
        ),
        (lambda: Joint("j", RUB, (3,)), 'joint j: at has 3; must be names, such as "3"'),  # type: ignore[arg-type]
        (lambda: Joint("j", RUB, 3), 'joint j: at = 3; must be a tuple of names, ("3",)'),  # type: ignore[arg-type]
        (
            lambda: jointed(channels=(Channel("v", "velocity"),)),
            "three: channels[1].at is missing; must be of dofs, a, b, c",
        ),
        (lambda: jointed(excitation=Excitation(1.0)), "three: excitation.at is missing; must be of dofs, a, b, c"),
        (lambda: masses(modes=2.5), "MatrixBody: modes = 2.5; must be a whole number >= 1"),
        (lambda: masses(dofs=(1, 2, 3)), 'MatrixBody: dofs has 1; must be names, such as "1"'),
        (
            lambda: masses(fixed=("a", "b", "c")),
            "MatrixBody: fixed has every degree of freedom with mass; must leave one free",
        ),
        (
            lambda: steady_state(jointed(excitation=Excitation(0.0, at="b")), 20.0),
            "three: excitation.amplitude = 0; must be > 0 [N]",
        ),
        (
            lambda: jointed(body=masses(damping_matrix=0.5 * MASSES), damping=Damping(50.0)),
            "three: damping and a damping matrix of its body; must have one of them",
        ),
        (lambda: Jenkins("0.3", 1e-5), 'Jenkins: mu = "0.3"; must be a number'),  # type: ignore[arg-type]
        (lambda: jointed().with_number("joints.j.mu", "3"), 'joints.j.mu = "3"; must be a number'),  # type: ignore[arg-type]
        (
            lambda: Joint("j", RUB, "left"),  # type: ignore[arg-type]
            'joint j: at = "left"; must be a tuple of names, ("left",)',
        ),
        (
            lambda: Joint("j", Jenkins(0.3, 1e-5), ("a",)),  # type: ignore[arg-type]
            "joint j: law is Jenkins, a friction law that nothing presses; must be Friction(Jenkins(...), "
            "normal_load=...), of hbm.models.joints",
        ),
        (
            lambda: Joint("j", "cubic-spring", ("a",)),  # type: ignore[arg-type]
            "joint j: law = 'cubic-spring'; must be a law of hbm.models.joints, such as CubicSpring(cubic=1e9)",
        ),
        *(
            (
                lambda given=given: Damping(modal_ratios=given),
                f"Damping: modal_ratios = {given!r}; must be a sequence, of one ratio for all modes or one for each, "
                "such as (0.005,)",
            )
            for given in (0.005, "0.005")
        ),
        (
            lambda: jointed(joints=(Joint("j", RUB, ("a",), ("d",)),)),
            'three: joint j: to = "d"; must be of dofs, a, b, c',
        ),
        (
            lambda: jointed(joints=(Joint("j", RUB, ("0.5*a - 2*d",)),)),
            'three: joint j: at = "0.5*a - 2*d" has "d"; must be of dofs, a, b, c',
        ),
        (
            lambda: jointed(joints=(Joint("j", RUB, ("a",), loaded_by="c"),)),
            'three: joint j: loaded_by = "c"; must be of fixed, which is empty',
        ),
        (
            lambda: jointed(excitation=Excitation(1.0, position=0.3)),
            "three: excitation.position = 0.3; must be of dofs, a, b, c",
        ),
        (
            lambda: jointed(body=masses(fixed=("c",), modes=2), channels=(Channel("v", "velocity", at="c"),)),
            'three: channels[1].at = "c"; must be free to move, it is fixed',
        ),
    ],
)
def test_what_no_rig_is_made_of_is_refused_where_it_is_made_or_used(call: Callable[[], object], said: str) -> None:
    with pytest.raises(ValueError) as refused:  # the message is compared
        call()
    assert str(refused.value) == said


def test_matrices_may_be_lists_of_rows() -> None:
    lists = masses(mass=MASSES.toarray().tolist(), stiffness=SPRINGS.toarray().tolist())
    assert (lists.stiffness != SPRINGS).nnz == 0


def test_what_a_joint_takes_is_asked_for_by_its_name() -> None:
    with pytest.raises(KeyError, match='no joint "k"; there are j'):
        steady_state(jointed(), 5.0, harmonics=3).taken("k")


def test_ratios_of_damping_may_be_any_sequence() -> None:
    assert Damping(modal_ratios=np.array([0.01, 0.02])).modal_ratios == (0.01, 0.02)  # type: ignore[arg-type]
    assert Damping(modal_ratios=[0.01]) == Damping(modal_ratios=(0.01,))  # type: ignore[arg-type]


def test_a_body_with_a_damping_matrix_has_no_other_damping() -> None:
    """Its decay is that of the matrix: c = 0.5 m gives 0.5 per second for every mode."""
    rig = jointed(body=masses(damping_matrix=0.5 * MASSES), damping=Damping())
    np.testing.assert_allclose(rig.structure.damping, 0.5 * np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"causes": ["added-mess"]}, 'diagnose: causes has "added-mess"; must be one of stribeck-weakening, '),
        (
            {"causes": ["parameter:beam.colour"]},
            'diagnose: causes has "parameter:beam.colour"; must be one of parameter:beam.',
        ),
        (
            {"tolerances": {"foo": 0.1}},
            "diagnose: tolerance of foo; must be of a number of the rig file, not 0: contact.friction.mu, ",
        ),
        (
            {"tolerances": {"beam.youngs_modulus": -0.1}},
            "diagnose: tolerance of beam.youngs_modulus = -0.1; must be >= 0 and finite [relative]",
        ),
    ],
)
def test_a_diagnosis_refuses_causes_and_numbers_that_are_not_there(options: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError) as refused:
        diagnose(load_rig(EXAMPLES / "diagnosed_beam" / "rig.toml"), SPECTRA, **options)
    assert str(refused.value).startswith(said)


def test_causes_by_name_are_those_of_their_classes() -> None:
    named = list(candidates_among(RIG, ["sensor-gain", "parameter:beam.length", "added-mass"]))
    given = [CAUSES["sensor-gain"], WrongParameter("beam.length"), CAUSES["added-mass"]]
    assert [c.label for c in named] == [c.label for c in candidates_among(RIG, given)]
    assert len(named) > len(given)  # a gain of each channel
