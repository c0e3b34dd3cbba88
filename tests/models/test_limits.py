"""What the laws become where a parameter is zero, equal or without bound; and where the work of the hybrid law goes."""

from dataclasses import replace

import numpy as np
import pytest
from marching import P, cycle, history, march, triangle
from scipy.integrate import solve_ivp

from models import (
    Coulomb,
    Dahl,
    ForceBalance,
    FrictionLaw,
    Hybrid,
    Iwan,
    Jenkins,
    Karnopp,
    LuGre,
    SpringDamper,
    VelocityLimited,
)
from models.published import ASSUMED_HYBRID

MU, STIFFNESS = 0.52, 1.04e7
JENKINS = Jenkins(mu=MU, critical_slip=MU * P / STIFFNESS)
COULOMB = Coulomb(mu=MU)


def same_force(law: FrictionLaw, other: FrictionLaw, tolerance: float, C: float = 5e-9) -> None:
    """Along two random walks under a reaction that depends on T."""
    for seed in (1, 2):
        u, v, R = history(seed)
        ours, theirs = (march(one, u, v, R=R, eta=0.05, C=C)[0] for one in (law, other))
        assert np.abs(theirs).max() > 20.0
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance)


def distance(law: FrictionLaw, other: FrictionLaw, *, n: int = 1024, C: float = 2e-8) -> float:
    """Root mean square difference of the forces over the second cycle of a smooth motion [N]."""
    u, v, R, dt = cycle(0, n=n)
    u, v, R = (np.tile(x, 2) for x in (u, v, R))
    ours, theirs = (march(one, u, v, R=R, C=C, dt=dt)[0][n:] for one in (law, other))
    return float(np.sqrt(np.mean((ours - theirs) ** 2)))


# ------------------------------------------------------------------------------------------------- identities


def test_lugre_without_damping_and_weakening_is_dahl() -> None:
    bare = LuGre(mu_static=MU, mu=MU, stribeck_velocity=1e-3, stiffness=STIFFNESS, bristle_damping=0.0, viscous=0.0)
    same_force(bare, Dahl(mu=MU, stiffness=STIFFNESS), 1e-10)
    same_force(bare, Dahl(mu=MU, stiffness=STIFFNESS), 1e-10, C=0.0)


def test_spring_and_damper_without_damper_is_the_penalty_law() -> None:
    # the deflection relaxes at 1e9 times a sample's rate where there is no damper
    same_force(SpringDamper(mu=MU, stiffness=STIFFNESS, damping=0.0), JENKINS, 1e-6)
    same_force(SpringDamper(mu=MU, stiffness=STIFFNESS, damping=0.0), JENKINS, 1e-6, C=0.0)


@pytest.mark.parametrize("banded", [Karnopp, ForceBalance], ids=lambda law: law.name)
@pytest.mark.parametrize("band", [1e-2, 1e-6])
def test_banded_laws_with_one_coefficient_are_coulomb(banded: type, band: float) -> None:
    same_force(banded(mu_static=MU, mu=MU, velocity_band=band), COULOMB, 1e-10)


def test_forces_in_balance_hold_a_massless_contact_as_the_band_does() -> None:
    parameters = {"mu_static": MU, "mu": 0.4, "velocity_band": 1e-2}
    same_force(ForceBalance(**parameters), Karnopp(**parameters), 1e-12)


@pytest.mark.parametrize(
    "law",
    [
        Iwan(mu=MU, stiffness=STIFFNESS, spread=0.7, elements=1),
        Iwan(mu=MU, stiffness=STIFFNESS, spread=0.0, elements=7),
        Iwan(mu=MU, stiffness=STIFFNESS, limits=(3.0, 3.0)),
    ],
    ids=["one element", "no spread", "two equal limits"],
)
@pytest.mark.parametrize("C", [0.0, 5e-9])
def test_iwan_of_equal_elements_is_the_penalty_law(law: Iwan, C: float) -> None:
    same_force(law, JENKINS, 1e-8, C=C)


