"""The CasADi residual and the eliminated one are two codes for the same equations."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from hbm.balance.problem import HarmonicBalance, State
from hbm.fourier import FourierBasis
from hbm.symbolic import residual_function
from models import (
    LAWS,
    Attachments,
    Coulomb,
    Dahl,
    ForceBalance,
    Frictionless,
    Hybrid,
    Iwan,
    Jenkins,
    Karnopp,
    LuGre,
    PointSpring,
    Resonator,
    Rig,
    SpringDamper,
    Stribeck,
    VelocityLimited,
    Viscous,
    parameters,
)
from models.published import paper_rig

LAW_SETS = {
    "none": Frictionless(),
    "coulomb-lagrange": Coulomb(0.5),
    "coulomb-penalty": Jenkins(0.52, 4.15e-6),
    "vlfm": VelocityLimited(mu=0.52, velocity_limit=6e-4),
    "karnopp": Karnopp(mu_static=0.52, mu=0.49, velocity_band=6e-4),
    "sdfm": SpringDamper(mu=0.52, stiffness=1.04e7, damping=347.0),
    "fbfm": ForceBalance(mu_static=0.52, mu=0.49, velocity_band=6e-4),
    "stribeck": Stribeck(mu_static=0.5, mu=0.3, stribeck_velocity=6e-4, critical_slip=4e-6),
    "dahl": Dahl(mu=0.5, stiffness=1e7),
    "lugre": LuGre(0.5, 0.3, 2e-3, 1e7, bristle_damping=347.0, viscous=10.0),
    "hybrid": Hybrid(0.5, 0.3, 2e-3, 1.5e7, 6e7, 6e7, 300.0, 200.0),
    "iwan": Iwan(mu=0.52, stiffness=1.04e7, elements=4),
    "viscous": Viscous(400.0),
}


def slipping_state(problem: HarmonicBalance, seed: int) -> State:
    """Random motion large enough to slip several times a period."""
    rng = np.random.default_rng(seed)
    size, n = problem.basis.size, problem.structure.n
    decay = np.exp(-0.5 * problem.basis.k)
    Q = 2e-4 * rng.normal(size=(size, n)) * decay[:, None] / np.arange(1, n + 1) ** 2
    return State(Q, 20.0 * rng.normal(size=size) * decay, 2 * np.pi * 51.0, problem.level)


def problem_of(law: str, parameter: str = "frequency", H: int = 5) -> tuple[Rig, HarmonicBalance]:
    rig = paper_rig(law=LAW_SETS[law])
    return rig, HarmonicBalance(rig, FourierBasis(H, 64), parameter=parameter, hz=51.0)


def test_every_law_has_a_set():
    assert LAW_SETS.keys() == LAWS.keys()


@pytest.mark.parametrize("law", LAW_SETS)
@pytest.mark.parametrize("parameter", ["frequency", "force"])
def test_symbolic_residual_equals_eliminated_residual(law, parameter):
    rig, problem = problem_of(law, parameter)
    p = np.array(list(parameters(rig.contact.law).values()), dtype=float)
    x, lam = problem.pack(slipping_state(problem, 3))
    symbolic = residual_function(problem)(x, lam, p).full().ravel()
    # rounding of a residual whose terms are up to 1e3 times the excitation; a Maxwell element forgets its
    # start in many periods, not one
    assert symbolic == pytest.approx(problem.residual(x, lam), abs=1e-9 if law != "viscous" else 1e-6)


@pytest.mark.parametrize("law", [name for name in LAW_SETS if name != "viscous"])
@pytest.mark.parametrize("parameter", ["frequency", "force"])
def test_bordered_solve_inverts_the_automatic_jacobian(law, parameter):
    rig, problem = problem_of(law, parameter)
    p = np.array(list(parameters(rig.contact.law).values()), dtype=float)
    x, lam = problem.pack(slipping_state(problem, 4))
    residual = residual_function(problem)
    symbols = ca.MX.sym("x", problem.size), ca.MX.sym("lam")
    jacobian = ca.Function("J", list(symbols), [ca.jacobian(residual(*symbols, p), ca.vertcat(*symbols))])(
        x, lam
    ).full()
    rng = np.random.default_rng(5)
    row, rhs = rng.normal(size=problem.size), rng.normal(size=problem.size)
    linearization = problem.linearize(x, lam)
    dx, dlam = linearization.solve_bordered(row, 0.3, rhs, 0.7)
    bordered = np.vstack([jacobian, np.append(row, 0.3)])
    solution = np.append(dx, dlam)
    backward = np.abs(bordered @ solution - np.append(rhs, 0.7)).max()
    assert backward < 1e-10 * np.abs(bordered).max() * np.abs(solution).max()
    assert linearization.determinant_sign(row, 0.3) == np.linalg.slogdet(bordered)[0]


def test_generated_c_has_no_dependencies(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, problem = problem_of("coulomb-penalty", H=2)
    residual_function(problem).generate("residual.c")
    text = (tmp_path / "residual.c").read_text()
    assert "int residual(const casadi_real** arg" in text
    assert all(line.startswith("#include <math.h>") for line in text.splitlines() if line.startswith("#include"))


def test_residual_functions_agree_with_everything_attached() -> None:
    """Here the reaction has an elastic part."""
    attached = Attachments(
        tip_stiffness=50.0, springs=(PointSpring(500.0, 0.25),), resonators=(Resonator(0.02, 70.0, 0.3),)
    )
    rig = replace(paper_rig(), attachments=attached)
    assert np.abs(rig.structure.reaction.stiffness).max() > 0.0
    problem = HarmonicBalance(rig, FourierBasis(5, 64))
    x, lam = problem.pack(slipping_state(problem, 3))
    symbolic = residual_function(problem)(x, lam, problem.environment.parameters).full().ravel()
    assert symbolic == pytest.approx(problem.residual(x, lam), abs=1e-12 * np.abs(symbolic).max())
