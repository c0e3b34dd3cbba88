"""Figures show the numbers of the results, and change nothing else."""

from dataclasses import fields, replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from continuation import End
from hbm.errors import InputError
from hbm.figures import (
    plot_contact,
    plot_curves,
    plot_frequency_response,
    plot_history,
    plot_loop,
    plot_loops,
    plot_phase,
)
from hbm.figures.compared import Compared, View, clearest, noise_error, record_errors
from hbm.figures.misfitmap import by_cell, plot_misfit_map
from hbm.figures.records import SAMPLES, period, record_choice
from hbm.integration.history import TimeHistory
from hbm.integration.integrate import simulate
from hbm.response.curve import ResponseCurve
from hbm.response.loop import FrictionLoop, friction_loop
from hbm.response.trace import steady_state, trace_frequency
from hbm.rigfiles.load import load_rig
from hbm.stability.multipliers import Stability
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import Joint, PolynomialSpring
from models.parts import Damping, Excitation
from models.published import ASSUMED_IWAN, PAPER_COULOMB, PAPER_DAHL, PAPER_PENALTY

EXAMPLES = Path(__file__).parents[1] / "examples"
PAPER = load_rig(EXAMPLES / "paper_beam.toml")


@pytest.fixture(scope="module")
def curves() -> list[ResponseCurve]:
    return [trace_frequency(PAPER, (48.0, 50.0), level=level, harmonics=3) for level in (6.5, 2.0, 4.0)]


@pytest.fixture(scope="module")
def history() -> TimeHistory:
    return simulate(PAPER, 50.0, duration=0.2, steps_per_period=64)


def panels(rows: int = 1) -> list[mpl.axes.Axes]:
    return list(np.atleast_1d(Figure().subplots(rows, 1)))


def lines(ax: mpl.axes.Axes) -> list[Line2D]:
    """Curves of an axes, without reference lines and markers."""
    return [line for line in ax.lines if str(line.get_label()).endswith(" N")]


def test_amplitude_is_the_peak_of_the_drive_in_millimetres(curves: list[ResponseCurve]) -> None:
    (ax,) = panels()
    assert plot_frequency_response(curves, ax) is ax
    assert [line.get_label() for line in lines(ax)] == ["6.5 N", "2 N", "4 N"]
    for line, curve in zip(lines(ax), curves, strict=True):
        assert np.array_equal(line.get_xdata(), curve.dense.hz)
        assert np.array_equal(line.get_ydata(), curve.dense["drive"].peak * 1e3)
        assert set(curve.hz) <= set(curve.dense.hz)
        assert line.get_linestyle() == "-"
    assert ax.get_ylabel() == "Drive displacement,\npeak [mm]"
    assert ax.get_xlabel() == "Excitation frequency [Hz]"


def test_folds_and_corners_are_marked_on_the_curve(curves: list[ResponseCurve]) -> None:
    (ax,) = panels()
    plot_frequency_response(curves[0], ax)
    for kind in ("fold", "corner"):
        (marks,) = (line for line in ax.lines if line.get_label() == f"_{kind}")
        at = [i for i, p in enumerate(curves[0].branch.points) if getattr(p, kind)]
        assert np.array_equal(marks.get_xdata(), curves[0].hz[at])
        assert np.array_equal(marks.get_ydata(), curves[0]["drive"].peak[at] * 1e3)


def test_a_partial_curve_shows_where_it_ends(curves: list[ResponseCurve]) -> None:
    (ax,) = panels()
    partial = replace(curves[0], branch=replace(curves[0].branch, end=End.STEP_BELOW_MINIMUM))
    plot_frequency_response(partial, ax)
    (mark,) = (line for line in ax.lines if line.get_label() == "_ends here")
    assert list(mark.get_xdata()) == [partial.hz[-1]]
    assert "ends here" in [t.get_text() for t in ax.get_legend().get_texts()]


