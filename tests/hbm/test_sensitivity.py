"""Derivatives of steady states: closed forms, homogeneity, automatic differentiation, and differences of solutions."""

import pickle
from dataclasses import replace
from functools import partial
from operator import attrgetter

import casadi as ca
import numpy as np
import pytest
from changed import changed
from rigs import HZ, CubicSpring, beam, oscillator
from scipy.optimize import brentq

from continuation import NewtonSettings, solve_at
from hbm import ResponseCurve, Sensitivities, sensitivities
from hbm.balance.padding import pad
from hbm.balance.problem import HarmonicBalance, State
from hbm.balance.solution import PeriodicSolution, describe
from hbm.fourier import FourierBasis
from hbm.response.trace import steady_state, trace_frequency
from hbm.symbolic import residual_function
from models import (
    Attachments,
    Coulomb,
    Damping,
    FrictionLaw,
    Frictionless,
    Jenkins,
    LuGre,
    PointMass,
    PointSpring,
    Resonator,
    Rig,
    Stribeck,
    Viscous,
    parameters,
)
from models.published import ASSUMED_HYBRID, ASSUMED_IWAN, ASSUMED_SDFM, ASSUMED_VLFM, PAPER_DAHL
from models.scalars import solution_numbers

JENKINS = Jenkins(0.52, 4.15e-6)
COULOMB = Coulomb(0.52)
STRIBECK = Stribeck(mu_static=0.55, mu=0.5, stribeck_velocity=2e-3, critical_slip=4e-6)


