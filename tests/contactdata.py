"""Spectra of the paper's beam at two levels, a few records each, with noise; and a spectra file of them."""

import csv
from functools import cache
from pathlib import Path

import numpy as np

from hbm.inverse.reconstruct import reconstruct
from hbm.inverse.reconstruction import Reconstruction
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from hbm.response.trace import steady_state
from hbm.rigfiles.load import load_rig
from models import Rig

RIG_FILE = Path(__file__).parents[1] / "examples" / "paper_beam.toml"
STATES = ((2.5, 48.0), (2.5, 52.0), (2.5, 55.0), (6.5, 56.0), (6.5, 53.0), (6.5, 50.0))
H = 7


@cache
def rig() -> Rig:
    return load_rig(RIG_FILE)


@cache
def spectra() -> MeasuredSpectra:
    """Harmonics 1..7 of a solution with 9, noise of 0.02 m/s2 and 2 mN."""
    rng = np.random.default_rng(1)
    points = [steady_state(rig(), hz, level=level, harmonics=9, samples=128) for level, hz in STATES]
    coefficients, std = {}, {}
    for channel in rig().channels:
        noise = 2e-3 if channel.quantity == "force" else 0.02
        if channel.quantity == "force":
            exact = np.zeros((len(STATES), 19))
            exact[:, 1] = [level for level, _ in STATES]
        else:
            exact = np.array([p.channels[channel.name].coefficients for p in points])
        kept = exact[:, np.r_[0 : H + 1, 10 : 10 + H]]
        coefficients[channel.name] = kept + noise * rng.standard_normal(kept.shape)
        std[channel.name] = np.full((len(STATES), H + 1), noise)
        coefficients[channel.name][:, 0] = std[channel.name][:, 0] = np.nan
    level, hz = np.array(STATES).T
    return spectra_of(rig(), hz, level, coefficients, std, "six records")


@cache
def reconstruction() -> Reconstruction:
    return reconstruct(rig(), spectra())


def write_spectra_file(path: Path) -> Path:
    s = spectra()
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow("record,level,frequency_hz,channel,harmonic,cos,sin,std".split(","))
        for i, record in enumerate(s.records.tolist()):
            for j, name in enumerate(s.channels):
                for k in range(1, H + 1):
                    pair = s.coefficients[i, j, k], s.coefficients[i, j, H + k]
                    rows.writerow([record, s.level[i], s.hz[i], name, k, *pair, s.std[i, j, k]])
    return path
