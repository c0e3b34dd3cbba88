"""A law over a period of samples in buffers that CasADi reads and fills, marched until its loop is closed."""

from collections.abc import Callable
from typing import ClassVar, Protocol

import casadi as ca
import numpy as np

from hbm.aft.recurrence import NEUTRAL, Loop, monodromy, radius
from hbm.aft.slopes import Layout, Slopes, unpacked
from hbm.fourier import Array

CLOSURE = 1e-12
"""A loop counts as closed when the forces after a period repeat to this fraction of the largest."""

MOST_PERIODS = 8
"""Newton iterations on the memory that a period maps on itself."""


def buffered(
    function: ca.Function, arguments: list[Array], results: list[Array] | None = None
) -> tuple[Callable[[], None], list[Array]]:
    """Bind arrays to a function's inputs; return the call and the arrays it fills, new ones unless given."""
    buffer, evaluate = function.buffer()
    if results is None:
        results = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
    for i, argument in enumerate(arguments):
        buffer.set_arg(i, argument.data)
    for i, result in enumerate(results):
        buffer.set_res(i, result.data)

    def call(_alive: object = (buffer, arguments, results)) -> None:  # CasADi holds plain pointers into these
        evaluate()

    return call, results


class Functions(Protocol):
    """What :class:`hbm.aft.period.LawFunctions` and :class:`hbm.aft.jointstep.JointFunctions` share."""

    @property
    def layout(self) -> Layout:
        """How slopes are stored."""

    @property
    def march(self) -> ca.Function:
        """(carried, ...) -> carried."""

    @property
    def force(self) -> ca.Function:
        """(carried, ...) -> (forces, gap, carried)."""

    @property
    def period(self) -> ca.Function:
        """(carried, ...) -> (forces, gap, slopes, carried)."""


