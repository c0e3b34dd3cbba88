"""Frequency responses of files: what pyuff writes is read back in SI, and modes come out of it."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import pyuff
from typer.testing import CliRunner

from hbm.cli import app
from hbm.errors import InputError
from hbm.measurement.frffile import is_frf, load_responses

HZ, RATIO = np.array([20.0, 31.0, 55.0]), np.array([0.01, 0.005, 0.008])
SHAPES = np.array([[0.9, 0.5, 1.1], [0.4, -0.9, -0.3]])
AT = np.arange(0.0, 70.0, 0.25)
G, LBF = 9.80665, 4.4482216152605


def accelerance(noise: float = 0.0) -> np.ndarray:
    """Accelerations of both places per force at the first, (n, 2) [m/s2/N]."""
    w, wr = 2 * np.pi * AT[:, None], 2 * np.pi * HZ
    exact = -(w**2) * (SHAPES[0] / (wr**2 - w**2 + 2j * RATIO * wr * w)) @ SHAPES.T
    rng = np.random.default_rng(0)
    return exact + noise * np.abs(exact).max() * (
        rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape)
    )


def data_set(data: np.ndarray, response: tuple[int, int], reference: tuple[int, int], **other: object) -> dict:
    """Data set 58 of a frequency response, in g per lbf."""
    return {
        **{"type": 58, "binary": 0, "func_type": 4, "load_case_id": 0},
        **{"rsp_ent_name": "NONE", "rsp_node": response[0], "rsp_dir": response[1]},
        **{"ref_ent_name": "NONE", "ref_node": reference[0], "ref_dir": reference[1]},
        **{"abscissa_spacing": 1, "x": AT, "abscissa_spec_data_type": 18, "data": data},
        **{"ordinate_spec_data_type": 12, "ordinate_axis_units_lab": "g"},
        **{"orddenom_spec_data_type": 13, "orddenom_axis_units_lab": "lbf"},
        **other,
    }


def written(path: Path, *sets: dict) -> Path:
    pyuff.UFF(str(path)).write_sets(list(sets), "overwrite")
    return path


def test_a_file_that_is_not_there_is_not_called_damaged(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no\.uff: no such file; must be a UFF file"):
        load_responses(tmp_path / "no.uff")


def test_uff_in_g_per_lbf_is_read_in_si(tmp_path: Path) -> None:
    H = accelerance()
    sets = [data_set(H[:, j] * LBF / G, (j + 1, 3), (1, 3)) for j in range(2)]
    found = load_responses(written(tmp_path / "frf.uff", *sets))
    assert found.channels == {"1+Z": "acceleration", "2+Z": "acceleration"}
    assert found.hz == pytest.approx(AT[1:])
    assert found.H == pytest.approx(H[1:], rel=1e-5)
    assert not found.sized


def test_a_hammer_that_went_about_is_read_by_reciprocity(tmp_path: Path) -> None:
    H = accelerance()
    label = {"ordinate_axis_units_lab": "m/s2/N", "orddenom_axis_units_lab": "NONE"}
    sets = [data_set(H[:, j], (1, 3), (j + 1, -2), **label) for j in range(2)]
    found = load_responses(written(tmp_path / "frf.unv", *sets))
    assert list(found.channels) == ["1-Y", "2-Y"]
    assert found.H == pytest.approx(H[1:], rel=1e-5)
    assert set(found.channels.values()) == {"acceleration"}


def test_coherence_says_how_noise_compares(tmp_path: Path) -> None:
    """Of a coherence of 0.5 the noise is as large as the response, of 0.9 a third of it."""
    seen = np.where(AT < 30.0, 0.5, 0.9)
    sets = [data_set(accelerance()[:, 0], (1, 3), (1, 3)), data_set(seen, (1, 3), (1, 3)) | {"func_type": 6}]
    found = load_responses(written(tmp_path / "frf.uff", *sets))
    relative = found.std[:, 0] / np.abs(found.H[:, 0])
    assert relative[AT[1:] < 30.0] == pytest.approx(1.0)
    assert relative[AT[1:] >= 30.0] == pytest.approx(1.0 / 3.0)


def test_coherence_of_one_channel_alone_does_not_count(tmp_path: Path) -> None:
    """Beside a channel of which nothing is known, both weigh by the size of what they read."""
    H = accelerance()
    sets = [data_set(H[:, j], (j + 1, 3), (1, 3)) for j in range(2)]
    of_one = data_set(np.full(len(AT), 0.9), (1, 3), (1, 3)) | {"func_type": 6}
    found = load_responses(written(tmp_path / "frf.uff", *sets, of_one))
    assert found.std == pytest.approx(np.broadcast_to(np.sqrt(np.mean(np.abs(found.H) ** 2, axis=0)), found.H.shape))


def test_responses_to_forces_here_and_there_are_refused(tmp_path: Path) -> None:
    H = accelerance()
    sets = [data_set(H[:, j], (j + 1, 3), (j + 1, 3)) for j in range(2)]
    path = written(tmp_path / "frf.uff", *sets)
    with pytest.raises(InputError, match="responses of 2 places to forces at 2; must be to a force at one place"):
        load_responses(path)
    per_motion = data_set(H[:, 0], (1, 3), (1, 3), ordinate_axis_units_lab="g", orddenom_axis_units_lab="mm")
    with pytest.raises(InputError, match="is in m/s2 per m; must be a motion per force"):
        load_responses(written(tmp_path / "other.uff", per_motion))


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("1,a,0.1,zero,", "line 2: imag = zero; must be a number"),
        ("0,a,0.1,0,", "line 2: frequency_hz = 0; must be a number > 0"),
        ("1,a,0.1,0,-1", "line 2: std = -1; must be a number > 0"),
        ("1,a,0.1,0,\n1,a,0.2,0,", "a at 1 Hz a second time; must be once"),
        ("", "no rows; must have one per frequency and channel"),
    ],
)
def test_bad_rows_are_refused(rows: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "frf.csv"
    path.write_text(f"frequency_hz,channel,real,imag,std\n{rows}\n")
    assert is_frf(path)
    with pytest.raises(InputError, match=said):
        load_responses(path)


def modal_rig(folder: Path, std: str, H: np.ndarray) -> tuple[str, dict]:
    """What the command says of responses in a CSV file with this deviation, and its table of modes."""
    path, rig = folder / "frf.csv", folder / "rig.toml"
    rows = [
        f"{f:.6g},{name},{h.real!r},{h.imag!r},{std}"
        for f, both in zip(AT[40:], H[40:].tolist(), strict=True)
        for name, h in zip(("here", "there"), both, strict=True)
    ]
    path.write_text("\n".join(["frequency_hz,channel,real,imag,std", *rows]))
    told = CliRunner().invoke(app, ["modal", str(path), "--drive", "here", "--out", str(rig)], catch_exceptions=False)
    assert told.exit_code == 0, told.output
    return told.output, tomllib.loads(rig.read_text())["modal"]


def test_the_command_finds_modes_and_their_deviations(tmp_path: Path) -> None:
    """Deviations that are not stated come from what the modes leave: about those of the noise."""
    noise = 1e-3
    H, std = accelerance(noise), noise * np.abs(accelerance()).max()
    said, stated = modal_rig(tmp_path, f"{std:.6g}", H)
    assert "no standard deviations are known" not in said
    said, unstated = modal_rig(tmp_path, "", H)
    assert "no standard deviations are known" in said
    for modal in (stated, unstated):
        stds = np.array(modal["tolerances"]["frequencies_hz"])
        assert np.all(np.abs(np.array(modal["frequencies_hz"]) - HZ) < 4.0 * stds)
        ratio = stds / np.array(stated["tolerances"]["frequencies_hz"])
        assert np.all((ratio > 0.5) & (ratio < 2.0))


def test_a_mode_that_is_hardly_known_is_doubted(tmp_path: Path) -> None:
    """A single mode, and a response 2 % off away from it: the second mode that is asked for is none."""
    w, wr = 2 * np.pi * AT, 2 * np.pi * 31.0
    rng = np.random.default_rng(0)
    H = 1.0 / (wr**2 - w**2 + 2j * 0.01 * wr * w) * (1.0 + 0.02 * (AT / 31.0 - 1.0) ** 2)
    noise = 2e-3 * float(np.abs(H).max())
    H = H + noise * (rng.standard_normal(len(AT)) + 1j * rng.standard_normal(len(AT)))
    path, rig = tmp_path / "frf.csv", tmp_path / "rig.toml"
    rows = [
        f"{f!r},here,{h.real!r},{h.imag!r},{noise!r}"
        for f, h in zip(AT[80:180].tolist(), H[80:180].tolist(), strict=True)
    ]
    path.write_text("\n".join(["frequency_hz,channel,real,imag,std", *rows]))
    asked = ["modal", str(path), "--quantity", "here=displacement", "--out", str(rig)]
    alone = CliRunner().invoke(app, [*asked, "--modes", "1"], catch_exceptions=False)
    assert alone.exit_code == 0, alone.output
    assert "damping is hardly known" not in alone.output
    both = CliRunner().invoke(app, [*asked, "--modes", "2"], catch_exceptions=False)
    assert "warning: mode 2: damping is hardly known" in both.output
