"""Sweeps through a known resonance, integrated in time: steady states, what they lag by, and how fast is slow."""

import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.signal import cont2discrete, lfilter
from typer.testing import CliRunner

from hbm.cli import app
from hbm.errors import InputError
from hbm.identification.modalfit import fit_modes
from hbm.measurement.recording import Recording, recording
from hbm.measurement.responses import frequency_responses
from hbm.measurement.spectrafile import load_spectra
from hbm.measurement.sweep import SLOW, passage, sweep_spectra, swept

RATE, HZ = 1000.0, 50.0
OMEGA = 2 * np.pi * HZ
SCALE = 1e4  # responses of order 1


def force_at(hz):
    """Drops at the resonance, as that of a shaker does."""
    return 1.0 - 0.3 * np.exp(-(((hz - HZ) / 3.0) ** 2))


@cache
def simulated(speed: float, ratio: float, cubic: float, begin: float, end: float):
    """Times, force and motion of x'' + 2 zeta omega x' + omega^2 x + cubic x^3 = F cos phi, phi of a linear sweep."""
    t = np.arange(0.0, (end - begin) / speed, 1.0 / RATE)

    def force(t):
        return force_at(begin + speed * t) * np.cos(2 * np.pi * (begin * t + 0.5 * speed * t**2))

    def motion(t, y):
        return [y[1], force(t) - 2 * ratio * OMEGA * y[1] - OMEGA**2 * y[0] - cubic * y[0] ** 3]

    x = SCALE * solve_ivp(motion, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-12, method="DOP853").y[0]
    return t, force(t), x


def run(speed: float, ratio: float = 0.01, cubic: float = 0.0, span=(42.0, 58.0), noise: float = 0.0) -> Recording:
    t, force, x = simulated(speed, ratio, cubic, *span)
    rng = np.random.default_rng(4)
    dirty = {"force": force + noise * rng.standard_normal(len(t)), "x": x + noise * rng.standard_normal(len(t))}
    return recording("up.csv", t, dirty)


def steady(hz, ratio: float = 0.01):
    omega = 2 * np.pi * hz
    return SCALE / (OMEGA**2 - omega**2 + 2j * ratio * OMEGA * omega)


@pytest.fixture(scope="module")
def fast() -> Recording:
    """Over three times too fast: 0.9 Hz/s would do for a bandwidth of 1 Hz."""
    return run(3.0, noise=0.02)


@pytest.mark.parametrize("speed", [0.7, 3.0])
def test_a_response_is_off_its_steady_state_by_what_is_stated(speed: float, fast: Recording) -> None:
    sweep = swept(fast if speed == 3.0 else run(speed, noise=0.02), "force", 3)
    found = sweep_spectra([sweep], "force")
    off = found.complex("x")[:, 1] - steady(found.hz) * found.complex("force")[:, 1]
    std = np.hypot(found.std[:, 1, 1], np.abs(steady(found.hz)) * found.std[:, 0, 1])  # the force is measured, too
    pulls = np.concatenate([off.real, off.imag]) / np.tile(std, 2)
    assert np.sqrt(np.mean(pulls**2)) == pytest.approx(1.0, abs=0.15)


def exact(
    begin: float, end: float, speed: float, ratios=(0.01, 0.008), hz=(45.0, 52.0), shares=(1.0, 0.5)
) -> dict[str, np.ndarray]:
    """Force and acceleration of modes of 45 and 52 Hz, of 1 and 0.8 %, or of others, sampled at 4 kHz.

    Each mode is integrated exactly for a force that is straight over an eighth of a sample.
    """
    t = np.arange(0.0, abs(end - begin) / speed, 1.0 / 32000.0)
    force = 2.0 * np.cos(2 * np.pi * (begin * t + 0.5 * np.sign(end - begin) * speed * t**2))
    motion = np.zeros_like(t)
    for of, ratio, share in zip(hz, ratios, shares, strict=True):
        omega = 2 * np.pi * of
        mode = np.array([1.0, 0.0, 0.0]), np.array([1.0, 2 * ratio * omega, omega**2])
        b, a, _ = cont2discrete(mode, 1.0 / 32000.0, "foh")
        motion += share * lfilter(b.ravel(), a, force)
    return {"force": force[::8], "a1": motion[::8]}


