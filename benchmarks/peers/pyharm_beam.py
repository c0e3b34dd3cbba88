"""The beam by pyHarm (pip install pyHarm-os): its own elements, Newton and continuation.

pyHarm's elements act on the dofs of nodes, so the modes are turned into nodes: node 0 moves with the slip, node 1
with the shaker, three more complete the basis. Lengths are in units of 2 mm, frequencies in units of 50 Hz.

Steps and corrector were searched by hand, some 25 combinations of `ds0`, `ds_max`, `lc`, `max_iter` and both
correctors. Of those that finish the sweep this is the fastest whose peak has four digits; where the points fall on
the peak is partly luck (`ds0` 0.012: 3.2 digits). Many combinations stop at 47.678 Hz, where a second slip phase
is born.
"""

import logging
import os
import tempfile
import warnings
from importlib.metadata import version
from typing import Any

import numpy as np
from cases import Case, Row, load, seconds, timed

LENGTH, OMEGA = 2e-3, 2 * np.pi * 50.0
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


def model(case: Case) -> dict:
    """Input of pyHarm: the modal model turned so that slip and drive displacement are dofs."""
    s, contact = case.rig.structure, case.rig.contact
    size = np.linalg.norm(s.excitation)
    slip = size / np.linalg.norm(s.slip_row)  # motion of node 0 per slip: all dofs of one magnitude
    rows = np.array([s.slip_row * slip, s.excitation])
    others = np.linalg.svd(rows)[2][2:] * size
    to_modes = np.linalg.inv(np.vstack([rows, others]))
    matrices = {
        name: to_modes.T @ np.diag(values) @ to_modes
        for name, values in (("M", np.ones(s.n)), ("C", s.damping), ("K", s.omega_n**2), ("G", np.zeros(s.n)))
    }
    law, P = contact.law, contact.normal_load
    jenkins = {"mu": law.mu, "N0": P / slip, "k": law.mu * P / law.critical_slip / slip**2}
    return {
        "system": {"type": "Base", "nh": case.H, "nti": case.N_t, "adim": {"status": True, "lc": LENGTH, "wc": OMEGA}},
        "substructures": {"beam": {"matrix": matrices, "ndofs": 1}},
        "connectors": {
            "contact": {"type": "Jenkins", "connect": {"beam": [0]}, "dirs": [0], **jenkins},
            "shaker": {
                "type": "CosinusForcing",
                "connect": {"beam": [1]},
                "dirs": [0],
                "amp": case.rig.excitation.amplitude,
            },
        },
        "analysis": {
            "frf": {**SETTINGS, "puls_inf": 2 * np.pi * case.hz[0], "puls_sup": 2 * np.pi * case.hz[1]},
        },
    }


def row(case: Case) -> Row:
    """Time the beam; reading the input and building the system are left out."""
    warnings.simplefilter("ignore")
    os.chdir(tempfile.mkdtemp())  # it leaves a .pyHarm folder where it runs
    import pyHarm

    logging.disable(logging.CRITICAL)

    def operated(maestro: Any) -> Any:
        maestro.operate()
        return maestro

    curve, wall, cpu = timed(operated, prepare=lambda: pyHarm.Maestro(model(case)))
    system, found = curve.system, curve.nls["frf"].SolList
    accepted = [p for p in found if p.flag_accepted]
    x = np.array([p.x for p in accepted])
    dofs = system.expl_dofs
    drive = x[:, dofs[dofs.node_num == 1].index] * LENGTH  # a_0, a_1, b_1, a_2, b_2...
    drive = np.hstack([drive[:, :1], drive[:, 1::2], drive[:, 2::2]])
    top = x[int(np.argmax(np.abs(drive[:, 1] + 1j * drive[:, case.H + 1])))]
    return Row(
        tool=f"pyHarm {version('pyHarm-os')}",
        wall=wall,
        cpu=cpu,
        hz=(x[:, -1] * OMEGA / (2 * np.pi)).tolist(),
        drive=drive.tolist(),
        rejected=len(found) - len(accepted),
        linearize=seconds(lambda: (system.Residual(top), system.Jacobian(top))),
        load=load(),
    )