def test_unstable_stretches_are_dashed_and_join_the_stable_ones(curves: list[ResponseCurve]) -> None:
    curve = curves[0]
    stable = np.ones(len(curve.points), dtype=bool)
    stable[5:9] = False
    stability = tuple(Stability(np.array([0.5 if s else 2.0], dtype=complex), 0.02) for s in stable)
    curve = replace(curve, stability=stability, doubtful=np.zeros(len(stable), dtype=bool))
    (ax,) = panels()
    plot_phase(curve, ax)
    solid, dashed = ax.lines
    assert (solid.get_linestyle(), dashed.get_linestyle()) == ("-", "--")
    assert solid.get_color() == dashed.get_color()
    shown = curve.dense.stable
    assert shown is not None
    assert list(shown[np.isin(curve.dense.hz, curve.hz)]) == list(stable)
    assert np.array_equal(np.isnan(solid.get_ydata()), ~shown)
    first, *_, last = np.flatnonzero(~shown)
    assert list(np.flatnonzero(~np.isnan(dashed.get_ydata()))) == list(range(first - 1, last + 2))


def test_more_force_is_darker_so_that_grey_print_can_be_read(curves: list[ResponseCurve]) -> None:
    (ax,) = panels()
    plot_frequency_response(curves, ax)
    luminance = {
        str(line.get_label()): np.dot((0.2126, 0.7152, 0.0722), to_rgb(line.get_color())) for line in lines(ax)
    }
    assert luminance["2 N"] > luminance["4 N"] + 0.1
    assert luminance["4 N"] > luminance["6.5 N"] + 0.1


def test_phase_is_that_of_the_fundamental(curves: list[ResponseCurve]) -> None:
    (ax,) = panels()
    plot_phase(curves, ax)
    for line, curve in zip(lines(ax), curves, strict=True):
        shown = np.radians(np.asarray(line.get_ydata()))
        assert np.allclose(np.exp(1j * shown), np.exp(1j * curve.dense["drive"].phase[:, 1]))
        assert np.all((np.degrees(shown) >= -270.0) & (np.degrees(shown) <= 90.0))


def test_contact_panels_show_slip_friction_and_both_ends_of_the_reaction(curves: list[ResponseCurve]) -> None:
    slip, friction, normal = plot_contact(curves[0], panels(3))
    drawn = curves[0].dense
    assert np.array_equal(lines(slip)[0].get_ydata(), drawn["slip"].peak * 1e6)
    assert np.array_equal(lines(friction)[0].get_ydata(), drawn["friction"].peak)
    assert np.array_equal(lines(normal)[0].get_ydata(), drawn["normal"].peak)
    least = [p.channels["normal"].samples.min() for p in drawn.points]
    assert np.array_equal(lines(normal)[1].get_ydata(), least)


@pytest.mark.parametrize(("load", "shown"), [(83.0, False), (3.0, True)])
def test_zero_reaction_is_drawn_where_the_tip_comes_near_to_lifting(load: float, shown: bool) -> None:
    rig = replace(PAPER, contact=replace(PAPER.contact, normal_load=load))
    curve = trace_frequency(rig, (40.0, 40.2), harmonics=1)
    assert bool(curve.lift_off) is shown
    _, _, normal = plot_contact(curve, panels(3))
    assert ("lift-off below" in [t.get_text() for t in normal.texts]) is shown


def test_loop_is_closed_and_within_its_limits() -> None:
    point = steady_state(PAPER, 50.0, harmonics=3)
    (ax,) = panels()
    plot_loop(point, ax, mu=0.52)
    high, low, loop = ax.lines
    slip, T = (np.append(s, s[0]) for s in (point.channels["slip"].samples, point.channels["friction"].samples))
    R = np.append(point.channels["normal"].samples, point.channels["normal"].samples[0])
    assert np.array_equal(loop.get_xydata(), np.column_stack([slip * 1e6, T]))
    assert np.array_equal(high.get_ydata(), 0.52 * R)
    assert np.array_equal(low.get_ydata(), -0.52 * R)


def test_page_has_five_panels_on_one_frequency_axis(curves: list[ResponseCurve]) -> None:
    axes = plot_curves(curves)
    labels = [ax.get_ylabel().replace("\n", " ") for ax in axes]
    assert labels == [
        "Drive displacement, peak [mm]",
        "Phase to the force [°]",
        "Slip, peak [µm]",
        "Friction force, peak [N]",
        "Normal reaction, max and min [N]",
    ]
    assert {ax.get_xlim() for ax in axes} == {(48.0, 50.0)} or np.allclose(axes[0].get_xlim(), (48, 50))
    assert [len(lines(ax)) for ax in axes] == [3, 3, 3, 3, 6]
    assert axes[0].get_title(loc="left") == "clamped-supported beam, Table 1, coulomb-penalty"


