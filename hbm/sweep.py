"""The same task for many items, here or by an executor of ``concurrent.futures``."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, TypeVar

from hbm.threads import one_thread

Result = TypeVar("Result")

CHUNKS = 8
"""Items are handed over in so many parts: they take unequally long, and each part costs a message."""


def all_cores(prepare: Callable[[], None] | None = None) -> ProcessPoolExecutor:
    """Executor with a process for each core this one may run on, each prepared first."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None
    return ProcessPoolExecutor(cores, get_context("spawn"), prepare)


def each(executor: Executor | None, task: Callable[..., Result], *items: Sequence[Any]) -> list[Result]:
    """Results of a task for items, in their order.

    Parameters
    ----------
    executor : concurrent.futures.Executor or None
        Without one the items are done one after the other, here. One of processes needs a task that can be pickled.
    task : callable
    *items : sequence
        One sequence for each argument of the task.
    """
    if executor is None:
        return [task(*values) for values in zip(*items, strict=True)]
    size = max(1, len(items[0]) // CHUNKS)
    parts = [list(zip(*(values[i : i + size] for values in items), strict=True)) for i in range(0, len(items[0]), size)]
    return [result for part in executor.map(_part, [task] * len(parts), parts) for result in part]


@one_thread
def _part(task: Callable[..., Result], values: Sequence[tuple[Any, ...]]) -> list[Result]:
    return [task(*arguments) for arguments in values]
