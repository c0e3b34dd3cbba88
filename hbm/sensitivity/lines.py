"""Exact derivatives of a steady state under a force of many lines, by the implicit function theorem and GMRES."""

from collections.abc import Callable, Sequence

import numpy as np

from hbm.balance.lines import EXACT, LinesHere
from hbm.balance.scaled import State
from hbm.fourier import Array
from hbm.sensitivity.channels import ChannelSensitivity, Peak, smooth_peak
from hbm.sensitivity.jointed import JointChannels, law_changes
from hbm.sensitivity.scalars import FORCE


class LineChannels(JointChannels):
    """Derivatives of the channels on their lines alone: no samples of them, and of no peak."""

    def _at_port(self, name: str, coefficients: Array, samples: Callable[[], Array]) -> ChannelSensitivity:
        return self._sampled(name, coefficients)

    def _sampled(self, name: str, coefficients: Array, peak: Peak = smooth_peak) -> ChannelSensitivity:
        none = np.zeros((0, coefficients.shape[1]))
        return ChannelSensitivity(coefficients, none, np.full(coefficients.shape[1], np.nan))


def line_changes(here: LinesHere, keys: Sequence[str], accuracy: float = EXACT) -> tuple[Array, Array]:
    """Derivatives of the modes (2H+1, n, p) and joint forces (2H+1, m, p) to numbers of the rig (p,).

    That to the amplitude of the excitation is to the share of all its lines. Their `accuracy` is relative.

    Raises
    ------
    ConvergenceError
        If GMRES does not find one.
    """
    problem, s = here.problem, here.problem.structure
    Q = np.zeros((*here.state.Q.shape, len(keys)))
    changes = [np.zeros((*signals.shape, len(keys))) for signals in here.signals]
    moving, structures = problem.rig.structure_changes(tuple(keys))
    Q[:, :, moving] = -problem.modes.moved(problem.moved_balance(here.state, structures))
    for own, by_rows in zip(changes, problem.moved_signals(here.state, structures), strict=True):
        own[:, :, moving] = by_rows
    for i in moving:
        moved = problem.signals(State(Q[:, :, i], np.zeros_like(here.state.T), problem.Omega, 0.0))
        for own, by_modes in zip(changes, moved, strict=True):
            own[:, :, i] += by_modes
    if FORCE in keys:
        i, shape = keys.index(FORCE), np.outer(problem.force_shape, s.excitation)
        Q[:, :, i] = problem.modes.moved(shape)
        grown = problem.signals(State(Q[:, :, i], np.zeros_like(here.state.T), problem.Omega, 1.0))
        for own, a in zip(changes, grown, strict=True):
            own[:, :, i] = a
    missed = here.answered(changes) if changes else np.zeros((*here.state.T.shape, len(keys)))
    for at, columns, by in law_changes(problem, here.signals, problem.Omega, keys):
        missed[:, at, columns] += by
    T = here.followed(missed, accuracy)
    return Q + problem.modes.moved(np.einsum("kmp,mn->knp", T, s.joints)), T
