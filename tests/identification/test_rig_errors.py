"""What a rig file is uncertain by, in the parameters of laws identified with it."""

import pytest
from contactdata import reconstruction

from hbm import RigErrors, identify, reconstruct, rig_errors
from hbm.identification.lawfit import LawFit
from hbm.inverse.reconstruction import Reconstruction

LAW = "coulomb-penalty"


@pytest.fixture(scope="module")
def contact() -> Reconstruction:
    return reconstruction()


@pytest.fixture(scope="module")
def fit(contact: Reconstruction) -> LawFit:
    return identify(contact.rig, contact, [LAW]).best


@pytest.fixture(scope="module")
def errors(fit: LawFit, contact: Reconstruction) -> RigErrors:
    return rig_errors(fit, contact)


@pytest.mark.parametrize(
    ("key", "factor"), [("contact.normal_load", 1.02), ("beam.youngs_modulus", 1.01), ("excitation.position", 0.9995)]
)
def test_changes_are_those_of_rigs_identified_anew(
    key: str, factor: float, fit: LawFit, contact: Reconstruction, errors: RigErrors
) -> None:
    """With a number off, and all done again from physical scales, parameters differ as they say."""
    off = contact.rig.with_numbers({key: contact.rig.number(key) * factor})
    again = identify(off, reconstruct(off, contact.spectra), [LAW]).best
    share = (factor - 1.0) / errors.tolerances[key]
    for i, name in enumerate(errors.names):
        assert again[name].value - fit[name].value == pytest.approx(
            share * errors.changes[key][i], rel=0.1, abs=0.1 * fit[name].std
        )


def test_they_are_most_of_what_is_not_known(fit: LawFit, errors: RigErrors) -> None:
    """The load alone, which friction is in proportion to, is known to 2 %; noise says far less than that."""
    assert errors.names == ("mu", "critical_slip")
    load = errors.changes["contact.normal_load"][0]
    assert load == pytest.approx(-0.02 * fit["mu"].value, rel=0.1)
    assert errors.std[0] > max(abs(load), 5.0 * fit["mu"].std)
    assert not any(key.startswith("contact.friction") for key in errors.changes)
    assert "contact.normal_load (2 %: -0.01)" in str(errors)


def test_tolerances_may_be_given(fit: LawFit, contact: Reconstruction, errors: RigErrors) -> None:
    exact = dict.fromkeys(errors.tolerances, 0.0)
    known = rig_errors(fit, contact, exact | {"contact.normal_load": 0.002})
    assert list(known.changes) == ["contact.normal_load"]
    assert known.std[0] == pytest.approx(0.1 * abs(errors.changes["contact.normal_load"][0]), rel=0.05)


def test_numbers_that_sensors_ask_for_are_told(fit: LawFit, contact: Reconstruction, errors: RigErrors) -> None:
    """Of a rig file whose Young's modulus is 1 % too small; of the right one nothing."""
    assert "sensors agree" not in str(errors)
    key = "beam.youngs_modulus"
    off = contact.rig.with_numbers({key: 0.99 * contact.rig.number(key)})
    found = reconstruct(off, contact.spectra)
    said = str(rig_errors(identify(off, found, [LAW]).best, found))
    assert f"sensors agree better with {key} = 2." in said
    assert said.endswith("hbm inverse makes a rig file of that")
