"""A command that is told to end: in time, with its status, without a process or half a file left."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
DIAGNOSED = EXAMPLES / "diagnosed_beam"
DIAGNOSIS = ("diagnose", str(DIAGNOSED / "rig.toml"), str(DIAGNOSED / "spectra.csv"), "--out")
WORKERS = 2
LIMIT = 3.0

pytestmark = pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for processes in /proc")


def started(*arguments: str) -> subprocess.Popen[str]:
    """A command, the leader of a session in which its processes are found again."""
    return subprocess.Popen(
        [sys.executable, "-m", "hbm.cli", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def session(leader: int) -> list[int]:
    """Processes of a session that are alive."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            state, *numbers = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it ended meanwhile
        if int(numbers[2]) == leader and state not in "ZX":
            found.append(int(folder.name))
    return found


def wait_until_alone(leader: int, limit: float) -> bool:
    end = time.monotonic() + limit
    while session(leader) and time.monotonic() < end:
        time.sleep(0.05)
    return not session(leader)


def wait_for_workers(leader: int) -> None:
    end = time.monotonic() + 20
    while len(session(leader)) < 1 + WORKERS and time.monotonic() < end:
        time.sleep(0.05)
    time.sleep(2.0)  # they compute


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_diagnosis_ends_with_its_workers(number: signal.Signals, tmp_path: Path) -> None:
    run = started(*DIAGNOSIS, str(tmp_path / "out"))
    wait_for_workers(run.pid)
    begin = time.monotonic()
    run.send_signal(number)
    out, said = run.communicate(timeout=30)
    assert wait_until_alone(run.pid, LIMIT)
    assert time.monotonic() - begin < LIMIT
    assert (run.returncode, out, said) == (128 + number, "", "hbm: interrupted, nothing half written\n")
    assert list(tmp_path.iterdir()) == []


def test_workers_of_a_killed_diagnosis_end_too(tmp_path: Path) -> None:
    run = started(*DIAGNOSIS, str(tmp_path / "out"))
    wait_for_workers(run.pid)
    run.kill()
    run.communicate()
    assert wait_until_alone(run.pid, LIMIT)
    assert list(tmp_path.iterdir()) == []


def test_a_command_started_deaf_to_interrupts_still_ends(tmp_path: Path) -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell without a terminal does behind &
    try:
        run = started("simulate", str(EXAMPLES / "paper_beam.toml"), "--frequency", "50", "--duration", "60")
    finally:
        signal.signal(signal.SIGINT, before)
    time.sleep(3.0)
    os.kill(run.pid, signal.SIGINT)
    run.communicate(timeout=30)
    assert run.returncode == 130


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("where", ["exec('import os, signal; os.kill(os.getpid(), {0})')", "os.kill(os.getpid(), {0})"])
def test_the_status_is_that_of_the_signal_wherever_it_meets_the_command(number: signal.Signals, where: str) -> None:
    """CPython remembers an interrupt within ``exec``, of which dataclasses are made, and ends by SIGINT for any."""
    code = f"import os, hbm.cli; hbm.cli.app = lambda **_: {where.format(int(number))}; hbm.cli.main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (128 + number, "hbm: interrupted, nothing half written\n")


@pytest.mark.skipif(shutil.which("timeout") is None, reason="coreutils")
def test_timeout_ends_a_command(tmp_path: Path) -> None:
    command = ("simulate", str(EXAMPLES / "paper_beam.toml"), "--frequency", "50", "--duration", "60")
    done = subprocess.run(
        [
            "timeout",
            "--preserve-status",
            "3",
            sys.executable,
            "-m",
            "hbm.cli",
            *command,
            "--out",
            str(tmp_path / "h.csv"),
        ],
        capture_output=True,
        timeout=30,
    )
    assert done.returncode == 143
    assert list(tmp_path.iterdir()) == []