class SteadyPeriod:
    """A law over a period in buffers: marched until its loop is closed, its slopes worked out when they are asked for.

    Attributes
    ----------
    _memory, _outputs : int
        How many of the carried values decide what follows, and how many forces there are.
    _inputs : list of array
        Buffers that the functions read: what is carried, then those of the law.
    _carried, _marched, _end : (c,) array
        Buffers of what stands before the first sample: as given, after a march, and after a period.
    _forces, _gap : (N_t * outputs,) array
        Buffers of the forces, and of what f = law(f) is short of.
    _table : (N_t * stored,) array
        Buffer of the slopes.
    _layout : Layout
        How they are stored there.
    _sloped : bool
        Whether it belongs to the period in the other buffers.
    _known : Slopes or None
        What it holds then, once it was asked for.
    _march, _with_slopes, _without_slopes : callable
        Fill the buffers over a period from the state carried.
    _fades : bool
        Whether the state before the period fades without ever being forgotten: then closing the loop needs slopes.
    _iterations : int
        Newton iterations on f = law(f) at each sample, one of `choices`.
    """

    choices: ClassVar[tuple[int, ...]]
    """Enough iterations for most, and more where the loop stays open."""

    _memory: int
    _outputs: int
    _inputs: list[Array]
    _carried: Array
    _marched: Array
    _end: Array
    _forces: Array
    _gap: Array
    _table: Array
    _layout: Layout
    _known: Slopes | None
    _sloped: bool
    _march: Callable[[], None]
    _with_slopes: Callable[[], None]
    _without_slopes: Callable[[], None]
    _fades: bool
    _iterations: int

    def _bind(self, iterations: int) -> None:
        """Set up for so many iterations: `_memory`, `_outputs`, and :meth:`_allocate`."""
        raise NotImplementedError

    def _allocate(self, functions: Functions, *inputs: Array) -> None:
        """New buffers for functions over a period, which read these inputs behind what is carried."""
        self._carried = np.zeros(functions.period.size1_in(0))
        self._inputs = [self._carried, *inputs]
        self._march, (self._marched,) = buffered(functions.march, self._inputs)
        self._with_slopes, (self._forces, self._gap, self._table, self._end) = buffered(functions.period, self._inputs)
        self._without_slopes, _ = buffered(functions.force, self._inputs, [self._forces, self._gap, self._end])
        self._layout, self._known = functions.layout, None
        self._sloped = False

    def _unpacked(self, table: Array) -> Slopes:
        """Slopes in a buffer that a function over a period filled."""
        by_sample = table.reshape(len(self._forces) // self._outputs, -1)
        return unpacked(by_sample, self._outputs, self._memory, self._layout)

    def _steady(self) -> float:
        """Fill the buffers with the steady period, and return the closure of the loop."""
        closure = self._close()
        while not (self._solved or self._last_try):
            self._bind(next(n for n in self.choices if n > self._iterations))
            closure = self._close()
        return closure

    def _period(self) -> None:
        """Go over a period from the state carried."""
        if self._fades:
            self._with_slopes()
        else:
            self._without_slopes()
        self._sloped, self._known = self._fades, None

    @property
    def _local(self) -> Slopes:
        """The slopes of the last period."""
        if not self._sloped:
            self._with_slopes()
            self._sloped = True
        if self._known is None:
            self._known = self._unpacked(self._table)
        return self._known

    def _first_period(self) -> Slopes:
        """The slopes along the period from the virgin state; the buffers go on holding the steady one."""
        buffers = self._carried, self._forces, self._gap, self._end, self._table
        steady = [buffer.copy() for buffer in buffers]
        self._carried[:] = 0.0
        self._with_slopes()
        first = self._unpacked(self._table).copy()
        for buffer, values in zip(buffers, steady, strict=True):
            buffer[:] = values
        return first

    def _followed(self, function: ca.Function, chosen: slice = slice(None)) -> Loop:
        """The steady period by the slopes that a function of what the buffers hold works out, to some of its inputs."""
        evaluate, (_, _, table, _) = buffered(function, self._inputs)

        def read() -> Slopes:
            evaluate()
            return self._unpacked(table).to(chosen).copy()

        def virgin() -> Slopes:
            steady = self._carried.copy()
            self._carried[:] = 0.0
            found = read()
            self._carried[:] = steady
            return found

        return Loop(read(), virgin)

    @property
    def _transitions(self) -> Array:
        """Derivative of the memory after each sample to that before, see :attr:`hbm.aft.slopes.Slopes.transitions`."""
        return self._local.transitions

    @property
    def _pull(self) -> Array:
        """Largest change of a force over the period per unit of each memory, (memory,); they differ in units."""
        pull = np.abs(self._local.outputs_by_states).max(axis=(0, 1))
        return np.where(pull > 0.0, pull, 1.0)

    @property
    def _solved(self) -> bool:
        """Whether f = law(f) holds at every sample of the last period."""
        if not self._gap.any():
            return True
        return bool(np.abs(self._gap).max() <= CLOSURE * np.abs(self._forces).max())

    @property
    def _last_try(self) -> bool:
        return self._iterations == self.choices[-1]

    def _close(self) -> float:
        """March until the loop is measured closed.

        From the virgin state, for a contact that never slips keeps what its history left. A state that fades,
        like a bristle's, has one orbit only, and the last one found is a better start.
        """
        if self._fades:
            closure = self._close_from_here()
            if closure <= CLOSURE and radius(self._transitions) < 1.0 - NEUTRAL:
                return closure
        self._carried[:] = 0.0
        return self._close_from_here()

    def _close_from_here(self) -> float:
        if len(self._carried):
            self._march()
            self._carried[:] = self._marched
        n, closure = self._memory, np.inf
        for _ in range(MOST_PERIODS):
            self._period()
            if not self._solved and not self._last_try:
                return closure
            gap = self._end[:n] - self._carried[:n]
            if not gap.any() and not self._gap.any():  # friction that slips forgets where it came from
                return 0.0
            pull = self._pull
            closure = self._open_force(pull * gap)
            if not closure > CLOSURE or not gap.any():  # no other memory mends samples that are not solved
                break
            self._fades = True
            slope = np.eye(n) - monodromy(self._transitions) * pull[:, None] / pull
            self._carried[:n] += np.linalg.lstsq(slope, pull * gap, rcond=1e-9)[0] / pull
        return closure

    def _open_force(self, by_memory: Array) -> float:
        """Largest force that stands between two periods or is short of f = law(f), over the largest force."""
        missing = max(float(np.abs(by_memory).max(initial=0.0)), float(np.abs(self._gap).max()))
        largest = float(np.abs(self._forces).max())
        return missing / largest if largest > 0.0 else 0.0
