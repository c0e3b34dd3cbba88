"""Figures of a diagnosis whatever was measured: one record, one frequency, records without a fundamental."""

import itertools
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.text import Text

from hbm.diagnosis.discrepancy import Discrepancy, Known
from hbm.diagnosis.missingforce import MissingForce
from hbm.diagnosis.verdict import Errors
from hbm.figures.compared import MODELS, Compared, clearest
from hbm.figures.diagnosis import plot_deviations, plot_responses
from hbm.figures.gain import plot_gain
from hbm.figures.identification import plot_ranking
from hbm.figures.misfitmap import plot_misfit_map
from hbm.figures.missingforce import plot_missing_force
from hbm.figures.overview import plot_overview
from hbm.figures.style import AxesArray

CHANNELS, UNITS = ["a1", "a2"], ["m/s²", "m/s²"]
SPREAD = (15.5, 16.2, 16.8, 17.6, 38.0, 41.0)


def compared(hz: tuple[float, ...], harmonics: dict[int, tuple[int, ...]]) -> Compared:
    """A record at each frequency, every third held out; the harmonics of each channel."""
    rows = [(r, c, k) for r in range(len(hz)) for c, own in harmonics.items() for k in own]
    record, channel, harmonic = np.array(rows).T
    measured = 10.0 / harmonic * np.exp(0.3j * record)
    where = np.array(hz)[record]
    size = np.ones(len(rows))
    return Compared(
        record + 1, channel, harmonic, 5.0 * size, where, measured, 0.9 * measured, 0.01 * size, record % 3 == 2
    )


CASES = {
    "several bands": compared(SPREAD, {0: (1, 2), 1: (1, 2)}),
    "one record": compared((16.0,), {0: (1, 2), 1: (1, 2)}),
    "one frequency": compared((16.0, 16.0, 16.0), {0: (1, 2), 1: (1, 2)}),
    "no fundamental": compared(SPREAD, {0: (2, 3), 1: (2, 3)}),
    "one record without a fundamental": compared((16.0,), {0: (2,), 1: (2,)}),
    "no fundamental in one channel": compared(SPREAD, {0: (1, 2), 1: (2,)}),
}


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.mark.parametrize("case", CASES)
def test_every_figure_is_drawn(case: str) -> None:
    """Warnings are errors: limits without extent, means of nothing."""
    models = dict.fromkeys(MODELS, CASES[case])
    grids = [
        plot_responses(models, CHANNELS, UNITS),
        plot_deviations(models, CHANNELS),
        plot_misfit_map(models, CHANNELS),
        plot_overview(models, clearest(list(models.values()), missed=True), "a1", "m/s²"),
    ]
    for grid in grids:
        grid.flat[0].figure.canvas.draw()


def test_responses_have_the_prefix_of_what_was_measured() -> None:
    """Displacements of 10 and 5 nm, curves beside points."""
    case = CASES["several bands"].times(1e-9)
    models = dict.fromkeys(MODELS, case)
    rows = plot_responses(models, CHANNELS, ["m", "m"])
    left, _ = plot_overview(models, clearest([case], missed=True), "a1", "m")
    assert [row[0].get_ylabel() for row in rows] == ["a1\n[nm]", "a2\n[nm]"]
    assert left.get_ylabel() == "Harmonic 1 of a1 [nm]"
    for ax in (*rows[:, 0], left):
        drawn = np.concatenate([line.get_ydata() for line in ax.lines if len(line.get_xdata())])
        np.testing.assert_allclose(np.unique(drawn.round(9)), [9.0, 10.0])


def test_errors_that_are_alike_are_drawn_about_themselves() -> None:
    """Models that say nothing of what was measured are off by all of it, but for rounding."""
    errors = {name: {"train": Errors(1.0 + i * 1e-16, 2e3)} for i, name in enumerate(MODELS)}
    left, right = plot_gain(SimpleNamespace(errors=errors))
    left.figure.canvas.draw()
    for ax, value in ((left, 100.0), (right, 2e3)):
        low, high = ax.get_xlim()
        assert value / 1.5 < low < value < high < 1.5 * value


# ---- labels have room


def overlapping(labels: list[Text]) -> bool:
    """Whether labels that stand beside each other touch."""
    boxes = [label.get_window_extent() for label in labels if label.get_text()]
    return any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))


@pytest.mark.parametrize("hz", [SPREAD, tuple(np.r_[np.linspace(101.25, 110.75, 20), 155.5, 230.25])])
def test_all_frequencies_of_the_overview_that_have_room_are_labelled(hz: tuple[float, ...]) -> None:
    models = {"nominal": compared(hz, {0: (1, 2)})}
    _, right = plot_overview(models, clearest(list(models.values()), missed=True), "a1", "m/s²")
    right.figure.canvas.draw()
    labels = right.get_xticklabels()
    assert not overlapping(labels)
    shown = {label.get_text() for label in labels}
    assert shown >= {f"{f:.4g}" for f in (hz[0], hz[-1])}
    assert len(shown) == len(hz) if hz is SPREAD else len(shown) > 3


def test_powers_of_a_ranking_do_not_touch() -> None:
    laws = ["polynomial-stiffness m2 to m3", "rig file as it is"]
    left, _ = plot_ranking(laws, np.array([0.0, 7e6]), np.array([0.007, 0.9]), clear=30.0)
    left.figure.canvas.draw()
    assert not overlapping(left.get_xticklabels())


