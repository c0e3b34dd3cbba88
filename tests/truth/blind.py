"""Blind cases: a rig, its measurements and a hidden cause drawn from a seed; the answer goes to another folder.

    case = draw(seed=7, which="E")                 # the cause drawn too, perhaps none
    case = draw(seed=8, which="E", cause="added-mass", rig_seed=7)      # shares rig and records with the other
    write_case("data/0007", "answers/0007.json", case)

Sets: A one level, one sensor, fundamental; C three levels, six sensors, fundamental; D harmonics 1..9
too; E the second mode's band too; F as E, with less than half of the records, at 50 dB. Strength is aimed at a residual
of length rho (chi2 = rho^2 over the response's coefficients, harmonics 1 and up, against the rig without the cause, of
the same simulator under the same noise), and the rho that came out, over the records kept, is stated. With `tolerances`
the rig is built a little off its file; rho is against the rig as built. The steps, 2048 at 60 dB and 1024 at 50, leave
0.1 noise units in all; for F, 512, 0.3.

With `background`, a range of sizes, the rig as built has imperfections too (`background.py`): of a size drawn from its
seed, none for one rig in six. Then there are 1024 steps and fewer frequencies, which takes a third of the time.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from tests.truth.background import background_of, drawn_size, drifting, relative_change, response
from tests.truth.hidden import CATALOGUE, MAKERS, OUTSIDE, Hidden, Scene, Unfit
from tests.truth.laws import Coulomb, Dahl
from tests.truth.measure import Spectra, measure, read, with_noise, write_rig, write_spectra
from tests.truth.rig import Sensor, TrueRig
from tests.truth.shooting import Settings
from tests.truth.simulate import Record, Truth, scattered, simulate_records

Array = np.ndarray
SETS = ("A", "C", "D", "E", "F")
STEPS, FEW_STEPS = {50: 1024, 60: 2048}, 512
CLOSE = 0.05  # of P: with less normal force than that the tip nearly lifts off
JUMPED = 1.5  # times the largest background that is asked for: that is none
LEAST = 0.8  # of the records, that must be fit to keep
SEEN = 3.0  # noise units of a threshold that is passed: less is as if it never were
DRAWS, MISSES = 3, 10.0  # on a background: a cause this many times weaker than asked is drawn again, so many times
TARGETS = ((1.25, 1.5), (2.0, 3.0), (5.0, 7.0))  # slip amplitude over the critical slip, by level
UPPER_TARGETS = ((1.3, 1.7), (3.5, 5.0))
MATERIALS = ((210e9, 7800.0), (200e9, 7900.0), (70e9, 2700.0), (103e9, 8500.0), (110e9, 4430.0), (120e9, 8900.0))


@dataclass(frozen=True)
class Bench:
    """A rig set up: nominal (of the rig file), as built, its records, and how it moves without a hidden cause."""

    nominal: TrueRig
    built: TrueRig
    records: tuple[Record, ...]
    steps: int
    snr: int
    harmonics: int
    settings: Settings
    truth: Truth
    quick: bool = False
    few: bool = False  # records, of which probes take those that respond most
    path: tuple[float, ...] = ()  # of Young's modulus from record to record, in a background
    background: Mapping[str, object] = field(default_factory=lambda: stated(0.0, 0.0, {}))

    def each(self, rigs: TrueRig | Sequence[TrueRig], picked: Array) -> TrueRig | list[TrueRig]:
        """Rigs of these records, Young's modulus drifting in the background."""
        rigs = drifting(rigs, self.path) if self.path else rigs
        return rigs if isinstance(rigs, TrueRig) else [rigs[i] for i in picked]

    def without(self, picked: Array) -> Truth:
        """How it moves without a hidden cause, in the records of these numbers."""
        return self.truth.where(np.isin(np.arange(len(self.records)), picked))

    def fit(self, truth: Truth) -> Array:
        """Records that somebody would have kept."""
        if self.quick:
            return np.ones(len(truth.records), bool)
        near = truth.min_R <= CLOSE * truth.rig.normal_load
        return truth.usable & ~near & (np.abs(truth.energy) < 1e-4)


