"""A body in modes with joints by pyHarm (pip install pyHarm-os): reads a case (.npz), writes its curve (.json).

The modes are turned into nodes, as in pyharm_beam.py: one node for the ports of each joint, the next moves with the
shaker, others complete the basis. pyHarm leaves JAX in single precision, in which Penalty3D does not close to the
tolerance: run it with JAX_ENABLE_X64=1.
"""

import json
import logging
import os
import sys
import tempfile
import time
import warnings
from typing import Any

import numpy as np

RUNS = 3
SETTINGS = {
    "study": "frf",
    "solver": "NewtonRaphson",
    "solver_options": {"tol_residual": 1e-8, "tol_delta_x": 1e-8, "max_iter": 30},
    "corrector": "pseudo_arc_length",
    "ds_min": 1e-8,
    "verbose": False,
}


def model(case: dict[str, Any]) -> dict[str, Any]:
    """Input of pyHarm: motions at the ports, then the drive displacement, as dofs."""
    ports, drive, elements = case["ports"], case["drive"], json.loads(str(case["elements"]))
    rows = np.vstack([ports, drive])
    others = np.linalg.svd(rows)[2][len(rows) :] * np.linalg.norm(drive)
    to_modes = np.linalg.inv(np.vstack([rows, others]))
    n, each = len(drive), int(case["each"])
    modal = {"M": np.ones(n), "C": case["damping"], "K": case["omega_n"] ** 2, "G": np.zeros(n)}
    matrices = {name: to_modes.T @ np.diag(values) @ to_modes for name, values in modal.items()}
    joints = len(ports) // each
    connectors: dict[str, Any] = {
        f"joint{i}.{j}": {"connect": {"beam": [i]}, **element}
        for i in range(joints)
        for j, element in enumerate(elements)
    }
    shaker = {"type": "CosinusForcing", "connect": {"beam": [joints]}, "dirs": [0], "amp": float(case["force"])}
    low, high = (2 * np.pi * case["hz"]).tolist()
    steps = {"ds0": float(case["step"]) / 2, "ds_max": float(case["step"])}
    return {
        "system": {
            "type": "Base",
            "nh": int(case["H"]),
            "nti": int(case["N_t"]),
            "adim": {"status": True, "lc": float(case["length"]), "wc": float(case["omega"])},
        },
        "substructures": {"beam": {"matrix": matrices, "ndofs": each}},
        "connectors": {**connectors, "shaker": shaker},
        "analysis": {"frf": {**SETTINGS, **steps, "puls_inf": low, "puls_sup": high}},
    }


def solved(system: Any, x: np.ndarray, omega: float) -> tuple[np.ndarray, float]:
    """Newton at a frequency, from the nearest point of a curve; the solution and what it leaves."""
    x = x[np.argmin(np.abs(x[:, -1] - omega))].copy()
    x[-1] = omega
    for _ in range(30):
        residual = system.Residual(x)
        if np.abs(residual).max() < 1e-11:
            break
        x[:-1] -= np.linalg.solve(system.Jacobian(x)[0], residual)
    return x, float(np.abs(residual).max())


def main(source: str, target: str) -> None:
    """Trace the curve, a first time untimed, and solve at given frequencies."""
    case = dict(np.load(source))
    warnings.simplefilter("ignore")
    os.chdir(tempfile.mkdtemp())  # it leaves a .pyHarm folder where it runs
    import pyHarm

    logging.disable(logging.CRITICAL)
    wall, cpu = [], []
    for _ in range(1 + RUNS):
        maestro = pyHarm.Maestro(model(case))
        begin, used = time.perf_counter(), time.process_time()
        maestro.operate()
        wall.append(time.perf_counter() - begin)
        cpu.append(time.process_time() - used)
    system, found = maestro.system, maestro.nls["frf"].SolList
    x = np.array([p.x for p in found if p.flag_accepted])
    to_hz, dofs = float(case["omega"]) / (2 * np.pi), system.expl_dofs
    node, length = len(case["ports"]) // int(case["each"]), float(case["length"])
    at = dofs[(dofs.node_num == node) & (dofs.dof_num == 0)].index

    def drive(x: np.ndarray) -> list[float]:
        a = x[at] * length  # a_0, a_1, b_1, a_2, b_2...
        return [*a[:1], *a[1::2], *a[2::2]]

    there = [solved(system, x, hz / to_hz) for hz in case["at"].tolist()]
    begin = time.process_time()
    for _ in range(20):
        system.Residual(there[0][0]), system.Jacobian(there[0][0])
    curve = {
        "wall": sorted(wall[1:])[RUNS // 2],
        "cpu": sorted(cpu[1:])[RUNS // 2],
        "linearize": (time.process_time() - begin) / 20,
        "hz": (x[:, -1] * to_hz).tolist(),
        "drive": [drive(p) for p in x],
        "rejected": len(found) - len(x),
        "at": [drive(p) for p, _ in there],
        "left": max(left for _, left in there),
    }
    with open(target, "w", encoding="utf-8") as file:
        json.dump(curve, file)


if __name__ == "__main__":
    main(*sys.argv[1:])
