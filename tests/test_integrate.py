"""Time integration against closed forms, scipy.solve_ivp and an independent simulator."""

import csv
import json
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hbm.integration import stepfunction
from hbm.integration.history import State, TimeHistory
from hbm.integration.integrate import simulate, steady_state
from hbm.integration.stepfunction import lineariser, marcher
from hbm.integration.timestep import Stepper
from hbm.response import trace as response
from models import (
    LAWS,
    Beam,
    Channel,
    Contact,
    ContactSample,
    Coulomb,
    Dahl,
    Damping,
    Excitation,
    ForceBalance,
    FrictionLaw,
    Frictionless,
    Hybrid,
    Iwan,
    Jenkins,
    Karnopp,
    LuGre,
    ModalBody,
    Rig,
    SpringDamper,
    Stribeck,
    VelocityLimited,
    Viscous,
)
from models.published import paper_rig

EXAMPLES = Path(__file__).resolve().parents[2] / "shared" / "data" / "examples"

JENKINS = Jenkins(mu=0.52, critical_slip=4.15e-6)
COULOMB = Coulomb(mu=0.52)
STRIBECK = Stribeck(mu_static=0.5, mu=0.3, stribeck_velocity=5e-3, critical_slip=4e-6)
VISCOUS = Viscous(coefficient=50.0)
DAHL = Dahl(mu=0.5, stiffness=1e7)
LUGRE = LuGre(0.52, 0.49, 5e-3, 1e7, bristle_damping=300.0, viscous=0.0)
HYBRID = Hybrid(0.52, 0.49, 5e-3, 1.5e7, 6e7, 6e7, damping_plastic=300.0, damping_presliding=300.0)
EVERY_LAW = [
    Frictionless(),
    COULOMB,
    JENKINS,
    STRIBECK,
    VISCOUS,
    Viscous(coefficient=5000.0),
    VelocityLimited(mu=0.52, velocity_limit=1e-3),
    Karnopp(mu_static=0.495, mu=0.49, velocity_band=1e-3),  # with larger jumps steps are not solved
    SpringDamper(mu=0.52, stiffness=1e7, damping=300.0),
    ForceBalance(mu_static=0.52, mu=0.49, velocity_band=1e-5),
    DAHL,
    LUGRE,
    HYBRID,
    Iwan(mu=0.52, stiffness=1e7, elements=5),
]


def label(law: FrictionLaw) -> str:
    return law.name


def beam_rig(law: FrictionLaw, modes: int = 5, alpha: float = 20.0, force: float = 6.5, **contact: bool) -> Rig:
    return Rig(
        name="Table 1, damped",
        body=Beam(0.606, 0.03888, 0.00478, 210e9, 7800.0, modes),
        damping=Damping(mass_proportional=alpha),
        contact=Contact(83.0, law, radius=0.005, **contact),
        excitation=Excitation(force, 0.555),
        channels=(
            Channel("force", "force", 0.555),
            Channel("a1", "acceleration", 0.1),
            Channel("v1", "velocity", 0.1),
            Channel("y1", "displacement", 0.1),
        ),
    )


def modal_rig(law: FrictionLaw, modes: int = 3, alpha: float = 20.0, force: float = 12.0) -> Rig:
    return Rig(
        name="three modes, no compliance",
        body=ModalBody(
            frequencies_hz=(40.0, 130.0, 260.0)[:modes],
            shapes=((0.9, -0.7, 0.4)[:modes],),
            contact_shape=(0.5, 0.6, 0.3)[:modes],
            excitation_shape=(1.0, -0.5, 0.7)[:modes],
        ),
        damping=Damping(mass_proportional=alpha),
        contact=Contact(20.0, law),
        excitation=Excitation(force),
        channels=(Channel("a", "displacement"),),
    )


RIGID_BEAM = beam_rig(COULOMB, residual_compliance=False)  # foreshortening, reaction and the dissipative scheme


def test_every_law_of_the_catalogue_is_tested() -> None:
    assert {law.name for law in EVERY_LAW} == set(LAWS)


# --- exact: the linear structure


@pytest.mark.parametrize("steps", [16, 64])
def test_frictionless_steady_state_is_the_modal_sum_at_any_step(steps: int) -> None:
    rig = beam_rig(Frictionless(), alpha=0.6)
    s, hz = rig.structure, 52.0
    W = 2 * np.pi * hz
    Y = 6.5 * s.excitation / (s.omega_n**2 - W**2 + 1j * W * s.damping)  # q = Re(Y e^{i W t})
    history = steady_state(rig, hz, steps_per_period=steps).history
    drive = s.excitation @ Y + s.residual.drive_by_force * 6.5
    a1 = -(W**2) * (s.channel_rows["a1"] @ Y + s.residual.channels["a1"][0] * 6.5)
    for channel, a in {"drive": drive, "a1": a1}.items():
        _, cos, sin = history.coefficients(channel, 1)
        assert abs(cos - 1j * sin - a) < 1e-10 * abs(a)


