"""Figures of a diagnosis with the numbers of their curves."""

from collections.abc import Iterator

import numpy as np

from hbm.diagnosis.decide import DECISIVE, TIED
from hbm.diagnosis.verdict import Diagnosis
from hbm.figures import diagnosis as figures
from hbm.figures.decay import plot_decay
from hbm.figures.gain import plot_gain
from hbm.figures.identification import plot_ranking
from hbm.figures.lines import most_missed, plot_lines
from hbm.figures.misfitmap import plot_misfit_map
from hbm.figures.missingforce import plot_missing_force
from hbm.figures.overview import plot_overview
from hbm.files.diagnosed import Diagnosed
from hbm.files.diagnosiscolumns import (
    compared_columns,
    decay_columns,
    deviation_columns,
    error_columns,
    overview_columns,
    place_columns,
    ranked_rows,
    ranking_columns,
)
from hbm.files.figurefiles import Plate
from hbm.measurement.decay import Decay

PLATES = ("overview", "lines", "backbone", "responses", "gain", "deviations", "misfit_map", "missing_force", "ranking")
"""Names of all that there can be."""

CURVE_FILE = "response_curves.csv"
"""Numbers of the curves that were traced."""

MOST_RANKED = 10
"""Causes of a table or figure, at most."""

RULES = (
    f"A cause is accepted if its BIC is at least {DECISIVE:g} below that of the rig file that it extends. Of two "
    f"causes the lower BIC says nothing where chi2 differs by less than {TIED:g}: these records cannot tell them apart."
)
"""The two rules by which causes are judged, which have thresholds of their own."""


def diagnosis_plates(found: Diagnosed) -> list[Plate]:
    """The figures with their numbers; those of the models only where these are known."""
    own = found.diagnosis
    if own.floored:
        first = _decay_plates(found, found.spectra) if isinstance(found.spectra, Decay) else _line_plates(found)
        return [*first, *_gain_plates(own), *_ranking_plates(found)]
    return [
        *_overview(found),
        *_response_plates(found),
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
    channel, unit = found.channels[view.channel], found.units[view.channel]
    most = "moves most" if found.diagnosis.verdict == "consistent" else "the rig file misses most clearly"
    yield Plate(
        "overview",
        "What is wrong",
        f"Left: what {most}, harmonic {view.harmonic} of {channel} at {view.level:.3g} N, with 95 % bars"
        f"{_lines(found)}. Right: relative error of each record over all channels and harmonics, beside what noise "
        "makes of it. Hollow: records held out, which no fit has seen.",
        plot_overview(found.compared, view, channel, unit, traced=found.traced),
        found.labelled(overview_columns(found.compared, view)),
    )


def _line_plates(found: Diagnosed) -> Iterator[Plate]:
    """The one figure that shows what is wrong in records of many lines."""
    models = found.compared
    if not models:
        return
    record, channel = most_missed(models)
    (label,) = found.spectra.labels_of(np.array([record])).tolist()
    first = next(iter(models.values()))
    held = ", which no fit has seen" if first.held_out[first.record == record].any() else ""
    columns = found.labelled(compared_columns(models, found.channels))
    yield Plate(
        "lines",
        "What is wrong",
        f"Amplitude of each line of {found.channels[channel]} in record {label}{held}; that of what each model misses, "
        "phase included; and of the noise that was stated.",
        plot_lines(models, record, channel, found.channels[channel], found.units[channel]),
        columns,
    )


def _decay_plates(found: Diagnosed, decay: Decay) -> Iterator[Plate]:
    """The one figure that shows what is wrong with a backbone."""
    models = found.compared
    if not models:
        return
    yield Plate(
        "backbone",
        "What is wrong",
        "Frequency and damping ratio over the amplitude, measured, with 95 % bars, and simulated; below, what models "
        "miss. Hollow: amplitudes held out, which no fit has seen.",
        plot_decay(models, decay, found.channels[0], found.units[0]),
        decay_columns(models, decay),
    )


def _gain_plates(d: Diagnosis) -> Iterator[Plate]:
    if d.errors:
        caption = (
            "Relative error, and misfit in noise variances (1: noise alone), of each model on the records it was "
            "fitted to (filled) and on those held out (hollow)."
        )
        yield Plate("gain", "What the extended model gains", caption, plot_gain(d), error_columns(d))


def _response_plates(found: Diagnosed) -> Iterator[Plate]:
    models, channels = found.compared, found.channels
    if not _fundamental(found):
        return
    columns = found.labelled(compared_columns(models, channels))
    yield Plate(
        "responses",
        "Measured and simulated",
        "Amplitude of the fundamental over the frequency, by level, with 95 % bars: before (nominal, calibrated) and "
        f"after (extended){_lines(found)}. Hollow: records held out, which no fit has seen.",
        figures.plot_responses(models, channels, found.units, traced=found.traced),
        {name: values[columns["harmonic"] == 1] for name, values in columns.items() if name != "deviation"},
        (CURVE_FILE,) if found.traced else (),
    )


def _fundamental(found: Diagnosed) -> bool:
    """Whether the fundamental is compared in any record: where a band of frequencies leaves it out it has no figure."""
    return any(bool((c.harmonic == 1).any()) for c in found.compared.values())


def _lines(found: Diagnosed) -> str:
    """Meaning of the lines of the models, for a caption."""
    if not found.traced:
        return "; lines join the records"
    names = {t.model for t in found.traced}
    others = [name for name in found.compared if name not in names]
    joined = f"; lines of the {' and '.join(others)} model join its records" if others else ""
    return f"; curves are traced with the mean of the forces that were measured at the level{joined}"


def _model_plates(found: Diagnosed) -> Iterator[Plate]:
    models, channels = found.compared, found.channels
    if not models:
        return
    columns = found.labelled(compared_columns(models, channels))
    if _fundamental(found):
        yield Plate(
            "deviations",
            "Deviations",
            "Measured less simulated fundamental relative to the measured one, phase included; beside what noise makes "
            "of it. Hollow: records held out.",
            figures.plot_deviations(models, channels),
            found.labelled(deviation_columns(models, channels)),
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
    two = f" Each place acts beside {d.known}: no place alone will do." if d.known else ""
    beside = two if d.two else ""
    yield Plate(
        "missing_force",
        "What is missing, and where",
        "What is left when an unknown force acts at one place, two numbers per record and harmonic "
        f"(in brackets, where places differ in it: share of the misfit beyond noise that it explains).{beside} Below, "
        "of the best place: the force by harmonics, in phase and in quadrature to the fundamental of the motion, and "
        "its growth, with 95 % bars, a colour for each level; hollow: lost in noise.",
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
        f"Left: Bayesian information criterion (BIC) above that of the best. {RULES} Right: error on the records held "
        "out.",
        plot_ranking([row[0] for row in rows], bic, held if np.isfinite(held).all() else None, clear=DECISIVE),
        ranking_columns(found.diagnosis),
    )
