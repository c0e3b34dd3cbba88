"""The same task for many items, here or by an executor of ``concurrent.futures``; and one BLAS thread for each.

Matrices here have some hundred rows: a second BLAS thread costs time, most of all on a busy machine.
"""

import os
import pickle
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, InvalidStateError, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import cache, partial, wraps
from multiprocessing import get_context, parent_process
from typing import Any, ParamSpec, TypeVar, cast

from threadpoolctl import ThreadpoolController

from hbm.interrupts import held, kill_workers

Inputs = ParamSpec("Inputs")
Result = TypeVar("Result")

CHUNKS = 8
"""Items are handed over in so many parts: they take unequally long, and each part costs a message."""


@cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController()


_here = threading.local()
"""Whether this thread runs a function that has one BLAS thread already."""


def one_thread(function: Callable[Inputs, Result]) -> Callable[Inputs, Result]:
    """Run a function with one BLAS thread."""

    @wraps(function)
    def limited(*args: Inputs.args, **kwargs: Inputs.kwargs) -> Result:
        if getattr(_here, "limited", False):  # to ask the libraries takes as long as some of what is run so
            return function(*args, **kwargs)
        with _libraries().limit(limits=1, user_api="blas"):
            _here.limited = True
            try:
                return function(*args, **kwargs)
            finally:
                _here.limited = False

    return limited


def cores() -> int:
    """Cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Helped(ProcessPoolExecutor):
    """Processes beside this one, which takes its part in what is mapped, and does all of it until they have started.

    Parameters
    ----------
    processes : int
    prepare : callable or None
        Done first by each of them.
    """

    def __init__(self, processes: int, prepare: Callable[[], None] | None = None) -> None:
        super().__init__(processes, get_context("spawn"), partial(_prepared, prepare))
        with held():  # processes inherit it: a terminal signals them too, and ending is for this one to order
            # a process starts with its first task, which may come late
            self._started = [self.submit(int) for _ in range(processes)]

    def map(
        self, fn: Callable[..., Result], *iterables: Iterable[Any], timeout: float | None = None, chunksize: int = 1
    ) -> Iterator[Result]:
        """As the executor's; items are done from the last on here, from the first on by processes, one at a time each.

        What a process had taken that was killed, as a system does that is short of memory, is done here too.
        """
        items = list(zip(*iterables, strict=True))
        left, there, turn = deque(range(len(items))), dict[int, Future[Result]](), threading.RLock()

        def hand_over(_: object = None) -> None:
            """Let a process have the first item left: by itself an executor hands each of them one more in advance."""
            with turn, suppress(RuntimeError):  # processes were killed, or end
                if left:
                    there[left[0]] = future = self.submit(fn, *items[left[0]])
                    left.popleft()
                    future.add_done_callback(hand_over)

        def last() -> int | None:
            with turn:
                return left.pop() if left else None

        here, mine = dict[int, Result](), last()
        try:
            for _ in self._started if all(start.done() for start in self._started) else ():
                hand_over()
            while mine is not None:
                here[mine] = fn(*items[mine])
                mine = last()
        finally:
            left.clear()
        for i, future in there.items():
            try:
                here[i] = future.result(timeout)
            except BrokenProcessPool:
                here[i] = fn(*items[i])
        return iter([here[i] for i in range(len(items))])


@contextmanager
def all_cores(prepare: Callable[[], None] | None = None) -> Iterator[Helped | None]:
    """Executor for all cores this process may run on, itself among them; None where that is one.

    Its other processes are prepared first, at once. Where the work ends early, by an error or an interrupt, they are
    killed and nothing is waited for.
    """
    if cores() == 1:
        yield None
        return
    executor = Helped(cores() - 1, prepare)
    with unconcerned():
        try:
            yield executor
        except BaseException:
            kill_workers()
            _hear_no_more(executor)
            executor.shutdown(cancel_futures=True)
            raise
        executor.shutdown()


def _hear_no_more(executor: ProcessPoolExecutor) -> None:
    """Let the thread that reads results end, whose processes were killed.

    One killed within a message leaves that thread waiting for the rest, as long as this process could still write it.
    """
    executor._result_queue._writer.close()  # type: ignore[attr-defined]


@contextmanager
def unconcerned() -> Iterator[None]:
    """Say nothing of a thread that fails a task which was cancelled: that of an executor whose processes are killed.

    They are killed here, or by a system that is short of memory while what no process has taken is cancelled.
    """
    before = threading.excepthook

    def hook(failed: threading.ExceptHookArgs) -> None:
        if not issubclass(failed.exc_type, InvalidStateError):
            before(failed)

    threading.excepthook = hook
    try:
        yield
    finally:
        threading.excepthook = before


def _prepared(prepare: Callable[[], None] | None) -> None:
    """Prepare a process, which ends when the one that started it does, however that ends."""
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    if prepare is not None:
        prepare()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)


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
    pickled = pickle.dumps(task)
    _keep(pickled, task)
    return [result for part in executor.map(_part, [pickled] * len(parts), parts) for result in part]


@one_thread
def _part(pickled: bytes, values: Sequence[tuple[Any, ...]]) -> list[Any]:
    if pickled not in _kept:
        _keep(pickled, cast(Callable[..., Any], pickle.loads(pickled)))
    task = _kept[pickled]
    return [task(*arguments) for arguments in values]


_kept: dict[bytes, Callable[..., Any]] = {}
"""The last task, one for all parts that a process does: a rig in it is worked out once."""


def _keep(pickled: bytes, task: Callable[..., Any]) -> None:
    _kept.clear()
    _kept[pickled] = task
