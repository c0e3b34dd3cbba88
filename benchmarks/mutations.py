"""Damaged rigs, matrices, spectra and histories read and computed with, one after the other: how does each of them end?

    python benchmarks/mutations.py --rigs 500 --matrices 100 --spectra 200 --histories 50 --seed 1

Every damaged file is read as the commands read it, and a short computation is done with what is accepted. One worker
process does it on one core, with a limit of time and memory; it is replaced where a limit is met. An end is

- refused: one line that names the file;
- not solved: one line of a computation that did not converge, or whose numbers ran out of bounds;
- accepted: finite numbers; of a rig the energy balance closes; of a neutral change what its twin gives;
- wrong: accepted, and one of these does not hold;
- traceback: any other exception, a warning of NumPy, or a line that is of a library's inside and names no key;
- over time.
"""

import argparse
import gc
import multiprocessing
import os
import re
import resource
import shutil
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.mutants import HZ, ROOT, Mutant, histories, history_twins, spectra
from benchmarks.rigmutants import TWINS, matrices, rigs

LIMIT = 60.0
"""Seconds of CPU for one file."""
MEMORY = 6 * 2**30
"""Bytes of address space of the worker."""
MOST_MARCHED = 40
"""Modes up to which motion is integrated in time: what a step takes grows with the square of their number."""
ENDS = ("refused", "not solved", "accepted", "wrong", "traceback", "over time")
INSIDE = re.compile(
    r"svd|singular|infs or nans|numerical result|division by zero|broadcast|out of bounds for|out of range|"
    r"object has no|not supported between|unsupported operand|cannot convert|reshape|unpack|subscriptable|overflow|"
    r"encountered in|casadi|nonetype|keyerror|positive.definite|input should|not contain",
    re.IGNORECASE,
)
"""Words of libraries that say nothing to a user."""


# ------------------------------------------------------------------------------------------------ short computations


def of_rig(path: Path) -> dict[str, Any]:
    """What a rig gives, in numbers: modes, a steady state, a short curve, three periods from rest."""
    from hbm import linear_modes, load_rig, simulate, steady_state, trace_frequency

    rig = load_rig(path, allow_code=True)
    str(rig), repr(rig)
    modes = linear_modes(rig)
    first = float(next((f for f in modes.sliding_hz if f > 0.0), 1.0))
    point = steady_state(rig, 0.93 * first, harmonics=5)
    curve = trace_frequency(rig, (0.93 * first, 0.94 * first), harmonics=3)
    few = len(modes.sliding_hz) <= MOST_MARCHED
    history = simulate(rig, 0.93 * first, duration=3.0 / first, steps_per_period=64) if few else None
    return {
        "hz": modes.sliding_hz,
        "drive": point["drive"].coefficients,
        "energy": point.energy_error * _dissipates(point),
        "curve": np.array([p["drive"].peak for p in curve.points]),
        "history": history.channels["drive"].values if history is not None else 0.0,
    }


def of_matrix(path: Path) -> dict[str, Any]:
    """What the rig of the bar gives whose stiffness is in a file."""
    rig = path.with_name("bar.toml")
    rig.write_text((TWINS / "matrix.toml").read_text(encoding="utf-8").replace("K.mtx", path.name), encoding="utf-8")
    return of_rig(rig)


def _dissipates(point: Any) -> bool:
    """Whether energy is supplied beyond what rounding leaves of the force times the motion."""
    drive = point["drive"].coefficients
    H = (len(drive) - 1) // 2
    return bool(abs(drive[1 + H]) > 1e-8 * np.hypot(drive[1], drive[1 + H]))


def of_spectra(path: Path, rig: Path) -> dict[str, Any]:
    """What spectra give: the contact of their first two records; and a mode, of which nothing is compared."""
    from hbm import InputError, load_rig, load_spectra, reconstruct
    from hbm.identification.modalfit import fit_modes
    from hbm.measurement.responses import frequency_responses

    loaded = load_rig(rig)
    measured = load_spectra(path, loaded)
    repr(measured)
    with suppress(InputError):  # no force, or too few frequencies
        fit_modes(frequency_responses(measured, "force", {"a1": "acceleration"}), 1)
    found = reconstruct(loaded, measured.select(records=measured.records[:2].tolist()))
    return {name: found[name].samples for name in ("friction", "slip")}


def of_history(path: Path) -> dict[str, Any]:
    """What a history gives: its channels, and their harmonics."""
    from hbm import InputError, harmonic_spectra, load_history
    from hbm.measurement.decay import free_decay
    from hbm.measurement.sweep import sweep_spectra, swept

    recorded = load_history(path)
    estimate = harmonic_spectra(recorded, HZ, 5)
    with suppress(InputError):  # it is neither a sweep nor a decay
        sweep_spectra([swept(recorded, "force", 1)], "force")
    with suppress(InputError):
        free_decay(recorded, "a1", (0.5 * HZ, 1.5 * HZ))
    return {
        **{f"samples of {name}": values for name, values in recorded.channels.items()},
        **{name: estimate.amplitude(name) for name in estimate.channels},
    }


def computed(mutant: Mutant, path: Path) -> dict[str, Any]:
    """What a mutant, or its twin, at a path gives."""
    if mutant.kind == "rig":
        return of_rig(path)
    if mutant.kind == "matrix":
        return of_matrix(path)
    return of_history(path) if mutant.kind == "history" else of_spectra(path, Path(mutant.twin).with_name("rig.toml"))


# --------------------------------------------------------------------------------------------------------- judgement


