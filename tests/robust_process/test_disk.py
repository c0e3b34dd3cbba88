"""Results on a disk that is full, in a folder that cannot be written, or that another run writes into."""

import errno
import fcntl
import os
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from hbm.errors import InputError
from hbm.files.outputs import write_folder

RESULT = {"a.csv": "new", "figures/b.png": b"new", "c.json": "new"}


@pytest.fixture
def full_after(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Call with a number: so many files still fit on the disk."""

    def fill(files: int) -> None:
        real, made = tempfile.mkstemp, []

        def mkstemp(*args: str, **options: str) -> tuple[int, str]:
            if len(made) == files:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            made.append(1)
            return real(*args, **options)

        monkeypatch.setattr(tempfile, "mkstemp", mkstemp)

    return fill


def everything(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("fits", [0, 1, 2])
def test_a_full_disk_leaves_no_folder(fits: int, tmp_path: Path, full_after: Callable[[int], None]) -> None:
    full_after(fits)
    with pytest.raises(InputError, match=r"cannot be written \(no space left on device\)"):
        write_folder(tmp_path / "out", RESULT)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("fits", [0, 1, 2])
def test_a_full_disk_keeps_the_result_of_an_earlier_run(
    fits: int, tmp_path: Path, full_after: Callable[[int], None]
) -> None:
    write_folder(tmp_path, dict.fromkeys([*RESULT, "extended.toml"], "old"))
    full_after(fits)
    with pytest.raises(InputError, match="no space left"):
        write_folder(tmp_path, RESULT, owned=["extended.toml"])
    assert everything(tmp_path) == dict.fromkeys([*RESULT, "extended.toml"], b"old")


def test_files_of_an_earlier_run_do_not_stay_beside_a_new_result(tmp_path: Path) -> None:
    write_folder(tmp_path, {"a.csv": "old", "extended.toml": "old"})
    (tmp_path / "notes.txt").write_text("mine")
    write_folder(tmp_path, RESULT, owned=["a.csv", "extended.toml"])
    assert everything(tmp_path) == dict.fromkeys(RESULT, b"new") | {"notes.txt": b"mine"}


def test_two_runs_do_not_mix_their_files(tmp_path: Path) -> None:
    opened = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(opened, fcntl.LOCK_EX)  # another run is at it
    second = threading.Thread(target=write_folder, args=(tmp_path, RESULT))
    second.start()
    second.join(0.2)
    assert second.is_alive()
    assert everything(tmp_path) == {}
    os.close(opened)
    second.join(10.0)
    assert everything(tmp_path) == dict.fromkeys(RESULT, b"new")
