"""Friction over one period: closed forms, and derivatives against the march itself."""

import numpy as np
import pytest

from hbm.aft.force import Environment, InputChange, LawOverPeriod
from hbm.aft.joint import JointOverPeriod
from hbm.aft.projection import projected, shown
from hbm.aft.recurrence import Loop, gradients, last_dragged, radius
from hbm.aft.slopes import Slopes
from hbm.fourier import FourierBasis
from models import (
    LAWS,
    Coulomb,
    Dahl,
    ForceBalance,
    FrictionLaw,
    Frictionless,
    Hybrid,
    Iwan,
    Jenkins,
    Karnopp,
    LuGre,
    SpringDamper,
    Stribeck,
    VelocityLimited,
    Viscous,
    parameters,
)
from models.joints import Friction

P, OMEGA = 83.0, 2 * np.pi * 50.0


def signals(basis: FourierBasis, u: np.ndarray, rho: np.ndarray | None = None, eta: np.ndarray | None = None):
    out = np.zeros((basis.size, 4))
    out[:, 0], out[:, 1] = u, OMEGA * basis.derivative(u)
    out[0, 2] = P
    if rho is not None:
        out[:, 2] += rho
    if eta is not None:
        out[:, 3] = eta
    return out


def cosine(basis: FourierBasis, amplitude: float) -> np.ndarray:
    u = np.zeros(basis.size)
    u[basis.fundamental] = amplitude
    return u


def environment(law: FrictionLaw, compliance: float) -> Environment:
    return Environment(compliance, P, np.array(list(parameters(law).values()), dtype=float))


@pytest.mark.parametrize("ratio", [1.01, 1.5, 3.0, 20.0])
def test_jenkins_equivalent_stiffness_and_damping(ratio):
    """Describing function of an elastic dry-friction element (Caughey 1960; Iwan 1966)."""
    law, basis = Jenkins(0.5, 4e-6), FourierBasis(1, 16384)
    limit, u_crit = law.mu * P, law.critical_slip
    stiffness, A = limit / u_crit, ratio * u_crit
    T = LawOverPeriod(law, basis).linearize(signals(basis, cosine(basis, A)), OMEGA, environment(law, 0.0))
    theta = np.arccos(1.0 - 2.0 * u_crit / A)
    k_eq = stiffness / np.pi * (theta - 0.5 * np.sin(2.0 * theta))
    loss = 4.0 * limit * (A - u_crit)  # loop area = pi Omega c_eq A^2
    # u = A cos: T = -k_eq u - c_eq u', u' = -A Omega sin. Sampling the corners of the loop: error O(N_t^-2)
    assert T.coefficients[1] == pytest.approx(-k_eq * A, rel=1e-6, abs=1e-6 * limit)
    assert T.coefficients[2] == pytest.approx(loss / (np.pi * A), rel=1e-6)


def test_series_compliance_acts_as_a_spring_in_series():
    law, basis = Jenkins(0.5, 4e-6), FourierBasis(5, 256)
    C = 3e-8
    softer = Jenkins(0.5, 4e-6 + law.mu * P * C)
    u = signals(basis, cosine(basis, 1e-5))
    with_C, _ = LawOverPeriod(law, basis).force(u, OMEGA, environment(law, C))
    direct, _ = LawOverPeriod(softer, basis).force(u, OMEGA, environment(softer, 0.0))
    assert with_C == pytest.approx(direct, abs=1e-10)


def test_stuck_contact_is_a_spring():
    law, basis = Jenkins(0.5, 4e-6), FourierBasis(3, 64)
    u = np.random.default_rng(0).normal(size=basis.size) * 1e-7
    T, _ = LawOverPeriod(law, basis).force(signals(basis, u), OMEGA, environment(law, 0.0))
    assert T == pytest.approx(-law.mu * P / law.critical_slip * (basis.synthesis @ u), rel=1e-9, abs=1e-9)


def test_viscous_contact_without_compliance_is_a_dashpot():
    law, basis = Viscous(300.0), FourierBasis(3, 64)
    u = np.random.default_rng(1).normal(size=basis.size) * 1e-6
    s = signals(basis, u)
    force = LawOverPeriod(law, basis).linearize(s, OMEGA, environment(law, 0.0))
    assert force.coefficients == pytest.approx(-300.0 * s[:, 1], rel=1e-6, abs=1e-6)