def test_history_shows_all_and_the_last_periods(history: TimeHistory) -> None:
    whole, last = plot_history(history, periods=2)[0]
    drive = history.channels["drive"].values * 1e6
    assert np.abs(drive).max() < 200.0
    assert whole.get_ylabel() == "Drive\n[µm]"
    assert np.array_equal(whole.lines[0].get_xydata(), np.column_stack([history.time, drive]))
    assert np.array_equal(last.lines[0].get_xydata(), np.column_stack([history.time * 1e3, drive])[-129:])


@pytest.mark.parametrize(("periods", "said"), [(0.5, ""), (1.5, ", last period"), (2.0, ", last 2 periods")])
def test_a_short_history_says_how_many_periods_are_enlarged(periods: float, said: str) -> None:
    axes = plot_history(simulate(PAPER, 50.0, duration=periods / 50.0, steps_per_period=64))
    assert axes[-1][1].get_xlabel() == f"Time [ms]{said}"
    assert len(axes[0][1].lines[0].get_xdata()) == 64 * (int(periods) or periods) + 1


def test_names_of_joints_stand_above_their_forces() -> None:
    """Side by side, where no curve is, for they would lie on the curves of so many."""
    ports = {f"p{i}": (0.3 + 0.1 * i, 1.0 - 0.3 * i) for i in range(6)}
    joints = tuple(Joint(f"spring {p}", PolynomialSpring(linear=50.0), (p,)) for p in ports)
    rig = JointedRig("sprung", ModalModel((2.0, 3.0), ports), Damping(0.3), joints, Excitation(1.0, at="p0"))
    forces = plot_curves(trace_frequency(rig, (1.0, 4.0), harmonics=1))[2]
    forces.figure.draw_without_rendering()
    names, panel = forces.get_legend().get_window_extent(), forces.get_window_extent()
    assert panel.y1 <= names.y0
    assert names.x1 <= panel.x1
    assert names.height < 0.5 * panel.height


NINE = {f"p{i}": (0.3 + 0.1 * i, 1.0 - 0.2 * i) for i in range(9)}


@pytest.fixture(scope="module")
def many() -> JointedRig:
    """Nine springs in parallel."""
    joints = tuple(Joint(f"spring {p}", PolynomialSpring(linear=50.0), (p,)) for p in NINE)
    return JointedRig("sprung", ModalModel((2.0, 3.0), NINE), Damping(0.3), joints, Excitation(1.0, at="p0"))


def told_apart(ax: mpl.axes.Axes, names: list[Line2D]) -> None:
    """Lines are the ports, solid, in order, each with a marker of its own; neighbours differ in their greys too."""
    assert len(ax.lines) >= len(NINE)
    lines = ax.lines[: len(NINE)]
    markers = [line.get_marker() for line in lines]
    assert len(set(markers)) == len(NINE)
    assert not {"", "None", None} & set(markers)
    assert {line.get_linestyle() for line in lines} == {"-"}  # dashes tell what is unstable
    assert [line.get_marker() for line in names] == markers
    assert [line.get_color() for line in names] == [line.get_color() for line in lines]
    greys = np.array([to_rgb(line.get_color()) for line in lines]) @ (0.299, 0.587, 0.114)
    assert np.abs(np.diff(greys)).min() > 0.05


def test_joints_are_told_apart_in_grey_print_along_a_curve(many: JointedRig) -> None:
    _, _, forces, motions = plot_curves(trace_frequency(many, (1.0, 4.0), harmonics=1))
    for ax in (forces, motions):
        told_apart(ax, forces.get_legend().legend_handles)


def test_joints_are_told_apart_in_grey_print_over_time(many: JointedRig) -> None:
    axes = plot_history(simulate(many, 2.0, duration=1.0))
    (legend,) = axes[0, 0].figure.legends
    for ax in axes[1:, 1]:
        told_apart(ax, legend.legend_handles)


