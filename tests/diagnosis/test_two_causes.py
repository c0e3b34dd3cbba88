"""Two hidden effects at one place of a structure of one mode, in the records of an independent simulator."""

import re
from collections.abc import Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from hbm.diagnosis.decide import STRONGER, hardly_behind, leading
from hbm.diagnosis.diagnose import diagnose
from hbm.diagnosis.predict import pays_unseen
from hbm.diagnosis.verdict import Diagnosis
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from hbm.outputerror.evaluation import Evaluation
from models.bodies import ModalModel
from models.causes import WrongParameter
from models.causes.cause import Cause
from models.causes.joints import CubicStiffness, LocalDamper, QuadraticDamping
from models.jointed import JointedRig
from models.parts import Channel, Damping, Excitation
from tests.truth.modal import Modes, accelerations, cubic, quadratic, steady

NOMINAL = Modes(np.array([40.0]), np.array([0.004]), {"tip": np.array([0.8])})
OFF = {"hz": 3e-4, "ratio": 0.05, "shape": 3e-3}
K3, DRAG = 3.67e11, 268.0
LEVELS, HALF_BANDS = (0.1, 0.25, 0.5, 1.0), (-2.0, -1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0)
FORCE, H, NOISE = 0.118, 3, 5e-3
"""Largest force [N]; noise of each coefficient, of the rms of the channel."""


def rig() -> JointedRig:
    """The structure as it is known: linear."""
    body = ModalModel(tuple(NOMINAL.hz), {name: tuple(row) for name, row in NOMINAL.rows.items()})
    channels = (Channel("force", "force"), Channel("a", "acceleration", at="tip"))
    damping = Damping(modal_ratios=tuple(NOMINAL.ratio))
    return JointedRig("one mode", body, damping, (), Excitation(1.0, at="tip"), channels)


@cache
def records() -> MeasuredSpectra:
    """Records of the structure with a cubic spring and a quadratic dashpot."""
    rng = np.random.default_rng(1)
    true, hardening, drag = NOMINAL.disturbed(rng, **OFF), cubic(K3), quadratic(DRAG)
    hz = np.tile(NOMINAL.hz * (1.0 + np.array(HALF_BANDS) * NOMINAL.ratio), len(LEVELS))
    force = np.repeat(LEVELS, len(HALF_BANDS)) * FORCE
    q = steady(
        true,
        lambda u, v, z: (hardening(u, v, z)[0] + drag(u, v, z)[0], z),
        true.rows["tip"],
        "tip",
        hz,
        force,
        periods=250,
        H=H,
    )
    clean = accelerations(true, q, "tip", hz)
    std = NOISE * np.sqrt(np.mean(clean[:, [1, H + 1]] ** 2))
    seen = {"a": clean + std * rng.standard_normal(clean.shape), "force": np.zeros(clean.shape)}
    seen["force"][:, 1] = force
    stds = {name: np.full((len(hz), H + 1), s) for name, s in (("a", std), ("force", 1e-4 * FORCE))}
    for name in seen:  # no mean was measured
        seen[name][:, 0] = stds[name][:, 0] = np.nan
    return spectra_of(rig(), hz, force, seen, stds)


def told(*causes: type[Cause]) -> tuple[Diagnosis, set[str]]:
    """The diagnosis with some candidates, and the names in the extended model."""
    found = diagnose(rig(), records(), causes=[WrongParameter, *causes])
    return found, set() if found.extended_fit is None else {c.name for c in found.extended_fit.model.causes}


@pytest.mark.slow
def test_two_causes_that_hide_each_other_are_named_together() -> None:
    """Alone the spring takes the damping to the bound of its tolerance, so that it is not believed."""
    found, names = told(CubicStiffness, QuadraticDamping)
    assert (found.verdict, names) == ("cause-found", {"cubic-stiffness", "quadratic-damping"})
    assert found.errors["extended"]["held_out"].nrmse < 0.01 < 0.2 < found.errors["calibrated"]["held_out"].nrmse
    shares = next(line for line in found.evidence if line.startswith("Of the misfit"))
    spring, drag, both = (float(share) for share in re.findall(r"([\d.]+) %", shares))
    assert drag < 50.0 < spring < 90.0 and both > 99.0, shares


@pytest.mark.slow
def test_no_pair_is_named_where_one_of_the_two_is_not_in_the_catalogue() -> None:
    found, names = told(CubicStiffness, LocalDamper)
    assert (found.verdict, names) == ("unexplained", set())


# ---- what leads, and what a second one has to take


def fit(label: str, chi2: float, *causes: str, missing: tuple[int, ...] = (), settled: bool = True) -> Evaluation:
    """A fit of some causes."""
    model = SimpleNamespace(label=label, causes=causes)
    return cast(Evaluation, SimpleNamespace(model=model, chi2=chi2, bic=chi2, missing=missing, settled=settled))


def test_first_causes_lead_that_take_a_large_share() -> None:
    """In whatever order they were judged, which need not be that of their chi2."""
    base, first, again, second = fit("base", 1000.0), fit("a", 200.0), fit("a", 210.0), fit("b", 400.0)
    transient, lost = fit("t", 10.0, settled=False), fit("l", 20.0, missing=(3,))
    raced = [transient, lost, second, first, again, fit("c", 100.0)]
    assert leading(base, None, raced) == [second, first]
    assert leading(base, second, raced) == [second]
    assert leading(base, transient, raced) == []
    little = fit("d", 1001.0 * STRONGER)
    assert leading(base, little, raced) == leading(base, None, [little]) == []


def test_of_few_readings_those_lead_too_that_are_hardly_behind() -> None:
    judged = [-78.5, -76.2, -76.1, -74.3, -74.1, -60.0]
    assert hardly_behind(judged) == 4
    assert [hardly_behind(judged[:n]) for n in range(3)] == [0, 1, 2]
    raced = [fit(label, 100.0) for label in "abcdef"]
    assert leading(fit("base", 1000.0), None, raced, hardly_behind(judged)) == raced[:4]
    assert leading(fit("base", 1000.0), raced[2], raced, hardly_behind(judged)) == raced[2:3]


@pytest.mark.parametrize(("left", "paid"), [(69.0, True), (71.0, False)])
def test_a_second_cause_takes_its_share_of_records_held_out(left: float, paid: bool) -> None:
    def unseen(e: Evaluation) -> Any:
        return White(e.chi2)

    pair, alone, other = fit("a + b", left, "a", "b"), fit("a", 100.0, "a"), fit("c", 1.0, "c")
    assert pays_unseen(pair, [alone, other], unseen) is paid
    assert pays_unseen(alone, [alone, other], unseen)


class White(Sequence[float]):
    """Ten coefficients with so much chi2 beyond noise."""

    def __init__(self, beyond: float) -> None:
        self.charged = 10.0 + beyond

    def __len__(self) -> int:
        return 10

    def __getitem__(self, i: Any) -> Any:
        return 0.0
