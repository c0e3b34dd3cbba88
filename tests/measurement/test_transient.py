"""Responses from rest to rest: modes marched in time under hits that follow each other, and read with noise."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter
from typer.testing import CliRunner, Result

from hbm import load_rig
from hbm.cli import app
from hbm.errors import InputError
from hbm.identification.modalfit import fit_modes
from hbm.measurement.clipping import clipped_from_rest
from hbm.measurement.recording import Recording, recording
from hbm.measurement.transient import responses_from_rest

HZ, RATIO = np.array([20.0, 31.0, 55.0]), np.array([0.01, 0.005, 0.008])
SHAPES = np.array([[0.9, 0.5, 1.1], [0.4, -0.9, -0.3], [-0.2, 0.8, -0.7]])
CHANNELS = {"a1": "acceleration", "v2": "velocity", "x3": "displacement"}
NOISE, RATE, KEPT = 1e-3, 32768, 16
"""Of the largest of each channel; steps per second of the march, and every which is read."""


def modal_march(force: np.ndarray) -> tuple[np.ndarray, ...]:
    """Exact motion of every mode under a force that changes evenly over each step: q, q', q'', each (N, 3)."""
    dt, w = 1.0 / RATE, 2 * np.pi * HZ
    found = []
    for j in range(3):
        A = np.zeros((4, 4))
        A[0, 1] = A[1, 2] = A[2, 3] = 1.0
        A[1, :2] = -(w[j] ** 2), -2 * RATIO[j] * w[j]
        E, p = expm(A * dt), force * SHAPES[0, j]
        driven = np.outer(p, E[:2, 2]) + np.outer(np.append(np.diff(p), 0.0) / dt, E[:2, 3])
        values, vectors = np.linalg.eig(E[:2, :2])
        driven = np.roll(driven @ np.linalg.inv(vectors).T, 1, axis=0)
        x = np.stack([lfilter([1.0], [1.0, -v], driven[:, i]) for i, v in enumerate(values)], axis=1) @ vectors.T
        q, v = x.real.T
        found.append((q, v, p - w[j] ** 2 * q - 2 * RATIO[j] * w[j] * v))
    return tuple(np.array(parts).T for parts in zip(*found, strict=True))


