"""Local slopes of a law along a period: how its outputs and internal states after a sample follow what was before.

States side by side, as the anchors of elements in parallel, act on none but themselves. Their slopes to each other are
left out, so that many of them cost no more than their number.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hbm.fourier import Array

FEW = 16
"""Every so many samples."""

FEW_STATES = 5
"""Up to so many internal states a recurrence is solved as one banded system, else sample by sample; and what they do to
each other through the outputs is put together before it is stored."""


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of outputs and states after each sample to the states before it and to the inputs of the sample.

    Attributes
    ----------
    outputs_by_states : (N_t, outputs, states) array
    outputs_by_inputs : (N_t, outputs, inputs) array
    states_by_states : (N_t, states, states) array, or (N_t, states)
        Of each state to itself alone, where none acts on another by what the law is made of.
    states_by_inputs : (N_t, states, inputs) array
    """

    outputs_by_states: Array
    outputs_by_inputs: Array
    states_by_states: Array
    states_by_inputs: Array

    @property
    def states(self) -> int:
        """Number of internal states."""
        return int(self.outputs_by_states.shape[2])

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        return int(self.outputs_by_states.shape[1])

    @property
    def transitions(self) -> Array:
        """Slopes of the states to those before, (N_t, states) to themselves where none acts on another one."""
        A = self.states_by_states
        if A.ndim == 2:
            return A
        others = ~np.eye(self.states, dtype=bool)
        if A[::FEW, others].any() or A[:, others].any():  # a few samples tell most that do
            return A
        return np.diagonal(A, axis1=1, axis2=2)

    @property
    def by_states(self) -> Array:
        """Of outputs and states to the states, (N_t, outputs + states, states)."""
        A = self.states_by_states
        return np.concatenate([self.outputs_by_states, A if A.ndim == 3 else A[:, :, None] * np.eye(self.states)], 1)

    @property
    def by_inputs(self) -> Array:
        """Of outputs and states to the inputs, (N_t, outputs + states, inputs)."""
        return np.concatenate([self.outputs_by_inputs, self.states_by_inputs], axis=1)

    def to(self, inputs: slice) -> "Slopes":
        """Those to some of the inputs."""
        some = self.outputs_by_inputs[:, :, inputs], self.states_by_inputs[:, :, inputs]
        return replace(self, outputs_by_inputs=some[0], states_by_inputs=some[1])

    def copy(self) -> "Slopes":
        """Arrays of their own."""
        return Slopes(*(getattr(self, name).copy() for name in self.__dataclass_fields__))


class Layout(NamedTuple):
    """How the slopes of a sample are stored.

    Attributes
    ----------
    apart : bool
        No state acts on another one, but through the outputs: a row of a state has one slope to states, its own.
    held : bool
        Rows of states are those with the outputs held, and their slopes to these are stored behind.
    """

    apart: bool
    held: bool


def packed(local: Any, by_outputs: Any) -> tuple[Any, Layout]:
    """Slopes of a sample as expressions: those that are stored, one after another, rows of the outputs first.

    Parameters
    ----------
    local : SX, (outputs + states, states + inputs)
        To the states before and to the inputs, those of the states after with the outputs held.
    by_outputs : SX, (states, outputs)
        Of the states after to the outputs.
    """
    n, outputs = by_outputs.shape
    above, below = local[:outputs, :], local[outputs:, :]
    apart = bool((below[:, :n].sparsity() + ca.Sparsity.diag(n)).nnz() == n)
    held = apart and n > FEW_STATES and by_outputs.nnz() > 0
    if not held:  # few are put together here
        below = below + by_outputs @ above
        apart = bool((below[:, :n].sparsity() + ca.Sparsity.diag(n)).nnz() == n)
    parts = [ca.diag(below[:, :n]), below[:, n:]] if apart else [below]
    rows = ca.horzcat(*parts, *([by_outputs] if held else []))
    return ca.densify(ca.vertcat(ca.vec(above.T), ca.vec(rows.T))), Layout(apart, held)


def unpacked(table: Array, outputs: int, states: int, layout: Layout) -> Slopes:
    """Slopes in a table of samples (N_t, stored), as :func:`packed` leaves them; views of it where it holds all."""
    own, behind = 1 if layout.apart else states, outputs if layout.held else 0
    inputs = (table.shape[1] - states * (outputs + own + behind)) // (outputs + states)
    end = outputs * (states + inputs)
    above = table[:, :end].reshape(len(table), outputs, states + inputs)
    below = table[:, end:].reshape(len(table), states, own + inputs + behind)
    A = below[:, :, 0] if layout.apart else below[:, :, :states]
    found = Slopes(above[:, :, :states], above[:, :, states:], A, below[:, :, own : own + inputs])
    by_outputs = below[:, :, own + inputs :]
    if not by_outputs.any():
        return found
    coupled, at = np.einsum("kim,kmj->kij", by_outputs, found.outputs_by_states), np.arange(states)
    coupled[:, at, at] += A
    by_inputs = found.states_by_inputs + by_outputs @ found.outputs_by_inputs
    return replace(found, states_by_states=coupled, states_by_inputs=by_inputs)
