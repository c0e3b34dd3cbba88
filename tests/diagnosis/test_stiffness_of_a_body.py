"""A model of finite elements that is too soft or too stiff as a whole, alone and beside a joint that is missing."""

import numpy as np
import pytest
from scipy.linalg import eigh

from hbm.diagnosis.diagnose import diagnose
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from models.bodies.matrix import MatrixBody
from models.jointed import JointedRig
from models.parts import Channel, Damping, Excitation
from tests.truth.modal import Hidden, Modes, accelerations, cubic, nothing, steady

MASS = np.diag([1.0, 0.8, 1.2, 1.0])
STIFFNESS = 2e4 * (np.diag([3.0, 2.5, 2.2, 1.2]) - np.diag([1.0, 1.2, 1.0], 1) - np.diag([1.0, 1.2, 1.0], -1))
NAMES = ("1.x", "2.x", "3.x", "4.x")
RATIO = 0.012
DRIVE, SENSORS, AT = "1.x", ("2.x", "3.x", "4.x"), "4.x"
LEVELS, OF_MODES, H, NOISE, K3 = (0.5, 3.0), (0, 1), 5, 2e-3, 4e9


def modes_of(factor: float) -> Modes:
    """Modes of the matrices, the stiffness times a factor."""
    squares, shapes = eigh(factor * STIFFNESS, MASS)
    rows = dict(zip(NAMES, shapes, strict=True))
    return Modes(np.sqrt(squares) / (2 * np.pi), np.full(len(squares), RATIO), rows)


def rig_of() -> JointedRig:
    body = MatrixBody(MASS, STIFFNESS, NAMES, modes=4)
    sensors = (Channel(name.replace(".", ""), "acceleration", at=name) for name in SENSORS)
    return JointedRig(
        "four masses",
        body,
        Damping(modal_ratios=(RATIO,)),
        (),
        Excitation(1.0, at=DRIVE),
        (Channel("force", "force"), *sensors),
    )


def measured(factor: float, hidden: Hidden, seed: int) -> MeasuredSpectra:
    """Records about two modes of masses whose springs are stiffer than the model by a factor, with a hidden force."""
    rng, modes, rig = np.random.default_rng(seed), modes_of(factor), rig_of()
    near = np.concatenate([modes.hz[i] * np.array([0.96, 0.985, 1.0, 1.015, 1.04]) for i in OF_MODES])
    hz, force = np.tile(near, len(LEVELS)), np.repeat(LEVELS, len(near))
    q = steady(modes, hidden, modes.rows[AT], DRIVE, hz, force, periods=200, steps=512, H=H)
    clean = {"force": np.zeros((len(hz), 2 * H + 1))}
    clean["force"][:, 1] = force
    clean |= {name.replace(".", ""): accelerations(modes, q, name, hz) for name in SENSORS}
    std = {name: NOISE * np.sqrt(np.mean(y[:, [1, H + 1]] ** 2)) for name, y in clean.items()} | {"force": 1e-4}
    noisy = {name: y + std[name] * rng.standard_normal(y.shape) for name, y in clean.items()}
    stds = {name: np.full((len(hz), H + 1), s) for name, s in std.items()}
    for name in noisy:  # no mean was measured
        noisy[name][:, 0] = stds[name][:, 0] = np.nan
    return spectra_of(rig, hz, force, noisy, stds)


def test_a_stiffness_that_is_wrong_is_named() -> None:
    """By 4 %, four tolerances: a spring between any two places, however small, leads to it too."""
    found = diagnose(rig_of(), measured(1.04, nothing, 1))
    assert found.cause == "parameter:matrix.stiffness_factor"
    value = found.parameters["value"]
    assert value.value == pytest.approx(1.04, abs=4 * value.std) and value.std < 2e-3


def test_a_joint_is_found_beside_a_stiffness_that_is_off_within_its_tolerance() -> None:
    found = diagnose(rig_of(), measured(1.01, cubic(K3), 2))
    assert (found.cause, found.parameters["at"].value) == ("cubic-stiffness", AT)
    stiffness = found.parameters["cubic"]
    assert stiffness.value == pytest.approx(K3, abs=4 * stiffness.std) and stiffness.std < 0.1 * K3
