"""What the history of a contact, or of joints, that stick does to a record."""

from dataclasses import replace
from math import cos

import numpy as np
import pytest

import hbm.integration.integrate
from hbm import steady_state
from hbm.outputerror.jointhistory import history_of_joints, spare_forces
from hbm.outputerror.records import Measurement
from hbm.outputerror.simulated import held_beside, history, spare_friction, sticks
from hbm.sensitivity.derivatives import disturbed, sensitivities
from hbm.sensitivity.jointed import linearized
from models.bodies import ModalModel
from models.friction import Jenkins
from models.jointed import JointedRig
from models.joints import CubicSpring, Friction, Joint, PlaneFriction
from models.parts import Channel, Damping, Excitation
from models.published import PAPER_PENALTY, paper_rig
from models.scalars import FORCE

PAPER = paper_rig().with_modes(5)
RIG, HZ, LEVEL, H = replace(PAPER, contact=replace(PAPER.contact, law=PAPER_PENALTY)), 54.0, 0.3, 3
CHANNELS = ("a1", "a6")
STIFFNESS, RATIO = 5e3, 0.1
"""Of the joint that sticks [N/m]; damping ratio of the one mode."""


def test_motion_depends_on_the_mean_friction_as_time_integration_says():
    """Foreshortening: the mean of T stiffens the beam. Time integration starts from a contact that was pushed aside."""
    balanced = steady_state(RIG, HZ, level=LEVEL, harmonics=9, samples=512)
    plain = hbm.integration.integrate.steady_state(RIG, HZ, level=LEVEL, steps_per_period=512)
    state = plain.history.state
    pushed = hbm.integration.integrate.steady_state(
        RIG, HZ, level=LEVEL, steps_per_period=512, start=replace(state, z=state.z + 2e-7)
    )
    assert plain.converged and pushed.converged and sticks(balanced)
    mean = pushed.history.friction[:-1].mean() - plain.history.friction[:-1].mean()
    spare = RIG.contact.law.mu * RIG.contact.normal_load - np.ptp(balanced["friction"].samples) / 2
    assert spare_friction(RIG, balanced) == spare
    by = sensitivities(RIG, balanced, [FORCE], held_beside(balanced))
    change = history(spare, by.disturbed, balanced, Measurement((), CHANNELS, H, np.zeros(0)))
    alone = disturbed(RIG, balanced, held_beside(balanced))
    assert all(np.allclose(by.disturbed[name], alone[name], rtol=1e-9, atol=0.0) for name in alone)
    by_mean = change[:, :, 0, 0] / (spare / np.sqrt(3))
    for name, predicted in zip(CHANNELS, by_mean.T, strict=True):
        moved = pushed.history.coefficients(name, H) - plain.history.coefficients(name, H)
        marched = np.array([moved[1], -moved[H + 1]]) / mean
        np.testing.assert_allclose(predicted, marched, atol=0.01 * np.abs(marched).max())
        assert np.abs(mean * predicted).max() > 1e-4 * np.abs(plain.history.coefficients(name, H)[1])


def test_contact_that_slips_has_no_say_in_its_mean():
    slipping = steady_state(RIG, 50.0, harmonics=15)
    assert not sticks(slipping)
    assert spare_friction(RIG, slipping) == 0.0


def of_joints(limit: float, k3: float) -> JointedRig:
    """One mode at a joint that sticks up to a limit, beside a cubic spring."""
    body, damping = ModalModel((20.0,), {"tip": (1.0,)}), Damping(modal_ratios=(RATIO,))
    pad = Joint("pad", Friction(Jenkins(1.0, limit / STIFFNESS), limit), ("tip",))
    spring = Joint("spring", CubicSpring(k3), ("tip",))
    channels = (Channel("force", "force"), Channel("x", "displacement", at="tip"))
    return JointedRig("one mode", body, damping, (pad, spring), Excitation(1.0, at="tip"), channels)