# ----------------------------------------------------------------------------------------- approach to Coulomb


@pytest.mark.parametrize(
    "family",
    [
        lambda h: Dahl(mu=MU, stiffness=1e9 / h),
        lambda h: VelocityLimited(mu=MU, velocity_limit=1e-4 * h),
        lambda h: Karnopp(mu_static=MU + 0.05 * h, mu=MU, velocity_band=1e-3),
        lambda h: Jenkins(mu=MU, critical_slip=5e-8 * h),
        lambda h: SpringDamper(mu=MU, stiffness=1e9 / h, damping=100.0),
    ],
    ids=["dahl", "vlfm", "karnopp", "penalty", "sdfm"],
)
def test_regularised_laws_tend_to_coulomb_in_proportion(family) -> None:
    away = np.array([distance(family(h), COULOMB) for h in (1.0, 0.5, 0.25)])
    assert away[0] < 3.0  # of some 40 N
    np.testing.assert_allclose(away[:-1] / away[1:], 2.0, rtol=0.25)


# -------------------------------------------------------------------------------------------------------- Iwan


def test_iwan_loop_is_masing() -> None:
    """Unloading and reloading follow the virgin curve, doubled in both directions."""
    law = Iwan(mu=MU, stiffness=STIFFNESS, spread=1.0, elements=8)
    u = triangle(1.2e-5, 300)
    T, _ = march(law, u, np.gradient(u), C=0.0)
    virgin = T[:301]
    np.testing.assert_allclose(T[300:901:2], T[300] - 2 * virgin, atol=1e-10)
    np.testing.assert_allclose(T[900:1501:2], T[900] + 2 * virgin, atol=1e-10)


@pytest.mark.parametrize("spread", [1.0, 0.4])
def test_iwan_virgin_curve_tends_to_that_of_a_uniform_distribution(spread: float) -> None:
    """With x = K u / mu R a parabola from x = 1 - s, where the weakest slip, to x = 1 + s, where all do."""
    x = np.linspace(0.0, 2.2, 441)
    low, high = 1.0 - spread, 1.0 + spread
    slipping = np.clip(x, low, high)
    exact = ((slipping**2 - low**2) / 2 + slipping * (high - slipping)) / (2 * spread)
    exact = np.where(x < low, x, exact)
    R, errors = 60.0, []
    for n in (5, 10, 20):
        law = Iwan(mu=MU, stiffness=STIFFNESS, spread=spread, elements=n)
        T, _ = march(law, x * MU * R / STIFFNESS, 0.0, R=R, C=0.0)
        errors.append(np.abs(-T / (MU * R) - exact).max())
    assert errors[0] < 0.0101
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.1)  # midpoint rule


@pytest.mark.parametrize("U", [2.5e-6, 6e-6, 2e-5])
def test_iwan_loop_area_is_the_sum_of_its_elements(U: float) -> None:
    law, R = Iwan(mu=MU, stiffness=STIFFNESS, limits=(1.0, 2.0, 5.0)), 60.0
    limit, k = MU * R * np.array([1.0, 2.0, 5.0]) / 8.0, STIFFNESS / 3
    u = triangle(U, 2000)
    T, _ = march(law, u, np.gradient(u), R=R, C=0.0)
    area = -np.trapezoid(T[2000:], u[2000:])
    expected = np.sum(4 * limit * np.maximum(U - limit / k, 0.0))
    assert area == pytest.approx(expected, abs=STIFFNESS * (U / 2000) ** 2)  # corners between samples


# ------------------------------------------------------------------------------------------------------ hybrid


def rigid_chain(k: float, damping_presliding: float, mu_static: float = 0.4) -> Hybrid:
    """All of the chain's yielding in k_e, or nearly."""
    return Hybrid(
        mu_static=mu_static,
        mu=0.3,
        stribeck_velocity=2e-3,
        stiffness=STIFFNESS,
        stiffness_elastic_plastic=k,
        stiffness_plastic_presliding=k,
        damping_plastic=0.0,
        damping_presliding=damping_presliding,
    )


