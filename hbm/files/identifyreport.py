"""Everything about identified friction laws in one folder: ranking, parameters, figures, one HTML page.

It takes plain numbers, :class:`hbm.files.identifiedlaw.IdentifiedLaw`, wherever they come from; :data:`FILES` names all
files there can be.
"""

from collections.abc import Sequence

import numpy as np

from hbm.figures import identification as figures
from hbm.figures.page import Page, Section, Table, page_html
from hbm.figures.style import closed
from hbm.files.figurefiles import Plate, plate_contents, plate_files
from hbm.files.identifiedlaw import (
    IdentifiedLaw,
    Value,
    law_columns,
    output_error_columns,
    parameter_columns,
    ranked,
    rig_error_columns,
    value_text,
)
from hbm.files.inversefiles import record_columns
from hbm.files.outputs import Columns, columns_text
from hbm.files.version import installed_version
from hbm.identification.comparison import CLEAR
from hbm.identification.rigerrors import RigErrors
from hbm.identification.spectra import SpectraFit
from hbm.inverse.reconstruction import Reconstruction

PAGE_FILE, LAW_FILE, PARAMETER_FILE = "report.html", "laws.csv", "parameters.csv"
OUTPUT_ERROR_FILE = "output_error.csv"
RIG_ERROR_FILE = "rig_errors.csv"
PLATES = ("law_loops", "law_residuals", "parameters", "ranking")
FILES = (
    PAGE_FILE,
    LAW_FILE,
    PARAMETER_FILE,
    RIG_ERROR_FILE,
    OUTPUT_ERROR_FILE,
    *(name for plate in PLATES for name in plate_files(plate)),
)
"""All files that can be in the folder."""

MOST_DRAWN = 4


def identify_contents(
    reconstruction: Reconstruction,
    laws: Sequence[IdentifiedLaw],
    *,
    verdict: str = "",
    errors: RigErrors | None = None,
    output_error: SpectraFit | None = None,
    warnings: Sequence[str] = (),
) -> dict[str, str | bytes]:
    """Contents of the files of an identification, by their names in the folder.

    Parameters
    ----------
    reconstruction : Reconstruction
        Reconstruction that the laws were fitted to.
    laws : sequence of IdentifiedLaw
    verdict : str
        Which law is best, and which cannot be told from it.
    errors : RigErrors, optional
        What the rig file is uncertain by, in the best law.
    output_error : SpectraFit, optional
        The best law fitted to the spectra themselves.
    warnings : sequence of str
    """
    plates = identify_plates(reconstruction, laws)
    contents: dict[str, str | bytes] = {
        LAW_FILE: columns_text(law_columns(laws)),
        PARAMETER_FILE: columns_text(parameter_columns(laws)),
        PAGE_FILE: page_html(identify_page(reconstruction, laws, plates, verdict, errors, output_error, warnings)),
    }
    if errors is not None:
        contents[RIG_ERROR_FILE] = columns_text(rig_error_columns(errors))
    if output_error is not None:
        contents[OUTPUT_ERROR_FILE] = columns_text(output_error_columns(output_error))
    return contents | plate_contents(plates)


# ------------------------------------------------------------------------------------------------------------- tables