def test_frictionless_start_from_rest_is_the_closed_form_at_any_step() -> None:
    rig = beam_rig(Frictionless(), modes=3, alpha=2.0)
    s, hz = rig.structure, 60.0
    W = 2 * np.pi * hz
    history = simulate(rig, hz, steps_per_period=20, duration=0.237)
    t = history.time[:, None]
    Y = 6.5 * s.excitation / (s.omega_n**2 - W**2 + 1j * W * s.damping)
    decay, w = s.damping / 2, np.sqrt(s.omega_n**2 - (s.damping / 2) ** 2)
    # q(0) = q'(0) = 0: q = Re(Y e^{iWt}) + e^{-d t} (A cos w t + B sin w t)
    A = -Y.real
    B = (decay * A - (1j * W * Y).real) / w
    q = (Y * np.exp(1j * W * t)).real + np.exp(-decay * t) * (A * np.cos(w * t) + B * np.sin(w * t))
    assert len(t) == 1 + round(0.237 * hz * 20)
    np.testing.assert_allclose(history.q, q, rtol=0, atol=1e-11 * np.abs(q).max())


def test_modes_far_faster_than_the_step_stay_exact() -> None:
    rig, W = beam_rig(Frictionless(), modes=20), 2 * np.pi * 52.0  # 12 kHz against 832 steps a second
    Y = 6.5 * rig.structure.excitation / (rig.structure.omega_n**2 - W**2 + 1j * W * rig.structure.damping)
    _, cos, sin = steady_state(rig, 52.0, steps_per_period=16).history.coefficients("drive", 1)
    drive = rig.structure.excitation @ Y + rig.structure.residual.drive_by_force * 6.5
    assert abs(cos - 1j * sin - drive) < 1e-10 * abs(drive)


# --- independent: equations typed anew, switched by events


def reference(rig: Rig, hz: float, periods: int, stiffness: float, mu: Callable[[float], float]) -> np.ndarray:
    """Jenkins element with a limit mu(v) R on a rig, (q, q') after some periods from rest, by solve_ivp with events."""
    s, n, W, C = rig.structure, rig.structure.n, 2 * np.pi * hz, rig.structure.compliance
    k = 1.0 / (1.0 / stiffness + C)
    r, load = s.reaction, rig.contact.normal_load

    def slip(t: float, q: np.ndarray) -> float:
        force = rig.excitation.amplitude * np.cos(W * t)
        return float(s.slip_row @ q - q @ s.shortening @ q / 2 + s.residual.slip_by_force * force)

    def slip_velocity(t: float, q: np.ndarray, v: np.ndarray) -> float:
        force_rate = -W * rig.excitation.amplitude * np.sin(W * t)
        return float((s.slip_row - s.shortening @ q) @ v + s.residual.slip_by_force * force_rate)

    def limit(t: float, x: np.ndarray, sign: float) -> float:
        """T when slipping, T = sign mu(v) R with R affine in T through q''."""
        q, v, F = x[:n], x[n:], rig.excitation.amplitude * np.cos(W * t)
        p = s.slip_row - s.shortening @ q
        sliding = F * s.excitation - s.damping * v - s.omega_n**2 * q
        free = load + r.inertia @ sliding + r.damping @ v - r.force_share * F
        slope = r.inertia @ p + r.stretch @ q - r.friction_lever
        m = sign * mu(slip_velocity(t, q, v))
        return m * free / (1.0 - m * slope)

    def rate(t: float, x: np.ndarray, T: float) -> np.ndarray:
        q, v, F = x[:n], x[n:], rig.excitation.amplitude * np.cos(W * t)
        push = F * s.excitation + T * (s.slip_row - s.shortening @ q)
        return np.concatenate([v, push - s.damping * v - s.omega_n**2 * q])

    def anchor_speed(t: float, x: np.ndarray, sign: float) -> float:
        f, e = rate(t, x, limit(t, x, sign)), 1e-7
        change = (limit(t + e, x + e * f, sign) - limit(t - e, x - e * f, sign)) / (2 * e)
        return slip_velocity(t, x[:n], x[n:]) + float(change / k)

    t, end, x, anchor, sign = 0.0, periods / hz, np.zeros(2 * n), 0.0, 0.0
    while t < end:
        if sign == 0.0:
            events = [lambda t, x, a=anchor, s=s: k * (a - slip(t, x[:n])) - limit(t, x, s) for s in (1.0, -1.0)]
            events[0].direction, events[1].direction = 1.0, -1.0

            def force(t: float, x: np.ndarray, a: float = anchor) -> float:
                return k * (a - slip(t, x[:n]))
        else:
            events = [lambda t, x, s=sign: anchor_speed(t, x, s)]
            events[0].direction = sign

            def force(t: float, x: np.ndarray, s: float = sign) -> float:
                return limit(t, x, s)

        for event in events:
            event.terminal = True
        options = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-14, "max_step": 0.02 / hz}
        solution = solve_ivp(lambda t, x, f=force: rate(t, x, f(t, x)), (t, end), x, events=events, **options)
        t, x = float(solution.t[-1]), solution.y[:, -1]
        if sign == 0.0:
            sign = 1.0 if solution.t_events[0].size else -1.0
        else:
            anchor, sign = slip(t, x[:n]) + force(t, x) / k, 0.0
    return x


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "hz"), [("jenkins", 52.0), ("stribeck", 50.0)])
def test_stick_slip_agrees_with_event_driven_solve_ivp(kind: str, hz: float) -> None:
    law: FrictionLaw = JENKINS if kind == "jenkins" else STRIBECK
    rig = beam_rig(law, modes=3)
    if kind == "jenkins":
        expected = reference(rig, hz, 6, 0.52 * 83.0 / 4.15e-6, lambda v: 0.52)
    else:
        expected = reference(rig, hz, 6, 0.5 * 83.0 / 4e-6, lambda v: 0.3 + 0.2 * np.exp(-((v / 5e-3) ** 2)))
    errors = []
    for steps in (512, 2048):
        state = simulate(rig, hz, steps_per_period=steps, duration=6 / hz).state
        errors.append(np.abs(state.q - expected[:3]).max() / np.abs(expected[:3]).max())
    assert errors[0] < 3e-4  # second order: errors fall 16-fold
    assert errors[1] < 3e-5


