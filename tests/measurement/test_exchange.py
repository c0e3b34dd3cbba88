"""Files for other programs: written by us, read with the library that their users read them with, and the reverse."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyuff
import xarray
from scipy.io import loadmat, savemat

from hbm.errors import InputError
from hbm.measurement.exchange import write_arrays, write_recording
from hbm.measurement.historyfile import load_history
from hbm.measurement.recording import recording
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from hbm.measurement.spectrafile import load_spectra, write_spectra
from models import Channel, Rig
from models.published import paper_rig

UNITS = {"force": "N", "a1": "m/s2"}
H = 3


@pytest.fixture(scope="module")
def rig() -> Rig:
    return replace(paper_rig(), channels=(Channel("force", "force", 0.555), Channel("a1", "acceleration", 0.1)))


@pytest.fixture(scope="module")
def spectra(rig: Rig) -> MeasuredSpectra:
    """Two records of two channels; harmonic 2 of a1 was not measured, nor anything of it in record 2."""
    rng = np.random.default_rng(3)
    coefficients = {name: rng.standard_normal((2, 2 * H + 1)) for name in UNITS}
    std = {name: rng.random((2, H + 1)) for name in UNITS}
    coefficients["a1"][:, [2, H + 2]] = std["a1"][:, [2]] = np.nan
    coefficients["a1"][1], std["a1"][1] = np.nan, np.nan
    return spectra_of(rig, np.array([48.5, 54.112]), np.array([2.0, 4.7]), coefficients, std)


def refusal(action: Any, *args: Any) -> str:
    with pytest.raises(InputError) as refused:
        action(*args)
    return str(refused.value)


# -------------------------------------------------------------------------------------------------------------- NetCDF


def test_xarray_reads_dimensions_coordinates_and_units(spectra: MeasuredSpectra, tmp_path: Path) -> None:
    write_spectra(tmp_path / "s.nc", spectra, UNITS)
    with xarray.open_dataset(tmp_path / "s.nc", engine="h5netcdf") as found:
        assert dict(found.sizes) == {"record": 2, "channel": 2, "harmonic": H + 1, "part": 2}
        c = spectra.complex("force")[1, 3]
        third = found["coefficient"].sel(record=2, channel="force", harmonic=3)
        assert (float(third.sel(part="cos")), float(third.sel(part="sin"))) == (c.real, -c.imag)
        assert float(found["coefficient"].sel(record=1, channel="force", harmonic=0, part="sin")) == 0.0
        assert float(found["std"].sel(record=1, channel="a1", harmonic=3)) == spectra.std[0, 1, 3]
        assert np.isnan(found["coefficient"].sel(record=1, channel="a1", harmonic=2)).all()
        assert found["frequency_hz"].values.tolist() == spectra.hz.tolist()
        assert (found["level"].attrs["units"], found["frequency_hz"].attrs["units"]) == ("N", "Hz")
        assert found["unit"].sel(channel="a1").item() == "m/s2"


def test_named_arrays_go_to_netcdf_and_mat(tmp_path: Path) -> None:
    slip = np.arange(6.0).reshape(2, 3)
    arrays = {"slip": (("record", "phase"), slip, "m")}
    phase = np.array([0.0, 0.3, 0.6])
    coordinates = {"record": (("record",), np.array([4, 9]), "1"), "phase": (("phase",), phase, "1")}
    for ending in ("nc", "mat"):
        write_arrays(tmp_path / f"r.{ending}", arrays, coordinates)
    with xarray.open_dataset(tmp_path / "r.nc", engine="h5netcdf") as found:
        assert found["slip"].sel(record=9, phase=0.3).item() == 4.0
        assert found["slip"].attrs["units"] == "m"
    found = loadmat(tmp_path / "r.mat", simplify_cells=True)
    np.testing.assert_array_equal(found["slip"], slip)
    assert (found["record"].tolist(), found["units"]["slip"]) == ([4, 9], "m")


def test_a_missing_package_is_named(spectra: MeasuredSpectra, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "s.nc"
    line = f"{path}: needs {{}}; install it with: pip install 'casadi-hbm[io]'"
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "h5netcdf", None)
        assert refusal(write_spectra, path, spectra) == line.format("h5netcdf")
        assert list(tmp_path.iterdir()) == []
    write_spectra(path, spectra)
    monkeypatch.setitem(sys.modules, "xarray", None)
    assert refusal(load_spectra, path) == line.format("xarray")


# ----------------------------------------------------------------------------------------------------------------- MAT


def test_matlab_sees_vectors_cells_and_arrays(spectra: MeasuredSpectra, tmp_path: Path) -> None:
    write_spectra(tmp_path / "s.mat", spectra, UNITS)
    found = loadmat(tmp_path / "s.mat", simplify_cells=True)
    assert (found["channel"].tolist(), found["unit"].tolist()) == (["force", "a1"], ["N", "m/s2"])
    assert found["frequency_hz"].tolist() == spectra.hz.tolist()
    np.testing.assert_array_equal(found["coefficient"][..., 0], spectra.coefficients[:, :, : H + 1])
    np.testing.assert_array_equal(found["coefficient"][:, :, 1:, 1], spectra.coefficients[:, :, H + 1 :])
    np.testing.assert_array_equal(found["std"], spectra.std)


def mat(spectra: MeasuredSpectra) -> dict[str, Any]:
    """What MATLAB would save: every number a double, one record and one channel squeezed."""
    return {
        **{"record": 7.0, "level": 2.0, "frequency_hz": 50.0, "channel": np.array(["a1"], dtype=object)},
        **{"harmonic": np.array([1.0, 3.0]), "std": np.array([[[0.1, 0.2]]])},
        "coefficient": np.array([[[[1.0, 2.0], [3.0, -4.0]]]]),
    }


def test_a_mat_file_of_matlab_is_read(rig: Rig, spectra: MeasuredSpectra, tmp_path: Path) -> None:
    savemat(tmp_path / "s.mat", mat(spectra))
    found = load_spectra(tmp_path / "s.mat", rig)
    assert (found.records.tolist(), found.hz.tolist(), found.channels) == ([7], [50.0], ("a1",))
    assert found.complex("a1")[0, [1, 3]].tolist() == [1 - 2j, 3 + 4j]


@pytest.mark.parametrize(
    ("changed", "line"),
    [
        (
            {"std": np.zeros((1, 1, 2))},
            " record 7, a1, harmonic 1: std = 0; must be > 0, for each of cos and sin; "
            "estimate it from the time history with hbm spectra",
        ),
        (
            {"channel": np.array(["a9"], dtype=object)},
            ' record 7, a9, harmonic 1: channel "a9" is not in the rig; channels are force, a1',
        ),
        ({"harmonic": np.array([1.0, 1.5])}, ' record 7, a1, harmonic 1.5: harmonic = "1.5"; must be a whole number'),
        ({"std": np.ones((3, 2))}, ": std is 3 x 2; must be 1 x 1 x 2"),
    ],
)
def test_a_bad_mat_file_is_refused(
    changed: dict[str, Any], line: str, rig: Rig, spectra: MeasuredSpectra, tmp_path: Path
) -> None:
    path = tmp_path / "s.mat"
    savemat(path, mat(spectra) | changed)
    assert refusal(load_spectra, path, rig) == f"{path}{line}"


def test_other_mat_and_netcdf_files_are_refused(rig: Rig, tmp_path: Path) -> None:
    path = tmp_path / "s.mat"
    savemat(path, {"x": 1.0})
    assert refusal(load_spectra, path, rig) == (
        f"{path}: no variable record; must be a spectra file, as hbm spectra writes it"
    )
    for ending, kind in {"nc": "NetCDF-4", "mat": "a MAT file (v5)"}.items():
        path = tmp_path / f"g.{ending}"
        path.write_bytes(bytes(range(256)) * 3)
        message = refusal(load_spectra, path, rig)
        assert message.startswith(f"{path}: cannot be read (") and message.endswith(f"); must be {kind}")
        assert "\n" not in message


# --------------------------------------------------------------------------------------------------------------- UFF58


def test_pyuff_reads_amplitudes_and_deviations(spectra: MeasuredSpectra, tmp_path: Path) -> None:
    """12 digits of a value, 6 of a frequency."""
    write_spectra(tmp_path / "s.uff", spectra, UNITS)
    sets = pyuff.UFF(str(tmp_path / "s.uff")).read_sets()
    assert [(s["rsp_ent_name"], s["rsp_node"], s["id1"]) for s in sets] == [
        (name, node, what)
        for name, node in (("force", 1), ("a1", 2), ("force", 1))
        for what in ("harmonic amplitudes", "standard deviations")
    ]
    assert [s["ordinate_axis_units_lab"] for s in sets] == ["N", "N", "m/s2", "m/s2", "N", "N"]
    assert sets[4]["id4"] == "record 2, level 4.7 N, fundamental 54.112 Hz"
    np.testing.assert_allclose(sets[4]["data"], spectra.complex("force")[1], rtol=1e-11)
    np.testing.assert_allclose(sets[4]["x"], 54.112 * np.arange(H + 1), rtol=1e-5)
    kept = [0, 1, 3]  # harmonic 2 was not measured
    np.testing.assert_allclose(sets[2]["x"], 48.5 * np.array(kept), rtol=1e-5)
    np.testing.assert_allclose(sets[2]["data"], spectra.complex("a1")[0, kept], rtol=1e-11)
    np.testing.assert_allclose(sets[3]["data"], spectra.std[0, 1, kept], rtol=1e-11)


def test_a_recording_goes_to_uff_and_comes_back(tmp_path: Path) -> None:
    """The step, 1/51200 s, has more digits than the format; it is found all the same."""
    t = np.arange(1000) / 51200.0
    signals = {"force": np.cos(300.0 * t), "a1": np.sin(300.0 * t)}
    write_recording(tmp_path / "h.uff", recording("h", t, signals, UNITS))
    sets = pyuff.UFF(str(tmp_path / "h.uff")).read_sets()
    assert [(s["func_type"], s["ordinate_spec_data_type"]) for s in sets] == [(1, 13), (1, 12)]
    np.testing.assert_allclose(sets[1]["data"], signals["a1"], atol=1e-11)
    found = load_history(tmp_path / "h.uff")
    np.testing.assert_allclose(found.time, t, rtol=1e-13)
    np.testing.assert_allclose(found.channels["a1"], signals["a1"], atol=1e-11)
    assert dict(found.units) == UNITS


def test_what_uff_cannot_hold_is_refused(rig: Rig, tmp_path: Path) -> None:
    path, t = tmp_path / "h.uff", np.array([0.0, 1.0, 3.0])
    assert refusal(write_recording, path, recording("h", t, {"a1": t})) == (
        f"{path}: time steps from 1 to 2 s; must be equal for UFF58"
    )
    assert refusal(write_recording, path, recording("h", np.arange(3.0), {"accelerometer 1": t})) == (
        f'{path}: channel "accelerometer 1"; must be ASCII of at most 10 characters in UFF58'
    )
    assert list(tmp_path.iterdir()) == []
