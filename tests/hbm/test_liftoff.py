"""A tip that lifts off its support: two integrators, statics, and its own derivatives."""

import re
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from rigs import beam

import tests.truth as truth
from continuation import Branch, ConvergenceError, continue_branch
from hbm.balance.problem import HarmonicBalance, balance_of
from hbm.balance.solution import PeriodicSolution
from hbm.fourier import FourierBasis
from hbm.integration import integrate
from hbm.integration.handover import state_at_phase_zero
from hbm.response import settling, start
from hbm.response.bifurcations import stability_of
from hbm.response.trace import steady_state
from hbm.sensitivity.derivatives import sensitivities
from models import Attachments, Channel, Damping, Frictionless, Rig
from models.published import PAPER_PENALTY
from tests.truth.measure import coefficients

HZ, LIFTS = 48.0, 38.5
"""Where the paper's beam, damped by 20 1/s, is off its support for 5 to 8 % of the period."""


def with_lift(rig: Rig, lift_off: bool = True) -> Rig:
    return replace(rig, contact=replace(rig.contact, lift_off=lift_off))


def paper(modes: int = 5) -> Rig:
    channels = (
        Channel("a1", "acceleration", 0.2),
        Channel("a2", "acceleration", 0.58),
        Channel("d", "displacement", 0.59),
    )
    return replace(beam(PAPER_PENALTY, alpha=20.0, modes=modes), channels=channels)


@cache
def lifted(modes: int = 5, level: float = LIFTS, **accuracy: int) -> tuple[Rig, PeriodicSolution, PeriodicSolution]:
    """Rig, its motion with the tip kept on the support, and that without."""
    rig = with_lift(paper(modes))
    kept = steady_state(with_lift(rig, False), HZ, level=level, **accuracy)
    return rig, kept, steady_state(rig, HZ, level=level, start=kept, **accuracy)


def off(solution: PeriodicSolution) -> float:
    return float((solution["normal"].samples < 1e-9).mean())


def fundamental(solution: PeriodicSolution, name: str) -> complex:
    c = solution[name].coefficients
    return complex(c[1], c[solution.basis.H + 1])


def test_a_tip_that_stays_on_its_support_moves_as_if_it_were_kept_there() -> None:
    rig = paper()
    kept, free = (steady_state(r, HZ, level=30.0) for r in (rig, with_lift(rig)))
    assert kept["normal"].samples.min() > 20.0
    for name in kept.channels:
        size = np.abs(kept[name].coefficients).max()
        np.testing.assert_allclose(free[name].coefficients, kept[name].coefficients, atol=1e-7 * size)


def test_a_motion_says_for_how_long_its_tip_is_off_its_support() -> None:
    _, kept, free = lifted()
    assert f"the tip is out of contact for {off(free):.0%} of the period" in str(free)
    assert "the tip would lift off: the normal reaction turns negative; the model keeps it" in str(kept)
    assert "tip" not in str(steady_state(paper(), HZ, level=1.0, harmonics=3))


@pytest.mark.parametrize("load", [1e-4, 1e-2])
def test_a_tip_without_load_bends_like_a_cantilever(load: float) -> None:
    """That of a static force in one half of its period, none of the tip in the other."""
    rig = replace(with_lift(beam(Frictionless(), modes=20)), channels=(Channel("tip", "displacement", 0.606),))
    rig = replace(rig, contact=replace(rig.contact, normal_load=load))
    L, EI, x = 0.606, rig.body.bending_stiffness, rig.excitation.position
    found = steady_state(rig, 0.01, level=1.0, harmonics=31, samples=1024)
    expected = max(1.0 - load / ((3 * L * x**2 - x**3) / (2 * L**3)), 0.0) * x**2 * (3 * L - x) / (6 * EI)
    assert found["tip"].samples.max() == pytest.approx(expected, rel=0.02)
    assert np.abs(found["tip"].samples[np.cos(2 * np.pi * np.arange(1024) / 1024) < -0.2]).max() < 0.02 * expected


@pytest.mark.parametrize("modes", [5, 8])
def test_time_integration_finds_the_same_steady_state(modes: int) -> None:
    """Over seven harmonics, to a twentieth of what the lift does."""
    rig, kept, balanced = lifted(modes, harmonics=47, samples=1024)
    assert 0.03 < off(balanced) < 0.1
    assert abs(balanced.energy_error) < 1e-9
    start = state_at_phase_zero(balanced)
    assert integrate.simulate(rig, HZ, level=LIFTS, start=start, duration=0.02).lift_off is None  # it does, and may
    marched = integrate.steady_state(rig, HZ, level=LIFTS, steps_per_period=2048, start=start)
    assert marched.converged
    for name in ("drive", "d", "a1", "a2", "normal"):
        ours = marched.history.coefficients(name, 7)[1:]
        theirs, without = (
            np.concatenate([s[name].coefficients[1:8], s[name].coefficients[48:55]]) for s in (balanced, kept)
        )
        np.testing.assert_allclose(ours, theirs, atol=0.05 * np.abs(without - theirs).max(), err_msg=name)