@pytest.mark.parametrize("C", [0.0, 2e-8])
@pytest.mark.parametrize("mu_static", [0.4, 0.3])
def test_hybrid_with_a_rigid_chain_is_lugre_without_damping_or_dahl(C: float, mu_static: float) -> None:
    """In a chain of very different stiffnesses the law's step is of first order: the samples must resolve it."""
    lugre = LuGre(mu_static, 0.3, 2e-3, STIFFNESS, bristle_damping=0.0, viscous=0.0)
    other = lugre if mu_static > 0.3 else Dahl(mu=0.3, stiffness=STIFFNESS)
    by_stiffness = [distance(rigid_chain(k, 0.0, mu_static), other, n=1024, C=C) for k in (1e8, 1e9, 1e12)]
    assert by_stiffness[0] > 3 * by_stiffness[1]
    assert by_stiffness[1] > by_stiffness[2]
    by_samples = [distance(rigid_chain(1e12, 0.0, mu_static), other, n=n, C=C) for n in (512, 1024)]
    assert by_samples[0] < 1.0  # of some 30 N
    assert by_samples[0] / by_samples[1] > 1.8


def test_hybrid_with_a_rigid_chain_and_presliding_damping_has_one_state() -> None:
    """dz/dt = (v - |v| k_e z / g) / (1 + c_s |v| / g), resisting force k_e z + c_s dz/dt."""
    law, c_s, omega, A = rigid_chain(1e13, 2000.0), 2000.0, 300.0, 1.5e-5

    def motion(t):
        return A * np.sin(omega * t), A * omega * np.cos(omega * t), P * (1.0 + 0.4 * np.sin(2 * omega * t + 0.3))

    def rate(t, z):
        _, v, R = motion(t)
        g = R * (0.3 + 0.1 * np.exp(-((v / 2e-3) ** 2)))
        return (v - abs(v) * STIFFNESS * z / g) / (1.0 + c_s * abs(v) / g)

    errors = []
    for n in (512, 1024, 2048):
        t = 2 * np.pi / omega * np.arange(n + 1) / n
        z = solve_ivp(rate, (0.0, t[-1]), [0.0], t_eval=t, method="LSODA", rtol=1e-9, atol=1e-15).y[0]
        expected = -(STIFFNESS * z + c_s * rate(t, z))
        u, v, R = motion(t)
        before = {"u": u[0], "v": v[0], "rho": R[0]}
        T, _ = march(law, u[1:], v[1:], R=R[1:], C=0.0, dt=t[1], before=before)
        errors.append(np.sqrt(np.mean((T - expected[1:]) ** 2)))
    assert errors[0] < 0.15
    assert errors[0] / errors[2] > 3.5


def random_hybrid(seed: int) -> Hybrid:
    rng = np.random.default_rng(seed)
    stiff = 10 ** rng.uniform(6, 8, 3)
    mu = rng.uniform(0.1, 0.5)
    return Hybrid(mu * rng.uniform(1.0, 3.0), mu, 10 ** rng.uniform(-4, -2), *stiff, *10 ** rng.uniform(1, 4, 2))


@pytest.mark.parametrize("seed", range(12))
def test_hybrid_never_gives_energy(seed: int) -> None:
    """Over any closed cycle, under any reaction, work done on the contact itself is lost."""
    law = random_hybrid(seed)
    u, v, R, dt = cycle(seed, n=1024, scale=10 ** np.random.default_rng(seed + 100).uniform(-6, -4.5))
    T, states = march(law, *(np.tile(x, 6) for x in (u, v)), R=np.tile(R, 6), C=0.0, dt=dt)
    np.testing.assert_allclose(states[:, -1], states[:, -1025], atol=1e-3 * np.abs(states).max())  # a closed cycle
    assert -np.sum(T[-1024:] * v) * dt > 0.0


