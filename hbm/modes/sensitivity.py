"""Exact derivatives of a free decay to the numbers of a rig: of frequency and decay at given amplitudes of a channel.

The implicit function theorem on the balance of the damped nonlinear normal mode, with its complete matrix. The drive
amplitude is first held, then moved along the branch so that the amplitude of the channel stays.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from continuation import Point
from hbm.fourier import Array
from hbm.modes.backbone import NonlinearMode
from hbm.modes.epmc import DriveAmplitude
from hbm.modes.sustained import JointMotion
from hbm.parallel import one_thread
from hbm.sensitivity.derivatives import balance_change
from hbm.sensitivity.jointed import JointChannels
from models.scalars import HZ

AMPLITUDE = "amplitude of the drive"
"""Stands beside the keys of numbers for a step along the branch."""


@dataclass(frozen=True, eq=False)
class DecayChange:
    """How a motion of a nonlinear mode changes with p numbers of the rig, the amplitude of a channel held.

    Attributes
    ----------
    hz : (p,) array
        Derivatives of the frequency [Hz].
    relief : (p,) array
        Of the damping xi that would keep the motion up [1/s].
    Q, T : (2H+1, n, p) and (2H+1, m, p) arrays
        Of the coefficients of modes and joint forces.
    """

    hz: Array
    relief: Array
    Q: Array
    T: Array


@one_thread
def decay_changes(mode: NonlinearMode, channel: str, keys: Sequence[str]) -> list[DecayChange]:
    """Derivatives of each motion of a nonlinear mode of a rig with joints to numbers of the rig.

    Parameters
    ----------
    mode : NonlinearMode
        Solved at the amplitudes of the channel, :func:`hbm.modes.decaying.at_channel`.
    channel : str
        Its amplitude is held.
    keys : sequence of str, (p,)
        Keys of the rig file.
    """
    return [_changed(mode, i, channel, tuple(keys)) for i in range(len(mode.points))]


def _changed(mode: NonlinearMode, i: int, channel: str, keys: tuple[str, ...]) -> DecayChange:
    problem, point, solution = mode.problem, mode.branch.points[i], mode.points[i]
    balance, y, Omega = problem.unpack(point.x, point.lam)
    motion = balance.motion(y, Omega)
    assert isinstance(motion, JointMotion)  # of a rig with joints
    x = np.column_stack([_at_held_drive(mode, i, motion, keys), point.tangent_x / point.tangent_lam])
    Q, T = _unscaled(problem, point, x)
    hz, relief = solution.hz / point.x[-2] * x[-2], balance.Omega_ref * x[-1]

    none = np.zeros_like
    by = np.concatenate([Q[..., :-1], none(Q[..., :1]), Q[..., -1:]], axis=2)
    pushed = np.concatenate([T[..., :-1], none(T[..., :1]), T[..., -1:]], axis=2)
    read = JointChannels(motion.balance, solution, (*keys, HZ, AMPLITUDE), by, pushed)[channel].coefficients
    cosine, sine = problem.fundamental
    there = solution[channel].coefficients
    growth = (there[cosine] * read[cosine] + there[sine] * read[sine]) / np.hypot(there[cosine], there[sine]) ** 2
    growth = np.delete(growth, len(keys)) + growth[len(keys)] * hz

    step = -growth[:-1] / growth[-1]  # along the branch, so that the channel's amplitude stays
    return DecayChange(*(a[..., :-1] + a[..., -1:] * step for a in (hz, relief, Q, T)))


def _at_held_drive(mode: NonlinearMode, i: int, motion: JointMotion, keys: tuple[str, ...]) -> Array:
    """Derivatives (size, p) of the unknowns at held drive amplitude."""
    problem, solution = mode.problem, mode.points[i]
    scale, N, p = problem.scale(mode.branch.points[i].lam), problem.balance.size, len(keys)
    state = solution.state
    held = np.zeros((*state.Q.shape, p)), np.zeros((*state.T.shape, p))
    by = np.zeros((N + 2, p))
    by[:N] = balance_change(motion.here, keys)
    drive = JointChannels(motion.balance, solution, keys, *held)["drive"]
    by[N:] = drive.coefficients[problem.fundamental] / problem.drive_ref
    return np.asarray(np.linalg.solve(problem.jacobian(motion, scale), -by / scale))


def _unscaled(problem: DriveAmplitude, point: Point, x: Array) -> tuple[Array, Array]:
    """Derivatives of the modes (2H+1, n, p+1) and joint forces (2H+1, m, p+1); the last are along the branch."""
    balance, N = problem.balance, problem.balance.size
    y = x[:N].copy()
    y[:, -1] += np.log(10.0) * point.x[:N]  # unknowns are per amplitude
    y *= problem.scale(point.lam)
    size, split = balance.basis.size, balance.basis.size * balance.structure.n
    Q = y[:split].reshape(size, -1, y.shape[1]) * balance.q_ref
    return Q, y[split:].reshape(size, -1, y.shape[1]) * balance.f_ref[:, None]