def test_the_independent_simulator_finds_the_same_steady_state() -> None:
    """Eight modes each; to a tenth of what the lift does to what is seen."""
    rig, kept, balanced = lifted(8, harmonics=47, samples=1024)
    sensors = [(c.name, c.position) for c in rig.channels if c.quantity == "acceleration"]
    true = truth.table_1(truth.Coulomb(**PAPER_PENALTY_NUMBERS), sensors=[x for _, x in sensors], alpha=20.0)
    true = replace(true, effects=(truth.ContactLoss(83.0),), modes=8)
    settings = truth.Settings(ramp=8, hold=5, coarse=128, tolerance=1e-7)
    seen = truth.simulate_records(true, [truth.Record(LIFTS, HZ)], 1024, settings)
    assert (seen.converged & seen.stable).all()
    for j, (name, _) in enumerate(sensors):
        theirs = coefficients(seen.acceleration[0, j], 9)[1:]
        ours, without = (s[name].coefficients[1:10] + 1j * s[name].coefficients[48:57] for s in (balanced, kept))
        assert np.abs(ours - theirs).max() < 0.1 * np.abs(without - theirs).max()
    assert off(balanced) == pytest.approx((seen.R[0] < 1e-6).mean(), abs=0.01)


PAPER_PENALTY_NUMBERS = {"mu": PAPER_PENALTY.mu, "critical_slip": PAPER_PENALTY.critical_slip}

DIFFERENTIATED = 38.7

KEYS = {
    "contact.normal_load": 1e-6,
    "contact.radius": 1e-6,
    "contact.load_variation": 1e-6,
    "contact.friction.mu": 1e-6,
    "beam.length": 1e-6,
    "beam.youngs_modulus": 1e-6,
    "beam.density": 1e-6,
    "excitation.position": 1e-6,
    "damping.mass_proportional": 1e-5,
    "attachments.clamp_stiffness": 1e-5,
    "excitation.amplitude": 1e-6,
    "frequency_hz": 1e-7,
}


@pytest.fixture(scope="module")
def differentiated():
    rig = replace(with_lift(paper(7)), attachments=Attachments(clamp_stiffness=2e7))
    kept = steady_state(with_lift(rig, False), HZ, level=38.0, harmonics=15, samples=512)
    solution = steady_state(rig, HZ, level=DIFFERENTIATED, harmonics=15, samples=512, start=kept)
    assert off(solution) > 0.02
    return rig, solution, sensitivities(rig, solution, tuple(KEYS))


@pytest.mark.parametrize("key", KEYS)
def test_derivatives_are_those_of_solutions_again(differentiated, key: str) -> None:
    rig, solution, s = differentiated
    i, h = s.parameters.index(key), KEYS[key]

    def again(factor: float) -> PeriodicSolution:
        settings = {"harmonics": 15, "samples": 512, "start": solution}
        if key == "frequency_hz":
            return steady_state(rig, HZ * factor, level=DIFFERENTIATED, **settings)
        if key == "excitation.amplitude":
            return steady_state(rig, HZ, level=DIFFERENTIATED * factor, **settings)
        return steady_state(rig.with_number(key, s.values[i] * factor), HZ, level=DIFFERENTIATED, **settings)

    above, below = again(1 + h), again(1 - h)
    for name in ("a1", "a2", "d", "drive", "friction", "normal"):
        difference = (above[name].coefficients - below[name].coefficients) / (2 * h * s.values[i])
        exact, size = s[name].coefficients[:, i], np.abs(solution[name].coefficients[1:]).max() / abs(s.values[i])
        np.testing.assert_allclose(exact, difference, rtol=0, atol=2e-3 * np.abs(difference).max() + 3e-5 * size)


@pytest.mark.parametrize("parameter", ["frequency", "force"])
def test_newton_solves_with_the_complete_derivative(parameter: str) -> None:
    rig, _, solution = lifted(harmonics=9, samples=256)
    problem = HarmonicBalance(rig, solution.basis, parameter=parameter, hz=HZ, level=LIFTS)
    x, lam = problem.pack(solution.state)
    here = problem.linearize(x, lam)
    rng = np.random.default_rng(1)
    row, rhs = rng.standard_normal(problem.size), rng.standard_normal(problem.size)
    h, direction = 1e-7, rng.standard_normal(problem.size)
    moved = (problem.residual(x + h * direction, lam) - problem.residual(x - h * direction, lam)) / (2 * h)
    np.testing.assert_allclose(here.complete @ direction, moved, atol=1e-5 * np.abs(moved).max())
    column = (problem.residual(x, lam + h) - problem.residual(x, lam - h)) / (2 * h)
    found, d_lam = here.solve_bordered(row, 0.5, rhs, 0.3)
    matrix = np.block([[here.complete, column[:, None]], [row, 0.5]])
    exact = np.linalg.solve(matrix, np.append(rhs, 0.3))
    np.testing.assert_allclose(np.append(found, d_lam), exact, atol=1e-2 * np.abs(exact).max())


