"""Frequencies in rad/s in place of Hz, of records or of a rig: told by how sensors move beside each other."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hbm.fourier import MANY
from hbm.measurement.inband import warn_far_below, warn_in_radians
from hbm.measurement.spectrafile import load_spectra, write_spectra
from hbm.rigfiles.load import load_rig
from models.plausible import PlausibilityWarning
from tests.three_modes import HZ, NOMINAL, ROWS, SENSORS, rig_of, spectra_with_noise

UPPER = (46.0, 46.6, 47.4, 48.0, 89.0, 91.0)
"""About the second and the third mode."""

EXAMPLE = Path(__file__).parents[2] / "examples" / "measured_beam"


def records(tmp_path: Path, factor: float, at: Sequence[float] = HZ) -> Path:
    """Accelerations about two modes, by a structure that is off by some percent, at frequencies times a factor."""
    rng, hz = np.random.default_rng(4), np.array(at)
    w, wr = 2 * np.pi * hz[:, None], 2 * np.pi * NOMINAL.hz
    seen = {}
    for name in SENSORS:
        rows = ROWS[name] * ROWS["drive"] * rng.uniform(0.95, 1.05, 3)
        H = -(w[:, 0] ** 2) * np.sum(rows / (wr**2 - w**2 + 2j * NOMINAL.ratio * wr * w), axis=1)
        seen[name] = np.stack([0.0 * H.real, H.real, -H.imag], axis=1)
    spectra = spectra_with_noise(rig_of(), seen, hz, np.ones(len(hz)), rng)
    write_spectra(tmp_path / "s.csv", replace(spectra, hz=factor * hz))
    return tmp_path / "s.csv"


@pytest.mark.parametrize(
    ("at", "of_records", "of_rig", "said"),
    [
        (HZ, 2 * np.pi, 1.0, "frequency_hz = 116.2 to 307.9: the rig moves so at 18.5 to 49 Hz; are they in rad/s?"),
        (UPPER, 1.0, 2 * np.pi, "at 46 to 91 Hz if its modes are 2 pi times lower; are their frequencies in rad/s?"),
    ],
)
def test_frequencies_in_radians_are_warned_of(
    tmp_path: Path, at: Sequence[float], of_records: float, of_rig: float, said: str
) -> None:
    rig = rig_of(replace(NOMINAL, hz=of_rig * NOMINAL.hz))
    with pytest.warns(PlausibilityWarning) as told:
        load_spectra(records(tmp_path, of_records, at), rig)
    (line,) = (str(one.message) for one in told)
    assert line.startswith(f"{tmp_path / 's.csv'}: ") and line.endswith(said)


def test_frequencies_in_hertz_are_not_doubted_nor_what_is_off_in_another_way(tmp_path: Path) -> None:
    """Nor accelerations in g, nor modes a tenth off, nor exchanged cables."""
    file = records(tmp_path, 1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        spectra = load_spectra(file, rig_of())
        load_spectra(file, rig_of(replace(NOMINAL, hz=1.1 * NOMINAL.hz)))
        in_g = spectra.coefficients.copy()
        in_g[:, 1:] /= 9.80665
        write_spectra(tmp_path / "g.csv", replace(spectra, coefficients=in_g, std=spectra.std / 9.80665))
        load_spectra(tmp_path / "g.csv", rig_of())
        exchanged = spectra.coefficients[:, [0, 3, 2, 1]]
        write_spectra(tmp_path / "x.csv", replace(spectra, coefficients=exchanged))
        load_spectra(tmp_path / "x.csv", rig_of())


def test_records_of_a_contact_in_radians_are_warned_of() -> None:
    """Its friction moves the resonance, not how the sensors move beside each other."""
    rig = load_rig(EXAMPLE / "rig.toml")
    spectra = load_spectra(EXAMPLE / "spectra.csv", rig)
    with pytest.warns(PlausibilityWarning, match=r"the rig moves so at 46 to 58 Hz; are they in rad/s\?$"):
        warn_in_radians(rig, replace(spectra, hz=2 * np.pi * spectra.hz))


@pytest.mark.parametrize(("hz", "doubted"), [(0.05, False), (0.05e-3, True)])
def test_of_a_multisine_its_highest_line_is_compared_with_the_modes(hz: float, doubted: bool) -> None:
    """Harmonics of a base frequency far below all modes reach them; in kHz they do not."""
    H = MANY + 100
    seen = {name: np.zeros((1, 2 * H + 1)) for name in SENSORS}
    rng = np.random.default_rng(4)
    spectra = spectra_with_noise(rig_of(), seen, np.array([hz]), np.ones(1), rng)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        warn_far_below(rig_of(), spectra)
    assert bool(told) == doubted
