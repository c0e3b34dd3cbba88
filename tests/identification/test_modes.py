"""Modes fitted to frequency responses of a modal model that is known: deviations as stated, and the rig file back."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hbm import load_rig, steady_state
from hbm.cli import app
from hbm.commands.modal import _print
from hbm.errors import InputError
from hbm.files.modalrig import modal_rig_text
from hbm.identification.modalfit import fit_modes
from hbm.measurement.responses import FrequencyResponses
from hbm.measurement.spectra import MeasuredSpectra
from hbm.measurement.spectrafile import write_spectra
from hbm.outputerror.nominal import tolerances

HZ = np.array([20.0, 31.0, 33.0, 55.0, 300.0])
RATIO = np.array([0.01, 0.004, 0.006, 0.008, 0.01])
SHAPES = np.array([[0.9, 0.5, 0.7, 1.1, 0.8], [0.4, -0.9, 0.6, -0.3, 1.0], [-0.2, 0.8, 0.5, 0.9, -0.7]])
AT = np.arange(15.0, 70.0, 0.15)
CHANNELS = {"a1": "acceleration", "v2": "velocity", "x3": "displacement"}
NOISE = np.array([0.02, 1e-4, 6e-7])  # about 0.2 % of the peaks


def responses(hz: np.ndarray) -> np.ndarray:
    """Per force at the place of a1; the fifth mode lies far above the band."""
    w, wr = 2 * np.pi * hz[:, None], 2 * np.pi * HZ
    q = SHAPES[0] / (wr**2 - w**2 + 2j * RATIO * wr * w)
    return (1j * w) ** np.array([2, 1, 0]) * (q @ SHAPES.T)


def noisy(seed: int, noise: np.ndarray = NOISE) -> FrequencyResponses:
    rng = np.random.default_rng(seed)
    both = rng.standard_normal((2, len(AT), 3))
    return FrequencyResponses(
        AT, CHANNELS, responses(AT) + noise * (both[0] + 1j * both[1]), np.broadcast_to(noise, (len(AT), 3))
    )


@pytest.fixture(scope="module")
def fits():
    return [fit_modes(noisy(seed)) for seed in range(6)]


def test_as_many_modes_as_there_are_in_the_band(fits) -> None:
    assert [len(m) for m in fits] == [4] * 6
    assert all(m.chi2_reduced == pytest.approx(1.0, abs=0.12) for m in fits)


def test_a_force_that_is_not_exact_errs_all_channels_alike() -> None:
    """Pulls of 8 x 8 numbers, where the error of the force is ten times that of the channels at the peaks."""
    pulls, chi2, exact, off = [], [], responses(AT), 0.02
    own = np.broadcast_to(NOISE, exact.shape)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        read, force = rng.standard_normal((2, len(AT), 3)), rng.standard_normal((2, len(AT), 1))
        seen = exact * (1.0 + off * (force[0] + 1j * force[1])) + own * (read[0] + 1j * read[1])
        m = fit_modes(FrequencyResponses(AT, CHANNELS, seen, own, np.full(len(AT), off)), 4)
        pulls += [(m.hz - HZ[:4]) / m.hz_std, (m.ratio - RATIO[:4]) / m.ratio_std]
        chi2.append(m.chi2_reduced)
    assert np.std(pulls) == pytest.approx(1.0, abs=0.3)
    assert np.mean(chi2) == pytest.approx(1.0, abs=0.12)


def test_shapes_are_not_low_where_the_force_was_read_with_noise() -> None:
    """It is divided by, and weighed with: the drive was low by 2.2 deviations in the mean of 8 pulls."""
    at, off, pulls = np.arange(15.0, 70.0, 0.02), 0.04, []
    w, wr = 2 * np.pi * at[:, None], 2 * np.pi * HZ[[0, 3]]
    exact = -(w**2) * ((SHAPES[0, [0, 3]] / (wr**2 - w**2 + 2j * RATIO[[0, 3]] * wr * w)) @ SHAPES[:2, [0, 3]].T)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        read, force = rng.standard_normal((2, len(at), 2)), rng.standard_normal((2, len(at), 1))
        by = 1.0 + off * (force[0] + 1j * force[1])
        seen, own = (exact + NOISE[0] * (read[0] + 1j * read[1])) / by, NOISE[0] / np.abs(by) * np.ones(2)
        channels = {"a1": "acceleration", "a2": "acceleration"}
        m = fit_modes(FrequencyResponses(at, channels, seen, own, off / np.abs(by[:, 0])), 2, drive="a1")
        pulls.append((m.A[0] - SHAPES[0, [0, 3]] ** 2) / m.A_std[0])
    assert abs(np.mean(pulls)) < 4.0 / np.sqrt(np.size(pulls))


def test_numbers_are_right_within_their_deviations(fits) -> None:
    """Pulls of 6 x 20 numbers."""
    true = SHAPES * SHAPES[0]
    pulls = [((m.hz - HZ[:4]) / m.hz_std, (m.ratio - RATIO[:4]) / m.ratio_std) for m in fits]
    of_A = [(m.A - true[:, :4]) / m.A_std for m in fits]
    for found in (np.ravel(pulls), np.ravel(of_A)):
        assert found.std() == pytest.approx(1.0, abs=0.25)
        assert abs(found.mean()) < 4.0 / np.sqrt(len(found))


def test_losses_of_modes_beyond_a_narrow_band_are_not_taken_for_modes() -> None:
    """Peaks known to some 1e-5: pulls of 4 x 10 numbers; without losses their rms was 14."""
    at, pulls = np.arange(29.0, 35.0, 0.01), []
    exact, std = responses(at), np.broadcast_to(0.02 * NOISE, (600, 3))
    for seed in range(4):
        both = np.random.default_rng(seed).standard_normal((2, 600, 3))
        m = fit_modes(FrequencyResponses(at, CHANNELS, exact + std * (both[0] + 1j * both[1]), std))
        assert len(m) == 2
        true = (SHAPES * SHAPES[0])[:, 1:3]
        pulls += [(m.hz - HZ[1:3]) / m.hz_std, (m.ratio - RATIO[1:3]) / m.ratio_std, *((m.A - true) / m.A_std)]
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.35)
    assert np.abs(pulls).max() < 4.0


def test_deviations_do_not_depend_on_how_stiff_a_structure_is(fits) -> None:
    straight = noisy(1)
    m = fit_modes(FrequencyResponses(AT, CHANNELS, 1e-6 * straight.H, 1e-6 * straight.std))
    assert m.hz_std == pytest.approx(fits[1].hz_std, rel=1e-3)
    assert m.ratio_std == pytest.approx(fits[1].ratio_std, rel=1e-3)


def test_residuals_are_what_the_mode_above_answers_at_rest(fits) -> None:
    expected = SHAPES[:, 4] * SHAPES[0, 4] / (2 * np.pi * HZ[4]) ** 2
    for m in fits:
        assert np.abs((m.above - expected) / m.above_std).max() < 4.5
        assert np.abs(m.below / m.below_std).max() < 4.5


def near_above(seed: int, noise: float) -> tuple[FrequencyResponses, np.ndarray]:
    """Where modes at 80 and 150 Hz are next above a band to 70 Hz, and their static flexibility (3, 3)."""
    hz = np.append(HZ[:4], [80.0, 150.0])
    shapes = np.hstack([SHAPES[:, :4], [[0.8, 0.6], [1.0, -0.5], [-0.7, 0.4]]])
    ratio = np.append(RATIO[:4], [0.01, 0.01])
    w, wr, both = 2 * np.pi * AT[:, None], 2 * np.pi * hz, np.random.default_rng(seed).standard_normal((2, len(AT), 3))
    exact = (1j * w) ** np.array([2, 1, 0]) * ((shapes[0] / (wr**2 - w**2 + 2j * ratio * wr * w)) @ shapes.T)
    std = np.broadcast_to(noise * NOISE, exact.shape)
    static = (shapes[:, 4:] / wr[4:] ** 2) @ shapes[:, 4:].T
    return FrequencyResponses(AT, CHANNELS, exact + std * (both[0] + 1j * both[1]), std), static


def test_a_mode_next_above_the_band_is_no_mode_of_it_and_flexibility_is_that_at_rest(tmp_path: Path) -> None:
    """Without it the rig file had 1.8 to 2.3 times the flexibility at rest, and none where no force acted."""
    for seed in range(3):
        seen, static = near_above(seed, 1.0)
        m = fit_modes(seen, drive="a1")
        assert len(m) == 4
        assert m.beyond is not None and 78.0 < m.beyond.hz < 90.0
        assert np.abs((m.above - static[0]) / m.above_std).max() < 4.5
        shapes, std, _ = m.shapes("a1")
        assert np.abs((shapes - SHAPES[:, :4]) / std).max() < 4.5
        (tmp_path / "rig.toml").write_text(modal_rig_text(m, "near", "force", 1.0, "a1"))
        modal = tomllib.loads((tmp_path / "rig.toml").read_text())["modal"]
        ports = np.array([row[-1] for row in modal["ports"].values()])
        whole = modal["flexibility"] + np.outer(ports, ports) / (2 * np.pi * modal["frequencies_hz"][-1]) ** 2
        assert whole[0] == pytest.approx(static[0], rel=0.15)
        assert whole == pytest.approx(static, abs=0.4 * static.max())  # also where no force acted
        rig = load_rig(tmp_path / "rig.toml")
        assert rig.structure.n == 5
        known = tolerances(rig)  # of what no force has shown, which is 0
        unseen = {(i, j): known[f"modal.flexibility[{i + 1}][{j + 1}]"] for i, j in ((1, 1), (1, 2), (2, 2))}
        assert all(abs(static[at] - whole[at]) < 1.5 * std < 3.0 * static.max() for at, std in unseen.items())
        assert sum("flexibility" in key for key in known) == len(unseen)


def test_a_mode_next_above_the_band_stands_beside_modes_that_damp_one_another() -> None:
    """Where normal modes ask for it, 78 Hz, it was off by many deviations, and its flexibility by a sixth."""
    hz, shapes = np.append(HZ[:4], 80.0), np.hstack([SHAPES[:, :4], [[0.8], [1.0], [-0.7]]])
    w, wr, row = 2 * np.pi * AT, 2 * np.pi * hz, np.array([0.3, -1.0, 0.8, 0.2, 0.0])
    D = np.diag(2 * 0.005 * wr) + 1.5 * np.outer(row, row)
    moved = [shapes @ np.linalg.solve(np.diag(wr**2 - x**2) + 1j * x * D, shapes[0]) for x in w]
    both = np.random.default_rng(0).standard_normal((2, len(AT), 3))
    seen = np.array(moved) * (1j * w[:, None]) ** np.array([2, 1, 0]) + NOISE * (both[0] + 1j * both[1])
    m = fit_modes(FrequencyResponses(AT, CHANNELS, seen, np.broadcast_to(NOISE, seen.shape)), drive="a1")
    assert len(m) == 4 and m.damping is not None and m.damping_std is not None and m.beyond is not None
    assert np.abs((m.damping - D[:4, :4]) / m.damping_std).max() < 4.5
    static = shapes[:, 4] * shapes[0, 4] / wr[4] ** 2
    assert np.abs((m.above - static) / m.above_std).max() < 4.5
    assert abs(m.beyond.hz - 80.0) < 4.5 * m.beyond.hz_std
    text = modal_rig_text(m, "damped", "force", 1.0, "a1")
    modal = tomllib.loads(text)["modal"]
    assert np.array(modal["damping_matrix"]).shape == np.array(modal["tolerances"]["damping_matrix"]).shape == (5, 5)


def test_shapes_are_mass_normalised_by_the_channel_at_the_drive(fits) -> None:
    shapes, std, root = fits[0].shapes("a1")
    assert np.abs((shapes - SHAPES[:, :4]) / std).max() < 4.5
    assert root == pytest.approx(SHAPES[0, :4], rel=0.01)
    with pytest.raises(InputError, match=r"v2 moves against the force .*must be the channel at the point driven"):
        fits[0].shapes("v2")


def test_no_mode_is_added_that_the_drive_moves_against() -> None:
    """A mode of the second channel alone, next to one of the structure, is no other: the drive would have no part."""
    w = 2 * np.pi * AT
    false = np.zeros((len(AT), 3), dtype=complex)
    for j, size in ((0, -2e-3), (1, 0.1)):
        wr = 2 * np.pi * 44.0
        false[:, j] = (1j * w) ** (2 - j) * size / (wr**2 - w**2 + 2j * 0.004 * wr * w)
    straight = noisy(2)
    seen = FrequencyResponses(AT, CHANNELS, straight.H + false, straight.std)
    assert np.sum(np.abs(fit_modes(seen).hz - 44.0) < 0.1) == 1
    kept = fit_modes(seen, drive="a1")
    assert len(kept) == 4 and (kept.A[0] > 0.0).all()


def test_a_drive_that_is_not_there_is_refused_before_any_fit() -> None:
    with pytest.raises(InputError, match="modal: --drive = a9; must be one of a1, v2, x3"):
        fit_modes(noisy(0), drive="a9")


def test_a_drive_that_is_not_where_the_force_acts_is_refused_and_the_channel_that_is_named() -> None:
    with pytest.raises(InputError, match=r"v2 moves against the force at 31, 55 Hz and with it in other .*; a1 does$"):
        fit_modes(noisy(0), drive="v2")
    elsewhere = noisy(0)
    with pytest.raises(InputError, match=r"x3 moves against the force at 20 Hz and .*; no other channel does$"):
        fit_modes(
            FrequencyResponses(AT, {"v2": "velocity", "x3": "displacement"}, elsewhere.H[:, 1:], elsewhere.std[:, 1:]),
            drive="x3",
        )


def test_few_frequencies_next_to_five_modes_tell_all_of_them() -> None:
    """None of the modes explains much before all of them are there."""
    f, ratio = np.array([22.0, 47.0, 48.1, 95.0, 140.0]), np.array([0.002, 0.003, 0.0025, 0.004, 0.003])
    shapes = np.array([[0.9, 0.8, 0.6, 0.7, -0.8], [0.5, 1, -0.9, -0.6, 0.9], [1.1, -0.4, 0.8, -0.9, 0.3]])
    shapes = np.vstack([shapes, [0.3, 0.9, 0.5, 1.1, 0.7], [0.8, -0.7, -0.6, 0.5, -1.0]])
    at = np.array([15.3, 21.37, 22.0, 22.4, 33.1, 46.61, 47.13, 48.07, 49.3, 71.7, 94.6, 95.9, 139.2])
    s, w, rng = 2j * np.pi * at[:, None], 2 * np.pi * f, np.random.default_rng(3)
    exact = s**2 * ((shapes[0] / (s**2 + 2 * ratio * w * s + w**2)) @ shapes.T)
    read, force = rng.standard_normal((2, 13, 5)), rng.standard_normal((2, 13, 1))
    seen = exact * (1.0 + 2.2e-5 * (force[0] + 1j * force[1])) + 2.2e-4 * (read[0] + 1j * read[1])
    names = {f"a{j}": "acceleration" for j in range(1, 6)}
    found = fit_modes(FrequencyResponses(at, names, seen, np.full((13, 5), 2.2e-4), np.full(13, 2.2e-5)), drive="a1")
    assert len(found) == 5
    assert np.abs((found.hz - f) / found.hz_std).max() < 4.5
    assert np.abs((found.ratio - ratio) / found.ratio_std).max() < 4.5


def test_the_phase_of_a_voltage_is_found() -> None:
    """The force leads the voltage by 0.1 rad at all frequencies."""
    straight = noisy(3)
    m = fit_modes(FrequencyResponses(AT, CHANNELS, straight.H * np.exp(0.1j), straight.std), phase=True)
    assert len(m) == 4
    assert abs(m.phase - 0.1) < 4.0 * m.phase_std < 0.01
    assert np.abs((m.hz - HZ[:4]) / m.hz_std).max() < 4.5


def test_a_resonance_that_is_not_linear_is_doubted_and_warnings_of_records_are_repeated(tmp_path: Path) -> None:
    """A steady state of a hardening spring, by one term, is no sum of modes."""
    hz = np.linspace(19.0, 22.0, 60)
    x = np.full(60, 0.0 + 0.0j)
    w, wn = 2 * np.pi * hz, 2 * np.pi * 20.0
    for _ in range(400):
        x = 0.5 * x + 0.5 / (wn**2 + 3e10 * np.abs(x) ** 2 - w**2 + 2j * 0.01 * wn * w)
    pairs = np.zeros((60, 2, 3))
    pairs[:, 0, 1], pairs[:, 1, 1], pairs[:, 1, 2] = 1.0, x.real * 1e4, -x.imag * 1e4
    std = np.broadcast_to(np.array([1e-6, 1e-3])[:, None], (60, 2, 2)).copy()
    level = np.repeat([1.0, 3.0], [59, 1])
    found = MeasuredSpectra("steps", np.arange(1, 61), level, hz, ("force", "x"), pairs, std, ((7, "x is odd"),))
    write_spectra(tmp_path / "s.csv", found)
    args = ["modal", str(tmp_path / "s.csv"), "--quantity", "x=displacement", "--modes", "1"]
    result = CliRunner().invoke(app, [*args, "--out", str(tmp_path / "rig.toml")])
    assert result.exit_code == 0, result.output
    said = " ".join(result.stdout.split())
    assert "warning: not linear at this level" in said
    assert "s.csv: x is odd." in said
    assert "records of 1 to 3 N were fitted as one; --record takes those of the lowest level alone" in said
    table = tomllib.loads((tmp_path / "rig.toml").read_text())
    stated = table["modal"]["tolerances"]
    assert stated["frequencies_hz"][0] >= 0.0049 * table["modal"]["frequencies_hz"][0]  # those of numbers not measured
    assert stated["modal_ratios"][0] >= 0.19 * table["damping"]["modal_ratios"][0]
    assert stated["ports"]["x"][0] >= 0.029 * abs(table["modal"]["ports"]["x"][0])


def spectra(seed: int) -> MeasuredSpectra:
    """A stepped sine of 2 N with any phase, and what the channels read of it."""
    rng = np.random.default_rng(seed)
    force = 2.0 * np.exp(2j * np.pi * rng.random(len(AT)))
    c = np.column_stack([force, noisy(seed).H * force[:, None]])
    pairs = np.stack([np.zeros(c.shape), c.real, -c.imag], axis=2)
    std = np.broadcast_to(np.concatenate([[1e-6], 2.0 * NOISE])[:, None], (len(AT), 4, 2))
    names = ("force", *CHANNELS)
    return MeasuredSpectra("steps", np.arange(1, len(AT) + 1), np.full(len(AT), 2.0), AT, names, pairs, std.copy())


def test_the_rig_file_answers_as_the_structure(tmp_path: Path) -> None:
    """A joint that does next to nothing makes it a rig; its steady states are the frequency responses."""
    write_spectra(tmp_path / "low.csv", spectra(1))
    args = ["modal", str(tmp_path / "low.csv"), "--drive", "a1", "--out", str(tmp_path / "rig.toml")]
    result = CliRunner().invoke(app, [*args, "--quantity", "v2=velocity", "--quantity", "x3=displacement"])
    assert result.exit_code == 0, result.output
    text = (tmp_path / "rig.toml").read_text()
    modal = tomllib.loads(text)["modal"]
    assert len(modal["frequencies_hz"]) == 4
    off = (np.array(modal["frequencies_hz"]) - HZ[:4]) / modal["tolerances"]["frequencies_hz"]
    assert np.abs(off).max() < 4.5
    assert (np.array(modal["tolerances"]["frequencies_hz"]) < 1e-3 * HZ[:4]).all()  # where noise alone is left
    joint = '\n[[joints]]\nname = "nothing"\nlaw = "dashpot"\nat = "a1"\nlinear = 1e-9\nquadratic = 0.0\n'
    (tmp_path / "joined.toml").write_text(text + joint)
    rig = load_rig(tmp_path / "joined.toml")
    for hz in (18.0, 31.02, 45.0, 55.3):
        state = steady_state(rig, hz, level=2.0, harmonics=1)
        true = 2.0 * responses(np.array([hz]))[0]
        for name, expected in zip(CHANNELS, true, strict=True):
            c = state[name].coefficients
            assert c[1] - 1j * c[2] == pytest.approx(expected, abs=0.02 * abs(expected))


@pytest.mark.parametrize("seed", range(3))
def test_a_rig_of_one_mode_in_a_narrow_band_answers_as_the_structure(tmp_path: Path, seed: int) -> None:
    """What modes on both sides add is nearly a constant there: its parts are not told apart, their sum is."""
    whole = spectra(seed)
    near = (AT > 52.0) & (AT < 58.0)
    narrow = MeasuredSpectra(
        "steps",
        np.arange(1, near.sum() + 1),
        whole.level[near],
        AT[near],
        whole.channels,
        whole.coefficients[near],
        whole.std[near],
    )
    write_spectra(tmp_path / "narrow.csv", narrow)
    args = ["modal", str(tmp_path / "narrow.csv"), "--drive", "a1", "--modes", "1", "--out", str(tmp_path / "rig.toml")]
    result = CliRunner().invoke(app, [*args, "--quantity", "v2=velocity", "--quantity", "x3=displacement"])
    assert result.exit_code == 0, result.output
    rig = load_rig(tmp_path / "rig.toml")
    for hz in (52.5, 54.8, 55.3, 57.5):
        state = steady_state(rig, hz, level=2.0, harmonics=1)
        true, peak = 2.0 * responses(np.array([hz, 55.0]))
        for name, expected, largest in zip(CHANNELS, true, peak, strict=True):
            c = state[name].coefficients
            assert c[1] - 1j * c[2] == pytest.approx(expected, abs=0.02 * abs(largest))


def test_bad_input_is_one_line(tmp_path: Path) -> None:
    write_spectra(tmp_path / "low.csv", spectra(1))
    file, out = str(tmp_path / "low.csv"), str(tmp_path / "rig.toml")
    for args, line in (
        (["--quantity", "v2=speed"], 'modal: --quantity = "v2=speed"; must be NAME=QUANTITY, of a1, v2, x3 and '),
        (["--force", "shaker"], f'{file}: channel "shaker" is not in it; channels are force, a1, v2, x3'),
        (["--from", "20", "--to", "20.5"], "modal: 3 frequencies at which the force excites; must be at least 8"),
        (["--drive", "a9", "--from", "15", "--to", "25"], "modal: --drive = a9; must be one of a1, v2, x3"),
        (
            ["--from", "3", "--to", "11"],
            "modal: --from 3 --to 11: frequencies are 15 to 69.9, and in the band if they are in rad/s; must be in Hz",
        ),
    ):
        result = CliRunner().invoke(app, ["modal", file, "--out", out, *args])
        assert result.exit_code == 2
        assert result.stderr.startswith(line)
        assert not Path(out).exists()


def test_what_does_not_move_or_is_not_enough_has_no_modes() -> None:
    at = np.linspace(10.0, 20.0, 40)
    names = {"a": "acceleration"}
    still = FrequencyResponses(at, names, np.zeros((40, 1), dtype=complex), np.full((40, 1), 1e-3))
    for responses, modes, said in (
        (still, None, "no channel moves"),
        (still.between(0.0, 1.0), None, "0 frequencies at which the force excites; must be at least 8"),
        (still, 26, "modes = 26; must be <= 25 with 40 frequencies of 1 channels"),
    ):
        with pytest.raises(InputError, match=said):
            fit_modes(responses, modes)


def test_a_step_is_no_reason_to_fail() -> None:
    """Poles beside it run off to where they have no logarithm."""
    at = np.linspace(15.0, 25.0, 40)
    step = (at > 20.0) + 0.01j
    found = fit_modes(FrequencyResponses(at, {"a": "acceleration"}, step[:, None], np.full((40, 1), 1e-4)), 5)
    assert np.isfinite(found.hz).all()


def test_a_mode_above_the_band_that_the_drive_hardly_sees_is_said_to_be_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    m = fit_modes(near_above(0, 1.0)[0], drive="a1")
    assert m.beyond is not None
    unseen = replace(m, beyond=m.beyond._replace(A=m.beyond.A * [1e-6, 1.0, 1.0]))
    for found, modes, said in ((m, 5, False), (unseen, 4, True)):
        _print(found, "a1")
        assert ("hardly moves in it: left out" in " ".join(capsys.readouterr().out.split())) is said
        (tmp_path / "rig.toml").write_text(modal_rig_text(found, "near", "force", 1.0, "a1"))
        assert load_rig(tmp_path / "rig.toml").structure.n == modes