@pytest.mark.parametrize("coefficient", [50.0, 5000.0])
def test_viscous_contact_agrees_with_solve_ivp(coefficient: float) -> None:
    rig = beam_rig(Viscous(coefficient=coefficient), modes=3)
    s, n, W = rig.structure, 3, 2 * np.pi * 52.0

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        q, v, T = x[:n], x[n : 2 * n], x[2 * n]
        p = s.slip_row - s.shortening @ q
        push = 6.5 * np.cos(W * t) * s.excitation + T * p
        speed = p @ v - s.residual.slip_by_force * W * 6.5 * np.sin(W * t)
        # T = -c (speed + C T')
        return np.concatenate([v, push - s.damping * v - s.omega_n**2 * q, [-(T / coefficient + speed) / s.compliance]])

    solution = solve_ivp(rate, (0, 6 / 52.0), np.zeros(2 * n + 1), method="Radau", rtol=1e-7, atol=1e-12)
    state = simulate(rig, 52.0, steps_per_period=2048, duration=6 / 52.0).state
    np.testing.assert_allclose(state.q, solution.y[:n, -1], rtol=0, atol=1e-5 * np.abs(state.q).max())


# --- order and energy


def final(rig: Rig, steps: int) -> np.ndarray:
    return simulate(rig, 45.0, steps_per_period=steps, duration=4 / 45.0).state.q


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rig", "order"),
    [
        (beam_rig(JENKINS, modes=3), 2),
        (beam_rig(STRIBECK, modes=3), 2),
        (beam_rig(VISCOUS, modes=3), 2),
        (beam_rig(COULOMB, modes=3), 2),  # C_res makes T continuous
        (modal_rig(COULOMB), 1),  # T jumps where the contact grips
    ],
    ids=["jenkins", "stribeck", "viscous", "coulomb-compliant", "coulomb-rigid"],
)
def test_error_falls_with_the_stated_power_of_the_step(rig: Rig, order: int) -> None:
    exact = final(rig, 32768)
    sizes = np.array([128, 181, 256, 362, 2048, 2896, 4096])
    errors = np.array([np.abs(final(rig, n) - exact).max() for n in sizes]) / np.abs(exact).max()
    # where in its step a switch falls is left to chance; another order would make these differ 16-fold
    constants = errors * sizes.astype(float) ** order
    assert np.mean(constants[4:]) < 2.5 * np.mean(constants[:4])


