"""Joints on a body beside pyHarm, beside time integration, and what a joint costs.

    python -m benchmarks.joints              # joints on a beam, friction in a plane, the cost of a joint
    python -m benchmarks.joints lap 2 4 8    # plates in a lap joint with so many contacts: examples/lap_joint.py

Both codes trace the same modes without residual flexibility, with the same harmonics and samples, warm. Then both solve
at the same frequencies about the peak: what is compared there is every harmonic of the drive displacement, and its
peak. Times are CPU times.
"""

import runpy
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from benchmarks.cases import Case, PyHarm, Traced, cpu_seconds, largest, top
from benchmarks.peers import ours, pyharm
from benchmarks.workers import process
from hbm import PeriodicSolution, joint_steady_state, steady_state
from hbm.balance.jointed import JointBalance
from hbm.fourier import FourierBasis
from hbm.integration.jointed import state_at_phase_zero
from hbm.parallel import one_thread
from models import Beam, Jenkins
from models.bodies import FiniteBeam, ModalModel
from models.jointed import JointedRig
from models.joints import Friction, Joint, PlaneFriction
from models.parts import Damping, Excitation

H, N_T, MODES, RUNS, BUDGET = 9, 256, 12, 3, 20.0
"""Harmonics, samples, modes; runs of a curve, fewer where they take longer than this [s]."""
FINE = 4
"""Times as many harmonics and samples beside time integration, which has no end of harmonics."""
LAP_JOINT = Path(__file__).parents[1] / "examples" / "lap_joint.py"
LAP_MODES, LAP_H = 14, 7
LAP_HZ = {2: (153.0, 156.0), 4: (153.5, 156.5), 8: (156.5, 159.5)}
"""Modes kept beside the static shapes of the contacts; harmonics; sweep by the number of contacts [Hz]."""
DRIVE = "y(0.505)"
MU, STIFFNESS, LOAD = 0.4, 8e3, 10.0
"""Of all Jenkins joints together: friction, stiffness [N/m], normal load [N]."""


def told(rig: JointedRig, hz: tuple[float, float], elements: list[Any], turn: Any = None, harmonics: int = H) -> Case:
    """A case with what pyHarm is told; its unit of length is set to the peak, once that is known."""
    steps = {"first": 0.05, "longest": 0.1}
    return Case(
        rig, hz, harmonics, N_T, PyHarm(tuple(elements), 1.0, float(rig.structure.omega_n[0]), **steps, turn=turn)
    )


PRESSED_BY_MINUS_Z = np.array([[0.0, 0, -1], [1, 0, 0], [0, 1, 0]])
"""Directions of Penalty3D from ours: it has the normal first, and counts it out of the contact."""


def jenkins(law: Any) -> dict[str, Any]:
    """Its element of a Jenkins joint under a constant load."""
    limit = law.law.mu * law.normal_load
    return {"type": "Jenkins", "dirs": [0], "mu": law.law.mu, "N0": law.normal_load, "k": limit / law.law.critical_slip}


def penalty(law: PlaneFriction) -> dict[str, Any]:
    """Its element of elastic dry friction in a plane."""
    normal = {"N0": law.normal_load, "g": 0.0, "k_n": law.normal_stiffness}
    return {"type": "Penalty3D", "dirs": [0, 1, 2], "mu": law.mu, "k_t": law.tangential_stiffness, **normal}


def chain(joints: int, modes: int = MODES) -> Case:
    """Jenkins joints along a cantilever: what they bear and their stiffness shared out."""
    places = [f"y({x:.4f})" for x in (np.linspace(0.16, 0.6, joints) if joints > 1 else [0.6])]
    damping, beam = Damping(modal_ratios=(0.01,)), Beam(0.606, 0.03888, 0.00478, 210e9, 7800.0, 2 * modes)
    found = FiniteBeam(beam, "clamped", "free").ported([*dict.fromkeys([*places, DRIVE])], damping)
    bending = np.flatnonzero(np.abs(found.rows).max(axis=0) > 1e-9)[:modes]  # no port sees the others, along the beam
    ports = {p: tuple(row) for p, row in zip(found.places, found.rows[:, bending].tolist(), strict=True)}
    body = ModalModel(tuple((found.omega_n[bending] / (2 * np.pi)).tolist()), ports)
    load, k = LOAD / joints, STIFFNESS / joints
    law = Friction(Jenkins(MU, MU * load / k), load)
    joined = tuple(Joint(f"j{i + 1}", law, (place,)) for i, place in enumerate(places))
    rig = JointedRig(f"{joints} Jenkins", body, damping, joined, Excitation(3.0, at=DRIVE))
    s = rig.structure
    stuck = np.sqrt(np.linalg.eigvalsh(k * s.joints.T @ s.joints + np.diag(s.omega_n**2))[0])
    hz = (0.8 * float(s.omega_n[0]) / (2 * np.pi), 1.2 * float(stuck) / (2 * np.pi))
    return told(rig, hz, [jenkins(law)])


