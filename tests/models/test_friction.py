"""Each law's one-sample map against closed forms and a plain loop that shares no line with it."""

from dataclasses import fields, replace

import casadi as ca
import numpy as np
import pytest
from marching import P, cycle, history, march, one_sample, triangle

from models import LAWS, Coulomb, Frictionless, Jenkins, Stribeck, Viscous, describe, parameters
from models.friction import ContactSample, settings, with_symbols
from models.friction.elements import limits
from models.published import (
    ASSUMED_FBFM,
    ASSUMED_HYBRID,
    ASSUMED_IWAN,
    ASSUMED_KARNOPP,
    ASSUMED_SDFM,
    ASSUMED_VLFM,
    PAPER_COULOMB,
    PAPER_DAHL,
    PAPER_DECAY,
    PAPER_LUGRE,
    PAPER_PENALTY,
    PAPER_STRIBECK,
)

EXAMPLES = {
    "none": Frictionless(),
    "coulomb-lagrange": PAPER_COULOMB,
    "coulomb-penalty": PAPER_PENALTY,
    "vlfm": ASSUMED_VLFM,
    "karnopp": ASSUMED_KARNOPP,
    "sdfm": ASSUMED_SDFM,
    "fbfm": ASSUMED_FBFM,
    "stribeck": PAPER_STRIBECK,
    "decay": PAPER_DECAY,
    "dahl": PAPER_DAHL,
    "lugre": PAPER_LUGRE,
    "hybrid": ASSUMED_HYBRID,
    "iwan": ASSUMED_IWAN,
    "viscous": Viscous(coefficient=120.0),
}
SLIDING = [name for name, law in EXAMPLES.items() if type(law) in (Coulomb, Jenkins, Stribeck)]


def plain_loop(u, v, R, eta, *, k, mu):
    """Incremental elastoplastic loop; the limit is found by iterating R = rho + eta T. `mu` is a function of v."""
    T, forces, u_old = 0.0, [], 0.0
    for u_n, v_n, rho, e in zip(*np.broadcast_arrays(u, v, R, eta), strict=True):
        trial = T - k * (u_n - u_old)
        T = trial
        for _ in range(60):  # contraction with factor mu |eta| << 1
            limit = mu(v_n) * (max(rho, 0.0) + e * T)
            T = np.sign(trial) * min(abs(trial), limit)
        forces.append(T)
        u_old = u_n
    return np.array(forces)


def coefficient(law):
    """Friction coefficient against speed, typed anew."""
    if isinstance(law, Stribeck):
        return lambda v: law.mu + (law.mu_static - law.mu) * np.exp(-((abs(v) / law.stribeck_velocity) ** law.exponent))
    return lambda v: law.mu


def stiffness(law, C: float) -> float:
    """Stick stiffness in series with C, typed anew."""
    if isinstance(law, Coulomb):
        return 1.0 / C
    k_t = (law.mu_static if isinstance(law, Stribeck) else law.mu) * P / law.critical_slip
    return k_t / (1.0 + C * k_t)


# -------------------------------------------------------------------------------------- laws that stick and slide


@pytest.mark.parametrize("name", SLIDING)
@pytest.mark.parametrize("eta", [0.0, -0.018, 0.3])
@pytest.mark.parametrize("seed", [1, 2])
def test_force_is_that_of_an_incremental_loop(name: str, eta: float, seed: int) -> None:
    law = EXAMPLES[name]
    u, v, R = history(seed)
    T, _ = march(law, u, v, R=R, eta=eta)
    expected = plain_loop(u, v, R, eta, k=stiffness(law, 5e-9), mu=coefficient(law))
    assert (np.abs(expected) > 1.0).sum() > 100  # the walk does load the contact
    # rounding of k u ~ 1e3 N accumulates over 400 increments; |v| of Stribeck is smoothed at 1e-8 v_s
    np.testing.assert_allclose(T, expected, atol=1e-6)