def derivative(s: Sensitivities, channel: str, key: str) -> complex:
    """Derivative of the complex amplitude of the first harmonic."""
    column = s[channel].coefficients[:, s.parameters.index(key)]
    return complex(column[1], -column[1 + len(column) // 2])


# ---- closed forms


@pytest.mark.parametrize(("law", "c"), [(Frictionless(), 0.0), (Viscous(0.4), 0.4)], ids=["none", "viscous"])
def test_linear_oscillator_matches_the_derivatives_of_its_receptance(law, c):
    alpha, F, Omega = 0.1, 0.3, 0.9
    rig = oscillator(law, damping=alpha, amplitude=F)
    s = sensitivities(rig, steady_state(rig, Omega * HZ, harmonics=1))
    X = F / (1.0 - Omega**2 + 1j * Omega * (alpha + c))
    exact = {
        "excitation.amplitude": X / F,
        "damping.mass_proportional": -1j * Omega * X**2 / F,
        "frequency_hz": 2 * np.pi * (2 * Omega - 1j * (alpha + c)) * X**2 / F,
        "contact.normal_load": 0.0,
    }
    if c:
        exact["contact.friction.coefficient"] = exact["damping.mass_proportional"]
    for key, value in exact.items():
        # the viscous law carries a relaxation time of 1e-9 samples
        assert derivative(s, "y", key) == pytest.approx(value, rel=1e-10 if not c else 1e-6, abs=1e-14), key
    assert s.units[-4:] == ("N", "N", "Hz", "1/s")
    assert s.logarithmic("y")["excitation.amplitude"] == pytest.approx(1.0, rel=1e-12)


def duffing(A, W, F, d, gamma):
    """One-term balance of a Duffing oscillator (Nayfeh & Mook 1979, ch. 4), zero where it holds."""
    return ((1.0 - W**2 + 0.75 * gamma * A**2) * A) ** 2 + (d * W * A) ** 2 - F**2


def test_duffing_oscillator_matches_the_derivatives_of_its_closed_form():
    d, F, gamma, W = 0.1, 0.5, 1.0, 1.4
    rig = oscillator(CubicSpring(gamma), damping=d, amplitude=F)
    curve = trace_frequency(rig, (0.5 * HZ, W * HZ), harmonics=1)
    s = sensitivities(rig, curve.points[-1])
    symbols = ca.SX.sym("A W F d gamma", 5)
    A = float(np.hypot(*curve["y"].coefficients[-1, 1:]))
    slopes = ca.Function("slopes", [symbols], [ca.jacobian(duffing(*ca.vertsplit(symbols)), symbols)])
    by_A, by_W, by_F, by_d, by_gamma = slopes([A, W, F, d, gamma]).full().ravel()
    a = s.solution["y"].coefficients
    X = complex(a[1], -a[2])
    exact = {
        "contact.friction.gamma": -by_gamma / by_A,
        "frequency_hz": -by_W / by_A / HZ,
        "excitation.amplitude": -by_F / by_A,
        "damping.mass_proportional": -by_d / by_A,
    }
    for key, value in exact.items():
        assert (derivative(s, "y", key) * X.conjugate()).real / A == pytest.approx(value, rel=1e-8), key


def test_a_fold_has_no_derivative():
    d, gamma, W = 0.1, 1.0, 1.6

    def slope(A):
        """Derivative of the balance to A, which vanishes at a fold."""
        stiffness = 1.0 - W**2 + 0.75 * gamma * A**2
        return stiffness**2 + 1.5 * gamma * A**2 * stiffness + (d * W) ** 2

    A = brentq(slope, 0.6, 0.9, xtol=1e-15)
    F = np.sqrt(duffing(A, W, 0.0, d, gamma))
    phase = np.arctan2(d * W, 1.0 - W**2 + 0.75 * gamma * A**2)
    Q = A * np.array([0.0, np.cos(phase), np.sin(phase)])
    rig = oscillator(CubicSpring(gamma), damping=d, amplitude=F)
    problem = HarmonicBalance(rig, FourierBasis(1, 64))
    T = -0.75 * gamma * A**2 * Q
    solution = describe(problem, *problem.pack(State(Q[:, None], T, W, F)))
    with pytest.raises(ArithmeticError, match="at a fold the solution has no derivative"):
        sensitivities(rig, solution)


# ---- homogeneity


def homogeneous(law: FrictionLaw, *, residual_compliance: bool) -> Rig:
    """The beam without what is quadratic in the motion."""
    return beam(law, foreshortening=False, residual_compliance=residual_compliance)


@pytest.mark.parametrize("residual_compliance", [True, False], ids=["C_res", "no C_res"])
@pytest.mark.parametrize("law", [JENKINS, COULOMB, STRIBECK], ids=lambda law: law.name)
@pytest.mark.parametrize("hz", [46.0, 49.0, 53.5])
def test_scaling_force_load_and_lengths_scales_the_response(law, hz, residual_compliance):
    """Euler's identity: a motion that is homogeneous in F, P, u_crit and v_s is the sum of their p dX/dp.

    Limited by the solution's own residual, 1e-10 of the excitation, amplified by the resonance.
    """
    rig = homogeneous(law, residual_compliance=residual_compliance)
    solution = steady_state(rig, hz)
    s = sensitivities(rig, solution)
    scaled = [
        key.endswith(("normal_load", "amplitude", "critical_slip", "stribeck_velocity")) for key in s.parameters
    ] * s.values
    for name, channel in s.channels.items():
        value = solution[name].coefficients
        # a contact without compliance that sticks has a slip of rounding errors
        tolerance = 1e-8 * np.abs(value).max() + 1e-15
        assert channel.coefficients @ scaled == pytest.approx(value, abs=tolerance), name
        assert channel.peak @ scaled == pytest.approx(solution[name].peak, abs=tolerance), name


# ---- automatic differentiation of the whole residual


@pytest.mark.parametrize("law", [JENKINS, COULOMB, STRIBECK], ids=lambda law: law.name)
@pytest.mark.parametrize("parameter", ["frequency", "force"])
def test_unknowns_change_as_the_symbolic_residual_says(law, parameter):
    """Dense implicit differentiation of another code for the same equations, foreshortening included."""
    rig = beam(law)
    solution = steady_state(rig, 50.0, harmonics=7, samples=128)
    s = sensitivities(rig, solution)
    problem = HarmonicBalance(rig, solution.basis, parameter=parameter, hz=50.0)
    x, lam = problem.pack(solution.state)
    function = residual_function(problem)
    symbols = ca.MX.sym("x", problem.size), ca.MX.sym("lam"), ca.MX.sym("p", len(parameters(law)))
    slopes = ca.Function("J", list(symbols), [ca.jacobian(function(*symbols), ca.vertcat(*symbols))])
    J = slopes(x, lam, list(parameters(law).values())).full()
    expected = np.linalg.solve(J[:, : len(x)], -J[:, len(x) :])
    by_lam = s.parameters.index("frequency_hz" if parameter == "frequency" else "excitation.amplitude")
    columns = [by_lam, *range(len(parameters(law)))]
    units = np.array([problem.hz_ref if parameter == "frequency" else problem.F_ref, *np.ones(len(columns) - 1)])
    Q = s.Q[:, :, columns].reshape(-1, len(columns)) / problem.q_ref
    found = np.concatenate([Q, s.T[:, columns] / problem.F_ref]) * units
    assert np.all(np.abs(found - expected).max(axis=0) < 1e-12 * np.abs(expected).max(axis=0))


# ---- differences of solutions


def resolved(rig: Rig, hz: float, near: PeriodicSolution, loan: float = 0.0) -> PeriodicSolution:
    """Solution to rounding, from a near one; with the loan of another rig to a rigid contact."""
    problem = HarmonicBalance(rig, near.basis)
    if loan:
        problem.environment = replace(problem.environment, compliance=loan)
        problem.dynamic_lagrangian = loan
    lam = problem.lam_at(hz)
    result = solve_at(problem, pad(problem, near.state), lam, NewtonSettings(tolerance=1e-13, max_iterations=8))
    assert result.residual_norm < 5e-12
    return describe(problem, result.x, lam)


CASES = [
    (JENKINS, 45.0, {}),  # sticks
    (JENKINS, 49.0, {}),  # near resonance
    (JENKINS, 53.4, {}),
    (JENKINS, 49.0, {"load_variation": 0.0}),
    (COULOMB, 49.0, {}),
    (COULOMB, 53.5, {}),
    (COULOMB, 49.0, {"residual_compliance": False}),  # dynamic Lagrangian
    (COULOMB, 57.0, {"residual_compliance": False}),
    (STRIBECK, 49.0, {}),
    (STRIBECK, 57.0, {"residual_compliance": False}),
    (Viscous(300.0), 49.0, {}),
]


@pytest.mark.parametrize(("law", "hz", "contact"), CASES, ids=lambda v: v.name if hasattr(v, "name") else str(v))
def test_channels_change_as_neighbouring_solutions_do(law: FrictionLaw, hz: float, contact: dict[str, bool]):
    """Central differences, relative to the channel's change or to its peak, whichever is larger.

    Measured 1e-9 to 6e-7. A tenfold step raises it a hundredfold: the differences are what errs. Peaks less than a
    sample from a tie of two samples bend most.
    """
    rig = beam(law, modes=6, **contact)
    solution = resolved(rig, hz, steady_state(rig, hz))
    s = sensitivities(rig, solution)
    for i, (key, value) in enumerate(zip(s.parameters, s.values, strict=True)):
        step = 1e-6 if key == "frequency_hz" else 1e-5  # the response to the frequency bends most
        up, down = (
            resolved(changed(rig, key, moved), moved if key == "frequency_hz" else hz, solution)
            for moved in (value * (1 + step), value * (1 - step))
        )
        for name, channel in s.channels.items():
            for what in ("coefficients", "samples", "peak"):
                slope = value * np.asarray(getattr(channel, what)[..., i])
                difference = (np.asarray(getattr(up[name], what)) - getattr(down[name], what)) / (2 * step)
                tolerance = 2e-6 * max(np.abs(slope).max(), solution[name].peak)
                assert slope == pytest.approx(difference, abs=tolerance), (key, name, what)


# ---- every number of the rig

ATTACHED = Attachments(
    clamp_stiffness=5e3,
    tip_stiffness=50.0,
    masses=(PointMass(0.01, 0.4),),
    springs=(PointSpring(500.0, 0.25),),
    resonators=(Resonator(0.02, 70.0, 0.3),),
)
SOFT = replace(ATTACHED, support_stiffness=1e6)
EVERY_NUMBER = [
    (JENKINS, 45.0, Attachments(), {}),  # sticks
    (JENKINS, 49.0, Attachments(), {}),  # near resonance
    (JENKINS, 47.0, SOFT, {}),
    (JENKINS, 49.0, ATTACHED, {}),
    (JENKINS, 47.0, SOFT, {"load_variation": 0.0}),
    (COULOMB, 49.0, ATTACHED, {"foreshortening": False}),
    (COULOMB, 49.0, Attachments(), {"residual_compliance": False}),  # dynamic Lagrangian
    (STRIBECK, 49.0, SOFT, {}),
]


def of_channel(name: str, what: str, solution: PeriodicSolution) -> np.ndarray:
    return np.asarray(getattr(solution[name], what))


@pytest.mark.parametrize(("law", "hz", "attachments", "contact"), EVERY_NUMBER)
def test_every_number_of_the_rig_changes_the_solution_as_its_derivative_says(law, hz, attachments, contact):
    """Central differences of solutions: what they err by falls like the square of the step, down to their rounding.

    Length and thickness move the resonance most, and with it the samples that change between stick and slip: their
    steps are shorter. Solutions are rounded to 1e-14, their differences to 1e-7 of the step, of the channel's peak.
    """
    rig = replace(beam(law, modes=6, **contact), attachments=attachments)
    solution = resolved(rig, hz, steady_state(rig, hz))
    known = solution_numbers(rig, solution.hz, solution.level)
    keys = tuple(key for key, (value, _) in known.items() if value)
    s = sensitivities(rig, solution, keys)
    rigid = rig.structure.compliance == 0.0  # the slip is a difference of what cancels: rounded a hundred times more
    loan = HarmonicBalance(rig, solution.basis).dynamic_lagrangian  # held, as the derivatives hold it
    readings = [
        (f"{what} of {name}", getattr(channel, what), solution[name].peak, partial(of_channel, name, what))
        for name, channel in s.channels.items()
        for what in ("coefficients", "samples", "peak")
    ]
    for what, slope in (("state.Q", s.own_Q), ("state.T", s.T)):
        read = attrgetter(what)
        readings.append((what, slope, np.abs(read(solution)).max(), read))
    assert s.parameters == keys and s.units == tuple(known[key][1].unit for key in keys)
    for i, (key, value) in enumerate(zip(keys, s.values, strict=True)):

        def neighbour(relative: float, key: str = key, value: float = value) -> PeriodicSolution:
            moved = value * (1.0 + relative)
            return resolved(changed(rig, key, moved), moved if key == "frequency_hz" else hz, solution, loan)

        step = 1e-7 if key in ("beam.length", "beam.thickness") else 1e-6
        step = 1e-5 if rigid and step == 1e-6 else step
        around = [(h, neighbour(h), neighbour(-h)) for h in (4 * step, step)]

        for what, slope, size, read in readings:
            exact = value * np.asarray(slope[..., i])
            coarse, fine = (np.abs((read(up) - read(down)) / (2 * h) - exact).max() for h, up, down in around)
            rounding = (1e-11 / step if rigid else 1e-6) * max(np.abs(exact).max(), size)
            assert fine < max(rounding, coarse / 12.0), (key, what)


@pytest.mark.parametrize("attachments", [ATTACHED, SOFT], ids=["attached", "soft"])
@pytest.mark.parametrize("law", [JENKINS, COULOMB, STRIBECK, PAPER_DAHL], ids=lambda law: law.name)
def test_work_of_the_force_is_lost_with_everything_attached(law, attachments):
    rig = replace(beam(law, modes=6), attachments=attachments)
    solution = steady_state(rig, 47.5)
    assert solution["slip"].peak > 5e-6  # it slips
    assert abs(solution.energy_error) < 1e-6


def test_a_key_that_is_none_of_the_rig_is_refused():
    rig = beam(JENKINS)
    solution = steady_state(rig, 49.0, harmonics=5)
    names = "contact.friction.mu, contact.friction.critical_slip, contact.normal_load, excitation.amplitude, "
    for keys, found in {
        ("attachments.clamp_stiffness",): "attachments.clamp_stiffness is not a number of the rig",
        (): "no keys",
    }.items():
        with pytest.raises(ValueError) as refused:
            sensitivities(rig, solution, keys)
        assert str(refused.value).startswith(f"sensitivities: {found}; must be some of {names}")


def test_attachments_of_no_size_change_no_solution_and_have_derivatives():
    """The neutral values of the diagnosis; one-sided differences of second order to small sizes."""
    bare = beam(JENKINS, modes=6)
    nothing = Attachments(
        tip_stiffness=0.0,
        masses=(PointMass(0.0, 0.4),),
        springs=(PointSpring(0.0, 0.25),),
        resonators=(Resonator(0.0, 70.0, 0.3),),
    )
    rig = replace(bare, attachments=nothing)
    solution = resolved(bare, 49.0, steady_state(bare, 49.0))
    same = resolved(rig, 49.0, solution)
    for name, channel in solution.channels.items():
        assert same[name].samples == pytest.approx(channel.samples, abs=1e-11 * channel.peak), name
    sizes = {"masses[0].mass": 1e-6, "springs[0].stiffness": 0.1, "tip_stiffness": 1e-4, "resonators[0].mass": 1e-6}
    s = sensitivities(rig, same, [f"attachments.{key}" for key in sizes])
    for i, (key, size) in enumerate(zip(s.parameters, sizes.values(), strict=True)):
        half, whole = (resolved(changed(rig, key, h), 49.0, same) for h in (size / 2, size))
        for name in ("drive", "slip", "normal", "a3"):
            differences = 4 * half[name].coefficients - whole[name].coefficients - 3 * same[name].coefficients
            exact = s[name].coefficients[:, i]
            assert exact == pytest.approx(differences / size, abs=1e-6 * np.abs(exact).max()), (key, name)


def test_derivatives_are_one_sided_where_a_sample_starts_to_slip():
    """Just below the force at which one sample reaches the limit everything is linear; just above, that sample is held.

    The friction's peak is then mu P whatever the force.
    """

    def at(force: float) -> Sensitivities:
        rig = oscillator(Jenkins(0.5, 1.0), damping=0.1, amplitude=force, load=2.0)
        return sensitivities(rig, steady_state(rig, 0.8 * HZ, harmonics=3))

    stuck = at(0.1)
    first_slip = 0.1 * (0.5 * 2.0) / stuck.solution["friction"].peak
    below, above = at(first_slip * (1 - 1e-9)), at(first_slip * (1 + 1e-9))
    assert below.logarithmic("friction") == pytest.approx(stuck.logarithmic("friction"), rel=1e-8)
    assert below.logarithmic("friction")["excitation.amplitude"] == pytest.approx(1.0, rel=1e-9)
    held = {"contact.friction.mu": 1.0, "contact.normal_load": 1.0}
    for key, found in above.logarithmic("friction").items():
        assert found == pytest.approx(held.get(key, 0.0), abs=1e-9), key


def test_height_of_a_resonance_follows_its_logarithmic_derivative():
    """Envelope theorem: the resonance of rigs with 2 % more and less mu is elsewhere, and its height is predicted.

    5 %: curvature over the step, and the kinks of 256 samples.
    """

    def resonance(mu: float) -> ResponseCurve:
        return trace_frequency(beam(Jenkins(mu, 4.15e-6)), (48.4, 49.8), step_hz=0.05)

    middle, up, down = (resonance(0.52 * factor) for factor in (1.0, 1.02, 0.98))
    change = np.log(up.peak["drive"].peak / down.peak["drive"].peak) / np.log(1.02 / 0.98)
    found = sensitivities(middle.rig, middle.peak).logarithmic("drive")["contact.friction.mu"]
    assert found == pytest.approx(change, rel=0.05)
    assert abs(up.peak.hz - down.peak.hz) > 0.3


def test_a_solution_of_another_rig_is_refused():
    solution = steady_state(beam(JENKINS), 49.0, harmonics=5)
    with pytest.raises(ValueError, match="must be a solution of this rig"):
        sensitivities(beam(COULOMB), solution)


def test_sensitivities_can_be_sent_to_another_process():
    s = sensitivities(beam(JENKINS), steady_state(beam(JENKINS), 49.0, harmonics=5))
    sent = pickle.loads(pickle.dumps(s))
    assert list(sent.channels) == list(s.solution.channels)
    for name, channel in s.channels.items():
        assert np.array_equal(sent[name].samples, channel.samples)


def test_a_sensor_reads_in_proportion_to_its_gain_and_moves_nothing():
    rig = beam(JENKINS)
    solution, sensor = steady_state(rig, 49.0, harmonics=5), rig.response_channels[0]
    s = sensitivities(rig, solution, (f"channels.{sensor.name}.gain",))
    read = solution[sensor.name].coefficients
    np.testing.assert_allclose(s[sensor.name].coefficients[:, 0], read / sensor.gain, rtol=1e-12, atol=0)
    assert not s.Q.any() and not s["friction"].coefficients.any()


def test_damping_that_ratios_replace_has_no_effect():
    rig = replace(beam(JENKINS), damping=Damping(modal_ratios=(0.001,)))
    s = sensitivities(rig, steady_state(rig, 49.0, harmonics=5))
    assert not s["drive"].coefficients[:, s.parameters.index("damping.mass_proportional")].any()


# ---- every law with states, or with a force that depends on itself

IMPLICIT = [
    PAPER_DAHL,
    LuGre(0.52, 0.49, 2e-3, 1e7, bristle_damping=347.0, viscous=10.0),
    replace(ASSUMED_HYBRID, mu_static=0.52, mu=0.49, stribeck_velocity=2e-3),
    replace(ASSUMED_IWAN, spread=0.8),
    ASSUMED_SDFM,
    ASSUMED_VLFM,
]


@pytest.mark.parametrize("law", IMPLICIT, ids=lambda law: law.name)
def test_law_parameters_against_solutions_beside(law: FrictionLaw) -> None:
    rig = beam(law)
    found = steady_state(rig, 51.0, harmonics=7, samples=256)
    exact = sensitivities(rig, found)["drive"].coefficients

    def drive(name: str, value: float) -> np.ndarray:
        beside = beam(replace(law, **{name: value}))
        return steady_state(beside, 51.0, harmonics=7, samples=256, start=found)["drive"].coefficients

    for i, (name, value) in enumerate(parameters(law).items()):
        step = 1e-5 * value
        differences = (drive(name, value + step) - drive(name, value - step)) / (2 * step)
        # the residual floor of the two solutions, for parameters that hardly matter
        assert exact[:, i] == pytest.approx(differences, rel=0.0, abs=1e-4 * np.abs(exact[:, i]).max())


@pytest.mark.parametrize("law", [*IMPLICIT, COULOMB, STRIBECK], ids=lambda law: law.name)
def test_what_moves_the_compliance_against_solutions_beside(law: FrictionLaw) -> None:
    """Every law is shown the series compliance, which radius and modulus change."""
    rig = beam(law)
    found = steady_state(rig, 51.0, harmonics=7, samples=256)
    s = sensitivities(rig, found, ["contact.radius", "beam.youngs_modulus"])
    for i, (key, value) in enumerate(zip(s.parameters, s.values, strict=True)):
        step = 1e-6 * value
        up, down = (
            steady_state(changed(rig, key, moved), 51.0, harmonics=7, samples=256, start=found)
            for moved in (value + step, value - step)
        )
        for name in ("drive", "slip", "friction"):
            exact = s[name].coefficients[:, i]
            differences = (up[name].coefficients - down[name].coefficients) / (2 * step)
            # the residual floor of the two solutions
            assert exact == pytest.approx(differences, rel=0.0, abs=1e-4 * np.abs(exact).max()), (key, name)
