"""Work that this process shares with others: each item is done once, here or there, and results keep their order."""

import os
import time
from pathlib import Path

import pytest

from hbm.parallel import Helped, all_cores, each, unconcerned


def where(item: int) -> tuple[int, int]:
    """The item, and the process that does it, which takes some time."""
    time.sleep(0.02)
    return item, os.getpid()


def inverse(x: float) -> float:
    time.sleep(0.02)
    return 1.0 / x


def slow_to_start() -> None:
    time.sleep(1.0)


def started(executor: Helped) -> int:
    """The other process, once it runs."""
    return executor.submit(os.getpid).result()


def test_items_are_done_here_and_there_and_stay_in_order() -> None:
    with Helped(1) as executor:
        other = started(executor)
        found = list(executor.map(where, range(12)))
    assert [item for item, _ in found] == list(range(12))
    assert {process for _, process in found} == {os.getpid(), other}


def test_one_item_is_done_here() -> None:
    with Helped(1) as executor:
        started(executor)
        assert list(executor.map(where, [5])) == [(5, os.getpid())]
        assert list(executor.map(where, [])) == []


def waits_for_second(item: int, seen: Path) -> int:
    """The item; the first one ends once the second was begun, or after some seconds."""
    if item == 1:
        seen.touch()
    for _ in range(1 if item else 100):
        if seen.exists():
            break
        time.sleep(0.05)
    assert item or seen.exists()
    return item


def test_no_item_waits_for_one_that_a_process_is_at(tmp_path: Path) -> None:
    """It would be done last of all if the process had it in advance, as executors do."""
    with Helped(1) as executor:
        started(executor)
        assert list(executor.map(waits_for_second, range(4), [tmp_path / "seen"] * 4)) == list(range(4))


def test_nothing_waits_for_a_process_to_start() -> None:
    with Helped(1, slow_to_start) as executor:
        assert each(executor, where, range(3)) == [(i, os.getpid()) for i in range(3)]


@pytest.mark.parametrize("at", [0, 3])
def test_an_error_is_raised_wherever_it_is(at: int) -> None:
    values = [1.0] * 4
    values[at] = 0.0
    with Helped(1) as executor:
        started(executor)
        with pytest.raises(ZeroDivisionError):
            list(executor.map(inverse, values))


def ends_elsewhere(item: int, process: int) -> int:
    """The item; in any other process than this one no more than its end."""
    if os.getpid() != process:
        os._exit(1)
    return item


def test_what_a_process_had_taken_that_was_killed_is_done_here() -> None:
    with unconcerned(), Helped(1) as executor:
        started(executor)
        for _ in range(2):  # the second time there is none any more
            assert list(executor.map(ends_elsewhere, range(6), [os.getpid()] * 6)) == list(range(6))


def test_one_core_needs_no_other_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hbm.parallel.cores", lambda: 1)
    with all_cores() as executor:
        assert executor is None
    assert each(None, inverse, [2.0]) == [0.5]
