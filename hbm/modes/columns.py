"""Columns of the table of a backbone; their names end in units."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hbm.balance.solution import PeriodicSolution
from hbm.fourier import Array
from models.jointed import AnyRig

if TYPE_CHECKING:
    from hbm.modes.backbone import Backbone


def columns_of(backbone: "Backbone") -> dict[str, Array]:
    """Columns of a backbone, a row for each motion; see :attr:`hbm.modes.backbone.Backbone.columns`."""
    shape = {f"shape_{i}": column for i, column in enumerate(backbone.shape.T, start=1)}
    return {
        "point": np.arange(1, len(backbone.points) + 1),
        "amplitude_m": backbone.amplitude,
        "frequency_hz": backbone.hz,
        "damping_ratio": backbone.damping_ratio,
        "decay_rate_1_s": backbone.decay_rate,
        "force_n": backbone.force,
        "energy_lost_j": backbone.lost,
        "friction_loss_j": backbone.rubbed,
        **_where_it_touches(backbone.rig, backbone.points),
        **{f"{name}_{part}": getattr(values, part) for name, values in shape.items() for part in ("real", "imag")},
    }


def _where_it_touches(rig: AnyRig, points: Sequence[PeriodicSolution]) -> dict[str, Array]:
    """Peaks of motion and force at every port, such as ``tip.motion_m`` and ``tip.force_n``; and of a reaction."""
    found = dict[str, Array]()
    for *names, units in zip(rig.motions, rig.forces, rig.units, strict=True):
        for name, unit in zip(names, units, strict=True):
            found[f"{name}_{unit.lower().replace(' ', '_')}"] = np.array([p[name].peak for p in points])
    if "normal" in rig.computed:
        found["normal_min_n"] = np.array([p["normal"].samples.min() for p in points])
        found["normal_max_n"] = np.array([p["normal"].peak for p in points])
    return found