def law_table(laws: Sequence[IdentifiedLaw]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table of laws, the best first, as printed and as on the page."""
    order = ranked(laws)
    headings = ["law", "misfit", "BIC above best", "held-out error [%]", "Obj (24) [N²]", "parameters"]
    rows = []
    for law in order:
        held = f"{100 * law.held_out:.3g}" if np.isfinite(law.held_out) else "-"
        values = "; ".join(f"{v.name} {value_text(v)}" for v in law.values)
        row = [law.law, f"{law.chi2_reduced:.4g}", f"{law.bic - order[0].bic:.4g}", held, f"{law.range_error:.3g}"]
        rows.append([*row, values])
    return headings, rows


# ------------------------------------------------------------------------------------------------------------- figures


def identify_plates(reconstruction: Reconstruction, laws: Sequence[IdentifiedLaw]) -> list[Plate]:
    """The figures with their numbers; parameters by level only where there are some."""
    order = ranked(laws)
    predicted = {law.law: law.friction for law in order}
    slips = {law.law: law.slip for law in order}
    held = np.array([law.held_out for law in order])
    by_level = [p for law in order for p in law.by_level]
    plates = [
        Plate(
            "ranking",
            "Which law",
            "Left: Bayesian information criterion (BIC) above the best law's. Laws less than "
            f"{CLEAR:g} apart in BIC or chi2 cannot be told apart, unless by records held out. Right, where records "
            "were held out: relative error of the friction force there.",
            figures.plot_ranking(
                list(predicted),
                np.array([law.bic for law in order]),
                held if np.isfinite(held).all() else None,
                clear=CLEAR,
            ),
            law_columns(laws),
        ),
        Plate(
            "law_loops",
            "Loops",
            "Fitted laws under the reconstructed slip and reaction, on the reconstructed loop (grey, 95 % band).",
            figures.plot_law_loops(reconstruction, predicted, drawn_records(reconstruction, predicted), slip=slips),
            loop_columns(reconstruction, predicted, slips),
        ),
        Plate(
            "law_residuals",
            "What the laws leave",
            "Rms over the records of what is left of each cosine and sine of the friction force. Right: relative "
            "to the resolution of the sensors; a law that is right stays near 1, where the noise of the slip, through "
            "the law's stiffness, adds to it.",
            figures.plot_law_residuals(reconstruction, predicted),
            residual_columns(reconstruction, predicted),
        ),
    ]
    if by_level:
        caption = (
            "Fitted to each force level alone, with 95 % bars, beside the value of all levels (line and band). A "
            "parameter that drifts with the level says that the law is not the right one. Hollow: not determined, the "
            "standard deviation exceeds the value; such bars leave the panel."
        )
        columns = parameter_columns(laws)
        plates.append(
            Plate(
                "parameters",
                "Parameters by level",
                caption,
                figures.plot_parameters(by_level, list(predicted)),
                columns,
            )
        )
    return plates


def drawn_records(reconstruction: Reconstruction, predicted: figures.Predicted) -> list[int]:
    """Records whose loops are drawn: those that show most, without records held out of a law."""
    seen = [record for record in figures.loop_records(reconstruction) if _seen(reconstruction, predicted, record)]
    every = reconstruction.spectra.records.tolist()
    return seen or [record for record in every if _seen(reconstruction, predicted, record)][:MOST_DRAWN]


def _seen(reconstruction: Reconstruction, predicted: figures.Predicted, record: int) -> bool:
    i = reconstruction.index(record)
    return all(bool(np.isfinite(forces[i]).all()) for forces in predicted.values())


def loop_columns(reconstruction: Reconstruction, predicted: figures.Predicted, slips: figures.Predicted) -> Columns:
    """Closed loops of the records drawn: slip and friction with standard deviations, and those of each law."""
    places = [reconstruction.index(record) for record in drawn_records(reconstruction, predicted)]
    phase = np.append(reconstruction.phase, 1.0)
    slip, friction = reconstruction["slip"], reconstruction["friction"]
    shown = {"slip": slip.samples, "slip_std": slip.std, "friction": friction.samples, "friction_std": friction.std}
    for law, forces in predicted.items():
        shown |= {f"slip_{law}": slips[law], f"friction_{law}": forces}
    columns = record_columns(reconstruction, np.repeat(places, len(phase))) | {"phase": np.tile(phase, len(places))}
    return columns | {name: np.concatenate([closed(values[i]) for i in places]) for name, values in shown.items()}


def residual_columns(reconstruction: Reconstruction, predicted: figures.Predicted) -> Columns:
    """Rms residual of each harmonic, in N and relative to the resolution of the sensors."""
    columns = {"harmonic": np.arange(1.0, reconstruction.H + 1), "resolution": figures.residual_noise(reconstruction)}
    for law, forces in predicted.items():
        columns[f"rms_{law}"], columns[f"relative_{law}"] = figures.law_residuals(reconstruction, forces)
    return columns


# ---------------------------------------------------------------------------------------------------------------- page


def identify_page(
    reconstruction: Reconstruction,
    laws: Sequence[IdentifiedLaw],
    plates: Sequence[Plate],
    verdict: str,
    errors: RigErrors | None,
    output_error: SpectraFit | None,
    warnings: Sequence[str],
) -> Page:
    """The page about identified laws, with its figures."""
    best, r = ranked(laws)[0], reconstruction
    table = Section(
        "Laws",
        table=Table(*law_table(laws), "misfit: per degree of freedom; ± is one standard deviation"),
        csv=(LAW_FILE, PARAMETER_FILE),
    )
    return Page(
        title=f"{r.rig.name}: friction laws",
        lead=(
            f"{len(laws)} friction law{'s' * (len(laws) > 1)} fitted to the friction force that was reconstructed from "
            f"{len(r)} records, weighed by its uncertainty.",
            *filter(None, [verdict]),
        ),
        warnings=warnings,
        summary=(
            ("Best law", best.law),
            *((v.name, value_text(v)) for v in best.values),
            *((f"{name}, by the rig file", f"± {std}") for name, std, _ in ([] if errors is None else errors.told)),
            ("Misfit per degree of freedom", f"{best.chi2_reduced:.3g} (1: as much as standard deviations say)"),
        ),
        sections=(
            table,
            *_rig_error_sections(errors),
            *_output_error_sections(laws, output_error),
            *(plate.section for plate in plates),
        ),
        foot=f"hbm {installed_version()}, hbm identify; spectra: {r.spectra.source}",
    )


def _rig_error_sections(errors: RigErrors | None) -> list[Section]:
    """What numbers of the rig file are uncertain by, in the parameters of the best law."""
    if errors is None:
        return []
    told = (
        "Friction is reconstructed with the numbers of the rig file. What these may be off by (--tolerance, or the "
        "tolerances of a diagnosis) is in no standard deviation above: it is the same in all records. Beside noise, "
        f"of {errors.law}:"
    )
    asks = errors.known.asks
    where = "; hbm inverse makes a rig file of that" if errors.known.asked else ""
    more = [f"{asks[0].upper()}{asks[1:]}{where}."] if asks else []
    table = Table(("parameter", "standard deviation", "most by (off by: change)"), [list(row) for row in errors.told])
    return [Section("What the rig file is uncertain by", text=(told, *more), table=table, csv=(RIG_ERROR_FILE,))]


def _output_error_sections(laws: Sequence[IdentifiedLaw], fit: SpectraFit | None) -> list[Section]:
    """The law fitted to the spectra themselves, beside what was identified from the contact signals."""
    if fit is None:
        return []
    before = {v.name: value_text(v) for law in laws if law.law == fit.name for v in law.values}
    rows = [
        [p.name, before.get(p.name, "-"), value_text(Value(p.name, p.value, p.std, p.unit))]
        for p in fit.parameters.entries
    ]
    told = (
        f"{fit.name}, through the forward model: each steady state simulated and compared with the measured responses; "
        f"misfit {fit.quality.chi2_reduced:.3g} per degree of freedom, {len(fit.records)} records. {fit.numerics}",
    )
    table = Table(("parameter", "from contact signals", "from spectra"), rows)
    return [
        Section("Fitted to the spectra themselves", text=(*told, *fit.failures), table=table, csv=(OUTPUT_ERROR_FILE,))
    ]
