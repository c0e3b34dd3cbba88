"""Joints on a body beside pyHarm, beside time integration, and what a joint costs.

    python benchmarks/joints.py --peer /path/to/python/with/pyHarm

Both codes trace the same modes without residual flexibility, with the same harmonics and samples, warm. Then both solve
at the same frequencies about the peak: what is compared there is every harmonic of the drive displacement, and its
peak.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from hbm.balance.jointed import JointBalance
from hbm.fourier import FourierBasis
from hbm.integration.jointed import joint_steady_state, state_at_phase_zero
from hbm.parallel import one_thread
from hbm.response.trace import steady_state, trace_frequency
from models import Beam, Jenkins
from models.bodies import FiniteBeam, ModalModel
from models.jointed import JointedRig
from models.joints import Friction, Joint, PlaneFriction
from models.parts import Damping, Excitation

H, N_T, MODES, RUNS = 9, 256, 12, 3
FINE = 4
"""Times as many harmonics and samples beside time integration, which has no end of harmonics."""
PEER = Path(__file__).parent / "peers" / "pyharm_joints.py"
DRIVE = "y(0.505)"
MU, STIFFNESS, LOAD = 0.4, 8e3, 10.0
"""Of all Jenkins joints together: friction, stiffness [N/m], normal load [N]."""


@dataclass(frozen=True)
class Case:
    """A rig, a sweep [Hz], and what the peer makes of it: elements of each joint, step, dofs from our ports."""

    rig: JointedRig
    hz: tuple[float, float]
    elements: list[dict[str, Any]]
    turn: Any = 1.0
    each: int = 1
    step: float = 0.1


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
    return Case(rig, hz, [{"type": "Jenkins", "dirs": [0], "mu": MU, "N0": load, "k": k}])


def pressed(force: float, mu: float, name: str) -> Case:
    """Elastic dry friction in a plane, pressed by its own normal motion, on six modes.

    Ours counts the normal motion into the contact, Penalty3D out of it. Without friction the peer is given its
    unilateral gap, closed by a constant force.
    """
    rows = np.random.default_rng(3).normal(size=(4, 6)).round(2).tolist()
    body = ModalModel((40.0, 55.0, 90.0, 130.0, 210.0, 300.0), dict(zip("xyzd", map(tuple, rows), strict=True)))
    k_t, load, k_n = 4e4, 10.0, 4e4
    joint = Joint("plane", PlaneFriction(mu, k_t, load, k_n), ("x", "y", "z"))
    rig = JointedRig(name, body, Damping(modal_ratios=(0.01,)), (joint,), Excitation(force, at="d"))
    rubbing = {"type": "Penalty3D", "dirs": [0, 1, 2], "mu": mu, "N0": load, "g": 0.0, "k_n": k_n, "k_t": k_t}
    gap = {"type": "PenaltyUnilateralGap", "dirs": [0], "g": -load / k_n, "k": k_n}
    closed = {"type": "GOForcing", "dirs": [0], "dto": 0, "ho": 0, "amp": load}
    turn = np.array([[0, 0, -1.0 if mu else 1.0], [1, 0, 0], [0, 1, 0]])
    return Case(rig, (36.0, 64.0), [rubbing] if mu else [gap, closed], turn, 3)


def timed(call: Any, runs: int) -> tuple[Any, float, float]:
    """Last result, median wall and CPU seconds of warm calls."""
    call()
    wall, cpu = [], []
    for _ in range(runs):
        begin, used = time.perf_counter(), time.process_time()
        result = call()
        wall.append(time.perf_counter() - begin)
        cpu.append(time.process_time() - used)
    return result, median(wall), median(cpu)


def by_peer(python: str, case: Case, length: float, at: np.ndarray) -> dict[str, Any]:
    """The curve by pyHarm, and its solutions at frequencies."""
    s = case.rig.structure
    ports = s.joints if case.each == 1 else np.kron(np.eye(len(case.rig.joints)), case.turn) @ s.joints
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "case.npz", Path(folder) / "curve.json"
        physics = {"ports": ports, "drive": s.excitation, "omega_n": s.omega_n, "damping": s.damping.diagonal()}
        settings = {"H": H, "N_t": N_T, "hz": np.array(case.hz), "at": at, "step": case.step, "each": case.each}
        units = {"force": case.rig.excitation.amplitude, "length": length, "omega": float(s.omega_n[0])}
        np.savez(source, elements=json.dumps(case.elements), **physics, **settings, **units)
        environment = {**os.environ, "JAX_ENABLE_X64": "1", "OMP_NUM_THREADS": "1"}
        command = [python, str(PEER), str(source), str(target)]
        subprocess.run(command, check=True, capture_output=True, timeout=600, env=environment)
        return json.loads(target.read_text())


def top(hz: np.ndarray, drive: np.ndarray) -> float:
    """Top of a parabola through the three largest displacements, of solutions at ascending frequencies [m]."""
    largest = np.abs(drive @ FourierBasis(H, 4096).synthesis.T).max(axis=1)
    i = int(np.clip(largest.argmax(), 1, len(hz) - 2))
    x = hz[i - 1 : i + 2] - hz[i]
    a, b, c = np.polyfit(x, largest[i - 1 : i + 2], 2)
    return float(c - b**2 / (4 * a))


@one_thread
def compare(case: Case, python: str | None) -> None:
    """One line of the table."""
    rig = case.rig
    curve, wall, cpu = timed(lambda: trace_frequency(rig, case.hz, harmonics=H, samples=N_T), RUNS)
    peak = max(curve.points, key=lambda p: p["drive"].peak)
    at = peak.hz * np.array([1.0, 0.998, 0.999, 1.001, 1.002])
    points = [steady_state(rig, hz, harmonics=H, samples=N_T, start=peak) for hz in at]
    same = np.array([p["drive"].coefficients for p in points])
    order, reach = at.argsort(), float(peak["drive"].amplitude[1])
    print(f"{rig.name}: peak at {peak.hz:.3f} Hz, {said(case, peak)}; energy {peak.energy_error:.0e}")
    print(
        f"  ours   {row(wall, cpu, len(curve.points), top(at[order], same[order]))}",
        "" if curve.complete else "PARTIAL",
    )
    if python is not None:
        try:
            theirs = by_peer(python, case, reach, at)
        except subprocess.SubprocessError as failed:
            print(f"  pyHarm failed: {(getattr(failed, 'stderr', None) or b'').decode()[-300:] or failed}", flush=True)
        else:
            there = np.array(theirs["at"])
            apart = np.abs(there - same).max() / reach
            line = row(theirs["wall"], theirs["cpu"], len(theirs["hz"]), top(at[order], there[order]))
            print(f"  pyHarm {line}; {theirs['rejected']} rejected, to {theirs['hz'][-1]:.1f} of {case.hz[1]:.1f} Hz")
            each = 1e3 * theirs["linearize"]
            print(f"         harmonics apart {apart:.1e}, left {theirs['left']:.0e}, R+J {each:.2f} CPU ms", flush=True)
    fine = steady_state(rig, peak.hz, harmonics=FINE * H, samples=FINE * N_T, start=peak)
    start = state_at_phase_zero(JointBalance(rig, fine.basis), fine.state)
    period = joint_steady_state(rig, peak.hz, steps_per_period=FINE * N_T, start=start)
    marched = period.history.coefficients("drive", 1)[1:]
    away = [
        np.hypot(*(p["drive"].coefficients[[1, h + 1]] - marched)) / np.hypot(*marched)
        for p, h in ((peak, H), (fine, FINE * H))
    ]
    print(f"  marched: apart {away[0]:.1e} with {H} harmonics, {away[1]:.1e} with {FINE * H}; ", end="")
    print(f"energy {fine.energy_error:.0e}, closure {period.closure:.0e}", flush=True)


def said(case: Case, peak: Any) -> str:
    """How many joints slip, or how far the normal load goes."""
    joints = case.rig.joints
    if case.each == 1:
        return f"{sum(peak[name].peak > 0.999 * MU * LOAD / len(joints) for name in case.rig.forces)} slip"
    normal = joints[0].law.normal_load - peak["plane.force.3"].samples
    return f"normal load {normal.min():.2f} to {normal.max():.2f} N"


def row(wall: float, cpu: float, points: int, peak: float) -> str:
    """What both codes are asked."""
    each = 1e3 * cpu / points
    return f"{wall:7.3f} s (CPU {cpu:.3f}), {points} points, {each:.2f} CPU ms a point, peak {1e3 * peak:.6f} mm"


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

    return 1e3 * timed(newton, 40)[2], 1e3 * timed(lambda: problem.linearize(x, lam), 40)[2]


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peer", help="Python that has pyHarm; left out: ours alone")
    python = parser.parse_args().peer
    for joints in (2, 4, 8):
        compare(chain(joints), python)
    compare(pressed(8.0, 0.3, "plane friction, always pressed"), python)
    compare(pressed(16.0, 0.0, "no friction, separating"), python)
    compare(pressed(16.0, 0.3, "plane friction, separating"), None)  # Penalty3D drops its preload once it is open
    print("\njoints, CPU ms an iteration (residual, derivative, bordered solve), CPU ms of the residual alone")
    for joints in (1, 2, 4, 8, 16):
        print("{:3d} {:8.2f} {:8.2f}".format(joints, *iteration(joints)), flush=True)


if __name__ == "__main__":
    main()
