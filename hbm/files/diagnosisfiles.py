"""Everything about a diagnosis in one folder: the verdict, the extended rig, figures with their numbers, one HTML page.

``diagnosis.json`` is docs/reference/data_files.md; ``extended.toml`` is there where a cause was found.
:func:`diagnosis_contents` makes the files; :data:`FILES` names all there can be.
"""

import math
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hbm.diagnosis.decide import DECISIVE
from hbm.diagnosis.discrepancy import Discrepancy
from hbm.diagnosis.verdict import Diagnosis
from hbm.figures import diagnosis as figures
from hbm.figures.gain import plot_gain
from hbm.figures.identification import plot_ranking
from hbm.figures.misfitmap import plot_misfit_map
from hbm.figures.missingforce import plot_missing_force
from hbm.figures.overview import plot_overview
from hbm.figures.page import Page, Section, Table, page_html
from hbm.files.diagnosiscolumns import (
    compared_columns,
    deviation_columns,
    error_columns,
    force_columns,
    overview_columns,
    place_columns,
    ranked_rows,
    ranking_columns,
)
from hbm.files.diagnosissummary import WRONG, first_screen, verdict_line
from hbm.files.figurefiles import Plate, plate_contents, plate_files
from hbm.files.outputs import columns_text, json_text
from hbm.measurement.spectra import MeasuredSpectra
from hbm.rigfiles.extensions import Extension
from hbm.rigfiles.laws import Consent
from hbm.rigfiles.load import rig_of_table
from hbm.rigfiles.write import extended_rig_text
from hbm.version import installed_version
from models.causes.parameter import WrongParameter
from models.causes.sensors import SensorDelay, SensorGain, SensorPosition
from models.jointed import AnyRig
from models.parts import UNITS

DIAGNOSIS_FILE, EXTENDED_FILE, PAGE_FILE = "diagnosis.json", "extended.toml", "report.html"
ERROR_FILE, RANKING_FILE, FORCE_FILE = "errors.csv", "ranking.csv", "missing_force.csv"
PLATES = ("overview", "gain", "responses", "deviations", "misfit_map", "missing_force", "ranking")
FILES = (
    DIAGNOSIS_FILE,
    EXTENDED_FILE,
    PAGE_FILE,
    ERROR_FILE,
    RANKING_FILE,
    FORCE_FILE,
    *(name for plate in PLATES for name in plate_files(plate)),
)
"""All files that can be in the folder."""

MODELS, PARTS = figures.MODELS, ("train", "held_out")
MOST_RANKED = 10