@pytest.mark.parametrize("span", [(40.0, 57.0), (57.0, 40.0)])
def test_modes_of_a_slow_sweep_are_right_by_what_is_stated(span: tuple[float, float]) -> None:
    """What a mode lags by is common to the windows of a sweep: no fit averages it out, up or down."""
    clean, truth, pulls = exact(*span, 0.4), np.array([45.0, 52.0, 0.01, 0.008]), []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        dirty = {name: values + 5e-3 * rng.standard_normal(len(values)) for name, values in clean.items()}
        measured = recording("sweep.csv", np.arange(len(dirty["a1"])) / 4000.0, dirty)
        spectra = sweep_spectra([swept(measured, "force", 1)], "force")
        found = fit_modes(frequency_responses(spectra, "force", {"a1": "acceleration"}).between(41.0, 56.0), 2)
        assert found.hz_std.max() < 1e-4
        std = np.concatenate([found.hz_std, found.ratio_std])
        pulls.append((np.concatenate([found.hz, found.ratio]) - truth) / std)
    assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.5


def test_what_modes_leave_at_a_low_peak_counts_there() -> None:
    """One of 70 Hz above the sweep is not described; the peak at 20 Hz is a fifteenth as high as that at 49 Hz."""
    ratios, hz, shares = (0.006, 0.004, 0.005), (20.0, 49.0, 70.0), (0.1, 1.0, -0.6)
    rng = np.random.default_rng(0)
    dirty = {
        name: values[::4] + 1e-3 * values.std() * rng.standard_normal(len(values[::4]))
        for name, values in exact(17.0, 60.0, 0.5, ratios, hz, shares).items()
    }
    found = sweep_spectra(
        [swept(recording("up.csv", np.arange(len(dirty["a1"])) / 1000.0, dirty), "force", 1)], "force"
    )
    w = 2 * np.pi * found.hz
    modes = [(s, 2 * np.pi * f, z) for s, f, z in zip(shares, hz, ratios, strict=True)]
    H = sum(-s * w**2 / (wn**2 - w**2 + 2j * z * wn * w) for s, wn, z in modes)
    off = found.complex("a1")[:, 1] - H * found.complex("force")[:, 1]
    pulls = np.abs(off) / np.hypot(found.std[:, 1, 1], np.abs(H) * found.std[:, 0, 1]) / np.sqrt(2.0)
    assert np.sqrt(np.mean(pulls**2)) == pytest.approx(1.0, abs=0.2)
    assert np.sqrt(np.mean(pulls[np.abs(found.hz - 20.0) < 0.4] ** 2)) < 2.5


@pytest.mark.parametrize("span", [(40.0, 57.0), (57.0, 40.0)])
@pytest.mark.parametrize("times", [8.0, 50.0])
def test_modes_of_a_sweep_that_is_too_fast_are_right_by_what_is_stated(times: float, span: tuple[float, float]) -> None:
    """Of 0.2 %: a mode grows, and falls, within a few windows, which do not see just its mean."""
    truth = np.array([45.0, 52.0, 0.002, 0.0025])
    clean, pulls = exact(*span, times * SLOW * (2 * 0.002 * 45.0) ** 2, tuple(truth[2:])), []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        dirty = {name: values + 5e-3 * rng.standard_normal(len(values)) for name, values in clean.items()}
        measured = recording("sweep.csv", np.arange(len(dirty["a1"])) / 4000.0, dirty)
        spectra = sweep_spectra([swept(measured, "force", 1)], "force")
        assert any("swept too fast" in line for line in spectra.warnings)
        found = fit_modes(frequency_responses(spectra, "force", {"a1": "acceleration"}).between(41.0, 56.0), 2)
        std = np.concatenate([found.hz_std, found.ratio_std])
        assert (std / truth < [1e-5, 1e-5, 5e-3, 5e-3]).all()
        pulls.append((np.concatenate([found.hz, found.ratio]) - truth) / std)
    assert np.sqrt(np.mean(np.square(pulls))) < 1.5


