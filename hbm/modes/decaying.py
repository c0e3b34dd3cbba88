"""Nonlinear modes as a free decay shows them: frequency and damping ratio over the amplitude of a channel.

A decay passes slowly through the motions of the damped nonlinear normal mode: at each amplitude it loses what they lose
(Krack, Nonlinear modal analysis of nonconservative systems, Computers & Structures 154, 2015). They are kept up by a
negative damping, so that a linear one has its undamped frequency; what is not kept up is slower, as an oscillator is.
"""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from continuation import ConvergenceError, Point
from hbm.balance.scaled import State
from hbm.balance.solution import PeriodicSolution, describe
from hbm.channels import DERIVATIVES
from hbm.errors import InputError
from hbm.fourier import Array, FourierBasis, default_samples
from hbm.measurement.decay import damping_ratio
from hbm.modes.amplitudes import StuckMode, solved, traced
from hbm.modes.backbone import NonlinearMode, described
from hbm.modes.epmc import DriveAmplitude, FreeMotion
from hbm.modes.sustained import SustainedJoints
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

GROWTH, TELLING = (0.2, 5.0), 1e-6
"""Powers of the drive displacement that a channel may grow with, such as 2 of an acceleration where a spring hardens;
steps of its logarithm that are longer tell which."""


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
    found = toward_channel(rig, mode, channel, amplitudes, basis, budget)
    low, high = span(found, channel)
    if low <= amplitudes[0] and high >= amplitudes[1]:
        return found
    raise InputError(
        f"{rig.name}: {channel} of mode {mode} reaches {low:.3g} to {high:.3g}; must be {amplitudes[0]:.3g} to "
        f"{amplitudes[1]:.3g}, the amplitudes of the decay; {found.branch.message}"
    )


@one_thread
def toward_channel(
    rig: AnyRig,
    mode: int,
    channel: str,
    amplitudes: tuple[float, float],
    basis: FourierBasis = BASIS,
    budget: Budget | None = None,
) -> NonlinearMode:
    """Nonlinear mode over as much of a range of amplitudes of a channel as it reaches; as :func:`over_channel`.

    It goes up from small amplitudes and ends where the largest one is reached: beyond may be what no decay shows, such
    as an internal resonance, which a trace can spend all its points on.

    Raises
    ------
    continuation.ConvergenceError
        If there is no first motion.
    """
    problem = FreeMotion(rig, basis)
    low, high = amplitudes[0] / BEYOND, amplitudes[1] * BEYOND
    per_metre = _of_linear_mode(problem, mode, channel)
    drive = low / per_metre, high / per_metre

    def enough(point: Point) -> bool:
        return float(_channel_amplitude(described(problem, [point]), channel)[0]) >= high

    for _ in range(ROUNDS):
        branch = traced(problem, mode, drive, None, budget, enough)
        found = NonlinearMode(rig, described(problem, branch.points), branch, problem)
        reached = _channel_amplitude(found.points, channel)
        if not found.complete or (reached[0] <= amplitudes[0] and reached[-1] >= amplitudes[1]):
            break
        # longer at the ends that are missing alone
        drive = drive[0] * min(low / reached[0], 1.0), drive[1] * max(high / reached[-1], 1.0)
    return found


def span(mode: NonlinearMode, channel: str) -> tuple[float, float]:
    """Least and largest amplitude of a channel that a mode reaches, in its unit."""
    reached = _channel_amplitude(mode.points, channel)
    return float(reached.min()), float(reached.max())


def predicted(mode: NonlinearMode, channel: str, amplitude: Array) -> tuple[Array, Array]:
    """Frequency [Hz] and damping ratio of a decay of a mode at amplitudes of a channel, (m,) each; nan beyond it.

    The damping ratio is that by which the channel falls, :func:`rate_of`.

    They are solved there; by lines between the points of the mode where that fails, as beside a fold.
    """
    hz, ratio = _where(mode, channel, amplitude, np.column_stack([mode.decaying_hz, _ratio_of(mode, channel)])).T
    within = np.isfinite(hz)
    with suppress(ConvergenceError):
        if within.any():
            there = at_channel(mode, channel, amplitude[within])
            hz[within], ratio[within] = there.decaying_hz, _ratio_of(there, channel)
    return hz, ratio


def rate_of(mode: NonlinearMode, channel: str) -> Array:
    """Rate at which the amplitude of a channel falls in a free decay, (points,) [1/s].

    The action falls at the rate xi; a channel by half of that only where frequency and shape do not change with the
    amplitude. An acceleration X omega^2 falls faster than X where the frequency falls with it. The rate is half of xi
    where the channel does not stand for the motion, as beside internal resonances.
    """
    growth = np.array([_growth(mode.problem, point, channel) for point in mode.branch.points])
    rate, lost = growth * mode.decay_rate, 2 * np.pi * mode.hz * mode.damping_ratio
    return np.where(np.isfinite(rate) & (growth > GROWTH[0]) & (growth < GROWTH[1]), rate, lost)


