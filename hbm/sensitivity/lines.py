"""Exact derivatives of a steady state under a force of many lines, by the implicit function theorem and GMRES."""

from collections.abc import Callable, Sequence

import numpy as np

from hbm.balance.lines import EXACT, LinesHere
from hbm.fourier import Array
from hbm.sensitivity.channels import ChannelSensitivity, Peak, smooth_peak
from hbm.sensitivity.jointed import JointChannels, law_changes
from models.scalars import FORCE


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
    Q, force = np.zeros((*here.state.Q.shape, len(keys))), np.zeros((problem.basis.size, len(keys)))
    moving, structures = problem.rig.structure_changes(tuple(keys))
    Q[:, :, moving] = -problem.modes.moved(problem.moved_balance(here.state, structures))
    if FORCE in keys:
        i = keys.index(FORCE)
        force[:, i] = problem.force_shape
        Q[:, :, i] = problem.modes.moved(np.outer(problem.force_shape, s.excitation))
    held = np.zeros((*here.state.T.shape, len(keys)))
    changes = problem.signals_along(here.state, Q, held, force, np.zeros(len(keys)))
    for own, by_rows in zip(changes, problem.moved_signals(here.state, structures), strict=True):
        own[:, :, moving] += by_rows
    missed = here.answered(changes) if changes else held
    for at, columns, by in law_changes(problem, here.signals, problem.Omega, keys):
        missed[:, at, columns] += by
    T = here.followed(missed, accuracy)
    return Q + problem.modes.moved(np.einsum("kmp,mn->knp", T, s.joints)), T