def stated(size: float, asked: float, parts: Mapping[str, float]) -> dict[str, object]:
    """What the answer says of a background."""
    return {"background": size, "background_asked": asked, "background_parts": dict(parts)}


@dataclass(frozen=True)
class Case:
    """What the diagnosis sees (nominal rig, spectra) and what it does not (answer, truth)."""

    seed: int
    set: str
    snr: int
    nominal: TrueRig
    spectra: Spectra
    numbers: tuple[int, ...]
    answer: dict[str, object]
    truth: Truth

    @property
    def rho(self) -> float:
        return float(self.answer["rho"])


def jenkins_stiffness(amplitude: float) -> complex:
    """Describing function of an element of stiffness 1 that slips at 1."""
    if amplitude <= 1:
        return 1.0 + 0j
    turn = np.arccos(1 - 2 / amplitude)
    return complex((turn - np.sin(2 * turn) / 2) / np.pi, 4 * (amplitude - 1) / (np.pi * amplitude**2))


def peak(rig: TrueRig, law: Coulomb, mode: int, slip: float) -> tuple[float, float, float]:
    """Force [N] and frequency [Hz] of the resonance with a slip amplitude (in critical slips), and swing of R over P.

    By the fundamental alone.
    """
    r = rig.reduced()
    low = rig.natural_frequencies(mode)[-1]
    high = rig.natural_frequencies(mode, law.mu * rig.normal_load / law.critical_slip)[-1]
    hz = np.linspace(0.97 * low, 1.03 * high, 1500)
    w = 2 * np.pi * hz[:, None]
    per_force = 1 / (r.omega2 - w**2 * r.inertia + 1j * w * r.damping)
    stiffness = law.mu * rig.normal_load / law.critical_slip * jenkins_stiffness(slip)
    soft = (per_force * r.contact**2).sum(axis=1) + r.axial
    driven = (per_force * r.contact * r.drive).sum(axis=1)
    force = slip * law.critical_slip * (1 + stiffness * soft) / driven
    i = int(np.abs(force).argmin())
    T = -stiffness * slip * law.critical_slip
    q = per_force[i] * (force[i] * r.drive + T * r.contact)
    here = w[i, 0]
    R = (-(here**2) * r.tip_mass_row + 1j * here * r.tip_damping_row + r.tip_stiffness_row) @ q
    return float(abs(force[i])), float(hz[i]), float(abs(R)) / rig.normal_load


def draw_rig(rng: np.random.Generator) -> TrueRig:
    """A beam that a laboratory might have, on Coulomb friction."""
    E, density = MATERIALS[int(rng.integers(len(MATERIALS)))]
    length = float(np.round(rng.uniform(0.4, 0.8), 4))
    places = np.linspace(0.18, 0.94, 6) + rng.uniform(-0.04, 0.04, 6)
    return TrueRig(
        length=length,
        width=float(np.round(rng.uniform(0.025, 0.045), 5)),
        thickness=float(np.round(length * rng.uniform(0.0075, 0.0115), 6)),
        youngs_modulus=float(np.round(E * rng.uniform(0.97, 1.03), -8)),
        density=float(np.round(density * rng.uniform(0.99, 1.01), 0)),
        alpha=float(np.round(np.exp(rng.uniform(np.log(0.3), np.log(3.0))), 3)),
        radius=float(np.round(rng.uniform(0.004, 0.008), 5)),
        normal_load=float(np.round(rng.uniform(50, 180), 0)),
        law=Coulomb(float(np.round(rng.uniform(0.3, 0.6), 3)), float(np.round(rng.uniform(3e-6, 1.2e-5), 8))),
        drive=float(np.round(length * rng.choice([rng.uniform(0.3, 0.5), rng.uniform(0.8, 0.93)]), 3)),
        sensors=tuple(Sensor(f"a{i}", float(np.round(length * x, 3))) for i, x in enumerate(places, 1)),
    )


