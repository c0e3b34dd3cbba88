"""Identification of the example measurements, whose answers are known; a part of the records, for speed."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from continuation import ConvergenceError
from hbm import load_rig, load_spectra
from hbm.errors import InputError
from hbm.identification import spectra as outputerror
from hbm.identification.identify import identify
from hbm.identification.spectra import fit_spectra
from hbm.inverse.reconstruct import reconstruct
from models import Jenkins

EXAMPLES = Path(__file__).parents[3] / "shared" / "data" / "examples"
pytestmark = pytest.mark.skipif(not EXAMPLES.exists(), reason=f"the example measurements are not at {EXAMPLES}")


@cache
def example(name, every):
    """Rig, every n-th record, and its reconstruction."""
    rig = load_rig(EXAMPLES / name / "rig.toml")
    spectra = load_spectra(EXAMPLES / name / "spectra.csv", rig)
    spectra = spectra.select(records=spectra.records[::every])
    return rig, spectra, reconstruct(rig, spectra)


def truth(name):
    return json.loads((EXAMPLES / "answers.json").read_text())[name]["truth"]["law"]


@cache
def identified(name, every, laws):
    rig, _, contact = example(name, every)
    return identify(rig, contact, laws)


def test_parameters_of_the_paper_beam():
    # 60 dB. The generator is another discretisation: 0.5 % of mu and 2 % of the stiffness are asked for, and
    # deviations, inflated where the fit fails, within 5
    fit = identified("paper_null", 3, ("coulomb-penalty", "stribeck"))["coulomb-penalty"]
    for name, relative in (("mu", 5e-3), ("critical_slip", 2e-2)):
        assert fit[name].value == pytest.approx(truth("paper_null")[name], rel=relative)
        assert abs(fit[name].value - truth("paper_null")[name]) < 5 * fit[name].std
    assert fit.quality.chi2_reduced < 2.0
    assert fit.held_out.relative_error < 0.03


def test_generalisation_of_the_true_law_is_not_told_from_it_but_not_preferred():
    comparison = identified("paper_null", 3, ("coulomb-penalty", "stribeck")).comparison
    assert comparison.ranking[0].name == "coulomb-penalty"
    assert comparison.not_separable == ("stribeck",)
    assert "stribeck cannot be told from it" in comparison.verdict


def test_weakening_is_recognised():
    found = identified("stribeck_weakening", 2, ("coulomb-penalty", "stribeck"))
    assert found.comparison.ranking[0].name == "stribeck"
    assert found.comparison.ranking[1].separable
    fit, true = found["stribeck"], truth("stribeck_weakening")
    assert fit["mu"].value == pytest.approx(true["mu"], rel=0.02)
    assert fit["mu_static"].value == pytest.approx(true["mu_static"], rel=0.05)


def test_report_and_arrays_of_a_fit():
    fit = identified("paper_null", 3, ("coulomb-penalty", "stribeck"))["coulomb-penalty"]
    r, H = len(fit.records), fit.residual.shape[1]
    assert fit.predicted.shape == (r, H + 1)
    assert fit.loops.friction.shape == fit.loops.fitted_slip.shape == (r, 256)
    text = str(fit)
    assert "[[Parameters]]" in text and "mu:" in text and "+/-" in text and "reduced chi-square" in text
    # the residual is reconstructed less predicted, so that the ranges (24) follow from both
    ranges = np.ptp(fit.loops.friction, axis=1) - np.ptp(fit.loops.fitted_friction, axis=1)
    assert fit.objective == pytest.approx(np.mean(ranges**2))


def test_levels_and_named_records_held_out():
    rig, spectra, contact = example("paper_null", 5)
    held = tuple(spectra.records[1::4].tolist())
    told = []
    found = identify(
        rig,
        contact,
        ("coulomb-penalty",),
        held_out=held,
        by_level=True,
        on_progress=lambda doing, done: told.append((doing, done)),
    )
    fit = found["coulomb-penalty"]
    assert set(fit.records.tolist()).isdisjoint(held)
    assert fit.held_out.records.tolist() == list(held)
    assert sorted(found.levels) == sorted(set(spectra.level.tolist()))
    assert told[-1] == ("done", 1.0) and all(0.0 <= done <= 1.0 for _, done in told)


def test_spectra_fit_agrees_with_the_truth():
    # 9 records at 60 dB with force noise; numerics stay below the noise by choice
    rig, spectra, contact = example("paper_null", 5)
    fit = fit_spectra(rig, spectra, Jenkins(mu=0.515, critical_slip=4.2e-6), reconstruction=contact)
    assert fit.failures == ()
    assert fit.quality.chi2_reduced == pytest.approx(1.0, abs=0.2)
    for name in ("mu", "critical_slip"):
        assert abs(fit[name].value - truth("paper_null")[name]) < 4 * fit[name].std
        assert fit[name].std < 5e-3 * fit[name].value


def test_record_without_steady_state_is_left_out_and_named(monkeypatch):
    rig, spectra, contact = example("paper_null", 15)
    lost = int(spectra.records[1])
    solve = outputerror.solve_record

    def failing(rig, basis, record, last):
        if record.number == lost:
            raise ConvergenceError("no convergence here")
        return solve(rig, basis, record, last)

    monkeypatch.setattr(outputerror, "solve_record", failing)
    start = Jenkins(mu=0.52, critical_slip=4.15e-6)
    fit = fit_spectra(rig, spectra, start, reconstruction=contact, harmonics=15)
    assert fit.failures == (f"record {lost}: left out; no convergence here",)
    assert lost not in fit.records and len(fit.records) == len(spectra) - 1


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"laws": ()}, r"^identify: no law to fit; name at least one$"),
        ({"laws": ("dahl", "dahl")}, r"^identify: law dahl is named twice; must be once$"),
        ({"laws": ("dahl",), "hold": ("sigma",)}, r"^identify: no law has a parameter sigma to hold; parameters are "),
        ({"laws": ("dahl",), "held_out": ()}, r"^identify: no record is held out; must be some of them$"),
        ({"laws": ("dahl",), "held_out": (999,)}, r"no record 999; records are "),
    ],
)
def test_what_cannot_be_asked_is_refused(given, message):
    rig, _, contact = example("paper_null", 5)
    with pytest.raises(InputError, match=message):
        identify(rig, contact, **given)