def energy_error(rig: Rig, steps: int) -> float:
    """Input work minus stored, damped and rubbed energy of a run, relative to the input."""
    h, s = simulate(rig, 50.0, steps_per_period=steps, duration=0.1), rig.structure

    def integral(power: np.ndarray) -> float:
        return float(np.sum(power[1:] + power[:-1]) / 2 * (h.time[1] - h.time[0]))

    slip_speed = np.sum((s.slip_row - h.q @ s.shortening) * h.qdot, axis=1)
    stored = (h.qdot[-1] @ h.qdot[-1] + h.q[-1] @ (s.omega_n**2 * h.q[-1])) / 2
    lost = integral(np.sum(s.damping * h.qdot**2, axis=1)) - integral(h.friction * slip_speed)
    given = integral(h.force * (h.qdot @ s.excitation))
    return abs(given - stored - lost) / integral(np.abs(h.force * (h.qdot @ s.excitation)))


@pytest.mark.parametrize("law", EVERY_LAW, ids=label)
@pytest.mark.parametrize("make", [beam_rig, modal_rig])
def test_input_work_is_stored_damped_and_rubbed_away(make: Callable[[FrictionLaw], Rig], law: FrictionLaw) -> None:
    coarse, fine = (energy_error(make(law), steps) for steps in (512, 2048))
    # second order, like the trapezoidal rule of the integrals
    assert coarse < 1e-4
    assert 12 < coarse / fine < 20


# --- the contact


@pytest.mark.parametrize("law", [COULOMB, JENKINS], ids=label)
@pytest.mark.parametrize("make", [beam_rig, modal_rig])
def test_friction_stays_within_mu_R_and_reaches_it(make: Callable[[FrictionLaw], Rig], law: FrictionLaw) -> None:
    history = simulate(make(law), 45.0, duration=10 / 45.0)
    used = np.abs(history.friction) / (0.52 * history.channels["normal"].values)
    # R of the history comes from the equation of motion at the sample, R in the step from its own affine form
    assert 1.0 - 1e-9 < used.max() < 1.0 + 1e-9


def test_rigid_contact_does_not_move_while_it_sticks() -> None:
    history = simulate(modal_rig(COULOMB), 45.0, steps_per_period=1024, duration=10 / 45.0)
    slip = history.channels["slip"].values
    sticks = np.abs(history.friction[1:]) < 0.52 * 20.0 * (1 - 1e-9)
    assert 0.05 < sticks.mean() < 0.95
    assert np.abs(np.diff(slip)[sticks]).max() < 1e-14 * np.abs(slip).max()
    assert np.abs(np.diff(slip)[~sticks]).max() > 1e-4 * np.abs(slip).max()


def test_contact_with_a_weak_force_never_slips() -> None:
    rig = beam_rig(JENKINS, force=0.5)
    motion = steady_state(rig, 52.0, steps_per_period=256)
    assert motion.converged
    assert abs(motion.history.state.z[0]) < 1e-15
    s, k = rig.structure, 1.0 / (4.15e-6 / (0.52 * 83.0) + rig.structure.compliance)
    stuck = np.diag(s.omega_n**2) + k * np.outer(s.slip_row, s.slip_row)
    W = 2 * np.pi * 52.0
    moved = s.residual.slip_by_force * 0.5  # T = -k (c.q + moved)
    push = 0.5 * s.excitation - k * moved * s.slip_row
    Q = np.linalg.solve(stuck - W**2 * np.eye(5) + 1j * W * np.diag(s.damping), push)
    a = s.excitation @ Q + s.residual.drive_by_force * 0.5 - s.residual.slip_by_force * k * (s.slip_row @ Q + moved)
    _, cos, sin = motion.history.coefficients("drive", 1)
    assert abs(cos - 1j * sin - a) < 1e-4 * abs(a)  # linear but for the step and the foreshortening
    assert abs(motion.multipliers[0] - 1.0) < 1e-9  # the anchor stays where it is put
    assert abs(motion.multipliers[1]) < 0.95


def test_linear_interpolation_alone_would_let_a_rigid_contact_blow_up() -> None:
    # q_new = q_old with v_new = -2 v - f h / 2, f_new = -6 v / h - 2 f: spectral radius 2 + sqrt(3)
    rig = modal_rig(COULOMB, modes=1, force=0.0)
    assert Stepper(rig, 45.0, 0.0, 4096).growth == pytest.approx(2 + np.sqrt(3), rel=1e-4)
    stable = Stepper.stable(modal_rig(COULOMB), 45.0, 3.0, 512)
    assert stable.radius is not None
    assert stable.growth <= 1.0 + 1e-9
    assert Stepper.stable(beam_rig(COULOMB), 45.0, 3.0, 512).radius is None


