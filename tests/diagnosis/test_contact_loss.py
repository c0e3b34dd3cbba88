"""A tip that lifts off, hidden in data of the independent simulator; and a rig file that says so."""

import os
from dataclasses import replace

import numpy as np
import pytest

from hbm import load_rig, load_spectra
from hbm.diagnosis.diagnose import diagnose
from hbm.files.extendedrig import write_extended_rig
from hbm.response.trace import steady_state
from hbm.rigfiles.extensions import Extension
from models import Attachments
from models.causes.structure import ContactLoss as Cause
from tests.truth import (
    ContactLoss,
    Coulomb,
    Settings,
    measure,
    scattered,
    simulate_records,
    table_1,
    write_rig,
    write_spectra,
)

SEED = int(os.environ.get("HBM_BLIND_SEED", "2"))
ASKED = {20.0: (47.2, 48.5), 39.0: (45.7, 47.2, 47.7, 49.5)}
SETTINGS = Settings(ramp=10, hold=6, coarse=128, tolerance=1e-7, retries=0)


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Rig file and spectra at two levels; at the higher one the reaction of a tip that is kept would turn negative."""
    print(f"HBM_BLIND_SEED={SEED}")
    rng = np.random.default_rng(SEED)
    kept = replace(table_1(Coulomb(mu=0.52, critical_slip=4.15e-6), alpha=20.0), high_mode_from=2)
    true = replace(kept, effects=(ContactLoss(kept.normal_load),))
    asked = [(level, hz) for level, all_hz in ASKED.items() for hz in all_hz]
    truth = simulate_records(true, scattered(asked, rng), 512, SETTINGS)
    steady = truth.converged & truth.stable
    assert ((truth.R < 1e-6).mean(axis=1)[steady] > 0.02).sum() == 2
    folder = tmp_path_factory.mktemp("lifting")
    write_rig(folder / "rig.toml", kept, amplitude=39.0)
    write_spectra(folder / "spectra.csv", measure(truth.where(steady), 50, rng, usable_only=False))
    return folder


@pytest.mark.slow
def test_a_tip_that_lifts_off_is_found_and_predicts_what_was_not_fitted(measured) -> None:
    rig = load_rig(measured / "rig.toml")
    found = diagnose(rig, load_spectra(measured / "spectra.csv", rig))
    assert found.verdict == "cause-found"
    assert found.cause == "contact-loss"
    assert found.parameters == {}
    assert found.gain["held_out_chi2_ratio"] < 1.0
    assert "off its support in record" in str(found)


def test_an_extended_rig_file_lets_the_tip_lift_off(tmp_path) -> None:
    kept = table_1(Coulomb(mu=0.52, critical_slip=4.15e-6), alpha=20.0)
    write_rig(tmp_path / "rig.toml", kept, amplitude=38.5)
    write_extended_rig(tmp_path / "extended.toml", tmp_path / "rig.toml", [Extension.of(Cause(), {})])
    nominal, extended = (load_rig(tmp_path / name) for name in ("rig.toml", "extended.toml"))
    assert not nominal.contact.lift_off
    assert extended.contact.lift_off
    assert steady_state(nominal, 48.0, harmonics=9)["normal"].samples.min() < -0.5
    assert steady_state(extended, 48.0, harmonics=9)["normal"].samples.min() == 0.0


def test_a_load_held_constant_says_nothing_of_a_lift_and_varies_once_the_tip_lifts_off(tmp_path) -> None:
    write_rig(tmp_path / "rig.toml", table_1(Coulomb(mu=0.52, critical_slip=4.15e-6), alpha=20.0), amplitude=38.5)
    rig = load_rig(tmp_path / "rig.toml")
    constant = replace(rig, contact=replace(rig.contact, load_variation=0.0))
    assert not steady_state(constant, 48.0, harmonics=9).lift_off
    (cause,) = Cause.candidates(constant)
    lifted, varied = (steady_state(cause.extend(r, {}), 48.0, harmonics=9) for r in (constant, rig))
    assert lifted.off["the tip"] == varied.off["the tip"] > 0.0
    assert lifted["drive"].samples == pytest.approx(varied["drive"].samples, rel=1e-9)


def test_it_is_offered_once_and_where_it_is_known(tmp_path) -> None:
    write_rig(tmp_path / "rig.toml", table_1(Coulomb(mu=0.52, critical_slip=4.15e-6)), amplitude=1.0)
    rig = load_rig(tmp_path / "rig.toml")
    (cause,) = Cause.candidates(rig)
    for known in (
        cause.extend(rig, {}),
        replace(rig, contact=replace(rig.contact, residual_compliance=False)),
        replace(rig, attachments=Attachments(clamp_stiffness=1e5, clamp_limit=1.0)),
        replace(rig, excitation=replace(rig.excitation, settled=False)),
    ):
        assert not list(Cause.candidates(known))
