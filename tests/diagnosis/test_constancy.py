"""Numbers of a cause that change between levels or bands give a look-alike away; constant ones do not."""

from types import SimpleNamespace

import numpy as np
import pytest

from hbm.diagnosis.constancy import varying
from hbm.outputerror.model import Free

LEVELS, HZ, POINTS = (2.0, 4.0, 6.0), (48.0, 50.0, 52.0, 150.0, 155.0), 24
RECORDS = [
    SimpleNamespace(number=i, force=force, hz=hz) for i, (force, hz) in enumerate((f, h) for f in LEVELS for h in HZ)
]
CAMPAIGN = SimpleNamespace(data=SimpleNamespace(records=RECORDS))
STIFFNESS = Free("stiffness", "N/m", 0.0, 1e4, 1.0, "linear", 1.0, cause=0)
PLACE = Free("position", "m", -50.0, 50.0, 0.3, "linear", 1.0, cause=0)
LOAD = Free("contact.normal_load", "N", -50.0, 50.0, 0.0, "linear", 1.0, std=1.0)


def fitted(stiffness, rng, load=0.0):
    """Least squares of one stiffness, a place and a load known before, where the stiffness of each record is given."""
    free, record = (LOAD, STIFFNESS, PLACE), np.repeat([r.number for r in RECORDS], POINTS)
    J = rng.standard_normal((len(record), 3)) + 0.5
    each = np.array([stiffness(r) for r in RECORDS])[record]
    measured = J[:, 0] * load + J[:, 1] * each + J[:, 2] * 0.3 + rng.standard_normal(len(record))
    expected = np.diag([1.0, 0.0, 0.0])
    x = np.linalg.solve(J.T @ J + expected, J.T @ measured)
    white = SimpleNamespace(jacobian=J, residual=measured - J @ x, record=record)
    found, pulls = dict.fromkeys(range(len(RECORDS))), np.array([x[0], 0.0, 0.0])
    return SimpleNamespace(
        model=SimpleNamespace(free=free), x=x, white=white, expected=expected, pulls=pulls, found=found
    )


def test_constant_numbers_are_constant():
    """In every one of 200 measurements: the threshold is far beyond chance."""
    rng = np.random.default_rng(5)
    assert not any(varying(fitted(lambda r: 100.0, rng, rng.standard_normal()), CAMPAIGN) for _ in range(200))


@pytest.mark.parametrize(
    ("stiffness", "told"),
    [
        (lambda r: 100.0 + r.force, ("at 2 N", "at 4 N", "at 6 N")),
        (lambda r: 100.0 + r.hz / 50.0, ("about 50 Hz", "about 152 Hz")),
    ],
    ids=["level", "band"],
)
def test_a_number_that_changes_is_told_with_where(stiffness, told):
    """The values of each group, to within what 500 to 1000 points tell; in all draws."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        found = varying(fitted(stiffness, rng), CAMPAIGN)
        assert found is not None and found.gain > 30.0
        words = found.sentence.split(": ")[1].split(" (chi2")[0].split(", ")
        assert [word.split(" ", 1)[1] for word in words] == list(told)
        groups = [
            [r for r in RECORDS if name in (f"at {r.force:g} N", "about 50 Hz" if r.hz < 100 else "about 152 Hz")]
            for name in told
        ]
        true = [np.mean([stiffness(r) for r in group]) for group in groups]
        assert [float(word.split()[0]) for word in words] == pytest.approx(true, abs=0.25)


def test_one_group_says_nothing():
    rng = np.random.default_rng(7)
    one = SimpleNamespace(data=SimpleNamespace(records=[r for r in RECORDS if r.force == 2.0 and r.hz < 100]))
    e = fitted(lambda r: 100.0 + r.force, rng)
    e.found = {r.number: None for r in one.data.records}
    keep = np.isin(e.white.record, list(e.found))
    e.white = SimpleNamespace(
        jacobian=e.white.jacobian[keep], residual=e.white.residual[keep], record=e.white.record[keep]
    )
    assert varying(e, one) is None


def test_what_a_band_does_not_determine_is_not_said_to_differ():
    """A joint that hardly slips in one band does not say there at what it slips, and all else is constant.

    Records of that band see a thousandth of the limit, and a misfit of seven standard deviations along this: to first
    order the limit would be out of reach there, known to 40 times itself.
    """
    rng, limit = np.random.default_rng(8), Free("limit", "N", 1e-3, 2.5e8, 10.0, "inverse", 10.0, cause=0)
    for _ in range(20):
        e = fitted(lambda r: 1.0, rng)
        sticks = np.array([r.hz > 100.0 for r in RECORDS])[e.white.record]
        e.white.jacobian[sticks, 1] *= 1e-3
        along = np.where(sticks, e.white.jacobian[:, 1], 0.0)
        e.white.residual -= 7.0 * along / np.linalg.norm(along)
        e.model.free = (LOAD, limit, PLACE)
        assert varying(e, CAMPAIGN) is None


def test_a_level_that_says_nothing_does_not_hide_that_others_differ():
    """The highest level sees next to nothing of the number; the other two still tell that it changes."""
    rng = np.random.default_rng(9)
    for _ in range(20):
        e = fitted(lambda r: 100.0 + r.force, rng)
        loud = np.array([r.force == 6.0 for r in RECORDS])[e.white.record]
        e.white.jacobian[loud, 1] *= 1e-6
        found = varying(e, CAMPAIGN)
        assert found is not None and "at 2 N" in found.sentence and "at 4 N" in found.sentence
        assert "at 6 N" not in found.sentence
