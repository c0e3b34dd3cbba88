"""Signals that end a command: SIGINT and SIGTERM stop it at once, but never between the files of one result.

A command that has spent its time is ended in the same way, by itself (:func:`within`).

A command that is told to end raises ``KeyboardInterrupt`` where it is, keeps or drops what it has, and ends by itself.
One that has not ended after :data:`GRACE` is ended where it stands; files appear by renaming, so none is half there.
"""

import os
import signal
import sys
import threading
from _thread import interrupt_main
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import active_children
from types import FrameType

GRACE = 2.5
"""Seconds that a command has to keep what is complete."""

SIGNALS = (signal.SIGINT, signal.SIGTERM)

_received: list[int] = []
_spent: list[str] = []
_holding: list[bool] = []


def listen() -> None:
    """End this process by either signal, also where its parent had it ignore them, as a shell does behind ``&``."""
    _received.clear()
    for number in SIGNALS:
        signal.signal(number, _interrupt)


def _interrupt(number: int, _: FrameType | None) -> None:
    if _received:
        return  # it is ending already; a second signal would only cost what it is keeping
    _received.append(number)
    last_resort = threading.Timer(GRACE, _end)
    last_resort.daemon = True
    last_resort.start()
    if not _holding:
        raise KeyboardInterrupt


def _end() -> None:
    kill_workers()
    ended = _spent[0] if _spent else "hbm: interrupted, and ended before all was kept; no file is half written"
    print(ended, file=sys.stderr, flush=True)
    os._exit(status())


def kill_workers() -> None:
    """End the processes that this one started."""
    for worker in active_children():
        worker.kill()


def ending() -> bool:
    """Whether the command was told to end."""
    return bool(_received)


def status() -> int:
    """Exit status of an interrupted command: 128 and the number of the signal; 1 where it has spent its time."""
    return 1 if _spent else 128 + (_received[0] if _received else signal.SIGINT)


def said() -> str:
    """What an interrupted command says."""
    return _spent[0] if _spent else "hbm: interrupted, nothing half written"


def conclude() -> None:
    """End the process here where it was told to end.

    An interpreter that shuts down after an interrupt takes its time, and may give the status of another signal.
    """
    _holding.append(True)  # from here on it ends by itself
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    if _received:
        kill_workers()
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError):  # nobody reads it any more
                stream.flush()
        os._exit(status())


@contextmanager
def within(seconds: float, spent: Callable[[], str]) -> Iterator[None]:
    """Interrupt the command where what is done here takes longer; `spent` gives what it then says."""

    def spend() -> None:
        _spent.append(spent())
        if hasattr(signal, "pthread_kill"):
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)  # wakes it where it waits
        else:
            interrupt_main()

    timer = threading.Timer(seconds, spend)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()  # what was spent just now interrupts here, not what follows
    if _spent:  # a destructor that was running swallowed the interrupt
        raise KeyboardInterrupt


@contextmanager
def held() -> Iterator[None]:
    """Hold both signals back until this is done; processes started meanwhile never see them."""
    masked = hasattr(signal, "pthread_sigmask")
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS) if masked else set()
    known = len(_received)
    _holding.append(True)  # a thread of a library may still take a signal for this one
    try:
        yield
    finally:
        _holding.pop()
        if masked:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    if len(_received) > known:
        raise KeyboardInterrupt