@pytest.mark.parametrize("seed", range(4))
def test_work_on_the_hybrid_contact_is_stored_or_dissipated(seed: int) -> None:
    """v T_r = d/dt stored + c_p z_p'^2 + c_s z_s'^2 + c_z (v - z_s')^2: nothing dissipated is negative."""
    law = random_hybrid(seed)
    k_p = 1.0 / (1.0 / law.stiffness + 1.0 / law.stiffness_elastic_plastic)
    k_ps, c_p, c_s = law.stiffness_plastic_presliding, law.damping_plastic, law.damping_presliding
    omega, A = 300.0, 1.5e-5

    def powers(t, p, s):
        v = A * omega * (np.cos(omega * t) + 0.6 * np.cos(2 * omega * t + 1.0))
        R = P * (1.0 + 0.6 * np.sin(omega * t + 0.3))
        g = R * (law.mu + (law.mu_static - law.mu) * np.exp(-((v / law.stribeck_velocity) ** 2)))
        s_rate = (v * g - abs(v) * k_ps * (s - p)) / (g + c_s * abs(v))
        p_rate = -(k_p * p + k_ps * (p - s)) / c_p
        f_e = law.stiffness * (p * law.stiffness_elastic_plastic / (law.stiffness + law.stiffness_elastic_plastic))
        resisting = f_e + c_p * p_rate + c_s * s_rate  # as docs/theory/equations.md adds it up
        lost = c_p * p_rate**2, c_s * s_rate**2, resisting**2 * abs(v) / g  # c_z (v - z_s') is the resisting force
        return p_rate, s_rate, resisting * v, *lost

    def rate(t, y):
        return powers(t, y[0], y[1])

    end = 2 * np.pi / omega
    y = solve_ivp(rate, (0.0, end), np.zeros(6), method="Radau", rtol=1e-9, atol=1e-14, max_step=end / 500).y
    p, s, work = y[:3]
    stored = k_p * p**2 / 2 + k_ps * (s - p) ** 2 / 2
    np.testing.assert_allclose(work, stored + y[3:].sum(axis=0), atol=1e-6 * np.abs(work).max())
    assert (np.diff(y[3:], axis=1) >= -1e-15).all()
    assert work[-1] > 0.0


@pytest.mark.parametrize(("sign", "passive"), [(1.0, True), (-1.0, False)], ids=["z_s - z_p", "printed: z_p - z_s"])
def test_printed_sign_of_the_third_balance_lets_the_contact_run_away(sign: float, passive: bool) -> None:
    """Steady sliding at v: with sign (z_s - z_p) the force settles at g; as printed the spring drives what it holds.

    The deflection d = z_s - z_p then obeys d' = a + b d with b > 0, and the force passes every limit.
    """
    law, v = replace(ASSUMED_HYBRID, damping_plastic=1e9), 1e-3  # the plastic node stands still
    k, c_s = law.stiffness_plastic_presliding, law.damping_presliding
    g = P * (law.mu + (law.mu_static - law.mu) * np.exp(-((v / law.stribeck_velocity) ** 2)))
    growth = -sign * k * v / (g + c_s * v)

    def rate(t, d):  # sign k d + c_s d' + c_z (d' - v) = 0
        return (g - sign * k * d) / (c_s + g / v)

    end = 20.0 / abs(growth)
    d = solve_ivp(rate, (0.0, end), [0.0], method="LSODA", rtol=1e-9, atol=1e-16, t_eval=[end / 2, end]).y[0]
    resisting = k * d + c_s * np.array([rate(0.0, x) for x in d])
    if passive:
        assert resisting[-1] == pytest.approx(g, rel=1e-6)
        T, _ = march(law, v * np.linspace(0, end, 400)[1:], v, C=0.0, dt=end / 399, before={"v": v})
        assert -T[-1] == pytest.approx(g, rel=1e-3)
    else:
        assert np.log(d[1] / d[0]) == pytest.approx(growth * end / 2, rel=1e-3)
        assert resisting[-1] > 1e8 * g