def test_panels_of_joints_that_do_not_move_say_so() -> None:
    """A joint at a node of the only mode that is driven; warnings are errors."""
    body = ModalModel((50.0, 130.0), {"a": (1.0, 0.0), "b": (0.0, -1.0)})
    joint = Joint("spring", PolynomialSpring(linear=50.0), ("a",))
    rig = JointedRig("node", body, Damping(1.0), (joint,), Excitation(1.0, at="b"))
    curve = trace_frequency(rig, (120.0, 140.0), harmonics=1)
    axes = plot_curves(curve)
    axes[0].figure.draw_without_rendering()
    for ax, said in zip(axes[2:], ("no force at the joints", "no motion at the joints"), strict=True):
        assert [text.get_text() for text in ax.texts] == [said]
        assert not ax.lines
        assert not len(ax.get_yticks())
        assert ax.get_yscale() == "linear"


@pytest.mark.parametrize(
    ("level", "units"), [(1e-6, ("nm", "µN", "nm")), (1.0, ("mm", "N", "mm")), (1e6, ("m", "kN", "m"))]
)
def test_axes_have_the_prefix_of_their_data(level: float, units: tuple[str, str, str]) -> None:
    """A kilogram on springs of 140 N/m, of which the joint has 100 N/m, moves by 5 mm/N where it resonates."""
    joint = Joint("spring", PolynomialSpring(linear=100.0), ("a",))
    rig = JointedRig("one", ModalModel((1.0,), {"a": (1.0,)}), Damping(20.0), (joint,), Excitation(1.0, at="a"))
    curve = trace_frequency(rig, (1.5, 2.2), level=level, harmonics=1)
    drive, _, force, motion = plot_curves(curve)
    factors = {"nm": 1e9, "µN": 1e6, "mm": 1e3, "N": 1.0, "m": 1.0, "kN": 1e-3}
    signals = curve.dense["drive"], curve.dense["spring.force"], curve.dense["spring.motion"]
    for ax, unit, signal in zip((drive, force, motion), units, signals, strict=True):
        assert ax.get_ylabel().endswith(f"[{unit}]")
        np.testing.assert_allclose(ax.lines[0].get_ydata(), factors[unit] * signal.peak)


def loops(*names: str) -> list[FrictionLoop]:
    sets = {"dahl": PAPER_DAHL, "penalty": PAPER_PENALTY, "iwan": ASSUMED_IWAN, "coulomb": PAPER_COULOMB}
    return [friction_loop(sets[name], 1e-5, 50.0, load=83.0, samples=64) for name in names]


def test_a_few_loops_share_two_panels() -> None:
    drawn = loops("dahl", "iwan")
    axes = plot_loops(drawn)
    assert [ax.get_xlabel() for ax in axes] == ["Slip [µm]", "Velocity [mm/s]"]
    for ax, x in zip(axes, ("u", "v"), strict=True):
        assert [line.get_label() for line in ax.lines] == ["dahl", "iwan"]
        for line, loop in zip(ax.lines, drawn, strict=True):
            scaled = getattr(loop, x) * {"u": 1e6, "v": 1e3}[x]
            assert np.array_equal(line.get_xdata(), np.append(scaled, scaled[0]))
            assert np.array_equal(line.get_ydata(), np.append(loop.T, loop.T[0]))
    assert len({(line.get_linestyle(), line.get_color()) for line in axes[0].lines}) == 2
    assert [text.get_text() for text in axes[0].figure.legends[0].get_texts()] == ["dahl", "iwan"]


@pytest.mark.parametrize("odd", [False, True])
def test_many_loops_have_a_pair_of_panels_each_before_the_others(odd: bool) -> None:
    drawn = loops("coulomb", "penalty", "dahl", "iwan", "dahl", *["iwan"] * (not odd))
    panels = plot_loops(drawn)
    assert panels.shape == (3, 4)
    order = [(row, column) for column in (0, 2) for row in range(3)]
    if odd:
        order.remove((0, 2))
        assert panels[0, 2].texts[0].get_text() == "slip ±10 µm at 50 Hz,\nload 83 N; grey: the other laws"
    for (row, column), loop in zip(order, drawn, strict=True):
        assert panels[row, column].get_title(loc="left") == loop.law.name
        for ax, x in zip(panels[row, column : column + 2], (loop.u * 1e6, loop.v * 1e3), strict=True):
            *others, own = ax.lines
            assert len(others) == len(drawn)
            assert np.array_equal(own.get_xdata(), np.append(x, x[0]))
            assert np.array_equal(own.get_ydata(), np.append(loop.T, loop.T[0]))


