"""Stability: closed forms, charts, and the monodromy of the time integration, laws with memory included."""

from dataclasses import replace

import numpy as np
import pytest
from rigs import HZ, beam, oscillator
from scipy.special import mathieu_a, mathieu_b

from hbm.balance.problem import HarmonicBalance
from hbm.fourier import FourierBasis
from hbm.integration import integrate
from hbm.integration.handover import state_at_phase_zero
from hbm.response.bifurcations import stability_of, with_stability
from hbm.response.curve import ResponseCurve
from hbm.response.trace import steady_state, trace_frequency
from hbm.stability.hill import HillMatrix, hill, hill_exponents
from hbm.stability.multipliers import floquet
from models import Attachments, Coulomb, Dahl, Frictionless, Iwan, Jenkins, LuGre, Rig, Stribeck
from models.elements import ImpactStop, MidplaneStretching, QuadraticDrag

JENKINS = Jenkins(mu=0.52, critical_slip=4.15e-6)
# falls with speed: it drives itself
STRIBECK = Stribeck(mu_static=0.5, mu=0.3, stribeck_velocity=5e-3, critical_slip=4e-6)
LUGRE = LuGre(0.52, 0.49, 5e-3, 1e7, bristle_damping=300.0, viscous=0.0)
IWAN = Iwan(mu=0.52, stiffness=1e7, elements=3)
STOP = 0.4


def duffing(force: float = 1.0) -> Rig:
    """The beam sliding freely, in its first mode alone, held axially."""
    rig = beam(Frictionless(), alpha=3.0, modes=1, residual_compliance=False, foreshortening=False)
    return replace(rig, elements=(MidplaneStretching(2e8),), excitation=replace(rig.excitation, amplitude=force))


def judged(rig: Rig, hz: float, level: float, **numerics: int):
    """Balance, solution, stability and the monodromy of the time integration on as many steps."""
    solution = steady_state(rig, hz, level=level, **numerics)
    problem = HarmonicBalance(rig, solution.basis, level=level)
    marched = integrate.steady_state(
        rig, hz, level=level, steps_per_period=solution.basis.N_t, start=state_at_phase_zero(solution)
    )
    assert marched.converged
    return problem, solution, floquet(problem, solution.state), marched.multipliers


def missed(found: np.ndarray, expected: np.ndarray, least: float = 0.05) -> float:
    """Largest distance of an expected multiplier that matters to the nearest found."""
    return float(max(np.abs(found - m).min() for m in expected[np.abs(expected) > least]))


# ---- closed forms and charts


def test_multipliers_of_free_sliding_are_those_of_the_modes() -> None:
    rig = beam(Frictionless(), alpha=3.0, modes=3)
    solution = steady_state(rig, 52.0, harmonics=3, samples=32)
    found = floquet(HarmonicBalance(rig, solution.basis), solution.state)
    s = rig.structure
    decay = s.damping / 2
    exponents = -decay + 1j * np.sqrt(s.omega_n**2 - decay**2)
    expected = np.exp(np.concatenate([exponents, exponents.conj()]) / 52.0)
    assert missed(found.multipliers, expected) < 1e-12
    assert found.stable and found.undying == 0
    np.testing.assert_allclose(found.exponents.real[:6], -1.5, rtol=1e-9)


@pytest.fixture(scope="module")
def bent() -> ResponseCurve:
    """Duffing's curve over both of its folds."""
    return with_stability(trace_frequency(duffing(), (48.6, 50.8), harmonics=7, samples=128, step_hz=0.5))


def test_duffing_is_unstable_exactly_between_its_folds(bent: ResponseCurve) -> None:
    curve = bent
    folds = [b.behind for b in curve.bifurcations]
    assert [b.kind.value for b in curve.bifurcations] == ["fold", "fold"]
    between = np.zeros(len(curve.points), dtype=bool)
    between[slice(*folds)] = True
    assert between.any()
    assert np.array_equal(curve.stable, ~between)
    for b in curve.bifurcations:
        # seven harmonics and 128 samples leave so much
        assert b.stability.multipliers[0] == pytest.approx(1.0, abs=1e-5)
    assert [b.hz for b in curve.bifurcations] == pytest.approx(curve.folds, rel=1e-4)


def test_disturbances_of_duffing_lose_volume_as_damping_takes_it() -> None:
    """Liouville: the multipliers of q'' + alpha q' + ... have the product exp(-alpha T)."""
    solution = steady_state(duffing(), 49.0, harmonics=7, samples=128)
    found = floquet(HarmonicBalance(duffing(), solution.basis), solution.state)
    assert np.prod(found.multipliers[:2]).real == pytest.approx(np.exp(-3.0 / 49.0), rel=1e-7)


