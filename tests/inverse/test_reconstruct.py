from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import chi2

from hbm.errors import InputError
from hbm.identification.start import scales_of
from hbm.inverse.contact import Contact
from hbm.inverse.contactforce import prior
from hbm.inverse.observed import observe
from hbm.inverse.reconstruct import reconstruct
from hbm.inverse.unseen import Unseen
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from hbm.response.trace import steady_state
from models.causes import CAUSES
from models.friction import Dahl, FrictionLaw, Iwan, Jenkins
from tests.inverse.measurement import RIG, SAMPLES, Truth, measured, respond, with_noise

STD = {"force": 1e-4, **{f"a{i}": 0.02 for i in range(1, 7)}}
THETA = 2 * np.pi * np.arange(SAMPLES) / SAMPLES


def friction_of(k: np.ndarray, amplitude: np.ndarray, phase: np.ndarray) -> np.ndarray:
    return (amplitude * np.cos(np.outer(THETA, k) + phase)).sum(axis=1)


def excess(friction: np.ndarray, normal: np.ndarray) -> float:
    """By how much the limit |T| / R is larger forwards than backwards."""
    return float((friction / normal).max() + (friction / normal).min())


def record(hz: float, size: float, seed: int) -> tuple[float, Truth]:
    """A force of harmonics up to 9 that fall like k^-2, with the mean that makes its limits equal both ways."""
    rng = np.random.default_rng(seed)
    k = np.arange(1, 10)
    amplitude = size * k**-2.0 * np.where(k % 2, 1.0, 0.3)
    alternating = friction_of(k, amplitude, rng.uniform(0, 2 * np.pi, len(k)))
    force = 6.5 * np.exp(1j * rng.uniform(0, 2 * np.pi))
    mean = 0.0
    for _ in range(6):
        truth = respond(RIG, hz, force, alternating + mean)
        mean = brentq(lambda m, R=truth.normal: excess(alternating + m, R), -40.0, 40.0)
    return hz, truth


RECORDS = [record(46.0, 20.0, 1), record(50.0, 40.0, 2), record(54.0, 30.0, 3), record(57.5, 10.0, 4)]


@pytest.fixture(scope="module")
def clean() -> MeasuredSpectra:
    return measured(RIG, RECORDS, STD, 9)


def stacked(name: str) -> np.ndarray:
    return np.array([getattr(truth, name) for _, truth in RECORDS])


def zero_mean(samples: np.ndarray) -> np.ndarray:
    return samples - samples.mean(axis=1, keepdims=True)


def within(estimate: np.ndarray, truth: np.ndarray, std: np.ndarray) -> np.ndarray:
    return np.abs(estimate - truth) < 1.96 * std


def test_noiseless_records_give_friction_slip_and_reaction_back(clean: MeasuredSpectra) -> None:
    """To 5e-4 of their peaks: what the two models' ways of cutting off modes and harmonics differ by."""
    found = reconstruct(RIG, replace(clean, std=clean.std / 100))
    assert found.slips.tolist() == [True, True, True, False]
    for name in ("friction", "slip", "normal"):
        truth, samples = stacked(name), found[name].samples
        assert np.abs(zero_mean(samples) - zero_mean(truth)).max() < 5e-4 * np.abs(truth).max()
        means = samples.mean(axis=1), truth.mean(axis=1)
        assert np.allclose(means[0][:3], means[1][:3], atol=5e-4 * np.abs(truth).max())  # the stuck one's is not known


