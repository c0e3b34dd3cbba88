"""For how long contacts of joints are open, against a march that knows nothing of the package."""

import re
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from hbm import frequency_response, steady_state
from hbm.commands.tables import print_curves
from models import Jenkins
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import Friction, Joint, PlaneFriction
from models.joints.law import JointLaw
from models.parts import Damping, Excitation

HZ, RATIO, STIFFNESS, FORCE, AT = 10.0, 0.05, 4e3, 10.0, 12.0
RUBS = Joint("rubs", Friction(Jenkins(0.3, 1e-5), 5.0), ("along",))


def pressed(load: float, plane: bool) -> JointedRig:
    """An oscillator on an elastic contact that may separate, and one beside it that stays in contact."""
    shapes = {"w": (1.0, 0.0), "along": (0.0, 1.0)}
    law: JointLaw = PlaneFriction(0.3, 1e4, load, STIFFNESS)
    if not plane:
        law = Friction(Jenkins(0.3, 1e-5), load, normal_stiffness=STIFFNESS, reference_load=abs(load))
    ports = ("along", "along", "w") if plane else ("along", "w")
    body = ModalModel((HZ, 3.3 * HZ), shapes)
    lap = Joint("lap", law, ports)
    return JointedRig("lap", body, Damping(modal_ratios=(RATIO, RATIO)), (RUBS, lap), Excitation(FORCE, at="w"))


def open_share(load: float, periods: int = 60, steps: int = 4000) -> float:
    """Share of the last period without pressure, by a leap-frog of its own."""
    dt, omega = 1.0 / (AT * steps), 2 * np.pi * HZ
    w = v = 0.0
    for _ in range(periods):
        apart = 0
        for F in (FORCE * np.cos(2 * np.pi * np.arange(steps) / steps)).tolist():
            pressure = max(load + STIFFNESS * w, 0.0)
            apart += pressure == 0.0
            v += dt * (F + max(load, 0.0) - pressure - 2 * RATIO * omega * v - omega**2 * w)
            w += dt * v
    return apart / steps


@pytest.mark.parametrize("load", [4.0, -4.0])
@pytest.mark.parametrize("plane", [False, True])
def test_it_is_said_for_how_long_a_joint_is_open(load: float, plane: bool) -> None:
    found = steady_state(pressed(load, plane), AT, harmonics=41, samples=2048)
    assert set(found.off) == ({"joint lap", "joint rubs"})
    assert found.off["joint lap"] == pytest.approx(open_share(load), abs=2e-3)
    assert f"\njoint lap is out of contact for {open_share(load):.0%} of the period\n" in str(found)
    assert "joint rubs" not in str(found)
    held = steady_state(pressed(1e4, plane), AT, harmonics=5)
    assert "out of contact" not in str(held)


def test_a_curve_says_for_how_long_at_most() -> None:
    rig = pressed(4.0, plane=False)
    curve = frequency_response(replace(rig, name="lap"), (11.0, 13.0), harmonics=9)
    console = Console(width=200, record=True)
    print_curves(console, [curve])
    said = re.findall(r"10 N: joint (\w+) is out of contact for up to (\d+)% of the period", console.export_text())
    assert said == [("lap", f"{100 * max(p.off['joint lap'] for p in curve.points):.0f}")]
