"""Free decays whose instantaneous frequency and damping are known, and one simulated with friction beside its mode."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from hbm.cli import app
from hbm.errors import InputError
from hbm.measurement.decay import Decay, free_decay, over_amplitude
from hbm.measurement.recording import Recording, recording
from hbm.measurement.tone import steady_tone
from hbm.modes.decaying import over_channel, predicted
from hbm.response.budget import Budget
from hbm.rigfiles.load import load_rig

RATE, BAND = 4000.0, (95.0, 150.0)


def hz_of(A):
    return 122.45 - 0.47 * A


def ratio_of(A):
    return 4.2e-4 + 9.8e-4 * A


@pytest.fixture(scope="module")
def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Amplitude and phase over 3 s, by their own differential equation."""
    t = np.arange(0.0, 3.0, 1.0 / RATE)

    def rate(_, y):
        omega = 2 * np.pi * hz_of(y[0])
        return [-ratio_of(y[0]) * omega * y[0], omega]

    found = solve_ivp(rate, (0.0, t[-1]), [0.9, 0.3], t_eval=t, rtol=1e-10, atol=1e-12)
    return t, *found.y


def blow(motion, seed: int, noise: float = 0.02) -> Recording:
    """The mode, another one outside the band, and white noise."""
    t, A, phase = motion
    other = 0.2 * np.exp(-1.5 * t) * np.cos(2 * np.pi * 243.4 * t)
    y = A * np.cos(phase) + other + noise * np.random.default_rng(seed).standard_normal(len(t))
    return recording(f"blow{seed}.csv", t, {"v": y})


def pulls(d: Decay) -> tuple[np.ndarray, np.ndarray]:
    A = d.amplitude
    return (d.hz - hz_of(A)) / d.hz_std, (d.damping_ratio - ratio_of(A)) / d.damping_ratio_std


def test_the_mirror_image_bends_no_slope() -> None:
    """A straight decay without noise: its image at -110 Hz decays alike, and would be common to all blows."""
    t = np.arange(0.15, 4.0, 1.0 / RATE)
    omega, ratio = 2 * np.pi * 110.0, 0.008
    y = np.exp(-ratio * omega * t) * np.cos(omega * t)
    d = free_decay(recording("blow.csv", t, {"v": y}), "v", BAND)
    assert d.damping_ratio == pytest.approx(ratio / np.sqrt(1 + ratio**2), abs=1e-6)  # noise of 1e-4 gives 2e-6
    assert d.hz == pytest.approx(110.0, abs=5e-5)


def test_large_amplitudes_of_several_blows_are_right_within_their_deviations() -> None:
    """Where the noise is least what is common to all blows counts most: six draws of five blows."""
    t = np.arange(0.15, 2.0, 1.0 / RATE)
    omega, ratio, first = 2 * np.pi * 110.0, 0.008, []
    y = np.exp(-ratio * omega * t) * np.cos(omega * t)
    for seed in range(6):
        noise = 1e-4 * np.random.default_rng(seed).standard_normal((5, len(t)))
        blows = [free_decay(recording("blow.csv", t, {"v": y + own}), "v", BAND) for own in noise]
        d = over_amplitude(blows)
        off = d.damping_ratio[:3] - ratio / np.sqrt(1 + ratio**2), d.hz[:3] - 110.0
        first.append(np.concatenate([off[0] / d.damping_ratio_std[:3], off[1] / d.hz_std[:3]]))
    assert np.sqrt(np.mean(np.square(first))) < 1.3
    assert np.abs(first).max() < 3.5


def test_frequency_and_damping_are_right_within_their_deviations(motion) -> None:
    """Counted over 20 draws of noise, 20 windows each."""
    hz, ratio = (
        np.concatenate(p) for p in zip(*(pulls(free_decay(blow(motion, s), "v", BAND)) for s in range(20)), strict=True)
    )
    assert len(hz) > 300
    for p in (hz, ratio):
        assert abs(p.mean()) < 4.0 / np.sqrt(len(p))
        assert p.std() == pytest.approx(1.0, abs=0.2)


