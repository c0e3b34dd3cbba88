"""Bifurcations with the package `continuation` alone: folds, cusps and detached resonances of two oscillators.

A Duffing oscillator, and one with a nonlinear tuned vibration absorber (T. Detroux, G. Habib, L. Masset, G. Kerschen,
Mechanical Systems and Signal Processing 60-61, 2015; mass ratio 0.05, tuned by its rule of equal peaks), whose response
has a detached part that no sweep meets. Both by harmonic balance in a few lines of CasADi; all the rest is asked of
F(x, frequency, force) = 0.

    python examples/continuation_duffing.py figure.png
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
from hbm.continuation import (
    AtMu,
    Branch,
    DenseTwoParameterProblem,
    FoldCurve,
    Kind,
    Settings,
    continue_branch,
    fold_curve,
    isolas,
    refine,
)
from matplotlib.figure import Figure

SAMPLES = 32
BLUE, ORANGE, GREEN, GREY = "#0072b2", "#d55e00", "#009e73", "0.6"
MARKS = {Kind.CUSP: ("^", "cusp"), Kind.ISOLA_CENTRE: ("o", "isola centre"), Kind.CROSSING: ("X", "crossing")}


@dataclass(frozen=True)
class Oscillator:
    """Masses with linear dampers and springs, cubic springs, and a harmonic force on the first mass.

    Attributes
    ----------
    mass, damping, stiffness : (n, n) array
        Matrices.
    cubic : sequence of (coefficient, (n,) array)
        Springs with the force coefficient * (row . q)^3 along row.
    """

    mass: Any
    damping: Any
    stiffness: Any
    cubic: Sequence[tuple[float, Any]]


DUFFING = Oscillator(np.eye(1), np.array([[0.1]]), np.eye(1), [(1.0, np.ones(1))])
ABSORBED = Oscillator(
    np.diag([1.0, 0.05]),
    np.array([[0.002 + 0.0128, -0.0128], [-0.0128, 0.0128]]),
    np.array([[1.0 + 0.0454, -0.0454], [-0.0454, 0.0454]]),
    [(1.0, np.array([1.0, 0.0])), (0.0042, np.array([1.0, -1.0]))],
)


class HarmonicBalance:
    """Periodic motions with the harmonics 1 and 3; lam is the frequency, mu the force.

    Attributes
    ----------
    problem : DenseTwoParameterProblem
        Residual of the cosines and sines, mass by mass, with its Jacobian.
    size : int
        Number of unknowns.
    """

    def __init__(self, oscillator: Oscillator) -> None:
        k, n = np.array([1, 3]), len(oscillator.mass)
        phase = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
        waves = np.hstack([np.cos(np.outer(phase, k)), np.sin(np.outer(phase, k))])
        zero = np.zeros((2, 2))
        derivative = np.block([[zero, np.diag(k)], [-np.diag(k), zero]])
        self.size = N = 4 * n
        x, lam, mu, v = ca.SX.sym("x", N), ca.SX.sym("lam"), ca.SX.sym("mu"), ca.SX.sym("v", N)
        Q = ca.reshape(x, 4, n)
        balance = lam**2 * derivative @ derivative @ Q @ oscillator.mass.T
        balance += lam * derivative @ Q @ oscillator.damping.T + Q @ oscillator.stiffness.T
        for coefficient, row in oscillator.cubic:
            balance += 2.0 / SAMPLES * waves.T @ (coefficient * (ca.DM(waves) @ Q @ row) ** 3) @ row[None]
        balance[0, 0] -= mu
        y, residual = ca.vertcat(x, lam, mu), ca.vec(balance)
        jacobian = ca.jacobian(residual, y)
        self._residual = ca.Function("residual", [x, lam, mu], [residual])
        self._jacobian = ca.Function("jacobian", [x, lam, mu], ca.horzsplit(jacobian, [0, N, N + 1, N + 2]))
        self._second = ca.Function("second", [x, lam, mu, v], [ca.jacobian(jacobian[:, :N] @ v, y)])
        self.problem = DenseTwoParameterProblem(
            lambda *at: self._residual(*at).full()[:, 0],
            lambda *at: tuple(part.full().squeeze() for part in self._jacobian(*at)),
        )

    def second(self, x: Any, lam: float, mu: float, v: Any, directions: Any) -> Any:
        """Change of J_x v along directions of (x, lam, mu)."""
        return self._second(x, lam, mu, v).full() @ directions

    def response(self, force: float, settings: Settings) -> Branch:
        """Frequency response from rest far below the resonance."""
        return continue_branch(AtMu(self.problem, force), np.zeros(self.size), 0.5, settings).require_complete()

    def folds(self, response: Branch, force: float, settings: Settings) -> FoldCurve:
        """Folds in the plane of frequency and force, from the last one of a response down, over the cusp and up."""
        *_, fold = refine(AtMu(self.problem, force), response)
        return fold_curve(self.problem, fold, force, settings, second=self.second)


def amplitude(x: Any) -> Any:
    """Fundamental amplitude of the first mass, of the unknowns (..., N)."""
    return np.hypot(x[..., 0], x[..., 2])


def main() -> Figure:
    """Responses above the fold curves of both oscillators."""
    figure, axes = plt.subplots(2, 2, figsize=(7.2, 5.4), sharex="col", height_ratios=(1.25, 1), layout="constrained")
    duffing(*axes[:, 0])
    absorbed(*axes[:, 1])
    for letter, axis in zip("acbd", axes.T.flat, strict=True):
        axis.set_title(f"({letter})", loc="left", fontsize=9)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0, 0].set_ylabel("amplitude")
    axes[1, 0].set_ylabel("force")
    for axis in axes[1]:
        axis.set_xlabel("frequency")
    return figure


def duffing(above: Any, below: Any) -> None:
    """Responses that fold beyond the cusp."""
    system, settings = HarmonicBalance(DUFFING), Settings(lam_end=2.5, lam_min=0.4, max_angle=0.2)
    for force, shade in zip((0.3, 0.2, 0.1, 0.05), (1.0, 0.8, 0.6, 0.4), strict=True):
        branch = system.response(force, settings)
        above.plot(branch.lam, amplitude(branch.x), color=plt.cm.Blues(shade), lw=1.2, label=f"force {force:g}")
    down = Settings(lam_end=0.01, lam_max=0.4, max_angle=0.2)
    draw_folds(system.folds(system.response(0.4, settings), 0.4, down), above, below)
    above.set(xlim=(0.6, 2.0), ylim=(0.0, 2.0))
    above.legend(frameon=False, loc="upper left", fontsize=8)
    below.set(ylim=(0.0, 0.4))
    below.text(1.62, 0.36, "three solutions", fontsize=8, ha="center")
    below.legend(frameon=False, loc="upper left", fontsize=8)


def absorbed(above: Any, below: Any) -> None:
    """Response with a detached part, born at one force and joined to the main part at another."""
    system, settings = HarmonicBalance(ABSORBED), Settings(lam_end=3.5, lam_min=0.4, step=0.02, max_angle=0.2)
    force, larger = 0.15, 0.24
    joined = system.response(larger, settings)
    curve = system.folds(joined, larger, Settings(lam_end=0.05, lam_max=larger, step=0.02, max_angle=0.2))
    main_part = system.response(force, settings)
    (isola,) = isolas(curve, force, [main_part], settings)
    above.plot(joined.lam, amplitude(joined.x), color=GREY, lw=0.8, label=f"force {larger:g}")
    above.plot(main_part.lam, amplitude(main_part.x), color=BLUE, lw=1.2, label=f"force {force:g}")
    above.plot(isola.lam, amplitude(isola.x), color=GREEN, lw=1.2, label=f"force {force:g}, isola")
    draw_folds(curve, above, below)
    for fold in curve.at(force):
        above.plot(fold.lam, amplitude(fold.x), ".", color=ORANGE, ms=6)
        below.plot(fold.lam, force, ".", color=ORANGE, ms=6)
    born, met = (next(p.lam for p in curve.special if p.kind is kind) for kind in (Kind.ISOLA_CENTRE, Kind.CROSSING))
    below.axhspan(born, met, color=GREY, alpha=0.25, lw=0)
    below.text(2.0, 0.17, f"detached\n{born:.3f} to {met:.3f}", fontsize=8, ha="center", va="center")
    above.set(xlim=(0.6, 2.8), ylim=(0.0, 3.0))
    below.set(ylim=(0.05, larger))
    above.legend(frameon=False, loc="upper left", fontsize=8)
    below.legend(frameon=False, loc="lower right", fontsize=8)


def draw_folds(curve: FoldCurve, above: Any, below: Any) -> None:
    """Fold curve over the responses, and in the plane of the parameters with its special points."""
    above.plot(curve.lam, amplitude(curve.x), color=ORANGE, lw=0.8, ls="--", zorder=1, label="folds")
    below.plot(curve.lam, curve.mu, color=ORANGE, lw=1.2)
    for point in curve.special:
        mark, label = MARKS[point.kind]
        above.plot(point.x[-1], amplitude(point.x), mark, color="k", ms=5)
        below.plot(point.x[-1], point.lam, mark, color="k", ms=5, label=label)


if __name__ == "__main__":
    main().savefig(sys.argv[1] if len(sys.argv) > 1 else "continuation_duffing.png", dpi=200)
