"""Curves, spectra and reconstructions as labelled arrays and tables: the same numbers, with names and units."""

from dataclasses import replace

import numpy as np
import pytest

import hbm.labelled
from continuation import Kind
from continuation.geometry import Frame
from continuation.special import special
from hbm import (
    force_response,
    load_rig,
    load_spectra,
    nonlinear_mode,
    parameter_response,
    read_curves,
    reconstruct,
    sensitivities,
    steady_state,
    trace_frequency,
    write_curves,
)
from hbm.errors import InputError
from hbm.files.inversefiles import reconstruction_contents
from models.published import paper_rig

xarray = pytest.importorskip("xarray")
pytest.importorskip("pandas")
BEAM = "examples/diagnosed_beam"


@pytest.fixture(scope="module")
def curve():
    return trace_frequency(paper_rig(), (50.0, 51.0), harmonics=3)


@pytest.fixture(scope="module")
def spectra():
    rig = load_rig(f"{BEAM}/rig.toml")
    return rig, load_spectra(f"{BEAM}/spectra.csv", rig)


def test_a_curve_has_its_names_and_units(curve):
    found = curve.to_xarray()
    third = found.coefficients.sel(channel="slip", coefficient="b3")
    np.testing.assert_array_equal(third, curve["slip"].coefficients[:, 6])
    assert str(found.unit.sel(channel="slip").item()) == "m" and found.hz.attrs["units"] == "Hz"
    assert found.peak.attrs == found.rms.attrs == {"comment": hbm.labelled.EACH} and "comment" not in found.hz.attrs
    alone = replace(curve, points=tuple(replace(p, channels={"slip": p["slip"]}) for p in curve.points)).to_xarray()
    assert alone.peak.attrs == alone.rms.attrs == alone.coefficients.attrs == {"units": "m"}
    table = curve.to_dataframe()
    own = table[table.channel == "a1"]
    np.testing.assert_array_equal(own.hz, curve.hz)
    np.testing.assert_array_equal(own.peak, curve["a1"].peak)
    np.testing.assert_array_equal(own.a1, curve["a1"].coefficients[:, 1])


def test_a_curve_says_what_it_is_along_at_every_point(curve):
    assert "parameter" not in curve.to_dataframe() and curve.to_xarray().attrs["level_N"] == curve.level
    swept = force_response(curve.rig, 40.0, (1.0, 3.0), harmonics=3)
    numbered = parameter_response(curve.rig, "contact.normal_load", (80.0, 83.0), hz=40.0, harmonics=3)
    for along, key, unit in ((swept, "excitation.amplitude", "N"), (numbered, "contact.normal_load", "N")):
        found, table = along.to_xarray(), along.to_dataframe()
        assert found.attrs["parameter"] == key and found.parameter.attrs["units"] == unit
        own = table[table.channel == "drive"]
        for given in (found.parameter, own.parameter):
            np.testing.assert_array_equal(given, along.values)
        for given in (found.level, own.level):
            np.testing.assert_array_equal(given, [p.level for p in along.points])
    assert "level_N" not in swept.to_xarray().attrs
    assert " points from 1 to 3 N at 40 Hz, " in repr(swept)


def test_a_backbone_and_sensitivities_are_tables():
    mode = nonlinear_mode(paper_rig(), amplitudes=(1e-6, 1e-5), harmonics=3)
    table, found = mode.to_dataframe(), mode.to_xarray()
    for own in (table, found):
        np.testing.assert_array_equal(own.frequency_hz, mode.hz)
        np.testing.assert_array_equal(own.shape_1_imag, mode.shape[:, 0].imag)
    s = sensitivities(paper_rig(), steady_state(paper_rig(), 40.0, harmonics=3), ["beam.length", "contact.normal_load"])
    rows = s.to_dataframe()
    row = rows[(rows.parameter == "contact.normal_load") & (rows.channel == "drive")].iloc[0]
    np.testing.assert_array_equal(
        [row.a0, row.b3, row.peak], [*s["drive"].coefficients[[0, -1], 1], s["drive"].peak[1]]
    )
    assert (row.value, row.parameter_unit, row.unit) == (83.0, "N", "m")
    assert row.relative_peak == s.logarithmic("drive")["contact.normal_load"]


def test_what_is_shown_is_short_and_says_units(curve, tmp_path):
    write_curves(tmp_path / "c.csv", curve)
    (saved,) = read_curves(tmp_path / "c.csv")
    count, level = len(curve.points), curve.level
    least, most = curve["drive"].peak.min(), curve["drive"].peak.max()
    for own in (curve, saved):
        assert repr(own["drive"]) == f"{count} points, peak {least:.6g} to {most:.6g} m, 3 harmonics"
    said = f"curve of {count} points, frequency_hz from 50 to 51 Hz, level {level:g} N; channels force, "
    assert repr(saved).startswith(said)
    at = curve.branch.points[0]
    assert repr(at) == f"point at lam = {at.lam:.10g}, {at.x.size} unknowns"
    place = special(Kind.FOLD, Frame(at.state, at.tangent, at.tangent, 1), 0.0, 0.0)
    assert repr(place) == f"fold at lam = {at.lam:.10g}, {at.x.size} unknowns"


def test_spectra_have_records_and_channels(spectra):
    _, measured = spectra
    found, table = measured.to_xarray(), measured.to_dataframe()
    last = int(measured.records[-1])
    name = measured.channels[1]
    expected = measured.coefficients[-1, 1]
    np.testing.assert_array_equal(found.coefficients.sel(record=last, channel=name), expected)
    row = table[(table.record == last) & (table.channel == name)].iloc[0]
    np.testing.assert_array_equal([row.a0, row.a1, row[f"b{measured.H}"]], expected[[0, 1, -1]])
    assert row.std1 == measured.std[-1, 1, 1] and row.hz == measured.hz[-1]


def test_a_reconstruction_has_its_signals_and_energies_as_its_file_has(spectra, tmp_path):
    seen = reconstruct(*spectra)
    found, table = seen.to_xarray(), seen.to_dataframe()
    np.testing.assert_array_equal(found.friction, seen["friction"].samples)
    assert found.friction.attrs["units"] == "N" and found.friction_std.shape == found.friction.shape
    np.testing.assert_array_equal(found.frequency_hz, seen.spectra.hz)
    file = tmp_path / "reconstruction.nc"
    file.write_bytes(reconstruction_contents(seen, netcdf=True)["reconstruction.nc"])
    with xarray.open_dataset(file) as saved:
        xarray.testing.assert_equal(saved.load(), found)
    np.testing.assert_array_equal(table.energy_per_cycle, seen.energy_per_cycle.value)
    assert len(table) == len(seen.spectra)


def test_a_package_that_is_missing_is_said_in_one_line(curve, monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(hbm.labelled, "import_module", missing)
    with pytest.raises(InputError, match="to_xarray: needs xarray; install it with"):
        curve.to_xarray()
