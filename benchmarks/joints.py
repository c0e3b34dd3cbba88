"""Two, four and eight Jenkins joints on one beam: beside pyHarm, beside time integration, and what a joint costs.

    python benchmarks/joints.py --peer /path/to/python/with/pyHarm

The fundamental of the drive displacement is compared at our peak: their Newton iterations start from our solution, at
its frequency, and end at theirs.
"""

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from hbm.balance.jointed import JointBalance
from hbm.fourier import FourierBasis
from hbm.integration.jointed import joint_steady_state, state_at_phase_zero
from hbm.parallel import one_thread
from hbm.response.trace import steady_state, trace_frequency
from models import Beam, Jenkins
from models.bodies import FiniteBeam, ModalModel
from models.jointed import JointedRig
from models.joints import Friction, Joint
from models.parts import Damping, Excitation

H, N_T, MODES = 9, 256, 20
MU, LOAD, STIFFNESS = 0.4, 5.0, 2e4
FORCE = {1: 3.0, 2: 3.0, 4: 6.0, 8: 9.0, 16: 9.0}
"""By the number of joints, so that all of them slip [N]."""
BEAM = Beam(0.606, 0.03888, 0.00478, 210e9, 7800.0, MODES)
PATIENCE = 120
"""For the peer's curve, which is traced twice [s]."""

PEER = Path(__file__).parent / "peers" / "pyharm_joints.py"


def rig_with(joints: int) -> JointedRig:
    """Joints to the ground along a cantilever, constant load, no residual flexibility: what both codes can do."""
    positions = np.linspace(0.12, 0.59, joints)
    places = [f"y({x:.3f})" for x in positions]
    damping = Damping(modal_ratios=(0.01,))
    modes = FiniteBeam(BEAM, "clamped", "free").ported([*places, "y(0.555)"], damping)
    keep = modes.omega_n < 2 * np.pi * 6000.0
    ports = {place: tuple(row[keep].tolist()) for place, row in zip(modes.places, modes.rows, strict=True)}
    body = ModalModel(tuple((modes.omega_n[keep] / (2 * np.pi)).tolist()), ports)
    law = Friction(Jenkins(MU, MU * LOAD / STIFFNESS), LOAD)
    found = tuple(Joint(f"j{i + 1}", law, (place,)) for i, place in enumerate(places))
    return JointedRig(f"{joints} joints", body, damping, found, Excitation(FORCE[joints], at="y(0.555)"))


def window(rig: JointedRig) -> tuple[float, float]:
    """Around the first resonance with the joints stuck and sliding."""
    s = rig.structure
    joined = s.joints.T @ s.joints * STIFFNESS + np.diag(s.omega_n**2)
    stuck = float(np.sqrt(np.linalg.eigvalsh(joined)[0])) / (2 * np.pi)
    return 0.8 * float(s.omega_n[0]) / (2 * np.pi), 1.1 * stuck


@one_thread
def ours(rig: JointedRig, hz: tuple[float, float]) -> tuple[float, int, float, float]:
    """Wall time of a warm curve, points, peak of the fundamental and where."""
    for _ in range(2):
        begin = time.perf_counter()
        curve = trace_frequency(rig, hz, harmonics=H, samples=N_T)
        wall = time.perf_counter() - begin
    first = curve["drive"].amplitude[:, 1]
    top = int(first.argmax())
    return wall, len(curve.points), float(first[top]), float(curve.hz[top])


def peer(python: str, rig: JointedRig, hz: tuple[float, float], at: float, *, trace: bool) -> dict:
    """The same by pyHarm: solved at our peak, and if asked for its own curve."""
    s = rig.structure
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "case.npz", Path(folder) / "curve.json"
        np.savez(
            source,
            rows=s.joints,
            drive=s.excitation,
            omega_n=s.omega_n,
            damping=s.damping.diagonal(),
            mu=MU,
            load=LOAD,
            stiffness=STIFFNESS,
            force=rig.excitation.amplitude,
            H=H,
            N_t=N_T,
            hz=np.array(hz),
            length=1e-3,
            omega=float(s.omega_n[0]),
            at=at,
            Q=steady_state(rig, at, harmonics=H, samples=N_T).state.Q,
        )
        command = [python, str(PEER), str(source), str(target), "yes" if trace else "no"]
        subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE)
        return json.loads(target.read_text())


def compare(rig: JointedRig, python: str | None) -> None:
    """One line of the table."""
    hz = window(rig)
    wall, points, peak, at = ours(rig, hz)
    line = f"{len(rig.joints):3d} | {wall:6.2f} s {points:4d} {1e3 * wall / points:6.2f} ms"
    line += f" | {1e3 * peak:.5f} mm {at:.3f} Hz"
    solution = steady_state(rig, at, harmonics=4 * H, samples=4 * N_T)
    problem = JointBalance(rig, solution.basis)
    period = joint_steady_state(rig, at, steps_per_period=4 * N_T, start=state_at_phase_zero(problem, solution.state))
    marched = period.history.harmonics("drive", 1)
    a = solution["drive"].coefficients[[1, 4 * H + 1]]
    line += f" | {np.hypot(*(a - marched[1:])) / np.hypot(*a):.1e} {abs(solution.energy_error):.0e}"
    if python is not None:
        line += f" | apart {peer(python, rig, hz, at, trace=False)['apart']:.1e}"
        try:
            found = peer(python, rig, hz, at, trace=True)
            count = len(found["hz"])
            line += f" | {found['wall']:6.2f} s {count:4d} {1e3 * found['wall'] / count:6.2f} ms"
        except subprocess.SubprocessError as failed:
            line += f" | its curve: {type(failed).__name__} (at most {PATIENCE} s)"
    print(line, flush=True)


@one_thread
def iteration(joints: int) -> float:
    """Milliseconds of residual, derivative and solve, warm."""
    rig = rig_with(joints)
    problem = JointBalance(rig, FourierBasis(H, N_T))
    x, row = np.random.default_rng(0).normal(size=(2, problem.size))
    begin = 0.0
    for i in range(30):
        if i == 10:
            begin = time.perf_counter()
        here = problem.linearize(0.1 * x, problem.lam_at(30.0))
        here.solve_bordered(row, 1.0, here.residual, 0.0)
    return 1e3 * (time.perf_counter() - begin) / 20


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peer", help="Python that has pyHarm; left out: ours alone")
    python = parser.parse_args().peer
    print("joints | ours: curve, points, a point | peak of the fundamental | marched, energy", end="")
    print(" | pyHarm at our peak | its curve, points, a point")
    for joints in (2, 4, 8):
        compare(rig_with(joints), python)
    print("\njoints, ms an iteration (residual, derivative, solve)")
    for joints in (1, 2, 4, 8, 16):
        print(f"{joints:3d} {iteration(joints):8.2f}", flush=True)


if __name__ == "__main__":
    main()
