"""How exactly numbers of causes are known at a kink, and which of them are surely not where a cause changes nothing."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from hbm.diagnosis.deviations import matters, std_at_kinks
from hbm.diagnosis.estimates import estimates, std_upwards
from hbm.outputerror.evaluation import evaluate
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.model import Model
from hbm.response.synthesis import synthesize
from models.causes.clamp import ClampFriction
from models.causes.parameter import WrongParameter
from models.causes.structure import AddedMass, AttachedResonator
from models.friction.extended import WeakeningJenkins
from tests.hbm.rigs import beam

STICKING = 0.508
"""Static coefficient from which on the tip sticks at 5.5 N and 48 Hz."""


def measured(level, law, key):
    """One record of a beam, and a model of it with one free number."""
    rig = beam(law, alpha=2.0)
    campaign, _ = campaign_of(rig, synthesize(rig, (level,), (48.0,), snr=60.0, seed=1, harmonics=3).spectra)
    return campaign, Model(rig, {}, (WrongParameter(key),))


def test_at_the_onset_of_slip_a_number_is_as_uncertain_as_where_the_tip_sticks():
    campaign, model = measured(5.5, WeakeningJenkins(0.5, 0.4, 2e-3, 1e7), "contact.friction.mu_static")
    (free,) = model.free
    slides, sticks, far = (
        evaluate(model, campaign, np.array([free.of(mu)]), {}) for mu in (0.5, STICKING, 0.5 + 3.0 * 0.095)
    )
    assert slides.std == pytest.approx(0.095, rel=0.01)
    assert not sticks.white.jacobian.any()  # nothing is known of it there
    linear = slides.white.residual - slides.white.jacobian @ (far.x - slides.x)
    assert linear @ linear - slides.white.chi2 > 5.0  # by the derivative, and by simulation:
    assert abs(far.white.chi2 - slides.white.chi2) < 1.0
    assert std_at_kinks(slides, campaign) == pytest.approx(sticks.std)


def test_where_a_tip_slides_on_either_side_the_derivative_is_believed():
    campaign, model = measured(6.5, beam().contact.law, "contact.friction.mu")
    e = evaluate(model, campaign, model.start, {})
    assert std_at_kinks(e, campaign) == pytest.approx(e.std, rel=0.01)


@pytest.mark.parametrize(
    ("causes", "numbers", "said"),
    [
        ((AddedMass(),), {"mass": (0.010, 0.003), "position": (0.3, 0.2)}, True),
        ((AddedMass(),), {"mass": (0.008, 0.003), "position": (0.3, 0.001)}, False),  # where nothing is, is exact
        ((AttachedResonator(),), {"mass": (8e-5, 3e-5), "frequency_hz": (230.0, 1.0), "position": (0.3, 0.1)}, False),
        ((ClampFriction(),), {"stiffness": (1e12, 1e18), "limit": (2.3, 0.1)}, True),  # rigid until it slips
        ((ClampFriction(),), {"stiffness": (1e12, 1e18), "limit": (2.3, 1.0)}, False),
        ((ClampFriction(),), {"stiffness": (np.inf, np.nan), "limit": (np.inf, np.nan)}, False),
    ],
)
def test_a_cause_matters_where_a_number_is_surely_not_neutral(causes, numbers, said):
    model = Model(beam(), {}, causes)
    values, std = zip(*(numbers[f.name] for f in model.free), strict=True)
    x = np.array([f.of(value) for f, value in zip(model.free, values, strict=True)])
    assert matters(SimpleNamespace(model=model, x=x), np.array(std)) is said


def test_of_two_causes_each_must_matter():
    model = Model(beam(), {}, (AddedMass(), ClampFriction()))
    mass = {(0, "mass"): (0.01, 0.001), (0, "position"): (0.3, 0.01)}
    for stiffness, limit, said in (((1e4, 10.0), (2.3, 0.1), True), ((1e12, 1e18), (2.3, 5.0), False)):
        numbers = mass | {(1, "stiffness"): stiffness, (1, "limit"): limit}
        values, std = zip(*(numbers[f.cause, f.name] for f in model.free), strict=True)
        x = np.array([f.of(value) for f, value in zip(model.free, values, strict=True)])
        assert matters(SimpleNamespace(model=model, x=x), np.array(std)) is said


def test_a_cause_without_a_size_matters():
    model = Model(beam(), {}, ())
    assert matters(SimpleNamespace(model=model, x=np.zeros(0)), np.zeros(0))


@pytest.mark.parametrize("share", [0.01, 0.1, 0.3, 0.6, 2.0])
def test_a_stiffness_is_as_uncertain_as_it_may_be_larger(share):
    """By draws of the logarithm of the compliance, of which the records leave some."""
    rng = np.random.default_rng(1)
    compliance = np.exp(rng.uniform(np.log(max(0.01 * share, 1.0 - 8.0 * share)), np.log(1.0 + 8.0 * share), 4_000_000))
    left = 1.0 / compliance[rng.random(len(compliance)) < np.exp(-0.5 * ((compliance - 1.0) / share) ** 2)]
    assert np.mean(left > 1.0 + std_upwards(1.0, share)) == pytest.approx(norm.cdf(-1.0), abs=3e-3)


def test_what_is_told_of_a_clamp_that_is_nearly_rigid_allows_for_a_stiffer_one():
    rig, causes = beam(), (ClampFriction(),)
    model = Model(rig, {}, causes)
    told = {"stiffness": 3e5, "limit": 0.8}
    x = np.array([f.of(told[f.name]) for f in model.free])
    e = SimpleNamespace(model=model, x=x, std=np.array([2e5, 1e-3]))
    found = estimates(e)
    assert found["stiffness"].std == std_upwards(3e5, 2e5) > 4e6
    assert found["limit"].std == pytest.approx(1e-3, rel=0.03)
    assert std_upwards(np.inf, 3.0) == 3.0 and std_upwards(1.0, 0.0) == 0.0
