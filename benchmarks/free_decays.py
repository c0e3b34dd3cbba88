"""Decay rates of nonlinear modes beside free decays marched in time, cycle by cycle: docs/theory/backbones.md.

    python -m benchmarks.free_decays

Every line is a cycle: the share of what is left until nothing slips that it takes, and by how much the rate and the
frequency that were marched differ from those of the mode.
"""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from hbm import NonlinearMode, load_rig, nonlinear_mode, simulate
from hbm.fourier import Array
from models import Jenkins
from models.bodies import MatrixBody
from models.jointed import JointedRig
from models.joints import CubicSpring, Friction, Joint
from models.parts import Damping, Excitation

BEAM = Path(__file__).parents[1] / "examples" / "paper_beam.toml"
SLIPS = 1.05
"""Factor by which the damping of a contact that slips exceeds that of one that sticks."""


def chain() -> JointedRig:
    """Twelve masses in a row on springs, two Jenkins joints and a cubic spring."""
    n, k = 12, 1e6
    stiffness = k * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    stiffness[-1, -1] = k
    body = MatrixBody(np.eye(n), stiffness, dofs=tuple(str(i) for i in range(1, n + 1)), modes=n)
    joints = (
        Joint("ground12", Friction(Jenkins(mu=0.5, critical_slip=2.5e-4), normal_load=10.0), at=("12",)),
        Joint("link56", Friction(Jenkins(mu=0.5, critical_slip=2.5e-5), normal_load=10.0), at=("5",), to=("6",)),
        Joint("cubic9", CubicSpring(cubic=5e7), at=("9",)),
    )
    return JointedRig("chain", body, Damping(modal_ratios=(0.005,)), joints, Excitation(20.0, at="3"))


def oscillator(share: float) -> JointedRig:
    """A mass on a spring, and a Jenkins contact of a share of its stiffness."""
    body = MatrixBody(np.eye(1), np.array([[1e4]]), dofs=("m",), modes=1)
    slider = Friction(Jenkins(mu=0.5, critical_slip=1e-4), normal_load=2.0 * share)
    joints = (Joint("rub", slider, at=("m",)),)
    return JointedRig(f"oscillator {share:g}", body, Damping(modal_ratios=(0.003,)), joints, Excitation(1.0, at="m"))


def cycles(t: Array, y: Array) -> Array:
    """Time, frequency and amplitude of the fundamental of each cycle, (cycles, 3)."""
    up = np.flatnonzero((y[:-1] < 0.0) & (y[1:] >= 0.0))
    crossing = t[up] - y[up] * (t[up + 1] - t[up]) / (y[up + 1] - y[up])
    found = []
    for (i, j), (begin, end) in zip(pairwise(up), pairwise(crossing), strict=True):
        phase = 2 * np.pi * (t[i : j + 1] - begin) / (end - begin)
        size = abs(np.trapezoid(y[i : j + 1] * np.exp(-1j * phase), phase)) / np.pi
        found.append(((begin + end) / 2, 1 / (end - begin), size))
    return np.array(found)


def compare(mode: NonlinearMode, amplitude: float, seconds: float) -> None:
    """Print the cycles of a decay from an amplitude [m] until nothing slips."""
    start = mode.at([amplitude])
    history = simulate(mode.rig, start.hz[0], level=0.0, start=start.points[0], duration=seconds)
    time, hz, size = cycles(history.time, history.channels["drive"].values).T
    stuck = mode.amplitude[np.argmax(mode.damping_ratio > SLIPS * mode.damping_ratio[0]) - 1]
    end = int(np.argmax(size < stuck)) if (size < stuck).any() else len(size) - 1
    rate = np.log(size[:-2] / size[2:]) / (time[2:] - time[:-2])
    print(f"{mode.rig.name}: nothing slips below {stuck:.3g} m")
    for i in range(1, end):
        m = mode.at([size[i]])
        taken = -np.expm1(-2 * np.pi * m.damping_ratio[0]) * size[i] / (size[i] - stuck)
        off = rate[i - 1] / m.decay_rate[0] - 1, hz[i] / m.decaying_hz[0] - 1
        print(
            f"  {size[i]:.3e} m  D {m.damping_ratio[0]:6.2%}  takes {taken:4.0%}  {end - i:2d} left  "
            f"rate {off[0]:+7.1%}  frequency {off[1]:+7.2%}"
        )


def main() -> None:
    """Compare four rigs."""
    beam = load_rig(BEAM)
    beam = replace(beam, damping=replace(beam.damping, mass_proportional=0.6))
    compare(nonlinear_mode(beam, amplitudes=(1e-6, 1.2e-3)), 1e-3, 0.45)
    compare(nonlinear_mode(chain(), amplitudes=(1e-6, 8e-3)), 2.1e-3, 1.5)
    compare(nonlinear_mode(oscillator(0.2), amplitudes=(1e-5, 1e-2)), 3e-3, 4.0)
    compare(nonlinear_mode(oscillator(0.05), amplitudes=(1e-5, 1e-2)), 1e-3, 6.0)


if __name__ == "__main__":
    main()
