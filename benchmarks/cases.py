"""What is compared: equations that every tool solves, and what each hands back about its curve."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from hbm.fourier import FourierBasis
from hbm.rigfiles.load import load_rig
from models import Channel, Contact, Damping, Excitation, Jenkins, ModalBody, Rig
from models.bodies import ModalModel
from models.jointed import AnyRig, JointedRig
from models.joints import CubicSpring, Joint
from models.published import paper_rig

PAPER_RIG = Path(__file__).parents[1] / "examples" / "paper_beam.toml"
HZ = 1.0 / (2.0 * np.pi)  # one radian per second


@dataclass(frozen=True)
class PyHarm:
    """What pyHarm is told of a case beside the modes.

    Attributes
    ----------
    elements : tuple of dict
        Its elements at each joint, whose ports are the dofs of one node.
    length, omega : float
        Its units [m, rad/s].
    first, longest : float
        Steps, in these units.
    scale : float
        Its dofs in units of our ports: all dofs should be of one magnitude.
    turn : (ports, ports) array or None
        Its directions from ours, at each joint.
    """

    elements: tuple[dict[str, Any], ...]
    length: float
    omega: float
    first: float
    longest: float
    scale: float = 1.0
    turn: Any = None


@dataclass(frozen=True)
class Case:
    """Equations that every tool solves.

    Attributes
    ----------
    rig : Rig or JointedRig
    hz : (float, float)
        Sweep [Hz].
    H, N_t : int
        Harmonics, and samples per period.
    pyharm : PyHarm or None
        None where pyHarm cannot solve them.
    march : callable or None
        Force from the displacement, both (N,), of an oscillator of unit mass and stiffness, from any start: what
        harmonicbalance takes. None for other rigs.
    """

    rig: AnyRig
    hz: tuple[float, float]
    H: int
    N_t: int
    pyharm: PyHarm | None = None
    march: Callable[[np.ndarray], np.ndarray] | None = None


@dataclass(frozen=True)
class Traced:
    """A curve as a tool hands it back.

    Attributes
    ----------
    tool : str
        Name and version.
    hz : (points,) array
        Frequencies of the accepted points.
    drive : (points, 2H+1) array
        Coefficients a_0, a_1..a_H, b_1..b_H of the displacement at the excitation [m].
    samples : int
        Per period.
    rejected : int
        Points computed and thrown away, or found wrong.
    drawn : Traced or None
        The curve as the tool draws it between these points; None by straight lines.
    """

    tool: str
    hz: np.ndarray
    drive: np.ndarray
    samples: int
    rejected: int = 0
    drawn: "Traced | None" = None

    @property
    def height(self) -> np.ndarray:
        """Largest displacement over the period [m], (points,)."""
        return largest(self.drive)


def duffing() -> Case:
    """B1: y'' + 0.1 y' + y + y^3 = 0.5 cos(Omega t)."""
    rig = JointedRig(
        name="Duffing",
        body=ModalModel((HZ,), {"y": (1.0,)}),
        damping=Damping(mass_proportional=0.1),
        joints=(Joint("spring", CubicSpring(1.0), ("y",)),),
        excitation=Excitation(0.5, at="y"),
    )
    told = PyHarm(({"type": "CubicSpring", "dirs": [0], "k": 1.0},), 1.0, 1.0, first=0.09, longest=0.09)
    return Case(rig, (0.4 * HZ, 2.5 * HZ), 7, 128, told, march=lambda u: -(u**3))