def pressed(force: float, mu: float, name: str) -> Case:
    """Elastic dry friction in a plane, pressed by its own normal motion, on six modes.

    Without friction the peer is given its unilateral gap, closed by a constant force.
    """
    rows = np.random.default_rng(3).normal(size=(4, 6)).round(2).tolist()
    body = ModalModel((40.0, 55.0, 90.0, 130.0, 210.0, 300.0), dict(zip("xyzd", map(tuple, rows), strict=True)))
    k_t, load, k_n = 4e4, 10.0, 4e4
    joint = Joint("plane", PlaneFriction(mu, k_t, load, k_n), ("x", "y", "z"))
    rig = JointedRig(name, body, Damping(modal_ratios=(0.01,)), (joint,), Excitation(force, at="d"))
    gap = {"type": "PenaltyUnilateralGap", "dirs": [0], "g": -load / k_n, "k": k_n}
    closed = {"type": "GOForcing", "dirs": [0], "dto": 0, "ho": 0, "amp": load}
    if mu:
        return told(rig, (36.0, 64.0), [penalty(joint.law)], PRESSED_BY_MINUS_Z)
    return told(rig, (36.0, 64.0), [gap, closed], np.abs(PRESSED_BY_MINUS_Z))


def lap(contacts: int, plane: bool) -> Case:
    """Plates in a lap joint, reduced so that no residual flexibility is left, around the first bending mode."""
    rig: JointedRig = runpy.run_path(str(LAP_JOINT))["lap_joint"](contacts, plane, 0.5)
    rig = replace(rig, body=replace(rig.body, reduction="craig-bampton", modes=LAP_MODES))
    law: Any = rig.joints[0].law
    if plane:
        turn, element = PRESSED_BY_MINUS_Z, penalty(law)
    else:
        turn, element = None, jenkins(law)
    return told(rig, LAP_HZ[contacts], [element], turn, LAP_H)


def timed(module: Any, case: Case) -> tuple[Any, Traced, float, float]:
    """Last run of a case, its curve, median CPU seconds (warm), and those of a residual with its derivative."""
    spent: list[float] = []
    while len(spent) < 1 + RUNS and sum(spent) < BUDGET:
        run = module.prepared(case)
        used = time.process_time()
        curve, newton = run()
        spent.append(time.process_time() - used)
    return run, curve, median(spent[1:] or spent), cpu_seconds(newton, 10)


def by_peer(case: Case, at: np.ndarray) -> tuple[tuple[Traced, float, float], tuple[np.ndarray, float]]:
    """What pyHarm takes, and its solutions at frequencies with what they leave."""
    run, *taken = timed(pyharm, case)
    return tuple(taken), run.solutions(at)


