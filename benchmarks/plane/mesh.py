"""Figures 5 and 6 of the paper: a cantilever by elements of Table 2, beside beam theory."""

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from models import Damping
from models.plane import ELEMENTS, PlaneBeam
from models.published import PAPER_BEAM

COLUMNS = (15, 30, 60, 120, 240)
ROWS = 2
INERTIA = PAPER_BEAM.width * PAPER_BEAM.thickness**3 / 12
MARKERS = dict(zip(ELEMENTS, "osD^vxP", strict=True))


@dataclass(frozen=True)
class Measured:
    """A cantilever's answers over those of Euler-Bernoulli theory.

    Attributes
    ----------
    unknowns : int
    deflection, rotation : float
        Of the end under a load there.
    hz : (3,) array
        Natural frequencies.
    """

    unknowns: int
    deflection: float
    rotation: float
    hz: np.ndarray


def measured(element: str, columns: int, rows: int = ROWS) -> Measured:
    """Answers of one mesh."""
    b = PAPER_BEAM
    model = PlaneBeam(
        b.length, b.thickness, b.width, b.youngs_modulus, b.density, element=element, columns=columns, rows=rows
    ).model(modes=3)
    top, bottom = (model.at(b.length, y * b.thickness / 2) for y in (1, -1))
    places = [f"{model.at(b.length)}.y", f"{top}.x", f"{bottom}.x"]
    body = model.body.ported(places, Damping())
    still = body.receptance(0.0).real[:, 0]
    theory = b.length**3 / (3 * b.youngs_modulus * INERTIA)
    slope = (still[2] - still[1]) / b.thickness / (b.length**2 / (2 * b.youngs_modulus * INERTIA))
    roots = np.array([1.8751040687, 4.6940911330, 7.8547574382])
    mass = b.density * b.width * b.thickness
    hz = roots**2 / (2 * np.pi * b.length**2) * np.sqrt(b.youngs_modulus * INERTIA / mass)
    return Measured(len(model.matrices.along), still[0] / theory, slope, body.omega_n[:3] / (2 * np.pi) / hz)


def study() -> dict[str, list[Measured]]:
    """Every element over the number of columns."""
    return {name: [measured(name, columns) for columns in COLUMNS] for name in ELEMENTS}


def draw(found: dict[str, list[Measured]]) -> Figure:
    """Deflection and first frequency over the number of elements along the beam."""
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, cases in found.items():
        left.semilogx(COLUMNS, [c.deflection for c in cases], marker=MARKERS[name], ms=4, lw=1, label=name)
        right.loglog(COLUMNS, [abs(c.hz[0] - 1) for c in cases], marker=MARKERS[name], ms=4, lw=1, label=name)
    left.axhline(1.0, color="0.6", lw=0.8, zorder=0)
    left.set(ylabel="end deflection / beam theory", xlabel="elements along the beam")
    right.set(ylabel="|first frequency / beam theory - 1|", xlabel="elements along the beam")
    for ax in (left, right):
        ax.set_xticks(COLUMNS, [str(c) for c in COLUMNS])
        ax.minorticks_off()
        ax.grid(alpha=0.25, lw=0.5)
    right.legend(fontsize=8, ncols=2, frameon=False)
    return figure