def test_lift_off_is_reported_with_its_time_and_its_absence() -> None:
    calm = simulate(beam_rig(JENKINS), 52.0, duration=0.1)
    assert calm.lift_off is None
    assert calm.channels["normal"].values.min() > 0
    wild = simulate(beam_rig(JENKINS, alpha=2.0, force=150.0), 52.0, duration=0.2)
    negative = wild.time[wild.channels["normal"].values < 0]
    assert wild.lift_off == pytest.approx(negative[0], abs=1e-12)
    thinned = simulate(beam_rig(JENKINS, alpha=2.0, force=150.0), 52.0, duration=0.2, last_periods=1, every=64)
    assert thinned.lift_off == wild.lift_off


# --- restart, bookkeeping


@pytest.mark.parametrize("rig", [*(beam_rig(law) for law in EVERY_LAW), modal_rig(COULOMB), RIGID_BEAM])
def test_restart_continues_the_same_trajectory(rig: Rig) -> None:
    hz, N = 52.0, 128
    whole = simulate(rig, hz, steps_per_period=N, duration=5.25 / hz)
    first = simulate(rig, hz, steps_per_period=N, duration=2.25 / hz)
    second = simulate(rig, hz, steps_per_period=N, duration=3 / hz, start=first.state)
    assert second.time[0] == pytest.approx(first.time[-1])
    np.testing.assert_allclose(second.time, whole.time[-len(second.time) :], atol=1e-14)
    scale = np.abs(whole.q).max()
    np.testing.assert_allclose(second.q, whole.q[-len(second.time) :], rtol=0, atol=1e-10 * scale)
    assert second.coefficients("drive", 3) == pytest.approx(whole.coefficients("drive", 3), abs=1e-10 * scale)


def test_thinning_keeps_the_samples_of_the_full_history() -> None:
    full = simulate(beam_rig(JENKINS), 52.0, steps_per_period=128, duration=6 / 52.0)
    thin = simulate(beam_rig(JENKINS), 52.0, steps_per_period=128, duration=6 / 52.0, last_periods=2, every=4)
    assert len(full.time) == 6 * 128 + 1
    assert len(thin.time) == 2 * 32 + 1
    assert thin.samples_per_period == 32
    for name, signal in thin.channels.items():
        np.testing.assert_array_equal(signal.values, full.channels[name].values[-2 * 128 - 1 :: 4])
    drive = full.channels["drive"].values[::4]
    change = np.abs(drive[-32:] - drive[-64:-32]).max()
    assert thin.steadiness == pytest.approx(change / np.abs(drive[-32:]).max(), rel=1e-12)


def test_channels_have_their_units_and_belong_together() -> None:
    h = simulate(beam_rig(JENKINS), 52.0, steps_per_period=2048, duration=3 / 52.0)
    units = {name: signal.unit for name, signal in h.channels.items()}
    assert units == {
        "force": "N", "a1": "m/s2", "v1": "m/s", "y1": "m",
        "drive": "m", "slip": "m", "slip_velocity": "m/s", "friction": "N", "normal": "N",
    }  # fmt: skip
    dt = h.time[1] - h.time[0]
    for rate, quantity in (("v1", "y1"), ("slip_velocity", "slip")):
        derivative = np.gradient(h.channels[quantity].values, dt)[1:-1]
        expected = h.channels[rate].values[1:-1]
        assert np.sqrt(np.mean((derivative - expected) ** 2)) < 2e-3 * np.abs(expected).max()
    np.testing.assert_allclose(h.channels["force"].values, 6.5 * np.cos(2 * np.pi * 52.0 * h.time), atol=1e-12)


def test_channels_read_with_their_gain_and_delay_as_in_harmonic_balance() -> None:
    """One rig, two solvers: each harmonic of a channel that reads 1.3 times what was there 0.4 ms ago agrees."""
    rig = beam_rig(JENKINS)
    channels = tuple(replace(c, gain=1.3, delay=4e-4) if c.name in ("a1", "v1", "y1") else c for c in rig.channels)
    rig = replace(rig, channels=channels)
    marched = steady_state(rig, 52.0, steps_per_period=1024).history
    balanced = response.steady_state(rig, 52.0, harmonics=15, samples=1024)
    for name in ("a1", "v1", "y1"):
        expected = balanced[name].coefficients[[1, 3, 16, 18]]
        found = marched.coefficients(name, 3)[[1, 3, 4, 6]]
        np.testing.assert_allclose(found, expected, atol=5e-3 * np.abs(expected).max())
    c, k, theta = balanced["y1"].coefficients, np.arange(1, 16), 2 * np.pi * 52.0 * marched.time
    expected = c[0] + np.cos(np.outer(theta, k)) @ c[1:16] + np.sin(np.outer(theta, k)) @ c[16:]
    past = marched.time - marched.time[0] > 4e-4
    found = marched.channels["y1"].values
    np.testing.assert_allclose(found[past], expected[past], atol=5e-3 * np.abs(expected).max())


