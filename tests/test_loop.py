"""Loops under a prescribed slip against closed forms."""

import re
from typing import Any

import numpy as np
import pytest

from hbm.response.loop import friction_loop
from models import LAWS, Coulomb, Dahl, Iwan, Jenkins, VelocityLimited, Viscous, published

P, U, HZ = 83.0, 1e-5, 50.0
COULOMB, JENKINS, DAHL = Coulomb(0.5), Jenkins(0.5, 4e-6), Dahl(0.5, 1e7)
SETS = {name: law for name, law in vars(published).items() if type(law) in LAWS.values()}


def test_rectangle_of_coulomb_friction() -> None:
    """4 mu P U, less twice the elastic slip that 1e-5 of the slip stands for."""
    loop = friction_loop(COULOMB, U, HZ, load=P)
    assert loop.dissipated == pytest.approx(4 * 0.5 * P * U, rel=2e-5)
    assert np.abs(loop.T).max() == pytest.approx(0.5 * P, rel=1e-12)
    assert loop.compliance == pytest.approx(1e-5 * U / P)


def test_parallelogram_of_an_elastic_dry_friction_element() -> None:
    """4 mu P (U - u_crit); the corners are met to half a sample, hence the second order."""
    exact = 4 * 0.5 * P * (U - 4e-6)
    errors = [abs(friction_loop(JENKINS, U, HZ, load=P, samples=n).dissipated / exact - 1.0) for n in (256, 4096)]
    assert errors[0] < 1e-3
    assert errors[1] < errors[0] / 64


@pytest.mark.parametrize("amplitude", [1e-6, 1e-5, 1e-4])
def test_loop_of_dahl_is_exponential(amplitude: float) -> None:
    """From -U to U z relaxes towards mu P / k: peak mu P tanh a and 4 mu P (U - mu P / k tanh a), a = k U / (mu P)."""
    limit, k = 0.5 * P, 1e7
    a = k * amplitude / limit
    loop = friction_loop(DAHL, amplitude, HZ, load=P)
    assert loop.T.max() == pytest.approx(limit * np.tanh(a), rel=1e-12)
    exact = 4 * limit * (amplitude - limit / k * np.tanh(a))
    # trapezoids of 1024 chords: (pi / 1024)^2 of the box around the loop
    assert loop.dissipated == pytest.approx(exact, abs=1e-5 * 4 * limit * amplitude)


def test_loop_of_iwan_is_the_sum_of_its_elements() -> None:
    law = Iwan(mu=0.5, stiffness=1e7, limits=(1.0, 2.0, 5.0))
    limits = 0.5 * P * np.array(law.limits) / 8.0
    stiffness = 1e7 / 3
    lost = 4 * limits * np.maximum(U - limits / stiffness, 0.0)
    loop = friction_loop(law, U, HZ, load=P, samples=4096)
    assert loop.dissipated == pytest.approx(lost.sum(), rel=1e-5)
    assert -loop.T[0] == pytest.approx(np.minimum(limits, stiffness * U).sum(), rel=1e-12)


def test_dashpot_and_its_ramp() -> None:
    viscous = friction_loop(Viscous(300.0), U, HZ, load=P)
    assert viscous.T == pytest.approx(-300.0 * viscous.v, abs=1e-9)
    assert viscous.dissipated == pytest.approx(np.pi * 300.0 * 2 * np.pi * HZ * U**2, rel=1e-5)
    ramp = friction_loop(VelocityLimited(0.5, 1e-3), U, HZ, load=P)
    assert ramp.T == pytest.approx(-0.5 * P * np.clip(ramp.v / 1e-3, -1.0, 1.0), abs=1e-9)


def test_what_is_prescribed_is_what_comes_back() -> None:
    slip = U * np.array([0.3, 1.0, 0.0, -0.2, 0.5])  # a_0, a_1, a_2, b_1, b_2
    loop = friction_loop(JENKINS, slip, HZ, load=P, reaction=[P, 30.0, -5.0], samples=256)
    theta = 2 * np.pi * HZ * loop.time
    assert theta[[0, -1]] == pytest.approx([0.0, 2 * np.pi * 255 / 256])
    expected = 0.3 + np.cos(theta) - 0.2 * np.sin(theta) + 0.5 * np.sin(2 * theta)
    assert loop.u == pytest.approx(U * expected)
    rate = -np.sin(theta) - 0.2 * np.cos(theta) + np.cos(2 * theta)
    assert loop.v == pytest.approx(2 * np.pi * HZ * U * rate)
    assert loop.R == pytest.approx(P + 30.0 * np.cos(theta) - 5.0 * np.sin(theta))
    assert np.all(np.abs(loop.T) <= 0.5 * loop.R * (1 + 1e-12))
    assert (np.abs(loop.T) >= 0.5 * loop.R * (1 - 1e-12)).sum() > 50  # and slides


def test_the_compliance_stretches_and_loses_nothing() -> None:
    C = 3e-8
    loop = friction_loop(JENKINS, U, HZ, load=P, compliance=C)
    assert loop.w == pytest.approx(loop.u + C * loop.T)
    softer = friction_loop(Jenkins(0.5, 4e-6 + 0.5 * P * C), U, HZ, load=P)
    assert loop.T == pytest.approx(softer.T, abs=1e-9)
    assert loop.dissipated == pytest.approx(softer.dissipated, rel=1e-12)


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize(("amplitude", "least"), [(2e-6, -1e-9), (2e-5, 0.01)])  # stribeck sticks at 2 µm
def test_every_published_set_closes_its_loop_and_dissipates(name: str, amplitude: float, least: float) -> None:
    loop = friction_loop(SETS[name], amplitude, HZ, load=P, samples=256)
    assert loop.closure < 1e-12
    assert loop.dissipated > least * 4 * P * amplitude


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"slip": 0.0}, "slip is constant; must move"),
        ({"slip": [1.0, 2.0]}, "slip of shape (2,); must be 2H+1 finite coefficients"),
        ({"slip": np.inf}, "slip of shape (3,); must be 2H+1 finite coefficients"),
        ({"reaction": [80.0, 1.0]}, "reaction of shape (2,); must be 2H+1 finite coefficients"),
        ({"hz": 0.0}, "hz = 0.0; must be > 0"),
        ({"load": -1.0}, "load = -1.0; must be > 0"),
        ({"compliance": -1.0}, "compliance = -1.0; must be >= 0"),
        ({"samples": 4}, "samples = 4; must be >= 16"),
    ],
)
def test_what_cannot_be_is_refused(wrong: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {"slip": U, "hz": HZ, "load": P} | wrong
    with pytest.raises(ValueError, match=f"^friction_loop: {re.escape(message)}$"):
        friction_loop(JENKINS, **arguments)
