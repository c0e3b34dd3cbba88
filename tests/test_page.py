"""The HTML page: self-contained, balanced, escaped, small; and its figures show what their files say."""

import base64
import csv
import io
import re
from html.parser import HTMLParser
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hbm.figures import page as pages
from hbm.figures.identification import (
    ParameterByLevel,
    law_residuals,
    plot_law_loops,
    plot_law_residuals,
    plot_parameters,
    plot_ranking,
)
from hbm.figures.inverse import (
    BAND,
    loop_band,
    plot_reconstructed_loop,
    plot_reconstructed_loops,
    plot_signals,
    representative,
)
from hbm.figures.page import LARGEST, Page, Section, Table, page_html
from hbm.figures.trust import misfit_limit, noise_floor
from hbm.files.figurefiles import plate_files
from hbm.files.identifiedlaw import IdentifiedLaw, Value
from hbm.files.identifyreport import FILES as IDENTIFY_FILES
from hbm.files.identifyreport import identify_contents, identify_plates
from hbm.files.inversereport import DRAWINGS, FILES, Drawing, inverse_contents, inverse_page, with_std
from hbm.identification.known import Known
from hbm.identification.rigerrors import RigErrors
from hbm.inverse.reconstruction import Reconstruction
from tests.contactdata import STATES, reconstruction

VOID = {"meta", "img", "br", "link", "hr", "input"}
SCALE = {"slip": 1e6, "slip_velocity": 1e3, "friction": 1.0, "normal": 1.0}