def missing_forces(*shares: float, known: Known | None = None) -> AxesArray:
    """Figure of a missing force in two records of 5 N and two of 2 N, with places that explain some shares."""
    place = SimpleNamespace(name="m2 to m3", kind="force", unit="N", against="m")
    force = np.array([[1.0 + 1.0j, 0.0, 30.0 + 20.0j]] * 4)
    sizes = 0.01 * np.ones((4, 3)), 1e-4 * np.ones((4, 3)) + 0j, np.zeros(4), np.full(4, 16.0)
    missing = (MissingForce(place, share, 10.0, 1e4 * (1 - share), 6, force, *sizes) for share in shares)
    levels = np.array([5.0, 2.0, 5.0, 2.0])
    hz = np.full(4, 16.0)
    axes = plot_missing_force(Discrepancy(np.arange(4), levels, hz, 1e4, 100, tuple(missing), known=known))
    axes[0].figure.canvas.draw()
    return axes


def test_long_names_leave_room_for_the_bars_of_a_ranking() -> None:
    long = " + ".join(f"parameter:damping.modal_ratios[{i}]" for i in range(9, 13))
    left, right = plot_ranking([long, "rig file"], np.array([0.0, 7e6]), np.array([0.007, 0.9]), clear=30.0)
    left.figure.draw_without_rendering()  # a layout that has no room warns, which fails here
    names = [label.get_text() for label in left.get_yticklabels()]
    assert names[1] == "rig file" and len(names[0]) == 36
    assert names[0].startswith("parameter:") and names[0].endswith("[12]")
    assert min(ax.get_position().width for ax in (left, right)) > 0.2
    assert all(t.get_window_extent().x0 >= 0.0 for t in left.get_yticklabels())
    plt.close(left.figure)


def test_colours_of_the_growth_are_those_of_the_levels() -> None:
    _, _, growth = missing_forces(0.99)
    handles = growth.get_legend().legend_handles
    assert [text.get_text() for text in growth.get_legend().get_texts()] == ["2 N", "5 N"]
    dots = [line for line in growth.lines if line.get_marker() == "o" and len(line.get_xdata())]
    assert [line.get_color() for line in dots] == [handle.get_color() for handle in handles]
    assert growth.get_xlabel() == "Motion there [µm]"


def test_a_share_that_all_places_explain_alike_is_left_out() -> None:
    alike, _, _ = missing_forces(0.9998, 0.9997)
    assert [text.get_text() for text in alike.texts] == ["2", "3"]
    apart, _, _ = missing_forces(0.9998, 0.5)
    assert [text.get_text() for text in apart.texts] == ["2  (explains 100 %)", "5e+03  (explains 50 %)"]


def test_joints_whose_forces_do_it_alone_stand_above_the_places() -> None:
    """The place whose harmonics are drawn keeps its colour."""
    places, _, _ = missing_forces(0.8, 0.5, known=Known("the joints pad and stop", True, 0.9999, 94.0, 1.0, 6))
    assert [t.get_text() for t in places.get_yticklabels()] == ["the joints pad and stop", *["m2 to m3"] * 2]
    assert places.texts[0].get_text() == "1  (explains 100 %)"
    colors = [bar.get_facecolor() for bar in places.patches]
    assert colors[0] == colors[2] != colors[1]
    much = Known("the joints pad and stop", True, 0.2, 8e3, 5e4, 6)  # they leave more than a place does
    places, _, _ = missing_forces(0.8, 0.5, known=much)
    assert [t.get_text() for t in places.get_yticklabels()] == ["m2 to m3"] * 2


@pytest.mark.parametrize(("count", "labels"), [(6, 6), (10, 10), (21, 7)])
def test_records_of_the_misfit_map_are_labelled_all_or_evenly(count: int, labels: int) -> None:
    """At most ten have room beside each other in one of three panels; all have a mark."""
    hz = tuple(50.0 + np.arange(count))
    grid = plot_misfit_map(dict.fromkeys(MODELS, compared(hz, {0: (1, 2)})), ["a1"])
    grid[0, 0].figure.canvas.draw()
    for ax in grid[1]:
        ticks = ax.get_xticks()
        assert len(ticks) == labels
        assert len(set(np.diff(ticks))) == 1
        shown = [label.get_text() for label in ax.get_xticklabels()]
        assert shown == [f"{hz[int(i)]:.4g}" for i in ticks]
        marked = {*ticks.tolist(), *ax.get_xticks(minor=True).tolist()}
        assert marked == set(range(count))
        spacing = np.diff(ax.transData.transform([(t, 0.0) for t in ticks[:2]])[:, 0])[0]
        digits = 0.73 * ax.get_xticklabels()[0].get_fontsize() / 72 * ax.figure.dpi  # as high as that
        assert spacing / np.sqrt(2.0) > digits  # between labels that are turned by 45 degrees


def test_legend_of_the_missing_force_stands_above_its_bars() -> None:
    _, harmonics, _ = missing_forces(0.99)
    assert harmonics.get_legend().get_window_extent().y0 >= harmonics.get_window_extent().y1
