"""A clamp that slips, a tip that lifts off and rubs with a falling law, a stop: in every solver at once."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from continuation import Branch, continue_branch
from hbm.balance.jointed import JointBalance
from hbm.integration.integrate import simulate
from hbm.integration.jointed import joint_steady_state, state_at_phase_zero
from hbm.response import start
from hbm.response.bifurcations import stability_of, with_stability
from hbm.response.trace import steady_state, trace_frequency
from hbm.rigfiles.load import load_rig
from models.jointed import JointedRig

FILE = Path(__file__).parents[2] / "examples" / "jointed_beam.toml"
H, N_T = 41, 2048


@pytest.fixture(scope="module")
def rig() -> JointedRig:
    found = load_rig(FILE)
    assert isinstance(found, JointedRig)
    return found


def test_harmonic_balance_time_integration_and_stability_agree(rig: JointedRig) -> None:
    coarse = steady_state(rig, 44.0, harmonics=9, samples=512)
    solution = steady_state(rig, 44.0, harmonics=H, samples=N_T, start=coarse)
    # all of them are at work
    assert solution["clamp.force"].peak == pytest.approx(4.0, rel=1e-9)  # it slips
    assert solution["tip.force.2"].samples.max() == pytest.approx(83.0, rel=1e-9)  # it is off its support
    assert solution["stop.force"].peak > 5.0
    assert abs(solution.energy_error) < 1e-6
    problem = JointBalance(rig, solution.basis)
    period = joint_steady_state(rig, 44.0, steps_per_period=N_T, start=state_at_phase_zero(problem, solution.state))
    for name in ("a3", "drive", "clamp.motion", "tip.motion.1", "tip.force.2", "stop.motion"):
        a, b = solution[name].coefficients, period.history.coefficients(name, H)
        assert np.hypot(*(a - b)[[1, H + 1]]) < 5e-3 * np.hypot(*a[[1, H + 1]]), name
    stability = stability_of(rig, solution)
    own = np.abs(np.linalg.eigvals(period.monodromy)).max()
    assert stability.largest == pytest.approx(own, abs=0.02)


def test_a_first_solution_is_found_with_few_harmonics(rig: JointedRig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where neither rest nor one harmonic leads there, it is a ramp of few harmonics that does, not one of all."""
    ramps = []

    def noted(problem: JointBalance, *args: Any) -> Branch:
        ramps.append(problem.basis.H)
        return continue_branch(problem, *args)

    monkeypatch.setattr(start, "continue_branch", noted)
    solution = steady_state(rig, 44.0, harmonics=H, samples=512)
    assert ramps and max(ramps) < 10
    problem = JointBalance(rig, solution.basis)
    assert np.abs(problem.residual(*problem.pack(solution.state))).max() < 1e-10
    assert solution["tip.force.2"].samples.max() == pytest.approx(83.0, rel=1e-9)


def test_its_curve_is_traced_with_stability(rig: JointedRig) -> None:
    curve = with_stability(trace_frequency(rig, (43.0, 50.0), harmonics=9, samples=256))
    assert curve.complete
    assert curve.stable is not None
    assert max(abs(p.energy_error) for p in curve.points) < 1e-6


def test_it_is_simulated_like_any_rig(rig: JointedRig) -> None:
    history = simulate(rig, 46.0, duration=2.0 / 46.0, steps_per_period=1024)
    assert len(history.time) == 2 * 1024 + 1
    assert history.largest_residual < 1e-7