class Outline(HTMLParser):
    """Elements of a page; fails where one is not closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open[-1:] != ["style"] and data.strip():
            self.words.append(" ".join(data.split()))

    def all(self, tag: str, attribute: str) -> list[str]:
        return [str(attrs[attribute]) for name, attrs in self.found if name == tag and attribute in attrs]


def small_figure() -> Figure:
    figure = Figure(figsize=(2, 2))
    figure.subplots().plot([0, 1], [0, 1])
    return figure


@pytest.fixture(scope="module")
def contents() -> dict[str, str | bytes]:
    return inverse_contents(reconstruction())


@pytest.fixture(scope="module")
def outline(contents: dict[str, str | bytes]) -> Outline:
    return Outline(str(contents["report.html"]))


# ----------------------------------------------------------------------------------------------------------- the page


def test_page_says_everything_in_order_and_escapes_it() -> None:
    page = Page(
        "a < b & c",
        lead=("First.", "<script>alert(1)</script>"),
        warnings=("mu > 1",),
        summary=(("Records", "3"),),
        sections=(
            Section("One", text=("Text.",), table=Table(("law", "mu"), (("dahl", "0.5"),), "Laws"), csv=("a b.csv",)),
            Section("Two", figure=small_figure(), caption="A line.", csv=("figures/line.csv",)),
        ),
        foot="end",
    )
    found = Outline(page_html(page))
    assert "script" not in [tag for tag, _ in found.found]
    assert found.words == [
        *("a < b & c", "a < b & c", "First.", "<script>alert(1)</script>", "Beware", "mu > 1", "Records", "3"),
        *("One", "Text.", "Laws", "law", "mu", "dahl", "0.5", "Numbers:", "a b.csv"),
        *("Two", "A line.", "Numbers:", "figures/line.csv", "end"),
    ]
    assert found.all("a", "href") == ["a%20b.csv", "figures/line.csv"]
    assert found.all("img", "alt") == ["Two"]


def test_the_first_figure_stands_before_the_key_numbers_and_the_contents() -> None:
    sections = [Section(name, text=("Text.",)) for name in ("One", "Two", "Three")]
    first = Section("First", figure=small_figure(), caption="A line.", csv=("figures/first.csv",))
    found = Outline(page_html(Page("p", lead=("Lead.",), first=first, summary=(("Records", "3"),), sections=sections)))
    assert found.words == [
        *("p", "p", "Lead.", "A line.", "Numbers:", "figures/first.csv", "Records", "3", "One", "Two", "Three"),
        *("One", "Text.", "Two", "Text.", "Three", "Text."),
    ]
    assert found.all("img", "alt") == ["First"]
    assert found.all("a", "href") == ["figures/first.csv", "#s1", "#s2", "#s3"]


def test_an_empty_page_is_a_page() -> None:
    assert Outline(page_html(Page("Nothing"))).words == ["Nothing", "Nothing"]


def test_small_figures_are_vectors_and_large_ones_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    page = Page("p", sections=(Section("s", figure=small_figure()),))
    (vector,) = Outline(page_html(page)).all("img", "src")
    assert b"<svg" in base64.b64decode(vector.removeprefix("data:image/svg+xml;base64,"))
    monkeypatch.setattr(pages, "LARGEST_SVG", 100)
    (pixels,) = Outline(page_html(page)).all("img", "src")
    image = base64.b64decode(pixels.removeprefix("data:image/png;base64,"))
    assert image.startswith(b"\x89PNG")
    assert int.from_bytes(image[16:20]) == 2 * 200  # two inches at 200 dpi: twice a screen's


def test_a_page_that_is_too_large_has_fewer_pixels_or_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    page = Page("p", sections=(Section("s", figure=small_figure()),))
    monkeypatch.setattr(pages, "LARGEST", len(page_html(page)) - 1)
    assert Outline(page_html(page)).all("img", "src")[0].startswith("data:image/png")
    monkeypatch.setattr(pages, "LARGEST", 100)
    with pytest.raises(ValueError, match=r'page "p": .* bytes; must be at most 100'):
        page_html(page)


def test_ragged_tables_are_refused() -> None:
    with pytest.raises(ValueError, match=r"row \['1'\] has 1 entries; must have 2"):
        Table(("a", "b"), (("1",),))


def test_pages_are_the_same_each_time_and_change_nothing_global() -> None:
    page, before = Page("p", sections=(Section("s", figure=small_figure()),)), dict(mpl.rcParams)
    assert page_html(page) == page_html(page)
    assert dict(mpl.rcParams) == before


# ------------------------------------------------------------------------------------------------- of a reconstruction


def test_report_opens_offline_and_is_small(contents: dict[str, str | bytes], outline: Outline) -> None:
    text = str(contents["report.html"])
    assert len(text.encode()) < LARGEST == 5_000_000
    without_images = re.sub(r"data:image/[a-z+]+;base64,[A-Za-z0-9+/=]+", "", text)
    assert not re.search(r"https?:|//|@import|url\(|<script|<link", without_images)
    assert all(source.startswith("data:image/") for source in outline.all("img", "src"))


def test_report_links_to_files_that_are_there(contents: dict[str, str | bytes], outline: Outline) -> None:
    links = [link for link in outline.all("a", "href") if not link.startswith("#")]
    assert set(links) <= set(contents)
    assert {plate_files(drawing.name)[1] for drawing in DRAWINGS} <= set(links)
    anchors = [link[1:] for link in outline.all("a", "href") if link.startswith("#")]
    assert anchors == outline.all("section", "id")
    assert set(contents) <= set(FILES)


def test_report_shows_key_numbers_levels_and_warnings(outline: Outline) -> None:
    r = reconstruction()
    assert {f"{len(r)}, 48 to 56 Hz, harmonics to 7", f"{int(r.slips.sum())} of 6", *r.warnings} <= set(outline.words)
    table = outline.words[outline.words.index("worst misfit") + 1 :]
    assert (table[:2], table[8:10]) == (["2.5", "3"], ["6.5", "3"])
    assert inverse_page(r, []).title == f"{r.rig.name}: what happens at the contact"


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (47.26, 0.128, "47.26 ± 0.13"),
        (1e-6, 0.02, "0.000 ± 0.020"),
        (-1e-6, 2.0, "0.0 ± 2.0"),
        (123.0, 55.0, "123 ± 55"),
    ],
)
def test_numbers_have_the_digits_their_deviation_allows(value: float, std: float, text: str) -> None:
    assert with_std(value, std) == text


# ------------------------------------------------------------------------------------- curves are what their files say


def numbers(contents: dict[str, str | bytes], drawing: Drawing) -> dict[str, np.ndarray]:
    rows = list(csv.DictReader(io.StringIO(str(contents[plate_files(drawing.name)[1]]))))
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0]}


def drawn(name: str) -> tuple[Drawing, np.ndarray]:
    drawing = next(d for d in DRAWINGS if d.name == name)
    return drawing, drawing.draw(reconstruction(), None)


def lines(ax: Axes, label: str) -> list[Line2D]:
    return [line for line in ax.lines if line.get_label() == label]


def of_record(table: dict[str, np.ndarray], record: float) -> dict[str, np.ndarray]:
    return {name: values[table["record"] == record] for name, values in table.items()}


def test_loops_are_what_their_file_says(contents: dict[str, str | bytes]) -> None:
    drawing, axes = drawn("loops")
    table = numbers(contents, drawing)
    records = list(dict.fromkeys(table["record"].tolist()))
    assert records == [1, 2, 3, 6, 5, 4]  # by level, then by frequency
    panels = [ax for ax in axes.flat if ax.lines]
    for ax, record in zip(panels, records, strict=True):
        own = of_record(table, record)
        (line,) = lines(ax, "reconstructed")
        assert np.array_equal(line.get_xdata(), own["slip"] * 1e6)
        assert np.array_equal(line.get_ydata(), own["friction"])
        level, hz = STATES[int(record) - 1]
        assert ax.get_title(loc="left") == f"{level:g} N, {hz:g} Hz"
        assert ("sticks" in [text.get_text() for text in ax.texts]) is not bool(own["slips"][0])


def test_signals_and_their_bands_are_what_their_file_says(contents: dict[str, str | bytes]) -> None:
    drawing, axes = drawn("signals")
    table = numbers(contents, drawing)
    records = list(dict.fromkeys(table["record"].tolist()))
    assert axes.shape == (4, len(records))
    for row, name in zip(axes, ("friction", "normal", "slip", "slip_velocity"), strict=True):
        for ax, record in zip(row, records, strict=True):
            own = of_record(table, record)
            (line,) = lines(ax, "reconstructed")
            assert np.array_equal(line.get_xdata(), own["phase"])
            assert np.array_equal(line.get_ydata(), own[name] * SCALE[name])
            top = ax.collections[0].get_paths()[0].vertices[:, 1].max()
            assert np.isclose(top, ((own[name] + BAND * own[f"{name}_std"]) * SCALE[name]).max())


def test_harmonics_are_filled_where_they_stand_out_of_the_noise(contents: dict[str, str | bytes]) -> None:
    drawing, axes = drawn("harmonics")
    table = numbers(contents, drawing)
    for ax, record in zip(axes, dict.fromkeys(table["record"].tolist()), strict=True):
        own = of_record(table, record)
        (clear,), (lost,) = lines(ax, "harmonics of friction"), lines(ax, "lost in the noise")
        above = own["amplitude"] > own["noise_floor"]
        assert np.array_equal(clear.get_ydata(), np.where(above, own["amplitude"], np.nan), equal_nan=True)
        assert np.array_equal(lost.get_ydata(), np.where(above, np.nan, own["amplitude"]), equal_nan=True)
        (floor,) = lines(ax, "noise of the sensors, 95 %")
        assert np.array_equal(floor.get_ydata(), own["noise_floor"])
        assert np.array_equal(floor.get_xdata(), own["harmonic"])


def test_noise_floor_is_passed_by_noise_in_5_percent_of_the_cases() -> None:
    """Amplitudes of independent cos and sin of unit variance, seed 0; the binomial spread is 0.2 %."""
    noise = np.random.default_rng(0).standard_normal((2, 10_000))
    floor = noise_floor(reconstruction())[0, 1] / reconstruction().resolution[0, 1]
    assert np.mean(np.hypot(*noise) > floor) == pytest.approx(0.05, abs=0.008)


def test_energy_is_what_its_file_says(contents: dict[str, str | bytes]) -> None:
    drawing, axes = drawn("energy")
    table = numbers(contents, drawing)
    for ax, name in zip(axes, ("energy_per_cycle", "work_rate"), strict=True):
        scale = {"J": 1.0, "mJ": 1e3, "mW": 1e3, "W": 1.0}[ax.get_ylabel().split("[")[-1].rstrip("]")]
        for level, line in zip((2.5, 6.5), lines(ax, "_all"), strict=True):
            own = {key: values[table["level"] == level] for key, values in table.items()}
            order = np.argsort(own["frequency_hz"])
            assert np.array_equal(line.get_xdata(), own["frequency_hz"][order])
            assert np.array_equal(line.get_ydata(), own[name][order] * scale)
            (filled,) = lines(ax, f"{level:g} N")
            assert np.array_equal(np.isfinite(filled.get_ydata()), own["slips"][order] == 1.0)
        bars = np.concatenate([c.get_segments() for c in ax.collections])[:, :, 1]
        order = np.lexsort((table["frequency_hz"], table["level"]))
        assert np.allclose(bars[:, 1] - bars[:, 0], 2 * scale * BAND * table[f"{name}_std"][order], rtol=1e-6)


def test_misfit_is_what_its_file_says(contents: dict[str, str | bytes]) -> None:
    drawing, axes = drawn("misfit")
    table = numbers(contents, drawing)
    top, bottom = axes
    shown = np.concatenate([np.asarray(lines(top, f"{level:g} N")[0].get_ydata()) for level in (2.5, 6.5)])
    assert np.array_equal(shown, table["chi2_reduced"])
    assert np.array_equal(lines(top, "noise alone passes it 1 in 1000 times")[0].get_ydata(), table["limit"])
    channels = reconstruction().misfit.channels
    cells = np.asarray(bottom.collections[0].get_array())
    assert np.array_equal(cells, [table[f"channel_{name}"] for name in channels])
    assert [label.get_text() for label in bottom.get_yticklabels()] == list(channels)


def test_misfit_limit_is_where_a_record_stops_to_be_consistent() -> None:
    r = reconstruction()
    assert np.array_equal(r.misfit.reduced < misfit_limit(r), r.misfit.consistent)


def test_resolution_is_what_its_file_says(contents: dict[str, str | bytes]) -> None:
    drawing, axes = drawn("resolution")
    table = numbers(contents, drawing)
    left, right = axes
    for ax, label, name in (
        (left, "friction, amplitude", "friction"),
        (left, "resolution of the sensors, std", "resolution"),
        (right, "condition", "condition"),
    ):
        assert np.array_equal(lines(ax, label)[0].get_ydata(), table[f"{name}_median"])
        assert np.array_equal(lines(ax, label)[0].get_xdata(), table["harmonic"])
    assert np.array_equal(table["resolution_largest"], reconstruction().resolution[:, 1:].max(axis=0))


# --------------------------------------------------------------------------------------------------------- the figures


def test_representative_records_run_from_little_slip_to_the_most() -> None:
    r = reconstruction()
    amplitude = np.ptp(r["slip"].samples, axis=1)
    most = [1 + int(np.argmax(np.where(r.spectra.level == level, amplitude, 0.0))) for level in (2.5, 6.5)]
    assert representative(r, 1) == most
    assert representative(r, 2)[0] in (1, 2, 3)
    assert set(most) <= set(representative(r, 2))
    assert len(representative(r, 2)) == 4


def test_band_of_a_flat_loop_is_the_deviation_of_the_force_and_of_a_steep_one_that_of_slip() -> None:
    """A circle: at its top the band reaches 1.96 std of T up, at its side 1.96 std of u out."""
    t = 2 * np.pi * np.arange(400) / 400
    band = loop_band(np.cos(t), np.sin(t), np.full(400, 0.02), np.full(400, 0.05)).vertices
    assert band[:, 1].max() == pytest.approx(1.0 + 1.96 * 0.05, rel=1e-4)
    assert band[:, 0].max() == pytest.approx(1.0 + 1.96 * 0.02, rel=1e-4)


def test_truth_is_drawn_dotted_and_without_its_mean_where_the_contact_sticks() -> None:
    r = reconstruction()
    stuck = r.spectra.records[np.flatnonzero(~r.slips)[0]]
    i = r.index(int(stuck))
    truth = {name: r[name].samples + 3.0 * SCALE["friction"] for name in SIGNALS_DRAWN}
    ax = Figure().subplots()
    plot_reconstructed_loop(r, int(stuck), ax, truth=truth)
    (line,) = lines(ax, "true")
    assert np.mean(np.asarray(line.get_ydata())[:-1]) == pytest.approx(0.0, abs=1e-9)
    axes = plot_signals(r, [int(stuck)], truth=truth)
    reaction = lines(axes[1, 0], "true")[0]
    assert np.array_equal(np.asarray(reaction.get_ydata())[:-1], truth["normal"][i])
    figure = plot_reconstructed_loops(r, truth=truth)[0, 0].figure
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["reconstructed", "true"]


SIGNALS_DRAWN = ("slip", "slip_velocity", "friction", "normal")


def predictions(r: Reconstruction) -> dict[str, np.ndarray]:
    return {"dahl": 0.9 * r["friction"].samples, "lugre": 1.0 * r["friction"].samples}


def test_loops_of_laws_lie_on_the_measured_ones() -> None:
    r = reconstruction()
    axes = plot_law_loops(r, predictions(r), [5, 6])
    for ax, i in zip(axes, (4, 5), strict=True):
        for law, force in predictions(r).items():
            (line,) = lines(ax, law)
            assert np.array_equal(np.asarray(line.get_xdata())[:-1], r["slip"].samples[i] * 1e6)
            assert np.array_equal(np.asarray(line.get_ydata())[:-1], force[i])
    styles = {(line.get_color(), line.get_linestyle()) for line in axes[0].lines}
    assert len(styles) == 3


def test_residual_of_a_law_is_what_it_leaves_of_each_harmonic() -> None:
    """90 % of the friction leaves a tenth of each harmonic; rms of cos and sin is |c| / sqrt 2."""
    r = reconstruction()
    rms, relative = law_residuals(r, predictions(r)["dahl"])
    tenth = 0.1 * r["friction"].amplitude[:, 1:]
    assert np.allclose(rms, np.sqrt(np.mean(tenth**2, axis=0) / 2), rtol=1e-6)
    assert np.allclose(relative, np.sqrt(np.mean((tenth / r.resolution[:, 1:]) ** 2, axis=0) / 2))
    left, right = plot_law_residuals(r, predictions(r))
    assert np.array_equal(lines(left, "dahl")[0].get_ydata(), rms)
    assert np.array_equal(lines(right, "dahl")[0].get_ydata(), relative)


def test_parameters_have_a_panel_each_with_the_value_of_all_levels() -> None:
    level, value = np.array([2.0, 4.0]), np.array([0.5, 0.52])
    alone = ParameterByLevel("dahl", "mu", "1", level, value, np.array([0.01, 0.02]))
    both = ParameterByLevel("lugre", "stiffness", "N/m", level, 1e7 * value, 1e5 * value, 5.1e6, 1e4)
    first, second = plot_parameters([alone, both])
    assert np.array_equal(lines(first, "mu")[0].get_ydata(), value)
    assert [ax.get_title(loc="left") for ax in (first, second)] == ["dahl\nmu", "lugre\nstiffness"]
    assert second.get_ylabel() == "[N/m]"
    assert 5.1e6 in np.asarray(second.lines[0].get_ydata())
    assert len(first.lines) == 1
    assert np.allclose(first.collections[0].get_segments()[1][:, 1], [0.52 - BAND * 0.02, 0.52 + BAND * 0.02])


def test_ranking_has_the_best_law_on_top() -> None:
    left, right = plot_ranking(
        ["dahl", "lugre", "iwan"], np.array([30.0, 10.0, 20.0]), np.array([0.3, 0.1, 0.2]), clear=6.0
    )
    assert [label.get_text() for label in left.get_yticklabels()] == ["lugre", "iwan", "dahl"]
    assert [bar.get_width() for bar in left.patches] == [0.0, 10.0, 20.0]
    assert np.allclose([bar.get_width() for bar in right.patches], [10.0, 20.0, 30.0])
    assert left.yaxis_inverted()


def test_records_are_drawn_in_the_order_they_are_named() -> None:
    for drawing in DRAWINGS[:3]:
        axes = drawing.draw(reconstruction(), [6, 2])
        titles = [ax.get_title(loc="left") for ax in axes.flat if ax.get_title(loc="left")]
        assert titles == ["6.5 N, 50 Hz", "2.5 N, 52 Hz"]


def test_template_is_part_of_the_package() -> None:
    assert (Path(pages.__file__).parent / "page.html").exists()


# ------------------------------------------------------------------------------------------------- of identified laws


def identified(r: Reconstruction) -> list[IdentifiedLaw]:
    level = np.array([2.5, 6.5])
    by_level = ParameterByLevel("dahl", "mu", "1", level, np.array([0.5, 0.52]), np.array([0.01, 0.02]))
    found = {"dahl": (2.0, 30.0, 0.02, (by_level,)), "lugre": (1.0, 10.0, 0.01, ())}
    return [
        IdentifiedLaw(
            law,
            (Value("mu", 0.5, 0.01, "1"),),
            chi2,
            bic,
            held,
            0.5,
            r["slip"].samples * 1.1,
            predictions(r)[law],
            levels,
        )
        for law, (chi2, bic, held, levels) in found.items()
    ]


@pytest.fixture(scope="module")
def laws() -> dict[str, str | bytes]:
    load = "contact.normal_load"
    known = Known({load: 83.0}, {load: 0.02}, np.zeros(4), np.zeros((1, 4)))  # which no sensor sees
    errors = RigErrors("lugre", ("mu",), ("1",), known, {load: np.array([-0.011])})
    return identify_contents(reconstruction(), identified(reconstruction()), errors=errors, warnings=("careful",))


def test_page_of_laws_ranks_them_and_links_to_its_files(laws: dict[str, str | bytes]) -> None:
    found = Outline(str(laws["report.html"]))
    assert set(laws) == set(IDENTIFY_FILES) - {"output_error.csv"}
    assert {link for link in found.all("a", "href") if not link.startswith("#")} <= set(laws)
    assert {"careful", "0.500 ± 0.010"} <= set(found.words)
    assert found.words[found.words.index("Best law") + 1] == "lugre"
    assert found.words[found.words.index("mu, by the rig file") + 1] == "± 0.011"
    assert "contact.normal_load (2 %: -0.011)" in found.words
    assert str(laws["rig_errors.csv"]).splitlines()[1] == "lugre,contact.normal_load,83.0,0.02,1.0,0.0,mu,1,-0.011"
    cells = found.words[found.words.index("parameters") + 1 :]
    assert cells[:6] == ["lugre", "1", "0", "1", "0.5", "mu 0.500 ± 0.010"]
    assert cells[6:12] == ["dahl", "2", "20", "2", "0.5", "mu 0.500 ± 0.010"]


def test_loops_and_residuals_of_laws_are_what_their_files_say(laws: dict[str, str | bytes]) -> None:
    r = reconstruction()
    plates = {plate.name: plate for plate in identify_plates(r, identified(r))}

    def columns(name: str) -> dict[str, np.ndarray]:
        rows = list(csv.DictReader(io.StringIO(str(laws[f"figures/{name}.csv"]))))
        return {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}

    loops, residuals = columns("law_loops"), columns("law_residuals")
    panels = [ax for ax in plates["law_loops"].figure.axes if ax.lines]
    for ax, record in zip(panels, dict.fromkeys(loops["record"].tolist()), strict=True):
        own = of_record(loops, record)
        for label, ending in (("reconstructed", ""), ("dahl", "_dahl"), ("lugre", "_lugre")):
            assert np.array_equal(lines(ax, label)[0].get_xdata(), own[f"slip{ending}"] * 1e6)
            assert np.array_equal(lines(ax, label)[0].get_ydata(), own[f"friction{ending}"])
    left, right = plates["law_residuals"].figure.axes
    assert np.array_equal(lines(left, "resolution of the sensors, std")[0].get_ydata(), residuals["resolution"])
    for law in ("dahl", "lugre"):
        assert np.array_equal(lines(left, law)[0].get_ydata(), residuals[f"rms_{law}"])
        assert np.array_equal(lines(right, law)[0].get_ydata(), residuals[f"relative_{law}"])


def test_parameters_of_laws_are_listed_for_all_levels_and_each(laws: dict[str, str | bytes]) -> None:
    assert str(laws["parameters.csv"]).splitlines() == [
        "law,parameter,unit,level,value,std",
        "lugre,mu,1,,0.5,0.01",
        "dahl,mu,1,,0.5,0.01",
        "dahl,mu,1,2.5,0.5,0.01",
        "dahl,mu,1,6.5,0.52,0.02",
    ]
