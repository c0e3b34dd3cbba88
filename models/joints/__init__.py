"""Joints: whatever is nonlinear is a law that reads the motion at a few ports of a body, and answers with forces."""

from models.joints.joint import Joint
from models.joints.law import JointLaw, JointSample, numbers
from models.joints.lossy import Backlash, HystereticDamping
from models.joints.rubbing import Friction, PlaneFriction
from models.joints.springs import Clearance, CubicSpring, Dashpot, PolynomialSpring, Separation, Stop

__all__ = [
    "JOINT_LAWS",
    "Backlash",
    "Clearance",
    "CubicSpring",
    "Dashpot",
    "Friction",
    "HystereticDamping",
    "Joint",
    "JointLaw",
    "JointSample",
    "PlaneFriction",
    "PolynomialSpring",
    "Separation",
    "Stop",
    "numbers",
]

JOINT_LAWS: dict[str, type] = {
    law.name: law
    for law in (
        PolynomialSpring,
        CubicSpring,
        Dashpot,
        Stop,
        Separation,
        Clearance,
        HystereticDamping,
        Backlash,
        PlaneFriction,
    )
}
"""Laws of joints by name, beside the friction laws."""
