"""Stability and bifurcations of two oscillators: a Neimark-Sacker bifurcation, and a cascade of period doublings.

Above, a linear oscillator with a small mass on a cubic spring, a nonlinear energy sink (Gendelman & Starosvetsky 2007):
a pair of multipliers leaves the unit circle, and beyond the amplitude is modulated. Below, the oscillator
x'' + 0.2 x' + x + x^3 = 30 cos Omega t (Parlitz & Lauterborn 1985): its symmetry breaks at a branch point, on the curve
that leaves there the period doubles, and on that of twice the period it doubles again.

    python examples/bifurcations.py figure.png
"""

import sys
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from hbm.continuation import Branch, ConvergenceError, Kind
from hbm.models import Channel, Contact, Damping, Excitation, ModalBody, Rig
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hbm import ResponseCurve, trace_frequency, with_stability
from hbm.response.branching import crossing, doubled

HZ = 1 / (2 * np.pi)
"""One radian per second."""

COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
MARKS = {Kind.FOLD: "o", Kind.BRANCH_POINT: "D", Kind.NEIMARK_SACKER: "s", Kind.PERIOD_DOUBLING: "^"}


@dataclass(frozen=True, eq=False)
class Cubic:
    """A cubic spring and a dashpot in the place of friction: T = -cubic u^3 - damping v."""

    name: ClassVar[str] = "cubic"
    states: ClassVar[int] = 0
    set_valued: ClassVar[bool] = False

    cubic: Any
    damping: Any = 0.0

    def advance(self, z: Any, before: Any, now: Any) -> tuple[Any, Any]:
        """No state, and the force."""
        return z, -self.cubic * now.u**3 - self.damping * now.v


def energy_sink(mass: float = 0.05, push: float = 0.3) -> Rig:
    """Main mass 1 on a spring 1, driven; the small one is free but for its cubic spring and dashpot."""
    return Rig(
        name="nonlinear energy sink",
        body=ModalBody((HZ, 1e-3 * HZ), ((1.0, 0.0),), (1.0, -1 / np.sqrt(mass)), (1.0, 0.0)),
        damping=Damping(mass_proportional=0.0),
        contact=Contact(1.0, Cubic(4 / 3 * mass, 0.2 * mass)),
        excitation=Excitation(push * mass),
        channels=(Channel("x", "displacement"),),
    )


def duffing(push: float = 30.0) -> Rig:
    """One mass, x'' + 0.2 x' + x + x^3 = push cos Omega t."""
    return Rig(
        name="Duffing",
        body=ModalBody((HZ,), ((1.0,),), (1.0,), (1.0,)),
        damping=Damping(mass_proportional=0.2),
        contact=Contact(1.0, Cubic(1.0)),
        excitation=Excitation(push),
        channels=(Channel("x", "displacement"),),
    )


def cascade() -> dict[str, ResponseCurve]:
    """The symmetric motion, those that branch off, and those of twice the period."""
    symmetric = with_stability(trace_frequency(duffing(), (2.6 * HZ, 1.2 * HZ)))
    end = symmetric.problem.lam_at(1.2 * HZ)
    found = {"symmetric": replace(symmetric, branch=_within(symmetric, end))}
    at = next(b for b in symmetric.bifurcations if b.kind is Kind.BRANCH_POINT)
    curve = found["not symmetric"] = with_stability(crossing(found["symmetric"], at)[0])
    for name in ("twice the period", "four times"):
        at = next(b for b in curve.bifurcations if b.kind is Kind.PERIOD_DOUBLING)
        try:
            curve = found[name] = with_stability(doubled(curve, at))
        except ConvergenceError:
            break
    return found


def _within(curve: ResponseCurve, end: float) -> Branch:
    """Its branch, with settings that do not let others go beyond its own end."""
    return replace(curve.branch, settings=replace(curve.branch.settings, lam_min=end, lam_end=end))


def draw(ax: Axes, curves: dict[str, ResponseCurve]) -> None:
    """Largest displacement over the frequency: solid where stable, and the bifurcations by their kinds."""
    for order, (name, curve) in enumerate(curves.items()):
        drawn = curve.dense
        y, color, zorder = drawn["x"].peak, COLORS[order], 5 - order
        unstable = ~drawn.stable
        ax.plot(drawn.hz / HZ, y, color=color, linewidth=0.9, linestyle=(0, (3, 1.5)), zorder=zorder)
        ax.plot(drawn.hz / HZ, np.where(unstable, np.nan, y), color=color, linewidth=1.6, label=name, zorder=zorder)
        for kind, marker in MARKS.items():
            at = [(b.hz / HZ, b.solution["x"].peak) for b in curve.bifurcations if b.kind is kind]
            if at:
                x, height = np.transpose(at)
                ax.plot(x, height, marker, color=color, markerfacecolor="white", markersize=4.5, zorder=zorder + 5)
    for kind, marker in MARKS.items():
        if any(b.kind is kind for curve in curves.values() for b in curve.bifurcations):
            ax.plot([], [], marker, color="0.3", markerfacecolor="white", markersize=4.5, label=kind.value)
    ax.set(xlabel="Excitation frequency [rad/s]", ylabel="Largest displacement")
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(frameon=False, fontsize=8)


def main(path: str) -> None:
    """Draw both."""
    figure = Figure(figsize=(6.3, 7.0), layout="constrained")
    above, below = figure.subplots(2, 1)
    sink = with_stability(trace_frequency(energy_sink(), (0.95 * HZ, 1.06 * HZ), harmonics=7))
    draw(above, {"nonlinear energy sink": sink})
    curves = cascade()
    draw(below, curves)
    figure.savefig(path, dpi=150)
    for name, curve in {"energy sink": sink, **curves}.items():
        print(f"{name}: {int(curve.stable.sum())} of {len(curve.points)} points stable")
        for b in curve.bifurcations:
            print(f"  {b.kind.value} at {b.hz / HZ:.5f} rad/s, multiplier {b.multiplier:.4f}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "bifurcations.png")