def test_progress_reports_time_reached() -> None:
    seen: list[float] = []
    simulate(beam_rig(JENKINS), 50.0, steps_per_period=64, duration=0.05, progress=seen.append)
    assert seen == pytest.approx([0.02, 0.04, 0.05])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"hz": 0.0}, "simulate: hz = 0; must be > 0 and finite [Hz]"),
        ({"hz": 52.0, "duration": -1.0}, "simulate: duration = -1; must be > 0 and finite [s]"),
        (
            {"hz": 52.0, "steps_per_period": 100, "every": 3},
            "simulate: every = 3; must divide 100 steps per period",
        ),
        ({"hz": 52.0, "steps_per_period": -4}, "simulate: steps_per_period = -4; must be a whole number >= 8"),
        ({"hz": 52.0, "last_periods": 51}, "simulate: last_periods = 51; must be a whole number 1 to 50"),
        (
            {"hz": 52.0, "start": "rest"},
            "simulate: start = 'rest'; must be a State of a rig with [contact], or a PeriodicSolution",
        ),
        (
            {"hz": 52.0, "start": State(np.zeros(3), np.zeros(3), 0.0, np.zeros(1))},
            "simulate: start has 8 values; this rig and its friction law need 12",
        ),
    ],
)
def test_arguments_out_of_range_are_refused(options: dict, message: str) -> None:
    with pytest.raises(ValueError) as refusal:
        simulate(beam_rig(JENKINS), **options)
    assert str(refusal.value) == message


def test_an_unsolvable_step_is_an_error_that_says_what_to_do_and_is_shortened_unless_given() -> None:
    # friction falls so fast with speed that one step has several solutions; with 20 modes the contact is that light
    steep = Stribeck(mu_static=0.5, mu=0.16, stribeck_velocity=6e-4, critical_slip=4e-6)
    with pytest.raises(ArithmeticError, match=r"contact residual .* N at 52 Hz; .* try more than 512 steps per period"):
        simulate(beam_rig(steep, modes=20), 52.0, duration=1.0, steps_per_period=512)
    assert simulate(beam_rig(steep, modes=20), 52.0, duration=0.2).samples_per_period > 512


# --- steady states


@pytest.mark.parametrize(
    "rig", [*(beam_rig(law) for law in EVERY_LAW), modal_rig(COULOMB), modal_rig(JENKINS), RIGID_BEAM]
)
def test_steady_state_repeats_and_is_where_a_long_run_ends(rig: Rig) -> None:
    hz, N = 48.0 if rig.contact.law is STRIBECK else 52.0, 256
    motion = steady_state(rig, hz, steps_per_period=N)
    assert motion.converged
    assert abs(motion.multipliers[0]) < 1.0
    again = simulate(rig, hz, steps_per_period=N, duration=1 / hz, start=motion.history.state)
    scale = np.abs(again.q).max()
    np.testing.assert_allclose(again.q[:-1], motion.history.q, rtol=0, atol=1e-8 * scale)
    np.testing.assert_allclose(again.q[-1], again.q[0], rtol=0, atol=1e-8 * scale)
    long = simulate(rig, hz, steps_per_period=N, duration=250 / hz, last_periods=2)  # transients fall by e^-55
    assert long.steadiness < 1e-9
    for channel, tolerance in (("drive", 1e-8), ("slip", 1e-7), ("friction", 1e-7), ("normal", 1e-7)):
        a, b = long.coefficients(channel, 9), motion.history.coefficients(channel, 9)
        np.testing.assert_allclose(b, a, rtol=0, atol=tolerance * max(np.abs(a).max(), 1e-9))


@pytest.mark.parametrize(
    "rig", [beam_rig(JENKINS), beam_rig(STRIBECK), beam_rig(VISCOUS), modal_rig(COULOMB), RIGID_BEAM]
)
def test_monodromy_is_the_derivative_of_the_period_map(rig: Rig) -> None:
    hz, N, n = 45.0, 256, rig.structure.n
    motion = steady_state(rig, hz, steps_per_period=N)
    x = motion.history.state.flat
    scale = np.concatenate([np.full(n, 1e-4), np.full(n, 1e-1), [10.0], np.full(len(x) - 2 * n - 1, 1e-5)])

    def mapped(x: np.ndarray) -> np.ndarray:
        return simulate(rig, hz, steps_per_period=N, duration=1 / hz, start=State.from_flat(x, n, 0.0)).state.flat

    columns = [(mapped(x + 1e-6 * e) - mapped(x - 1e-6 * e)) / 2e-6 for e in np.diag(scale)]
    finite = np.column_stack(columns) / scale[:, None]
    exact = motion.monodromy * scale / scale[:, None]
    # no step switches within the perturbation
    np.testing.assert_allclose(exact, finite, rtol=0, atol=1e-5 * np.abs(finite).max())