def test_without_noise_they_are_exact(motion) -> None:
    """What is left is that frequency and damping change within a window."""
    d = free_decay(blow(motion, 0, noise=0.0), "v", BAND)
    assert d.hz == pytest.approx(hz_of(d.amplitude), abs=2e-3)
    assert d.damping_ratio == pytest.approx(ratio_of(d.amplitude), rel=0.02)


def test_several_decays_differ_by_what_is_stated(motion) -> None:
    decays = [free_decay(blow(motion, s), "v", BAND) for s in range(8)]
    d = over_amplitude(decays)
    assert d.decays == 8
    hz, ratio = pulls(d)
    assert np.abs(hz).max() < 4.0
    assert np.abs(ratio).max() < 4.0
    assert d.hz_std.max() < decays[0].hz_std.max()


def test_what_is_clipped_is_left_out_with_a_warning(motion, tmp_path: Path) -> None:
    """Damping is flat where a flat top does not fall; what comes after it is as if nothing had been clipped."""
    whole = blow(motion, 0)
    v = np.clip(whole.channels["v"], -0.6, 0.7)
    last = int(np.flatnonzero((v == 0.7) | (v == -0.6))[-1])
    d = free_decay(replace(whole, channels={"v": v}), "v", BAND)
    line = f"blow0.csv: v is flat-topped up to {whole.time[last]:.4g} s: was it clipped? All before is left out"
    assert d.warnings == (line,)
    assert d.amplitude[0] < 0.7
    assert max(np.abs(part).max() for part in pulls(d)) < 4.0
    rest = whole.between(float(whole.time[last + 1]), 3.0)
    assert d.damping_ratio == pytest.approx(free_decay(rest, "v", BAND).damping_ratio, rel=1e-12)
    assert over_amplitude([d, free_decay(whole, "v", BAND), d]).warnings == (line,)
    np.savetxt(tmp_path / "b.csv", np.column_stack([whole.time, v]), delimiter=",", header="time_s,v", comments="")
    result = CliRunner().invoke(app, ["decay", str(tmp_path / "b.csv"), "--channel", "v", "--band", "95", "150"])
    assert result.exit_code == 0
    assert "b.csv: v is flat-topped up to " in result.stdout
    t = np.arange(0.0, 3.0, 1.0 / RATE)
    held = recording("b.csv", t, {"v": np.clip(np.cos(2 * np.pi * 110.3 * t), -0.7, 0.7)})
    with pytest.raises(
        InputError, match=r"b.csv after its flat tops: 0.00225 s; must be more than 0.12 s for a band of"
    ):
        free_decay(held, "v", BAND)
    with pytest.raises(
        InputError, match=r"b.csv after its flat tops: 1 samples from 2.997 to 2.997 s; must be at least"
    ):
        free_decay(held.between(0.0, float(t[-12])), "v", BAND)


@pytest.mark.parametrize("steps", [4, 40, 4000])
def test_steps_of_a_converter_are_no_flat_tops(motion, steps: int) -> None:
    t, A, phase = motion
    y = np.round(steps * A * np.cos(phase)) / steps
    assert not free_decay(recording("blow.csv", t, {"v": y}), "v", BAND).warnings


def test_what_is_no_decay_of_a_mode_is_refused(motion) -> None:
    recorded = blow(motion, 0)
    for channel, band, line in (
        ("a", BAND, 'no channel "a"; channels are v'),
        ("v", (95.0, 2500.0), "a band from 95 to 2500 Hz; must increase, within 0 and 2000 Hz, half the sampling rate"),
        ("v", (150.0, 95.0), "a band from 150 to 95 Hz; must increase, within 0 and 2000 Hz"),
        ("v", (122.0, 122.5), "3 s; must be more than "),
        ("v", (500.0, 540.0), "v stands out of the noise for "),
    ):
        with pytest.raises(InputError, match=line):
            free_decay(recorded, channel, band)


RIG = """
name = "one mode on a slider"
[modal]
frequencies_hz = [50.0]
shapes = [[1.0]]
contact_shape = [1.0]
excitation_shape = [1.0]
[damping]
modal_ratios = [0.0005]
[contact]
normal_load = 1.0
[contact.friction]
law = "coulomb-penalty"
mu = 0.5
critical_slip = 4e-4
[excitation]
amplitude = 1.0
[[channels]]
name = "v"
quantity = "velocity"
"""


