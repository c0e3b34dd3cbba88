"""The numerical error of a curve is measured, and the measure is honest."""

from itertools import count

import numpy as np
import pytest
from rigs import HZ, beam, oscillator

from hbm.commands.tables import _numerics_row
from hbm.fourier import default_samples
from hbm.response import accuracy
from hbm.response.accuracy import choose_harmonics, difference, error_of, estimate_error, frequency_response
from hbm.response.assessment import Assessment, NumericalError, Probe
from hbm.response.curve import ResponseCurve
from hbm.response.trace import steady_state, trace_frequency
from models import Frictionless, Viscous

SWEEP = (44.0, 58.0)


@pytest.fixture(scope="module")
def coarse() -> ResponseCurve:
    """Few harmonics, few samples: errors large enough to be measured."""
    return trace_frequency(beam(), SWEEP, harmonics=5, samples=64)


def test_estimate_is_within_a_factor_three_of_the_truth(coarse):
    """The truth: five times the harmonics, sixteen times the samples, four times the modes."""
    estimate = estimate_error(coarse)
    scales = {name: coarse[name].peak.max() for name in ("drive", "friction")}
    compared = 0
    for probe in estimate.probes:
        point = coarse.points[int(np.argmin(np.abs(coarse.hz - probe.hz)))]
        reference = steady_state(beam(modes=20), point.hz, harmonics=25, samples=1024, start=point)
        truth = max(difference(point, reference, name) / scale for name, scale in scales.items())
        if truth > 1e-4:
            compared += 1
            assert truth / 3 < probe.total < 3 * truth
    assert compared >= 5


@pytest.mark.parametrize("hz", [47.0, 52.0])
def test_error_of_a_solution_is_within_a_factor_three_of_the_truth(hz):
    found = steady_state(beam(), hz, harmonics=5, samples=64)
    reference = steady_state(beam(modes=20), hz, harmonics=25, samples=1024, start=found)
    truth = max(difference(found, reference, name) / found[name].peak for name in ("drive", "friction"))
    estimate = error_of(beam(), found)
    assert truth / 3 < estimate.total < 3 * truth
    assert str(estimate) == f"{estimate.shares('')} at {hz:g} Hz"
    assert "numerical error and stability: not judged here, but by error_of(rig, it)" in str(found)
    with pytest.raises(ValueError, match="error_of: the state has 5 modes and 1 ports; must be a solution of this rig"):
        error_of(beam(modes=8), found)


def test_sources_of_error_are_told_apart(coarse):
    """The same points with enough samples lose the samples' share, and keep that of the harmonics."""
    before = estimate_error(coarse)
    after = estimate_error(trace_frequency(beam(), SWEEP, harmonics=5, samples=1024))
    assert after.largest("samples") < before.largest("samples") / 20
    assert after.largest("harmonics") > before.largest("harmonics") / 3


def test_too_few_samples_are_said():
    rig, coarse_samples = beam(), 32
    curve = trace_frequency(rig, (46.0, 52.0), harmonics=5, samples=coarse_samples)
    from hbm.response.accuracy import _warnings

    said = list(_warnings(curve, estimate_error(curve), 5e-3))
    assert any(
        w.startswith(f"{2 * coarse_samples} samples change drive displacement or friction force by up to") for w in said
    )


def test_what_was_not_estimated_is_said_in_words(coarse):
    at = Probe(50.0, harmonics=2e-3, samples=1e-4, modes=np.nan, total=np.nan)
    said = "not estimated at the peak (harmonics 0.20%, samples 0.01%, modes not estimated), at most not estimated near"
    assert repr(NumericalError((at,), at, 0.0, 1)).startswith(said)
    found = Probe(45.0, harmonics=np.nan, samples=np.nan, modes=np.nan, total=1e-5)
    said = "at most 0.00% near 45 Hz, not estimated at 1 of 2 points"
    assert said in repr(NumericalError((found, at), at, 0.0, 2))
    assert "nan" not in repr(estimate_error(coarse))