def marched(f0: float, k3: float, steps: int = 128, periods: int = 40) -> np.ndarray:
    """Motion (steps,) of that mode where the joint sticks with a force f0 at rest, by Runge and Kutta's method."""
    Omega, w = 2 * np.pi * 22.0, 2 * np.pi * 20.0
    h, u, v, motion = 2 * np.pi / Omega / steps, 0.0, 0.0, np.empty(steps)

    def rate(t: float, u: float, v: float) -> tuple[float, float]:
        return v, cos(Omega * t) - 2 * RATIO * w * v - (w**2 + STIFFNESS) * u - f0 - k3 * u**3

    for i in range(periods * steps):
        t, motion[i % steps] = i * h, u
        a = rate(t, u, v)
        b = rate(t + h / 2, u + h / 2 * a[0], v + h / 2 * a[1])
        c = rate(t + h / 2, u + h / 2 * b[0], v + h / 2 * b[1])
        d = rate(t + h, u + h * c[0], v + h * c[1])
        u, v = (x + h / 6 * (p + 2 * q + 2 * r + s) for x, p, q, r, s in zip((u, v), a, b, c, d, strict=True))
    return motion


def test_motion_beside_a_joint_that_sticks_depends_on_its_mean_as_time_integration_says():
    """A cubic spring pulled aside gives even harmonics; alone with what is linear such a mean does nothing."""
    k3, f0, limit = 3e10, 1e-3, 5.0
    solution = steady_state(of_joints(limit, k3), 22.0, harmonics=9)
    data = Measurement((), ("x",), H, np.zeros(0))
    change = history_of_joints(linearized(of_joints(limit, k3), solution), solution, data)[:, 0, :, 0]
    ((port, spare),) = spare_forces(linearized(of_joints(limit, k3), solution).problem, solution)
    assert port == 0 and spare == pytest.approx(limit - np.ptp(solution["pad.force"].samples) / 2, rel=1e-12)
    forth, back = marched(f0, k3), marched(-f0, k3)
    between = 2 * f0 + STIFFNESS * (forth.mean() - back.mean())
    moved = 2 * np.fft.rfft(forth - back)[1 : H + 1] / len(forth) / between
    predicted = -(change[0] + 1j * change[1]) / (spare / np.sqrt(3.0))
    np.testing.assert_allclose(predicted, moved, atol=1e-3 * np.abs(moved).max())
    assert np.abs(spare * moved[1]) > 0.01 * np.abs(np.fft.rfft(forth)[1]) / len(forth)
    alone = steady_state(of_joints(limit, 0.0), 22.0, harmonics=9)
    nothing = history_of_joints(linearized(of_joints(limit, 0.0), alone), alone, data)
    assert np.abs(nothing).max() < 1e-9 * np.abs(alone["x"].coefficients).max()


def test_joint_that_slips_has_no_say_in_its_mean():
    rig = of_joints(0.5, 3e10)
    slipping = steady_state(rig, 22.0, level=5.0, harmonics=9)
    here = linearized(rig, slipping)
    assert list(spare_forces(here.problem, slipping)) == []
    assert history_of_joints(here, slipping, Measurement((), ("x",), H, np.zeros(0))) is None


def in_plane(pad: Joint, k3: float = 3e10) -> JointedRig:
    """Two modes at a joint that sticks, beside a cubic spring."""
    body = ModalModel((20.0, 31.0), {"tip": (1.0, 0.2), "side": (0.3, 0.8), "up": (0.4, -0.5)})
    spring = Joint("spring", CubicSpring(k3), ("tip",))
    channels = (Channel("force", "force"), Channel("x", "displacement", at="tip"))
    return JointedRig(
        "two modes", body, Damping(modal_ratios=(RATIO,)), (pad, spring), Excitation(1.0, at="tip"), channels
    )


@pytest.mark.parametrize("port", [0, 1])
def test_joint_in_a_plane_that_sticks_holds_what_its_circle_leaves_at_every_instant(port: int) -> None:
    rig = in_plane(Joint("pad", PlaneFriction(0.5, STIFFNESS, 10.0, 2e3), ("tip", "side", "up")))
    solution = steady_state(rig, 22.0, level=8.0, harmonics=9)
    forces = np.array([solution[name].samples for name in rig.forces[:3]])
    assert np.ptp(forces[2]) > 1.0  # the load varies
    spare = dict(spare_forces(linearized(rig, solution).problem, solution))[port]

    def holds(mean: float) -> bool:
        along = forces[port] + mean
        return bool(np.all(np.hypot(along, forces[1 - port]) <= 0.5 * (10.0 - forces[2])))

    means = [mean for mean in np.linspace(-6.0, 6.0, 12001) if holds(mean)]
    assert len(means) > 100 and spare == pytest.approx((means[-1] - means[0]) / 2, abs=1e-3)


