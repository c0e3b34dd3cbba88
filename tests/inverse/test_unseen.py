"""Harmonics above those measured, where they meet a mode: finite elements marched in time know the truth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from hbm.inverse.contact import contact_of
from hbm.inverse.reconstruct import FORMULATIONS, reconstruct
from hbm.inverse.sensing import sensing
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from models import Channel, Damping
from models.published import paper_rig
from tests.truth.laws import Coulomb
from tests.truth.rig import table_1
from tests.truth.simulate import Truth, simulate_records

SENSORS = {"a1": 0.1, "a2": 0.2, "a3": 0.3, "a4": 0.4, "a5": 0.5, "a6": 0.58}
CHANNELS = (Channel("force", "force", 0.555), *(Channel(n, "acceleration", x) for n, x in SENSORS.items()))
RIG = replace(paper_rig(), channels=CHANNELS, damping=Damping(mass_proportional=0.6))
LEVEL = 4.0
MODES = {4: 553.16, 5: 844.10}
MEETING = [(4, 10), (5, 15), (5, 16)]
"""Mode and harmonic of it, at frequencies that make the contact slip."""

HZ = [MODES[mode] * (1 + off) / k for mode, k in MEETING for off in (-0.014, -0.009, -0.005, 0.005, 0.009, 0.014)]
APART = 54.0
"""Hz, at which no harmonic from the tenth on is nearer than 2 % to a mode."""


@pytest.fixture(scope="module")
def truth() -> Truth:
    law = Coulomb(mu=0.52, critical_slip=4.146e-6)
    return simulate_records(table_1(law, sensors=tuple(SENSORS.values())), [(LEVEL, hz) for hz in [*HZ, APART]])


def spectra(truth: Truth, H: int) -> MeasuredSpectra:
    """At 60 dB of noise."""
    rng, hz = np.random.default_rng(3), np.array([record.hz for record in truth.records])
    coefficients, std = {}, {}
    for i, name in enumerate(["force", *SENSORS]):
        signal = truth.force if name == "force" else truth.acceleration[:, i - 1]
        c = np.fft.rfft(signal)[:, : H + 1] * 2 / signal.shape[1]
        noise = 1e-3 * np.abs(c[:, 1]).max()
        exact = np.concatenate([np.zeros((len(c), 1)), c.real[:, 1:], -c.imag[:, 1:]], axis=1)
        coefficients[name] = exact + noise * rng.normal(size=exact.shape)
        std[name] = np.full(c.shape, noise)
    return spectra_of(RIG, hz, np.full(len(hz), LEVEL), coefficients, std)


def test_bands_hold_what_a_harmonic_does_that_meets_a_mode(truth: Truth) -> None:
    """A single harmonic, two normal numbers, is most of what is missed in each record."""
    found = reconstruct(RIG, spectra(truth, 9))
    meets = truth.usable & found.slips & (np.arange(len(found)) < len(HZ))
    assert np.count_nonzero(meets) > 8
    for name, exact in (("normal", truth.R), ("slip", truth.u), ("friction", truth.T)):
        signal, each = found[name], exact.shape[1] // found[name].samples.shape[1]
        off = signal.samples - exact[:, ::each]
        if name == "slip":
            off -= off.mean(axis=1, keepdims=True)  # which none of the records knows
        square = np.mean((off / signal.std)[meets] ** 2, axis=1)
        most = chi2.ppf(0.995, 2 * len(square)) / (2 * len(square))
        assert square.mean() < most, (name, np.sqrt(square))


def test_the_work_rate_errs_by_what_is_said_where_harmonics_above_turn_the_velocity(truth: Truth) -> None:
    """The mean of R |v| over all of the motion, of which nine harmonics saw a part."""
    found = reconstruct(RIG, spectra(truth, 9))
    path = np.abs(np.roll(truth.u, -1, axis=1) - truth.u)
    exact = np.array([r.hz for r in truth.records]) * np.sum(
        (truth.R + np.roll(truth.R, -1, axis=1)) / 2 * path, axis=1
    )
    counted = truth.usable & found.slips
    pull = ((found.work_rate.value - exact) / found.work_rate.std)[counted]
    assert np.sum(pull**2) < chi2.ppf(0.995, len(pull)), pull
    assert (found.work_rate.std < 0.5 * exact)[counted].all()


def test_a_contact_that_holds_the_motion_amplifies_friction_by_the_mean_over_its_stiffness(truth: Truth) -> None:
    seen = sensing(RIG, spectra(truth, 9))
    unseen = contact_of(seen, FORMULATIONS["regularised"](seen, np.zeros(len(truth.records)))).unseen
    T, u = (2 * np.fft.rfft(x)[:, 1] / x.shape[1] for x in (truth.T, truth.u))
    s = np.linspace(0, 1, 20001)[:, None, None]
    square = np.mean(1 / np.abs(1 - s * (T / u)[:, None] * unseen.gains["slip"]) ** 2, axis=0)
    np.testing.assert_allclose(unseen.held[truth.usable], np.sqrt(square)[truth.usable], rtol=0.05)
    assert 1.5 < unseen.held[truth.usable].max() < 100.0


def test_the_mode_is_named_and_the_harmonics_that_tell(truth: Truth) -> None:
    told = [w for w in reconstruct(RIG, spectra(truth, 9)).warnings if "meets mode" in w]
    assert len(told) == 1
    assert told[0].startswith("record ") and ", was not measured and meets mode 4 at 553.2 Hz: it may be " in told[0]
    last = int(told[0].rsplit(" ", 1)[1])
    assert 10 < last < 20
    assert not any("meets mode" in w for w in reconstruct(RIG, spectra(truth, last)).warnings)


def test_where_no_harmonic_meets_a_mode_nothing_is_said_and_no_band_grows(
    truth: Truth, monkeypatch: pytest.MonkeyPatch
) -> None:
    apart = spectra(truth, 9).select(records=[str(len(HZ) + 1)])
    found = reconstruct(RIG, apart)
    assert not any("meets mode" in w for w in found.warnings)
    monkeypatch.setattr("hbm.inverse.unseen.AMPLIFIED", np.inf)
    without = reconstruct(RIG, apart)
    for name, signal in found.signals.items():
        np.testing.assert_array_equal(signal.std, without[name].std)