def test_viscous_contact_with_compliance_is_a_maxwell_element():
    law, C = Viscous(300.0), 1e-6
    errors = []
    for N_t in (64, 128):
        basis = FourierBasis(1, N_t)
        s = signals(basis, cosine(basis, 1e-5))
        a = LawOverPeriod(law, basis).linearize(s, OMEGA, environment(law, C)).coefficients
        # T = -c (v + C dT/dt): amplitude -i Omega c u / (1 + i Omega c C)
        exact = -1j * OMEGA * 300.0 * 1e-5 / (1.0 + 1j * OMEGA * 300.0 * C)
        errors.append(abs(a[1] - 1j * a[2] - exact) / abs(exact))
    assert errors[0] < 1e-3
    assert errors[1] == pytest.approx(errors[0] / 4.0, rel=0.05)  # velocity linear between samples: second order


EVERY_LAW = [
    Frictionless(),
    Jenkins(0.5, 4e-6),
    Coulomb(0.5),
    VelocityLimited(mu=0.5, velocity_limit=1e-3),
    Karnopp(mu_static=0.5, mu=0.4, velocity_band=1e-3),
    SpringDamper(mu=0.5, stiffness=1e7, damping=300.0),
    ForceBalance(mu_static=0.5, mu=0.4, velocity_band=1e-3),
    Stribeck(mu_static=0.5, mu=0.3, stribeck_velocity=6e-4, critical_slip=4e-6),
    Dahl(mu=0.5, stiffness=1e7),
    LuGre(mu_static=0.5, mu=0.3, stribeck_velocity=2e-3, stiffness=1e7, bristle_damping=300.0, viscous=10.0),
    Hybrid(0.5, 0.3, 2e-3, 1.5e7, 6e7, 6e7, 300.0, 200.0),
    Iwan(mu=0.5, stiffness=1e7, spread=0.9, elements=4),
    Iwan(mu=0.5, stiffness=1e7, spread=0.9, elements=8),
    Viscous(2000.0),
]


def test_every_law_is_tested_here():
    assert {law.name for law in EVERY_LAW} == set(LAWS)


@pytest.mark.parametrize("law", EVERY_LAW, ids=lambda law: law.name)
@pytest.mark.parametrize("amplitude", [2e-5, 2e-6])
def test_loops_close(law, amplitude):
    basis = FourierBasis(5, 128)
    u = np.random.default_rng(2).normal(size=basis.size) * amplitude
    _, closure = LawOverPeriod(law, basis).force(signals(basis, u), OMEGA, environment(law, 3e-8))
    assert closure < 1e-12


@pytest.mark.parametrize("law", EVERY_LAW, ids=lambda law: law.name)
@pytest.mark.parametrize("amplitude", [2e-5, 2.5e-6, 1e-6])  # slipping; stuck after a transient; stuck from the start
def test_derivatives_have_a_second_order_taylor_remainder(law, amplitude):
    """Along a random direction the remainder falls with the square of the step, unless the force is linear there."""
    basis = FourierBasis(5, 128)
    rng = np.random.default_rng(3)
    decay = np.exp(-basis.k)
    u, rho, eta = amplitude * rng.normal(size=basis.size) * decay, 8.0 * decay, -0.02 * decay
    contact = LawOverPeriod(law, basis)
    base = contact.linearize(signals(basis, u, rho, eta), OMEGA, environment(law, 3e-8))
    du, drho, deta = (rng.normal(size=basis.size) * decay * scale for scale in (amplitude, 8.0, 0.02))
    slope = sum(
        block @ d for block, d in ((base.by_u, du), (base.by_rho, drho), (base.by_eta, deta)) if block is not None
    )

    def remainder(h: float) -> float:
        s = signals(basis, u + h * du, rho + h * drho, eta + h * deta)
        T, _ = contact.force(s, OMEGA, environment(law, 3e-8))
        return float(np.abs(basis.analysis @ T - base.coefficients - h * slope).max())

    scale = float(np.abs(slope).max())
    # steps too small for any sample to change between stick and slip
    coarse, fine = remainder(1e-6), remainder(1e-7)
    assert coarse < 1e-8 * max(scale, 1.0)
    assert fine < max(coarse / 30.0, 1e-10 * max(scale, 1.0))


