"""Loops of a friction device that is known, by a march of its own; and what cannot be a loops file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hbm.cli import app
from hbm.errors import InputError
from hbm.identification import loops as fitting
from hbm.identification.loops import LAWS, fit_loop
from hbm.measurement.loopsfile import MeasuredLoop, load_loops
from models.plausible import PlausibilityWarning

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


def steady(
    forward: float = 30.0,
    backward: float = 30.0,
    *,
    backlash: float = 0.0,
    mass: float = 0.0,
    offset: float = 0.0,
    samples: int = 501,
    seed: int = 4,
) -> MeasuredLoop:
    """Some cycles of 100 samples at 10 Hz and 1 mm, spring 2e5 N/m, with the noise of sensors."""
    theta, noise = 2 * np.pi * np.arange(samples) / 100, np.random.default_rng(seed)
    x = 1e-3 * np.sin(theta)
    before = 1e-3 * np.sin(2 * np.pi * np.arange(100) / 100)
    T = force(np.concatenate([before, x]), 2e5, forward, backward, backlash)[-samples:]
    F = T + offset - mass * (20 * np.pi) ** 2 * x + 0.1 * noise.standard_normal(samples)
    return MeasuredLoop("steady", np.arange(samples) / 1000, x + 1e-8 * noise.standard_normal(samples), F)


@pytest.mark.parametrize("samples", [500, 501, 537])
def test_a_mass_is_found_wherever_the_recording_ends(samples: int) -> None:
    """An acceleration by lines of the whole recording is wrong where that holds a part of a cycle more."""
    pulls = []
    for seed in range(3):
        best = fit_loop(steady(mass=2.0, samples=samples, seed=seed))[0]
        assert best.law == "coulomb and mass"
        assert best.left < 0.0045  # noise is 0.0036 to 0.004 of the force
        known = {"stiffness": 2e5, "forward": 30.0, "mass": 2.0}
        pulls += [(best.values[name] - true) / best.stds[name] for name, true in known.items()]
        assert max(best.stds["forward"] / 30.0, best.stds["mass"] / 2.0) < 2e-3
    assert np.abs(pulls).max() < 4.0


def test_a_mass_stands_beside_backlash_and_both_limits() -> None:
    best = fit_loop(steady(33.0, 27.0, backlash=4e-4, mass=2.0))[0]
    assert best.law == "backlash and mass"
    for name, true in (("forward", 33.0), ("backward", 27.0), ("backlash", 4e-4), ("mass", 2.0)):
        assert best.values[name] == pytest.approx(true, abs=4.0 * best.stds[name])


def test_a_play_longer_than_the_half_of_the_way_is_found() -> None:
    """The median of a force read to 1 N is zero then."""
    device = steady(backlash=1.4e-3)
    best = fit_loop(MeasuredLoop("gap", device.time, device.displacement, np.round(device.force)))[0]
    assert best.law == "backlash"
    for name, true, read in (("forward", 30.0, 0.5), ("backward", 30.0, 0.5), ("backlash", 1.4e-3, 0.5 / 2e5)):
        assert best.values[name] == pytest.approx(true, abs=read)


def test_breakaway_is_no_spring_that_yields() -> None:
    """A device without a limit of its own, as Dahl's: the limit went to 1e-10 N, and the breakaway to 1e12."""
    x = 1e-3 * np.sin(2 * np.pi * np.arange(500) / 100)
    T, F = 0.0, []
    for dx in np.diff(np.concatenate([x[:100], x]), prepend=0.0):
        T += 2e5 * dx - abs(dx) * 2e5 / 30.0 * T
        F.append(T)
    device = MeasuredLoop("dahl", np.arange(500) / 1000, x, np.array(F[100:]))
    fits = fit_loop(device)
    assert not fits[0].at_bounds
    assert 0.5 * max(F) < fits[0].values["forward"] * (1.0 + fits[0].values.get("breakaway", 0.0)) < 3.0 * max(F)
    assert all(fit.values.get("breakaway", 0.0) <= 2.0 for fit in fits)
    bounded = [bool(fit.at_bounds) for fit in fits]
    assert bounded == sorted(bounded)  # last, whatever they leave
    assert all("not determined" in fit.warnings[0] for fit in fits if fit.at_bounds)


def test_a_zero_of_the_load_cell_is_told_where_backlash_shows_it() -> None:
    best = fit_loop(steady(backlash=4e-4, offset=5.0))[0]
    assert (best.law, best.warnings) == ("backlash and offset", ())
    for name, true in (("forward", 30.0), ("backward", 30.0), ("offset", 5.0)):
        assert best.values[name] == pytest.approx(true, abs=4.0 * best.stds[name])
    best = fit_loop(steady(offset=5.0))[0]
    assert best.law == "asymmetric"
    assert best.warnings == ("a zero of the load cell of 5 N would look the same as these limits: take it off before",)


