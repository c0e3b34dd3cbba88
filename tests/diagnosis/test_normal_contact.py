"""Friction under a constant load in the rig file; in the structure under that of an elastic contact, or by a spring."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from hbm.diagnosis.diagnose import diagnose
from hbm.diagnosis.estimates import told_of
from hbm.outputerror.evaluation import Evaluation, evaluate
from hbm.outputerror.fit import fit_model
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.model import Model
from hbm.response.trace import steady_state
from hbm.rigfiles.extensions import Extension, rig_of_tables
from models.causes.joints import LocalSpring
from models.causes.parameter import WrongParameter
from models.causes.pressing import NormalContact
from models.friction import Jenkins
from models.jointed import JointedRig
from models.joints import CubicSpring, Friction, Joint
from tests.three_modes import NOMINAL, ROWS, SENSORS, rig_of, spectra_with_noise
from tests.truth.modal import accelerations

MU, SLIP, LOAD, PRESSED = 0.5, 2e-4, 1.2, 4000.0
SHOE = Joint("shoe", Friction(Jenkins(MU, SLIP), LOAD), ("b",))
RIG = replace(rig_of(NOMINAL), joints=(SHOE,))


def marched(hz: np.ndarray, force: np.ndarray, pressed: float = PRESSED, spring: float = 0.0, H: int = 5) -> np.ndarray:
    """Modal harmonics (r, 2H+1, n) with what rubs along b, by central differences: a presses it, or springs back."""
    periods, steps = 100, 512
    omega, dt, k = 2 * np.pi * NOMINAL.hz, 1.0 / (hz * steps), MU * LOAD / SLIP
    u, last, anchor = np.zeros((len(hz), 3)), np.zeros((len(hz), 3)), np.zeros(len(hz))
    damping, step = 2 * NOMINAL.ratio * omega, dt[:, None]
    kept = np.zeros((steps, len(hz), 3))
    for i in range(periods * steps):
        kept[i % steps] = u
        load = np.maximum(LOAD + pressed * (u @ ROWS["a"]), 0.0)
        rub = np.clip(k * (anchor - u @ ROWS["b"]), -MU * load, MU * load)
        anchor = u @ ROWS["b"] + rub / k
        pushed = np.outer(rub, ROWS["b"]) + np.outer(LOAD - load - spring * (u @ ROWS["a"]), ROWS["a"])
        drive = np.outer(force * np.cos(2 * np.pi * (i % steps) / steps), ROWS["drive"])
        there = pushed + drive - omega**2 * u + 2 * u / step**2 - last * (1 / step**2 - damping / (2 * step))
        u, last = there / (1 / step**2 + damping / (2 * step)), u
    c = np.fft.rfft(kept, axis=0)[: H + 1].transpose(1, 0, 2) / steps
    return np.concatenate([c.real[:, :1], 2 * c.real[:, 1:], -2 * c.imag[:, 1:]], axis=1)


def test_the_stiffness_along_the_normal_is_found_in_what_another_simulator_marches() -> None:
    hz = np.array([18.5, 20.6, 22.5, 24.0, 46.0, 50.0])
    force = np.array([0.5, 0.5, 3.0, 1.5, 6.0, 4.0])
    q = marched(hz, force)
    seen = {name: accelerations(NOMINAL, q, name, hz) for name in SENSORS}
    spectra = spectra_with_noise(RIG, seen, hz, force, np.random.default_rng(3))
    campaign, _ = campaign_of(RIG, spectra)
    cause = NormalContact("shoe", "a")
    (unknown,) = cause.unknowns(RIG)
    without = Model(RIG, {})
    model = without.extended_by(cause)
    starts = (evaluate(model, campaign, np.array([model.free[-1].of(s)]), {}) for s in unknown.starts[1:3])
    start = min(starts, key=lambda e: e.chi2)
    found = fit_model(model, campaign, start.x, start.solutions)
    longest = max(share for solution in found.solutions.values() for share in solution.off.values())
    assert found.values[0, "stiffness"] == pytest.approx(PRESSED, abs=max(4 * found.std[0], 1e-3 * PRESSED))
    assert found.chi2 < 1e-3 * evaluate(without, campaign, without.start, {}).chi2
    assert longest > 0.05  # of a period in which it is open


def test_a_spring_beside_friction_is_not_taken_for_the_frequency_that_it_moves() -> None:
    """By 3.5 tolerances: calibration takes next to all, and the test asked for the frequency alone, a mistaken name."""
    hz = np.tile([18.5, 19.6, 20.6, 21.3, 22.5, 24.0], 2)
    force = np.repeat([0.6, 3.0], 6)
    q = marched(hz, force, pressed=0.0, spring=2350.0)
    seen = {name: accelerations(NOMINAL, q, name, hz) for name in SENSORS}
    spectra = spectra_with_noise(RIG, seen, hz, force, np.random.default_rng(0))
    found = diagnose(RIG, spectra, causes=[LocalSpring, WrongParameter])
    assert found.cause is not None and found.extended_fit is not None
    assert found.extended_fit.model.causes == (LocalSpring("a"),)
    assert found.extended_fit.values[0, "stiffness"] == pytest.approx(2350.0, abs=4 * found.extended_fit.std[0])


def test_it_is_offered_where_the_load_is_constant_in_every_direction_but_that_of_the_friction() -> None:
    labels = {c.label for c in NormalContact.candidates(RIG)}
    assert labels == {f"normal-contact shoe {sign}{place}" for place in ("drive", "a", "c") for sign in ("", "-1*")}
    pressed = NormalContact("shoe", "a").extend(RIG, {"stiffness": 9.0})
    beside = replace(RIG, joints=(Joint("spring", CubicSpring(1e7), ("c",)),))
    assert not [c for rig in (pressed, beside) for c in NormalContact.candidates(rig)]
    rows = {**ROWS, "p.x": np.array([0.9, 0.3, -0.5]), "p.y": np.array([0.4, -1.3, 0.6]), "o.y": np.ones(3)}
    named: JointedRig = rig_of(replace(NOMINAL, rows=rows), (replace(SHOE, at=("p.x",)),))
    assert {c.at for c in NormalContact.candidates(named)} == {"p.y", "-1*p.y"}
    between = replace(RIG, joints=(replace(SHOE, to=("a",)),))
    assert {(c.at, c.to) for c in NormalContact.candidates(between)} >= {("b", "c"), ("c", "b")}
    assert all(c.to for c in NormalContact.candidates(between))


def test_without_stiffness_it_changes_nothing_and_a_rig_file_has_it() -> None:
    cause = NormalContact("shoe", "-1*c")
    least, more = (cause.extend(RIG, {"stiffness": k}) for k in (0.0, 700.0))
    there, here = (steady_state(rig, 20.0, harmonics=7).state.Q for rig in (RIG, least))
    assert np.abs(there - here).max() < 1e-6 * np.abs(there).max()
    read = rig_of_tables(RIG, [Extension.of(cause, {"stiffness": 700.0}).table()], Path())
    assert read.numbers == more.numbers
    assert read.joints[0].at == ("b", "-1*c")
    assert told_of(cast(Evaluation, SimpleNamespace(model=Model(RIG, {}, (cause,))))) == cause.label