@pytest.mark.parametrize("span", [(15.0, 16.8), (16.8, 15.0)])
@pytest.mark.parametrize("decays", [1.0, 2.5])
def test_a_harmonic_that_crosses_a_mode_is_off_by_what_is_stated(span: tuple[float, float], decays: float) -> None:
    """A linear mode of 16.1 Hz drives by its cube one of 47.4 Hz, three times 15.8 Hz, which decays as fast or faster.

    Harmonic 3 of a force is cubed exactly: A^3/4. Nothing acts back, so that the steady state is a closed form, and
    both modes are integrated exactly for forces that are straight over a step.
    """
    begin, end = span
    step, speed = 1.0 / 8192.0, 0.02 * np.sign(end - begin)
    t = np.arange(0.0, (end - begin) / speed, step)
    force = np.cos(2 * np.pi * (begin * t + 0.5 * speed * t**2))
    first, second = ((2 * np.pi * 16.1, 0.006), (2 * np.pi * 47.4, decays * 0.006 * 16.1 / 47.4))

    def answer(mode: tuple[float, float], to):
        omega, ratio = mode
        b, a, _ = cont2discrete((np.array([1.0]), np.array([1.0, 2 * ratio * omega, omega**2])), step, "foh")
        return lfilter(b.ravel(), a, to)

    def of(mode: tuple[float, float], omega):
        return 1.0 / (mode[0] ** 2 - omega**2 + 2j * mode[1] * mode[0] * omega)

    moves = SCALE * answer(first, force)
    rng = np.random.default_rng(6)
    signals = {"force": force, "x": moves + 3.0 * answer(second, moves**3)}
    noisy = {name: values[::8] + 1e-3 * rng.standard_normal(len(values[::8])) for name, values in signals.items()}
    found = sweep_spectra([swept(recording("sweep.csv", t[::8], noisy), "force", 3)], "force")
    omega = 2 * np.pi * found.hz
    true = 0.75 * (SCALE * of(first, omega)) ** 3 * of(second, 3 * omega)
    F = found.complex("force")[:, 1]
    off = found.complex("x")[:, 3] / (F / np.abs(F)) ** 3 - true
    near = np.abs(found.hz - 15.95) < 0.4
    std = found.std[:, 1, 3]
    pulls = (np.concatenate([off.real, off.imag]) / np.tile(std, 2))[np.tile(near, 2)]
    assert 0.4 < np.sqrt(np.mean(pulls**2)) < 1.5
    assert np.abs(pulls).max() < 4.0


def test_resonance_and_bandwidth_are_those_of_the_mode_however_fast(fast: Recording) -> None:
    """The peak itself is low, wide and late."""
    sweep = swept(fast, "force", 3)
    passed = passage(sweep, "x", "force")
    size = np.abs(sweep.amplitudes[:, 1, 1] / sweep.amplitudes[:, 0, 1])
    assert size.max() < 0.85 * abs(steady(HZ))
    assert sweep.hz[size.argmax()] > HZ + 0.3
    assert passed.hz == pytest.approx(HZ, abs=0.03)
    assert passed.bandwidth == pytest.approx(2 * 0.01 * HZ, rel=0.05)
    assert passed.rate == pytest.approx(3.0, rel=0.02)
    assert passed.warning.startswith("swept too fast for x: 3 Hz/s at 49.98")
    assert passage(swept(run(0.7), "force", 3), "x", "force").warning is None


def test_a_response_without_a_resonance_tells_no_speed() -> None:
    """A constant share of the force at a constant phase: any speed would do."""
    t = np.arange(0.0, 30.0, 1.0 / RATE)
    phase = 2 * np.pi * (42.0 * t + 0.5 * 0.2 * t**2)
    found = sweep_spectra(
        [swept(recording("up.csv", t, {"force": np.cos(phase), "x": np.cos(phase - 1.0)}), "force")], "force"
    )
    said = "x passes no peak of 6 windows or more, which would say how fast is slow"
    assert [text for _, text in found.notes] == [said]


def test_a_nonlinear_resonance_is_followed_to_its_steady_states() -> None:
    """Hardening by 0.6 Hz at the peak; the steady state by one term of harmonic balance, exact but for its square."""
    ratio, cubic = 0.02, 0.8e11
    found = sweep_spectra([swept(run(0.4, ratio, cubic, (46.0, 55.0)), "force", 3)], "force")
    assert not found.notes

    def amplitude(hz: float) -> float:
        omega, F = 2 * np.pi * hz, force_at(hz)

        def left(A: float) -> float:
            return A * abs(OMEGA**2 + 0.75 * cubic * A**2 - omega**2 + 2j * ratio * OMEGA * omega) - F

        return brentq(left, 0.0, 2.0 * F / (2 * ratio * OMEGA**2))

    true = SCALE * np.array([amplitude(hz) for hz in found.hz])
    assert found.hz[true.argmax()] > HZ + 0.4
    late = found.hz > 46.5  # the start from rest has died out
    off = np.abs(found.complex("x")[:, 1])[late] - true[late]
    assert np.mean(np.abs(off) < 2.5 * found.std[late, 1, 1] + 0.002 * true.max()) > 0.9  # its flanks are steeper


STEP = 1.0 / 6000.0


