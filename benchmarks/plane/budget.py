"""Where the first resonance lies, term by term: from the beam of Table 1 to what Abaqus says in Table 4."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from hbm.integration.integrate import simulate
from hbm.response.trace import trace_frequency
from models import Coulomb, FrictionLaw
from models.jointed import AnyRig
from models.published import PAPER_FIGURE_9C, PAPER_PENALTY, paper_rig

from .rigs import CONTACT_STIFFNESS, Variant, plane_rig

LAWS: dict[str, FrictionLaw] = {"Lagrange": Coulomb(0.49), "penalty": PAPER_PENALTY, "decay": PAPER_FIGURE_9C}
ABAQUS = {"Lagrange": 52.8, "penalty": 53.0, "decay": 51.6}  # Hz, Table 4
SWEEP = (42.0, 62.0)
HARMONICS = 15
DURATION = 1.2  # s, section 5
RESOLUTION = 0.25  # Hz, of the runs from rest
RUNS = np.arange(45.0, 58.0 + RESOLUTION / 2, RESOLUTION)
RUN_MODES = 8  # of runs in time: the ninth would ask for steps of a microsecond
RUN_STEP = 4e-5  # s
BASE = Variant()
STRAIN, FLUSH = BASE.but(state="plane-strain"), BASE.but(flush=True)
BOTH = STRAIN.but(flush=True)
VARIANTS = {
    "plane stress, contact at 606 mm": BASE,
    "plane strain, contact at 606 mm": STRAIN,
    "plane stress, contact at 601 mm": FLUSH,
    "plane strain, contact at 601 mm": BOTH,
}


@dataclass(frozen=True)
class Term:
    """One row of the budget: what changes, against what, and where the peak of the steady state then is."""

    change: str
    hz: float
    before: float

    @property
    def shift(self) -> float:
        """[Hz]"""
        return self.hz - self.before


def steady_peak(rig: AnyRig) -> tuple[float, float, int]:
    """Frequency [Hz] and height [m] of the largest drive displacement, and how many points the curve has."""
    curve = trace_frequency(rig, SWEEP, harmonics=HARMONICS)
    return curve.peak.hz, float(curve["drive"].peak.max()), len(curve.points)


def peak_from_rest(rig: AnyRig) -> float:
    """Frequency of the largest drive displacement within 1.2 s from rest [Hz]."""
    bare = replace(rig, channels=())
    heights = [
        np.abs(
            simulate(bare, float(hz), duration=DURATION, steps_per_period=round(1 / hz / RUN_STEP))
            .channels["drive"]
            .values
        ).max()
        for hz in RUNS
    ]
    return float(RUNS[int(np.argmax(heights))])


def terms() -> Iterable[Term]:
    """Steady peaks under the penalty law, one change at a time."""
    one = paper_rig(PAPER_PENALTY)
    start = steady_peak(one)[0]
    yield Term("beam theory, Table 1", start, start)

    def changed(words: str, variant: Variant, before: float) -> Term:
        return Term(words, steady_peak(plane_rig(variant))[0], before)

    plane = changed("plane stress, half cylinder with its mass, one node of contact at 606 mm", BASE, start)
    yield plane
    nine = changed("nine nodes of contact: it rolls", BASE.but(nodes=9), plane.hz)
    yield nine
    for stiffness in (0.1 * CONTACT_STIFFNESS, 10 * CONTACT_STIFFNESS):
        words = f"normal stiffness of the contact {stiffness:.0e} N/m"
        yield changed(words, BASE.but(nodes=9, stiffness=stiffness), nine.hz)
    yield changed("coarse mesh of CPS4I, 30 by 2", BASE.but(nodes=9, columns=30, rows=2), nine.hz)
    yield changed("CPS8R", BASE.but(nodes=9, element="CPS8R"), nine.hz)
    strain = changed("plane strain", STRAIN.but(nodes=9), nine.hz)
    yield strain
    yield changed("contact at 601 mm: the half cylinder ends with the beam", FLUSH.but(nodes=9), nine.hz)
    yield changed("both", BOTH.but(nodes=9), nine.hz)


def damping_of_steps(alpha: float, hz: float, dt: float) -> tuple[float, float]:
    """What Hilber-Hughes-Taylor's method makes of an undamped oscillator: its frequency [Hz], its damping ratio."""
    beta, gamma, w2 = (1 - alpha) ** 2 / 4, 0.5 - alpha, (2 * np.pi * hz) ** 2
    # unknowns (d, v, a) after a step times `new`, before it times `old`
    new = np.array([[1, 0, -beta * dt**2], [0, 1, -gamma * dt], [(1 + alpha) * w2, 0, 1]])
    old = np.array([[1, dt, dt**2 * (0.5 - beta)], [0, 1, dt * (1 - gamma)], [alpha * w2, 0, 0]])
    roots = np.log(np.linalg.eigvals(np.linalg.solve(new, old)).astype(complex)) / dt
    s = roots[np.abs(np.abs(roots.imag) - 2 * np.pi * hz).argmin()]
    return abs(s.imag) / (2 * np.pi), -s.real / abs(s)