@pytest.mark.parametrize("name", SLIDING)
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_friction_never_exceeds_its_limit_under_a_varying_reaction(name: str, seed: int) -> None:
    law = EXAMPLES[name]
    u, v, rho = history(seed)
    eta = 0.02 * np.cos(np.arange(len(u)))
    T, _ = march(law, u, v, R=rho, eta=eta)
    limit = np.array([coefficient(law)(v_n) for v_n in v]) * (rho + eta * T)  # the reaction with T in it
    assert (np.abs(T) <= limit * (1 + 1e-7) + 1e-12).all()
    assert (np.abs(T) >= limit * (1 - 1e-7)).sum() > 50  # and reaches it


@pytest.mark.parametrize("direction", [-1.0, 1.0])
@pytest.mark.parametrize("eta", [-0.3, -0.018, 0.0, 0.4])
def test_sliding_force_satisfies_the_implicit_reaction(direction: float, eta: float) -> None:
    T, _ = march(PAPER_PENALTY, direction * np.array([1e-4]), direction, eta=eta)
    assert T[0] == pytest.approx(-direction * 0.52 * (P + eta * T[0]), rel=1e-14)


def test_no_reaction_no_friction() -> None:
    assert [float(limit) for limit in limits(0.5, ContactSample(0, 0, -20.0, 0.1, 0, P, 1))] == [0.0, 0.0]
    u, v, _ = history(6)
    for name in SLIDING:
        assert not march(EXAMPLES[name], u, v, R=-1.0)[0].any()


@pytest.mark.parametrize("name", SLIDING)
@pytest.mark.parametrize("seed", [7, 8])
def test_sliding_only_ever_dissipates(name: str, seed: int) -> None:
    """The anchor moves against the force on it: -T dz >= 0 at every sample, whatever the motion and reaction."""
    u, v, R = history(seed)
    T, states = march(EXAMPLES[name], u, v, R=R)
    dissipated = -T * np.diff(states[0], prepend=0.0)
    assert dissipated.min() > -1e-15  # J; a sample dissipates 1e-5 J where it slides
    assert dissipated.sum() > 1e-3


@pytest.mark.parametrize("seed", [9, 10])
def test_jenkins_returns_no_more_work_than_it_stored(seed: int) -> None:
    u, v, R = history(seed)
    T, _ = march(PAPER_PENALTY, u, v, R=R)
    k = stiffness(PAPER_PENALTY, 5e-9)
    work = np.cumsum(-T * np.diff(u, prepend=0.0))  # force at the end of each sample, a lower bound of the work done
    assert (work - T**2 / (2 * k)).min() > -1e-15


@pytest.mark.parametrize("U", [2e-5, 6e-6])
def test_jenkins_loop_area_is_the_closed_form(U: float) -> None:
    """4 mu R (U - mu R / k_t) per cycle under a constant reaction."""
    R, k_t = 60.0, 0.52 * P / 4.15e-6
    u = triangle(U, 400)
    T, _ = march(PAPER_PENALTY, u, np.gradient(u), R=R, C=0.0)
    loop = slice(400, None)  # U, -U, U
    area = -np.trapezoid(T[loop], u[loop])
    # the trapezoid rule cuts the two corners where sliding starts: less than k_t du^2 / 4 at each
    assert area == pytest.approx(4 * 0.52 * R * (U - 0.52 * R / k_t), abs=k_t * (U / 400) ** 2 / 2)


def test_fully_stuck_jenkins_is_a_spring() -> None:
    u = triangle(2e-6, 50)
    T, _ = march(PAPER_PENALTY, u, np.gradient(u), C=0.0)
    np.testing.assert_allclose(T, -0.52 * P / 4.15e-6 * u, atol=1e-10)


def test_jenkins_loop_is_masing() -> None:
    """From a reversal the curve is the virgin one, doubled in both directions."""
    u = triangle(2e-5, 300)
    T, _ = march(PAPER_PENALTY, u, np.gradient(u))
    virgin, unloading = T[:301], T[300:901:2]  # every second sample: twice the slip of the virgin curve
    np.testing.assert_allclose(unloading, T[300] - 2 * virgin, atol=1e-10)


