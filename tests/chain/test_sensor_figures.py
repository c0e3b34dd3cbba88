"""Figures of sensors: what is drawn is what was computed and measured, per force and over force too."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hbm import (
    InputError,
    MeasuredSpectra,
    ResponseCurve,
    force_response,
    load_rig,
    synthesize,
    trace_frequency,
    with_stability,
)
from hbm.cli import app
from hbm.figures import plot_channel, plot_frequency_response, plot_sensors
from hbm.modes.linear import linear_modes, sliding_to_stuck
from models.published import paper_rig

RIG = str(Path(__file__).parents[2] / "examples" / "one_mode.toml")  # channels force and a1


@pytest.fixture(scope="module")
def curves() -> list[ResponseCurve]:
    rig = load_rig(RIG)
    return [trace_frequency(rig, (44.0, 52.0), level=level, harmonics=3) for level in (1.0, 2.0)]


@pytest.fixture(scope="module")
def measured() -> MeasuredSpectra:
    return synthesize(load_rig(RIG), [1.0, 2.0], [45.0, 48.0, 60.0], harmonics=3).spectra


def test_measured_points_lie_on_the_curves_of_their_levels(
    curves: list[ResponseCurve], measured: MeasuredSpectra
) -> None:
    ax = plot_channel(curves, "a1", measured=measured)
    assert len(ax.containers) == 2
    for curve, container in zip(curves, ax.containers, strict=True):
        x, y = container[0].get_data()
        own = (measured.level > 0.9 * curve.level) & (measured.level < 1.1 * curve.level) & (measured.hz < 52.0)
        np.testing.assert_array_equal(x, measured.hz[own])
        np.testing.assert_allclose(y, np.abs(measured.complex("a1")[own, 1]))
        np.testing.assert_allclose(y, np.interp(x, curve.dense.hz, curve.dense["a1"].amplitude[:, 1]), rtol=0.02)


def test_a_panel_for_the_drive_and_every_sensor_on_axes_that_are_given(curves: list[ResponseCurve]) -> None:
    import matplotlib.pyplot as plt

    axes = plot_sensors(curves)
    assert [ax.get_ylabel() for ax in axes] == ["drive [mm]", "a1 [m/s²]"]
    assert {ax.get_yscale() for ax in axes} == {"log"}
    given = plt.figure().subplots(1, 2)
    assert plot_sensors(curves, ["drive", "a1"], given, log=False)[1] is given[1]


def test_levels_per_force_are_amplitudes_over_the_force(curves: list[ResponseCurve]) -> None:
    ax = plot_channel(curves, "a1", per_force=True)
    for line, curve in zip(ax.lines, curves, strict=False):
        np.testing.assert_allclose(line.get_ydata(), curve.dense["a1"].amplitude[:, 1] / curve.level)
    assert ax.get_ylabel() == "a1 [m/s² / N]"


def test_the_legend_names_what_is_drawn_and_no_more(curves: list[ResponseCurve], measured: MeasuredSpectra) -> None:
    def named(curve: ResponseCurve, *more: str) -> bool:
        legend = plot_channel(curve, "a1", measured=measured).get_legend()
        return legend is not None and [text.get_text() for text in legend.get_texts()] == ["2 N", *more, "measured"]

    curve = with_stability(curves[1])
    assert curve.doubtful is not None
    assert named(replace(curve, doubtful=np.zeros(len(curve.points), dtype=bool)))
    assert named(replace(curve, doubtful=np.ones(len(curve.points), dtype=bool)), "in doubt")


def test_a_force_response_is_drawn_over_the_force(measured: MeasuredSpectra) -> None:
    curve = force_response(load_rig(RIG), 48.0, (0.5, 3.0), harmonics=3)
    ax = plot_channel(curve, "a1", measured=measured)
    assert ax.get_xlabel() == "Force amplitude [N]"
    x, y = ax.containers[0][0].get_data()
    np.testing.assert_array_equal(x, [1.0, 2.0])
    np.testing.assert_allclose(y, np.interp(x, curve.dense.force, curve.dense["a1"].amplitude[:, 1]), rtol=0.02)
    assert plot_frequency_response(curve).get_xlabel() == "Force amplitude [N]"


def test_what_the_curves_do_not_have_is_refused(curves: list[ResponseCurve]) -> None:
    with pytest.raises(InputError, match='figure: no channel "a9"; must be one of force, a1, drive'):
        plot_channel(curves, "a9")
    with pytest.raises(InputError, match="figure: harmonic = 4; must be from 0 to 3"):
        plot_sensors(curves, harmonic=4)


def test_the_default_range_has_the_sliding_and_the_stuck_resonance() -> None:
    for rig in (load_rig(RIG), paper_rig()):
        begin, end = sliding_to_stuck(rig)
        modes = linear_modes(rig)
        assert begin < modes.sliding_hz[0] < end
        assert end > np.nan_to_num(modes.stuck_hz[0])


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--sensors"], "frf: --sensors without --plot; must have both"),
        (["--measured", "s.csv"], "frf: --measured without --plot; must have both"),
        (["--log", "--plot", "f.png"], "frf: --log without --sensors or --measured; must have one of them"),
    ],
)
def test_options_of_a_figure_that_is_not_drawn_are_refused(options: list[str], line: str) -> None:
    result = CliRunner().invoke(app, ["frf", RIG, *options])
    assert (result.exit_code, result.stderr) == (2, f"{line}\n")


def test_the_command_takes_the_levels_that_were_measured(tmp_path: Path) -> None:
    spectra, plot = tmp_path / "s.csv", tmp_path / "f.png"
    made = ["synthesize", RIG, "--levels", "1", "2", "--frequencies", "45", "48", "--out", str(spectra)]
    assert CliRunner().invoke(app, made).exit_code == 0
    options = ["--from", "44", "--to", "50", "--harmonics", "3", "--no-stability", "--plot", str(plot)]
    result = CliRunner().invoke(app, ["frf", RIG, *options, "--measured", str(spectra), "--log", "--per-force"])
    assert (result.exit_code, result.stderr) == (0, "")
    assert plot.stat().st_size > 10_000
    assert "2 N: H = 3 as asked for" in result.stdout


def test_a_figure_of_sensors_says_whose_they_are(curves: list[ResponseCurve]) -> None:
    (legend,) = plot_sensors(curves)[0].figure.legends
    assert legend.get_title().get_text() == curves[0].rig.name