def test_joint_in_a_plane_is_as_free_along_a_line_as_one_of_a_line():
    """Without a force across; that depends on the load alone, which the second has from a port of its own."""
    data = Measurement((), ("x",), H, np.zeros(0))
    plane, line = PlaneFriction(0.5, STIFFNESS, 10.0, 2e3), Friction(Jenkins(0.5, 5.0 / STIFFNESS), 10.0, 2e3)
    pads = Joint("pad", plane, ("tip", "0*side", "up")), Joint("pad", line, ("tip", "up"))
    found = []
    for rig in map(in_plane, pads):
        solution = steady_state(rig, 22.0, level=8.0, harmonics=9)
        found.append(history_of_joints(linearized(rig, solution), solution, data)[..., 0])
    assert np.abs(found[1]).max() > 0.0
    np.testing.assert_allclose(*found, rtol=0.0, atol=1e-6 * np.abs(found[1]).max())


def under_a_reaction(mu: float, load: float, of_modes: float, share: float) -> JointedRig:
    """One mode at a joint that the reaction of a support loads."""
    body = ModalModel((20.0,), {"tip": (1.0,)}, reactions={"wall": (of_modes,)}, shares={"wall": (share,)})
    pad = Joint("pad", Friction(Jenkins(mu, mu * load / STIFFNESS), load), ("tip",), loaded_by="wall")
    channels = (Channel("force", "force"), Channel("x", "displacement", at="tip"))
    return JointedRig("loaded", body, Damping(modal_ratios=(RATIO,)), (pad,), Excitation(1.0, at="tip"), channels)


def settled(rest: float, mu: float, load: float, of_modes: float, share: float, steps: int = 128) -> np.ndarray:
    """Friction (steps,) of that joint, which sticks with so large a force at rest until it slips, by a march in time.

    The reaction is of_modes (q'' + d q') - share (T + F), and so linear in T. The excitation grows for ten periods.
    """
    Omega, w, mine = 2 * np.pi * 22.0, 2 * np.pi * 20.0, of_modes - share
    h, u, v, anchor, friction = 2 * np.pi / Omega / steps, 0.0, 0.0, rest / STIFFNESS, np.empty(steps)

    def rate(t: float, u: float, v: float) -> tuple[float, float, float]:
        F = min(Omega * t / (20 * np.pi), 1.0) * cos(Omega * t)
        pressed = load + mine * F - of_modes * w**2 * u
        least, most = -mu * pressed / (1 + mu * mine), mu * pressed / (1 - mu * mine)
        T = min(max(STIFFNESS * (anchor - u), least), most)
        return v, F + T - 2 * RATIO * w * v - w**2 * u, T

    for i in range(40 * steps):
        t = i * h
        a = rate(t, u, v)
        b = rate(t + h / 2, u + h / 2 * a[0], v + h / 2 * a[1])
        c = rate(t + h / 2, u + h / 2 * b[0], v + h / 2 * b[1])
        d = rate(t + h, u + h * c[0], v + h * c[1])
        u += h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        v += h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        friction[i % steps] = T = rate(t + h, u, v)[2]
        anchor = u + T / STIFFNESS
    return friction


def test_joint_under_a_reaction_that_sticks_holds_what_marches_from_far_off_come_to():
    """Pushed aside in either direction it slips until the most is left that its limit holds at every instant."""
    numbers = (0.5, 6.0, 0.3, 0.25)
    solution = steady_state(under_a_reaction(*numbers), 22.0, level=1.0, harmonics=9)
    ((port, spare),) = spare_forces(linearized(under_a_reaction(*numbers), solution).problem, solution)
    forth, back = settled(4.0, *numbers), settled(-4.0, *numbers)
    assert port == 0 and spare == pytest.approx((forth.mean() - back.mean()) / 2, rel=5e-4)
    assert np.ptp(forth) == pytest.approx(np.ptp(solution["pad.force"].samples), rel=1e-4)  # it sticks in the end
    assert back.mean() < solution["pad.force"].samples.mean() < forth.mean()
    data = Measurement((), ("x",), H, np.zeros(0))
    assert history_of_joints(linearized(under_a_reaction(*numbers), solution), solution, data) is not None