def test_stability_is_that_of_the_time_integrator() -> None:
    """Of a motion that is not stable."""
    rig, _, solution = lifted(harmonics=31, samples=2048)
    marched = integrate.steady_state(rig, HZ, level=LIFTS, steps_per_period=2048, start=state_at_phase_zero(solution))
    found = stability_of(rig, solution)
    ours, theirs = (np.sort(np.abs(m))[::-1][:6] for m in (found.multipliers, marched.multipliers))
    assert not found.stable
    np.testing.assert_allclose(ours, theirs, atol=0.01)


def test_what_needs_something_else_too_is_refused() -> None:
    rig = with_lift(paper())
    for contact, named in (
        ({"load_variation": 0.0}, "variable_normal_load = true"),
        ({"residual_compliance": False}, "residual_compliance = true"),
    ):
        bad = replace(rig, contact=replace(rig.contact, **contact))
        with pytest.raises(ValueError, match=named):
            steady_state(bad, HZ)
    slipping = replace(rig, attachments=Attachments(clamp_stiffness=1e6, clamp_limit=5.0))
    with pytest.raises(ValueError, match="no clamp_limit"):
        steady_state(slipping, HZ)


def test_a_tip_that_is_off_for_long_is_marched_to() -> None:
    """Far beyond the onset, with all modes but the first damped by 2 %."""
    rig = with_lift(paper())
    rig = replace(rig, damping=replace(rig.damping, high_mode_from=2))
    kept = steady_state(with_lift(rig, False), HZ, level=60.0, harmonics=31)
    assert kept["normal"].samples.min() < -0.5 * rig.contact.normal_load
    found = steady_state(rig, HZ, level=60.0, harmonics=31, start=kept)
    assert 0.4 < off(found) < 0.5
    assert stability_of(rig, found).stable
    assert np.abs(found["friction"].samples[found["normal"].samples <= 0.0]).mean() < 0.5  # 31 harmonics of it
    marched = integrate.steady_state(rig, HZ, level=60.0, steps_per_period=1024, start=state_at_phase_zero(found))
    assert marched.converged
    drive = np.abs(found["drive"].coefficients).max()
    np.testing.assert_allclose(
        marched.history.coefficients("drive", 31), found["drive"].coefficients, atol=2e-3 * drive
    )


def test_where_no_way_leads_to_a_motion_it_is_said_how_far_one_is_from_periodic(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With hardly any damping a tip that jumps rings from period to period; with much it settles."""
    for way in ("_directly", "_by_samples", "_by_harmonics", "_by_force", "_from_afar", "_by_time"):
        monkeypatch.setattr(start, way, lambda *_, **__: None)

    def change(ratio: float) -> float:
        rig = replace(with_lift(paper()), damping=Damping(modal_ratios=(ratio,)))
        with pytest.raises(
            ConvergenceError, match=r"try more harmonics or samples, .* or simulate it in time"
        ) as failed:
            steady_state(rig, 40.0, level=200.0, harmonics=3)
        found = re.search(
            "marched in time, the motion still changes by (.*) of itself over its 60th", str(failed.value)
        )
        assert found is not None
        return float(found[1])

    assert change(1e-3) > 0.1
    assert change(0.05) < 1e-6


def test_a_motion_is_marched_once_for_its_start_and_for_what_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the usual samples first, then with more, which begin with a solution of those."""
    for way in ("_directly", "_by_harmonics", "_by_force", "_from_afar"):
        monkeypatch.setattr(start, way, lambda *_, **__: None)
    marches = []

    def counted(*args: Any, **settings: Any) -> Any:
        marches.append(settings["duration"])
        return integrate.simulate(*args, **settings)

    monkeypatch.setattr(settling, "simulate", counted)
    rig = replace(with_lift(paper()), damping=Damping(modal_ratios=(1e-3,)))
    with pytest.raises(ConvergenceError, match="still changes by"):
        steady_state(rig, 40.0, level=200.0, harmonics=3, samples=512)
    assert marches == [60 / 40.0]


def test_ramps_of_the_force_have_so_many_points_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that creep, for a joint that opens at every step, do not all creep to their own end."""
    ended = []

    def creeping(problem: Any, x: Any, lam: float, settings: Any, late: Any) -> Branch:
        ended.append((problem.basis.H, settings.max_points))
        return continue_branch(problem, x, lam, settings, late)

    monkeypatch.setattr(start, "continue_branch", creeping)
    monkeypatch.setattr(start, "MOST_POINTS", 3)
    monkeypatch.setattr(start, "_upwards", lambda *_: None)
    problem = balance_of(with_lift(paper()), FourierBasis(9, 128), level=LIFTS)
    assert start._by_force(problem, problem.lam_at(HZ), lambda _: False) is None
    assert ended == [(3, 3)]
