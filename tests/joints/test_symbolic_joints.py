"""The whole residual of joints as one CasADi function."""

import casadi as ca
import numpy as np
import pytest

from hbm.balance.jointed import JointBalance
from hbm.fourier import FourierBasis
from hbm.symbolic import residual_function
from models.joints import numbers
from tests.joints.rigs import made_up


@pytest.mark.parametrize(("damped", "rigid"), [(False, True), (True, False)])
def test_it_is_the_residual_that_is_solved(damped: bool, rigid: bool) -> None:
    problem = JointBalance(made_up(damped, rigid), FourierBasis(3, 32))
    function = residual_function(problem)
    x = 0.3 * np.random.default_rng(0).normal(size=problem.size)
    p = [value for j in problem.rig.joints for value in numbers(j.law).values()]
    found = function(x, 1.1, p).full().ravel()
    assert np.abs(found - problem.residual(x, 1.1)).max() < 1e-10 * np.abs(found).max()
    # and CasADi's derivative of it is the one that is solved with
    J = function.factory("J", ["x", "lam", "p"], ["jac:residual:lam"])(x, 1.1, p).full().ravel()
    assert np.abs(J - problem.linearize(x, 1.1).by_parameter).max() < 1e-9 * np.abs(J).max()
    assert isinstance(function, ca.Function)