def draw_records(rig: TrueRig, which: str, rng: np.random.Generator, fewer: bool = False) -> list[tuple[float, float]]:
    """Levels and frequencies: from stuck at most frequencies to clear slip, around the resonance.

    `fewer` frequencies of each level: 7 or 8 and 5, for 11 to 14 and 6 to 8.
    """

    def band(mode: int, targets: Sequence[tuple[float, float]], count: int) -> list[tuple[float, float]]:
        peaks = [peak(rig, rig.law, mode, rng.uniform(*target)) for target in targets]
        if max(swing for _, _, swing in peaks) > 0.6:
            raise Unfit("the tip would lift off")
        levels = [float(f"{force:.3g}") for force, _, _ in peaks]
        if any(b < 1.15 * a for a, b in pairwise(levels)):
            raise Unfit("levels too close to each other")
        seen = [hz for _, hz, _ in peaks]
        width = max(max(seen) - min(seen), 0.04 * min(seen))
        hz = np.linspace(min(seen) - 0.35 * width, max(seen) + 0.35 * width, count)
        hz = hz + rng.uniform(-0.2, 0.2, count) * (hz[1] - hz[0])
        return [(level, float(f"{f:.5g}")) for level in levels for f in hz]

    if which == "A":
        return band(1, TARGETS[2:], int(rng.integers(12, 16)))
    few = which == "F"
    counts = ((7, 9), (5, 6)) if fewer else ((11, 15), (6, 9))
    first = band(1, TARGETS, 5 if few else int(rng.integers(*counts[0])))
    return first + (band(2, UPPER_TARGETS, 3 if few else int(rng.integers(*counts[1]))) if which in "EF" else [])


def built_from(nominal: TrueRig, rng: np.random.Generator) -> TrueRig:
    """The rig within its tolerances: E 1 %, sensors 0.5 mm, 0.2 % and 2 us, P 2 %."""
    n = rng.standard_normal
    sensors = [Sensor(s.name, s.position + 5e-4 * n(), 1 + 2e-3 * n(), 2e-6 * n()) for s in nominal.sensors]
    return replace(
        nominal,
        youngs_modulus=nominal.youngs_modulus * (1 + 0.01 * n()),
        normal_load=nominal.normal_load * (1 + 0.02 * n()),
        sensors=tuple(sensors),
    )


