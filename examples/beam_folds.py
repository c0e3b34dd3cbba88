"""What the paper's beam does between 45 and 58 Hz at 6.5 N, and the resonance beside it that no sweep meets.

The fold of the response near 48.7 Hz is followed in frequency and force; it comes back to 6.5 N on a closed curve,
which is traced. Dashed is what is unstable; dots are time integrations. Every small peak of the response is a high
mode, excited by the harmonic that falls between its frequencies with the contact sliding and stuck, over the number of
the harmonic (bands). About three minutes.

    python examples/beam_folds.py figure.png
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from hbm.continuation import Kind
from hbm.models import Damping, Rig
from hbm.models.published import paper_rig
from matplotlib.figure import Figure

from hbm import ResponseCurve, linear_modes, steady_state, with_stability
from hbm.balance.solution import PeriodicSolution
from hbm.figures.style import FAINT, INK, SMALL, dressed, graded
from hbm.fourier import Array
from hbm.integration.handover import state_at_phase_zero
from hbm.integration.integrate import simulate
from hbm.response.trace import trace_frequency
from hbm.tracking.folds import FoldPath, fold_path, isolas

RANGE = 45.0, 58.0
LEVEL = 6.5
RESONANCES = {
    (2, 3): 53.4,
    (5, 17): 49.93,
    (4, 11): 50.79,
    (5, 16): 53.25,
    (3, 6): 54.51,
    (4, 10): 55.77,
    (5, 15): 56.69,
}
"""Mode and harmonic, counted from 1, and where it peaks [Hz]."""

ROWS = (2, 1, 0, 1, 0, 1, 0)
"""Of the bands, from below."""

STEPS = 1024
DARK, MIDDLE, LIGHT = graded([0.0, 1.0, 2.0])[::-1]
ORANGE = "#d55e00"


def main() -> Figure:
    """Figure of four panels."""
    rig = paper_rig().with_modes(10)
    response = with_stability(trace_frequency(rig, RANGE, harmonics=17, samples=512, step_hz=0.1))
    still = trace_frequency(_without_mode_2(rig), RANGE, harmonics=17, samples=512, step_hz=0.15)
    coarse = trace_frequency(paper_rig(), (49.0, 48.4), harmonics=9, samples=256)
    paths = [fold_path(coarse, (2.5, 12.0), fold=fold, max_points=250) for fold in (1, 0)]
    (isola,) = map(with_stability, isolas(paths[0], LEVEL, [coarse], (40.0, 60.0)))
    if isolas(paths[1], LEVEL, [coarse, isola], (40.0, 60.0)):
        raise ArithmeticError("a second detached curve, which the figure does not show")
    _say(response, still, paths, isola)
    figure = plt.figure(figsize=(7.0, 7.6), layout="constrained")
    above, between, below = figure.subfigures(3, 1, height_ratios=(1.35, 1.0, 1.15))
    _responses(above.subplots(), response, still, isola)
    _harmonics(between.subplots(), response)
    left, right = below.subplots(1, 2)
    _jump(left, response)
    _plane(right, paths, isola)
    for letter, ax in zip("abcd", figure.axes, strict=True):
        ax.set_title(f"({letter})", loc="left", fontsize=9, color=INK)
    return figure


def _without_mode_2(rig: Rig) -> Rig:
    """The rig with mode 2 damped so heavily, 20 %, that it cannot resonate."""
    ratios = rig.structure.damping / (2.0 * rig.structure.omega_n)
    ratios[1] = 0.2
    return replace(rig, damping=Damping(modal_ratios=tuple(ratios.tolist())))


def _marched(rig: Rig, start: PeriodicSolution, periods: int = 400) -> float:
    """Peak drive displacement [mm] after a march from a solution."""
    state = state_at_phase_zero(start)
    history = simulate(rig, start.hz, duration=periods / start.hz, steps_per_period=STEPS, start=state, last_periods=1)
    return 1e3 * float(np.abs(history.channels["drive"].values).max())


def _draw(ax: Any, curve: ResponseCurve, shown: Array, **style: Any) -> None:
    """Draw some points of a curve, dashed where they are unstable."""
    assert curve.stable is not None
    assert curve.doubtful is not None
    unstable = ~curve.stable & ~curve.doubtful
    height = np.where(shown, 1e3 * curve["drive"].peak, np.nan)
    ax.plot(curve.hz, np.where(unstable, np.nan, height), **style)
    beside = unstable | np.append(unstable[1:], False) | np.append(False, unstable[:-1])
    ax.plot(curve.hz, np.where(beside, height, np.nan), **(style | {"ls": (0, (2, 1)), "label": "_"}))


def _responses(ax: Any, response: ResponseCurve, still: ResponseCurve, isola: ResponseCurve) -> None:
    drawn, ring = response.dense, isola.dense
    ax.semilogy(still.dense.hz, 1e3 * still.dense["drive"].peak, color=FAINT, lw=1.2, label="mode 2 damped by 20 %")
    _draw(ax, drawn, np.ones(len(drawn.points), dtype=bool), color=DARK, lw=1.4, label="response at 6.5 N")
    off = np.array([p.lift_off for p in ring.points])
    _draw(ax, ring, ~off, color=ORANGE, lw=1.8, label="isola, tip on its support")
    height = np.where(off, 1e3 * ring["drive"].peak, np.nan)
    ax.plot(ring.hz, height, color=ORANGE, lw=0.8, ls=":", label="isola, tip would lift off")
    ax.plot([], [], color=INK, lw=1.4, ls=(0, (2, 1)), label="unstable")
    wanted = [49.5, 51.5, 53.9, 55.0, 57.0]
    starts = [min(response.points, key=lambda p: abs(p.hz - hz)) for hz in wanted]
    marched = [(p.hz, _marched(response.rig, p, 200)) for p in starts]
    top = max((p for p in isola.points if not p.lift_off and p.hz > 47.95), key=lambda p: p["drive"].peak)
    fine = steady_state(isola.rig, top.hz, harmonics=17, samples=1024, start=top)
    marched.append((fine.hz, _marched(isola.rig, fine)))
    print("time integration:", ", ".join(f"{y:.4f} mm at {hz:.3f} Hz" for hz, y in marched))
    ax.semilogy(*zip(*marched, strict=True), "o", ms=4, mfc="white", mec=INK, mew=0.8, label="time integration")
    for (mode, k), hz in RESONANCES.items():
        y = 1e3 * float(
            np.interp(hz, response.hz[np.argsort(response.hz)], response["drive"].peak[np.argsort(response.hz)])
        )
        low = mode == 5 and k == 16
        ax.annotate(
            f"{k}:{mode}",
            (hz, y),
            (0, -16 if low else 9),
            textcoords="offset points",
            ha="center",
            fontsize=SMALL,
            color=INK,
        )
    ax.set(xlim=RANGE, ylim=(0.01, 6.0))
    ax.legend(frameon=False, fontsize=SMALL, labelcolor=INK, loc="upper right")
    dressed(ax, "Excitation frequency [Hz]", "Drive displacement,\npeak [mm]")


def _harmonics(ax: Any, response: ResponseCurve) -> None:
    """Slip by single modes in single harmonics."""
    response = response.dense
    modes, H, s = linear_modes(response.rig), response.basis.H, response.rig.structure
    Q = np.array([p.state.Q for p in response.points])
    colors = graded([float(mode) for mode, _ in RESONANCES])
    for (mode, k), color, row in zip(RESONANCES, colors, ROWS, strict=True):
        slip = 1e6 * np.hypot(Q[:, k, mode - 1], Q[:, H + k, mode - 1]) * abs(s.slip_row[mode - 1])
        ax.semilogy(response.hz, slip, color=color, lw=1.8 if (mode, k) == (2, 3) else 1.0)
        band = modes.sliding_hz[mode - 1] / k, modes.stuck_hz[mode - 1] / k
        height = 9.0 * 1.9**row
        ax.plot(band, [height] * 2, color=color, lw=4, solid_capstyle="butt")
        ax.text(band[0] - 0.06, height, f"{k}:{mode}", ha="right", va="center", fontsize=SMALL, color=INK)
    ax.set(xlim=RANGE, ylim=(0.02, 50.0))
    dressed(ax, "Excitation frequency [Hz]", "Slip by harmonic k\nof mode i, k:i [µm]")


def _jump(ax: Any, response: ResponseCurve) -> None:
    """The region where the response jumps, with stepped marches up and down."""
    _draw(ax, response, np.ones(len(response.points), dtype=bool), color=DARK, lw=1.4)
    near = [p for p in response.points if abs(p.hz - 48.66) < 0.03]
    for start, steps, marker in (
        (min(near, key=lambda p: p["drive"].peak), (48.66, 48.67, 48.674, 48.69, 48.70), ">"),
        (max(near, key=lambda p: p["drive"].peak), (48.67, 48.66, 48.651, 48.63, 48.62), "<"),
    ):
        marched = _stepped(response.rig, start, steps)
        ax.plot(steps, marched, marker, ms=5, mfc="white", mec=INK, mew=0.8)
        print(f"marched {marker}:", ", ".join(f"{y:.4f} mm at {hz:g}" for hz, y in zip(steps, marched, strict=True)))
    for hz in response.folds:
        if 48.6 < hz < 48.75:
            ax.axvline(hz, color=FAINT, lw=0.8, zorder=0)
    ax.set(xlim=(48.60, 48.72), ylim=(0.05, 0.27))
    dressed(ax, "Excitation frequency [Hz]", "Drive displacement,\npeak [mm]")


def _stepped(rig: Rig, start: PeriodicSolution, steps: Sequence[float], periods: int = 900) -> list[float]:
    state, found = state_at_phase_zero(start), []
    for hz in steps:
        history = simulate(
            rig, hz, duration=periods / hz, steps_per_period=STEPS // 2, start=replace(state, time=0.0), last_periods=1
        )
        state = history.state
        found.append(1e3 * float(np.abs(history.channels["drive"].values).max()))
    return found


def _plane(ax: Any, paths: Sequence[FoldPath], isola: ResponseCurve) -> None:
    for path in paths:
        ax.plot(path.hz, path.values, color=DARK, lw=1.2)
    ax.axhline(LEVEL, color=FAINT, lw=0.8, zorder=0)
    ax.plot([isola.hz.min(), isola.hz.max()], [LEVEL] * 2, color=ORANGE, lw=2.0)
    names = {Kind.CUSP: ("^", "cusp"), Kind.ISOLA_CENTRE: ("o", "isola is born"), Kind.CROSSING: ("X", "crossing")}
    for kind, (marker, label) in names.items():
        places = [path.place(p) for path in paths for p in path.special if p.kind is kind]
        if places:
            ax.plot(*zip(*places, strict=True), marker, color=ORANGE, ms=5, label=label)
    ax.set(xlim=(47.3, 50.3), ylim=(2.5, 12.0))
    ax.legend(frameon=False, fontsize=SMALL, labelcolor=INK, loc="upper right")
    ax.text(50.25, LEVEL + 0.1, "6.5 N", ha="right", va="bottom", fontsize=SMALL, color=INK)
    dressed(ax, "Fold [Hz]", "Force [N]")


def _say(response: ResponseCurve, still: ResponseCurve, paths: Sequence[FoldPath], isola: ResponseCurve) -> None:
    print(response, [round(hz, 4) for hz in response.folds])
    for curve in (response, isola):
        print(*curve.bifurcations, sep="\n")
        print(np.sum(~curve.stable), "of", len(curve.points), "points unstable,", np.sum(curve.doubtful), "in doubt")
    print("mode 2 damped:", still)
    for path in paths:
        for point in path.special:
            hz, force = path.place(point)
            print(f"{point.kind.value}: {hz:.3f} Hz, {force:.3f} N")
    held = [p for p in isola.points if not p.lift_off]
    heights = [1e3 * p["drive"].peak for p in held]
    print(f"isola {isola.hz.min():.3f} to {isola.hz.max():.3f} Hz")
    print(f"with the tip on its support {min(heights):.3f} to {max(heights):.3f} mm")


if __name__ == "__main__":
    main().savefig(sys.argv[1] if len(sys.argv) > 1 else "beam_folds.png", dpi=200)