def end_of(mutant: Mutant, folder: Path, twins: dict[str, Any]) -> tuple[str, str]:
    """How a mutant ends, and what was said."""
    from hbm import ConvergenceError, InputError
    from models.plausible import PlausibilityWarning

    path = folder / f"mutant{mutant.ending}"
    path.write_bytes(mutant.content)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", PlausibilityWarning)
            found = computed(mutant, path)
    except InputError as refused:
        said = str(refused)
        clean = "\n" not in said and said.isprintable() and not INSIDE.search(said) and len(said) < 2000
        return ("refused" if clean else "traceback"), said
    except (ConvergenceError, ArithmeticError) as failed:
        clean = type(failed) in (ConvergenceError, ArithmeticError) and not INSIDE.search(str(failed))
        return ("not solved" if clean else "traceback"), f"{type(failed).__name__}: {failed}{_where(failed)}"
    except MemoryError:
        return "traceback", "out of memory"
    except Exception as failed:
        return "traceback", f"{type(failed).__name__}: {failed}{_where(failed)}"
    return _judged(mutant, found, twins, folder)


def _where(failed: BaseException) -> str:
    frames = [f for f in traceback.extract_tb(failed.__traceback__) if "/site-packages/" not in f.filename]
    return " at " + " < ".join(f"{Path(f.filename).name}:{f.lineno}" for f in frames[-1:-4:-1])


def _judged(mutant: Mutant, found: dict[str, Any], twins: dict[str, Any], folder: Path) -> tuple[str, str]:
    for name, values in found.items():
        if not np.isfinite(values).all():
            return "wrong", f"{name} is not finite"
    if abs(found.get("energy", 0.0)) > 1e-6:
        return "wrong", f"energy balance open by {found['energy']:.2g}"
    if not (mutant.neutral or mutant.cut):
        return "accepted", ""
    if mutant.twin not in twins:
        path = Path(mutant.twin)
        if mutant.kind == "history":
            path = folder / f"twin{mutant.ending}"
            path.write_bytes(history_twins()[mutant.twin])
        twins[mutant.twin] = computed(mutant, path)
    twin = twins[mutant.twin]
    if mutant.neutral and any(not np.array_equal(found[name], twin[name]) for name in twin):
        return "wrong", "not what its twin gives"
    if mutant.kind == "history" and mutant.cut:
        for name in (n for n in found if n.startswith("samples")):  # a last number may have lost digits
            if not np.array_equal(found[name][:-1], twin[name][: len(found[name]) - 1]):
                return "wrong", f"{name} are not a beginning of its twin's"
    return "accepted", ""


# ------------------------------------------------------------------------------------------------------------ worker


def work(pipe: Connection) -> None:
    """Judge mutants that come through a pipe, one after the other."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    twins: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as said:
        os.dup2(said.fileno(), 2)  # whatever a library prints
        shutil.copy(ROOT / "examples" / "bouc_wen.py", folder)  # one of the rigs names it
        for file in TWINS.glob("*.mtx"):
            shutil.copy(file, folder)
        while (mutant := pipe.recv()) is not None:
            end = end_of(mutant, Path(folder), twins)
            gc.collect()
            sys.stderr.flush()
            if said.tell():
                said.seek(0)
                end = "traceback", f"printed: {said.read().decode(errors='replace')}"
                said.seek(0)
                said.truncate()
            pipe.send(end)


class Worker:
    """A process that judges mutants, made anew where one takes too long or dies."""

    def __init__(self) -> None:
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=work, args=(other,), daemon=True)
        self.process.start()
        other.close()

    def end(self, mutant: Mutant) -> tuple[str, str]:
        """How a mutant ends."""
        self.pipe.send(mutant)
        begin = self.seconds()
        try:
            while not self.pipe.poll(1.0) and self.seconds() - begin < LIMIT:
                pass
            if self.pipe.poll():
                result: tuple[str, str] = self.pipe.recv()
                return result
            said = "over time", f"more than {LIMIT:g} s"
        except EOFError:
            said = "traceback", "the process died"
        self.process.kill()
        self.process.join()
        self._start()
        return said

    def seconds(self) -> float:
        """CPU time of the process."""
        user, system = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    def close(self) -> None:
        """End the process."""
        self.pipe.send(None)
        self.process.join()


def run(mutants: Iterable[Mutant], worker: Worker, keep: Path | None) -> tuple[Counter[str], list[str], float]:
    """Count the ends of mutants; what was not as it should be in words, and the longest CPU time."""
    counts: Counter[str] = Counter()
    bad: list[str] = []
    longest = 0.0
    for number, mutant in enumerate(mutants):
        begin = worker.seconds()
        end, said = worker.end(mutant)
        longest = max(longest, worker.seconds() - begin)
        counts[end] += 1
        if end in ("wrong", "traceback", "over time"):
            bad.append(f"{end}: {mutant.kind} {number} of {Path(mutant.twin).name}, {mutant.what}: {said!r:.300}")
            print(bad[-1], flush=True)
            if keep is not None:
                keep.mkdir(parents=True, exist_ok=True)
                (keep / f"{mutant.kind}{number}{mutant.ending}").write_bytes(mutant.content)
    return counts, bad, longest


def main() -> int:
    """Print one table; status 1 if anything ended as it should not."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    made = {"rigs": rigs, "matrices": matrices, "spectra": spectra, "histories": histories}
    for name in made:
        parser.add_argument(f"--{name}", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the files that did not end as they should")
    given = parser.parse_args()
    worker, failed = Worker(), 0
    table = ["| files | " + " | ".join(ENDS) + " | longest |", "|---|" + "---:|" * (len(ENDS) + 1)]
    for name, make in made.items():
        count = getattr(given, name)
        counts, bad, longest = run(make(given.seed, count), worker, given.keep)
        failed += len(bad)
        table.append(f"| {count} {name} | " + " | ".join(str(counts[end]) for end in ENDS) + f" | {longest:.1f} s |")
    worker.close()
    print(*table, sep="\n")
    return int(failed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
