"""The score of the diagnosis over a bank of blind cases: right names, false alarms, abstentions, against the ceiling.

    python -m benchmarks.blind_cases --seed 1 --count 84 --set E --plan --per-rig 6 --background 0 0.01 --out /tmp/bank
    python -m benchmarks.diagnosis --bank /tmp/bank --out /tmp/score --workers 2

Runs `diagnose` on every case, in a process that sees nothing but BANK/data/NNNN, then opens the answers. --set makes
poorer sets of a bank E (`benchmarks/score/sets.py`), --nulls N measures the truth of every null N times more, --rigs N
is from how many rigs the ceiling is computed. What is in OUT already is kept: a run goes on where it stopped.

OUT/results/NNNN.json: a diagnosis each; OUT/score.json, score.md: the table; OUT/confusion.png, top1.png.
"""

import argparse
import json
import shutil
from collections.abc import Iterator, Sequence
from datetime import date
from pathlib import Path

import numpy as np

from benchmarks.score.ceiling import RHO, Allowed, allowed, average
from benchmarks.score.figures import confusion_figure, top1_figure
from benchmarks.score.page import markdown
from benchmarks.score.rates import confusion, reliability, table
from benchmarks.score.rules import Outcome, load_outcome
from benchmarks.score.run import commit, run_all, write_json
from benchmarks.score.sets import SETS, poorer
from hbm import load_rig, load_spectra
from tests.truth.blind import draw, measured_again, truth_beside, write_measured, write_truth

DPI = 220


def answers(bank: Path) -> dict[str, dict[str, object]]:
    """By the name of the case."""
    return {path.stem: json.loads(path.read_text()) for path in sorted((bank / "answers").glob("*.json"))}


def cases(bank: Path) -> list[Path]:
    """Folders with complete data."""
    known = {path.stem for path in (bank / "answers").glob("*.json")}
    return [data for data in sorted((bank / "data").iterdir()) if data.name in known]


def more_nulls(bank: Path, out: Path, count: int, seed: int) -> Iterator[Path]:
    """Every null of the bank measured again so many times; its truth is made again where it was not kept."""
    for name, answer in answers(bank).items():
        if answer["drawn"] is not None or not count:
            continue
        kept = truth_beside(bank / "answers" / f"{name}.json")
        if not kept.exists():
            kept = out / "truth" / f"{name}.npz"
            make_truth(kept, answer)
        for k in range(count):
            data = out / "data" / f"{name}-{k:04d}"
            if not (data / "spectra.csv").exists():
                data.mkdir(parents=True, exist_ok=True)
                shutil.copy(bank / "data" / name / "rig.toml", data)
                spectra, numbers = measured_again(kept, np.random.default_rng([seed, *name.encode(), k]))
                write_measured(data / "spectra.csv", spectra, numbers)
            yield data


def make_truth(path: Path, answer: dict[str, object]) -> None:
    """The truth of a null, simulated again."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        seed, rig_seed, which = int(str(answer["seed"])), int(str(answer["rig_seed"])), str(answer["set"])
        sizes = answer.get("background_range")
        background = None if sizes is None else (float(sizes[0]), float(sizes[1]))
        case = draw(seed, which, None, rig_seed, tolerances=bool(answer["tolerances"]), background=background)
        write_truth(path, case)


def outcomes(bank: Path, out: Path) -> list[Outcome]:
    """Of all cases that have a result, nulls that were measured again among them."""
    known = answers(bank)
    found = []
    for results, folders in ((out / "results", bank / "data"), (out / "null-results", out / "nulls" / "data")):
        for path in sorted(results.glob("*.json")):
            answer = known.get(path.stem.partition("-")[0])
            if answer is not None:
                found.append(load_outcome(json.loads(path.read_text()), answer, folders / path.stem / "rig.toml"))
    return found


def ceiling(bank: Path, out: Path, which: str, seed: int, rigs: int) -> Iterator[str]:
    """Compute that of some rigs of the bank, one case without a cause of its own law each, where it is not there."""
    first = {answer["rig_seed"]: name for name, answer in reversed(answers(bank).items()) if answer["drawn"] is None}
    for name in sorted(first.values())[:rigs]:
        path = out / "ceiling" / f"{name}.json"
        if path.exists():
            continue
        rig = load_rig(bank / "data" / name / "rig.toml")
        spectra = load_spectra(bank / "data" / name / "spectra.csv", rig)
        part = spectra if which == "E" else poorer(which, rig, spectra, seed, name)
        rng = np.random.default_rng([seed, *name.encode()])
        write_json(path, {"rho": RHO} | allowed(rig, spectra, part, rng).json())
        yield f"ceiling of the rig of {name}"


def ceiling_of(out: Path) -> Allowed:
    return average([json.loads(path.read_text()) for path in sorted((out / "ceiling").glob("*.json"))])


def score(found: Sequence[Outcome], best: Allowed, out: Path, head: dict[str, object]) -> None:
    """Table and figures."""
    rows = table(found, best)
    counts = [{"truth": t, "said": s, "cases": n} for (t, s), n in sorted(confusion(found).items())]
    points = {
        what: [dict(zip(("confidence", "right", "cases"), p, strict=True)) for p in reliability(chosen)]
        for what, chosen in (("causes named", [o for o in found if o.named]), ("all verdicts", found))
    }
    whole = head | {"rows": [r.json() for r in rows], "confusion": counts, "reliability": points, "rho": RHO}
    write_json(out / "score.json", whole | {"ceiling": best.json()})
    (out / "score.md").write_text(markdown(head, rows, points))
    said = f"set {head['set']}, {head['cases']} cases, {head['date']}, commit {head['commits']}, seed {head['seed']}"
    described = {"Description": f"benchmarks.diagnosis: {said}"}
    for name, figure in (
        ("confusion", confusion_figure(found, f"{said}\nrows: truth (cases); columns: what was said")),
        ("top1", top1_figure(found, best, f"set {head['set']}, {head['cases']} cases")),
    ):
        figure.savefig(out / f"{name}.png", dpi=DPI, metadata=described)


def same_run(out: Path, which: str, seed: int) -> None:
    """Refuse to mix sets and seeds in one folder."""
    path = out / "run.json"
    mine = {"set": which, "seed": seed}
    there = json.loads(path.read_text()) if path.exists() else mine
    if there != mine:
        raise SystemExit(f"{out}: holds a run of {there}, this is one of {mine}; give another --out")
    write_json(path, mine)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bank", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--set", choices=SETS, default="E")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--nulls", type=int, default=0, metavar="N")
    parser.add_argument("--rigs", type=int, default=3, metavar="N")
    args = parser.parse_args()
    same_run(args.out, args.set, args.seed)
    for line in run_all(cases(args.bank), args.out / "results", args.set, args.seed, args.workers):
        print(line, flush=True)
    again = list(more_nulls(args.bank, args.out / "nulls", args.nulls, args.seed))
    for line in run_all(again, args.out / "null-results", args.set, args.seed, args.workers):
        print(line, flush=True)
    for line in ceiling(args.bank, args.out, args.set, args.seed, args.rigs):
        print(line, flush=True)
    found = outcomes(args.bank, args.out)
    head = {
        "set": args.set,
        "cases": len(found),
        "rigs": len({o.answer["rig_seed"] for o in found}),
        "seed": args.seed,
        "date": date.today().isoformat(),
        "commits": ", ".join(sorted({str(o.result["commit"]) for o in found})),
        "scored_at": commit(),
        "bank": str(args.bank),
    }
    score(found, ceiling_of(args.out), args.out, head)
    print((args.out / "score.md").read_text())


if __name__ == "__main__":
    main()