TIME = np.arange(0.0, 4.0, 1.0 / RATE)
PHASE = 2 * np.pi * 110.0 * TIME


def read(y: np.ndarray, noise: float = 1e-3, seed: int = 3) -> Decay:
    own = noise * np.random.default_rng(seed).standard_normal(len(y))
    return free_decay(recording("run.csv", TIME[: len(y)], {"v": y + own}), "v", BAND)


def test_a_shaker_that_still_acts_and_modes_that_beat_are_warned_of() -> None:
    """A linear mode: released at 1.5 s; after a second blow at 2 s; and beside another one 3 Hz away."""
    fall = np.exp(-0.002 * PHASE)
    released = np.exp(-0.008 * np.maximum(PHASE - PHASE[6000], 0.0))
    (driven,) = read(released * np.cos(PHASE)).warnings
    assert driven.startswith("run.csv: v is damped by more as it falls: a force acts until 1.")
    assert "(--settle)" in driven
    again = np.concatenate([fall[:8000], fall[:8000]]) * np.cos(PHASE)
    beating = fall * (np.cos(PHASE) + 0.5 * np.cos(113.0 / 110.0 * PHASE))
    for y in (again, beating):
        (said,) = read(y).warnings
        assert said.startswith("run.csv: v grows: a force acts until ")


def test_small_amplitudes_are_damped_no_less_than_large_ones() -> None:
    """Where windows ended and began as noise has it the last of a decay said 0.4 deviations too little damping."""
    rng, fall = np.random.default_rng(8), np.exp(-0.004 * PHASE)
    last = [read(fall * np.cos(PHASE + phase), 0.03, seed) for seed, phase in enumerate(rng.uniform(0.0, 6.3, 80))]
    pulls = [(d.damping_ratio[-1] - 0.004) / d.damping_ratio_std[-1] for d in last]
    assert abs(np.mean(pulls)) < 0.3


@pytest.mark.parametrize("beside", [0.5, 12.0])
def test_a_steady_tone_is_told_and_counts_as_noise(beside: float) -> None:
    """A slow beat bends all of a window: deviations by the scatter in it were seven times too small."""
    own, pulls = np.exp(-0.006 * PHASE), []
    for seed in range(8):
        tone = 0.01 * np.cos((1.0 + beside / 110.0) * PHASE + seed)
        d = read(own * np.cos(PHASE) + tone, 1e-3, seed)
        (said,) = d.warnings
        found = re.match(r"run.csv: v has a steady tone at ([0-9.]+) Hz, of ([0-9.]+): it counts as noise", said)
        assert found is not None
        assert float(found[1]) == pytest.approx(110.0 + beside, abs=0.1)
        assert float(found[2]) == pytest.approx(0.01, rel=0.1)
        assert d.amplitude.min() > 0.08
        pulls += list((d.damping_ratio - 0.006) / d.damping_ratio_std)
    assert np.sqrt(np.mean(np.square(pulls))) < 1.3
    with pytest.raises(InputError, match=r"v stands out of the noise for 0 s .*; v has a steady tone at 1"):
        read(own * np.cos(PHASE) + 30.0 * tone)


def test_a_mode_whose_frequency_moves_is_not_taken_for_others() -> None:
    """It falls from 115 to 100 Hz; a third harmonic follows. Modes above were said to move by infinitely much."""
    own = np.exp(-1.0 * TIME)
    phase = 2.0 * np.pi * np.cumsum(100.0 + 15.0 * own**2) / RATE
    assert read(own * (np.cos(phase) + 0.1 * np.cos(3.0 * phase))).warnings == ()