def oscillator() -> Case:
    """B2: y'' + 0.02 y' + y = 0.4 cos(Omega t) + T, T a Jenkins element of stiffness 1 that slips at 0.5."""
    limit, stiffness = 0.5, 1.0
    rig = Rig(
        name="Jenkins oscillator",
        body=ModalBody((HZ,), ((1.0,),), (1.0,), (1.0,)),
        damping=Damping(mass_proportional=0.02),
        contact=Contact(normal_load=1.0, law=Jenkins(mu=limit, critical_slip=limit / stiffness)),
        excitation=Excitation(0.4),
        channels=(Channel("y", "displacement"),),
    )

    def march(u: np.ndarray) -> np.ndarray:
        spring, before, force = 0.0, 0.0, []
        for now in [*u.tolist(), *u.tolist()]:  # the second period is periodic
            spring = min(max(spring - stiffness * (now - before), -limit), limit)
            before = now
            force.append(spring)
        return np.array(force[len(u) :])

    slider = {"type": "Jenkins", "dirs": [0], "mu": limit, "N0": 1.0, "k": stiffness}
    told = PyHarm((slider,), 1.0, 1.0, first=0.07, longest=0.07)
    return Case(rig, (0.5 * HZ, 1.6 * HZ), 15, 256, told, march)


def damped(rig: Rig) -> Rig:
    """Return the rig with ten times the paper's damping, alpha 0.6 1/s: wider peaks, all codes get over them."""
    return replace(rig, damping=Damping(mass_proportional=0.6))


def beam() -> Case:
    """B3: beam with five modes; constant normal load, no foreshortening, no residual compliance, as all codes can.

    Steps and corrector of pyHarm were searched by hand, some 25 combinations of `ds0`, `ds_max`, `lc`, `max_iter` and
    both correctors. Of those that finish the sweep this is the fastest whose peak has four digits; where its points
    fall on the peak is partly luck (`ds0` 0.012: 3.2 digits). Many combinations stop at 47.678 Hz, where a second slip
    phase is born.
    """
    rig = damped(paper_rig())
    plain = replace(rig.contact, load_variation=0.0, residual_compliance=False, foreshortening=False)
    rig = replace(rig, contact=plain, channels=())
    s, law, load = rig.structure, plain.law, plain.normal_load
    scale = float(np.linalg.norm(s.excitation) / np.linalg.norm(s.slip_row))
    stiffness = law.mu * load / law.critical_slip
    slider = {"type": "Jenkins", "dirs": [0], "mu": law.mu, "N0": load / scale, "k": stiffness / scale**2}
    told = PyHarm((slider,), 2e-3, 2 * np.pi * 50.0, first=0.013, longest=0.02, scale=scale)
    return Case(rig, (40.0, 80.0), 9, 256, told)


def paper(modes: int = 5) -> Case:
    """The paper's rig as its example has it, with everything switched on; no peer can."""
    return Case(load_rig(PAPER_RIG).with_modes(modes), (40.0, 65.0), 19, 256)


CASES: dict[str, Callable[[], Case]] = {
    "B1": duffing,
    "B2": oscillator,
    "B3": beam,
    "paper": paper,
    "paper50": lambda: paper(50),
}


def cpu_seconds(call: Callable[[], Any], times: int = 60) -> float:
    """Median CPU seconds of a short call, warm."""
    call()
    spent = []
    for _ in range(times):
        used = time.process_time()
        call()
        spent.append(time.process_time() - used)
    return median(spent)


def top(hz: np.ndarray, height: np.ndarray) -> tuple[float, float]:
    """Top of the parabola through the largest height and its neighbours: frequency, height."""
    i = int(np.argmax(height))
    if not 0 < i < len(hz) - 1:
        return float(hz[i]), float(height[i])
    x, y = hz[i - 1 : i + 2] - hz[i], height[i - 1 : i + 2] / height[i]
    a, b, c = np.polyfit(x, y, 2)
    if not a < 0.0:
        return float(hz[i]), float(height[i])
    return float(hz[i] - b / (2 * a)), float((c - b**2 / (4 * a)) * height[i])


def largest(drive: np.ndarray) -> np.ndarray:
    """Largest displacement of each motion over its period, from (points, 2H+1) coefficients."""
    return np.abs(drive @ FourierBasis(drive.shape[1] // 2, 4096).synthesis.T).max(axis=1)
