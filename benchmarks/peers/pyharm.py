"""Modes with joints by pyHarm (pip install pyHarm-os): its own elements, Newton and continuation.

pyHarm's elements act on the dofs of nodes, so the modes are turned into nodes: one for the ports of each joint, the
next moves with the shaker, others complete the basis. It leaves JAX in single precision, in which Penalty3D does not
close to the tolerance: the environment has JAX_ENABLE_X64=1.
"""

import logging
import os
import tempfile
import warnings
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import numpy as np

from benchmarks.cases import Case, Traced
from models.jointed import JointedRig

SETTINGS = {
    "study": "frf",
    "solver": "NewtonRaphson",
    "solver_options": {"tol_residual": 1e-8, "tol_delta_x": 1e-8, "max_iter": 30},
    "corrector": "pseudo_arc_length",
    "ds_min": 1e-8,
    "verbose": False,
}
CLOSED = 1e-11
"""Residual at which a solution at a given frequency is done, in its own units."""


def _joints(case: Case) -> tuple[np.ndarray, int]:
    """Rows of its dofs at the joints, and how many each joint has."""
    rig, told = case.rig, case.pyharm
    if not isinstance(rig, JointedRig):
        return told.scale * rig.structure.slip_row[None], 1
    turn = np.eye(1) if told.turn is None else told.turn
    return told.scale * np.kron(np.eye(len(rig.joints)), turn) @ rig.structure.joints, len(turn)


def model(case: Case) -> dict[str, Any]:
    """Input of pyHarm: motions at the ports, then the drive displacement where no port has it, as dofs."""
    s, told = case.rig.structure, case.pyharm
    ports, each = _joints(case)
    drive = s.excitation
    rows = ports if np.linalg.matrix_rank(ports) == len(drive) else np.vstack([ports, drive])
    others = np.linalg.svd(rows)[2][len(rows) :] * np.linalg.norm(drive)
    to_modes = np.linalg.inv(np.vstack([rows, others]))
    damping = s.damping if s.damping.ndim == 2 else np.diag(s.damping)
    modal = {"M": np.eye(s.n), "C": damping, "K": np.diag(s.omega_n**2), "G": np.zeros((s.n, s.n))}
    connectors: dict[str, Any] = {
        f"joint{i}.{j}": {"connect": {"body": [i]}, **element}
        for i in range(len(ports) // each)
        for j, element in enumerate(told.elements)
    }
    shaker = {"type": "CosinusForcing", "connect": {"body": [_shaken(case)]}, "dirs": [0]}
    steps = {"ds0": told.first, "ds_max": told.longest}
    ends = {"puls_inf": 2 * np.pi * case.hz[0], "puls_sup": 2 * np.pi * case.hz[1]}
    return {
        "system": {
            "type": "Base",
            "nh": case.H,
            "nti": case.N_t,
            "adim": {"status": True, "lc": told.length, "wc": told.omega},
        },
        "substructures": {
            "body": {"matrix": {name: to_modes.T @ m @ to_modes for name, m in modal.items()}, "ndofs": each}
        },
        "connectors": {**connectors, "shaker": {**shaker, "amp": case.rig.excitation.amplitude}},
        "analysis": {"frf": {**SETTINGS, **steps, **ends}},
    }


def _shaken(case: Case) -> int:
    """Node that the shaker moves."""
    ports, each = _joints(case)
    return 0 if len(ports) == case.rig.structure.n else len(ports) // each


class Run:
    """One run of pyHarm, prepared. Called, it returns the curve, and what evaluates residual and derivative at its top.

    Attributes
    ----------
    system : pyHarm's system
    x : (points, unknowns) array
        Points of the curve, in its units.
    """

    system: Any
    x: np.ndarray

    def __init__(self, case: Case) -> None:
        self.case, self._maestro = case, _maestro(case)

    def __call__(self) -> tuple[Traced, Callable[[], Any]]:
        self._maestro.operate()
        self.system, found = self._maestro.system, self._maestro.nls["frf"].SolList
        self.x = np.array([p.x for p in found if p.flag_accepted])
        hz = self.x[:, -1] * self.case.pyharm.omega / (2 * np.pi)
        name, rejected = f"pyHarm {version('pyHarm-os')}", len(found) - len(self.x)
        curve = Traced(name, hz, _drive(self.case, self.system, self.x), self.case.N_t, rejected)
        top = self.x[int(np.argmax(curve.height))]
        return curve, lambda: (self.system.Residual(top), self.system.Jacobian(top))

    def solutions(self, hz: np.ndarray) -> tuple[np.ndarray, float]:
        """Solutions (f, 2H+1) at frequencies (f,) [Hz] by Newton from the nearest points; what they leave."""
        found = [_solved(self.system, self.x, 2 * np.pi * f / self.case.pyharm.omega) for f in hz.tolist()]
        return _drive(self.case, self.system, np.array([p for p, _ in found])), max(left for _, left in found)


prepared = Run


def _maestro(case: Case) -> Any:
    warnings.simplefilter("ignore")
    os.chdir(tempfile.gettempdir())  # it leaves a .pyHarm folder where it runs
    import pyHarm

    logging.disable(logging.CRITICAL)
    return pyHarm.Maestro(model(case))


def _drive(case: Case, system: Any, x: np.ndarray) -> np.ndarray:
    """Coefficients of the drive displacement, (points, 2H+1) [m]."""
    dofs, node = system.expl_dofs, _shaken(case)
    a = x[:, dofs[(dofs.node_num == node) & (dofs.dof_num == 0)].index] * case.pyharm.length  # a_0, a_1, b_1, a_2...
    return np.hstack([a[:, :1], a[:, 1::2], a[:, 2::2]])


def _solved(system: Any, x: np.ndarray, omega: float) -> tuple[np.ndarray, float]:
    """Newton at a frequency from the nearest point of a curve, and what it leaves."""
    x = x[np.argmin(np.abs(x[:, -1] - omega))].copy()
    x[-1] = omega
    for _ in range(30):
        residual = system.Residual(x)
        if np.abs(residual).max() < CLOSED:
            break
        x[:-1] -= np.linalg.solve(system.Jacobian(x)[0], residual)
    return x, float(np.abs(residual).max())
