"""Backbone of forced records by the force balance of one mode: python forced.py forced.toml spectra.csv forced.csv."""

import sys
from pathlib import Path

import numpy as np

from hbm import load_rig, load_spectra
from hbm.files.outputs import columns_text
from hbm.inverse.sensing import readings
from hbm.measurement.decay import Decay

rig = load_rig(sys.argv[1])
seen = readings(rig, spectra := load_spectra(sys.argv[2], rig))
w, s = 2 * np.pi * spectra.hz, rig.structure
force, moved = seen.force[:, 1], -seen.measured[:, 1, 0] / w**2
D = s.excitation[0] ** 2 * force / (moved - s.drive_by_force * force) + w**2  # w0^2 + 2 i zeta w0 w
hz, half = np.sqrt(D.real) / (2 * np.pi), D.imag / (4 * np.pi * w)
size, weight = np.abs(moved) * D.real, 1 / np.abs(D - w**2) ** 2  # errors go with the force
names, rows = np.array([str(label).partition("@")[0] for label in spectra.labels]), []
for name in dict.fromkeys(names):
    own = np.flatnonzero(names == name)
    own = own[np.argsort(-size[own])]
    for part in np.array_split(own, 4 if np.ptp(np.log(size[own])) > 0.5 else 1):
        (f, h), n = np.average([hz[part], half[part]], axis=1, weights=weight[part]), len(part)
        off = np.average([(hz[part] - f) ** 2, (half[part] - h) ** 2], axis=1, weights=weight[part]) ** 0.5 / n**0.5
        rows.append((np.average(size[part], weights=weight[part]), f, off[0], h / f, off[1] / f))
        print(f"row {len(rows)}: {name} {rows[-1][0]:.3g} m/s2, {f:.4f} +- {off[0]:.1g} Hz, {h / f:.3%}")
Path(sys.argv[3]).write_text(columns_text(Decay(sys.argv[2], rig.channels[1].name, "m/s^2", *np.array(rows).T).columns))
