"""Sharp resonances and hardly any noise: what modes above the band do takes numbers of the rig file to their bounds."""

import numpy as np

import tests.truth.modal as truth
from hbm.diagnosis.diagnose import diagnose
from models.bodies import ModalModel
from models.jointed import JointedRig
from models.parts import Channel, Damping, Excitation
from tests.three_modes import spectra_with_noise
from tests.truth.modal import Modes

MODES = Modes(
    np.array([31.0, 53.0, 87.0, 142.0, 207.0, 289.0, 480.0, 710.0]),
    np.array([6.0, 4.0, 5.0, 3.5, 6.0, 4.0, 6.0, 6.0]) * 1e-3,
    {
        "a1": np.array([0.55, 0.48, 0.6, 0.42, 0.5, 0.38, 0.45, 0.4]),
        "a2": np.array([0.8, -0.35, -0.2, -0.55, 0.6, -0.45, -0.4, 0.3]),
        "a3": np.array([0.3, 0.7, -0.55, 0.35, -0.45, -0.5, 0.3, -0.35]),
        "a4": np.array([-0.25, 0.4, 0.5, 0.6, 0.3, -0.55, 0.5, 0.45]),
    },
)
KEPT, K3, H = 6, 6e9, 9
ONCE = (29.0, 30.2, 30.7, 31.0, 31.4, 32.3, 34.0, 51.0, 52.5, 53.0, 54.5)
HZ, FORCE = np.tile(ONCE, 3), np.repeat([0.6, 2.0, 6.0], len(ONCE))


def rig() -> JointedRig:
    """The six modes of the band, exactly."""
    ports = {name: tuple(row[:KEPT].tolist()) for name, row in MODES.rows.items()}
    return JointedRig(
        "lightly damped",
        ModalModel(tuple(MODES.hz[:KEPT].tolist()), ports),
        Damping(modal_ratios=tuple(MODES.ratio[:KEPT].tolist())),
        (),
        Excitation(1.0, at="a1"),
        (Channel("force", "force"), *(Channel(name, "acceleration", at=name) for name in ports)),
    )


def test_a_cause_is_fitted_again_where_numbers_of_the_rig_file_have_gone_to_their_bounds_for_it() -> None:
    """At the bounds it is 3 % off, and leaves ten times as much of the records held out."""
    between = MODES.rows["a3"] - MODES.rows["a4"]
    q = truth.steady(MODES, truth.cubic(K3), between, "a1", HZ, FORCE, periods=500, steps=512, H=H)
    seen = {name: truth.accelerations(MODES, q, name, HZ) for name in MODES.rows}
    spectra = spectra_with_noise(rig(), seen, HZ, FORCE, np.random.default_rng(1), 1e-5)
    d = diagnose(rig(), spectra, causes=["cubic-stiffness"])
    assert d.verdict in ("cause-found", "main-cause") and d.cause == "cubic-stiffness"
    assert (d.parameters["at"].value, d.parameters["to"].value) == ("a3", "a4")
    found = d.parameters["cubic"]
    assert isinstance(found.value, float) and found.std is not None
    assert abs(found.value - K3) < 3.0 * found.std and abs(found.value - K3) < 0.01 * K3
    assert d.errors["extended"]["held_out"].nrmse < 1e-3 * d.errors["calibrated"]["held_out"].nrmse
