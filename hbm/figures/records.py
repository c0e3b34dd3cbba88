"""Records one by one, for a page on which a reader chooses: a period of every channel, measured and simulated."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from hbm.figures.compared import Compared, record_errors
from hbm.figures.page import Choice, Drawing, Option, Table
from hbm.fourier import Array

SAMPLES = 96
"""Points of a drawn period."""

WIDTH, HEIGHT, EDGE = 200, 80, 4
"""Units of a drawing, and the room that is left above and below."""

MOST_RECORDS, MOST_DRAWN = 120, 8
"""Records on a page, and channels that are drawn, at most."""


def record_choice(models: Mapping[str, Compared], channels: Sequence[str], units: Sequence[str]) -> Choice:
    """Records beside the models, for a page.

    Parameters
    ----------
    models : mapping of str to Compared
        By the names of the models.
    channels, units : sequence of str

    Returns
    -------
    Choice
        Of the records that the calibrated model misses most and all models have, in the order of their numbers; shown
        first is the one that it misses most clearly.
    """
    judged = models.get("calibrated", next(iter(models.values())))
    numbers, place = np.unique(judged.record, return_inverse=True)
    # a record whose steady state one of the models has lost is compared by none
    shared = np.all([np.isin(numbers, c.record) for c in models.values()], axis=0)
    missed = np.where(shared, np.bincount(place.ravel(), judged.deviation**2), -1.0)
    kept = np.sort(np.argsort(-missed)[: min(MOST_RECORDS, int(shared.sum()))])
    options = tuple(_option(models, channels, units, int(numbers[i])) for i in kept)
    shown = int(np.argmax(missed[kept])) if len(kept) else 0
    return Choice("Record", options, shown, ("measured", *models))


def _option(models: Mapping[str, Compared], channels: Sequence[str], units: Sequence[str], number: int) -> Option:
    any_model = next(iter(models.values()))
    own = any_model.record == number
    held = ", held out" if bool(any_model.held_out[own][0]) else ""
    label = f"{number}: {any_model.level[own][0]:.3g} N, {any_model.hz[own][0]:.5g} Hz{held}"
    drawings, rows = [], []
    for place, (name, unit) in enumerate(zip(channels, units, strict=True)):
        entries = {model: c.where((c.record == number) & (c.channel == place)) for model, c in models.items()}
        first = next(iter(entries.values()))
        if len(first.harmonic):
            rows.append([name, *_row(entries, unit)])
            drawings.append(_drawing(name, unit, entries))
    rows.append(["all channels", "-", *_errors(models, number)])
    headings = ["channel", "fundamental", *(f"{model} [%]" for model in models), "noise [%]"]
    return Option(label, tuple(drawings[:MOST_DRAWN]), Table(headings, rows))


def _row(entries: Mapping[str, Compared], unit: str) -> Iterator[str]:
    """Measured fundamental, and the deviation of each model and of noise relative to the channel's reading."""
    first = next(iter(entries.values()))
    whole = float(np.linalg.norm(first.measured)) or 1.0
    fundamental = first.where(first.harmonic == 1)
    yield f"{abs(fundamental.measured[0]):.4g} {unit}" if len(fundamental.harmonic) else "-"
    for c in entries.values():
        yield _percent(float(np.linalg.norm(c.measured - c.simulated)) / whole)
    yield _percent(float(np.linalg.norm(np.sqrt(2.0) * first.std)) / whole)


def _errors(models: Mapping[str, Compared], number: int) -> Iterator[str]:
    """Relative error of each model over all channels, and of noise."""
    noise = 0.0
    for c in models.values():
        first, error, alone = record_errors(c)
        place = int(np.flatnonzero(c.record[first] == number)[0])
        noise = float(alone[place])
        yield _percent(float(error[place]))
    yield _percent(noise)


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g}" if share < 1.0 else f"{100.0 * share:.0f}"


def _drawing(name: str, unit: str, entries: Mapping[str, Compared]) -> Drawing:
    """One period of a channel from its harmonics, by model, in the box of a drawing."""
    first = next(iter(entries.values()))
    periods = {"measured": period(first.harmonic, first.measured)}
    periods |= {model: period(c.harmonic, c.simulated) for model, c in entries.items()}
    top = max(float(np.abs(y).max()) for y in periods.values()) or 1.0
    lines = {model: _points(y / top) for model, y in periods.items()}
    return Drawing(f"{name}, ±{top:.3g} {unit}", WIDTH, HEIGHT, lines)


def period(harmonic: npt.NDArray[np.int64], amplitude: npt.NDArray[np.complex128]) -> Array:
    """Samples of one period, its end too, of a signal by its complex amplitudes, s = Re sum c_k exp(i k theta)."""
    phase = np.linspace(0.0, 2.0 * np.pi, SAMPLES + 1)
    return np.asarray((amplitude[:, None] * np.exp(1j * harmonic[:, None] * phase)).real.sum(axis=0))


def _points(y: Array) -> str:
    """Points of an SVG polyline, y from -1 to 1."""
    across = np.linspace(0, WIDTH, len(y))
    down = HEIGHT / 2 - (HEIGHT / 2 - EDGE) * y
    return " ".join(f"{a:.0f},{b:.1f}" for a, b in zip(across, down, strict=True))
