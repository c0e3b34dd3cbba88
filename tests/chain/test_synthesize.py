"""Synthetic measurements: the truth within its standard deviations, and no trace of how it was made."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from hbm import load_rig, load_spectra, steady_state, synthesize
from hbm.cli import app
from hbm.errors import InputError
from models.parts import Drift

RIG = str(Path(__file__).parents[2] / "examples" / "one_mode.toml")  # channels force and a1
FREQUENCIES = [45.0, 48.0]


def run(*args: str) -> Result:
    return CliRunner().invoke(app, list(args), prog_name="hbm")


def made(out: Path, *more: str) -> Result:
    options = ["--levels", "1", "2", "--frequencies", "45", "48", "--snr", "50", "--harmonics", "3", "--out", str(out)]
    return run("synthesize", RIG, *options, *more)


def test_spectra_scatter_about_the_steady_states_by_their_standard_deviations(tmp_path: Path) -> None:
    """Of the four records of both channels 48 harmonic coefficients, their squares' sum within 5 sigma of its mean."""
    out = tmp_path / "s.csv"
    assert made(out).exit_code == 0
    rig = load_rig(RIG)
    spectra = load_spectra(out, rig)
    assert (spectra.level.tolist(), spectra.hz.tolist()) == ([1.0, 1.0, 2.0, 2.0], FREQUENCIES * 2)
    squares = []
    for i in range(4):
        true = steady_state(rig, float(spectra.hz[i]), level=float(spectra.level[i]), harmonics=21)
        for j, name in enumerate(spectra.channels):
            c = true[name].coefficients
            expected = c[1:4] - 1j * c[22:25]
            std = spectra.std[i, j, 1:]
            squares += list(np.abs(spectra.complex(name)[i, 1:4] - expected) ** 2 / std**2 / 2.0)
    assert np.mean(squares) == pytest.approx(1.0, abs=5.0 / np.sqrt(len(squares)))


def test_the_noise_is_as_asked_for() -> None:
    rig = load_rig(RIG)
    quiet, loud = (synthesize(rig, [2.0], FREQUENCIES, snr=snr).spectra for snr in (80.0, 40.0))
    largest = np.abs(loud.complex("a1")[:, 1]).max()
    assert np.mean(loud.std[:, 1, 1:]) == pytest.approx(0.01 * largest, rel=0.15)
    assert loud.std / quiet.std == pytest.approx(100.0, rel=0.02)  # the same noise, a hundred times larger


def test_a_seed_makes_the_same_file_and_another_one_another(tmp_path: Path) -> None:
    names = ["a.csv", "b.csv", "c.csv"]
    for name, seed in zip(names, ("7", "7", "8"), strict=True):
        assert made(tmp_path / name, "--seed", seed).exit_code == 0
    a, b, c = ((tmp_path / name).read_bytes() for name in names)
    assert a == b
    assert a != c
    assert b"seed" not in a


def test_the_recordings_give_the_same_spectra_in_one_command(tmp_path: Path) -> None:
    made(tmp_path / "s.csv", "--histories", str(tmp_path / "rec"))
    out = tmp_path / "t.csv"
    result = run("spectra", str(tmp_path / "rec"), "--rig", RIG, "--harmonics", "3", "--out", str(out))
    assert (result.exit_code, result.stderr) == (0, "")
    assert out.read_bytes() == (tmp_path / "s.csv").read_bytes()
    assert sorted(p.name for p in (tmp_path / "rec").iterdir())[::4] == ["manifest.csv", "record_004.csv"]


def test_recordings_of_an_earlier_run_are_replaced(tmp_path: Path) -> None:
    for levels in (["1", "2"], ["1"]):
        options = ["--levels", *levels, "--frequencies", "45", "--out", str(tmp_path / "s.csv")]
        assert run("synthesize", RIG, *options, "--histories", str(tmp_path / "rec")).exit_code == 0
    assert sorted(p.name for p in (tmp_path / "rec").iterdir()) == ["manifest.csv", "record_001.csv"]


