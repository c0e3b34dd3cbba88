"""Loops of a friction device that is known, by a march of its own; and what cannot be a loops file."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hbm.cli import app
from hbm.errors import InputError
from hbm.identification.loops import LAWS, fit_loop
from hbm.measurement.loopsfile import MeasuredLoop, load_loops

SAMPLES, HZ, X = 240, 0.5, 0.02
KNOWN = {"stiffness": 5e6, "forward": 12e3, "backward": 9e3, "backlash": 4e-3}


def displacement(cycles: int = 3, samples: int = SAMPLES) -> np.ndarray:
    theta = 2 * np.pi * np.arange(cycles * samples) / samples
    return X * (np.sin(theta) + 0.03 * np.sin(3 * theta))


def force(x: np.ndarray, stiffness, forward, backward, backlash=0.0, breakaway=0.0, distance=1.0) -> np.ndarray:
    """A hook in a slot on a spring on a slider, each moved in turn; one cycle to begin with."""
    slider, slipped, out = 0.0, 0.0, []
    for at in np.concatenate([x[: len(x) // 3], x]):
        reach = at - slider  # from the slider to the hook
        stretch = reach if reach > 0 else min(reach + backlash, 0.0)
        T = stiffness * stretch
        more = 1.0 + breakaway * np.exp(-slipped / distance)
        over = max(T - forward * more, 0.0) + min(T + backward * more, 0.0)
        slider += over / stiffness
        slipped = slipped + abs(over) / stiffness if over else 0.0
        out.append(T - over)
    return np.array(out[len(x) // 3 :])


def loop(noise: float = 0.0, seed: int = 0, mass: float = 0.0, hz: float = HZ, **more) -> MeasuredLoop:
    x = displacement()
    t = np.arange(len(x)) / (SAMPLES * hz)
    theta = 2 * np.pi * hz * t
    a = -X * (2 * np.pi * hz) ** 2 * (np.sin(theta) + 0.27 * np.sin(3 * theta))
    F = force(x, **KNOWN, **more) + mass * a
    return MeasuredLoop("known", t, x, F + noise * np.random.default_rng(seed).standard_normal(len(x)))


def test_backlash_and_both_limits_are_found_within_their_deviations() -> None:
    pulls = []
    for seed in range(6):
        best = fit_loop(loop(noise=300.0, seed=seed), list(LAWS)[:4])[0]
        assert best.law == "backlash"
        assert abs(best.work_error) < 0.01
        pulls += [(best.values[name] - true) / best.stds[name] for name, true in KNOWN.items()]
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.4)


def test_breakaway_and_mass_are_told_apart() -> None:
    assert fit_loop(loop(300.0, breakaway=0.3, distance=2e-3))[0].law == "backlash and breakaway"
    best = fit_loop(loop(300.0, mass=300.0, hz=2.0))[0]
    assert best.law == "backlash and mass"
    assert best.values["mass"] == pytest.approx(300.0, abs=4.0 * best.stds["mass"])


def test_energy_of_a_coulomb_loop_is_its_area() -> None:
    """4 F (X - F/k) a cycle, F the mean of both limits."""
    x = X * np.sin(2 * np.pi * np.arange(4 * SAMPLES * 3) / (4 * SAMPLES))
    T = force(x, 5e6, 10e3, 10e3)
    found = MeasuredLoop("c", np.arange(len(x)) / 1000.0, x, T)
    assert found.work == pytest.approx(3 * 4 * 10e3 * (X - 10e3 / 5e6), rel=2e-3)
    assert fit_loop(found, ["coulomb"])[0].values["stiffness"] == pytest.approx(5e6, rel=1e-3)


def written(path: Path, *loops: MeasuredLoop) -> Path:
    rows = ["loop,time_s,note,displacement_m,force_n"]
    for each in loops:
        columns = zip(each.time.tolist(), each.displacement.tolist(), each.force.tolist(), strict=True)
        rows += [f"{each.name},{t!r},x,{x!r},{F!r}" for t, x, F in columns]
    path.write_text("\n".join(rows))
    return path


def test_the_command_prints_and_writes_the_laws(tmp_path: Path) -> None:
    file, out = written(tmp_path / "l.csv", loop(300.0)), tmp_path / "laws.csv"
    result = CliRunner().invoke(app, ["loops", str(file), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "within 5 % in 1 of 1 loops" in result.stdout
    first = dict(zip(*(line.split(",") for line in out.read_text().splitlines()[:2]), strict=True))
    assert first["law"] == "backlash"
    assert float(first["forward"]) == pytest.approx(12e3, rel=0.01)
    again = load_loops(file)[0]
    assert again.force.tolist() == loop(300.0).force.tolist()


def test_what_is_no_loops_file_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "l.csv"
    head = "loop,time_s,displacement_m,force_n\n"
    for text, line in (
        ("loop,time_s,displacement_m\n", " line 1: no column force_n; must have loop,time_s,displacement_m,force_n, "),
        (head, ": no rows; must have at least one loop"),
        (f"{head}a,0,1\n", " line 2: 3 entries; must have 4"),
        (f"{head}a,0,x,1\n", " line 2: 0, x, 1; must be numbers, time_s, displacement_m, force_n"),
        (f"{head}" + "a,0,0,1\na,1,0,1\na,2,0,1\n", ": loop a: 3 samples over 0 m; must be 32 or more, and move"),
        (head + "".join(f"a,{i},{i % 8},7\n" for i in range(40)), ": loop a: force_n is 7 throughout; must change"),
    ):
        file.write_text(text)
        with pytest.raises(InputError) as refused:
            load_loops(file)
        assert str(refused.value).startswith(f"{file}{line}")
    result = CliRunner().invoke(app, ["loops", str(written(file, loop())), "--loop", "other"])
    assert (result.exit_code, result.stderr) == (2, f"{file}: no loop other; loops are known\n")