def _ratio_of(mode: NonlinearMode, channel: str) -> Array:
    return damping_ratio(2 * np.pi * mode.decaying_hz, rate_of(mode, channel))


def _growth(problem: DriveAmplitude, point: Point, channel: str) -> float:
    """Derivative d ln (amplitude of the channel) / d ln (amplitude of the drive) along the branch, by its tangent."""
    balance, y, Omega = problem.unpack(point.x, point.lam)
    along = point.tangent_x / (np.log(10.0) * point.tangent_lam) if point.tangent_lam else np.inf * point.tangent_x
    change = balance.unpack(problem.scale(point.lam) * (point.x[:-2] + along[:-2]), Omega)
    there, by = (_moved(problem, state, channel) for state in (balance.unpack(y, Omega), change))
    quantity = next(c.quantity for c in problem.rig.channels if c.name == channel)
    return float((by / there).real + DERIVATIVES[quantity] * along[-2] / point.x[-2])


def _moved(problem: DriveAmplitude, state: State, channel: str) -> complex:
    """Fundamental of the displacement at the place of a channel, linear in a state."""
    balance = problem.balance
    if isinstance(balance, SustainedJoints):
        i = [c.name for c in balance.rig.response_channels].index(channel)
        seen = state.Q @ balance.structure.channels[i] + state.T @ balance.structure.channels_by_joints[i]
    else:
        s = balance.structure
        seen = state.Q @ s.channel_rows[channel] + s.residual.channels.get(channel, (0.0, 0.0))[1] * state.T
    return complex(balance.basis.complex(seen)[1])


def at_channel(mode: NonlinearMode, channel: str, amplitudes: Array) -> NonlinearMode:
    """The motions of a mode at amplitudes of a channel, (m,), solved there.

    Raises
    ------
    ValueError
        If the mode does not reach one of them.
    continuation.ConvergenceError
        If one cannot be solved.
    """
    drive = np.exp(_where(mode, channel, amplitudes, np.log(mode.amplitude)[:, None])[:, 0])
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
    """Motions at amplitudes of a channel, from unknowns near them at amplitudes of the drive, by secants."""
    at, growth, last = np.log(drive), np.ones(len(drive)), None
    for _ in range(ROUNDS):
        found = [solved(problem, near, lam) for near, lam in zip(x, (at / np.log(10.0)).tolist(), strict=True)]
        x = [f.x for f in found]
        motions = tuple(describe(*problem.unpack(f.x, f.lam)) for f in found)
        reached = np.log(_channel_amplitude(motions, channel))
        missing = np.log(amplitudes) - reached
        if np.abs(missing).max() < EXACT:
            return NonlinearMode.of(problem, found, motions)
        if last is not None:
            told = np.abs(at - last[0]) > TELLING
            growth[told] = np.clip((reached - last[1])[told] / (at - last[0])[told], *GROWTH)
        last, at = (at, reached), at + missing / growth
    worst = int(np.abs(missing).argmax())
    raise ConvergenceError(
        f"{problem.rig.name}: no motion at {channel} = {amplitudes[worst]:.4g}, {abs(missing[worst]):.2g} of it off "
        f"after {ROUNDS} rounds; must be within {EXACT:g}"
    )


def _of_linear_mode(problem: FreeMotion, mode: int, channel: str) -> float:
    """Amplitude of a channel in the linear mode, with everything that touches stuck, per drive displacement [m]."""
    lam = float(np.log10(problem.drive_ref))
    motion = describe(*problem.unpack(StuckMode.of(problem.rig, mode).motion(problem, lam), lam))
    if not (read := float(_channel_amplitude([motion], channel)[0])):
        raise InputError(f"{problem.rig.name}: {channel} reads nothing of mode {mode}; must be a channel that does")
    return read / problem.drive_ref


def _where(mode: NonlinearMode, channel: str, amplitudes: Array, values: Array) -> Array:
    """What the points of a mode have, (points, k), where a channel first comes to amplitudes, (m, k); nan beyond it."""
    reached, wanted = np.log(_channel_amplitude(mode.points, channel)), np.log(amplitudes)
    found = np.full((len(wanted), values.shape[1]), np.nan)
    for row, at in zip(found, wanted, strict=True):
        passed = np.flatnonzero((reached[:-1] - at) * (reached[1:] - at) <= 0.0)
        if passed.size:
            i = int(passed[0])
            whole = reached[i + 1] - reached[i]
            row[:] = values[i] + ((at - reached[i]) / whole if whole else 0.0) * (values[i + 1] - values[i])
    return found


def _channel_amplitude(points: Sequence[PeriodicSolution], channel: str) -> Array:
    """Amplitude of the fundamental of a channel, (points,)."""
    return np.array([p[channel].amplitude[1] for p in points])
