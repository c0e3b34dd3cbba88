"""The same task for many items, here or by an executor of ``concurrent.futures``; and one BLAS thread for each.

Matrices here have some hundred rows: a second BLAS thread costs time, most of all on a busy machine.
"""

import os
import pickle
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from functools import cache, lru_cache, wraps
from multiprocessing import get_context
from typing import Any, ParamSpec, TypeVar, cast

from threadpoolctl import ThreadpoolController

Inputs = ParamSpec("Inputs")
Result = TypeVar("Result")

CHUNKS = 8
"""Items are handed over in so many parts: they take unequally long, and each part costs a message."""


@cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController()


def one_thread(function: Callable[Inputs, Result]) -> Callable[Inputs, Result]:
    """Run a function with one BLAS thread."""

    @wraps(function)
    def limited(*args: Inputs.args, **kwargs: Inputs.kwargs) -> Result:
        with _libraries().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


def all_cores(prepare: Callable[[], None] | None = None) -> ProcessPoolExecutor:
    """Executor with a process for each core this one may run on, each prepared first, at once."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    executor = ProcessPoolExecutor(cores, get_context("spawn"), prepare)
    for _ in range(cores):  # a process starts with its first task, which may come late
        executor.submit(int)
    return executor


def each(executor: Executor | None, task: Callable[..., Result], *items: Sequence[Any]) -> list[Result]:
    """Results of a task for items, in their order.

    Parameters
    ----------
    executor : concurrent.futures.Executor or None
        Without one the items are done one after the other, here.
    task : callable
        One that can be pickled, where there is an executor.
    *items : sequence
        One sequence for each argument of the task.
    """
    if executor is None:
        return [task(*values) for values in zip(*items, strict=True)]
    size = max(1, len(items[0]) // CHUNKS)
    parts = [list(zip(*(values[i : i + size] for values in items), strict=True)) for i in range(0, len(items[0]), size)]
    return [result for part in executor.map(_part, [pickle.dumps(task)] * len(parts), parts) for result in part]


@one_thread
def _part(pickled: bytes, values: Sequence[tuple[Any, ...]]) -> list[Any]:
    task = _unpickled(pickled)
    return [task(*arguments) for arguments in values]


@lru_cache(maxsize=1)
def _unpickled(task: bytes) -> Callable[..., Any]:
    """A task, one for all parts that a process does: a rig in it is worked out once."""
    return cast(Callable[..., Any], pickle.loads(task))
