"""A beam with a bolted lap joint: stiffness and damping of the joint over amplitude, from fundamentals alone."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import NullFormatter

from hbm.figures.style import FAINT, SMALL, WIDTH, dressed, graded

from .common import DATA, Finding, Sweep, legend_above, read_sweeps, table, with_std
from .single_mode import Equivalent, ModeFit, Reference, diagnosed, equivalent, exponent, fit_mode, reference, slope

FOLDER = DATA / "brb_jointed_beam"

REACH = 0.02
"""The largest constant response is this share, at most, above what constant force reached."""


def sweeps() -> tuple[list[Sweep], list[Sweep]]:
    """Records at constant force, and at constant response, by rising level."""
    every = read_sweeps(FOLDER / "forced_harmonics.csv", "force", "acc3")
    return [s for s in every if s.name.startswith("FC")], [s for s in every if s.name.startswith("RC")]


def implied() -> tuple[Reference, list[Equivalent]]:
    """The mode, from the constant-force record of lowest level, and what the joint makes of it at all levels."""
    by_force, _ = sweeps()
    found = reference(by_force[:1], 2, 2, rigid=True, turn=False)
    return found, [equivalent(found.mode, s, "acceleration", "jointed beam")[0] for s in by_force]


def own_peaks() -> list[tuple[Sweep, ModeFit, float]]:
    """Constant-response records by themselves: a linear fit each, and the displacement amplitude at their resonance.

    No harmonic balance and no other record: at constant response the joint is linear, so is the response.
    """
    peaks = []
    for sweep in sweeps()[1]:
        fit = fit_mode(sweep, 2, rigid=True, turn=False)
        amplitude = np.interp(fit.mode.hz, sweep.hz, np.abs(sweep.response)) / (2 * np.pi * fit.mode.hz) ** 2
        peaks.append((sweep, fit, float(amplitude)))
    return peaks


def at_amplitude(found: list[Equivalent], amplitude: float) -> tuple[float, float, float, float]:
    """Frequency and ratio at an amplitude, mean over the records and branches that meet it, and their scatter.

    The scatter is what the same joint does at the same amplitude on two sides of its resonance, and in other records:
    repeatability, with the error of the reference mode. The noise of the points is far smaller.
    """
    met = [values for e in found for values in _branches(e, amplitude)]
    f, z = np.array(met).T
    scatter = (float(np.std(x, ddof=1)) if len(x) > 1 else float("nan") for x in (f, z))
    return (float(f.mean()), float(z.mean()), *scatter)


def _branches(e: Equivalent, amplitude: float) -> list[tuple[float, float]]:
    """Frequency and ratio where the amplitude is met below and above resonance."""
    top = int(e.amplitude.argmax())
    if e.amplitude[top] < amplitude < (1.0 + REACH) * e.amplitude[top]:
        amplitude = float(e.amplitude[top])
    met = []
    for part in (slice(0, top + 1), slice(top, None)):
        A = e.amplitude[part]
        if len(A) > 1 and A.min() <= amplitude <= A.max():
            order = np.argsort(A)
            met.append(
                (
                    float(np.interp(amplitude, A[order], e.frequency[part][order])),
                    float(np.interp(amplitude, A[order], e.ratio[part][order])),
                )
            )
    return met


def run() -> Finding:
    """Table, figure and conclusion."""
    found, joints = implied()
    peaks = own_peaks()
    rows = []
    for sweep, fit, amplitude in peaks:
        f, z, f_std, z_std = at_amplitude(joints, amplitude)
        rows.append(
            (
                f"{sweep.name}, {amplitude * 1e6:.0f} µm",
                with_std(f, f_std),
                with_std(fit.mode.hz, fit.hz_std),
                with_std(z, z_std, 1e2),
                with_std(fit.mode.ratio, fit.ratio_std, 1e2),
            )
        )
    every = [np.concatenate([getattr(e, name) for e in joints]) for name in ("amplitude", "energy")]
    n, n_std, _ = exponent(*every)
    f = [at_amplitude(joints, a)[0] for *_, a in peaks]
    z = [at_amplitude(joints, a)[1] for *_, a in peaks]
    apart = (
        max(abs(x - fit.mode.hz) for x, (_, fit, _) in zip(f, peaks, strict=True)),
        max(abs(x / fit.mode.ratio - 1.0) for x, (_, fit, _) in zip(z, peaks, strict=True)),
    )
    return Finding(
        "brb_jointed_beam",
        table(
            "Jointed beam: implied by reconstructed joint force (constant force) and own peaks (constant response)",
            ("record", "implied f [Hz]", "own f [Hz]", "implied ζ [%]", "own ζ [%]"),
            rows,
        ),
        _figure(joints, peaks),
        (
            f"Frequency falls from {f[0]:.2f} to {min(f):.2f} Hz at {peaks[int(np.argmin(f))][2] * 1e6:.0f} µm and "
            f"rises to {f[-1]:.2f} Hz; damping rises from {z[0] * 100:.2f} to {z[-1] * 100:.2f} %; so say both paths.",
            f"Energy per cycle ~ A^{with_std(*slope(*every))} (beyond a part ~ A^2, A^{with_std(n, n_std)}). The paths "
            f"differ by up to {apart[0]:.2f} Hz and {apart[1] * 100:.0f} % of ζ, more than noise: other runs.",
            diagnosed(found.mode, sweeps()[0], "acceleration", "jointed beam"),
        ),
    )


def _figure(joints: list[Equivalent], peaks: list[tuple[Sweep, ModeFit, float]]) -> Figure:
    figure = Figure(figsize=(WIDTH, 2.7), layout=ConstrainedLayoutEngine(wspace=0.06))
    axes = figure.subplots(1, 3)
    for e, color in zip(joints, graded([0.0, 1.0, 2.0]), strict=True):
        A = e.amplitude * 1e6
        for ax, y, std in (
            (axes[0], e.frequency, e.frequency_std),
            (axes[1], e.ratio * 1e2, e.ratio_std * 1e2),
            (axes[2], e.energy * 1e3, e.energy_std * 1e3),
        ):
            ax.errorbar(A, y, 2 * std, fmt="o", color=color, markersize=2.4, elinewidth=0.7, label=_label(e.name))
    for i, (_, fit, amplitude) in enumerate(peaks):
        label = "own peak, constant response" if i == 0 else None
        for ax, y, std in (
            (axes[0], fit.mode.hz, fit.hz_std),
            (axes[1], fit.mode.ratio * 1e2, fit.ratio_std * 1e2),
        ):
            ax.errorbar(
                amplitude * 1e6, y, 2 * std, fmt="D", mfc="white", mec="C3", ecolor="C3", markersize=5, label=label
            )
    A = np.linspace(20.0, 300.0, 57)
    for power, text, place in ((2, "$A^2$", (-14, 4)), (4, "$A^4$", (-4, -12))):
        line = 1.2 * (A / 275.0) ** power
        axes[2].plot(A[A > 20.0 * (power - 1)], line[A > 20.0 * (power - 1)], color=FAINT, linewidth=0.9, zorder=0)
        first = int(np.argmax(A > 20.0 * (power - 1)))
        axes[2].annotate(text, (A[first], line[first]), place, textcoords="offset points", fontsize=SMALL, color="0.45")
    axes[2].set_xscale("log")
    axes[2].set_yscale("log")
    axes[2].set_xticks([10, 30, 100, 300], ["10", "30", "100", "300"])
    axes[2].xaxis.set_minor_formatter(NullFormatter())
    for ax, label in zip(axes, ("Frequency [Hz]", "Damping ratio [%]", "Energy per cycle [mJ]"), strict=True):
        dressed(ax, "Displacement [µm]", label)
    legend_above(figure, axes[0])
    return figure


def _label(name: str) -> str:
    return name.removeprefix("FC_").replace("N", " N")