def test_an_unstable_steady_state_is_found_and_left_by_a_long_run() -> None:
    rig = beam_rig(STRIBECK)  # falling friction feeds the upper modes
    motion = steady_state(rig, 52.0, steps_per_period=512)
    assert motion.converged
    growth = abs(motion.multipliers[0])
    assert growth > 1.2
    x = motion.history.state
    nudged = simulate(rig, 52.0, steps_per_period=512, start=replace(x, qdot=x.qdot * (1 + 1e-9)), duration=40 / 52.0)
    apart = np.linalg.norm(nudged.qdot[::512] - motion.history.qdot[0], axis=1)
    # first the other multipliers die out, last the motion is bounded; in between it goes as the multiplier says
    slope = np.polyfit(np.arange(10, 34), np.log(apart[10:34]), 1)[0]
    assert slope == pytest.approx(np.log(growth), rel=0.1)


def test_a_start_near_the_solution_is_used() -> None:
    rig = beam_rig(JENKINS)
    near = simulate(rig, 52.0, steps_per_period=512).state
    coarse = steady_state(rig, 52.0, steps_per_period=512, start=near)
    again = steady_state(rig, 52.0, steps_per_period=512, start=coarse.history.state)
    assert again.iterations == 0
    assert abs(coarse.history.time[0]) < 1e-12
    late = steady_state(rig, 52.0, steps_per_period=512, start=replace(coarse.history.state, time=7 / 52.0))
    assert late.iterations <= 1
    assert late.history.coefficients("drive", 5) == pytest.approx(coarse.history.coefficients("drive", 5), abs=1e-12)


def test_what_does_not_close_is_returned_as_not_converged() -> None:
    rig = beam_rig(JENKINS)
    motion = steady_state(rig, 52.0, steps_per_period=64, start=State.at_rest(rig), max_iterations=0)
    assert not motion.converged
    assert motion.closure > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("law", [JENKINS, COULOMB, VISCOUS], ids=label)
def test_harmonic_balance_finds_the_same_steady_state(law: FrictionLaw) -> None:
    motion = steady_state(beam_rig(law), 52.0, steps_per_period=2048)
    balanced = response.steady_state(beam_rig(law), 52.0, harmonics=31, samples=1024)
    for channel in ("drive", "slip", "slip_velocity", "friction", "normal", "a1"):
        theirs = balanced.channels[channel].coefficients[[*range(10), *range(32, 41)]]
        ours = motion.history.coefficients(channel, 9)
        first = int(channel == "a1")  # an acceleration has no mean
        scale = np.abs(ours[1:]).max()
        np.testing.assert_allclose(ours[first:], theirs[first:], rtol=0, atol=5e-4 * scale, err_msg=channel)


# --- a law from outside the catalogue


@dataclass(frozen=True, eq=False)
class TwoElements:
    """Two Jenkins elements side by side, each half as stiff and half as strong as one."""

    name: ClassVar[str] = "two elements"
    states: ClassVar[int] = 2
    set_valued: ClassVar[bool] = False

    mu: float
    critical_slip: float

    def advance(self, z: ca.SX, before: ContactSample, now: ContactSample) -> tuple[ca.SX, ca.SX]:
        k, high = self.mu * now.P / self.critical_slip / 2, self.mu * now.rho / 2
        forces = [ca.fmin(ca.fmax(k * (z[i] - now.u), -high), high) for i in range(2)]
        return ca.vertcat(*(now.u + force / k for force in forces)), forces[0] + forces[1]


def test_a_law_with_more_states_needs_nothing_but_its_definition() -> None:
    two = simulate(modal_rig(TwoElements(mu=0.52, critical_slip=4.15e-6)), 45.0, duration=8 / 45.0)
    one = simulate(modal_rig(JENKINS), 45.0, duration=8 / 45.0)
    np.testing.assert_allclose(two.q, one.q, rtol=0, atol=1e-9 * np.abs(one.q).max())
    np.testing.assert_allclose(two.state.z, one.state.z[[0, 0]], rtol=1e-6)


