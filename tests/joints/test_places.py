"""Where a joint acts: places of a body and their weighted sums."""

from dataclasses import replace

import pytest

from models import Beam
from models.bodies.finite import FiniteBeam
from models.bodies.modal import ModalModel
from models.bodies.ported import Body
from models.jointed import JointedRig
from models.joints import Joint, Stop
from models.parts import Damping, Excitation

PORTS = ModalModel((20.0, 47.0), {"acc-1": (1.0, 0.5), "b": (0.7, -0.9)})
BEAM = FiniteBeam(Beam(0.606, 0.03888, 0.00478, 210e9, 7800.0, 4))


def struck(body: Body, at: str, drive: str) -> JointedRig:
    """A body whose stop is at a place."""
    joint = Joint("stop", Stop(1e4, 1e-5), (at,))
    return JointedRig("struck", body, Damping(modal_ratios=(0.01,)), (joint,), Excitation(1.0, at=drive))


@pytest.mark.parametrize(
    ("body", "written", "means", "drive"),
    [
        (PORTS, "acc-1 - b", "acc-1 + -1*b", "b"),
        (PORTS, "-acc-1", "-1*acc-1", "b"),
        (PORTS, "- acc-1 + -b", "-1*acc-1 + -1*b", "b"),
        (PORTS, "0.5*acc-1 - 1e-2*b", "0.5*acc-1 + -0.01*b", "b"),
        (BEAM, "2*y(0.1) - y(0.2)", "2*y(0.1) + -1*y(0.2)", "y(0.3)"),
        (BEAM.matrices([0.3]), "y@0.3 - 0.01*slope@0.606", "y@0.3 + -0.01*slope@0.606", "y@0.3"),
    ],
)
def test_a_minus_between_places_is_a_weight(body: Body, written: str, means: str, drive: str) -> None:
    found, expected = (struck(body, at, drive).structure.joints for at in (written, means))
    assert found.tolist() == expected.tolist()


def test_what_is_joined_is_a_difference_of_places() -> None:
    between = replace(struck(PORTS, "acc-1", "b"), joints=(Joint("stop", Stop(1e4, 1e-5), ("acc-1",), ("b",)),))
    assert struck(PORTS, "acc-1 - b", "b").structure.joints.tolist() == between.structure.joints.tolist()


STILL = "where nothing moves; must be where a mode moves, or where there is flexibility"
NODE = ModalModel((20.0, 47.0), {"a": (1.0, 0.5), "b": (0.0, 0.0)})
YIELDS = replace(NODE, flexibility=((0.0, 0.0), (0.0, 1e-6)))


@pytest.mark.parametrize(
    ("at", "drive", "said"),
    [
        ("a", "b", f"struck: excitation at b, {STILL}"),
        ("b", "a", f"struck: joint stop at b, {STILL}"),
        ("a - a", "a", f"struck: joint stop at a - a, {STILL}"),
        ("0*a", "a", f"struck: joint stop at 0\\*a, {STILL}"),
    ],
)
def test_what_can_never_act_is_refused(at: str, drive: str, said: str) -> None:
    with pytest.raises(ValueError, match=f"^{said}$"):
        struck(NODE, at, drive)


@pytest.mark.parametrize(("at", "drive"), [("a", "b"), ("b", "a")])
def test_where_the_modes_left_out_move_a_joint_and_a_force_may_be(at: str, drive: str) -> None:
    assert struck(YIELDS, at, drive).ports == 1
