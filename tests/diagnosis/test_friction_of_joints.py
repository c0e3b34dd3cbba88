"""Friction of a joint that is known, of another law than the rig file says: found in records of another simulator."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hbm.diagnosis.diagnose import diagnose
from hbm.diagnosis.verdict import Estimate
from hbm.response.trace import steady_state
from hbm.rigfiles.extensions import Extension, rig_of_tables
from models.causes import Cause, all_candidates
from models.causes.friction import (
    AsymmetricFriction,
    DistributedMicroslip,
    OtherFriction,
    StribeckWeakening,
    ViscousContact,
)
from models.causes.joints import LocalMicroslip, QuadraticDamping
from models.causes.parameter import WrongParameter
from models.friction import Dahl, Iwan, Jenkins
from models.jointed import JointedRig
from models.joints import CubicSpring, Friction, Joint
from tests.three_modes import NOMINAL, ROWS, H, measured, rig_of
from tests.truth.modal import falling, jenkins, parts, steady

STIFFNESS, LIMIT = 3000.0, 0.6
KNOWN = Joint("shoe", Friction(Jenkins(1.0, LIMIT / STIFFNESS), LIMIT), ("b",))
BESIDE = Joint("pad", Friction(Dahl(0.5, 2000.0), 1.0), ("a",), ("c",))
SPRING = Joint("spring", CubicSpring(1e7), ("c",))

RIG = replace(rig_of(NOMINAL), joints=(KNOWN,))
SEVERAL = replace(rig_of(NOMINAL), joints=(KNOWN, BESIDE, SPRING))

VALUES = {
    "stribeck-weakening shoe": {"mu_static": 1.4, "mu": 0.8, "stribeck_velocity": 0.01},
    "distributed-microslip shoe": {"spread": 0.8},
    "viscous-contact shoe": {"coefficient": 3.0},
    "viscous-contact pad": {"coefficient": 3.0},
    "asymmetric-friction shoe": {"ratio": 1.3},
    "bristle-memory pad": {"sigma1": 2.0},
}


def law_causes(rig: JointedRig) -> dict[str, Cause]:
    return {c.label: c for c in all_candidates(rig) if isinstance(c, OtherFriction)}


def test_every_joint_that_rubs_may_have_another_law() -> None:
    assert law_causes(SEVERAL).keys() == VALUES.keys()
    iwan = replace(SEVERAL, joints=(Joint("shoe", Friction(Iwan(1.0, STIFFNESS), LIMIT), ("b",)), SPRING))
    assert law_causes(iwan).keys() == {"viscous-contact shoe", "asymmetric-friction shoe"}


@pytest.mark.parametrize("label", VALUES)
def test_another_law_is_in_its_joint_alone_and_in_the_rig_file(label: str) -> None:
    cause, values = law_causes(SEVERAL)[label], VALUES[label]
    for u in cause.unknowns(SEVERAL):
        assert all(u.lower <= s <= u.upper for s in u.starts)
        assert u.shapes or u.lower <= u.neutral <= u.upper
    rig = cause.extend(SEVERAL, values)
    assert {u.name: rig.number(u.key) for u in cause.unknowns(SEVERAL)} == values
    changed = [a.name for a, b in zip(rig.joints, SEVERAL.joints, strict=True) if a is not b]
    assert changed == [label.rpartition(" ")[2]]
    table = Extension.of(cause, values).table()
    assert table["joint"] == changed[0]
    read = rig_of_tables(SEVERAL, [table], Path())
    assert read.numbers == rig.numbers
    assert label not in law_causes(rig)


@pytest.mark.parametrize("label", VALUES)
def test_another_law_at_its_neutral_numbers_is_the_one_that_is_there(label: str) -> None:
    cause = law_causes(SEVERAL)[label]
    values = {u.name: u.starts[0] if u.shapes else u.neutral for u in cause.unknowns(SEVERAL)}
    there, here = (steady_state(r, 20.0, harmonics=7) for r in (SEVERAL, cause.extend(SEVERAL, values)))
    assert np.abs(there.state.Q - here.state.Q).max() < 1e-6 * np.abs(there.state.Q).max()


LAWS = [StribeckWeakening, DistributedMicroslip, ViscousContact, AsymmetricFriction]

HIDDEN = {
    "stribeck-weakening": (falling(STIFFNESS, 1.4 * LIMIT, 0.8 * LIMIT, 0.01), VALUES["stribeck-weakening shoe"]),
    "distributed-microslip": (parts(STIFFNESS, LIMIT, 0.8), VALUES["distributed-microslip shoe"]),
}


@pytest.mark.parametrize("name", HIDDEN)
def test_another_law_does_what_another_simulator_marches(name: str) -> None:
    hidden, values = HIDDEN[name]
    rig = law_causes(RIG)[f"{name} shoe"].extend(RIG, values)
    hz, force = np.array([20.2, 20.8, 46.5]), np.array([1.0, 1.0, 4.0])
    q, plain = (
        steady(NOMINAL, law, ROWS["b"], "drive", hz, force, periods=120, steps=512, H=H)
        for law in (hidden, jenkins(STIFFNESS, LIMIT))
    )
    for i in range(len(hz)):
        state = steady_state(rig, float(hz[i]), level=float(force[i]), harmonics=25, samples=512).state
        # but for the mean, which hangs on how the march began
        missed = np.abs(q[i, 1:] - state.Q[np.r_[1 : H + 1, 26 : 26 + H]]).max()
        assert missed < 2e-3 * np.abs(q[i]).max()
        assert missed < 0.1 * np.abs(q[i, 1:] - plain[i, 1:]).max()


@pytest.mark.parametrize("name", HIDDEN)
def test_another_law_of_a_joint_is_named_with_its_joint_and_numbers(name: str) -> None:
    hidden, truth = HIDDEN[name]
    d = diagnose(RIG, measured(hidden, "b"), causes=[*LAWS, LocalMicroslip, QuadraticDamping, WrongParameter])
    assert (d.verdict, d.cause) == ("cause-found", name)
    assert d.parameters["joint"] == Estimate("shoe")
    for number, true in truth.items():
        p = d.parameters[number]
        assert abs(p.value - true) < 4.0 * p.std, number


def test_a_channel_that_is_far_too_late_is_found_beside_friction() -> None:
    """By 15 ms, which is more than half a period of the second mode: from no delay steps end in another valley."""
    spectra, late, k = measured(jenkins(STIFFNESS, LIMIT), "b"), 0.015, np.arange(1, H + 1)
    i, read = spectra.channels.index("c"), spectra.coefficients.copy()
    seen = (read[:, i, 1 : H + 1] - 1j * read[:, i, H + 1 :]) * np.exp(-2j * np.pi * k * spectra.hz[:, None] * late)
    read[:, i, 1 : H + 1], read[:, i, H + 1 :] = seen.real, -seen.imag
    found = diagnose(RIG, replace(spectra, coefficients=read), causes=["sensor-delay"])
    assert (found.verdict, found.cause) == ("cause-found", "sensor-delay")
    assert found.parameters["delay_s"].value == pytest.approx(late, rel=1e-3)
