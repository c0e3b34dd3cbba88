"""The page about a diagnosis, and its tables: what is wrong on the first screen, figures, records, causes, evidence."""

import math
from collections.abc import Iterator, Sequence

from hbm.diagnosis.decide import TIED
from hbm.diagnosis.verdict import Diagnosis, Ranked
from hbm.figures.compared import MODELS
from hbm.figures.page import Page, Section, Table
from hbm.figures.records import record_choice
from hbm.files.diagnosed import Diagnosed
from hbm.files.diagnosiscolumns import PLAIN, ranked_rows
from hbm.files.diagnosisplates import MOST_RANKED, RULES
from hbm.files.diagnosissummary import ADDED, NEXT, REMAINS, WRONG, meaning, numbers, text, verdict_line
from hbm.files.extendedrig import EXTENDED_FILE, candidates
from hbm.files.figurefiles import Plate
from hbm.files.version import installed_version

ERROR_FILE, RANKING_FILE = "errors.csv", "ranking.csv"
PARTS = ("train", "held_out")


def diagnosis_page(found: Diagnosed, plates: Sequence[Plate]) -> Page:
    """The page about a diagnosis, with its figures; the overview comes first."""
    d, answers = found.diagnosis, found.answers()
    shown = {plate.name: plate.section for plate in plates}
    overview, responses = shown.pop("overview", shown.pop("backbone", None)), shown.pop("responses", None)
    return Page(
        title=f"{found.rig.name}: what the simulation gets wrong",
        lead=tuple(filter(None, (verdict_line(d), meaning(d) or answers["Why"], answers[WRONG]))),
        warnings=found.warnings,
        tables=tuple(_first_tables(found)),
        first=overview,
        summary=[(question, answers[question]) for question in (ADDED, REMAINS, NEXT)],
        sections=[
            *_candidate_section(d),
            *([responses] if responses else ()),
            *_record_section(found),
            *shown.values(),
            *_ranking_section(d),
            *_error_section(d),
            Section("Evidence", text=found.evidence),
        ],
        foot=f"hbm {installed_version()}, hbm diagnose; measured: {found.spectra.source}",
    )


def _first_tables(found: Diagnosed) -> Iterator[Table]:
    """Numbers of the causes, and errors of the models."""
    d = found.diagnosis
    rows = numbers(d)
    if rows:
        several = len({row[0] for row in rows}) > 1
        headings = ["cause", "number", "value", "rig file"]
        yield Table(headings[not several :], [row[not several :] for row in rows], "numbers, ± one standard deviation")
    if d.errors:
        parts = [part for part in PARTS if any(part in errors for errors in d.errors.values())]
        noise = [found.noise(held=part == "held_out") for part in parts]
        shown = [[model, *(_percent(d, model, part) for part in parts)] for model in MODELS if model in d.errors]
        shown.append(["noise alone", *(f"{100 * share:.2g}" if share else "-" for share in noise)])
        counts = {"train": 0 if d.campaign is None else len(d.campaign.numbers), "held_out": len(d.held_out_records)}
        said = {"train": "fitted", "held_out": "held out"}
        headings = ["error [%]", *(f"{counts[part] or ''} {said[part]}".strip() for part in parts)]
        yield Table(headings, shown, "error on records, before and after")


def _percent(d: Diagnosis, model: str, part: str) -> str:
    e = d.errors[model].get(part)
    return "-" if e is None else f"{100 * e.nrmse:.{2 if e.nrmse < 0.1 else 3}g}"


def _record_section(found: Diagnosed) -> Iterator[Section]:
    if not found.compared:
        return
    choice = record_choice(found.compared, found.channels, found.units)
    if not choice.options:
        return
    yield Section(
        "Record by record",
        text=(
            "One period of each channel, from the harmonics that were measured, and what each model misses: relative "
            "to all that the channel reads in the record. The record shown first is the one that the calibrated model "
            "misses most clearly.",
        ),
        choice=choice,
    )


def _candidate_section(d: Diagnosis) -> Iterator[Section]:
    rows, files = [], []
    for name, ranked, _ in candidates(d):
        held = "-" if ranked.held_out_nrmse is None else f"{100 * ranked.held_out_nrmse:.3g}"
        rows.append([ranked.label, held, _parameters(ranked)])
        files.append(name)
    if rows:
        yield Section(
            "Candidates, none of them believed",
            text=(
                "None of these causes explains what is missed. Their rigs are written to look at what is left, not to "
                "predict.",
            ),
            table=Table(["candidate", "error held out [%]", "numbers as fitted"], rows),
            csv=tuple(files),
        )


def _parameters(ranked: Ranked) -> str:
    return "; ".join(f"{name} {text(p)}" for name, p in ranked.parameters.items()) or "-"


def error_table(diagnosis: Diagnosis) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table of models, as printed and as on the page."""
    headings = ["model", "error [%]", "held out [%]", "misfit", "misfit held out"]
    rows = []
    for name, parts in diagnosis.errors.items():
        known = [parts.get(part) for part in PARTS]
        nrmse = ["-" if e is None else f"{100 * e.nrmse:.3g}" for e in known]
        rows.append([name, *nrmse, *("-" if e is None else f"{e.chi2_reduced:.4g}" for e in known)])
    return headings, rows


def _error_section(d: Diagnosis) -> Iterator[Section]:
    if d.errors:
        note = "error: relative rms of all coefficients; misfit: in noise variances, 1 is noise alone"
        yield Section("Errors of the models", table=Table(*error_table(d), note), csv=(ERROR_FILE,))


def ranking_table(diagnosis: Diagnosis) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table of causes, the best first."""
    rows = ranked_rows(diagnosis)[:MOST_RANKED]
    best = rows[0][1] if rows else 0.0
    shown = [
        [cause, f"{bic - best:.4g}", f"{100 * held:.3g}" if math.isfinite(held) else "-", said, parameters or "-"]
        for (cause, bic, _, held, parameters), said in zip(rows, _said(diagnosis, rows), strict=True)
    ]
    return ["cause", "BIC above best", "held-out error [%]", "verdict", "parameters"], shown


def _said(d: Diagnosis, rows: Sequence[tuple[str, float, float, float, str]]) -> Iterator[str]:
    """Place of each cause of the ranking in the verdict."""
    named = "" if d.extended_fit is None else d.extended_fit.model.label
    chi2 = {cause: chi2 for cause, _, chi2, _, _ in rows}
    tied = {r.label for r in d.ranking if {r.name, r.label} & set(d.not_separable)}
    for cause, *_ in rows:
        if cause in PLAIN.values():
            yield "no cause"
        elif cause == named:
            yield "named"
        elif cause in tied and abs(chi2[cause] - chi2.get(named, math.inf)) < TIED:
            yield "cannot be told apart"
        else:
            yield "less likely" if named else "not believed"


def _ranking_section(d: Diagnosis) -> Iterator[Section]:
    if d.ranking:
        note = "causes that were fitted, beside the rig file without one; ± is one standard deviation"
        files = (RANKING_FILE, EXTENDED_FILE)[: 1 + (d.extended is not None)]
        yield Section("Causes", text=(RULES,), table=Table(*ranking_table(d), note), csv=files)