def test_law_parameters_do_not_rebuild_the_step() -> None:
    simulate(beam_rig(JENKINS), 52.0, steps_per_period=64)
    before = marcher.cache_info().misses
    simulate(beam_rig(Jenkins(mu=0.3, critical_slip=2e-6), alpha=3.0, force=2.0), 47.0, steps_per_period=64)
    assert marcher.cache_info().misses == before


# --- an independent simulator


def example(name: str, modes: int) -> tuple[Rig, dict[int, dict[str, np.ndarray]], list[list[float]]]:
    table = tomllib.loads((EXAMPLES / name / "rig.toml").read_text())
    contact, friction = table["contact"], table["contact"].pop("friction")
    contact["load_variation"] = float(contact.pop("variable_normal_load"))
    rig = Rig(
        name=name,
        body=Beam(**table["beam"] | {"modes": modes}),
        damping=Damping(**table["damping"]),
        contact=Contact(law=LAWS[friction.pop("law")](**friction), **contact),
        excitation=Excitation(**table["excitation"]),
    )
    records: dict[int, dict[str, list[float]]] = {}
    with (EXAMPLES / "truth_contact" / f"{name}.csv").open() as file:
        for row in csv.DictReader(file):
            record = records.setdefault(int(row["record"]), {key: [] for key in row})
            for key, value in row.items():
                record[key].append(float(value))
    truth = {number: {key: np.array(values) for key, values in record.items()} for number, record in records.items()}
    return rig, truth, json.loads((EXAMPLES / "answers.json").read_text())[name]["true_force"]


def on_phases(history: TimeHistory, channel: str, phase: np.ndarray) -> np.ndarray:
    values = history.channels[channel].values
    return np.interp(phase, np.arange(len(values)) / len(values), values, period=1.0)


@pytest.mark.slow
@pytest.mark.skipif(not EXAMPLES.exists(), reason=f"no example measurements at {EXAMPLES}")
@pytest.mark.parametrize(
    ("name", "record", "slips"),
    [
        ("null", 4, False),
        ("null", 10, True),
        ("null", 40, True),
        ("paper_null", 22, True),
        ("paper_null", 34, True),
        ("paper_null", 40, True),
    ],
)
def test_contact_agrees_with_the_finite_element_simulator(name: str, record: int, slips: bool) -> None:
    rig, records, forces = example(name, modes=10)
    truth, (a, b) = records[record], forces[record - 1]
    motion = steady_state(rig, truth["frequency_hz"][0], level=float(np.hypot(a, b)))
    assert motion.converged
    phase = truth["phase"] - np.arctan2(b, a) / (2 * np.pi)
    # amplitudes of half the range; modes left out (10 against a full beam) and, in R, the elements' own ringing
    for channel, tolerance in (("slip", 1e-3), ("friction", 6e-3), ("normal", 0.06)):
        ours, theirs = on_phases(motion.history, channel, phase), truth[channel]
        if not slips:  # its mean is what the contact's history left
            ours, theirs = ours - ours.mean(), theirs - theirs.mean()
        assert np.abs(ours - theirs).max() < tolerance * np.ptp(theirs) / 2, channel


def test_settings_of_a_law_are_part_of_its_step() -> None:
    """Two laws with as many states and other settings, one after the other, do not share a compiled step."""

    def friction(*limits: float) -> float:
        law = Iwan(mu=0.52, stiffness=1.04e7, limits=limits)
        return float(np.abs(simulate(modal_rig(law), 45.0, duration=4 / 45.0).friction).mean())

    equal, unequal = friction(1.0, 1.0), friction(1.0, 9.0)
    assert abs(unequal / equal - 1.0) > 1e-3
    assert friction(1.0, 1.0) == equal


def test_derivatives_by_columns_are_those_of_one_expression(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond a few modes the derivative of a step is taken column by column: the same numbers."""
    rig = paper_rig().with_modes(6)
    stepper = Stepper(rig, 50.0, 6.5, 64)
    x = State.at_rest(rig).flat
    X, T, _ = stepper.march(x, 64)
    at_once = stepper.linearised(x, X, T)
    monkeypatch.setattr(stepfunction, "FEW_MODES", 0)
    lineariser.cache_clear()
    by_columns = stepper.linearised(x, X, T)
    lineariser.cache_clear()
    np.testing.assert_allclose(by_columns, at_once, rtol=1e-12, atol=1e-12)


def test_more_modes_than_a_march_of_a_foreshortened_beam_can_hold_are_refused() -> None:
    with pytest.raises(ValueError, match=r"^simulate: modes = 121; must be <= 120: a beam drawn in as it bends"):
        simulate(paper_rig().with_modes(121), 50.0, duration=0.02)
