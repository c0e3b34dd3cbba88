"""Fits to made-up contacts whose law is known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from contacts import SCALES, fed_back, jenkins, motions, observed, of_law

from hbm.errors import InputError
from hbm.fourier import FourierBasis
from hbm.identification.fit import LeastSquares, fit, uncertainty
from hbm.identification.identify import HELD
from hbm.identification.judgement import fitted_parameters
from hbm.identification.start import candidate
from models import LAWS, Coulomb, Dahl, Hybrid, Iwan, Jenkins, Karnopp, LuGre, SpringDamper, Stribeck
from models.friction import ForceBalance, VelocityLimited, Viscous, parameters
from models.friction.extended import DampedDahl, DistributedJenkins, WeakeningJenkins, asymmetric, beside_dashpot

TRUTHS = {
    law.name: law
    for law in (
        Coulomb(mu=0.47),
        Jenkins(mu=0.47, critical_slip=4.4e-6),
        VelocityLimited(mu=0.47, velocity_limit=8e-4),
        Karnopp(mu_static=0.55, mu=0.47, velocity_band=1.5e-3),
        SpringDamper(mu=0.47, stiffness=7e6, damping=900.0),
        ForceBalance(mu_static=0.55, mu=0.47, velocity_band=1.5e-3),
        Stribeck(mu_static=0.55, mu=0.47, stribeck_velocity=2e-3, critical_slip=4.4e-6),
        Dahl(mu=0.47, stiffness=7e6),
        LuGre(mu_static=0.55, mu=0.47, stribeck_velocity=2e-3, stiffness=7e6, bristle_damping=800.0, viscous=150.0),
        Hybrid(
            mu_static=0.55,
            mu=0.47,
            stribeck_velocity=2e-3,
            stiffness=2e7,
            stiffness_elastic_plastic=6e7,
            stiffness_plastic_presliding=5e7,
            damping_plastic=400.0,
            damping_presliding=300.0,
        ),
        Iwan(mu=0.47, stiffness=7e6, spread=0.7),
        Viscous(coefficient=3e3),
    )
}
EXTENDED = {
    law.name: law
    for law in (
        beside_dashpot(Jenkins)(mu=0.47, critical_slip=4.4e-6, coefficient=700.0),
        asymmetric(Jenkins)(mu=0.47, critical_slip=4.4e-6, ratio=1.2),
        DistributedJenkins(mu=0.47, critical_slip=4.4e-6, spread=0.7),
        WeakeningJenkins(mu_static=0.55, mu=0.47, stribeck_velocity=2e-3, stiffness=9e6),
        DampedDahl(mu=0.47, stiffness=7e6, bristle_damping=800.0),
    )
}
"""Laws that a diagnosis may lead to."""

FLOOR = 0.02
"""Noise by which noise-free records are weighed [N]."""


def test_every_law_with_parameters_is_tried_here():
    assert set(TRUTHS) == set(LAWS) - {"none"}


@pytest.mark.parametrize("name", [*sorted(TRUTHS), *EXTENDED])
def test_law_recovers_its_own_parameters(name):
    # noise-free, by the same samples: what is left is the search, judged by noise of 0.02 N. Starts are 5 % off; from
    # physical scales alone: the next test
    law = (TRUTHS | EXTENDED)[name]
    signals = motions(4, seed=1)
    made = observed([of_law(law, s) for s in signals], signals, FLOOR)
    moved = set(parameters(law)) - {"mu_static", "exponent"}
    start = replace(law, **{name: 1.05 * value for name, value in parameters(law).items() if name in moved})
    of = candidate(start, start, SCALES, ("exponent",))
    problem = LeastSquares(of, made)
    x = problem.search(of.x)
    judged = problem.judge(x)
    assert judged.chi2.sum() < 0.05
    std = np.sqrt(np.diag(uncertainty(problem.candidate, judged.jacobian)))
    assert np.all(np.abs(x - of.coordinates.of(parameters(law))) < 0.5 * std + 1e-4)


@pytest.mark.parametrize("law", [TRUTHS["coulomb-penalty"], TRUTHS["stribeck"]], ids=lambda law: law.name)
def test_law_is_found_from_physical_scales(law):
    signals = motions(5, seed=2)
    made = observed([of_law(law, s) for s in signals], signals, FLOOR)
    of = candidate(law.name, law, SCALES, ("exponent",))
    _, judged = fit(of, made)
    assert judged.chi2.sum() < 0.5
    found = of.at(judged.x)
    for name, value in parameters(law).items():
        assert getattr(found, name) == pytest.approx(value, rel=0.02)


def test_jenkins_marched_by_itself_is_recovered_within_its_deviations():
    # truth typed anew in NumPy at four times the samples; noise in force and slip; 6 seeds of 2 parameters. Half of
    # |error| / std must be below 0.67, all below 3.5
    truth = np.array([0.47, 4.4e-6])
    signals = motions(6, seed=3)
    forces = [jenkins(s, *truth) for s in signals]
    pulls, chi2 = [], []
    for seed in range(6):
        made = observed(forces, signals, FLOOR, np.random.default_rng(seed))
        made = replace(made, basis=FourierBasis(made.basis.H, 1024))
        of = candidate("coulomb-penalty", Jenkins(mu=0.4, critical_slip=3e-6), SCALES, ())
        problem, judged = fit(of, made)
        found = fitted_parameters(of.coordinates, judged.x, uncertainty(problem.candidate, judged.jacobian), SCALES)
        pulls.extend((e.value - t) / e.std for e, t in zip(found.entries, truth, strict=True))
        chi2.append(judged.chi2.sum() / made.records[0].informed / len(made.records))
    assert np.abs(pulls).max() < 3.5
    assert 0.4 < np.median(np.abs(pulls)) < 1.3
    assert np.mean(chi2) == pytest.approx(1.0, abs=0.2)


def test_chi2_that_noise_alone_makes_is_told_where_standard_deviations_are_a_floor_for_numerics():
    # 20 draws of noise of 1.2e-3 N beside a floor of 2e-4 of the force, of 5e-3 N and more
    law = TRUTHS["coulomb-penalty"]
    signals = motions(3, seed=8)
    forces, chi2, told = [of_law(law, s) for s in signals], [], []
    of = candidate(law, law, SCALES, ())
    for seed in range(20):
        problem = LeastSquares(of, observed(forces, signals, 1.2e-3, np.random.default_rng(seed)))
        chi2.append(problem.judge(of.x).chi2.sum() / sum(r.informed for r in problem.observed.records))
        told.append(problem.by_noise(of.x))
    assert np.mean(chi2) < 0.4
    assert np.mean(told) == pytest.approx(np.mean(chi2), rel=0.2)


@pytest.mark.parametrize("name", ["coulomb-penalty", "stribeck", "dahl", "sdfm"])
@pytest.mark.parametrize("gain", [0.0, 2e-8 - 1e-8j])
def test_gradient_of_the_residual(name, gain):
    # Taylor remainder: halving the step quarters it; with motion above the harmonics measured too
    law = TRUTHS[name]
    signals = motions(2, seed=4)
    made = fed_back(observed([of_law(law, s) for s in signals], signals, FLOOR), gain)
    problem = LeastSquares(candidate(law, law, SCALES, ("exponent",)), made)
    x = problem.candidate.x
    direction = np.random.default_rng(5).standard_normal(len(x))
    here, slope = problem.residuals(x), problem.slopes(x) @ direction
    remainders = [np.linalg.norm(problem.residuals(x + h * direction) - here - h * slope) for h in (4e-3, 2e-3, 1e-3)]
    rates = np.log2(np.array(remainders[:-1]) / remainders[1:])
    assert np.all(rates > 1.6)  # 2, less what corners of stick and slip between samples take


def test_parameter_that_the_records_do_not_determine_is_said_to_be_so():
    # a Jenkins contact: nothing weakens. Either the velocity is far below all slip speeds, and mu_static is open, or
    # far above them, and mu is; what acts at the speeds that occur is known
    signals = motions(5, seed=6)
    law = Jenkins(mu=0.47, critical_slip=4.4e-6)
    made = observed([of_law(law, s) for s in signals], signals, FLOOR, np.random.default_rng(7))
    of = candidate("stribeck", law, SCALES, ("exponent",))
    problem, judged = fit(of, made)
    found = fitted_parameters(of.coordinates, judged.x, uncertainty(problem.candidate, judged.jacobian), SCALES)
    assert {e.name for e in found.entries if e.undetermined} & {"mu_static", "mu", "stribeck_velocity"}
    assert "not determined" in str(found)


def test_limits_of_friction_are_not_determined_where_no_record_slips_nor_what_is_within_two_deviations_of_zero():
    # of a contact that sticks a local fit may state 0.40 +- 0.01 for a coefficient of 0.5
    of = candidate("coulomb-penalty", Jenkins(mu=0.5, critical_slip=4e-6), SCALES, ())
    covariance = np.diag([0.02, 0.7]) ** 2  # of logarithms
    slides, sticks = (
        fitted_parameters(of.coordinates, of.x, covariance, replace(SCALES, sticks_at=at)) for at in (0.0, 0.43)
    )
    assert [e.undetermined for e in slides.entries] == ["", "within 2 std of 0"]
    seen = 0.43 * SCALES.load
    assert sticks["mu"].undetermined == f"no record slips, friction is seen up to {seen:.3g} N, 0.43 times the reaction"
    assert sticks["critical_slip"].undetermined == f"no record slips, elastic slip is seen up to {seen / 9e6:.2g} m"


def test_static_coefficient_never_falls_below_the_kinetic_one():
    of = candidate("stribeck", TRUTHS["stribeck"], SCALES, ())
    low, high = of.coordinates.bounds
    rng = np.random.default_rng(8)
    for x in rng.uniform(low, np.minimum(high, 3.0), (50, len(low))):
        law = of.at(x)
        assert law.mu_static >= law.mu > 0.0


def test_covariance_is_factored_as_a_loop_that_hardly_closes_leaves_it():
    # noise enters through the inverse of what closes the loop: of a matrix that is singular to rounding too
    law, signals = TRUTHS["coulomb-penalty"], motions(1, seed=9)
    problem = LeastSquares(candidate(law, law, SCALES, ()), observed([of_law(law, signals[0])], signals, FLOOR))
    record, answer = problem.observed.records[0], problem.answers(problem.candidate.x)[0]
    size, scale = len(answer.matrix), np.diag(np.geomspace(1e-17, 1.0, len(answer.matrix)))
    for matrix in (
        answer.matrix,
        scale @ (np.eye(size) + 0.1 * np.random.default_rng(10).standard_normal((size, size))),
    ):
        law_noise = answer.slopes.by_u @ record.noise[1] + answer.slopes.by_rho @ record.noise[2]
        law_noise = np.linalg.solve(matrix, law_noise + answer.slopes.by_eta @ record.noise[3])
        deviations = (record.noise[0] - law_noise)[problem.observed.compared]
        root = problem.model.root(record, replace(answer, matrix=matrix))
        assert np.allclose(np.triu(root, 1), 0.0) and np.all(np.diag(root) != 0.0)
        left = root @ root.T - deviations @ deviations.T  # the floor squared, on the diagonal
        assert np.abs(left - left[0, 0] * np.eye(len(left))).max() < 1e-12 * np.abs(deviations @ deviations.T).max()


def test_law_too_stiff_to_be_solved_is_given_up_at_once():
    # beside a compliance that it exceeds a hundred thousand times; each iteration marches it over a period
    law, signals = Dahl(mu=0.47, stiffness=1e13), motions(1, seed=11)
    made = fed_back(observed([of_law(TRUTHS["dahl"], signals[0])], signals, FLOOR), 2e-8)
    problem = LeastSquares(candidate(law, law, SCALES, ()), made)
    (answer,) = problem.answers(problem.candidate.x)
    assert not answer.balanced and problem.model.evaluations <= 3


def test_the_exponent_of_the_stribeck_law_alone_is_held():
    own = Path(__file__).parents[2] / "examples" / "bouc_wen.py"
    law = Jenkins(mu=0.47, critical_slip=4.4e-6)
    made = [candidate(name, law, SCALES, HELD) for name in ("stribeck", f"{own}:BoucWen")]
    assert ["exponent" in of.coordinates.free for of in made] == [False, True]


def test_a_parameter_at_a_lower_bound_that_is_not_zero_has_an_effect():
    of = candidate("iwan", Iwan(mu=0.47, stiffness=7e6, spread=0.0), SCALES, ())
    beta = candidate(f"{Path(__file__).parents[2] / 'examples' / 'bouc_wen.py'}:BoucWen", of.law, SCALES, ())
    for made, name, said in (
        (of, "spread", "within 2 std of 0, no effect of it is seen"),
        (beta, "beta", "within 2 std of 0.5, which it cannot fall below"),
    ):
        x = made.coordinates.of(parameters(made.law) | {name: 0.5 * (name == "beta")})
        found = fitted_parameters(made.coordinates, x, 1e-4 * np.eye(len(x)), SCALES)
        assert found[name].undetermined == said


def test_law_without_parameters_is_refused():
    with pytest.raises(InputError, match=r"^identify: law none has no parameter to fit; take another$"):
        candidate("none", TRUTHS["dahl"], SCALES, ())


def test_unknown_law_is_refused():
    with pytest.raises(InputError, match=r'^identify: law "coulom"; must be'):
        candidate("coulom", TRUTHS["dahl"], SCALES, ())