@pytest.mark.parametrize(
    "law", [Jenkins(0.5, 4e-6), Stribeck(0.6, 0.4, 1e-3, critical_slip=4e-6)], ids=lambda law: law.name
)
@pytest.mark.parametrize("amplitude", [2e-5, 2.5e-6, 1e-6])  # slipping; stuck after a transient; stuck from the start
@pytest.mark.parametrize("N_t", [128, 19])  # many samples; fewer than products of two series ask for
def test_an_anchor_is_not_marched(law, amplitude, N_t):
    """Slopes put together from where the anchor was dragged are those of the march back over all samples."""
    basis = FourierBasis(5, N_t)
    u = amplitude * np.random.default_rng(3).normal(size=basis.size) * np.exp(-basis.k)
    contact = LawOverPeriod(law, basis)
    contact.force(signals(basis, u), OMEGA, environment(law, 3e-8))
    slopes = contact._local.copy()
    inputs = shown(basis)[:2] + shown(basis)[:1] * (slopes.by_inputs.shape[2] - 2)
    found = projected(slopes, basis, inputs, contact._first_period)
    marched = gradients(slopes, basis.analysis, contact._first_period)
    for by, by_samples, shown_input in zip(found, marched, inputs, strict=True):
        expected = by_samples @ shown_input.samples
        assert by == pytest.approx(expected, rel=1e-12, abs=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("amplitude", "least", "most"), [(3e-6, 0, 0), (1e-5, 1, 9), (1e-4, 10, 10)], ids=["stuck", "some slip", "all slip"]
)
def test_anchors_side_by_side_are_not_marched(amplitude, least, most):
    """Ten elements under a constant load and without compliance, of which none, some or all slip."""
    basis, law = FourierBasis(5, 128), Iwan(0.4, 0.4 * P / 3e-5)
    u = amplitude * np.random.default_rng(5).normal(size=basis.size) * np.exp(-basis.k)
    joint = JointOverPeriod(Friction(law, P), basis)
    shown_to_it = np.zeros((basis.size, 3))
    shown_to_it[:, 0] = shown_to_it[:, 1] = u
    joint.forces(shown_to_it, OMEGA)
    slopes = joint._local.copy()
    assert joint.functions.memory == law.states
    dragged = last_dragged(slopes)
    assert dragged is not None
    assert least <= (dragged[-1] >= 0).sum() <= most
    inputs = [shown(basis)[0] for _ in joint.functions.reads]
    found = projected(slopes, basis, inputs, joint._first_period)
    marched = gradients(slopes, basis.analysis, joint._first_period)
    for by, by_samples in zip(found, marched, strict=True):
        expected = by_samples @ basis.synthesis
        assert by == pytest.approx(expected, rel=1e-11, abs=1e-11 * np.abs(expected).max())
    change = np.random.default_rng(6).normal(size=(basis.N_t, len(inputs), 2))
    by_change = np.einsum("imt,itc->mc", np.stack([by[0] for by in marched]), change.transpose(1, 0, 2))
    along = basis.analysis @ Loop(slopes, joint._first_period).changed(change)[:, 0]
    assert along == pytest.approx(by_change, rel=1e-10, abs=1e-10 * np.abs(by_change).max())


@pytest.mark.parametrize("compliance", [0.0, 3e-8])
def test_slopes_of_elements_side_by_side_are_as_many_as_the_elements(compliance):
    """None is told of the others, but through their force: twice as many take twice the memory and time."""
    basis = FourierBasis(3, 32)
    few, many = (
        JointOverPeriod(Friction(Iwan(0.4, 1e6, elements=n), P), basis, compliance).functions.period.numel_out(2)
        for n in (20, 40)
    )
    assert many < 2 * few


def test_states_that_fade_side_by_side_follow_their_recurrence():
    """Three states with slopes of their own, against the periodic solution of their transitions written out."""
    rng, N_t, n = np.random.default_rng(7), 12, 3
    slopes = Slopes(
        rng.normal(size=(N_t, 2, n)),
        rng.normal(size=(N_t, 2, 1)),
        rng.uniform(0.5, 0.99, (N_t, n)),
        rng.normal(size=(N_t, n, 1)),
    )
    outputs = slopes.outputs_by_inputs[:, :, 0][:, :, None] * np.eye(N_t)[:, None]
    for i in range(n):
        chain = np.eye(N_t) - np.diag(slopes.states_by_states[1:, i], -1)
        chain[0, -1] -= slopes.states_by_states[0, i]
        z = np.linalg.solve(chain, np.diag(slopes.states_by_inputs[:, i, 0]))
        outputs += slopes.outputs_by_states[:, :, i, None] * np.roll(z, 1, axis=0)[:, None]
    found = Loop(slopes, slopes.copy).changed(np.eye(N_t)[:, None])
    assert found == pytest.approx(outputs, rel=1e-12, abs=1e-12)
    assert gradients(slopes, np.eye(N_t), slopes.copy)[0].swapaxes(0, 1) == pytest.approx(outputs, rel=1e-12, abs=1e-12)
    assert radius(slopes.transitions) == pytest.approx(np.prod(slopes.states_by_states, axis=0).max())


