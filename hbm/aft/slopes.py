"""Local slopes of a law along a period: how its outputs and internal states after a sample follow what was before.

States side by side, as the anchors of elements in parallel, act on none but themselves. Their slopes to each other are
left out, so that many of them cost no more than their number.
"""

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from hbm.fourier import Array


FEW = 16
"""Every so many samples."""


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


def packed(local: Any, outputs: int) -> tuple[Any, bool]:
    """Slopes of a sample as expressions (outputs + states, states + inputs): those that are stored, one after another.

    Returns
    -------
    SX
        Rows of the outputs, then of the states. A row of a state that acts on none but itself has one slope to states.
    bool
        Whether all are such states.
    """
    n = local.size1() - outputs
    A = local[outputs:, :n]
    apart = bool((A.sparsity() + ca.Sparsity.diag(n)).nnz() == n)
    if not apart:
        return ca.densify(ca.vec(local.T)), False
    alone = ca.horzcat(ca.diag(A), local[outputs:, n:])
    return ca.densify(ca.vertcat(ca.vec(local[:outputs, :].T), ca.vec(alone.T))), True


def unpacked(table: Array, outputs: int, states: int, *, apart: bool) -> Slopes:
    """Views of the slopes in a table of samples (N_t, stored), as :func:`packed` leaves them."""
    own = 1 if apart else states
    inputs = (table.shape[1] - states * (outputs + own)) // (outputs + states)
    end = outputs * (states + inputs)
    above = table[:, :end].reshape(len(table), outputs, states + inputs)
    below = table[:, end:].reshape(len(table), states, own + inputs)
    A = below[:, :, 0] if apart else below[:, :, :states]
    return Slopes(above[:, :, :states], above[:, :, states:], A, below[:, :, own:])
