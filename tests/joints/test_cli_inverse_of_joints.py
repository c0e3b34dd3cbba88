"""The command ``hbm inverse`` on a rig with joints: what it writes, how often the truth is in it, what it refuses."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from typer.testing import CliRunner, Result

from hbm import contact_errors
from hbm.cli import app
from hbm.files.jointinverse import FILES
from hbm.inverse.jointed import reconstruct_joints
from hbm.measurement.spectra import MeasuredSpectra
from hbm.measurement.spectrafile import load_spectra, write_spectra
from hbm.response.trace import steady_state
from hbm.rigfiles.load import load_rig
from models.jointed import JointedRig

FILE = """
name = "two sliders"
beam = { length = 0.606, width = 0.03888, thickness = 0.00478, youngs_modulus = 210e9, density = 7800.0, modes = 6 }
damping = { modal_ratios = [0.01] }
excitation = { amplitude = 20.0, position = 0.555 }
channels = [
    { name = "f", quantity = "force" },
    { name = "a1", quantity = "acceleration", position = 0.1 },
    { name = "a2", quantity = "acceleration", position = 0.3 },
    { name = "a3", quantity = "acceleration", position = 0.5 },
]
[[joints]]
name = "bolt 1"
law = "coulomb-penalty"
mu = 0.1
critical_slip = 1e-4
normal_load = 40.0
at = "y(0.25)"
[[joints]]
name = "two"
law = "coulomb-penalty"
mu = 0.1
critical_slip = 5e-4
normal_load = 10.0
at = "y(0.4)"
"""
H, MORE, STD, DRAWS = 5, 11, 0.03, 40
HZ = (47.0, 48.0)


def run(*args: str) -> Result:
    return CliRunner().invoke(app, ["inverse", *args], prog_name="hbm")


def kept(coefficients: np.ndarray) -> np.ndarray:
    full = coefficients.shape[-1] // 2
    return np.concatenate([coefficients[..., : H + 1], coefficients[..., full + 1 : full + 1 + H]], axis=-1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("joints")
    (folder / "rig.toml").write_text(FILE)
    return folder


@pytest.fixture(scope="module")
def truth(folder: Path) -> dict[str, np.ndarray]:
    """Simulated with twice the modes, more harmonics and samples; noise and a file of spectra made of it."""
    rig = load_rig(folder / "rig.toml")
    assert isinstance(rig, JointedRig)
    finer = rig.with_modes(12)
    solutions = [steady_state(finer, hz, harmonics=MORE, samples=512) for hz in HZ]
    names = tuple(c.name for c in rig.channels)
    exact = np.array([[kept(s[name].coefficients) for name in names] for s in solutions]).repeat(DRAWS, axis=0)
    noisy = exact + STD * np.random.default_rng(3).normal(size=exact.shape)
    records, count = np.arange(1, len(exact) + 1), len(exact)
    std = np.full((count, len(names), H + 1), STD)
    levels = np.full(count, 20.0)
    write_spectra(
        folder / "spectra.csv",
        MeasuredSpectra("made", records, levels, np.repeat(HZ, DRAWS), names, noisy, std),
    )
    wanted = [*rig.forces, *rig.motions]
    return {name: np.array([s[name].coefficients for s in solutions]).repeat(DRAWS, axis=0) for name in wanted}


def table(path: Path) -> dict[str, np.ndarray]:
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0]}


def test_the_truth_lies_within_the_stated_intervals_at_the_stated_rate(
    folder: Path, truth: dict[str, np.ndarray], tmp_path: Path
) -> None:
    result = run(str(folder / "rig.toml"), str(folder / "spectra.csv"), "--out", str(tmp_path / "out"))
    assert (result.exit_code, result.stderr) == (0, "")
    files = set(FILES) - {"calibrated.toml"}  # sensors ask for no other numbers
    written = {line for line in result.stdout.splitlines() if line.startswith("wrote ")}
    assert {f"wrote {tmp_path / 'out' / name}" for name in files} == written
    found = table(tmp_path / "out" / "harmonics.csv")
    inside = []
    for name, exact in truth.items():
        moving = found["harmonic"] > 0
        assert np.isnan(found[f"{name}_cos"][~moving]).all()  # means are not known
        for part, values in (("cos", kept(exact)[:, 1 : H + 1]), ("sin", kept(exact)[:, H + 1 :])):
            pull = (found[f"{name}_{part}"][moving] - values.ravel()) / found[f"{name}_std"][moving]
            inside.append(np.abs(pull) < 1.96)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.015)
    signals = table(tmp_path / "out" / "reconstruction.csv")
    peak, said = np.abs(signals["bolt 1.force"]).max(), " ".join(result.stdout.split())
    assert peak > 1.03 * 4.0  # of five harmonics, where the limit is 0.1 times 40 N: said to be no limit
    assert "their series overshoots a limit at which friction slides" in said
    phase = 2 * np.pi * signals["phase"][:256, None] * np.arange(1, MORE + 1)
    waves = np.hstack([np.zeros((256, 1)), np.cos(phase), np.sin(phase)])  # means are not known
    noise_alone, inside = [], []
    for name, exact in truth.items():
        samples, std = (signals[column].reshape(-1, 256) for column in (name, f"{name}_std"))
        by_noise = np.linalg.norm(found[f"{name}_std"].reshape(-1, H + 1)[:, 1:], axis=1)
        noise_alone.append(np.abs(samples - kept(exact)[:, 1:] @ kept(waves).T[1:]) < 1.96 * by_noise[:, None])
        inside.append(np.abs(samples - exact @ waves.T) < 1.96 * std)
    assert np.mean(noise_alone) == pytest.approx(0.95, abs=0.03)  # samples of a record err together
    assert np.mean(inside) > 0.95  # with harmonics that were not measured, which may be less than expected


def test_forces_are_as_uncertain_as_the_rig_file_makes_them(
    folder: Path, truth: dict[str, np.ndarray], tmp_path: Path
) -> None:
    """A modulus 1 % too large moves all forces; the sensors ask for the right one, and with it forces are right."""
    rig, out = tmp_path / "rig.toml", tmp_path / "out"
    rig.write_text(FILE.replace("210e9", "212.1e9"))
    result = run(str(rig), str(folder / "spectra.csv"), "--out", str(out))
    assert "sensors agree better with beam.youngs_modulus = 2." in result.stdout
    phase = 2 * np.pi * np.arange(256)[:, None] / 256 * np.arange(1, MORE + 1)
    waves = np.hstack([np.zeros((256, 1)), np.cos(phase), np.sin(phase)])  # means are not known
    missed = []
    for file in (rig, out / "calibrated.toml"):
        loaded = load_rig(file)
        errors = contact_errors(reconstruct_joints(loaded, load_spectra(folder / "spectra.csv", loaded)))
        off = {force: errors.stated[force].samples - truth[force] @ waves.T for force in loaded.forces}
        missed.append([np.sqrt(np.mean(off[force] ** 2)) for force in loaded.forces])
        for force in loaded.forces:
            pulls = off[force] / errors.stated[force].whole_std
            assert 0.3 < np.sqrt(np.mean(pulls**2)) < 1.5
    assert missed[1][1] < 0.6 * missed[0][1]  # of the other noise is the larger part


def test_tables_and_arrays_are_the_reconstruction(folder: Path, truth: object, tmp_path: Path) -> None:
    assert (
        run(
            str(folder / "rig.toml"), str(folder / "spectra.csv"), "--out", str(tmp_path), "--record", "2", "50"
        ).exit_code
        == 0
    )
    rig = load_rig(folder / "rig.toml")
    assert isinstance(rig, JointedRig)
    found = reconstruct_joints(rig, load_spectra(folder / "spectra.csv", rig).select(records=[2, 50]))
    energy, arrays = table(tmp_path / "energy.csv"), loadmat(tmp_path / "reconstruction.mat", simplify_cells=True)
    assert energy["record"].tolist() == [2.0, 50.0]
    np.testing.assert_allclose(energy["bolt 1.energy_per_cycle"], found.energy["bolt 1"].value, rtol=1e-12)
    np.testing.assert_allclose(energy["bolt 1.energy_per_cycle_std"], found.energy["bolt 1"].std, rtol=1e-12)
    np.testing.assert_allclose(arrays["bolt_1_force"], found["bolt 1.force"].samples, rtol=1e-12)
    np.testing.assert_allclose(arrays["two_motion_harmonic_std"], found["two.motion"].coefficient_std, rtol=1e-12)
    assert arrays["units"]["two_motion"] == "m"
    labelled, rows = found.to_xarray(), found.to_dataframe()
    np.testing.assert_array_equal(labelled["two_force"].sel(record=50), found["two.force"].samples[1])
    assert labelled["two_force"].units == "N"
    assert rows["two.energy_per_cycle"].tolist() == found.energy["two"].value.tolist()
    assert "what happens at the joints" in (tmp_path / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--design"], "inverse: --design and rig.toml, which has [[joints]]; must be a rig with [contact]"),
        (
            ["--out", "out", "--formulation", "modal"],
            "inverse: --formulation and rig.toml, which has [[joints]]; must be a rig with [contact]",
        ),
        (["--out", "out", "--record", "99"], "spectra.csv: no record 99; records are"),
    ],
)
def test_what_goes_with_one_contact_alone_is_refused(
    options: list[str], message: str, folder: Path, truth: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    result = run("rig.toml", "spectra.csv", *options)
    assert result.exit_code == 2
    assert result.stderr.startswith(message) and result.stderr.count("\n") == 1
    assert not (folder / "out").exists()


def test_too_few_sensors_are_refused_in_one_line(
    folder: Path, truth: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    few = [
        line for line in (folder / "spectra.csv").read_text().splitlines() if ",a2," not in line and ",a3," not in line
    ]
    Path("few.csv").write_text("\n".join(few) + "\n")
    result = run(str(folder / "rig.toml"), "few.csv", "--out", "out")
    assert (result.exit_code, result.stderr) == (
        2,
        "few.csv: 1 response channels measured and 2 joint forces unknown; must be at least as many channels\n",
    )
    assert not Path("out").exists()