def test_breakaway_that_is_not_there_is_soon_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its logarithm ran off, for hundreds of marches."""
    march, marches = fitting.marched, []
    monkeypatch.setattr(fitting, "marched", lambda *given: marches.append(given) or march(*given))
    fit_loop(steady(35.0, 25.0), ["backlash and breakaway"])
    assert len(marches) < 200


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


def test_forces_of_some_newtons_are_printed_in_newtons_and_warnings_with_them(tmp_path: Path) -> None:
    file = written(tmp_path / "l.csv", steady(35.0, 25.0, mass=2.0))
    result = CliRunner().invoke(app, ["loops", str(file)])
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[3].split() == ["record", "law", "N", "N", "%", "%"]
    assert "asymmetric and mass" in lines[5]
    name, mass, *_ = next(line for line in lines[6:] if line.startswith(" steady")).split()
    assert (name, float(mass)) == ("steady", pytest.approx(2.0, abs=0.02))
    assert lines[-1].startswith("warning: steady: a zero of the load cell of 5")


def test_a_loop_of_none_of_the_laws_is_said_to_be_so() -> None:
    """A cubic spring takes nothing; friction that fits it best does."""
    known = steady()
    spring = replace(known, force=3e7 * (known.displacement - known.displacement.mean()) ** 3)
    assert fit_loop(spring)[0].warnings[0].startswith("none of these laws is that of the loop: the best one takes ")
    assert not any(line.startswith("none") for line in fit_loop(known)[0].warnings)


def test_a_loop_that_is_none_does_not_hide_the_others(tmp_path: Path) -> None:
    """Those that are asked for are read alone."""
    known = steady()
    given = replace(known, name="reversed", force=-known.force)
    file = tmp_path / "l.csv"
    both = [written(tmp_path / f"{one.name}.csv", one).read_text().splitlines() for one in (known, given)]
    file.write_text("\n".join([*both[0], *both[1][1:]]) + "\n")
    with pytest.raises(InputError, match="loop reversed: force_n gives out"):
        load_loops(file)
    assert [one.name for one in load_loops(file, ["steady"])] == ["steady"]
    result = CliRunner().invoke(app, ["loops", str(file), "--loop", "steady"])
    assert result.exit_code == 0, result.output


def test_one_loop_of_reversed_sign_among_others_is_left_out_and_said_to_be_so(tmp_path: Path) -> None:
    file, known = tmp_path / "l.csv", steady()
    loops = [known, replace(known, name="turned", force=-known.force), replace(known, name="again")]
    tables = [written(tmp_path / f"{one.name}.csv", one).read_text().splitlines() for one in loops]
    file.write_text("\n".join([tables[0][0], *(line for table in tables for line in table[1:])]) + "\n")
    with pytest.warns(
        PlausibilityWarning, match=r"loop turned: force_n gives out 0.5\d* J, .* reversed sign; left out"
    ):
        assert [one.name for one in load_loops(file)] == ["steady", "again"]
    result = CliRunner().invoke(app, ["loops", str(file), "--out", str(tmp_path / "laws.csv")])
    assert result.exit_code == 0, result.output
    assert "warning: turned: force_n gives out 0.5" in result.stdout
    (row,) = (line for line in (tmp_path / "laws.csv").read_text().splitlines() if line.startswith("turned"))
    assert row.startswith("turned,reversed sign,,,,,-0.5") and not row.split(",", 7)[7].strip(",")


def test_samples_beyond_whole_cycles_are_left_out(tmp_path: Path) -> None:
    for samples, kept, notes in (
        (500, 500, ()),
        (501, 500, ()),
        (480, 400, ("80 of 480 samples are beyond 4 whole cycles and left out",)),
        (100, 100, ()),
        (160, 100, ("60 of 160 samples are beyond 1 whole cycle and left out",)),
    ):
        found = load_loops(written(tmp_path / "l.csv", steady(samples=samples)))[0]
        assert (len(found.time), found.notes) == (kept, notes)


def test_loops_that_cannot_be_those_of_friction_are_refused(tmp_path: Path) -> None:
    file, known = tmp_path / "l.csv", steady()
    by_hand = MeasuredLoop("steady", known.time, 1e3 * known.displacement, known.force)
    assert load_loops(written(file, by_hand))[0].notes == ("displacement_m spans 2 m; is it in mm?",)
    for measured, line in (
        (MeasuredLoop("steady", known.time, known.displacement, -known.force), "force_n gives out 0.5095 J, as one of"),
        (steady(samples=80), "80 samples hold 0.8 cycles of displacement_m and do not end where they began; must be"),
        (steady(offset=50.0), "force_n is 19.68 to 80.26 N, of one sign throughout; must resist both ways: take the"),
    ):
        with pytest.raises(InputError) as refused:
            load_loops(written(file, measured))
        assert str(refused.value).startswith(f"{file}: loop steady: {line}")


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