@dataclass(frozen=True, eq=False)
class Diagnosed:
    """A diagnosis with what it was made of.

    Attributes
    ----------
    diagnosis : Diagnosis
    rig : Rig or JointedRig
        Nominal.
    spectra : MeasuredSpectra
    force : Discrepancy or None
        Force that the calibrated model lacks; None where it was not worked out.
    warnings : tuple of str
        Warnings, such as a part of the result that is missing.
    """

    diagnosis: Diagnosis
    rig: AnyRig
    spectra: MeasuredSpectra
    force: Discrepancy | None = None
    warnings: tuple[str, ...] = ()

    @property
    def evidence(self) -> tuple[str, ...]:
        """Sentences: to beware of, of the diagnosis, of the missing force."""
        return (*self.warnings, *self.diagnosis.evidence, *(self.force.sentences() if self.force else ()))

    @cached_property
    def compared(self) -> Mapping[str, figures.Compared]:
        """The models beside all records, by their names; empty where these are not known."""
        level = dict(zip(self.spectra.records.tolist(), self.spectra.level.tolist(), strict=True))
        return {} if self.diagnosis.campaign is None else figures.compared(self.diagnosis, level)

    @cached_property
    def view(self) -> figures.View | None:
        """Signal that shows the misfit best; if the rig is consistent, the one that moves most."""
        models = self.compared
        if not models:
            return None
        missed = self.diagnosis.verdict != "consistent"
        return figures.clearest([c for name, c in models.items() if name != "extended"], missed=missed)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of those that were measured."""
        campaign = self.diagnosis.campaign
        return () if campaign is None else tuple(campaign.data.channels)

    def answers(self) -> dict[str, str]:
        """The six answers that are said first, by their question."""
        view, where, noise = self.view, "", 0.0
        if view is not None:
            where = f"harmonic {view.harmonic} of {self.channels[view.channel]} at {view.level:.3g} N"
            models = list(self.compared.values())
            noise = figures.noise_error(models[0], held=bool(self.diagnosis.held_out_records))
        return first_screen(self.diagnosis, self.force, extensions_of(self.diagnosis, {}), where, noise)


def diagnosis_contents(
    found: Diagnosed, nominal: Path, named: Mapping[type, str] | None = None
) -> dict[str, str | bytes]:
    """Contents of the files of a diagnosis, by their names in the folder.

    Parameters
    ----------
    found : Diagnosed
    nominal : Path
        Rig file, which the extended one repeats.
    named : mapping of type to str, optional
        Names of causes of one's own, ``file.py:Class``; the files are copied beside the extended rig.

    Returns
    -------
    dict of str to str or bytes
    """
    plates = diagnosis_plates(found)
    contents: dict[str, str | bytes] = {
        DIAGNOSIS_FILE: json_text(diagnosis_table(found)),
        ERROR_FILE: columns_text(error_columns(found.diagnosis)),
        RANKING_FILE: columns_text(ranking_columns(found.diagnosis)),
    }
    if found.diagnosis.extended is not None:
        contents |= _extended_rig(found.diagnosis, nominal, named or {})
    if found.force is not None and found.force.explainable:
        contents[FORCE_FILE] = columns_text(force_columns(found.force))
    return contents | {PAGE_FILE: page_html(diagnosis_page(found, plates))} | plate_contents(plates)


# ---------------------------------------------------------------------------------------------------- verdict and rig


def diagnosis_table(found: Diagnosed) -> dict[str, Any]:
    """The diagnosis file: every key is there, None where a number is not known."""
    table = found.diagnosis.json()
    errors = {model: {part: {} for part in PARTS} | table["errors"].get(model, {}) for model in MODELS}
    if "extended" not in table["errors"]:
        errors["extended"] = {}
    return table | {"errors": errors, "evidence": list(found.evidence)}


def extensions_of(diagnosis: Diagnosis, named: Mapping[type, str]) -> list[Extension]:
    """Extensions that make the extended rig of the nominal one: calibrated numbers, then causes."""
    e = diagnosis.extended_fit
    if e is None:
        return []
    calibrated = [(f.name, f.value(x)) for f, x in zip(e.model.free, e.x, strict=True) if f.cause < 0]
    out = [_corrected(key, value) for key, value in calibrated]
    for i, cause in enumerate(e.model.causes):
        out.append(Extension.of(cause, e.model.values(e.x, i), named.get(type(cause), "")))
    return out


def _corrected(key: str, value: float) -> Extension:
    """The extension that sets a calibrated number."""
    table, _, rest = key.partition(".")
    if table != "channels":
        return Extension.of(WrongParameter(key), {"value": value})
    channel, _, name = rest.rpartition(".")
    if name == "gain":
        return Extension.of(SensorGain(channel), {"gain": value})
    if name == "delay":
        return Extension.of(SensorDelay(channel), {"delay_s": value})
    return Extension.of(SensorPosition(channel), {"position": value})


def _extended_rig(diagnosis: Diagnosis, nominal: Path, named: Mapping[type, str]) -> dict[str, str | bytes]:
    """The extended rig file, read back as a check, and copies of the Python files it names: they must be beside it."""
    text = extended_rig_text(nominal.read_text(encoding="utf-8-sig"), extensions_of(diagnosis, named))
    table = tomllib.loads(text)
    rig_of_table(table, str(nominal), Consent.NAMED)
    contents: dict[str, str | bytes] = {}
    laws = [joint["law"] for joint in table.get("joints", ())]
    if "contact" in table:
        laws.append(table["contact"]["friction"]["law"])
    for name in dict.fromkeys([*laws, *(e["cause"] for e in table.get("extensions", ()))]):
        file, _, kind = name.rpartition(":")
        if file.endswith(".py"):
            copy = _free(Path(file).name, contents)
            contents[copy] = (nominal.parent / file).read_bytes()
            text = text.replace(name, f"{copy}:{kind}")
    contents[EXTENDED_FILE] = text
    return contents


def _free(name: str, taken: Collection[str]) -> str:
    """A name for a copy of a file, numbered where another has it."""
    return name if name not in taken else _free(f"another_{name}", taken)


# ------------------------------------------------------------------------------------------------------------- tables


def error_table(diagnosis: Diagnosis) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table of models, as printed and as on the page."""
    headings = ["model", "error [%]", "held out [%]", "misfit", "misfit held out"]
    rows = []
    for name, parts in diagnosis.errors.items():
        known = [parts.get(part) for part in PARTS]
        nrmse = ["-" if e is None else f"{100 * e.nrmse:.3g}" for e in known]
        rows.append([name, *nrmse, *("-" if e is None else f"{e.chi2_reduced:.4g}" for e in known)])
    return headings, rows


