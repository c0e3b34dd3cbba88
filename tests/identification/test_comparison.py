"""Order of laws, where one fits and where none does."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from hbm.identification.comparison import Comparison, compare
from hbm.identification.lawfit import Quality

POINTS = 200


def compared(by_noise: float = 1.0, **chi2: float) -> Comparison:
    """Laws "two" and "five" of so many parameters, with what they leave."""
    numbers = {"two": 2, "five": 5}
    fits = [
        SimpleNamespace(
            name=name,
            quality=Quality(left, POINTS, numbers[name], 1, by_noise),
            held_out=None,
            parameters=SimpleNamespace(entries=()),
        )
        for name, left in chi2.items()
    ]
    return compare(cast(Any, fits), fastest=1e-3)


@pytest.mark.parametrize(("two", "five", "best"), [(300.0, 200.0, "five"), (205.0, 200.0, "two")])
def test_parameters_count_where_a_law_fits(two: float, five: float, best: str) -> None:
    """Against noise: a parameter must gain the logarithm of the points."""
    found = compared(two=two, five=five)
    assert found.ranking[0].name == best
    assert [r.delta_bic for r in found.ranking] == pytest.approx([r.bic - found.ranking[0].bic for r in found.ranking])


def test_parameters_count_against_what_all_laws_miss() -> None:
    """A hundredth of a misfit that no law explains is no evidence, though it is 3000 times as large as noise."""
    found = compared(two=303_000.0, five=300_000.0)
    assert found.ranking[0].name == "two"
    assert found.ranking[1].bic > found.ranking[0].bic


def test_laws_that_no_record_was_held_out_for_have_no_column_of_it() -> None:
    text = repr(compared(two=205.0, five=200.0))
    assert "d BIC" in text and "held out" not in text and "nan" not in text


def test_a_chi2_far_below_one_is_told_to_be_that_of_a_floor() -> None:
    small = "noise alone makes 0.09, standard deviations hold a floor for numerics"
    assert small in compared(by_noise=0.09, two=18.0, five=17.0).verdict
    assert "floor" not in compared(two=205.0, five=200.0).verdict
