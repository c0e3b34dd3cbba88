"""Folds that are kinks of friction, told from those of the curve."""

from dataclasses import dataclass, replace

import numpy as np

from hbm.fourier import Array
from hbm.response.kinks import MOTION, VALUE, kinks
from hbm.response.trace import trace_frequency
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import CubicSpring, Joint
from models.parts import Damping, Excitation


@dataclass(frozen=True, eq=False)
class Passed:
    """A point of a curve."""

    x: Array
    value: float
    fold: bool = True


def left(passed: list[Passed]) -> list[float]:
    gone = {p for pair in kinks(passed, lambda p: (p.x, p.value), lambda p: p.fold) for p in pair}
    return [p.value for p in passed if p not in gone]


def turns(hz: Array, motion: Array) -> list[Passed]:
    """Where a sampled curve turns back."""
    way = np.sign(np.diff(hz))
    at = np.flatnonzero(way[1:] != way[:-1]) + 1
    return [Passed(np.array([motion[i], 1.0]), float(hz[i])) for i in at]


def test_a_scalloped_curve_keeps_the_two_folds_that_it_would_have_without_scallops() -> None:
    """An S of 1 % of its frequency, rippled by less than 1e-4: 70 turns, of which the two outermost are left."""
    motion = np.linspace(0.5, 2.5, 20001)
    smooth = 73.0 + 1.5 * ((motion - 1.5) ** 3 / 3.0 - 0.25 * (motion - 1.5))
    rippled = smooth + 2e-3 * np.sin(2 * np.pi * motion / 0.02)
    passed = turns(rippled, motion)
    assert len(passed) > 20
    true = [p.value for p in turns(smooth, motion)]
    np.testing.assert_allclose(left(passed), true, rtol=VALUE)
    assert len(true) == 2


def test_folds_far_apart_in_either_are_none() -> None:
    near, far = 0.5, 2.0
    for motion, value, kept in ((near, near, 0), (far, near, 2), (near, far, 2)):
        there = Passed(np.array([1.0 + motion * MOTION, 0.0]), 50.0 * (1.0 + value * VALUE))
        assert len(left([Passed(np.array([1.0, 0.0]), 50.0), there])) == kept


def test_what_lies_between_two_folds_keeps_both() -> None:
    one, other = (Passed(np.array([1.0]), 50.0 + d) for d in (0.0, 1e-5))
    assert left([one, other]) == []
    doubling = Passed(np.array([1.0]), 50.0, fold=False)
    assert len(left([one, doubling, other])) == 3


def test_a_number_that_passes_zero_has_no_kinks() -> None:
    assert len(left([Passed(np.array([1.0]), 0.0), Passed(np.array([1.0]), 1e-9)])) == 2


def test_folds_of_a_curve_are_told_by_the_motion_where_it_turns() -> None:
    """And not by that of the points behind, which are as far away as the steps are long."""
    spring = Joint("spring", CubicSpring(1e9), ("a",))
    body, damping = ModalModel((10.0,), {"a": (1.0,)}), Damping(modal_ratios=(0.01,))
    curve = trace_frequency(JointedRig("duffing", body, damping, (spring,), Excitation(1.0, at="a")), (8.0, 30.0))
    first, second = (p for p in curve.branch.points if p.fold)
    turned = replace(second, fold_x=first.fold_x * (1.0 + 0.1 * MOTION), fold_lam=first.fold_lam * (1.0 + 0.1 * VALUE))
    assert np.linalg.norm(second.x - first.x) > MOTION * np.linalg.norm(first.x)
    points = tuple(turned if p is second else p for p in curve.branch.points)
    assert len(curve.folds) == 2 and replace(curve, branch=replace(curve.branch, points=points)).folds == []