def test_nothing_global_changes(curves: list[ResponseCurve], history: TimeHistory) -> None:
    before = dict(mpl.rcParams)
    plot_curves(curves)
    plot_history(history)
    plot_loop(curves[0].peak, panels()[0])
    assert dict(mpl.rcParams) == before


def test_several_panels_are_drawn_into_those_given(curves: list[ResponseCurve], history: TimeHistory) -> None:
    """In any shape; what all share is then said in the panels, for the rest of the figure is the user's."""
    for plot, count in (
        (lambda axes: plot_curves(curves, axes), 5),
        (lambda axes: plot_history(history, axes), 8),
        (lambda axes: plot_loops(loops("dahl", "iwan"), axes), 2),
    ):
        figure = Figure()
        given = list(figure.subplots(1, count + 1))
        assert list(plot(given[:count]).flat) == given[:count]
        assert all(ax.has_data() for ax in given[:count]) and not given[count].has_data()
        assert not figure.legends and figure.get_supxlabel() == figure.get_supylabel() == ""
    assert [text.get_text() for text in given[0].get_legend().get_texts()] == ["dahl", "iwan"]
    with pytest.raises(InputError, match=r"^axes: 4 panels; must be 5, 5 x 1$"):
        plot_curves(curves, panels(4))


def test_panels_that_are_a_whole_figure_look_like_its_own() -> None:
    """The labels and the legend above them too."""
    many = loops("coulomb", "penalty", "dahl", "iwan", "dahl", "iwan")
    figure = Figure(layout="constrained")
    plot_loops(many, figure.subplots(3, 4))
    assert figure.get_supylabel() == "Friction force [N]"
    left, right = Figure(layout="constrained").subfigures(1, 2)
    plot_loops(many[:2], left.subplots(1, 2))
    assert [text.get_text() for text in left.legends[0].get_texts()] == ["coulomb-lagrange", "coulomb-penalty"]
    assert not right.legends


def test_a_users_style_stays_in_force(curves: list[ResponseCurve]) -> None:
    with mpl.rc_context({"axes.facecolor": "lightyellow", "font.size": 14.0}):
        (ax,) = panels()
        plot_phase(curves, ax)
        assert ax.yaxis.label.get_size() == 14.0
    assert ax.get_facecolor() == mpl.colors.to_rgba("lightyellow")


# ---- what a diagnosis shows first


def records_of_two_channels(off: dict[tuple[int, int, float], float]) -> Compared:
    """Five records at each of two levels, two channels, three harmonics; deviations by channel, harmonic and level."""
    hz, level = np.tile(np.linspace(45.0, 49.0, 5), 2), np.repeat([3.0, 6.5], 5)
    record, channel, harmonic = (part.ravel() for part in np.indices((10, 2, 3)))
    harmonic += 1
    measured = 10.0 * (1 + channel) / harmonic**2 * np.exp(0.3j * record)
    apart = np.array([off.get(key, 0.0) for key in zip(channel, harmonic, level[record], strict=True)])
    std = np.full(len(record), 0.01)
    held = record % 5 == 3
    return Compared(record + 1, channel, harmonic, level[record], hz[record], measured, measured - apart, std, held)


def test_the_view_is_where_most_is_missed_relative_to_the_channel() -> None:
    found = clearest([records_of_two_channels({(0, 2, 6.5): 1.0, (1, 1, 3.0): 1.5})], missed=True)
    assert found == View(0, 2, 6.5, (45.0, 49.0))


def test_the_view_of_a_rig_that_is_right_is_what_moves_most() -> None:
    assert clearest([records_of_two_channels({})], missed=False).harmonic == 1


def test_deviations_that_noise_may_make_are_no_view() -> None:
    noisy = records_of_two_channels({(0, 1, 3.0): 0.03, (1, 3, 6.5): 0.06})
    assert clearest([noisy], missed=True) == View(1, 3, 6.5, (45.0, 49.0))


def test_a_view_holds_its_records_in_the_order_of_their_frequencies() -> None:
    c = records_of_two_channels({})
    own = View(1, 3, 6.5, (45.0, 49.0)).of(c)
    assert list(c.record[own]) == [6, 7, 8, 9, 10]
    assert set(c.channel[own]) == {1} and set(c.harmonic[own]) == {3}


