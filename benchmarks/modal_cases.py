"""Blind cases of structures given by their modes: one hidden effect each, or none, or one wrong number.

    python -m benchmarks.modal_cases --seed 1 --count 60 --out /tmp/modal
    python -m benchmarks.modal_cases --seed 1 --count 30 --out /tmp/measuring --plan measuring

The second has in their place a channel or the force that reads a multiple, and frequencies that drift.

Every structure is a random chain of masses and springs, of which 3 to 8 modes are kept. Its records come from
`tests/truth/modal.py`, which shares no code with the package. The rig file is a little off in all that is identified
of it (background), within the tolerances of the diagnosis. A case is drawn and diagnosed with what a user has, its rig
and its spectra; the truth is looked at afterwards. OUT/cases.jsonl keeps a line per case, OUT/NNN.json what
was said of it: a run goes on where it stopped.
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.score.rates import wilson
from hbm import Diagnosis, diagnose
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from models.bodies import ModalModel
from models.jointed import JointedRig
from models.parts import Channel, Damping, Excitation
from tests.truth.modal import (
    Hidden,
    Modes,
    accelerations,
    cubic,
    gap,
    jenkins,
    last_periods,
    nothing,
    quadratic,
    steady,
)

Array = np.ndarray

PLAN = (
    "null",
    "cubic",
    "friction",
    "frequency",
    "stop",
    "drag",
    "null",
    "cubic",
    "friction",
    "damping",
    "stop",
    "drag",
)
PLANS = {"physics": PLAN, "measuring": ("gain", "force", "drift", "gain", "force", "drift", "null")}
NAMES = {
    "cubic": "cubic-stiffness",
    "friction": "local-friction",
    "stop": "one-sided-stop",
    "drag": "quadratic-damping",
    "spring": "local-spring",
}
"""What the diagnosis calls each effect. Friction that slides in none of its records is a spring, and nothing else."""

MEASURING = {"gain": "sensor-gain", "force": "sensor-gain", "drift": "drift"}
"""The same of what is wrong with the measurement."""

MASSES = 12
BACKGROUND = {"hz": 1e-3, "ratio": 0.1, "shape": 5e-3}
"""What the structure differs by from its rig file, relative standard deviations."""

NOISE = 3e-3
"""Of the rms of a channel, standard deviation of each coefficient: 50 dB."""

LEVELS = (0.3, 0.6, 1.0)
OFFSETS = (-4.0, -1.5, -0.6, 0.0, 0.6, 1.5, 4.0)
"""Frequencies of the records about each of two modes, in units of its half bandwidth."""

MOVED = 1e-4
"""Modal amplitude at resonance without an effect [m kg^(1/2)]."""

H, STEPS, PERIODS, MEASURED = 5, 256, 250, 8
"""A record is the mean of so many last periods of the march; what does not repeat from one to the next is its noise."""


@dataclass(frozen=True, eq=False)
class Case:
    """What a user has, and the truth."""

    kind: str
    rig: JointedRig
    spectra: MeasuredSpectra
    at: tuple[str, ...]
    key: str
    effect: float
    background: float


def structure(rng: np.random.Generator) -> Modes:
    """Modes of a random chain of masses that is held at one end, and in places beside."""
    mass, spring = (np.exp(0.4 * rng.standard_normal(MASSES)) for _ in range(2))
    ground = np.where(rng.random(MASSES) < 0.2, 0.1 * np.exp(0.5 * rng.standard_normal(MASSES)), 0.0)
    K = np.diag(spring + np.append(spring[1:], 0.0) + ground) - np.diag(spring[1:], 1) - np.diag(spring[1:], -1)
    root = 1.0 / np.sqrt(mass)
    squares, shapes = np.linalg.eigh(root[:, None] * K * root)
    n = int(rng.integers(3, 9))
    hz = rng.uniform(15.0, 60.0) * np.sqrt(squares[:n] / squares[0])
    places = rng.choice(MASSES, size=int(rng.integers(4, 7)), replace=False)
    rows = {f"p{k + 1}": (root[:, None] * shapes)[place, :n] for k, place in enumerate(places)}
    return Modes(hz, rng.uniform(0.008, 0.025, n), rows)


def rig_of(modes: Modes) -> JointedRig:
    """The rig file of a structure: driven at its first place, seen at all of them."""
    body = ModalModel(tuple(modes.hz.tolist()), {name: tuple(row.tolist()) for name, row in modes.rows.items()})
    sensors = (Channel(f"a{name[1:]}", "acceleration", at=name) for name in modes.rows)
    damping = Damping(modal_ratios=tuple(modes.ratio.tolist()))
    return JointedRig("structure", body, damping, (), Excitation(1.0, at="p1"), (Channel("force", "force"), *sensors))


def hidden(kind: str, rng: np.random.Generator, modes: Modes, at: Array, moved: float) -> Hidden:
    """An effect at a relative displacement that reaches `moved` [m], one to three half bandwidths of mode 1 large."""
    omega, ratio, share = 2 * np.pi * modes.hz[0], modes.ratio[0], at[0] ** 2
    size = rng.uniform(1.0, 3.0)
    stiffness = 2.0 * size * ratio * omega**2 / share  # that shifts mode 1 by so many half bandwidths
    if kind == "cubic":
        return cubic(4.0 / 3.0 * stiffness / moved**2)
    if kind == "stop":
        return gap(4.0 * stiffness, rng.uniform(0.3, 0.6) * moved)
    if kind == "friction":
        limit = np.pi / 4.0 * size * ratio * omega**2 / share * moved  # where it slides, half as large a damping
        return jenkins(limit / (rng.uniform(0.1, 0.3) * moved), limit)
    if kind == "drag":
        return quadratic(2.0 * size * ratio * omega / share * 3 * np.pi / (8.0 * omega * moved))
    return nothing


def slides(friction: Hidden, u: Array) -> bool:
    """Whether the force of a friction element at rest is out of proportion to the largest of motions (r, 2H+1)."""
    largest = float(np.hypot(u[:, 1 : H + 1], u[:, H + 1 :]).sum(axis=1).max())
    rest = np.zeros(1)
    far, near = (friction(np.array([x]), rest, rest)[0][0] / x for x in (largest, 1e-6 * largest))
    return bool(abs(far) < (1.0 - 1e-9) * abs(near))


def draw(kind: str, seed: int) -> Case:
    """A case of a kind; of a spring where a friction element slides in no record."""
    rng = np.random.default_rng(seed)
    nominal = structure(rng)
    true = nominal.disturbed(rng, **BACKGROUND)
    key, at = "", ()
    if kind in ("frequency", "damping"):
        i = int(rng.integers(0, 2))
        off = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.025, 0.05) if kind == "frequency" else rng.uniform(2.2, 3.5)
        name, values = ("hz", true.hz) if kind == "frequency" else ("ratio", true.ratio)
        true = replace(true, **{name: np.where(np.arange(len(values)) == i, off * values, values)})
        key = f"modal.frequencies_hz[{i + 1}]" if kind == "frequency" else f"damping.modal_ratios[{i + 1}]"
    wrong, read = 1.0, ""
    if kind in ("gain", "force"):
        sensors = [f"a{name[1:]}" for name in true.rows]
        read = "force" if kind == "force" else str(rng.choice(sensors))
        wrong = float(np.exp(rng.choice([-1.0, 1.0]) * rng.uniform(np.log(1.2), np.log(10.0))))
    row = np.zeros(len(true.hz))
    if kind in NAMES:
        names = list(rng.permutation(list(true.rows)))
        at = (str(names[0]),) if rng.random() < 0.6 else (str(names[0]), str(names[1]))
        row = true.rows[at[0]] - (true.rows[at[1]] if len(at) > 1 else 0.0)
    around = [f * (1.0 + np.array(OFFSETS) * z) for f, z in zip(nominal.hz[:2], nominal.ratio[:2], strict=True)]
    hz, first = np.tile(np.concatenate(around), len(LEVELS)), len(OFFSETS)
    of_mode = np.tile(np.repeat([0, 1], first), len(LEVELS))
    per_mode = MOVED * 2.0 * nominal.ratio[:2] * (2 * np.pi * nominal.hz[:2]) ** 2 / np.abs(nominal.rows["p1"][:2])
    force = np.repeat(LEVELS, 2 * first) * per_mode[of_mode]  # both modes are moved alike
    if kind == "drift":
        drift = rng.choice([-1.0, 1.0]) * rng.uniform(0.005, 0.03) / (len(hz) - 1)
        true = replace(true, hz=true.hz * (1.0 + drift * np.arange(len(hz))[:, None]))
    without = steady(true, nothing, row, "p1", hz, force, PERIODS, STEPS, H)
    moved = float(np.abs(np.hypot(without[:, 1], without[:, H + 1]) @ np.abs(row)).max()) if row.any() else 1.0
    effect = hidden(kind, rng, true, row, moved) if at else nothing
    by_period = last_periods(true, effect, row, "p1", hz, force, [(PERIODS, STEPS)], H, MEASURED)
    by_file = steady(nominal, nothing, row, "p1", hz, force, PERIODS, STEPS, H)

    def seen(motion: Array, modes: Modes) -> dict[str, Array]:
        return {f"a{name[1:]}": accelerations(modes, motion, name, hz) for name in modes.rows}

    def apart(a: dict[str, Array], b: dict[str, Array]) -> float:
        return float(np.sqrt(sum(np.sum((a[k] - b[k]) ** 2) for k in a) / sum(np.sum(b[k] ** 2) for k in b)))

    if kind == "friction" and not slides(effect, by_period[-1] @ row):
        kind = "spring"
    each = [seen(q, true) for q in by_period]
    clean, null = {name: np.mean([e[name] for e in each], axis=0) for name in each[0]}, seen(without, true)
    size = (len(hz), 2 * H + 1)
    std = {name: NOISE * np.sqrt(np.mean(y[:, [1, H + 1]] ** 2)) for name, y in clean.items()}
    noisy = {name: y + std[name] * rng.standard_normal(size) for name, y in clean.items()}
    noisy["force"], std["force"] = np.zeros(size), 1e-4 * float(force.max())
    noisy["force"][:, 1] = force
    stds = {name: np.full((len(hz), H + 1), s) for name, s in std.items()}
    for name in clean:
        scatter = np.var([e[name] for e in each], axis=0)
        stds[name][:, 1:] = np.sqrt(stds[name][:, 1:] ** 2 + (scatter[:, 1 : H + 1] + scatter[:, H + 1 :]) / 2)
    for name in noisy:  # no mean is measured
        noisy[name][:, 0] = stds[name][:, 0] = np.nan
    if read:
        noisy[read], stds[read] = wrong * noisy[read], wrong * stds[read]
    rig = rig_of(nominal)
    spectra = spectra_of(rig, hz, force, noisy, stds)
    beside = apart(null, seen(by_file, nominal))
    return Case(
        kind, rig, spectra, (read,) if read else at, key, *((beside, 0.0) if key else (apart(clean, null), beside))
    )


def judged(case: Case, d: Diagnosis, cpu_s: float) -> dict[str, object]:
    """What the diagnosis says, beside the truth."""
    place = tuple(str(d.parameters[name].value) for name in ("at", "to", "channel") if name in d.parameters)
    place = tuple(p for p in place if p and p != "ground")
    truth = (NAMES | MEASURING).get(case.kind) or (f"parameter:{case.key}" if case.key else None)
    told = d.json()
    return {
        "kind": case.kind,
        "modes": case.rig.structure.n,
        "places": len(case.rig.response_channels),
        "effect": round(case.effect, 4),
        "background": round(case.background, 4),
        "truth": truth,
        "at": list(case.at),
        "verdict": d.verdict,
        "cause": d.cause,
        "named_at": list(place),
        "not_separable": told.get("not_separable", []),
        "confidence": d.confidence,
        "cpu_s": round(cpu_s, 1),
    }


def share(count: int, of: int) -> str:
    """A share with its interval."""
    low, high = wilson(count, of)
    return f"{count} of {of} ({low:.0%} to {high:.0%})" if of else "none"


def right(f: dict[str, object]) -> bool:
    """Whether what is said first of a case is the truth."""
    return f["verdict"] == "consistent" if f["truth"] is None else f["cause"] == f["truth"]


def told(f: dict[str, object]) -> bool:
    """Whether the truth is said, first or among what is not separable from it."""
    return right(f) or (f["truth"] is not None and str(f["truth"]) in str(f["not_separable"]))


def placed(f: dict[str, object]) -> bool:
    """Whether the cause that is said first is at the ports of the truth, or of its channel."""
    return set(f["named_at"]) == set(f["at"])


def summary(found: list[dict[str, object]]) -> Iterator[str]:
    """A table of all cases by kind, then rates with their intervals of 95 %."""
    yield "| hidden | cases | named first | told | placed | CPU s, median |"
    yield "|---|---|---|---|---|---|"
    for kind in dict.fromkeys(str(f["kind"]) for f in found):
        some = [f for f in found if f["kind"] == kind]
        counts = (sum(map(right, some)), sum(map(told, some)), sum(map(placed, some)) if some[0]["at"] else "-")
        cpu = np.median([f["cpu_s"] for f in some])
        yield f"| {kind} | {len(some)} | {counts[0]} | {counts[1]} | {counts[2]} | {cpu:.0f} |"
    yield ""
    nulls = [f for f in found if f["truth"] is None]
    physics = [f for f in found if f["kind"] in NAMES | MEASURING]
    named = [f for f in physics if f["cause"]]
    wrong = [f for f in found if f["kind"] in ("frequency", "damping")]
    both = physics + wrong
    mixed = [f for f in both if f["cause"] and (f in wrong) != str(f["cause"]).startswith("parameter:")]
    rates = {
        "nulls with a cause": ([f for f in nulls if f["cause"]], nulls),
        "hidden named first": (list(filter(right, physics)), physics),
        "hidden told": (list(filter(told, physics)), physics),
        "placed, where a cause was named": (list(filter(placed, named)), named),
        "wrong number named first": (list(filter(right, wrong)), wrong),
        "number and physics told apart": ([f for f in both if f["cause"] and f not in mixed], both),
    }
    for name, (some, of) in rates.items():
        yield f"- {name}: {share(len(some), len(of))}"
    cpu = [f["cpu_s"] for f in found]
    yield f"- CPU seconds: median {np.median(cpu):.0f}, most {max(cpu):.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--plan", choices=PLANS, default="physics")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    plan = PLANS[args.plan]
    kept = args.out / "cases.jsonl"
    found = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    for i in range(len(found), args.count):
        case = draw(plan[i % len(plan)], args.seed + i)
        began = time.process_time()
        d = diagnose(case.rig, case.spectra)
        found.append(judged(case, d, time.process_time() - began))
        (args.out / f"{i:03}.json").write_text(json.dumps(d.json(), default=str) + "\n")
        with kept.open("a") as lines:
            lines.write(json.dumps(found[-1]) + "\n")
        print(json.dumps(found[-1]), flush=True)
    print("\n".join(summary(found)))


if __name__ == "__main__":
    main()
