"""Response curves of a diagnosis: what is traced, and where."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from hbm.diagnosis.curves import MOST_LEVELS, _alike_in_all_records, _spread
from hbm.rigfiles.load import load_rig
from models.parts import Drift

RIG = load_rig(Path(__file__).parents[2] / "examples" / "paper_beam.toml")


def test_a_rig_that_changes_from_record_to_record_has_no_response_of_the_frequency_alone():
    assert _alike_in_all_records(RIG)
    assert not _alike_in_all_records(replace(RIG, drift=(Drift("beam.youngs_modulus", 1e-3),)))
    for change in ({"settled": False}, {"measured_harmonics": True}):
        assert not _alike_in_all_records(replace(RIG, excitation=replace(RIG.excitation, **change)))


def test_few_levels_are_traced_the_lowest_and_the_highest_among_them():
    levels = np.arange(1.0, 10.0)
    found = _spread(levels)
    assert len(found) == MOST_LEVELS and {found[0], found[-1]} == {1.0, 9.0}
    assert np.array_equal(_spread(levels[:2]), levels[:2])