def test_error_of_a_record_is_relative_to_what_it_reads_each_channel_by_its_own() -> None:
    c = records_of_two_channels({(0, 1, 3.0): 1.0})
    first, error, noise = record_errors(c)
    assert list(c.record[first]) == list(range(1, 11))
    # channel 0 reads 10 [1, 1/4, 1/9] and channel 1 twice that: both count alike
    whole = 10.0 * np.sqrt(2.0 * (1.0 + 1.0 / 16.0 + 1.0 / 81.0))
    assert np.allclose(error, np.repeat([1.0 / whole, 0.0], 5))
    assert np.allclose(noise, np.sqrt(2.0) * 0.01 * np.sqrt(3.0 + 3.0 / 4.0) / whole)


def test_error_of_noise_is_that_of_records_without_misfit() -> None:
    c = records_of_two_channels({})
    _, _, noise = record_errors(c)
    assert noise_error(c, held=True) == pytest.approx(noise[0])  # all records read alike
    assert noise_error(replace(c, held_out=np.zeros_like(c.held_out)), held=True) == 0.0


def test_misfit_map_of_odd_harmonics_alone() -> None:
    """Even ones were not measured: nothing is drawn there, and the shades are of those that were."""
    c = records_of_two_channels({(0, 3, 6.5): 1.0})
    odd = Compared(*(getattr(c, f.name)[c.harmonic % 2 == 1] for f in fields(Compared)))
    grid = plot_misfit_map({"nominal": odd}, ["a1", "a2"])
    grid[0, 0].figure.canvas.draw()
    (image,) = grid[0, 0].get_images()
    assert np.ma.getmaskarray(image.get_array()).tolist() == [[False, True, False]] * 2
    assert image.get_clim() == (0.5, pytest.approx(by_cell(odd, 2)[0, 2]))


def test_a_drawn_period_is_the_signal_of_its_harmonics() -> None:
    """In the box of the drawing: x from 0 to its width, y downwards, the largest magnitude at its edge."""
    theta = np.linspace(0.0, 2.0 * np.pi, SAMPLES + 1)
    drawn = period(np.array([1, 2]), np.array([3.0, -0.5j]))
    assert np.allclose(drawn, 3.0 * np.cos(theta) + 0.5 * np.sin(2.0 * theta))
    c = records_of_two_channels({(0, 1, 3.0): 10.0})  # channel 0 at 3 N has no fundamental in the model
    choice = record_choice({"nominal": c}, ["a1", "a2"], ["m/s²", "m/s²"])
    assert [option.label for option in choice.options][3:5] == ["4: 3 N, 48 Hz, held out", "5: 3 N, 49 Hz"]
    first = choice.options[0]
    assert [drawing.heading.split(",")[0] for drawing in first.drawings] == ["a1", "a2"]
    points = np.array([pair.split(",") for pair in first.drawings[0].lines["measured"].split()], dtype=float)
    measured = period(c.harmonic[:3], c.measured[:3])
    assert np.allclose(points[:, 1], 40.0 - 36.0 * measured / np.abs(measured).max(), atol=0.06)
    whole = 10.0 * np.sqrt(1.0 + 1.0 / 16.0 + 1.0 / 81.0)
    assert first.table.rows[0][:3] == ["a1", "10 m/s²", f"{100.0 * 10.0 / whole:.2g}"]


@pytest.mark.parametrize("lost", ["nominal", "calibrated"])
def test_a_record_that_a_model_has_lost_is_drawn_for_none(lost: str) -> None:
    """Its steady state was not found with that model alone; the others have one record more."""
    c = records_of_two_channels({(0, 1, 3.0): 10.0})
    without = Compared(*(getattr(c, f.name)[c.record != 4] for f in fields(Compared)))
    models = {"nominal": c, "calibrated": c} | {lost: without}
    whole = record_choice({"nominal": c}, ["a1", "a2"], ["m/s²", "m/s²"])
    choice = record_choice(models, ["a1", "a2"], ["m/s²", "m/s²"])
    assert [o.label for o in choice.options] == [o.label for o in whole.options if not o.label.startswith("4:")]