@lru_cache(maxsize=3)
def set_up(
    seed: int,
    which: str,
    kind: str = "coulomb",
    tolerances: bool = False,
    quick: bool = False,
    background: tuple[float, float] | None = None,
) -> Bench:
    """The bench of a seed. `kind`: coulomb, dahl, or `constant-load` (R = P in the rig file)."""
    if which not in SETS:
        raise ValueError(f"set {which!r}; there are {', '.join(SETS)}")
    settings = (
        Settings(ramp=6, hold=2, coarse=64, tolerance=1e-6, iterations=6, retries=0, again=8)
        if quick
        else Settings(slow_modes=8, chord=True, tolerance=1e-7, coarse=128 if which == "F" else 256)
    )
    if background is not None and not quick:
        settings = replace(settings, ramp=25, hold=5, retries=1, again=20, coarse=128)
    for attempt in range(20):
        rng = np.random.default_rng([seed, SETS.index(which), attempt])
        try:
            rig = draw_rig(rng)
            asked = draw_records(rig, which, rng, background is not None)
            records = tuple(scattered(asked[:: len(asked) // 3] if quick else asked, rng))
            if which == "A":
                rig = replace(rig, sensors=(rig.sensors[int(rng.integers(6))],))
            snr = 50 if which == "F" else int(rng.choice([50, 60]))
            stiffness = rig.law.mu * rig.normal_load / rig.law.critical_slip
            if kind == "dahl":
                rig = replace(rig, law=Dahl(rig.law.mu, stiffness))
            if kind == "constant-load":
                rig = replace(rig, variable_normal_load=0.0)
            built = built_from(rig, rng) if tolerances else rig
            steps = 128 if quick else FEW_STEPS if which == "F" else STEPS[snr if background is None else 50]
            truth = simulate_records(built, records, steps, settings)
            harmonics = 1 if which in "AC" else 9
            bench = Bench(rig, built, records, steps, snr, harmonics, settings, truth, quick, background is not None)
            slip = np.ptp(truth.u, axis=1).max() * stiffness / (2 * rig.law.mu * rig.normal_load)
            if not quick and (bench.fit(truth).mean() < 0.85 or slip < 2.0):
                raise Unfit("unstable, lifting or hardly slipping")
            return bench if background is None else on_background(bench, background, seed)
        except Unfit:
            continue
    raise Unfit(f"seed {seed} makes no rig in 20 attempts")


def on_background(bench: Bench, sizes: tuple[float, float], seed: int) -> Bench:
    """The bench with imperfections, which have dice of their own."""
    rng = np.random.default_rng([seed, 29])
    asked = drawn_size(rng, *sizes)
    if not asked:
        return bench
    good = np.flatnonzero(bench.fit(bench.truth))
    made = background_of(bench.truth, good, asked, bench.settings, bench.harmonics, rng)
    stands = replace(bench, built=made.rig, truth=made.truth, path=made.path)
    if stands.fit(made.truth).mean() < 0.85:
        raise Unfit("unstable with its imperfections")
    if made.size > JUMPED * sizes[1]:
        raise Unfit("a record went to another branch with its imperfections")
    return replace(stands, background=stated(made.size, asked, made.parts))


def noise_of(bench: Bench, truth: Truth) -> Array:
    """Std of each response channel, as in `measure`."""
    return np.abs(read(truth, 1)[1][:, 1:, 1]).max(axis=0) * 10 ** (-bench.snr / 20)


def length_of(bench: Bench, truth: Truth, picked: Array, std: Array | None = None) -> tuple[float, float]:
    """rho of a truth whose records are these of the bench, and the share of its largest record in chi2.

    `std` per response channel; unless given, what `measure` would make of the bench without a cause.
    """
    std = noise_of(bench, bench.truth) if std is None else std
    each = apart(bench, truth, bench.without(picked), std)
    return float(np.sqrt(each.sum())), float(each.max() / max(each.sum(), 1e-300))


def apart(bench: Bench, one: Truth, other: Truth, std: Array) -> Array:
    """Chi2 by which two truths differ, record by record, where both can be used."""
    change = read(one, bench.harmonics)[1] - read(other, bench.harmonics)[1]
    square = np.abs(change[:, 1:, 1:] / std[:, None]) ** 2
    return np.where(bench.fit(one) & bench.fit(other), square.sum(axis=(1, 2)), 0.0)


def run(bench: Bench, hidden: Hidden, strength: float, picked: Array, steps: int) -> Truth:
    """The truth with the cause, for the records of these numbers."""
    rigs = hidden.rigs(strength)
    if not hidden.simulated:
        return hidden.afterwards(replace(bench.without(picked), rig=rigs), strength)
    asked = bench.records if hidden.records is None else hidden.records(strength)
    truth = simulate_records(bench.each(rigs, picked), [asked[i] for i in picked], steps, bench.settings)
    return hidden.afterwards(truth, strength)


def aimed(bench: Bench, hidden: Hidden, target: float) -> float:
    """Strength whose residual is about as long as the target: one probe of a few records, up to three more if far off.

    A strength that leaves no steady states to measure is lowered. What only the instruments do costs nothing and is met
    exactly, under the noise that they then have.
    """
    few = np.sqrt(len(bench.records) / 50)  # a typical strength is one for some 50 records
    strength = float(np.clip(hidden.typical * target / 100 / few, hidden.lower, hidden.upper))
    dear = hidden.simulated or hidden.marched
    if hidden.lower == hidden.upper or (bench.quick and dear):
        return strength
    good = np.flatnonzero(bench.fit(bench.truth))
    picked = (liveliest(bench, good) if bench.few else good[:: max(1, len(good) // 12)]) if dear else good
    extent = 1.0 if bench.few else np.sqrt(len(good) / len(picked))
    upper = hidden.upper
    for _ in range(4 if dear else 20):
        truth = run(bench, hidden, strength, picked, min(512, bench.steps))
        if bench.fit(truth).mean() < LEAST:
            upper = strength / 2
            strength = max(upper / 2, hidden.lower)
            continue
        rho, _ = length_of(bench, truth, picked, None if dear else noise_of(bench, truth))
        ratio = target / max(rho * extent, 1e-9)
        strength = float(np.clip(strength * np.clip(ratio, 0.02, 50.0), hidden.lower, upper))
        if 0.2 < ratio < 5.0 and dear:
            break
    return strength


def liveliest(bench: Bench, good: Array) -> Array:
    """The half of the records that move or accelerate most: they touch a stop, and are most of a residual's length."""
    felt = np.abs(np.fft.rfft(bench.truth.acceleration)[..., 1]).max(axis=1)[good]
    moved = felt / np.array([bench.records[i].hz for i in good]) ** 2
    lively = np.maximum(felt / felt.max(), moved / moved.max())
    return np.sort(good[np.argsort(-lively)[: (len(good) + 1) // 2]])


def strong_enough(bench: Bench, hidden: Hidden, strength: float) -> tuple[float, Truth]:
    """The truth at this strength, or at half or a quarter of it where too few records can be used."""
    everyone = np.arange(len(bench.records))
    for _ in range(3):
        truth = run(bench, hidden, strength, everyone, bench.steps)
        if bench.fit(truth).mean() >= LEAST or strength / 2 < hidden.lower:
            break
        strength /= 2
    return strength, truth


def seen_of(bench: Bench, hidden: Hidden, strength: float, truth: Truth) -> Hidden:
    """What records show of a cause: the simpler one that it is, where what sets in at a threshold never does."""
    if hidden.mild is None:
        return hidden
    mild = run(bench, hidden.mild, strength, np.arange(len(bench.records)), bench.steps)
    return hidden if np.sqrt(apart(bench, truth, mild, noise_of(bench, truth)).sum()) >= SEEN else hidden.mild


def kind_of(cause: str | None) -> str:
    """The nominal law a cause needs."""
    return {"bristle-memory": "dahl", "variable-normal-load": "constant-load"}.get(str(cause), "coulomb")


def draw(
    seed: int,
    which: str = "E",
    cause: str | None = "any",
    rig_seed: int | None = None,
    rho: tuple[float, float] = (50.0, 3000.0),
    tolerances: bool = False,
    quick: bool = False,
    background: tuple[float, float] | None = None,
) -> Case:
    """The case of a seed.

    `cause`: a key of `MAKERS`, None for a null case, "any" for a draw of all: one null and one outside the catalogue
    in eight each. `rig_seed`: take the bench of another seed. `quick`: few records, coarse; for tests.
    `background`: range of the sizes of imperfections, relative to the response; None for none.
    """
    rng = np.random.default_rng([seed, 17])
    drawn = draw_cause(rng)
    name = drawn if cause == "any" else cause
    target = float(np.exp(rng.uniform(*np.log(rho))))
    seed_of_rig = seed if rig_seed is None else rig_seed
    bench = set_up(seed_of_rig, which, kind_of(name), tolerances, quick, background)
    everyone = np.arange(len(bench.records))
    if name is None:
        hidden, strength, truth = None, 0.0, bench.truth
    else:
        for _ in range(1 if background is None else DRAWS):
            hidden = MAKERS[name](Scene(bench.built, bench.records, bench.truth, rng))
            strength, truth = strong_enough(bench, hidden, aimed(bench, hidden, target))
            if bench.fit(truth).mean() >= LEAST and length_of(bench, truth, everyone)[0] > target / MISSES:
                break
        else:
            if background is not None:
                raise Unfit(f"seed {seed}: the cause is hardly seen, or where it is no record can be used")
        hidden = seen_of(bench, hidden, strength, truth)
    keep = bench.fit(truth)
    if keep.mean() < LEAST:
        raise Unfit(f"seed {seed}: {keep.mean():.0%} of the records can be used")
    seen = truth.where(keep)
    spectra = measure(seen, bench.snr, np.random.default_rng([seed, 23]), harmonics=bench.harmonics, usable_only=False)
    length, share = length_of(bench, truth, everyone, spectra.std[0, 1:, 0])
    both = keep & bench.fit(bench.truth)
    change = relative_change(response(truth, bench.harmonics)[both], response(bench.truth, bench.harmonics)[both])
    slip = np.ptp(seen.u, axis=1) / 2
    answer = {
        "verdict": "consistent" if hidden is None else ("unexplained" if hidden.cause is None else "cause-found"),
        "cause": None if hidden is None else hidden.cause,
        "parameters": {} if hidden is None else dict(hidden.parameters(strength)),
        "what": "nothing" if hidden is None else hidden.what,
        "drawn": name,
        "rho": 0.0 if hidden is None else length,
        "rho_target": 0.0 if hidden is None else target,
        "largest_share": 0.0 if hidden is None else share,
        "seed": seed,
        "rig_seed": seed_of_rig,
        "set": which,
        "snr_db": bench.snr,
        "tolerances": tolerances,
        "effect": change,
        "background_range": background,
        **bench.background,
        "levels": sorted({r.level for r in bench.records}),
        "records": len(bench.records),
        "usable": int(keep.sum()),
        "unstable": int((~truth.stable).sum()),
        "not_converged": int((~truth.converged).sum()),
        "near_lift_off": int((truth.min_R <= CLOSE * bench.nominal.normal_load).sum()),
        "energy_worst": float(np.abs(truth.energy[keep]).max()),
        "slip_largest_m": float(slip.max()),
        "steps": bench.steps,
    }
    numbers = tuple(int(i) + 1 for i in np.flatnonzero(keep))
    return Case(seed, which, bench.snr, bench.nominal, spectra, numbers, answer, truth)


def draw_cause(rng: np.random.Generator) -> str | None:
    """One null and one outside the catalogue in eight each, the others of the catalogue alike."""
    dice = rng.random()
    pool: list[str | None] = [None] if dice < 1 / 8 else list(OUTSIDE) if dice < 2 / 8 else list(CATALOGUE)
    return pool[int(rng.integers(len(pool)))]


def write_case(folder: str | Path, answer: str | Path, case: Case) -> None:
    """rig.toml and spectra.csv in the folder; the answer to a file that is not in it. Nothing names the cause.

    Beside the answer of a case without a cause its truth, to be measured again: `measured_again`.
    """
    folder, answer = Path(folder).resolve(), Path(answer).resolve()
    if answer.is_relative_to(folder):
        raise ValueError(f"the answer {answer} would lie with the data in {folder}")
    folder.mkdir(parents=True, exist_ok=True)
    answer.parent.mkdir(parents=True, exist_ok=True)
    top = max(r.level for r in case.spectra.records)
    write_rig(folder / "rig.toml", case.nominal, name=f"beam {case.seed}", amplitude=top)
    write_measured(folder / "spectra.csv", case.spectra, case.numbers)
    answer.write_text(json.dumps(case.answer, indent=1) + "\n")
    if case.answer["drawn"] is None:
        write_truth(truth_beside(answer), case)


def write_measured(path: Path, spectra: Spectra, numbers: Sequence[int]) -> None:
    """Spectra as in a case: the mean where there are more harmonics than the fundamental."""
    write_spectra(path, spectra, mean=spectra.cos.shape[-1] > 2, numbers=numbers)


def truth_beside(answer: str | Path) -> Path:
    """Where the truth of a case without a cause is."""
    return Path(answer).with_suffix(".truth.npz")


def write_truth(path: str | Path, case: Case) -> None:
    """Noise-free spectra and the noise's std, to be measured again."""
    s = case.spectra
    np.savez_compressed(
        path,
        records=np.array([(r.level, r.hz, r.phase, r.force) for r in s.records]),
        numbers=np.array(case.numbers),
        channels=np.array(s.channels),
        true=s.true_cos + 1j * s.true_sin,
        std=s.std,
    )


def measured_again(path: str | Path, rng: np.random.Generator) -> tuple[Spectra, tuple[int, ...]]:
    """The same truth under other noise, and the numbers of its records."""
    with np.load(path) as saved:
        records = tuple(Record(*map(float, row)) for row in saved["records"])
        channels = tuple(str(name) for name in saved["channels"])
        spectra = with_noise(records, channels, saved["true"], saved["std"], rng)
        return spectra, tuple(int(n) for n in saved["numbers"])