@pytest.mark.parametrize("N_t", [64, 200], ids=["whole stretches", "one that is filled up"])
def test_states_that_act_on_one_another_are_followed_in_stretches_as_sample_by_sample(N_t):
    """Seven states that fade, and six beside one that never does: as a loop that is asked often and one that is not."""
    rng, n = np.random.default_rng(8), 7
    fading = rng.normal(size=(N_t, n, n))
    fading *= 0.9 / np.linalg.norm(fading, 2, axis=(1, 2))[:, None, None]
    lasting = fading.copy()
    lasting[:, 0] = lasting[:, :, 0] = 0.0
    lasting[:, 0, 0] = 1.0
    for A in (fading, lasting):
        slopes = Slopes(rng.normal(size=(N_t, 2, n)), rng.normal(size=(N_t, 2, 3)), A, rng.normal(size=(N_t, n, 3)))
        inputs = rng.normal(size=(N_t, 3, 2))
        seldom, often = (Loop(slopes, slopes.copy, often).changed(inputs) for often in (False, True))
        assert often == pytest.approx(seldom, rel=1e-11, abs=1e-11 * np.abs(seldom).max())


@pytest.mark.parametrize("law", EVERY_LAW, ids=lambda law: law.name)
def test_a_stuck_contact_is_linearized_twice_alike(law):
    """What a stuck contact remembers of its first period is looked up aside: the steady period stays."""
    basis = FourierBasis(5, 128)
    shown_to_it = signals(basis, 2.5e-6 * np.random.default_rng(3).normal(size=basis.size) * np.exp(-basis.k))
    contact = LawOverPeriod(law, basis)
    first, second = (contact.linearize(shown_to_it, OMEGA, environment(law, 3e-8)) for _ in range(2))
    assert np.array_equal(first.T, second.T)
    assert first.by_u is None or np.array_equal(first.by_u, second.by_u)


@pytest.mark.parametrize("law", EVERY_LAW, ids=lambda law: law.name)
def test_parameter_derivatives(law):
    basis = FourierBasis(5, 128)
    u = 2e-5 * np.random.default_rng(4).normal(size=basis.size) * np.exp(-basis.k)
    contact, s, env = LawOverPeriod(law, basis), signals(basis, u), environment(law, 3e-8)
    p = len(env.parameters)
    change = InputChange(np.zeros((basis.size, 3, p)), np.zeros(p), np.eye(p + 1, p))
    slopes = basis.analysis @ contact.along(s, OMEGA, env, change)
    for i, value in enumerate(env.parameters):
        step = 1e-6 * value * np.eye(len(env.parameters))[i]
        up, down = (
            basis.analysis @ contact.force(s, OMEGA, Environment(3e-8, P, env.parameters + h))[0] for h in (step, -step)
        )
        assert slopes[:, i] == pytest.approx((up - down) / (2 * step[i]), rel=1e-5, abs=1e-6 * np.abs(slopes).max())


def test_force_stays_within_the_varying_limit():
    law, basis = Jenkins(0.5, 4e-6), FourierBasis(7, 256)
    rng = np.random.default_rng(5)
    rho = 25.0 * rng.normal(size=basis.size) * np.exp(-basis.k)
    s = signals(basis, 2e-5 * rng.normal(size=basis.size), rho, np.full(basis.size, 0.01) * np.exp(-basis.k))
    T, _ = LawOverPeriod(law, basis).force(s, OMEGA, environment(law, 0.0))
    R = basis.synthesis @ s[:, 2] + (basis.synthesis @ s[:, 3]) * T
    assert np.all(np.abs(T) <= law.mu * np.maximum(R, 0.0) + 1e-9)
    assert np.count_nonzero(np.isclose(np.abs(T), law.mu * R)) > 50  # it does slip


def test_lost_contact_leaves_no_friction():
    law, basis = Jenkins(0.5, 4e-6), FourierBasis(1, 64)
    rho = np.array([0.0, 2.0 * P, 0.0])  # the reaction would turn negative for a third of the period
    s = signals(basis, cosine(basis, 1e-5), rho)
    T, _ = LawOverPeriod(law, basis).force(s, OMEGA, environment(law, 0.0))
    lifted = basis.synthesis @ s[:, 2] < 0.0
    assert 10 < np.count_nonzero(lifted) < 32
    assert np.all(T[lifted] == 0.0)
    assert np.abs(T[~lifted]).max() > 10.0
