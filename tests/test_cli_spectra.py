"""``hbm spectra``: what it writes and prints, and the one line and status with which it refuses."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from hbm.cli import app
from hbm.files.curves import write_history
from hbm.integration.integrate import simulate
from hbm.measurement.spectrafile import load_spectra
from hbm.response.trace import steady_state
from hbm.rigfiles.load import load_rig

EXAMPLES = Path(__file__).parents[1] / "examples"
RIG = str(EXAMPLES / "one_mode.toml")  # channels force and a1
HZ, RATE = 50.0, 2000.0


def run(*args: str) -> Result:
    return CliRunner().invoke(app, ["spectra", *args], prog_name="hbm")


def history(path: Path, *, level: float = 2.0, names: str = "force,a1", seed: int = 1, decay: float = 0.0) -> str:
    """A second of a force of phase 0 and of a response 3 cos + 0.5 sin, with noise, and ringing where it decays."""
    t, rng = np.arange(2000) / RATE, np.random.default_rng(seed)
    theta = 2.0 * np.pi * HZ * t
    ringing = np.exp(-decay * t) * np.cos(1.05 * theta) if decay else 0.0
    signals = [level * np.cos(theta), 3.0 * np.cos(theta) + 0.5 * np.sin(theta) + ringing]
    columns = [t, *(s + 1e-3 * rng.standard_normal(len(t)) for s in signals)][: names.count(",") + 2]
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=f"time_s,{names}", comments="")
    return str(path)


def test_records_are_written_and_told(tmp_path: Path) -> None:
    files = [history(tmp_path / "a.csv"), history(tmp_path / "b.csv", level=4.0, seed=2)]
    out = tmp_path / "s.csv"
    result = run(*files, "--fundamental", "50", "--harmonics", "3", "--rig", RIG, "--out", str(out))
    assert (result.exit_code, result.stderr) == (0, "")
    spectra = load_spectra(out, load_rig(RIG))
    assert (spectra.records.tolist(), spectra.channels, spectra.H) == ([1, 2], ("force", "a1"), 3)
    assert spectra.hz.tolist() == [50.0, 50.0]
    assert spectra.level == pytest.approx([2.0, 4.0], abs=2e-4)  # the fundamental of the force
    z = (spectra.coefficients[:, 1, [1, 4]] - [3.0, 0.5]) / spectra.std[:, 1, 1:2]
    assert np.max(np.abs(z)) < 4.0
    rows = [line.split() for line in result.stdout.splitlines()]
    amplitude, std = np.hypot(*spectra.coefficients[0, 1, [1, 4]]), spectra.std[0, 1, 1]
    assert ["a1", f"{amplitude:.5g}", f"{std:.2g}", "m/s2"] in [row[:4] for row in rows]
    assert "fundamental 50 Hz, 50 periods; standard deviations from the scatter of 50 blocks" in result.stdout
    assert result.stdout.splitlines()[-1] == f"wrote {out}"


def test_a_unit_that_nothing_states_is_not_made_up(tmp_path: Path) -> None:
    result = run(history(tmp_path / "a.csv"), "--fundamental", "50", "--out", str(tmp_path / "s.csv"))
    assert [line.split()[3:5] for line in result.stdout.splitlines() if "a1" in line] == [["not", "stated"]]


@pytest.mark.parametrize("ending", ["nc", "mat"])
def test_other_formats_hold_the_same(ending: str, tmp_path: Path) -> None:
    file = history(tmp_path / "a.csv")
    found = []
    for out in (tmp_path / "s.csv", tmp_path / f"s.{ending}"):
        assert run(file, "--fundamental", "50", "--level", "2", "--rig", RIG, "--out", str(out)).exit_code == 0
        found.append(load_spectra(out, load_rig(RIG)))
    np.testing.assert_array_equal(found[0].coefficients, found[1].coefficients)
    np.testing.assert_array_equal(found[0].std, found[1].std)


def test_one_number_per_file_after_one_flag(tmp_path: Path) -> None:
    files = [history(tmp_path / "a.csv"), history(tmp_path / "b.csv", seed=2)]
    out = tmp_path / "s.csv"
    options = ["--fundamental", "50", "50.001", "--level", "2", "2.5", "--settle", "0.2"]
    result = run(*files, *options, "--out", str(out))
    assert result.exit_code == 0
    spectra = load_spectra(out, load_rig(RIG))
    assert (spectra.hz.tolist(), spectra.level.tolist()) == ([50.0, 50.001], [2.0, 2.5])
    assert "40 periods" in result.stdout


def test_channels_are_renamed_and_the_frequency_refined(tmp_path: Path) -> None:
    file, out = history(tmp_path / "a.csv", names="load cell,top"), tmp_path / "s.csv"
    options = ["--channel", "force=load cell", "--channel", "a1=top", "--fundamental", "50.03", "--refine"]
    result = run(file, *options, "--rig", RIG, "--out", str(out))
    assert (result.exit_code, result.stderr) == (0, "")
    spectra = load_spectra(out, load_rig(RIG))
    assert spectra.channels == ("force", "a1")
    assert spectra.hz[0] == pytest.approx(50.0, abs=1e-3)
    assert spectra.complex("a1")[0, 1] == pytest.approx(3.0 - 0.5j, abs=5e-3)


@pytest.mark.parametrize(("rig", "read"), [(("--rig", RIG), ("force", "a1")), ((), ("force",))])
def test_columns_that_the_rig_knows_are_read_beside_one_that_is_named(
    rig: tuple[str, ...], read: tuple[str, ...], tmp_path: Path
) -> None:
    file, out = history(tmp_path / "a.csv", names="load cell,a1"), tmp_path / "s.csv"
    result = run(file, "--channel", "force=load cell", "--fundamental", "50", *rig, "--out", str(out))
    assert (result.exit_code, result.stderr) == (0, "")
    assert load_spectra(out, load_rig(RIG)).channels == read


@pytest.mark.parametrize("sweep", [("--sweep",), ("--fundamental", "50")])
def test_a_force_in_metres_is_refused_without_a_rig_too(sweep: tuple[str, ...], tmp_path: Path) -> None:
    file, out = history(tmp_path / "a.csv", names="force [m],a1 [m/s2]"), tmp_path / "s.csv"
    result = run(file, *sweep, "--out", str(out))
    assert (result.exit_code, result.stderr) == (2, f"{file}: channel force is in m; must be force, N\n")
    assert not out.exists()


@pytest.mark.parametrize("rig", [(), ("--rig", RIG)])
def test_a_force_may_be_a_voltage_and_no_motion(rig: tuple[str, ...], tmp_path: Path) -> None:
    """A shaker whose force is not measured; millivolts become volts, as other units become SI."""
    file, out = history(tmp_path / "a.csv", names="force [mV],a1 [m/s2]", level=200.0), tmp_path / "s.nc"
    given = ("--fundamental", "50", "--harmonics", "3", *rig, "--out", str(out))
    result = run(file, *given)
    assert (result.exit_code, result.stderr) == (0, "")
    assert load_spectra(out).level == pytest.approx([0.2], rel=1e-4)
    assert [line.split()[3] for line in result.stdout.splitlines() if line.split()[:1] == ["force"]] == ["V"]
    moved = history(tmp_path / "b.csv", names="force,a1 [V]")
    assert run(moved, *given).stderr.startswith(f'{moved}: unit of a1 is "V"; must be one of N, kN')
    other = history(tmp_path / "c.csv", names="force [N],a1 [m/s2]")
    result = run(file, other, *given)
    assert (result.exit_code, result.stderr) == (
        2,
        f"{other}: force is in N; must be in V, as in the files before\n",
    )


def test_a_sweep_may_have_its_phase_by_a_voltage(tmp_path: Path) -> None:
    t = np.arange(8000) / RATE
    u = np.cos(2.0 * np.pi * (40.0 * t + t**2))
    rows = np.column_stack([t, 3.0 * u, u, u + 1e-3 * np.random.default_rng(1).standard_normal(len(t))])
    file, out = tmp_path / "up.csv", tmp_path / "s.csv"
    np.savetxt(file, rows, delimiter=",", header="time_s,force [N],drive [V],a1 [m/s2]", comments="")
    result = run(str(file), "--sweep", "--harmonics", "1", "--reference", "drive", "--out", str(out))
    assert (result.exit_code, result.stderr) == (0, "")
    result = run(str(file), "--sweep", "--harmonics", "1", "--out", str(out))
    assert result.stderr.startswith(f'{file}: unit of drive is "V"; must be one of N, kN')


@pytest.mark.parametrize("how", [("--sweep",), ("--fundamental", "50")])
@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("", ' line 1: columns ""; must be time_s, or as Time (ms), and one per channel'),
        ("time_s,force,a1\n0,1,2\n1,#REF!,2\n", ' line 3: force = "#REF!"; must be a finite number'),
        ("time_s,force,a1\n0,1,2\n1,1,2\n2,1,2\n", ""),
    ],
)
def test_one_bad_file_of_many_is_named_and_nothing_written(
    how: tuple[str, ...], content: str, line: str, tmp_path: Path
) -> None:
    """Records are numbered in the order of the files: none may be missing unsaid."""
    good, bad, out = history(tmp_path / "a.csv"), tmp_path / "b.csv", tmp_path / "s.csv"
    bad.write_text(content)
    result = run(str(bad), good, *how, "--harmonics", "3", "--out", str(out))
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert result.stderr.startswith(f"{bad}{line}")
    assert not out.exists()


@pytest.mark.parametrize(
    ("level", "column", "warned"),
    [("9", "force", 1), ("0.4", "force (N)", 1), ("4", "force", 0), ("9", "force (V)", 0)],
)
def test_a_level_far_from_the_force_is_told(level: str, column: str, warned: int, tmp_path: Path) -> None:
    file, out = history(tmp_path / "a.csv", names=f"{column},a1"), tmp_path / "s.csv"
    result = run(file, "--fundamental", "50", "--level", level, "--out", str(out))
    assert result.exit_code == 0 and load_spectra(out).level.tolist() == [float(level)]
    said = [line for line in result.stdout.splitlines() if "check both and their units" in line]
    assert len(said) == warned
    for line in said:
        assert line.startswith(f"warning: {file}: level = {level} N, where the fundamental of force is 2 N;")


def test_what_is_wrong_with_a_record_is_told(tmp_path: Path) -> None:
    file, out = history(tmp_path / "a.csv", decay=4.0), tmp_path / "s.csv"
    result = run(file, "--fundamental", "50", "--out", str(out))
    assert result.exit_code == 0
    (line,) = [x for x in result.stdout.splitlines() if "a1 is not steady: a transient dies out at 4" in x]
    assert line.startswith("warning: ")
    assert "+2.5 Hz beside the fundamental" in line


def test_a_simulation_run_to_its_steady_state_has_the_harmonics_of_that_state(tmp_path: Path) -> None:
    """Time integration and harmonic balance share no line, and its file goes the way of a measured one.

    Damping 1 % of 50 Hz: after 3 s exp(-9.4) of the transient is left, 1e-4; steps of 1/512 of a period are right to
    1e-4 of the acceleration.
    """
    rig = load_rig(RIG)
    write_history(tmp_path / "run.csv", simulate(rig, 45.0, duration=3.5))
    out = tmp_path / "s.csv"
    result = run(str(tmp_path / "run.csv"), "--fundamental", "45", "--settle", "3", "--rig", RIG, "--out", str(out))
    assert result.exit_code == 0
    spectra = load_spectra(out, rig)
    exact = steady_state(rig, 45.0).channels["a1"].coefficients
    H = len(exact) // 2
    c = exact[1] - 1j * exact[H + 1]
    assert spectra.level[0] == pytest.approx(rig.excitation.amplitude, rel=1e-9)
    assert spectra.complex("a1")[0, 1] == pytest.approx(c, abs=1e-3 * abs(c))


# ------------------------------------------------------------------------------------------------------------ bad input


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--out", "s.csv"], "hbm spectra: missing option '--fundamental'; see hbm spectra --help"),
        (["--fundamental", "50"], "hbm spectra: missing option '--out'; see hbm spectra --help"),
        (["--fundamental", "0", "--out", "s.csv"], "spectra: --fundamental = 0; must be a number > 0 [Hz]"),
        (
            ["--fundamental", "50", "51", "--out", "s.csv"],
            "spectra: --fundamental has 2 numbers; must have 1, for one file",
        ),
        (["--fundamental", "50", "--level", "x", "--out", "s.csv"], 'spectra: --level = "x"; must be a number > 0 [N]'),
        (
            ["--fundamental", "50", "--harmonics", "0", "--out", "s.csv"],
            "spectra: --harmonics = 0; must be a whole number from 1 to 8192",
        ),
        (
            ["--fundamental", "50", "--settle", "-1", "--out", "s.csv"],
            "spectra: --settle = -1; must be a number >= 0 [s]",
        ),
        (
            ["--fundamental", "50", "--channel", "a1", "--out", "s.csv"],
            'spectra: --channel = "a1"; must be NAME=COLUMN',
        ),
        (
            ["--fundamental", "50", "--channel", "a1=x", "--channel", "a1=y", "--out", "s.csv"],
            "spectra: --channel a1 twice; must be once",
        ),
        (
            ["--fundamental", "50", "--out", "s.txt"],
            'spectra: --out = "s.txt"; must end in .csv or .npz or .nc or .mat or .uff',
        ),
        (
            ["--fundamental", "50", "--channel", "a1=top", "--out", "s.csv"],
            'h.csv: no channel "top"; channels are force, a1',
        ),
        (
            ["--fundamental", "50", "--channel", "b=a1", "--rig", RIG, "--out", "s.csv"],
            'h.csv: channel "b" is not in the rig; channels are force, a1; try --channel NAME=COLUMN',
        ),
        (
            ["--fundamental", "50", "--channel", "a1=a1", "--out", "s.csv"],
            "spectra: h.csv has no channel force that moves; must have it (--channel force=COLUMN), or give --level "
            "where no force was measured",
        ),
        (
            ["--fundamental", "0.5", "--out", "s.csv"],
            "h.csv: 1 s are 0.5 periods of 0.5 Hz; must be at least one period",
        ),
        (
            ["--fundamental", "500", "--out", "s.csv"],
            "h.csv: harmonic 9 of 500 Hz at 2000 samples/s; must be below 1000 Hz, half the sampling rate; "
            "try at most 1 harmonic",
        ),
        (
            ["--fundamental", "1500", "--out", "s.csv"],
            "h.csv: harmonic 9 of 1500 Hz at 2000 samples/s; must be below 1000 Hz, half the sampling rate; "
            "are the times in seconds?",
        ),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    options: list[str], line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    history(tmp_path / "h.csv")
    result = run("h.csv", *options)
    assert (result.stderr, result.stdout, result.exit_code) == (f"{line}\n", "", 2)
    assert [p.name for p in tmp_path.iterdir()] == ["h.csv"]


def test_a_unit_that_is_not_the_rigs_is_refused(tmp_path: Path) -> None:
    from scipy.io import savemat

    path, t = tmp_path / "h.mat", np.arange(100) / 1e3
    savemat(path, {"t": t, "a1": np.cos(300.0 * t), "units": {"a1": "mm"}})
    result = run(str(path), "--fundamental", "50", "--rig", RIG, "--out", str(tmp_path / "s.csv"))
    assert result.stderr == f"{path}: channel a1 is in m; must be acceleration, m/s2, in the rig\n"
    assert result.exit_code == 2


def test_the_help_has_an_example() -> None:
    result = run("--help")
    assert result.exit_code == 0
    assert "Example:  hbm spectra run1.csv run2.csv --fundamental 48 49.5 --settle 2" in result.stdout