@pytest.mark.parametrize(("unit", "power"), [("m", 0), ("m/s", 1), ("m/s2", 2), ("", 2)])
def test_other_modes_are_warned_of_as_far_as_they_move_the_place(unit: str, power: int) -> None:
    """Of a displacement a tenth as large at first, 0.025 at 1.39 s; pieces have 0.15 s. Harmonics are none."""
    own, other = np.exp(-0.3 * TIME), 0.1 * np.exp(-1.3 * TIME)
    harmonic = 0.1 * np.exp(-0.9 * TIME) * np.cos(3 * PHASE)
    noise = 1e-3 * np.random.default_rng(2).standard_normal(len(TIME))
    for size, hz in ((1.0, 243.0), (0.1, 243.0), (1.0, 1600.0)):
        y = own * np.cos(PHASE) + size * other * (hz / 110.0) ** power * np.cos(2 * np.pi * hz * TIME)
        d = free_decay(recording("run.csv", TIME, {"v": y + harmonic + noise}, {"v": unit}), "v", BAND)
        if size < 1.0:
            assert d.warnings == ()
            continue
        (said,) = d.warnings
        found = re.match(r"run.csv: until ([0-9.]+) s modes above 150 Hz move v by up to ([0-9.]+)%", said)
        assert found is not None
        assert float(found[1]) == pytest.approx(1.46, abs=0.15)
        assert float(found[2]) == pytest.approx(
            10.0 * np.exp(-0.13), abs=0.4
        )  # the middle of the first piece is at 0.13 s


@pytest.mark.parametrize(
    "envelope",
    [np.exp(-0.004 * PHASE), 1.0 - TIME / 4.05, 1.0 / (1.0 + 5.0 * TIME), np.maximum(1.0 - TIME, np.exp(-TIME) / 3)],
    ids=["viscous", "Coulomb", "quadratic", "friction that sticks"],
)
def test_what_damps_a_free_motion_is_not_warned_of(envelope: np.ndarray) -> None:
    for noise in (1e-4, 1e-2):
        assert read(envelope * np.cos(PHASE), noise).warnings == ()


def test_a_recording_that_begins_at_rest_is_refused_with_how_long_it_does() -> None:
    struck = np.where(TIME < 1.0, 0.0, np.exp(-0.008 * (PHASE - PHASE[4000])) * np.cos(PHASE))
    with pytest.raises(InputError, match=r"run.csv: v is at rest for 0\.9\d* s between 95 and 150 Hz; must begin in"):
        read(struck)


def test_decays_of_two_units_and_those_of_no_common_amplitude_are_not_put_together() -> None:
    d = read(np.exp(-0.008 * PHASE) * np.cos(PHASE))
    with pytest.raises(InputError, match="2 decays: v in m/s and a in m/s2; must be of one unit"):
        over_amplitude([replace(d, unit="m/s"), replace(d, channel="a", unit="m/s2")], source="2 decays")
    parts = {name: getattr(d, name)[:1] for name in ("amplitude", "hz", "hz_std", "damping_ratio", "damping_ratio_std")}
    other = {**parts, "amplitude": 2.0 * parts["amplitude"]}
    with pytest.raises(InputError, match="2 decays: 2 amplitudes in all, each in a class of its own; must be two in"):
        over_amplitude([replace(d, **parts), replace(d, **other)], source="2 decays")


def slider(x0: float, seconds: float, rate: int, k: float = 1250.0) -> Recording:
    """1 kg, 50 Hz, 0.05 %, beside a spring that slips at 0.5 N, by small steps and a return mapping."""
    omega, limit, dt = 2 * np.pi * 50.0, 0.5, 1.0 / rate
    x, v, T = x0, 0.0, min(k * x0, limit)
    out = np.empty(int(seconds * rate))
    for i in range(len(out)):
        out[i] = v
        v += dt * (-(omega**2) * x - 2 * 0.0005 * omega * v - T)
        x += dt * v
        T = max(-limit, min(limit, T + k * dt * v))
    return recording("slider.csv", np.arange(len(out)) / rate, {"v": out})


def test_a_decay_with_friction_follows_the_nonlinear_mode(tmp_path: Path) -> None:
    """Stick and slip in a march of its own; the mode is that of harmonic balance."""
    (tmp_path / "rig.toml").write_text(RIG)
    rig = load_rig(tmp_path / "rig.toml")
    d = free_decay(slider(4e-3, 3.0, 40_000), "v", (20.0, 90.0))
    mode = over_channel(rig, 1, "v", (float(d.amplitude.min()), float(d.amplitude.max())))
    hz, ratio = predicted(mode, "v", d.amplitude)
    assert np.ptp(hz) > 0.1
    assert ratio.max() > 2.0 * 0.0005
    assert d.hz == pytest.approx(hz, rel=5e-5)  # measured 3e-5, 0.4 %: both change within a window
    assert d.damping_ratio == pytest.approx(ratio, rel=0.008)