def test_time_tells_stable_from_unstable(bent: ResponseCurve) -> None:
    """Motions that start beside a periodic one return to it, or leave it at the rate of the largest multiplier."""
    rig, curve, steps = duffing(), bent, 128
    unstable = np.flatnonzero(~curve.stable)
    for i in (0, int(unstable[len(unstable) // 2])):
        p, multipliers = curve.points[i], curve.stability[i].multipliers
        at = integrate.steady_state(rig, p.hz, steps_per_period=steps, start=state_at_phase_zero(p)).history.state
        periods = 30
        moved = replace(at, q=at.q * (1 + 1e-6), time=0.0)
        march = integrate.simulate(rig, p.hz, duration=periods / p.hz, steps_per_period=steps, start=moved)
        away = np.array([march.q[::steps, 0] - at.q[0], (march.qdot[::steps, 0] - at.qdot[0]) / (2 * np.pi * p.hz)])
        growth = (np.linalg.norm(away[:, -1]) / np.linalg.norm(away[:, 10])) ** (1 / (periods - 10))
        assert (growth > 1.0) == (not curve.stable[i])
        if growth > 1.0:
            assert growth == pytest.approx(abs(multipliers[0]), rel=0.02)


@pytest.mark.parametrize("q", [0.5, 2.0, 5.0])
@pytest.mark.parametrize(
    ("m", "value"), [(m, v) for m in range(4) for v in (mathieu_a, mathieu_b) if m or v is mathieu_a]
)
def test_hill_finds_the_edges_of_mathieus_chart(m: int, value, q: float) -> None:
    """y'' + (a - 2 q cos 2t) y = 0: multipliers (-1)^m on the edges, beside them stable on one side only."""

    def multipliers(a: float) -> np.ndarray:
        t = np.pi * np.arange(64) / 64
        A = np.zeros((64, 2, 2))
        A[:, 0, 1], A[:, 1, 0] = 1.0, 2 * q * np.cos(2 * t) - a
        return np.exp(np.pi * hill_exponents(A, np.pi, 12))

    a = float(value(m, q))
    np.testing.assert_allclose(multipliers(a), (-1.0) ** m, atol=1e-5)  # a double root: half the digits
    beside = [np.abs(multipliers(a + d)).max() for d in (-1e-3, 1e-3)]
    stable, unstable = beside if value is mathieu_b else beside[::-1]  # tongues lie from b to a
    assert stable == pytest.approx(1.0, abs=1e-9)
    assert unstable > 1.0 + 1e-5


# ---- laws with memory


@pytest.mark.parametrize(
    ("law", "hz"),
    [(JENKINS, 50.0), (STRIBECK, 54.0), (Dahl(mu=0.5, stiffness=1e7), 50.0), (LUGRE, 54.0), (IWAN, 54.0)],
    ids=lambda value: getattr(value, "name", None),
)
def test_multipliers_are_those_of_the_time_integration(law, hz: float) -> None:
    """On the same samples; of what is left the harmonics beyond 15 are the most."""
    _, _, found, expected = judged(beam(law, alpha=6.0, modes=2), hz, 6.5, harmonics=15, samples=128)
    assert missed(found.multipliers, expected) < 2e-3
    assert found.stable == (np.abs(expected[0]) < 1.0) == (law is not STRIBECK)


def test_multipliers_converge_to_those_of_fine_steps() -> None:
    rig = beam(STRIBECK, alpha=6.0, modes=2)
    _, solution, found, _ = judged(rig, 54.0, 6.5, harmonics=15, samples=256)
    fine = integrate.steady_state(rig, 54.0, steps_per_period=2048, start=state_at_phase_zero(solution))
    assert found.largest == pytest.approx(abs(fine.multipliers[0]), abs=5e-3)
    assert found.largest > 1.1


@pytest.mark.parametrize(("law", "kept"), [(JENKINS, 1), (IWAN, 3), (Coulomb(mu=0.52), 1)], ids=lambda v: str(v)[:8])
def test_a_contact_that_sticks_keeps_its_mean_force_and_is_stable(law, kept: int) -> None:
    _, _, found, expected = judged(beam(law, alpha=6.0, modes=2), 50.0, 0.05, harmonics=5, samples=64)
    assert found.undying == kept == np.count_nonzero(np.abs(expected - 1.0) < 1e-9)
    assert found.stable and missed(found.multipliers, expected[kept:]) < 1e-9


def test_elements_beside_friction() -> None:
    elements = (MidplaneStretching(3e8), QuadraticDrag(100.0), ImpactStop(5e-5, 2e4, STOP))
    rig = replace(beam(JENKINS, alpha=6.0, modes=3), elements=elements)
    _, _, found, expected = judged(rig, 54.0, 6.5, harmonics=15, samples=128)
    assert missed(found.multipliers, expected) < 2e-3


# ---- Hill's matrix


def test_hill_agrees_where_nothing_is_remembered() -> None:
    rig = replace(beam(Frictionless(), alpha=6.0, modes=2), elements=(MidplaneStretching(3e8), QuadraticDrag(100.0)))
    solution = steady_state(rig, 54.0, harmonics=11)
    problem = HarmonicBalance(rig, solution.basis)
    expected = floquet(problem, solution.state).multipliers[:4]
    found = hill(problem, solution.state)
    assert missed(found.multipliers, expected) < 1e-5
    assert found.stable


def test_the_naive_hill_matrix_is_wrong_for_a_jenkins_element() -> None:
    """Its loop closes over a period, the disturbance does not; taken back by exp(-lambda dt) it is right."""
    rig = oscillator(Jenkins(mu=0.5, critical_slip=0.5), damping=0.02, amplitude=0.4)
    problem, solution, found, expected = judged(rig, 1.2 * HZ, 0.4, harmonics=31, samples=512)
    matrix, exponent = HillMatrix(problem, solution.state), found.exponents[0]
    right, naive = matrix.exponent(exponent), matrix.exponent(exponent, loop=0.0)
    marched = np.log(expected[np.abs(expected - found.multipliers[0]).argmin()]) / found.period
    assert abs(right - exponent) < 1e-3 * abs(exponent)
    assert abs(right - marched) < 2e-3 * abs(exponent)
    assert abs(naive - marched) > 0.1 * abs(exponent)
    assert np.exp(naive * found.period).real > np.exp(right * found.period).real + 0.04  # it overrates the motion


# ---- refusals


def test_refusals() -> None:
    slipping = replace(beam(JENKINS, modes=3), attachments=Attachments(clamp_stiffness=1e3, clamp_limit=0.1))
    problem = HarmonicBalance(slipping, FourierBasis(3, 32))
    state = problem.unpack(np.zeros(problem.size), problem.lam_at(50.0))
    with pytest.raises(ValueError, match="has a clamp that slips; must have none, or a joint"):
        floquet(problem, state)
    rigid = oscillator(Coulomb(mu=0.5), damping=0.1, amplitude=1.0)
    problem = HarmonicBalance(rigid, FourierBasis(3, 32))
    state = problem.unpack(np.zeros(problem.size), problem.lam_at(HZ))
    with pytest.raises(ValueError, match="oscillator is rigid where coulomb-lagrange sticks; must have residual_compl"):
        floquet(problem, state)
    jenkins = steady_state(beam(JENKINS, modes=2), 50.0, harmonics=3, samples=32)
    with pytest.raises(ValueError, match=r"coulomb-penalty remembers; must not; take the monodromy"):
        hill(HarmonicBalance(beam(JENKINS, modes=2), jenkins.basis), jenkins.state)
    with pytest.raises(
        ValueError, match="hill: 4 harmonics of 16 samples; must be at least 1, and fewer than a quarter"
    ):
        hill_exponents(np.zeros((16, 1, 1)), 1.0, 4)


def test_it_says_what_it_found() -> None:
    rig = beam(JENKINS, alpha=6.0, modes=2)
    solution = steady_state(rig, 50.0, level=0.05, harmonics=5, samples=64)
    found = stability_of(rig, solution)
    assert str(found).startswith("stable, largest multiplier ") and str(found).endswith("; 1 kept by what sticks")


def test_a_solution_of_another_rig_is_refused() -> None:
    rig = beam(JENKINS, modes=2)
    solution = steady_state(rig, 50.0, harmonics=3, samples=32)
    slippery = replace(rig, contact=replace(rig.contact, law=replace(JENKINS, mu=0.1)))
    with pytest.raises(ValueError, match=r"stability_of: the state misses the rig's balance by .* of the exc"):
        stability_of(slippery, solution)
    line = "stability_of: the state has 2 modes and 1 ports; must be a solution of this rig, which has 3 and 1"
    with pytest.raises(ValueError, match=line):
        stability_of(rig.with_modes(3), solution)