def test_a_linear_rig_needs_no_more_than_the_first_rung():
    H, N_t, reason = choose_harmonics(oscillator(Frictionless(), damping=0.1, amplitude=1.0), (0.5 * HZ, 2.0 * HZ))
    assert (H, N_t) == (7, 256)
    assert reason.startswith("H = 7: at the peaks 15 harmonics change drive displacement or friction force by 0.00%")


def test_chosen_harmonics_keep_the_tolerance():
    curve = frequency_response(beam(), SWEEP, tolerance=0.01)
    known = curve.assessment
    assert known.error.at_peak.harmonics < 0.01
    assert known.error.at_peak.samples < 0.01
    assert f"H = {curve.basis.H}: " in known.reason


def test_asked_for_harmonics_are_kept():
    curve = frequency_response(beam(), (47.0, 50.0), harmonics=3)
    assert curve.basis.H == 3
    assert curve.assessment.reason == "H = 3 as asked for"
    assert any(w.startswith("at the peak 7 harmonics change") for w in curve.assessment.warnings)


def test_lift_off_is_a_warning():
    curve = frequency_response(beam(Viscous(500.0)), (47.0, 48.5), harmonics=3)
    assert any("the tip would lift off from 47." in w for w in curve.assessment.warnings)


@pytest.mark.parametrize(("H", "N_t"), [(1, 256), (21, 256), (22, 512), (55, 1024)])
def test_default_samples(H, N_t):
    assert default_samples(H) == N_t


@pytest.mark.parametrize("alpha", [0.6, 0.06])
def test_five_modes_with_residual_flexibility_are_fifty(alpha):
    few, many = (trace_frequency(beam(alpha=alpha, modes=n), (47.5, 50.5), harmonics=15) for n in (5, 50))
    assert few["drive"].peak.max() == pytest.approx(many["drive"].peak.max(), rel=1e-3)
    assert few.peak.hz == pytest.approx(many.peak.hz, rel=1e-3)


def test_without_residual_flexibility_they_are_not():
    without, many = (
        trace_frequency(beam(modes=n, residual_compliance=False), (47.5, 56.0), harmonics=9) for n in (5, 50)
    )
    assert abs(without["drive"].peak.max() / many["drive"].peak.max() - 1.0) > 0.02


def test_a_peak_that_is_not_found_with_finer_numerics_is_not_assessed(coarse, monkeypatch):
    """What is found far off tells nothing of it: it was printed as the worst, 0.00 %."""

    def lost_at_the_peak(found, *_):
        return [None if p is coarse.peak else p for p in found]

    monkeypatch.setattr(accuracy, "_solve_again", lost_at_the_peak)
    error = estimate_error(coarse)
    row = _numerics_row(coarse, Assessment(error, "", ()))
    assert (row["at the peak\n%"], row["worst\n%"]) == ("not assessed", "not assessed")
    said = f"the numerical error is not assessed at 1 of {len(error.probes)} points, the peak among them: nothing was"
    assert any(w.startswith(said) for w in accuracy._warnings(coarse, error, 5e-3))


def test_an_estimate_ends_with_its_time_and_says_of_how_many_points_it_is(coarse, monkeypatch):
    """The peak comes first; the others are those of an estimate without a limit, and none is made up."""
    whole, clock = estimate_error(coarse), count()
    alone = estimate_error(coarse, 0.0)
    assert alone.probes == (whole.at_peak,)
    assert f"of 1 of {whole.chosen} points in the time" in repr(alone)
    monkeypatch.setattr(accuracy.time, "monotonic", lambda: next(clock))
    few = estimate_error(coarse, 5)
    assert [(p.hz, p.total) for p in few.probes] == [(p.hz, p.total) for p in whole.probes[:6]]
    said = f"the numerical error is that of 6 of {whole.chosen} points: its time was over"
    assert said in accuracy._warnings(coarse, few, 5e-3)
    assert whole.chosen == len(whole.probes) > 6
    assert not any("its time" in w for w in accuracy._warnings(coarse, whole, 5e-3))