def test_slip_velocity_is_the_derivative_of_slip(clean: MeasuredSpectra) -> None:
    found = reconstruct(RIG, clean)
    u, v = found["slip"].samples, found["slip_velocity"].samples
    over = np.fft.irfft(1j * np.arange(u.shape[1] // 2 + 1) * np.fft.rfft(u, axis=1), u.shape[1], axis=1)
    # the products of harmonics up to H reach 2 H: slip keeps those up to H, like every signal
    assert np.allclose(v, 2 * np.pi * clean.hz[:, None] * over, atol=1e-9 * np.abs(v).max())


def test_a_record_of_noise_alone_is_named_first(clean: MeasuredSpectra) -> None:
    coefficients = clean.coefficients.copy()
    std = np.hstack([clean.std[3], clean.std[3][:, 1:]])
    coefficients[3] = std * np.random.default_rng(4).standard_normal(std.shape)
    found = reconstruct(RIG, replace(clean, coefficients=coefficients))
    assert found.warnings[0].startswith("record 4 of ") and "reads noise alone" in found.warnings[0]


def test_energy_is_the_area_of_the_loop_and_work_rate_the_mean_of_load_times_speed(clean: MeasuredSpectra) -> None:
    found = reconstruct(RIG, clean)
    T, u, R = stacked("friction"), stacked("slip"), stacked("normal")
    area = -np.sum((T + np.roll(T, -1, axis=1)) / 2 * (np.roll(u, -1, axis=1) - u), axis=1)
    assert np.allclose(found.energy_per_cycle.value, area, rtol=2e-3, atol=2e-6)  # trapezoids of 256 samples
    path = np.sum((R + np.roll(R, -1, axis=1)) / 2 * np.abs(np.roll(u, -1, axis=1) - u), axis=1)
    assert np.allclose(found.work_rate.value, clean.hz * path, rtol=3e-3)


def repeated(spectra: MeasuredSpectra, times: int) -> MeasuredSpectra:
    again = {name: np.concatenate([getattr(spectra, name)] * times) for name in ("level", "hz", "coefficients", "std")}
    return replace(spectra, records=np.arange(1, times * len(spectra) + 1), **again)


def test_intervals_of_95_percent_hold_the_truth_93_to_97_times_of_100(
    clean: MeasuredSpectra, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Monte Carlo over 250 draws of the noise: harmonics of every signal, energy and work rate."""
    monkeypatch.setattr(Unseen, "friction", 0.0)  # by noise alone: harmonics above are missing in both,
    monkeypatch.setattr(Contact, "mean_std", lambda *_: 0.0)  # and the mean has a test of its own
    draws = 250
    noisy = replace(clean, std=3 * clean.std)  # or 1000 records would see what the two models cut off differently
    found = reconstruct(RIG, with_noise(repeated(noisy, draws), np.random.default_rng(20261121)))
    exact = reconstruct(RIG, replace(clean, std=clean.std / 1000))  # free of noise and prior
    covered = {}
    for name in ("friction", "slip", "normal"):
        error = found[name].complex[:, 1:] - np.tile(exact[name].complex[:, 1:], (draws, 1))
        std = found[name].coefficient_std[:, 1:]
        covered[name] = np.mean([within(error.real, 0.0, std), within(error.imag, 0.0, std)])
    for name in ("energy_per_cycle", "work_rate"):
        estimate, true = getattr(found, name), np.tile(getattr(exact, name).value, draws)
        covered[name] = np.mean(within(estimate.value, true, estimate.std))
    assert all(0.93 < share < 0.97 for share in covered.values()), covered


def test_shifting_the_time_origin_shifts_the_signals(clean: MeasuredSpectra) -> None:
    """By a quarter of a period, which moves samples by a quarter of their number."""
    turn = np.exp(1j * np.pi / 2 * np.arange(clean.H + 1))
    c = np.stack([clean.complex(name) for name in clean.channels], axis=1) * turn
    shifted = replace(clean, coefficients=np.concatenate([c.real, -c.imag[:, :, 1:]], axis=2))
    here, there = reconstruct(RIG, clean), reconstruct(RIG, shifted)
    for name in ("friction", "slip", "normal"):
        moved = np.roll(here[name].samples, -here[name].samples.shape[1] // 4, axis=1)
        assert np.allclose(there[name].samples, moved, atol=1e-7 * np.abs(moved).max())


def test_without_a_force_channel_the_responses_give_the_force_too(clean: MeasuredSpectra) -> None:
    """Six sensors, two unknowns: friction stays within its wider error bars."""
    found = reconstruct(RIG, clean.without("force"))
    with_force = reconstruct(RIG, clean)
    error = found["friction"].complex[:, 1] - with_force["friction"].complex[:, 1]
    assert np.all(np.abs(error) < 3 * found["friction"].coefficient_std[:, 1])
    assert np.all(found["friction"].coefficient_std[:, 1] > with_force["friction"].coefficient_std[:, 1])


def test_harmonics_that_were_not_measured_have_the_uncertainty_of_the_prior(clean: MeasuredSpectra) -> None:
    found = reconstruct(RIG, clean.select(harmonics=[1, 2, 3, 4, 5, 6, 8, 9]))
    friction = found["friction"]
    assert np.all(np.isinf(found.resolution[:, 7]))
    assert np.allclose(friction.complex[:, 7], 0.0)
    true = np.abs(reconstruct(RIG, clean)["friction"].complex[:, 7])
    assert np.all((true < 3 * friction.coefficient_std[:, 7]) & (friction.coefficient_std[:, 7] < 20 * true))


def test_the_prior_finds_the_decay_and_the_sizes_of_a_spectrum() -> None:
    """200 draws of 30 harmonics that fall like k^-2, even ones a tenth of the odd ones, under small noise."""
    rng = np.random.default_rng(7)
    k = np.arange(1, 31)
    size = k**-2.0 * np.where(k % 2, 1.0, 0.1)
    draws = np.abs(size * (rng.normal(size=(200, 30)) + 1j * rng.normal(size=(200, 30))))
    order, likely, largest = prior(draws, np.full((200, 30), 1e-5))
    assert np.mean(order == 2.0) > 0.9
    assert np.allclose(np.median(likely, axis=0), [0.1, 1.0], rtol=0.35)  # sizes are tried in steps of a third
    assert np.all(largest >= likely)


def test_contradicting_sensors_widen_the_error_bars(clean: MeasuredSpectra) -> None:
    """Noise five times what is stated: chi2 says so, and the standard deviations follow."""
    rng = np.random.default_rng(3)
    noisy = with_noise(replace(clean, std=5 * clean.std), rng)
    stated = replace(noisy, std=clean.std)
    found, honest = reconstruct(RIG, stated), reconstruct(RIG, noisy)
    assert not found.misfit.consistent.any()
    assert honest.misfit.consistent.all()
    assert np.allclose(found.misfit.reduced, 25.0, rtol=0.4)
    ratio = found["friction"].coefficient_std[:, 1] / honest["friction"].coefficient_std[:, 1]
    assert np.allclose(ratio, 1.0, rtol=0.25)


def test_contradicting_sensors_say_nothing_of_a_harmonic_that_none_measured(clean: MeasuredSpectra) -> None:
    kept, rng = [1, 2, 3, 4, 5, 6, 8, 9], np.random.default_rng(3)
    noisy = with_noise(replace(clean, std=5 * clean.std), rng).select(harmonics=kept)
    found = reconstruct(RIG, replace(noisy, std=noisy.std / 5))["friction"].coefficient_std
    agreeing = reconstruct(RIG, noisy)["friction"].coefficient_std
    assert np.allclose(found[:, 1], agreeing[:, 1], rtol=0.25)
    assert np.allclose(found[:, 7], agreeing[:, 7], rtol=0.25)


ELEMENTS = {
    "midplane-stretching": {"axial_stiffness": 3e8},
    "quadratic-drag": {"coefficient": 100.0},
    "impact-stop": {"stiffness": 5e3, "gap": 5e-5, "position": 0.4},
}


def test_nonlinear_elements_are_not_taken_for_friction() -> None:
    """Of a simulated motion with 15 harmonics, to 1 % where the nominal rig takes what they do for friction."""
    rig = RIG
    for name, values in ELEMENTS.items():
        rig = CAUSES[name]().extend(rig, values)
    true = steady_state(rig, 56.0, harmonics=15, samples=256)
    kept = [*range(10), *range(16, 25)]
    read = {c.name: true[c.name].coefficients[None, kept] for c in rig.channels}
    std = {c: 1e-3 * np.abs(a[:, 1:]).max() * np.ones((1, 10)) for c, a in read.items()}
    spectra = spectra_of(rig, np.array([56.0]), np.array([6.5]), read, std)
    found, wrong = reconstruct(rig, spectra), reconstruct(RIG, spectra)
    for signal in ("friction", "slip", "normal"):
        c = true[signal].coefficients[kept]
        exact = c[1:10] - 1j * c[10:]
        missed, otherwise = (np.abs(r[signal].complex[0, 1:] - exact).max() for r in (found, wrong))
        assert missed < 0.01 * np.abs(exact).max(), signal
        assert otherwise > 0.02 * np.abs(exact).max(), signal
    with pytest.raises(InputError, match=r"has midplane-stretching, quadratic-drag, impact-stop; must be regularised"):
        reconstruct(rig, spectra, formulation="nnm")


def test_what_cannot_be_reconstructed_is_refused_in_one_line(clean: MeasuredSpectra) -> None:
    with pytest.raises(InputError, match=r'^reconstruct: formulation = "magic"; must be one of regularised'):
        reconstruct(RIG, clean, formulation="magic")
    with pytest.raises(
        InputError, match=r"^spectra: holds no response channel; must hold at least one of a1, a2, a3, a4, a5, a6$"
    ):
        reconstruct(RIG, clean.select(channels=["force"]))
    with pytest.raises(InputError, match=r"^spectra: no record 9; records are 1, 2, 3, 4$"):
        reconstruct(RIG, clean).index(9)


def rubbed(law: FrictionLaw, level: float, hz: tuple[float, ...]) -> list[tuple[float, Truth]]:
    """Records of a law: the friction that it makes in the balance, and the motion under it typed anew."""
    rig = replace(RIG, contact=replace(RIG.contact, law=law))
    solutions = [steady_state(rig, f, level=level, harmonics=41, samples=SAMPLES) for f in hz]
    return [(f, respond(RIG, f, complex(level), s["friction"].samples)) for f, s in zip(hz, solutions, strict=True)]


@pytest.mark.parametrize("law", [Dahl(0.52, 1e7), Iwan(0.52, 1.04e7)], ids=["dahl", "iwan"])
def test_the_mean_is_as_uncertain_as_a_contact_leaves_it_that_does_not_slide_all_the_way(law: FrictionLaw) -> None:
    """Parts that stick have no part in the limits whose equality tells the mean; the limits of these laws differ."""
    truths = rubbed(law, 6.5, (46.0, 47.0, 52.0, 54.0, 57.0))
    found = reconstruct(RIG, with_noise(measured(RIG, truths, STD, 9), np.random.default_rng(5)))
    friction, mean = found["friction"], np.array([truth.friction.mean() for _, truth in truths])
    assert found.slips.sum() >= 4
    pulls = ((friction.samples.mean(axis=1) - mean) / friction.coefficient_std[:, 0])[found.slips]
    assert np.abs(pulls).max() < 2.5
    noise = np.linalg.norm(friction.coefficient_std[:, 1:], axis=1)[found.slips] / np.sqrt(2)
    missed = np.abs(pulls * friction.coefficient_std[found.slips, 0])
    assert (missed > 3 * noise).any()  # noise alone does not say it


def test_harmonics_that_nobody_saw_are_not_taken_for_known() -> None:
    """Where slip has just begun the third harmonic and all above are lost in noise, far below the first."""
    truths = rubbed(Dahl(0.52, 1e7), 2.0, (44.0, 46.0, 60.0, 62.0))
    exact = measured(RIG, truths, STD, 9)
    wanted = np.array([np.fft.rfft(truth.friction)[1:10] * 2 / SAMPLES for _, truth in truths])
    pulls = []
    for seed in range(20):
        found = reconstruct(RIG, with_noise(exact, np.random.default_rng(seed)))["friction"]
        off = found.complex[:, 1:10] - wanted
        pulls.append(np.stack([off.real, off.imag]) / found.coefficient_std[:, 1:])
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.25)
    assert np.abs(pulls).max() < 6.0  # of 1440


def test_friction_that_would_supply_energy_is_told() -> None:
    """Sines of the other sign, as of exp(-i omega t): everything is explained as well, and runs backwards."""
    right = measured(RIG, rubbed(Dahl(0.52, 1e7), 6.5, (44.0, 52.0, 55.0)), STD, 9)
    assert not any("supplies energy" in line for line in reconstruct(RIG, right).warnings)
    backwards = right.coefficients.copy()
    backwards[:, :, right.H + 1 :] *= -1
    (line,) = (w for w in reconstruct(RIG, replace(right, coefficients=backwards)).warnings if "supplies energy" in w)
    assert line.startswith("friction supplies energy in 3 of 3 records, most in record 2: ")
    assert line.endswith("are the signs of all sines reversed (exp(-i omega t)), or that of the force?")


def test_energy_of_harmonics_above_those_measured_is_in_its_deviation() -> None:
    """Three harmonics with little noise, of forces that go on to the ninth with random phases."""
    truths = [record(hz, 30.0, seed) for seed in range(4) for hz in (60.0, 70.0, 80.0, 95.0)]
    found = reconstruct(RIG, measured(RIG, truths, {name: std / 10 for name, std in STD.items()}, 3))
    loops = [((np.roll(t.friction, -1) + t.friction) / 2, np.roll(t.slip, -1) - t.slip) for _, t in truths]
    pulls = (found.energy_per_cycle.value + [T @ du for T, du in loops]) / found.energy_per_cycle.std
    least, most = np.sqrt(chi2.ppf([0.005, 0.995], len(truths)) / len(truths))  # of so many normal numbers
    assert least < np.sqrt(np.mean(pulls**2)) < most


BELOW = (45.0, 46.0, 47.0, 48.0, 49.0, 50.0, 51.0, 52.0)
"""Hz, below the resonance of the beam with a contact that sticks."""


def between(pulls: np.ndarray, count: int) -> bool:
    """Whether the root of the mean square of pulls is that of so many normal numbers, to 1 %."""
    least, most = np.sqrt(chi2.ppf([0.005, 0.995], count) / count)
    return bool(least < np.sqrt(np.mean(np.square(pulls))) < most)


def fundamentals(truths: list[tuple[float, Truth]]) -> np.ndarray:
    return np.array([2 * np.fft.rfft(truth.friction)[1] / SAMPLES for _, truth in truths])


def test_the_mean_that_a_stuck_contact_keeps_is_in_the_bands_of_the_rest() -> None:
    """It stiffens the beam, as no harmonic of friction does: noise says a part of what the fundamental errs by."""
    rng, level = np.random.default_rng(4), 3.0
    stuck = [(hz, truth.friction - truth.friction.mean()) for hz, truth in rubbed(Jenkins(5.0, 4e-5), level, BELOW)]
    kept = [T + rng.normal() * T.std() for _, T in stuck]
    truths = [(hz, respond(RIG, hz, complex(level), T)) for hz, T in zip(BELOW, kept, strict=True)]
    found = reconstruct(RIG, with_noise(measured(RIG, truths, STD, 9), rng))
    assert not found.slips.any()
    off, friction = found["friction"].complex[:, 1] - fundamentals(truths), found["friction"]
    pulls = np.abs(off) / np.sqrt(2) / friction.coefficient_std[:, 1]
    assert between(pulls, len(truths)), pulls
    seen = observe(found)  # what laws are judged by: deviations of cosine and sine of the fundamental
    stds = [np.linalg.norm(r.noise[0, [1, 1 + seen.basis.H]]) / np.sqrt(2.0) for r in seen.records]
    assert between(np.abs(off) / np.sqrt(2) / stds, len(truths)), stds
    wanted = np.array([truth.friction - truth.friction.mean() for _, truth in truths])
    over = (friction.samples - wanted) / friction.std
    assert between(over, len(truths)), over
    assert np.sqrt(np.mean(np.abs(off) ** 2 / 2)) > 5 * np.median(found.resolution[:, 1])
    most = np.max(np.abs(friction.samples) / found["normal"].samples)
    assert scales_of(found).sticks_at == pytest.approx(most)  # no fit knows a limit beyond it
    limit = "no record slips: the limit of friction is at least "
    (least,) = (float(w.removeprefix(limit).removesuffix(" N")) for w in found.warnings if w.startswith(limit))
    borne = max(np.ptp(T) for T in kept) / 2
    assert 0.9 * borne < least < borne
    assert not any(w.startswith(limit) for w in reconstruct(RIG, measured(RIG, RECORDS, STD, 9)).warnings)


@pytest.mark.parametrize("channels", [("a1", "a2", "a3", "a4", "a5", "a6"), ("a2", "a5")])
def test_a_fundamental_that_sensors_hardly_tell_from_the_force_is_as_uncertain_as_that(
    channels: tuple[str, ...],
) -> None:
    """Beside it all harmonics are small where the contact mostly sticks: they do not say how large it is."""
    truths = rubbed(Dahl(0.52, 1e7), 1.0, (46.0, 50.0, 54.0, 57.0))
    exact, pulls, energies = measured(RIG, truths, STD, 9).select(channels=list(channels)), [], []
    lost = [-np.sum((np.roll(t.friction, -1) + t.friction) / 2 * (np.roll(t.slip, -1) - t.slip)) for _, t in truths]
    for seed in range(12):
        found = reconstruct(RIG, with_noise(exact, np.random.default_rng(seed)))
        off = found["friction"].complex[:, 1] - fundamentals(truths)
        pulls.append(np.stack([off.real, off.imag]) / found["friction"].coefficient_std[:, 1])
        energies.append((found.energy_per_cycle.value - lost) / found.energy_per_cycle.std)
        assert not any("scatter" in line for line in found.warnings)  # of standard deviations that are exact
    assert between(np.array(pulls), 12 * 2 * len(truths)), np.sqrt(np.mean(np.square(pulls), axis=(0, 1)))
    assert np.sqrt(np.mean(np.square(energies))) < 1.3


def test_standard_deviations_that_are_too_large_are_told_without_a_force_channel_too() -> None:
    exact = measured(RIG, rubbed(Dahl(0.52, 1e7), 1.0, (46.0, 50.0, 54.0, 57.0)), STD, 9).select(channels=["a2", "a5"])
    noisy = with_noise(exact, np.random.default_rng(1))
    (line,) = (w for w in reconstruct(RIG, replace(noisy, std=3.0 * noisy.std)).warnings if "scatter" in w)
    assert line.endswith("stated too large")
    assert float(line.split("scatter ")[1].split()[0]) == pytest.approx(1 / 3, rel=0.15)