def ranking_table(diagnosis: Diagnosis) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table of causes, the best first."""
    rows = ranked_rows(diagnosis)[:MOST_RANKED]
    best = rows[0][1] if rows else 0.0
    shown = [
        [cause, f"{bic - best:.4g}", f"{100 * held:.3g}" if math.isfinite(held) else "-", parameters or "-"]
        for cause, bic, _, held, parameters in rows
    ]
    return ["cause", "BIC above best", "held-out error [%]", "parameters"], shown


# ------------------------------------------------------------------------------------------------------------ figures


def diagnosis_plates(found: Diagnosed) -> list[Plate]:
    """The figures with their numbers; those of the models only where these are known."""
    own = found.diagnosis
    return [
        *_overview(found),
        *_gain_plates(own),
        *_model_plates(found),
        *_force_plates(found),
        *_ranking_plates(found),
    ]


def _overview(found: Diagnosed) -> Iterator[Plate]:
    """The one figure that shows what is wrong, before and after."""
    view = found.view
    if view is None:
        return
    channel = found.channels[view.channel]
    (unit,) = (UNITS[c.quantity] for c in found.rig.channels if c.name == channel)
    most = "moves most" if found.diagnosis.verdict == "consistent" else "the rig file misses most clearly"
    yield Plate(
        "overview",
        "What is wrong",
        f"Left: what {most}, harmonic {view.harmonic} of {channel} at {view.level:.3g} N, with 95 % bars. Right: "
        "relative error of each record over all channels and harmonics, beside what noise makes of it. Hollow: records "
        "held out, which no fit has seen.",
        plot_overview(found.compared, view, channel, unit),
        overview_columns(found.compared, view),
    )


def _gain_plates(d: Diagnosis) -> Iterator[Plate]:
    if d.errors:
        caption = (
            "Relative error, and misfit in noise variances (1: noise alone), of each model on the records it was "
            "fitted to (filled) and on those held out (hollow)."
        )
        yield Plate("gain", "What the extended model gains", caption, plot_gain(d), error_columns(d))


def _model_plates(found: Diagnosed) -> Iterator[Plate]:
    models, channels = found.compared, found.channels
    if not models:
        return
    unit = {c.name: UNITS[c.quantity] for c in found.rig.channels}
    columns = compared_columns(models, channels)
    first = {name: values[columns["harmonic"] == 1] for name, values in columns.items() if name != "deviation"}
    yield Plate(
        "responses",
        "Measured and simulated",
        "Amplitude of the fundamental over the frequency, by level, with 95 % bars: before (nominal, calibrated) and "
        "after (extended). Hollow: records held out, which no fit has seen.",
        figures.plot_responses(models, channels, [unit[name] for name in channels]),
        first,
    )
    yield Plate(
        "deviations",
        "Deviations",
        "Measured less simulated fundamental relative to the measured one, phase included; beside what noise makes of "
        "it. Hollow: records held out.",
        figures.plot_deviations(models, channels),
        deviation_columns(models, channels),
    )
    yield Plate(
        "misfit_map",
        "Where the models miss",
        "Rms deviation in standard deviations of the noise, 1 where noise alone is left: by channel and harmonic, and "
        "by record.",
        plot_misfit_map(models, channels),
        columns,
    )


def _force_plates(found: Diagnosed) -> Iterator[Plate]:
    d = found.force
    if d is None or not d.explainable:
        return
    beside = " Each place acts beside a free contact force: no place alone will do." if d.two else ""
    yield Plate(
        "missing_force",
        "What is missing, and where",
        "What the calibrated model leaves when an unknown force acts at one place, two numbers per record and harmonic "
        f"(in brackets: share of the misfit beyond noise that it explains).{beside} Below, of the best place: the "
        "force by harmonics, in phase and in quadrature to the fundamental of the motion, and its "
        "growth, with 95 % bars; hollow: lost in noise.",
        plot_missing_force(d),
        place_columns(d),
    )


def _ranking_plates(found: Diagnosed) -> Iterator[Plate]:
    rows = ranked_rows(found.diagnosis)[:MOST_RANKED]
    if len(rows) < 2:
        return
    bic, held = np.array([row[1] for row in rows]), np.array([row[3] for row in rows])
    yield Plate(
        "ranking",
        "Which cause",
        f"Left: Bayesian information criterion above the best model's; a cause must lower it by {DECISIVE:g}. Right: "
        "error on the records held out.",
        plot_ranking([row[0] for row in rows], bic, held if np.isfinite(held).all() else None, decisive=DECISIVE),
        ranking_columns(found.diagnosis),
    )


# --------------------------------------------------------------------------------------------------------------- page


def diagnosis_page(found: Diagnosed, plates: Sequence[Plate]) -> Page:
    """The page about a diagnosis, with its figures; the overview comes first."""
    answers = found.answers()
    wrong = answers.pop(WRONG)
    shown = {plate.name: plate.section for plate in plates}
    return Page(
        title=f"{found.rig.name}: what the simulation gets wrong",
        lead=(verdict_line(found.diagnosis), wrong),
        warnings=found.warnings,
        first=shown.pop("overview", None),
        summary=list(answers.items()),
        sections=[*_table_sections(found.diagnosis), *shown.values(), Section("Evidence", text=found.evidence)],
        foot=f"hbm {installed_version()}, hbm diagnose; spectra: {found.spectra.source}",
    )


def _table_sections(d: Diagnosis) -> Iterator[Section]:
    if d.errors:
        note = "error: relative rms of all coefficients; misfit: in noise variances, 1 is noise alone"
        yield Section("Models", table=Table(*error_table(d), note), csv=(ERROR_FILE,))
    if d.ranking:
        note = f"fitted causes, the best first; one must lower BIC by {DECISIVE:g}; ± is one standard deviation"
        yield Section("Causes", table=Table(*ranking_table(d), note), csv=(RANKING_FILE,))
