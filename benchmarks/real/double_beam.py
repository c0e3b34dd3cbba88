"""Decays of a beam with a bolted inner beam: `hbm spectra` must not take them for steady states."""

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from hbm.figures.style import INK, SMALL, WIDTH, dressed, graded
from hbm.measurement.harmonics import HarmonicEstimate, harmonic_spectra
from hbm.measurement.recording import recording

from .common import DATA, Finding, read_rows, table, with_std

FOLDER = DATA / "resonant_double_beam"
WINDOWS = ((0.3, 1.3), (1.5, 3.0))
"""From early, where friction makes the rate fall with the amplitude, and late [s]."""
RUNG = 0.15
"""Until then [s] the table still has other modes in it."""
PLACES = ("position_1", "position_2", "position_3")


@dataclass(frozen=True, eq=False)
class Decay:
    """One blow, mode 1: velocity, and the set's own instantaneous frequency and decay rate."""

    name: str
    impact: str
    time: np.ndarray
    velocity: np.ndarray
    at: np.ndarray
    amplitude: np.ndarray
    hz: np.ndarray
    rate: np.ndarray

    def inside(self, window: tuple[float, float]) -> np.ndarray:
        """Rows of the table within a window."""
        return (self.at >= window[0]) & (self.at <= window[1])

    def estimate(self, window: tuple[float, float]) -> HarmonicEstimate:
        """What `hbm spectra` makes of a window, at the mean frequency of the table."""
        kept = (self.time >= window[0]) & (self.time < window[1])
        recorded = recording(self.name, self.time[kept], {"velocity": self.velocity[kept]})
        return harmonic_spectra(recorded, float(self.hz[self.inside(window)].mean()), 3)


def decays() -> list[Decay]:
    """All records."""
    rows = [r for r in read_rows(FOLDER / "instantaneous_frequency_damping.csv") if r["mode"] == "1"]
    kept = np.load(FOLDER / "decays.npz")
    found = []
    for name in sorted({r["record"] for r in rows}):
        mine = [r for r in rows if r["record"] == name]
        t, A, f, z = (
            np.array([float(r[c]) for r in mine])
            for c in ("time_s", "velocity_amplitude_ms", "frequency_hz", "damping_ratio")
        )
        v = kept[f"{name}_velocity_ms"].astype(float)
        found.append(Decay(name, mine[0]["impact"], kept["time_s"], v, t, A, f, 2 * np.pi * f * z))
    return found


def run() -> Finding:
    """Table, figure and conclusion."""
    every = decays()
    rows, flagged, ratios = [], 0, []
    for d in every:
        cells = [f"{d.name}, {d.impact[-1]}"]
        for window in WINDOWS:
            s = d.estimate(window).quality[0].steadiness
            flagged += not s.steady
            low, high = d.rate[d.inside(window)].min(), d.rate[d.inside(window)].max()
            cells += [f"{low:.2f}..{high:.2f}", with_std(s.decay_rate, s.decay_rate_std), f"{s.change:.0%}"]
            ratios.append(s.decay_rate / d.rate[d.inside(window)].mean())
        rows.append(tuple(cells))
    early, late = np.array(ratios[::2]), np.array(ratios[1::2])
    (low, high), (f_low, f_high) = ([min(x), max(x)] for x in _extremes(every))
    head = ("record, place", *(f"{h} {w[0]:g}..{w[1]:g} s" for w in WINDOWS for h in ("table", "hbm", "trend")))
    return Finding(
        "resonant_double_beam",
        table(
            "Decays: rate [1/s] of the set's table over a window, and of the transient that hbm spectra sees",
            head,
            rows,
        ),
        _figure(every),
        (
            f"{flagged} of {2 * len(every)} windows are flagged as not steady; rate of hbm over that of the table: "
            f"{early.min():.2f} to {early.max():.2f} early, {late.min():.2f} to {late.max():.2f} late.",
            f"The rate is no constant: from {high:.2f} 1/s it falls to {low:.2f} as the amplitude dies out, while the "
            f"frequency rises from {f_low:.2f} to {f_high:.2f} Hz: one exponential and a rest is the wrong shape.",
        ),
    )


def _extremes(every: list[Decay]) -> tuple[np.ndarray, ...]:
    return tuple(np.concatenate([getattr(d, x)[d.at > RUNG] for d in every]) for x in ("rate", "hz"))


def _figure(every: list[Decay]) -> Figure:
    figure = Figure(figsize=(WIDTH, 2.7), layout="constrained")
    axes = figure.subplots(1, 2)
    for place, color in zip(PLACES, graded([0.0, 1.0, 2.0]), strict=True):
        for i, d in enumerate(x for x in every if x.impact == place):
            label = f"blow at position {place[-1]}" if i == 0 else None
            for ax, y in zip(axes, (d.hz, d.rate), strict=True):
                ax.semilogx(
                    d.amplitude[d.at > RUNG],
                    y[d.at > RUNG],
                    "o-",
                    color=color,
                    markersize=2.2,
                    linewidth=0.7,
                    label=label,
                )
    for ax, label in zip(axes, ("Frequency [Hz]", "Decay rate [1/s]"), strict=True):
        dressed(ax, "Velocity amplitude [m/s]", label)
        ax.set_xticks([0.1, 0.2, 0.4, 0.8], ["0.1", "0.2", "0.4", "0.8"])
        ax.xaxis.set_minor_formatter(NullFormatter())
    axes[0].legend(frameon=False, fontsize=SMALL, labelcolor=INK)
    axes[0].ticklabel_format(axis="y", useOffset=False)
    return figure