def test_coulomb_contact_point_does_not_move_while_it_sticks() -> None:
    """u + C T, the contact's own displacement, stays where it was wherever |T| < mu R."""
    C = 2e-8
    u, v, R = history(11)
    T, _ = march(PAPER_COULOMB, u, v, R=R, C=C)
    contact = u + C * T
    stuck = np.abs(T[1:]) < 0.52 * R[1:] * (1 - 1e-9)
    assert 20 < stuck.sum() < len(stuck) - 20
    assert np.abs(np.diff(contact)[stuck]).max() < 1e-18
    assert np.abs(np.diff(contact)[~stuck]).max() > 1e-6


def test_compliance_in_series_softens_the_element() -> None:
    u = np.array([1e-7])
    soft, _ = march(PAPER_PENALTY, u, 0.0, C=3e-8)
    assert soft[0] == pytest.approx(-1e-7 / (4.15e-6 / (0.52 * P) + 3e-8), rel=1e-13)


@pytest.mark.parametrize("law", [PAPER_STRIBECK, PAPER_DECAY])
def test_stribeck_force_falls_from_static_to_kinetic(law: Stribeck) -> None:
    slide = np.array([1e-3])
    at = {v: -march(law, slide, v)[0][0] / P for v in (1e-12, 6.101e-4, 1.0)}
    assert at[1e-12] == pytest.approx(0.477, rel=1e-7)
    assert at[6.101e-4] == pytest.approx(0.161 + (0.477 - 0.161) / np.e, rel=1e-12)
    assert at[1.0] == pytest.approx(0.161, rel=1e-12)


def test_stribeck_without_a_fall_is_the_penalty_law() -> None:
    flat = Stribeck(mu_static=0.52, mu=0.52, stribeck_velocity=1e-3, critical_slip=4.15e-6)
    u, v, R = history(12)
    np.testing.assert_allclose(march(flat, u, v, R=R)[0], march(PAPER_PENALTY, u, v, R=R)[0], rtol=1e-13)


def force_at(force: ca.SX, now: ca.SX, values: list[float]) -> ca.DM:
    return ca.Function("force", [now], [force])(values)


@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0])
def test_stribeck_has_a_finite_derivative_at_rest(exponent: float) -> None:
    function, _ = one_sample(replace(PAPER_STRIBECK, exponent=exponent))
    T, z, before, constants = 0.0, [0.0], ca.DM.zeros(5), [0.0, 1e-4]
    now = ca.SX.sym("now", 4)
    force, _ = function(T, z, before, now, constants)
    slope = ca.Function("slope", [now], [ca.jacobian(force, now[1])])
    assert float(force_at(force, now, [1e-3, 0.0, P, 0.0])) < -0.4 * P  # it slides
    assert float(slope([1e-3, 0.0, P, 0.0])) == 0.0


# -------------------------------------------------------------------------------------------------------- viscous


def maxwell(c: float, C: float, v0: float, slope: float, T0: float, t: np.ndarray) -> np.ndarray:
    """Closed form of c C T' + T = -c (v0 + slope t) from T0."""
    tau = c * C
    return -c * (v0 + slope * (t - tau)) + (T0 + c * (v0 - slope * tau)) * np.exp(-t / tau)


@pytest.mark.parametrize("dt", [1e-6, 1e-4, 1e-2])
def test_viscous_contact_is_a_maxwell_element_exact_for_linear_velocity(dt: float) -> None:
    c, C, v0, slope, T0 = 120.0, 1e-6, 0.02, 30.0, 5.0
    t = dt * np.arange(1, 41)
    T, _ = march(Viscous(c), 0.0, v0 + slope * t, C=C, dt=dt, before={"T": T0, "v": v0})
    expected = maxwell(c, C, v0, slope, T0, t)
    # 1 - exp(-x) loses eps / x of c dv where a step is a small part x of the relaxation time
    np.testing.assert_allclose(T, expected, rtol=1e-11, atol=1e-11)


