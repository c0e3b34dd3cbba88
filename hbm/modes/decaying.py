"""Nonlinear modes as a free decay shows them: frequency and damping ratio over the amplitude of a channel.

A decay passes slowly through the motions of the damped nonlinear normal mode: at each amplitude it loses what they lose
(Krack, Nonlinear modal analysis of nonconservative systems, Computers & Structures 154, 2015). They are kept up by a
negative damping, so that a linear one has its undamped frequency; what is not kept up is slower, as an oscillator is.
"""

from collections.abc import Sequence

import numpy as np

from continuation import ConvergenceError
from hbm.balance.scaled import State
from hbm.balance.solution import PeriodicSolution, describe
from hbm.channels import factor
from hbm.errors import InputError
from hbm.fourier import Array, FourierBasis, default_samples
from hbm.modes.amplitudes import solved
from hbm.modes.backbone import NonlinearMode, nonlinear_mode
from hbm.modes.epmc import DriveAmplitude, FreeMotion
from hbm.parallel import one_thread
from hbm.response.budget import Budget
from models.jointed import AnyRig

BASIS = FourierBasis(15, default_samples(15))
"""Harmonics and samples of its motions."""

BEYOND = 1.2
"""Factor by which the mode reaches beyond the amplitudes asked for."""

EXACT = 1e-9
"""Amplitudes of a channel are met to within this share."""

ROUNDS = 6
"""A channel's amplitude per drive displacement changes with the amplitude: it is found in turns."""


def over_channel(
    rig: AnyRig,
    mode: int,
    channel: str,
    amplitudes: tuple[float, float],
    basis: FourierBasis = BASIS,
    budget: Budget | None = None,
) -> NonlinearMode:
    """Nonlinear mode whose motions have at least these amplitudes of a channel.

    Parameters
    ----------
    rig : Rig or JointedRig
    mode : int
        Counted from 1.
    channel : str
        A channel of the rig.
    amplitudes : (float, float)
        Least and largest amplitude of the channel, in its unit.
    basis : FourierBasis
    budget : Budget, optional
        As for :func:`hbm.modes.backbone.nonlinear_mode`.

    Raises
    ------
    InputError
        If the mode does not reach these amplitudes.
    continuation.ConvergenceError
        If there is no first motion.
    """
    low, high = amplitudes[0] / BEYOND, amplitudes[1] * BEYOND
    read = next(c for c in rig.channels if c.name == channel)
    per_metre = float(abs(factor(read, np.array([1j * rig.structure.omega_n[mode - 1]]))[0]))
    drive = low / per_metre, high / per_metre  # as if the channel were at the drive, to begin with
    for _ in range(ROUNDS):
        found = nonlinear_mode(rig, mode, amplitudes=drive, harmonics=basis.H, samples=basis.N_t, budget=budget)
        reached = _channel_amplitude(found.points, channel)
        if reached[0] <= amplitudes[0] and reached[-1] >= amplitudes[1]:
            return found
        if not found.complete:
            break
        drive = found.amplitude[0] * low / reached[0], found.amplitude[-1] * high / reached[-1]
    raise InputError(
        f"{rig.name}: {channel} of mode {mode} reaches {reached[0]:.3g} to {reached[-1]:.3g}; must be "
        f"{amplitudes[0]:.3g} to {amplitudes[1]:.3g}, the amplitudes of the decay"
    )


def predicted(mode: NonlinearMode, channel: str, amplitude: Array) -> tuple[Array, Array]:
    """Frequency [Hz] and damping ratio of a decay of a mode at amplitudes of a channel, (m,) each."""
    x = np.log(_channel_amplitude(mode.points, channel))
    at = np.log(amplitude)
    return np.asarray(np.interp(at, x, mode.decaying_hz)), np.asarray(np.interp(at, x, mode.damping_ratio))


def at_channel(mode: NonlinearMode, channel: str, amplitudes: Array) -> NonlinearMode:
    """The motions of a mode at amplitudes of a channel, (m,), solved there.

    Raises
    ------
    ValueError
        If the mode does not reach one of them.
    continuation.ConvergenceError
        If one cannot be solved.
    """
    reached = np.log(_channel_amplitude(mode.points, channel))
    drive = np.exp(np.interp(np.log(amplitudes), reached, np.log(mode.amplitude)))
    return _settled(mode.problem, mode.near(drive), drive, channel, amplitudes)


@one_thread
def near_states(
    rig: AnyRig, basis: FourierBasis, states: Sequence[State], relief: Array, channel: str, amplitudes: Array
) -> NonlinearMode:
    """The motions of a nonlinear mode at amplitudes of a channel, (m,), each from a state that is near.

    Parameters
    ----------
    rig : Rig or JointedRig
    basis : FourierBasis
    states : sequence of State, (m,)
    relief : (m,) array
        Damping xi that may keep each up [1/s].
    channel : str
    amplitudes : (m,) array

    Raises
    ------
    continuation.ConvergenceError
        If one cannot be solved.
    """
    problem, s = FreeMotion(rig, basis), rig.structure
    forces = [state.T.reshape(basis.size, -1) for state in states]
    moved = np.array([x.Q @ s.excitation + T @ s.flexibility_to_force for x, T in zip(states, forces, strict=True)])
    drive = np.linalg.norm(moved[:, problem.fundamental], axis=1)
    x = [problem.pack(state, float(xi), np.log10(a)) for state, xi, a in zip(states, relief, drive, strict=True)]
    return _settled(problem, x, drive, channel, amplitudes)


def _settled(
    problem: DriveAmplitude, x: Sequence[Array], drive: Array, channel: str, amplitudes: Array
) -> NonlinearMode:
    """Motions at amplitudes of a channel, from unknowns near them at amplitudes of the drive."""
    for _ in range(ROUNDS):
        found = [solved(problem, near, lam) for near, lam in zip(x, np.log10(drive).tolist(), strict=True)]
        x = [f.x for f in found]
        motions = tuple(describe(*problem.unpack(f.x, f.lam)) for f in found)
        off = amplitudes / _channel_amplitude(motions, channel)
        if np.abs(off - 1.0).max() < EXACT:
            return NonlinearMode.of(problem, found, motions)
        drive = drive * off
    raise ConvergenceError(
        f"{problem.rig.name}: amplitudes of {channel} are {np.abs(off - 1.0).max():.2g} off after {ROUNDS} rounds; "
        f"must be within {EXACT:g}"
    )


def _channel_amplitude(points: Sequence[PeriodicSolution], channel: str) -> Array:
    """Amplitude of the fundamental of a channel, (points,)."""
    return np.array([p[channel].amplitude[1] for p in points])