def hits(seed: int, apart: float = 1.0) -> Recording:
    """Four hits of 6 ms, then rest. After one second mode 1 still moves by a quarter of its largest."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(RATE * (8.0 + 4 * apart))) / RATE
    force = np.zeros_like(t)
    begins = 0.7 + apart * np.arange(4) + rng.uniform(0.0, 0.05, 4)
    for begin, size in zip(begins, rng.uniform(50.0, 150.0, 4), strict=True):
        touching = (t >= begin) & (t < begin + 6e-3)
        force[touching] += size * np.sin(np.pi * (t[touching] - begin) / 6e-3) ** 2
    q, v, a = modal_march(force)
    read = {"a1": a @ SHAPES[0], "v2": v @ SHAPES[1], "x3": q @ SHAPES[2], "force": force}
    read = {name: values[::KEPT] for name, values in read.items()}
    noisy = {
        name: values + NOISE * np.abs(values).max() * rng.standard_normal(len(values)) for name, values in read.items()
    }
    return recording("hits.csv", t[::KEPT], noisy, {"a1": "m/s2", "v2": "m/s", "x3": "m", "force": "N"})


@pytest.fixture(scope="module")
def recorded() -> Recording:
    return hits(0)


def test_modes_of_hits_are_those_marched_and_as_uncertain_as_stated() -> None:
    """Of 15 numbers of three recordings; shapes are not low because the force was read with an error."""
    pulls, of_shapes = [], []
    for seed in range(3):
        m = fit_modes(responses_from_rest(hits(seed), "force", CHANNELS).between(12.0, 70.0), drive="a1")
        assert len(m) == 3
        assert m.chi2_reduced == pytest.approx(1.0, abs=0.15)
        A = SHAPES * SHAPES[0]
        of_shapes.append(np.sign(A) * (m.A - A) / m.A_std)
        pulls.append(np.concatenate([(m.hz - HZ) / m.hz_std, (m.ratio - RATIO) / m.ratio_std, of_shapes[-1].ravel()]))
    assert 0.7 < np.sqrt(np.mean(np.square(pulls))) < 1.35
    assert abs(np.mean(of_shapes)) < 0.7


def test_a_recording_that_does_not_begin_and_end_at_rest_is_refused(recorded: Recording) -> None:
    with pytest.raises(InputError, match=r"hits.csv: a1 moves by [\d.]+% of its largest in the first"):
        responses_from_rest(recorded.between(0.75, 12.0), "force", CHANNELS)
    with pytest.raises(InputError, match=r"a1 moves by [\d.]+% of its largest in the last .* s; must be at rest"):
        responses_from_rest(recorded.between(0.0, 5.0), "force", CHANNELS)


@pytest.mark.parametrize("dead", ["a1", "force"])
def test_a_channel_that_is_constant_is_refused(dead: str, recorded: Recording) -> None:
    still = recording("hits.csv", recorded.time, {**recorded.channels, dead: np.full(len(recorded.time), 0.25)})
    with pytest.raises(InputError, match=f"hits.csv: {dead} is constant; must move, or be left out of the file"):
        responses_from_rest(still, "force", CHANNELS)


def test_a_channel_of_noise_alone_is_called_dead(recorded: Recording) -> None:
    noise = np.random.default_rng(4).standard_normal(len(recorded.time))
    dead = recording("hits.csv", recorded.time, {**recorded.channels, "v2": noise})
    with pytest.raises(InputError, match=r"hits.csv: v2 moves no more than before the first hit: is it dead"):
        responses_from_rest(dead, "force", CHANNELS)


def test_what_leaks_of_a_line_at_rest_counts_as_noise() -> None:
    """Of mains beside mode 2, 0.25 Hz of 31 Hz, in all channels; without one nothing is said."""
    good = hits(2)
    hum = np.sin(2 * np.pi * 31.25 * good.time)
    read = {name: values + 3e-3 * np.abs(values).max() * hum for name, values in good.channels.items()}
    found = responses_from_rest(Recording("", good.time, read, good.units), "force", CHANNELS)
    assert responses_from_rest(good, "force", CHANNELS).warnings == ()
    assert [line.split(" at 31.")[0] for line in found.warnings] == [f"{n} has a line" for n in ("force", *CHANNELS)]
    m = fit_modes(found.between(12.0, 70.0), drive="a1")
    assert len(m) == 3
    assert m.hz_std[1] > 5.0 * m.hz_std[2]
    assert np.abs((m.hz - HZ) / m.hz_std).max() < 4.0
    assert np.abs((m.ratio - RATIO) / m.ratio_std).max() < 4.0


def test_what_is_no_such_recording_is_refused(recorded: Recording) -> None:
    with pytest.raises(InputError, match='no channel "hammer"; channels are a1, v2, x3, force'):
        responses_from_rest(recorded, "hammer", CHANNELS)
    time = recorded.time + 1e-4 * np.sin(20.0 * recorded.time)
    uneven = recording("hits.csv", time, recorded.channels)
    with pytest.raises(InputError, match="must be equal to find frequency responses"):
        responses_from_rest(uneven, "force", CHANNELS)


def test_the_command_makes_a_rig_of_hits(recorded: Recording, tmp_path: Path) -> None:
    file, rig = tmp_path / "hits.csv", tmp_path / "rig.toml"
    table = np.column_stack([recorded.time, *recorded.channels.values()])
    np.savetxt(file, table, delimiter=",", header="time_s,a1 (m/s2),v2 (m/s),x3 (m),force (N)", comments="")
    asked = ["modal", str(file), "--transient", "--drive", "a1", "--from", "12", "--to", "70", "--out", str(rig)]
    told = CliRunner().invoke(app, asked, catch_exceptions=False)
    assert told.exit_code == 0, told.output
    assert "3 modes" in told.output
    found = load_rig(rig)
    assert np.array(found.body.frequencies_hz) == pytest.approx(HZ, rel=1e-4)
    assert [c.quantity for c in found.channels] == ["force", "acceleration", "velocity", "displacement"]
    refused = CliRunner().invoke(app, [*asked, "--record", "1"])
    assert refused.exit_code
    assert "--record" in refused.output
    np.savetxt(file, table[:9], delimiter=",", header="time_s,a1,v2,x3,force (mm)", comments="")
    refused = CliRunner().invoke(app, asked)
    assert (refused.exit_code, refused.stderr) == (2, f"{file}: channel force is in m; must be force, N\n")


@pytest.mark.parametrize("rough", [0.0, NOISE])
def test_a_channel_that_is_clipped_is_named_also_under_the_noise_of_what_comes_after(rough: float) -> None:
    """At 60 % of its largest, before and after noise is added; hits and motions that are not clipped have none."""
    good = hits(0)
    assert responses_from_rest(good, "force", CHANNELS).warnings == ()
    rng = np.random.default_rng(7)
    for name in ("a1", "force"):
        v = good.channels[name]
        limit = 0.6 * np.abs(v).max()
        flat = np.clip(v, -limit, limit) + rough * limit * rng.standard_normal(len(v))
        read = Recording("hits.csv", good.time, {**good.channels, name: flat}, good.units)
        assert responses_from_rest(read, "force", CHANNELS).warnings == (f"{name} is flat-topped: was it clipped?",)


def test_a_channel_that_is_clipped_for_few_samples_is_named() -> None:
    """What rises fast is beside its limit in two samples of each hit: they are no run, but all are of one value."""
    good, rng = hits(0), np.random.default_rng(3)
    short = np.zeros(len(good.time))
    for begin in (1000, 5000, 9000):
        short[begin : begin + 5] = np.array([0.2, 0.7, 1.0, 0.8, 0.3]) * rng.uniform(90.0, 100.0)
    noisy = short + 0.05 * rng.standard_normal(len(short))
    for limit, clipped in ((1e3, ()), (60.0, ("force is flat-topped: was it clipped?",))):
        read = {**good.channels, "force": np.clip(np.round(noisy, 3), -limit, limit)}
        assert responses_from_rest(Recording("", good.time, read, good.units), "force", CHANNELS).warnings == clipped


def test_spikes_are_named_with_their_time_and_hits_are_none() -> None:
    """Of 5 % of the largest motion, while it rings; the largest is told."""
    good = hits(1)
    ringing = good.channels["a1"].copy()
    for at, size in ((9000, 0.04), (12000, -0.05)):
        ringing[at] += size * np.abs(ringing).max()
    read = Recording("", good.time, {**good.channels, "a1": ringing}, good.units)
    assert responses_from_rest(good, "force", CHANNELS).warnings == ()
    (said,) = responses_from_rest(read, "force", CHANNELS).warnings
    assert said.startswith(f"a1 has a spike at {good.time[12000]:.5g} s, ") and "no force acts then" in said


@pytest.mark.parametrize("steps", [20, 200, 30_000])
def test_hits_on_a_coarse_converter_are_not_clipped(steps: int) -> None:
    t = np.arange(40_000) / 2000.0
    falls = np.where(t > 1.0, np.exp(-1.5 * (t - 1.0)) * np.sin(2 * np.pi * 7.3 * (t - 1.0)), 0.0)
    assert not clipped_from_rest(np.round(steps * falls), 0.0)
    assert clipped_from_rest(np.clip(np.round(steps * falls), -0.7 * steps, 0.7 * steps), 0.0) == (steps > 20)


def test_channels_of_hits_that_are_late_or_reversed_are_named(recorded: Recording, tmp_path: Path) -> None:
    """By samples of 1/2048 s; modes are those on one clock."""

    def run(name: str, **changed: np.ndarray) -> Result:
        path = tmp_path / f"{name}.csv"
        columns = {"time_s": recorded.time, **recorded.channels, **changed}
        np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
        band = ["--from", "12", "--to", "70", "--quantity", "v2=velocity", "--quantity", "x3=displacement"]
        return CliRunner().invoke(
            app, ["modal", str(path), "--transient", "--drive", "a1", *band, "--out", str(tmp_path / f"{name}.toml")]
        )

    moved = {name: np.roll(values, 5) for name, values in recorded.channels.items()}
    assert "warning" not in run("clean").stdout
    late = " ".join(run("late", v2=moved["v2"]).stdout.split())
    assert "warning: v2 comes 2.44" in late
    assert "ms after the force" in late
    assert load_rig(tmp_path / "late.toml").structure.omega_n == pytest.approx(2 * np.pi * HZ, rel=2e-4)
    early = " ".join(run("early", force=moved["force"]).stdout.split())
    assert "warning: all channels come 2.44" in early
    assert "ms before the force" in early
    reversed_ = run("reversed", a1=-recorded.channels["a1"])
    assert reversed_.exit_code == 2
    assert reversed_.stderr.startswith("modal: a1 moves against the force in all 3 modes")
