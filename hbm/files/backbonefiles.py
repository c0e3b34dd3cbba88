"""Files of backbones: a table (CSV) and, beside it, what is known of them (JSON)."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hbm.files.outputs import Columns, column_rows, with_companion
from hbm.files.version import installed_version
from hbm.modes.accuracy import NumericalChange
from hbm.modes.backbone import Backbone, NonlinearMode
from hbm.modes.linear import linear_modes
from hbm.textfiles import Contents, StrPath

SCHEMA = 1
NAMES = {True: "nonlinear-mode", False: "phase-resonance"}


def backbone_contents(
    path: StrPath, backbones: Sequence[Backbone], changes: Sequence[NumericalChange], mode: int
) -> Contents:
    """Contents of the file of the backbones of a mode of one rig, and of its companion.

    Parameters
    ----------
    path : str or path
        CSV file; the companion is :func:`hbm.files.outputs.companion` of it.
    backbones : sequence of Backbone
    changes : sequence of NumericalChange
        Numerical change of each backbone.
    mode : int
        Number of the mode.
    """
    tables = [_columns(b) for b in backbones]
    linear, first = linear_modes(backbones[0].rig), backbones[0]
    summary = {
        "schema": SCHEMA,
        "version": installed_version(),
        "rig": first.rig.name,
        "law": first.rig.law_name,
        "mode": mode,
        "stuck_hz": linear.stuck_hz[mode - 1],
        "sliding_hz": linear.sliding_hz[mode - 1],
        "backbones": [_summary(b, change) for b, change in zip(backbones, changes, strict=True)],
    }
    rows = column_rows({name: np.concatenate([table[name] for table in tables]) for name in tables[0]})
    return with_companion(path, rows, summary)


def backbone_name(backbone: Backbone) -> str:
    """Name of a kind of backbone in files."""
    return NAMES[isinstance(backbone, NonlinearMode)]


def _columns(backbone: Backbone) -> Columns:
    return {"backbone": np.full(len(backbone.points), backbone_name(backbone)), **backbone.columns}


def _summary(backbone: Backbone, change: NumericalChange) -> dict[str, Any]:
    basis = backbone.problem.balance.basis
    return {
        "backbone": backbone_name(backbone),
        "points": len(backbone.points),
        "complete": backbone.complete,
        "message": backbone.branch.message,
        "harmonics": basis.H,
        "samples": basis.N_t,
        "modes": backbone.rig.structure.n,
        "folds_m": backbone.folds,
        "lift_off_from_m": backbone.lift_off,
        "change_at_m": change.amplitude,
        "change_of_frequency_and_damping": {**change.by_source, "modes": change.modes},
    }
