"""A bank of blind cases: python -m benchmarks.blind_cases --seed 1 --count 40 --set E --out /tmp/bank.

Writes OUT/data/NNNN/{rig.toml, spectra.csv} and OUT/answers/NNNN.json; what exists is left alone. Case n has the seed
SEED + n. With --per-rig k, k cases in turn share a rig, its records and its run without a cause: twice as fast.
--background LOW HIGH: imperfections in every rig, of a size drawn between these (0 0.01: up to 1 % of the response).
--plan: null first, then each cause of the catalogue, then those outside it, over and over, instead of draws.
"""

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tests.truth.blind import SETS, Unfit, draw, write_case
from tests.truth.hidden import CATALOGUE, OUTSIDE


def planned(n: int, per_rig: int) -> str | None:
    """Each rig a null, then the causes in turn; special nominal laws last of a rig's cases."""
    rig, place = divmod(n, per_rig)
    names = [*CATALOGUE, *OUTSIDE]
    return None if place == 0 else names[(rig * (per_rig - 1) + place - 1) % len(names)]


def make(n: int, args: argparse.Namespace) -> str:
    """Make case n, and say how it went."""
    data, answer = args.out / "data" / f"{n:04d}", args.out / "answers" / f"{n:04d}.json"
    if answer.exists() and (data / "spectra.csv").exists():
        return f"{n:04d} is there"
    began = time.perf_counter()
    cause = planned(n, args.per_rig) if args.plan else "any"
    rig_seed = args.seed + n - n % args.per_rig
    try:
        case = draw(
            args.seed + n,
            args.set,
            cause,
            rig_seed,
            (args.rho[0], args.rho[1]),
            args.tolerances,
            background=None if args.background is None else (args.background[0], args.background[1]),
        )
    except Unfit as why:
        return f"{n:04d} left out: {why} ({cause}, {time.perf_counter() - began:.0f} s)"
    write_case(data, answer, case)
    a = case.answer
    return (
        f"{n:04d} {a['drawn']}: rho {a['rho']:.0f} (aimed at {a['rho_target']:.0f}, one record "
        f"{a['largest_share']:.0%}), effect {a['effect']:.2%}, background {a['background']:.2%}, "
        f"{a['usable']} of {a['records']} records, {a['snr_db']} dB, {time.perf_counter() - began:.0f} s"
    )


def summary(out: Path) -> str:
    counts: dict[str, int] = {}
    for path in sorted((out / "answers").glob("*.json")):
        name = str(json.loads(path.read_text())["drawn"])
        counts[name] = counts.get(name, 0) + 1
    return ", ".join(f"{name} {count}" for name, count in sorted(counts.items()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--set", choices=SETS, default="E")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--per-rig", type=int, default=1)
    parser.add_argument("--plan", action="store_true")
    parser.add_argument("--tolerances", action="store_true")
    parser.add_argument("--background", type=float, nargs=2, metavar=("LOW", "HIGH"))
    parser.add_argument("--rho", type=float, nargs=2, default=(50.0, 3000.0))
    args = parser.parse_args()
    began, todo = time.perf_counter(), range(args.count)
    if args.workers > 1:
        with ProcessPoolExecutor(args.workers) as pool:
            for line in pool.map(make, todo, [args] * len(todo)):
                print(line, flush=True)
    else:
        for n in todo:
            print(make(n, args), flush=True)
    print(f"{time.perf_counter() - began:.0f} s; in the bank: {summary(args.out)}")


if __name__ == "__main__":
    main()