def test_where_friction_ceases_to_slip_the_deviations_say_so(tmp_path: Path) -> None:
    """The damping falls to a sixth within a window or two."""
    (tmp_path / "rig.toml").write_text(RIG.replace("critical_slip = 4e-4", "critical_slip = 4e-5"))
    rig = load_rig(tmp_path / "rig.toml")
    d = free_decay(slider(6e-4, 1.0, 40_000, k=12_500.0), "v", (20.0, 90.0))
    mode = over_channel(rig, 1, "v", (float(d.amplitude.min()), float(d.amplitude.max())))
    hz, ratio = predicted(mode, "v", d.amplitude)
    assert ratio.max() > 4.0 * ratio.min()
    assert (d.hz - hz) / d.hz_std == pytest.approx(0.0, abs=3.0)
    assert (d.damping_ratio - ratio) / d.damping_ratio_std == pytest.approx(0.0, abs=3.0)


def test_windows_that_agree_by_chance_are_known_no_better_for_it() -> None:
    A, hz = np.array([1.0, 0.8]), np.array([50.0, 49.9])
    alike = [Decay("d", "v", "", A, hz, np.full(2, 0.01), hz * 1e-4, np.full(2, 1e-3)) for _ in range(3)]
    d = over_amplitude(alike, bins=2)
    assert d.hz_std == pytest.approx(0.01)
    assert d.damping_ratio_std == pytest.approx(1e-3)
    apart = [replace(one, hz=one.hz + shift) for one, shift in zip(alike, (-0.3, 0.0, 0.3), strict=True)]
    assert over_amplitude(apart, bins=2).hz_std == pytest.approx(0.3 / np.sqrt(3.0))


def test_a_mode_is_found_over_the_amplitudes_of_an_accelerometer(tmp_path: Path) -> None:
    """1 m/s2 is a tenth of a millimetre at this frequency; a metre there would be far out of the spring's reach."""
    (tmp_path / "rig.toml").write_text(RIG.replace('"velocity"', '"acceleration"'))
    rig = load_rig(tmp_path / "rig.toml")
    mode = over_channel(rig, 1, "v", (0.5, 10.0))
    omega = 2 * np.pi * mode.hz
    assert mode.amplitude[0] * omega[0] ** 2 == pytest.approx(0.5 / 1.2, rel=0.05)
    assert mode.amplitude[-1] * omega[-1] ** 2 == pytest.approx(12.0, rel=0.05)


def test_the_command_prints_and_writes_the_table(motion, tmp_path: Path) -> None:
    t, *_ = motion
    np.savez(tmp_path / "blows.npz", time_s=t, **{f"v{s}": blow(motion, s).channels["v"] for s in range(3)})
    named = [part for s in range(3) for part in ("--channel", f"v{s}")]
    out = tmp_path / "decay.csv"
    args = ["decay", str(tmp_path / "blows.npz"), *named, "--band", "95", "150", "--out", str(out)]
    result = CliRunner().invoke(app, args)
    assert result.exit_code == 0, result.output
    table = np.genfromtxt(out, delimiter=",", names=True)
    assert table["frequency_hz"] == pytest.approx(hz_of(table["amplitude"]), abs=0.05)
    assert "3 decays" in result.stdout


def test_what_else_is_in_a_file_may_be_in_any_unit(motion, tmp_path: Path) -> None:
    t, *_ = motion
    columns = np.column_stack([t, np.ones_like(t), blow(motion, 0).channels["v"], np.full_like(t, 21.0)])
    heading = "time_s,hammer [V],v [mm/s],room [degC]"
    np.savetxt(tmp_path / "blow.csv", columns, delimiter=",", header=heading, comments="")
    (tmp_path / "manifest.csv").write_text("file,channels,units\nblow.csv,tip=v|room=room,room=K\n")
    for file, channel in (("blow.csv", "v"), ("manifest.csv", "tip")):
        args = ["decay", str(tmp_path / file), "--band", "95", "150", "--channel"]
        result = CliRunner().invoke(app, [*args, channel])
        assert result.exit_code == 0, result.output
        assert "m/s" in result.stdout
        refused = CliRunner().invoke(app, [*args, "w"])
        assert refused.stderr == f'{tmp_path / "blow.csv"}: no channel "w"; channels are hammer, v, room\n'


