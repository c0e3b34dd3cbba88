"""Records are put together by level and by neighbouring frequencies."""

import numpy as np

from hbm.measurement.groups import frequency_bands, levels


def test_forces_within_five_per_cent_of_the_next_are_one_level():
    force = np.array([6.5, 2.0, 2.06, 6.6, 4.0])
    assert np.allclose(levels(force), [6.55, 2.03, 2.03, 6.55, 4.0])


def test_frequencies_part_where_the_next_is_forty_per_cent_higher():
    assert frequency_bands(np.array([60.0, 44.0, 150.0, 170.0, 44.0])) == [(44.0, 60.0), (150.0, 170.0)]
    assert frequency_bands(np.array([50.0])) == [(50.0, 50.0)]
