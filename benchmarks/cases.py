"""What is compared: two sets of equations, and what every tool has to hand back about its curve."""

import json
import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from models import Channel, Contact, Damping, Excitation, Jenkins, ModalBody, Rig
from models.published import paper_rig

RUNS = 5
BUDGET = 40.0  # s; a slow tool is run less often


@dataclass(frozen=True)
class Case:
    """Equations that every tool solves: a rig, a sweep [Hz], harmonics and samples."""

    name: str
    rig: Rig
    hz: tuple[float, float]
    H: int
    N_t: int


def damped(rig: Rig) -> Rig:
    """Return the rig with ten times the paper's damping, alpha 0.6 1/s: wider peaks, all codes get over them."""
    return replace(rig, damping=Damping(mass_proportional=0.6))


def beam() -> Case:
    """Beam with five modes; normal load constant, no foreshortening, no residual compliance: what all codes can do."""
    rig = damped(paper_rig())
    plain = replace(rig.contact, load_variation=0.0, residual_compliance=False, foreshortening=False)
    return Case("beam", replace(rig, contact=plain, channels=()), (40.0, 80.0), 9, 256)


def oscillator() -> Case:
    """y'' + 0.02 y' + y = 0.4 cos(Omega t) + T, T a Jenkins element of stiffness 1 that slips at 0.35."""
    rig = Rig(
        name="oscillator",
        body=ModalBody((0.5 / np.pi,), ((1.0,),), (1.0,), (1.0,)),
        damping=Damping(mass_proportional=0.02),
        contact=Contact(normal_load=1.0, law=Jenkins(mu=0.35, critical_slip=0.35)),
        excitation=Excitation(0.4),
        channels=(Channel("y", "displacement"),),
    )
    # harmonicbalance samples 4 H + 1 times a period and offers no choice
    return Case("oscillator", rig, (0.25 / np.pi, 0.8 / np.pi), 15, 61)


CASES: dict[str, Callable[[], Case]] = {"beam": beam, "oscillator": oscillator}


@dataclass(frozen=True)
class Row:
    """One tool's curve and its price.

    Attributes
    ----------
    tool : str
        Name and version.
    wall, cpu : list of float
        Seconds of each timed run; the first run, with compilation and caches, is not among them.
    hz : list of float
        Frequencies of the accepted points.
    drive : list of list of float
        Coefficients a_0, a_1..a_H, b_1..b_H of the displacement at the excitation [m], point by point.
    rejected : int
        Points computed and thrown away, or found wrong.
    linearize : float
        Seconds of one residual with its Jacobian at the point of largest amplitude.
    load : float
        Load average of the machine at the end.
    """

    tool: str
    wall: list[float]
    cpu: list[float]
    hz: list[float]
    drive: list[list[float]]
    rejected: int
    linearize: float
    load: float

    def save(self, file: Path) -> None:
        """Write as JSON."""
        file.write_text(json.dumps(asdict(self)))

    @staticmethod
    def load_from(file: Path) -> "Row":
        """Read what :meth:`save` wrote."""
        return Row(**json.loads(file.read_text()))

    @property
    def first_harmonic(self) -> np.ndarray:
        """Amplitude of the first harmonic [m], (points,)."""
        a = np.array(self.drive)
        return np.hypot(a[:, 1], a[:, a.shape[1] // 2 + 1])


def timed(run: Callable[[Any], Any], prepare: Callable[[], Any] = lambda: None) -> tuple[Any, list[float], list[float]]:
    """Last result, wall seconds and CPU seconds of `run(prepare())`, `prepare` and a first run not counted."""
    run(prepare())
    wall: list[float] = []
    cpu: list[float] = []
    while len(wall) < RUNS and sum(wall) < BUDGET:
        prepared = prepare()
        t, c = time.perf_counter(), time.process_time()
        result = run(prepared)
        wall.append(time.perf_counter() - t)
        cpu.append(time.process_time() - c)
    return result, wall, cpu


def seconds(call: Callable[[], Any], times: int = 60) -> float:
    """Median seconds of a short call, warm."""
    call()
    spent = []
    for _ in range(times):
        t = time.perf_counter()
        call()
        spent.append(time.perf_counter() - t)
    return median(spent)


def load() -> float:
    """Load average over the last minute."""
    return os.getloadavg()[0]
