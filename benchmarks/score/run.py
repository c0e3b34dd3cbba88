"""Diagnosis of one case, and of all cases of a bank, each in a process of its own: the answers are not in its folder.

A process gets DATA/{rig.toml, spectra.csv} and writes one file with the diagnosis, the time it took and the commit.
What fails, even a process that dies, is recorded as failed with its last words.

Run: python -m benchmarks.score.run DATA OUT.json SET SEED
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.score.sets import poorer

if TYPE_CHECKING:
    from hbm import Diagnosis

ROOT = Path(__file__).parents[2]


def commit() -> str:
    """Of the code, with `-dirty` where files differ from it."""
    words = ["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--match", ""]
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip() or "unknown"


def write_json(path: Path, table: object) -> None:
    """A file that is there is complete."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(table, indent=1) + "\n")
    part.replace(path)


def diagnosed(data: Path, which: str, seed: int) -> dict[str, object]:
    """What the diagnosis says of the files of a folder, and how long it took."""
    from hbm import load_rig, load_spectra
    from hbm.diagnosis.diagnose import diagnose

    rig = load_rig(data / "rig.toml")
    spectra = poorer(which, rig, load_spectra(data / "spectra.csv", rig), seed, data.name)
    wall, cpu = time.perf_counter(), time.process_time()
    found = diagnose(rig, spectra)
    return {
        "diagnosis": found.json(),
        "lack_of_fit": lack_of_fit(found),
        "records": len(spectra),
        "seconds": round(time.perf_counter() - wall, 2),
        "cpu_seconds": round(time.process_time() - cpu, 2),
    }


def lack_of_fit(found: "Diagnosis") -> float:
    """Length of what the best of all models fitted leaves of the records fitted beyond noise, in standard deviations.

    An effect that is not in the catalogue and leaves nothing cannot be told from what is.
    """
    plain = [e for e in (found.nominal, found.calibrated, found.extended_fit) if e is not None]
    least = min([e.chi2 for e in plain] + [r.chi2 for r in found.ranking])
    return max(least - len(plain[0].white), 0.0) ** 0.5


def one(data: Path, out: Path, which: str, seed: int) -> str:
    """Diagnose a folder in a process of its own; say how it went."""
    began = time.perf_counter()
    words = [sys.executable, "-m", "benchmarks.score.run", *map(str, (data.resolve(), out.resolve(), which, seed))]
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    env = os.environ | {"PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(words, cwd=ROOT, env=env, capture_output=True, text=True, check=False)
    if done.returncode or not out.exists():
        last = (done.stderr.strip().splitlines() or [f"ended with status {done.returncode}"])[-1]
        failure = {"failed": last, "seconds": round(time.perf_counter() - began, 2)}
        write_json(out, failure | stamp(data.name, which, seed))
        return f"{data.name} failed: {last}"
    found = json.loads(out.read_text())
    verdict = found["diagnosis"]["cause"] or found["diagnosis"]["verdict"]
    return f"{data.name} {verdict}, {found['seconds']:.0f} s"


def stamp(name: str, which: str, seed: int) -> dict[str, object]:
    return {"case": name, "set": which, "seed": seed, "commit": commit()}


def run_all(folders: Sequence[Path], results: Path, which: str, seed: int, workers: int) -> Iterator[str]:
    """Diagnose every folder that has no result yet; a line as each is ready."""
    todo = [data for data in folders if not (results / f"{data.name}.json").exists()]
    with ThreadPoolExecutor(workers) as pool:
        jobs = [pool.submit(one, data, results / f"{data.name}.json", which, seed) for data in todo]
        try:
            for i, job in enumerate(as_completed(jobs), start=1):
                yield f"{i}/{len(todo)}  {job.result()}"
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            raise


if __name__ == "__main__":
    data, out, which, seed = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], int(sys.argv[4])
    write_json(out, stamp(data.name, which, seed) | diagnosed(data, which, seed))