def slipping(force: np.ndarray, limit: float) -> np.ndarray:
    """Motion of a mode of 50 Hz and 1 % behind a Jenkins element of 15 % of its stiffness, forces (n,) or (n, many).

    Velocity and displacement are stepped in turn. A sweep and steady states by this are those of one system, however
    long its steps are.
    """
    share = 0.15 * OMEGA**2
    x = v = z = 0.0
    moved = []
    for f in force.tolist() if force.ndim == 1 else force:
        held = share * (x - z)
        if force.ndim == 1:
            held = min(max(held, -limit), limit)
        else:
            held = np.clip(held, -limit, limit)
        z = x - held / share
        v = v + STEP * (f - 0.02 * OMEGA * v - (OMEGA**2 - share) * x - held)
        x = x + STEP * v
        moved.append(x)
    return SCALE * np.array(moved)


@pytest.mark.parametrize(
    ("begin", "end", "limit"), [(42.0, 50.0, 0.5), (56.0, 44.0, 0.5), (47.0, 58.0, 2.0), (42.0, 50.0, 4.0)]
)
def test_a_response_that_slips_is_off_by_what_is_stated(begin: float, end: float, limit: float) -> None:
    """No poles describe it: those of the first run off, and those of the last two leave less than the lag."""
    t = np.arange(0.0, abs(end - begin) / 0.5, STEP)
    force = np.cos(2 * np.pi * (begin * t + 0.25 * np.sign(end - begin) * t**2))
    rng = np.random.default_rng(0)
    signals = {"force": force[::4], "x": slipping(force, limit)[::4]}
    noisy = {name: values + 1e-3 * values.std() * rng.standard_normal(len(values)) for name, values in signals.items()}
    found = sweep_spectra([swept(recording("up.csv", t[::4], noisy), "force", 3)], "force")
    chosen = np.arange(12, len(found.hz) - 3, 5)
    chosen = chosen[np.abs(found.hz[chosen] - begin) > 0.7]  # the start from rest has died out
    hz = found.hz[chosen]
    t = np.arange(0.0, 3.0, STEP)
    moved = slipping(np.cos(2 * np.pi * t[:, None] * hz), limit)
    true = []
    for x, f in zip(moved.T, hz, strict=True):
        last = slice(-round(15 / f / STEP), None)
        waves = np.exp(2j * np.pi * f * np.outer(t[last], np.arange(1, 8)))
        columns = np.column_stack([np.ones(len(waves)), waves.real, -waves.imag])
        c = np.linalg.lstsq(columns, x[last], rcond=None)[0]
        true.append(c[1] + 1j * c[8])
    F = found.complex("force")[chosen, 1]
    off = found.complex("x")[chosen, 1] / F * np.abs(F) - np.array(true)
    pulls = np.concatenate([off.real, off.imag]) / np.tile(found.std[chosen, 1, 1], 2)
    assert 0.5 < np.sqrt(np.mean(pulls**2)) < 1.3
    assert np.abs(pulls).max() < 4.0


def test_a_dead_channel_of_a_sweep_is_left_out(fast: Recording) -> None:
    channels = {"dead": np.full(len(fast.time), 2.5), **fast.channels}
    found = sweep_spectra([swept(recording("up.csv", fast.time, channels), "force", 3)], "force")
    assert found.channels == ("force", "x")
    assert found.notes[0] == (1, "dead is constant: left out")
    with pytest.raises(InputError, match=r"up.csv: dead is constant; must move, it gives the phase"):
        swept(recording("up.csv", fast.time, channels), "dead", 3)


def test_a_channel_of_noise_alone_is_left_out_of_a_sweep_and_a_weak_one_is_not(fast: Recording) -> None:
    """White noise: of a loose plug; beside it the same, but for a motion as large as the noise."""
    rng, x = np.random.default_rng(4), fast.channels["x"]
    loose, weak = 1e-3 * x.std() * rng.standard_normal((2, len(x)))
    channels = {"loose": loose, "weak": weak + 1e-3 * x, "dead": 0.0 * x, **fast.channels}
    found = sweep_spectra([swept(recording("up.csv", fast.time, channels), "force", 3)], "force")
    assert found.channels == ("weak", *fast.channels)
    assert found.notes[:2] == (
        (1, "dead is constant: left out"),
        (1, "loose has no harmonic that stands out of its noise: left out. Is it dead?"),
    )


def test_a_sweep_that_pauses_is_refused(fast: Recording) -> None:
    """Without a force there is no phase: it runs back and forth in the pause."""
    on = np.abs(fast.time - 2.5) > 0.8
    channels = {name: values * on for name, values in run(3.0).channels.items()}
    with pytest.raises(InputError, match=r"the phase of force does not go on at .* without a pause"):
        swept(recording("up.csv", fast.time, channels), "force", 3)