@one_thread
def compare(case: Case, peer: ProcessPoolExecutor | None) -> None:
    """Lines of a case."""
    rig = case.rig
    _, *mine = timed(ours, case)
    curve = ours.curve_of(case)
    peak = curve.peak
    at = peak.hz * np.array([0.998, 0.999, 1.0, 1.001, 1.002])
    points = [steady_state(rig, hz, harmonics=case.H, samples=N_T, start=peak) for hz in at.tolist()]
    same, reach = np.array([p["drive"].coefficients for p in points]), float(peak["drive"].amplitude[1])
    print(f"{rig.name}: peak at {peak.hz:.3f} Hz, {said(rig, peak)}; energy {peak.energy_error:.0e}")
    print(f"  ours   {row(*mine, top(at, largest(same))[1])}{'' if curve.complete else ' PARTIAL'}", flush=True)
    if peer is not None:
        case = replace(case, pyharm=replace(case.pyharm, length=reach))
        try:
            theirs, (there, left) = peer.submit(by_peer, case, at).result()
        except Exception as failed:  # whatever a peer raises
            print(f"  pyHarm failed: {failed}", flush=True)
        else:
            end = f"{theirs[0].rejected} rejected, to {theirs[0].hz[-1]:.1f} of {case.hz[1]:.1f} Hz"
            print(f"  pyHarm {row(*theirs, top(at, largest(there))[1])}; {end}")
            print(f"         harmonics apart {np.abs(there - same).max() / reach:.1e}, left {left:.0e}", flush=True)
    fine = steady_state(rig, peak.hz, harmonics=FINE * case.H, samples=FINE * N_T, start=peak)
    start = state_at_phase_zero(JointBalance(rig, fine.basis), fine.state)
    period = joint_steady_state(rig, peak.hz, steps_per_period=FINE * N_T, start=start)
    marched = period.history.coefficients("drive", 1)[1:]
    away = [
        np.hypot(*(p["drive"].coefficients[[1, h + 1]] - marched)) / np.hypot(*marched)
        for p, h in ((peak, case.H), (fine, FINE * case.H))
    ]
    print(f"  marched: apart {away[0]:.1e} with {case.H} harmonics, {away[1]:.1e} with {FINE * case.H}; ", end="")
    print(f"energy {fine.energy_error:.0e}, closure {period.closure:.0e}", flush=True)


def said(rig: JointedRig, peak: PeriodicSolution) -> str:
    """How many joints slip, or how far the normal loads go."""
    joints = rig.joints
    if joints[0].law.ports == 1:
        limits = [float(j.law.law.mu * j.law.normal_load) for j in joints]
        return (
            f"{sum(peak[f'{j.name}.force'].peak > 0.999 * limit for j, limit in zip(joints, limits, strict=True))} slip"
        )
    normal = np.array([j.law.normal_load - peak[f"{j.name}.force.3"].samples for j in joints])
    return f"normal load {normal.min():.2f} to {normal.max():.2f} N"


def row(curve: Traced, cpu: float, newton: float, peak: float) -> str:
    """What both codes are asked."""
    points = len(curve.hz)
    each = f"{1e3 * cpu / points:.2f} ms a point, R+J {1e3 * newton:.2f} ms"
    return f"{cpu:7.3f} s, {points} points, {each}, peak {1e3 * peak:.6f} mm"


@one_thread
def iteration(joints: int) -> tuple[float, float]:
    """CPU milliseconds of residual, derivative and solve at a solution, warm; and of the residual alone."""
    rig = chain(joints).rig
    problem = JointBalance(rig, FourierBasis(H, N_T))
    hz = 1.2 * float(rig.structure.omega_n[0]) / (2 * np.pi)
    x, lam = problem.pack(steady_state(rig, hz, harmonics=H, samples=N_T).state)
    weights = np.random.default_rng(0).normal(size=problem.size)

    def newton() -> None:
        here = problem.linearize(x, lam)
        here.solve_bordered(weights, 1.0, here.residual, 0.0)

    return 1e3 * cpu_seconds(newton), 1e3 * cpu_seconds(lambda: problem.residual(x, lam))


def main() -> None:
    """Print the lap joint, or both tables."""
    with process() as worker:
        peer = worker if find_spec("pyHarm") else print("pyHarm is not installed; pip install '.[peers]'")
        if sys.argv[1:2] == ["lap"]:
            for contacts in map(int, sys.argv[2:]):
                for plane in (False, True):
                    compare(lap(contacts, plane), peer)
            return
        for joints in (2, 4, 8):
            compare(chain(joints), peer)
        compare(pressed(8.0, 0.3, "plane friction, always pressed"), peer)
        compare(pressed(16.0, 0.0, "no friction, separating"), peer)
        compare(pressed(16.0, 0.3, "plane friction, separating"), None)  # Penalty3D drops its preload once it is open
    print("\njoints, CPU ms an iteration (residual, derivative, bordered solve), CPU ms of the residual alone")
    for joints in (1, 2, 4, 8, 16):
        print("{:3d} {:8.2f} {:8.2f}".format(joints, *iteration(joints)), flush=True)


if __name__ == "__main__":
    main()
