"""What a step of the solver works out is gone with the step: matrices of hundreds of steps must not pile up."""

import gc
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from hbm.balance.problem import balance_of
from hbm.fourier import FourierBasis
from hbm.modes.epmc import ForcedMotion, FreeMotion
from hbm.tracking.parameter import ParameterBalance, parameter_key
from models import Jenkins
from models.joints import Friction
from models.published import paper_rig
from tests.joints.rigs import beam_rig, made_up

BASIS = FourierBasis(3, 32)
RIGS = {"contact": paper_rig(), "joints": beam_rig(Friction(Jenkins(0.3, 1e-5), 20.0)), "rigid": made_up(True, True)}


def problems() -> Iterator[Any]:
    for name, rig in RIGS.items():
        balance, force = balance_of(rig, BASIS), parameter_key(rig, "excitation.amplitude", 50.0, 1.0)
        along = ParameterBalance(rig, force, (1.0, 2.0), BASIS, hz=50.0, level=1.0)
        yield pytest.param(balance, balance.size, id=name)
        yield pytest.param(along, balance.size, id=f"{name}, along a number")
        if name != "rigid":
            yield pytest.param(FreeMotion(rig, BASIS), balance.size + 2, id=f"{name}, left to itself")
            yield pytest.param(ForcedMotion(rig, BASIS), balance.size + 2, id=f"{name}, in resonance")


def left_of(step: Any) -> list[str]:
    """Kinds of objects of this package that a step leaves to the collector of circular references."""
    gc.collect()
    gc.disable()
    try:
        step()
        gc.set_debug(gc.DEBUG_SAVEALL)
        gc.collect()
        return [type(found).__name__ for found in gc.garbage if type(found).__module__.startswith("hbm.")]
    finally:
        gc.set_debug(0)
        gc.garbage.clear()
        gc.enable()


@pytest.mark.parametrize(("problem", "size"), list(problems()))
def test_a_step_leaves_nothing_behind(problem: Any, size: int) -> None:
    x, row = 1e-2 * np.random.default_rng(1).normal(size=size), np.ones(size)

    def step() -> None:
        here = problem.linearize(x, 0.9)
        here.solve_bordered(row, 1.0, row, 1.0)
        here.determinant_sign(row, 1.0)

    assert left_of(step) == []