def test_sweeps_may_have_different_channels(fast: Recording) -> None:
    other = Recording("two.csv", fast.time, {"y": fast.channels["x"], "force": fast.channels["force"]}, {})
    one, two = swept(fast, "force", 3), swept(other, "force", 3)
    found = sweep_spectra([one, two], "force")
    w = len(one.hz)
    assert found.channels == ("force", "x", "y")
    assert np.isnan(found.coefficients[w:, 1]).all()
    assert np.isnan(found.std[:w, 2]).all()
    np.testing.assert_array_equal(found.coefficients[w:, 2], found.coefficients[:w, 1])
    np.testing.assert_array_equal(found.coefficients[w:, 0], found.coefficients[:w, 0])


def test_a_sweep_needs_its_force(fast: Recording) -> None:
    by_voltage = Recording("up.csv", fast.time, {"u": fast.channels["force"], "x": fast.channels["x"]}, {})
    with pytest.raises(InputError, match=r"up.csv: no channel force that moves; must have it"):
        sweep_spectra([swept(by_voltage, "u", 3)], "force")


def test_sweeps_that_cannot_be_read_are_refused(fast: Recording) -> None:
    with pytest.raises(InputError, match='no channel "voltage"; channels are force, x'):
        swept(fast, "voltage")
    with pytest.raises(InputError, match=r"harmonic 11 of 45.\d* Hz; must be below 500 Hz, half the sampling rate"):
        swept(fast, "force", 11)
    with pytest.raises(InputError, match="fewer than 8 cycles of force"):
        swept(fast.between(0.0, 0.1), "force")


@pytest.mark.parametrize(("length", "least"), [(0.8, "1.3"), (30.0, "0.033")])
def test_a_steady_state_is_no_sweep(length: float, least: str) -> None:
    """Its frequency changes by less than one over its length, by which lines are told apart; a slow sweep's by more."""
    t, rng = np.arange(0.0, length, 1.0 / RATE), np.random.default_rng(7)

    def recorded(speed: float) -> Recording:
        force = np.cos(2 * np.pi * (48.0 * t + 0.5 * speed * t**2)) + 0.01 * rng.standard_normal(len(t))
        return recording("run1.csv", t, {"force": force})

    with pytest.raises(InputError) as refused:
        swept(recorded(0.0), "force", 3)
    assert str(refused.value) == (
        f"run1.csv: force stays at 48 Hz; must be a sweep, of {least} Hz at least over this time; "
        "spectra of a steady state are made without --sweep"
    )
    assert np.ptp(swept(recorded(3.0 / length**2), "force", 3).hz) > 1.0 / length


@pytest.mark.parametrize("options", [("--fundamental", "40"), ("--level", "3"), ("--refine",)])
def test_options_of_steady_states_do_not_go_with_sweeps(options: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "up.csv").write_text("time_s,force\n0,1\n")
    out = tmp_path / "s.csv"
    result = CliRunner().invoke(app, ["spectra", str(tmp_path / "up.csv"), "--sweep", *options, "--out", str(out)])
    assert (result.exit_code, result.stderr) == (2, f"spectra: {options[0]} with --sweep; must have one of them\n")
    assert not out.exists()


def test_sweeps_have_the_budget_of_other_recordings(fast: Recording, tmp_path: Path) -> None:
    np.savez(tmp_path / "up.npz", time_s=fast.time, **fast.channels)
    out = tmp_path / "s.csv"
    args = ["spectra", str(tmp_path / "up.npz"), "--sweep", "--max-seconds", "1e-6", "--out", str(out)]
    # a process of its own: a budget that is spent ends the process
    result = subprocess.run([sys.executable, "-m", "hbm.cli", *args], capture_output=True, text=True, timeout=100)
    assert (result.returncode, out.exists()) == (1, False)
    assert result.stderr.startswith("spectra: stopped after 1e-06 s, its budget, at 1 recordings; nothing written")


def test_the_command_writes_records_of_a_sweep(fast: Recording, tmp_path: Path) -> None:
    np.savez(tmp_path / "up.npz", time_s=fast.time, **fast.channels)
    out = tmp_path / "s.csv"
    result = CliRunner().invoke(
        app, ["spectra", str(tmp_path / "up.npz"), "--sweep", "--harmonics", "3", "--out", str(out)]
    )
    assert result.exit_code == 0, result.output
    assert "swept too fast for x" in result.stdout
    found = load_spectra(out)
    assert found.H == 3
    assert any("swept too fast" in text for _, text in found.notes)
    assert found.select(records=["up"]).hz.tolist() == found.hz.tolist()
    assert np.ptp(found.level) == 0.0
