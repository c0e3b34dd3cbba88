"""Files of backbones: a table (CSV) and, beside it, what is known of them (JSON)."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hbm.files.curves import companion
from hbm.fourier import Array
from hbm.modes.backbone import Backbone, NonlinearMode, NumericalChange
from hbm.modes.linear import linear_modes
from hbm.textfiles import StrPath, csv_text, write_together
from hbm.version import installed_version

SCHEMA = 1
NAMES = {True: "nonlinear-mode", False: "phase-resonance"}


def write_backbones(
    path: StrPath, backbones: Sequence[Backbone], changes: Sequence[NumericalChange], mode: int
) -> None:
    """Write backbones of a mode of one rig and, beside them, their companion.

    Parameters
    ----------
    path : str or path
        CSV file; the companion is :func:`hbm.files.curves.companion` of it.
    backbones : sequence of Backbone
    changes : sequence of NumericalChange
        Of each.
    mode : int
        Number of the mode.

    Raises
    ------
    InputError
        If the files cannot be written; then neither is.
    """
    tables = [_columns(b) for b in backbones]
    rows = [[_entry(v) for v in row] for table in tables for row in zip(*table.values(), strict=True)]
    linear, first = linear_modes(backbones[0].rig), backbones[0]
    summary = {
        "schema": SCHEMA,
        "version": installed_version(),
        "rig": first.rig.name,
        "law": first.rig.contact.law.name,
        "mode": mode,
        "stuck_hz": _number(linear.stuck_hz[mode - 1]),
        "sliding_hz": _number(linear.sliding_hz[mode - 1]),
        "backbones": [_summary(b, change) for b, change in zip(backbones, changes, strict=True)],
    }
    text = json.dumps(summary, indent=1, allow_nan=False) + "\n"
    write_together({Path(path): csv_text([list(tables[0]), *rows]), companion(path): text})


def backbone_name(backbone: Backbone) -> str:
    """Name of a kind of backbone in files."""
    return NAMES[isinstance(backbone, NonlinearMode)]


def _columns(backbone: Backbone) -> dict[str, list[Any]]:
    points = backbone.points
    numbers: dict[str, Array] = {
        "amplitude_m": backbone.amplitude,
        "frequency_hz": backbone.hz,
        "damping_ratio": backbone.damping_ratio,
        "decay_rate_1_s": _decay_rate(backbone),
        "force_n": backbone.force,
        "energy_lost_j": backbone.lost,
        "friction_loss_j": backbone.rubbed,
        "slip_m": np.array([p["slip"].peak for p in points]),
        "friction_n": np.array([p["friction"].peak for p in points]),
        "normal_min_n": np.array([p["normal"].samples.min() for p in points]),
        "normal_max_n": np.array([p["normal"].peak for p in points]),
    }
    shape = backbone.shape.T
    for i, column in enumerate(shape, start=1):
        numbers |= {f"shape_{i}_real": column.real, f"shape_{i}_imag": column.imag}
    columns: dict[str, list[Any]] = {name: values.tolist() for name, values in numbers.items()}
    return {"backbone": [backbone_name(backbone)] * len(points), "point": list(range(1, len(points) + 1)), **columns}


def _decay_rate(backbone: Backbone) -> Array:
    return backbone.decay_rate if isinstance(backbone, NonlinearMode) else np.full(len(backbone.points), np.nan)


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
        "change_of_frequency_and_damping": {
            name: [_number(value) for value in values] for name, values in change.by_source.items()
        },
    }


def _entry(value: Any) -> Any:
    return "" if isinstance(value, float) and not math.isfinite(value) else value


def _number(value: float) -> float | None:
    """JSON has no nan: null where a number is not known."""
    return float(value) if math.isfinite(value) else None