def test_a_channel_the_rig_does_not_have_is_refused(motion, tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(RIG)
    t, *_ = motion
    np.savez(tmp_path / "blows.npz", time_s=t, tip=blow(motion, 0).channels["v"])
    args = ["decay", str(tmp_path / "blows.npz"), "--channel", "tip", "--band", "95", "150"]
    result = CliRunner().invoke(app, [*args, "--rig", str(tmp_path / "rig.toml")])
    assert (result.exit_code, result.stderr) == (
        2,
        f"decay: channel tip is not in {tmp_path / 'rig.toml'}; must be one of its channels\n",
    )


def test_beside_a_rig_the_unit_is_that_of_its_channel_and_nothing_need_be_left_out(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(RIG)
    recorded = slider(4e-3, 1.0, 10_000)
    np.savez(tmp_path / "blow.npz", time_s=recorded.time, v=recorded.channels["v"])
    args = ["decay", str(tmp_path / "blow.npz"), "--channel", "v", "--band", "20", "90", "--settle", "0.0"]
    result = CliRunner().invoke(app, [*args, "--rig", str(tmp_path / "rig.toml")])
    assert result.exit_code == 0, result.output
    heading, units = result.stdout.splitlines()[2:4]
    assert heading.split()[0] == "v" and units.split()[0] == "m/s"
    alone = CliRunner().invoke(app, args)
    assert alone.stdout.splitlines()[3].split("  ")[0].strip() == "unit not stated"
    refused = CliRunner().invoke(app, [*args[:-1], "-1"])
    assert (refused.exit_code, refused.stderr) == (2, "decay: --settle = -1; must be a number >= 0 [s]\n")


def test_what_was_measured_is_written_where_the_mode_of_the_rig_does_not_reach_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A trace of so few points ends short of the largest amplitudes."""
    monkeypatch.setattr("hbm.modes.amplitudes.BUDGET", Budget(points=4))
    (tmp_path / "rig.toml").write_text(RIG)
    recorded, out = slider(4e-3, 1.0, 10_000), tmp_path / "decay.csv"
    np.savez(tmp_path / "blow.npz", time_s=recorded.time, v=recorded.channels["v"])
    args = ["decay", str(tmp_path / "blow.npz"), "--channel", "v", "--band", "20", "90", "--out", str(out)]
    result = CliRunner().invoke(app, [*args, "--rig", str(tmp_path / "rig.toml")])
    assert result.exit_code == 1
    table = np.genfromtxt(out, delimiter=",", names=True)
    beyond = np.isnan(table["simulated_hz"])
    assert 0 < beyond.sum() < len(beyond)
    assert np.isfinite(table["frequency_hz"]).all()
    assert table["amplitude"][beyond].min() > table["amplitude"][~beyond].max()
    assert re.fullmatch(
        rf"decay: one mode on a slider: mode 1 reaches v = \S+ to \S+: {beyond.sum()} of {len(beyond)} amplitudes are "
        r"not compared; stopped at .*: 4 points are its budget; .*\n",
        result.stderr,
    )
    plain = CliRunner().invoke(app, args)
    assert plain.exit_code == 0
    assert np.genfromtxt(out, delimiter=",", names=True)["frequency_hz"] == pytest.approx(table["frequency_hz"])


def test_a_tone_under_a_decay_of_many_samples_is_found_as_under_one_of_few() -> None:
    """A matrix of as many rows and columns as there are samples would take hours."""
    rng = np.random.default_rng(1)
    for samples in (300, 40_000):
        t = 0.05 * np.arange(samples)
        noise = 2e-3 * (rng.standard_normal(samples) + 1j * rng.standard_normal(samples))
        tone = steady_tone(t, np.exp(-24.0 * t / t[-1]) + 0.02 * np.exp(1.3j * t) + noise)
        assert tone is not None
        assert tone.omega == pytest.approx(1.3, abs=0.02)
        assert tone.amplitude == pytest.approx(0.02, rel=0.02)
