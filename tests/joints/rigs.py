"""Rigs with joints that several tests share."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from hbm.rigfiles.load import load_rig
from models import Beam, Jenkins
from models.bodies.finite import FiniteBeam
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import Friction, Joint, PlaneFriction, PolynomialSpring, Stop
from models.parts import Channel, Damping, Excitation
from models.published import paper_rig
from models.rig import Rig

TWO_MODES = """
name = "two modes"
[modal]
frequencies_hz = [16.0, 45.0]
ports = { one = [0.7, 0.5], two = [0.4, -0.6] }
[damping]
modal_ratios = [0.01]
[excitation]
amplitude = 1.0
at = "one"
"""
"""Beginning of a rig file."""


def loaded(folder: Path, text: str) -> JointedRig:
    """The rig of a file of this text."""
    (folder / "rig.toml").write_text(text)
    found = load_rig(folder / "rig.toml")
    assert isinstance(found, JointedRig)
    return found


BEAM = Beam(0.606, 0.03888, 0.00478, 210e9, 7800.0, 6)


def made_up(damped: bool, rigid: bool) -> JointedRig:
    """Numbers without a meaning, every term at work: residual flexibility, a reaction, coupled damping, rigid modes."""
    rng = np.random.default_rng(1)
    n = 4
    rows, C, D = rng.normal(size=(5, n)), rng.normal(size=(5, 5)), rng.normal(size=(n, n))
    body = ModalModel(
        (0.0 if rigid else 1.0, 2.0, 3.0, 5.0),
        {name: tuple(row) for name, row in zip("abcde", rows.tolist(), strict=True)},
        tuple(map(tuple, (1e-3 * C @ C.T).tolist())),
        tuple(map(tuple, (0.05 * D @ D.T).tolist())) if damped else None,
        {"s": tuple(0.05 * rng.normal(size=n))},
        {"s": tuple(0.1 * rng.normal(size=5))},
    )
    joints = (
        Joint("rub", Friction(Jenkins(0.4, 0.01), 2.0), ("a",), loaded_by="s"),
        Joint("spring", PolynomialSpring(cubic=200.0), ("b",), ("c",)),
        Joint("plane", PlaneFriction(0.3, 50.0, 1.0, 30.0), ("c", "d", "e")),
    )
    damping = Damping() if damped else Damping(0.3)
    return JointedRig("made up", body, damping, joints, Excitation(1.0, at="d"))


def beam_rig(friction: Friction) -> JointedRig:
    """A beam with four joints: friction, a spring between two points, a stop, friction in a plane."""
    joints = (
        Joint("rub", friction, ("y(0.25)",)),
        Joint("spring", PolynomialSpring(linear=1e3, cubic=1e13), ("y(0.3)",), ("y(0.45)",)),
        Joint("stop", Stop(2e4, 4e-6), ("y(0.4)",)),
        Joint("plane", PlaneFriction(0.3, 1e6, 10.0, 1e6), ("axial(0.5)", "y(0.5)", "y(0.35)")),
    )
    return JointedRig(
        "beam with four joints",
        FiniteBeam(BEAM),
        Damping(modal_ratios=(0.01,)),
        joints,
        Excitation(20.0, 0.555),
        (Channel("x", "acceleration", 0.3),),
    )


def contact_and_joint() -> tuple[Rig, JointedRig]:
    """The paper's beam under constant load with a Jenkins contact, and a rig with one joint that means the same."""
    rig = paper_rig()
    contact = replace(rig.contact, law=Jenkins(0.52, 4.146e-6), load_variation=0.0, foreshortening=False)
    rig = replace(rig, contact=contact)
    s = rig.structure
    cross = s.residual.slip_by_force
    body = ModalModel(
        tuple((s.omega_n / (2 * np.pi)).tolist()),
        {"tip": tuple(s.slip_row.tolist()), "shaker": tuple(s.excitation.tolist())},
        ((s.compliance, cross), (cross, s.residual.drive_by_force)),
    )
    joint = Joint("tip", Friction(contact.law, contact.normal_load), ("tip",))
    return rig, JointedRig("paper", body, rig.damping, (joint,), replace(rig.excitation, at="shaker"))
