"""An effect that numbers within their tolerances take nearly all of: its rest is told from noise by its name alone."""

import pytest

from hbm.diagnosis.diagnose import diagnose
from hbm.diagnosis.misfit import misfit
from hbm.response.synthesis import synthesize
from models.causes.friction import ViscousContact
from models.causes.structure import AddedMass
from tests.hbm.rigs import beam

E, STIFFER = "beam.youngs_modulus", 1.005
LEVELS, HZ = (3.0, 6.5), (46.0, 49.0, 51.0, 53.0, 55.0, 58.0)


def diagnosed(coefficient):
    """A beam half a tolerance too stiff, whose contact is viscous too [N s/m]."""
    rig = beam(alpha=2.0)
    viscous = ViscousContact().extend(rig, {"coefficient": coefficient})
    built = viscous.with_numbers({E: STIFFER * rig.body.youngs_modulus})
    spectra = synthesize(built, LEVELS, HZ, snr=50.0, seed=1, harmonics=5).spectra
    return diagnose(rig, spectra, held_out=(), causes=(ViscousContact, AddedMass))


def test_a_dashpot_that_damping_within_its_tolerance_hides_is_named():
    found = diagnosed(100.0)
    calibrated = found.calibrated
    assert misfit(calibrated, found.campaign).fits  # alone it leaves noise
    assert (found.verdict, found.cause) == ("cause-found", "viscous-contact"), found
    coefficient = found.parameters["coefficient"]
    assert abs(coefficient.value - 100.0) < 3.0 * coefficient.std
    assert calibrated.chi2 - found.extended_fit.chi2 > 38.0  # BIC falls by 30
    assert found.confidence < 0.6
    assert found.remainder.explained["train"] == pytest.approx(1.0, abs=0.01)  # of the rig file as it is
