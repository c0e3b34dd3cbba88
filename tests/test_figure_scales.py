"""Scales of figures: numbers beside an axis can be read, and are few."""

from collections.abc import Iterator
from itertools import pairwise

import matplotlib.pyplot as plt
import pytest
from matplotlib.axes import Axes
from matplotlib.axis import Axis

from hbm.figures.scales import logarithmic, phases
from hbm.figures.style import dressed

SPANS = [(15.0, 22.0), (150.0, 7e3), (1.6e-3, 2.4e-2), (1e-6, 0.6), (1e-25, 1e3), (17.9, 17.91), (1.0, 10.0)]


@pytest.fixture
def panel() -> Iterator[Axes]:
    figure = plt.figure(figsize=(2.4, 1.6), layout="constrained")
    yield dressed(figure.add_subplot(), "", "")
    plt.close(figure)


def shown(axis: Axis) -> list[str]:
    """Numbers beside an axis, none over another."""
    figure = axis.axes.get_figure(root=True)
    assert figure is not None
    figure.draw_without_rendering()
    labels = [label for label in axis.get_ticklabels(which="both") if label.get_text() and label.get_visible()]
    extents = [label.get_window_extent() for label in labels]
    assert not any(one.overlaps(next_one) for one, next_one in pairwise(sorted(extents, key=lambda e: (e.x0, e.y0))))
    assert len({label.get_fontsize() for label in labels}) == 1
    return [label.get_text() for label in labels]


@pytest.mark.parametrize("span", SPANS)
@pytest.mark.parametrize("direction", ["x", "y"])
def test_two_to_six_numbers_of_one_style_beside_a_logarithmic_axis(
    panel: Axes, direction: str, span: tuple[float, float]
) -> None:
    panel.plot(span, span)
    axis = panel.xaxis if direction == "x" else panel.yaxis
    logarithmic(axis)
    panel.set(**{f"{direction}lim": span})
    texts = shown(axis)
    assert 2 <= len(texts) <= 6
    assert len({"10^" in text for text in texts}) == 1


@pytest.mark.parametrize(
    ("span", "expected"),
    [
        ((-178.0, -1.0), [-180, -90, 0]),
        ((-150.0, -40.0), [-135, -90, -45]),
        ((-60.0, -3.0), [-60, -30]),
        ((-2.0, -1.999), [-5, 0]),
        ((-270.0, 90.0), [-270, -180, -90, 0, 90]),
    ],
)
def test_two_numbers_or_more_beside_a_phase(panel: Axes, span: tuple[float, float], expected: list[int]) -> None:
    panel.plot([0, 1], span)
    phases(panel.yaxis)
    low, high = panel.get_ylim()
    assert low <= span[0]
    assert high >= span[1]
    assert [round(v) for v in panel.get_yticks() if low <= v <= high] == expected
