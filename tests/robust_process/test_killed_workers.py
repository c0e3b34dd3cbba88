"""Processes that are killed in the middle of what they say: the one that started them goes on at once."""

import subprocess
import sys
from pathlib import Path

HALF = '''
import os, struct, sys, time
from hbm import parallel

def say_half() -> None:
    """Begin a message of 1000 bytes to the parent, and never send them."""
    frame = sys._getframe()
    while "result_queue" not in frame.f_locals:
        frame = frame.f_back
    os.write(frame.f_locals["result_queue"]._writer.fileno(), struct.pack("!i", 1000))
    open(sys.argv[1], "w").close()
    time.sleep(60.0)

if __name__ == "__main__":
    parallel.cores = lambda: 2
    try:
        with parallel.all_cores() as executor:
            executor.submit(say_half)
            while not os.path.exists(sys.argv[1]):
                time.sleep(0.01)
            time.sleep(0.2)  # the parent begins to read
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        print("left")
'''


def test_an_interrupt_does_not_wait_for_the_rest_of_a_message(tmp_path: Path) -> None:
    script = tmp_path / "half.py"
    script.write_text(HALF)
    words = [sys.executable, str(script), str(tmp_path / "begun")]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "left\n", "")
