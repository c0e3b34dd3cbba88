"""A beam resonating in thin air: frequency and damping over amplitude, where only the drive voltage is known."""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from hbm.figures.style import WIDTH, dressed, graded

from .common import DATA, Finding, Sweep, legend_above, read_sweeps, table, with_std
from .single_mode import Equivalent, Mode, Reference, diagnosed, equivalent, exponent, fit_mode, reference, slope

FOLDER = DATA / "eth_vacuum_beam"

RAYLEIGH = 4 / (3 * np.pi)
"""Loss over loss of stiffness of a loop whose arcs are parabolas (Rayleigh 1887): E grows like A^3, k falls like A."""


def sweeps() -> list[Sweep]:
    """One record a drive voltage."""
    return read_sweeps(FOLDER / "forced_harmonics.csv", "drive_voltage", "velocity")


def implied() -> tuple[list[Reference], list[Equivalent]]:
    """The modes, of one frequency and damping ratio, and what each level makes of them.

    That force is proportional to voltage is an assumption: its size and phase per volt are found for each level, as
    those that make the sides below and above resonance agree.
    """
    every = sweeps()
    found = [reference([s], 1, 2, rigid=False, turn=True) for s in every]
    lowest = found[0].mode
    modes = [replace(lowest, shape=x.mode.shape, turn=x.mode.turn) for x in found]
    return found, [equivalent(m, s, "velocity", "beam in vacuum")[0] for m, s in zip(modes, every, strict=True)]


def phase_resonance(sweep: Sweep, mode: Mode) -> tuple[float, float, float]:
    """Frequency where velocity is in phase with the force, its amplitude [m], and the damping ratio of that point.

    Read off the curve alone: no reconstruction; only the phase and the size of the force per volt are the mode's.
    """
    h = sweep.response / (sweep.drive * np.exp(1j * mode.turn))
    order = np.argsort(h.imag)
    hz, height = (float(np.interp(0.0, h.imag[order], x[order])) for x in (sweep.hz, h.real))
    amplitude = height * sweep.level / (2 * np.pi * hz)
    return hz, amplitude, mode.shape**2 / (2 * height * 2 * np.pi * hz)


def slopes(joints: list[Equivalent]) -> tuple[np.ndarray, np.ndarray]:
    """Straight lines through -df/f and zeta over amplitude [1, 1/m]."""
    A, f, z = (np.concatenate([getattr(e, x) for e in joints]) for x in ("amplitude", "frequency", "ratio"))
    by_frequency = np.polyfit(A, f, 1)
    return np.array([-by_frequency[0] / by_frequency[1], by_frequency[1]]), np.polyfit(A, z, 1)


def run() -> Finding:
    """Table, figure and conclusion."""
    found, joints = implied()
    rows = []
    for sweep, e, own in zip(sweeps(), joints, found, strict=True):
        hz, amplitude, ratio = phase_resonance(sweep, own.mode)
        near = np.argsort(np.abs(e.hz - hz))[:2]
        linear = fit_mode(sweep, 1, rigid=False, turn=True)
        rows.append(
            (
                f"{sweep.level:g} V, {amplitude * 1e6:.0f} µm",
                f"{e.frequency[near].mean():.4f}",
                f"{hz:.4f}",
                with_std(linear.mode.hz, linear.hz_std),
                f"{e.ratio[near].mean() * 1e4:.3f}",
                f"{ratio * 1e4:.3f}",
                with_std(linear.mode.ratio, linear.ratio_std, 1e4),
                with_std((own.mode.shape / found[0].mode.shape) ** 2, 2 * own.shape_std / own.mode.shape),
            )
        )
    A, E = (np.concatenate([getattr(e, name) for e in joints]) for name in ("amplitude", "energy"))
    n, n_std, _ = exponent(A, E)
    softening, damping = slopes(joints)
    rise = (found[-1].mode.shape / found[0].mode.shape) ** 2 - 1.0
    return Finding(
        "eth_vacuum_beam",
        table(
            "Beam in vacuum: implied by the reconstructed force, read off the curve at phase resonance, linear fit",
            ("level", "implied f [Hz]", "phase f", "linear f", "implied ζ [1e-4]", "phase ζ", "linear ζ", "force/V"),
            rows,
        ),
        _figure(
            joints, [phase_resonance(s, own.mode) for s, own in zip(sweeps(), found, strict=True)], softening, damping
        ),
        (
            f"Frequency falls and damping rises with amplitude; energy per cycle ~ A^{with_std(*slope(A, E))} (beyond "
            f"a part ~ A^2, A^{with_std(n, n_std)}). Force per volt is no constant: {rise:.0%} more at the top level.",
            f"Slope of ζ over slope of -f/f_0: {damping[0] / softening[0]:.3f}; hysteresis with parabolic arcs "
            f"(Rayleigh) has {RAYLEIGH:.3f}, a softening spring 0: micro-slip, and drag perhaps.",
            diagnosed(found[0].mode, sweeps(), "velocity", "beam in vacuum"),
        ),
    )


def _figure(
    joints: list[Equivalent],
    peaks: list[tuple[float, float, float]],
    softening: np.ndarray,
    damping: np.ndarray,
) -> Figure:
    figure = Figure(figsize=(WIDTH, 2.7), layout="constrained")
    axes = figure.subplots(1, 2)
    for e, s, color in zip(joints, sweeps(), graded([s.level for s in sweeps()]), strict=True):
        A = e.amplitude * 1e6
        for ax, y, std in ((axes[0], e.frequency, e.frequency_std), (axes[1], e.ratio * 1e4, e.ratio_std * 1e4)):
            ax.errorbar(A, y, 2 * std, fmt="o", color=color, markersize=2.6, elinewidth=0.7, label=f"{s.level:g} V")
    x = np.array([0.0, 360.0])
    lines = softening[1] * (1 - softening[0] * x * 1e-6), 1e4 * (damping[1] + damping[0] * x * 1e-6)
    for ax, line in zip(axes, lines, strict=True):
        ax.plot(x, line, color="0.55", linewidth=0.8, linestyle=(0, (4, 2)), zorder=0)
    for i, (hz, amplitude, ratio) in enumerate(peaks):
        for ax, y in zip(axes, (hz, ratio * 1e4), strict=True):
            label = "at phase resonance, read off the curve" if i == 0 else None
            ax.plot(amplitude * 1e6, y, "D", mfc="none", mec="C3", markersize=6, label=label)
    for ax, label in zip(axes, ("Frequency [Hz]", r"Damping ratio [$10^{-4}$]"), strict=True):
        dressed(ax, "Displacement [µm]", label)
        ax.set_xlim(0.0, 370.0)
    axes[0].ticklabel_format(useOffset=False)
    legend_above(figure, axes[0])
    return figure
