"""Modes that damp one another, from responses of lumped masses solved directly: exact, without any modes."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh
from typer.testing import CliRunner

from hbm import load_rig, steady_state
from hbm.cli import app
from hbm.errors import InputError
from hbm.files.modalrig import _row
from hbm.identification.modalfit import fit_modes
from hbm.measurement.responses import FrequencyResponses
from hbm.outputerror.nominal import tolerances
from models.bodies import ModalModel

NAMES = ("a", "b", "c")
MASS = np.diag([1.0, 1.0, 1.3])
CLOSE = (2 * np.pi * 20.0) ** 2 * np.array([[1.0, -0.02, -0.3], [-0.02, 1.06, -0.5], [-0.3, -0.5, 3.4]])
APART = (2 * np.pi * 20.0) ** 2 * np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.5]])
RATIO, NOISE = 0.004, 1e-3
"""Damping ratio without a dashpot, and noise of the rms of each channel."""

AT_A, B_TO_C = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, -1.0])
FORCE = 2.0


class Structure:
    """Masses on springs with a dashpot across a row of displacements, driven at the first."""

    def __init__(self, K: np.ndarray, row: np.ndarray, dashpot: float) -> None:
        squared, self.shapes = eigh(K, MASS)
        self.shapes *= np.sign(self.shapes[0])  # along the force
        self.hz = np.sqrt(squared) / (2 * np.pi)
        modal = MASS @ self.shapes
        self.K, self.C = K, modal @ np.diag(2 * RATIO * np.sqrt(squared)) @ modal.T + dashpot * np.outer(row, row)
        self.damping = self.shapes.T @ self.C @ self.shapes
        self.at = np.geomspace(0.75 * self.hz[0], 1.25 * self.hz[-1], 300)

    def responses(self, hz: np.ndarray) -> np.ndarray:
        w = 2 * np.pi * hz[:, None, None]
        force = np.broadcast_to(np.eye(3)[:, :1], (len(hz), 3, 1))
        return -(w[:, 0] ** 2) * np.linalg.solve(self.K - w**2 * MASS + 1j * w * self.C, force)[:, :, 0]

    def measured(self, seed: int, noise: float = NOISE) -> FrequencyResponses:
        rng, exact = np.random.default_rng(seed), self.responses(self.at)
        std = noise * np.broadcast_to(np.sqrt(np.mean(np.abs(exact) ** 2, axis=0)), exact.shape)
        both = rng.standard_normal((2, *exact.shape))
        return FrequencyResponses(
            self.at, dict.fromkeys(NAMES, "acceleration"), exact + std * (both[0] + 1j * both[1]), std
        )


STRUCTURES = {"close": Structure(CLOSE, AT_A, 2.0), "apart": Structure(APART, B_TO_C, 1.0)}
NORMAL = Structure(CLOSE, AT_A, 0.0)
UPPER = np.triu_indices(3)


@pytest.mark.parametrize("structure", STRUCTURES.values(), ids=STRUCTURES)
def test_a_dashpot_between_modes_is_found_within_deviations(structure: Structure) -> None:
    """Pulls of 10 x 18 numbers; as normal modes some frequency was off by 7 to 45 deviations."""
    pulls, chi2 = [], []
    for seed in range(10):
        m = fit_modes(structure.measured(seed), drive="a")
        assert m.damping is not None and m.damping_std is not None and len(m) == 3
        shapes, std, _ = m.shapes("a")
        pulls.append((m.hz - structure.hz) / m.hz_std)
        known = UPPER[0][m.damping_std[UPPER] > 0.0], UPPER[1][m.damping_std[UPPER] > 0.0]
        pulls.append((m.damping - structure.damping)[known] / m.damping_std[known])
        pulls.append(((shapes - structure.shapes) / std).ravel())
        assert m.ratio == pytest.approx(np.diag(m.damping) / (4 * np.pi * m.hz))
        chi2.append(m.chi2_reduced)
    found = np.concatenate(pulls)
    assert np.sqrt(np.mean(found**2)) == pytest.approx(1.0, abs=0.15) and np.abs(found).max() < 4.5
    assert np.mean(chi2) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("noise", [1e-4, NOISE, 0.02])
def test_normal_modes_are_fitted_as_such(noise: float) -> None:
    for seed in range(4):
        m = fit_modes(NORMAL.measured(seed, noise), drive="a")
        assert m.damping is None and m.phases_misfit is None and len(m) == 3


def test_what_takes_next_to_no_energy_but_in_one_dashpot_is_written_as_taking_some() -> None:
    """So noisy that the best symmetric matrix would often give energy."""
    structure = Structure(CLOSE, AT_A, 8.0)
    for seed in range(3):
        D = fit_modes(structure.measured(seed, 0.05), drive="a").damping
        assert D is not None and np.linalg.eigvalsh(D)[0] >= -1e-12 * D.max()


def csv_of(structure: Structure, path: Path, seed: int = 1) -> None:
    r = structure.measured(seed)
    rows = [
        f"{hz!r},{name},{h.real!r},{h.imag!r},{std!r}"
        for hz, H, S in zip(r.hz.tolist(), r.H.tolist(), r.own_std.tolist(), strict=True)
        for name, h, std in zip(NAMES, H, S, strict=True)
    ]
    path.write_text("\n".join(["frequency_hz,channel,real,imag,std", *rows]) + "\n")


def modal(folder: Path, *args: str) -> str:
    result = CliRunner().invoke(app, ["modal", str(folder / "frf.csv"), "--out", str(folder / "rig.toml"), *args])
    assert result.exit_code == 0, result.output
    return " ".join(result.output.split())


@pytest.mark.parametrize("structure", STRUCTURES.values(), ids=STRUCTURES)
def test_the_rig_file_answers_as_the_structure(structure: Structure, tmp_path: Path) -> None:
    csv_of(structure, tmp_path / "frf.csv")
    said = modal(tmp_path, "--drive", "a")
    assert "modes damp one another" in said and "warning" not in said
    table = tomllib.loads((tmp_path / "rig.toml").read_text())
    assert "damping" not in table and "modal_ratios" not in table["modal"]["tolerances"]
    rig = load_rig(tmp_path / "rig.toml")
    for hz in (*structure.hz, *(structure.hz[1:] - 0.3), structure.at[0]):
        state = steady_state(rig, float(hz), level=FORCE, harmonics=1)
        expected = FORCE * structure.responses(np.array([hz]))[0]
        found = np.array([state[name].coefficients for name in NAMES])
        assert np.abs(found[:, 1] - 1j * found[:, 2] - expected).max() < 0.01 * np.abs(expected).max()
    out = tmp_path / "curve.csv"
    band = ("--from", f"{structure.hz[0] - 1:.3f}", "--to", f"{structure.hz[1] + 1:.3f}")
    result = CliRunner().invoke(app, ["frf", str(tmp_path / "rig.toml"), *band, "--out", str(out)])
    assert result.exit_code == 0 and out.exists(), result.output


def test_without_a_drive_it_is_said_what_is_missing(tmp_path: Path) -> None:
    csv_of(STRUCTURES["close"], tmp_path / "frf.csv")
    said = modal(tmp_path, "--modes", "3")
    assert "shapes are not real" in said and "--drive" in said


def test_what_modes_beyond_the_band_damp_is_said_not_to_fit(tmp_path: Path) -> None:
    """Of one mode in a narrow band the shape is not real where the others are damped with it."""
    structure = Structure(APART, B_TO_C, 40.0)
    whole = structure.measured(1, 1e-4)
    m = fit_modes(whole.between(structure.hz[0] - 2.0, structure.hz[0] + 2.0), 1, drive="a")
    assert m.damping is None and m.phases_misfit is not None and m.phases_misfit < 0.5 * m.chi2_reduced


DAMPED = ModalModel((20.0, 21.0), {"a": (1.0, 0.5)}, damping_matrix=((1.0, 0.4), (0.4, 2.0)))


def test_entries_of_the_damping_are_numbers_and_take_energy_only() -> None:
    assert {key for key in DAMPED.numbers if "damping" in key} == {
        f"modal.damping_matrix[{i}][{j}]" for i, j in ((1, 1), (1, 2), (2, 2))
    }
    changed = DAMPED.with_numbers({"modal.damping_matrix[1][2]": 0.5})
    assert changed.damping_matrix == ((1.0, 0.5), (0.5, 2.0))
    beyond = DAMPED.with_numbers({"modal.damping_matrix[1][2]": 1.5}).damping_matrix
    D = np.array(beyond)
    asked = np.array([[1.0, 1.5], [1.5, 2.0]])
    assert D == pytest.approx(D.T) and np.linalg.eigvalsh(D)[0] == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.norm(D - asked) == pytest.approx(-np.linalg.eigvalsh(asked)[0])


def test_deviations_of_the_damping_are_those_of_a_diagnosis(tmp_path: Path) -> None:
    csv_of(STRUCTURES["close"], tmp_path / "frf.csv")
    modal(tmp_path, "--drive", "a")
    text = (tmp_path / "rig.toml").read_text()
    stated = tomllib.loads(text)["modal"]
    known = tolerances(load_rig(tmp_path / "rig.toml"), NAMES)
    std, D = stated["tolerances"]["damping_matrix"], stated["damping_matrix"]
    assert known["modal.damping_matrix[1][2]"] == pytest.approx(std[0][1] / abs(D[0][1]))
    assert known["modal.damping_matrix[3][3]"] == pytest.approx(std[2][2] / D[2][2])
    head, _, tail = text.rpartition("damping_matrix = ")  # of the tolerances
    rest = tail.partition("\n")[2]
    for wrong, said in (
        ("[[0.1, 0.1]]", "has 1 rows; must have 3"),
        ("[[0.1, 0.1, 0.1], [0.2, 0.1, 0.1], [0.1, 0.1, 0.1]]", r"\[2\]\[1\] = 0.2; must be as \[1\]\[2\]"),
        ("[[0.1, 0.1], [0.1, 0.1], [0.1, 0.1]]", r"damping_matrix\[1\] has 2 entries; must have 3"),
    ):
        (tmp_path / "wrong.toml").write_text(f"{head}damping_matrix = {wrong}\n{rest}")
        with pytest.raises(InputError, match=said):
            load_rig(tmp_path / "wrong.toml")


def test_numbers_of_two_digits_are_toml() -> None:
    """A deviation of 92 1/s was written as `92.`, which no reader takes."""
    written = _row([92.4, 9.24, 924.0, 0.0, 1.2e-7], 2)
    assert tomllib.loads(f"row = {written}")["row"] == [92.0, 9.2, 920.0, 0.0, 1.2e-7]
