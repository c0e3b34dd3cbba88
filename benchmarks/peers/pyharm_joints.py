"""Jenkins joints on one beam by pyHarm: reads a modal model (.npz), writes its curve (.json); needs pyHarm alone.

As in pyharm_beam.py the modes are turned into nodes: one for each joint, one for the shaker, others complete the basis.
"""

import json
import logging
import os
import sys
import tempfile
import time
import warnings

import numpy as np

SETTINGS = {
    "study": "frf",
    "solver": "NewtonRaphson",
    "solver_options": {"tol_residual": 1e-8, "tol_delta_x": 1e-8, "max_iter": 30},
    "corrector": "pseudo_arc_length",
    "ds0": 0.013,
    "ds_max": 0.02,
    "ds_min": 1e-8,
    "verbose": False,
}


def model(case: dict[str, np.ndarray], hz: tuple[float, float]) -> dict:
    """Input of pyHarm, and the motion of each node per unit of its dof."""
    rows, drive = case["rows"], case["drive"]
    size = np.linalg.norm(drive)
    scales = size / np.linalg.norm(rows, axis=1)
    turned = np.vstack([rows * scales[:, None], drive])
    others = np.linalg.svd(turned)[2][len(turned) :] * size
    to_modes = np.linalg.inv(np.vstack([turned, others]))
    n, m = len(drive), len(rows)
    matrices = {
        name: to_modes.T @ np.diag(values) @ to_modes
        for name, values in (
            ("M", np.ones(n)),
            ("C", case["damping"]),
            ("K", case["omega_n"] ** 2),
            ("G", np.zeros(n)),
        )
    }
    length, omega = float(case["length"]), float(case["omega"])
    connectors = {
        f"joint{i}": {
            "type": "Jenkins",
            "connect": {"beam": [i]},
            "dirs": [0],
            "mu": float(case["mu"]),
            "N0": float(case["load"]) / scales[i],
            "k": float(case["stiffness"]) / scales[i] ** 2,
        }
        for i in range(m)
    }
    connectors["shaker"] = {
        "type": "CosinusForcing",
        "connect": {"beam": [m]},
        "dirs": [0],
        "amp": float(case["force"]),
    }
    return {
        "system": {
            "type": "Base",
            "nh": int(case["H"]),
            "nti": int(case["N_t"]),
            "adim": {"status": True, "lc": length, "wc": omega},
        },
        "substructures": {"beam": {"matrix": matrices, "ndofs": 1}},
        "connectors": connectors,
        "analysis": {"frf": {**SETTINGS, "puls_inf": 2 * np.pi * hz[0], "puls_sup": 2 * np.pi * hz[1]}},
    }


def at_our_peak(case: dict[str, np.ndarray], system: object) -> float:
    """Their Newton iterations from our solution at our peak, at its frequency: relative change of the fundamental."""
    rows, drive, H = case["rows"], case["drive"], int(case["H"])
    size = np.linalg.norm(drive)
    turned = np.vstack([rows * (size / np.linalg.norm(rows, axis=1))[:, None], drive])
    nodes = np.vstack([turned, np.linalg.svd(turned)[2][len(turned) :] * size]) @ case["Q"].T / float(case["length"])
    dofs = system.expl_dofs
    place = [k if cs == "c" else H + k for k, cs in zip(dofs.harm, dofs.cs, strict=True)]
    x = np.append(nodes[dofs.node_num.to_numpy(), place], 2 * np.pi * float(case["at"]) / float(case["omega"]))
    first = dofs[(dofs.node_num == len(rows)) & (dofs.harm == 1)].index
    ours = np.hypot(*x[first])
    for _ in range(6):
        residual, jacobian = np.ravel(system.Residual(x)), system.Jacobian(x)[0]  # by unknowns, then by frequency
        free = len(x) - 1
        x[:free] -= np.linalg.solve(jacobian[:free, :free], residual[:free])
    return float(abs(np.hypot(*x[first]) / ours - 1.0))


def main(source: str, target: str, trace: str) -> None:
    """Solve at our peak; trace the curve twice, the second time timed, if asked for."""
    case = dict(np.load(source))
    warnings.simplefilter("ignore")
    os.chdir(tempfile.mkdtemp())  # it leaves a .pyHarm folder where it runs
    import pyHarm

    logging.disable(logging.CRITICAL)
    hz = tuple(case["hz"].tolist())
    apart = at_our_peak(case, pyHarm.Maestro(model(case, hz)).system)
    if trace == "no":
        with open(target, "w", encoding="utf-8") as file:
            json.dump({"apart": apart}, file)
        return
    for _ in range(2):
        maestro = pyHarm.Maestro(model(case, hz))
        begin = time.perf_counter()
        maestro.operate()
        wall = time.perf_counter() - begin
    accepted = [p for p in maestro.nls["frf"].SolList if p.flag_accepted]
    x = np.array([p.x for p in accepted])
    dofs, m, H = maestro.system.expl_dofs, len(case["rows"]), int(case["H"])
    drive = x[:, dofs[dofs.node_num == m].index] * float(case["length"])  # a_0, a_1, b_1, a_2, b_2...
    first = np.hypot(drive[:, 1], drive[:, 2])
    found = {
        "apart": apart,
        "wall": wall,
        "hz": (x[:, -1] * float(case["omega"]) / (2 * np.pi)).tolist(),
        "first": first.tolist(),
        "H": H,
        "version": getattr(pyHarm, "__version__", "1.2.2"),
    }
    with open(target, "w", encoding="utf-8") as file:
        json.dump(found, file)


if __name__ == "__main__":
    main(*sys.argv[1:])