def test_viscous_contact_without_compliance_is_a_dashpot() -> None:
    v = np.random.default_rng(13).standard_normal(200)
    T, _ = march(Viscous(120.0), 0.0, v, C=0.0)
    np.testing.assert_allclose(T, -120.0 * v, atol=120.0 * 1e-8)


def test_viscous_contact_that_resists_nothing() -> None:
    v = np.random.default_rng(14).standard_normal(50)
    assert not march(Viscous(0.0), 0.0, v, C=1e-8)[0].any()


def test_viscous_steady_state_converges_with_the_square_of_the_step() -> None:
    c, C, omega = 4000.0, 1e-6, 300.0
    errors = []
    for n in (64, 128, 256):
        t = 2 * np.pi / omega / n * np.arange(1, 12 * n + 1)
        T, _ = march(Viscous(c), 0.0, np.cos(omega * t), C=C, dt=t[0])
        exact = np.real(-c / (1 + 1j * omega * c * C) * np.exp(1j * omega * t))
        errors.append(np.abs(T - exact)[-n:].max())
    orders = np.diff(np.log(errors)) / np.log(0.5)
    np.testing.assert_allclose(orders, 2.0, atol=0.05)


# -------------------------------------------------------------------------------------- promises of every law


def test_every_law_has_an_example_here() -> None:
    assert {law.name for law in EXAMPLES.values()} == set(LAWS)


@pytest.mark.parametrize("name", EXAMPLES)
def test_rest_gives_no_force(name: str) -> None:
    T, _ = march(EXAMPLES[name], np.zeros(20), np.zeros(20))
    assert not T.any()


@pytest.mark.parametrize("name", EXAMPLES)
def test_force_is_odd_in_the_motion(name: str) -> None:
    u, v, R = history(15)
    forward, _ = march(EXAMPLES[name], u, v, R=R)
    backward, _ = march(EXAMPLES[name], -u, -v, R=R)
    np.testing.assert_allclose(backward, -forward, atol=1e-10)


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.parametrize("seed", range(3))
def test_work_over_a_closed_cycle_is_lost_to_friction(name: str, seed: int) -> None:
    """Excitation pays: the work against friction over a closed cycle is positive under any reaction.

    What the compliance in series stores comes back.
    """
    u, v, R, dt = cycle(seed)
    T, _ = march(EXAMPLES[name], np.tile(u, 2), np.tile(v, 2), R=np.tile(R, 2), C=2e-8, dt=dt)
    T = T[len(u) :]
    lost = -np.sum(T * v) * dt
    assert lost == 0.0 if name == "none" else lost > 1e-3 * np.abs(T).max() * np.abs(u).max()


@pytest.mark.parametrize("name", EXAMPLES)
def test_symbols_for_parameters_give_the_same_force(name: str) -> None:
    law = EXAMPLES[name]
    symbolic, p = with_symbols(law)
    before = ContactSample(2e-6, 1e-3, 75.0, -0.01, 1e-8, P, 1e-4, -20.0)
    now = ContactSample(3e-6, 2e-3, 70.0, -0.02, 1e-8, P, 1e-4, -25.0)
    z = ca.DM(np.full(law.states, 1e-6))
    force = ca.Function("force", [p], [symbolic.advance(z, before, now)[1]])
    expected = float(ca.DM(law.advance(z, before, now)[1]))
    assert float(force(list(parameters(law).values()))) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("name", LAWS)
def test_parameters_are_described_where_they_are_declared(name: str) -> None:
    described = describe(LAWS[name])
    assert [*described, *settings(LAWS[name])] == [f.name for f in fields(LAWS[name])]
    for p in described.values():
        assert p.unit
        assert p.meaning
        assert p.source
        assert p.at_least is None or p.at_least in described