@pytest.mark.parametrize("files", [["run_48Hz.csv"], ["manifest.csv", "run_48Hz.csv"], ["record_001.csv"]])
def test_recordings_are_not_put_among_those_of_others(files: list[str], tmp_path: Path) -> None:
    folder = tmp_path / "rec"
    folder.mkdir()
    for name in files:
        (folder / name).write_text("mine")
    result = made(tmp_path / "s.csv", "--histories", str(folder))
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert f'synthesize: --histories = "{folder}"; holds "{files[-1]}", must be empty' in result.stderr
    assert sorted(p.name for p in folder.iterdir()) == files
    assert {(folder / name).read_text() for name in files} == {"mine"}
    assert not (tmp_path / "s.csv").exists()


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--levels", "0"], "synthesize: --levels = 0; must be a number > 0 [N]"),
        (["--levels", "2", "2"], "synthesize: --levels = 2 twice; must be different"),
        (["--levels", "2", "--snr", "x"], "synthesize: --snr = x; must be a number from -20 to 200 [dB]"),
        (["--levels", "2", "--seed", "0"], "synthesize: --seed = 0; must be a whole number from 1 to 1000000000"),
    ],
)
def test_bad_options_are_refused_in_one_line(options: list[str], line: str, tmp_path: Path) -> None:
    result = run("synthesize", RIG, "--frequencies", "45", "--out", str(tmp_path / "s.csv"), *options)
    assert (result.stderr, result.exit_code) == (f"{line}\n", 2)
    assert not list(tmp_path.iterdir())


def test_a_rig_without_channels_is_refused() -> None:
    from dataclasses import replace

    from hbm import InputError

    with pytest.raises(InputError, match=r"has no channels; must have at least one \[\[channels\]\]"):
        synthesize(replace(load_rig(RIG), channels=()), [2.0], [45.0])


def test_where_no_steady_state_is_stable_nothing_is_made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """All frequencies of a level are named at which stability is denied."""
    from continuation import ConvergenceError
    from hbm.response import synthesis

    class Unstable:
        stable = False

    monkeypatch.setattr(synthesis, "stability_of", lambda rig, solution: Unstable())
    with pytest.raises(
        ConvergenceError, match="no stable steady state at 45, 48 Hz and 2 N; a test would show another"
    ):
        synthesize(load_rig(RIG), [2.0], FREQUENCIES)


def test_what_drifts_does_so_from_record_to_record() -> None:
    """A first record repeated at the end shows it."""
    rig = replace(load_rig(RIG), drift=(Drift("channels.a1.gain", -0.05),))
    spectra = synthesize(rig, [2.0], [*FREQUENCIES, FREQUENCIES[0]], snr=100.0).spectra
    a1 = spectra.complex("a1")[:, 1]
    true = [
        float(steady_state(rig.at_record(number), hz, level=2.0, harmonics=21)["a1"].amplitude[1])
        for number, hz in enumerate(spectra.hz, start=1)
    ]
    assert np.abs(a1) == pytest.approx(true, rel=1e-3)
    assert abs(true[2] / true[0] - 1.0) > 0.02
    with pytest.raises(InputError, match=r"^synthesize: drift of channels.a1.gain: 0 times its value in record 21"):
        synthesize(rig, [2.0], [45.0] * 21)


def test_where_stability_cannot_be_told_it_is_said_and_records_are_made(tmp_path: Path) -> None:
    """A clamp that slips ended in a traceback."""
    rig, out = tmp_path / "rig.toml", tmp_path / "s.csv"
    slips = '\n[[extensions]]\ncause = "clamp-friction"\nstiffness = 9500.0\nlimit = 0.8\n'
    rig.write_text((Path(RIG).parent / "paper_beam.toml").read_text() + slips)
    options = ["--levels", "2", "--frequencies", "50", "--snr", "50", "--harmonics", "3", "--out", str(out)]
    done = run("synthesize", str(rig), *options)
    assert done.exit_code == 0, done.output
    assert "records are of the steady states that a sweep comes to first" in " ".join(done.output.split())
    assert len(load_spectra(out, load_rig(rig))) == 1
