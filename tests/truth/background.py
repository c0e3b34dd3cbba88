"""A background of imperfections: a real structure differs a little from its file, and no single cause says how.

Its size is the relative rms change of the response. A frequency near a sharp resonance moves the response far more than
a gain does, so each part is probed on its own and scaled linearly: part p adds size sqrt(w_p), with drawn weights that
add up to 1, and never more than its full strength; then all by one factor, since parts add up or cancel, and once more
where the size of all records misses what was asked. Another discretisation and Newmark's rule have no scale: they are
part of every background. Full strengths are those of the constants here; compliances, mass and stiffness beside the
beam's own, each times a draw of 0.3 to 1.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tests.truth.effects import ClampRotation, Stinger, SupportFlexibility
from tests.truth.measure import read
from tests.truth.rig import TrueRig
from tests.truth.shooting import Settings
from tests.truth.simulate import Truth, simulate_records

Array = np.ndarray
PARTS = ("damping", "sensors", "supports", "stinger", "thickness", "drift")
NUMERICS = "numerics"
NONE = 1 / 6  # of the rigs have no background
DAMPING, GAIN, SHIFT, THICKNESS, DRIFT = 0.3, 5e-3, 3e-4, 5e-3, 2e-3  # drift: over the campaign, of Young's modulus
CLAMP, SUPPORT = 0.01, 3e-4  # of L / EI and of L^3 / 3 EI
MASS, STIFFNESS = 0.005, 0.01  # of the beam's mass and of 48 EI / L^3
MODES, ELEMENTS = (12, 14, 18, 20), (36, 40, 56, 60)  # the rig of the file has 16 and 48
TERMS = 4
PROBE, PROBED = 0.2, 10  # share of the full strength in a probe, and about how many records it takes
MISSES = 1.3  # size over what was asked, or the reverse, from which on it is made once more


@dataclass(frozen=True)
class Flaws:
    """All imperfections of a rig at full strength: `path` of Young's modulus by record, `damping` in logarithms."""

    damping: tuple[float, ...]
    gains: tuple[float, ...]
    shifts: tuple[float, ...]
    clamp: float
    support: float
    mass: float
    stiffness: float
    thickness: tuple[float, ...]
    path: tuple[float, ...]
    modes: int
    elements: int


@dataclass(frozen=True)
class Background:
    """The rig with its imperfections, Young's modulus of each record beside it, and how it moves."""

    rig: TrueRig
    path: tuple[float, ...]
    truth: Truth
    shares: dict[str, float]
    size: float
    parts: dict[str, float] = field(default_factory=dict)


def drawn_size(rng: np.random.Generator, low: float, high: float) -> float:
    """None for one rig in six."""
    return 0.0 if rng.random() < NONE else float(rng.uniform(low, high))


def draw_flaws(rig: TrueRig, records: int, rng: np.random.Generator) -> Flaws:
    def normal(std: float, count: int) -> tuple[float, ...]:
        return tuple(float(x) for x in std * rng.standard_normal(count))

    def some(whole: float) -> float:
        return float(whole * rng.uniform(0.3, 1.0))

    L, EI = rig.length, rig.bending
    terms = rng.standard_normal(TERMS) / np.arange(1, TERMS + 1)
    terms *= THICKNESS * np.sqrt(2) / np.linalg.norm(terms)
    modes = int(rng.choice(MODES))
    return Flaws(
        damping=normal(DAMPING, modes),
        gains=normal(GAIN, len(rig.sensors)),
        shifts=normal(SHIFT, len(rig.sensors)),
        clamp=some(CLAMP * L / EI),
        support=some(SUPPORT * L**3 / (3 * EI)),
        mass=some(MASS * rig.density * rig.area * L),
        stiffness=some(STIFFNESS * 48 * EI / L**3),
        thickness=tuple(float(x) for x in terms),
        path=slow_path(records, rng),
        modes=modes,
        elements=int(rng.choice(ELEMENTS)),
    )


def slow_path(records: int, rng: np.random.Generator) -> tuple[float, ...]:
    """Three half waves over the campaign, the longest the largest, without mean."""
    when = np.linspace(0, np.pi, records)
    path = sum(rng.standard_normal() / n**2 * np.cos(n * when) for n in (1, 2, 3))
    return tuple(float(x) for x in DRIFT * (path - path.mean()) / np.ptp(path))


def other_numerics(rig: TrueRig, flaws: Flaws) -> TrueRig:
    return replace(rig, modes=flaws.modes, elements=flaws.elements, newmark=True)


def imperfect(rig: TrueRig, flaws: Flaws, shares: Mapping[str, float]) -> TrueRig:
    """The rig with shares of its flaws but the drift: `drifting`."""
    damping, sensors, held, pushed, thick = (shares.get(part, 0.0) for part in PARTS[:-1])
    if damping:
        rig = replace(rig, damping_factors=tuple(np.exp(damping * np.array(flaws.damping)).tolist()))
    if sensors:
        off = zip(rig.sensors, flaws.gains, flaws.shifts, strict=True)
        moved = [replace(s, gain=s.gain * (1 + sensors * g), position=s.position + sensors * x) for s, g, x in off]
        rig = replace(rig, sensors=tuple(moved))
    if held:
        soft = (ClampRotation(1 / (held * flaws.clamp)), SupportFlexibility(1 / (held * flaws.support)))
        rig = replace(rig, effects=(*rig.effects, *soft))
    if pushed:
        rig = replace(rig, effects=(*rig.effects, Stinger(pushed * flaws.mass, pushed * flaws.stiffness, rig.drive)))
    if thick:
        rig = replace(rig, thickness_terms=tuple(thick * x for x in flaws.thickness))
    return rig


def drifting(rigs: TrueRig | Sequence[TrueRig], path: Sequence[float]) -> list[TrueRig]:
    """A rig per record, its Young's modulus off by the path, which comes on top of what else differs."""
    each = [rigs] * len(path) if isinstance(rigs, TrueRig) else rigs
    return [replace(r, youngs_modulus=r.youngs_modulus * (1 + x)) for r, x in zip(each, path, strict=True)]


def response(truth: Truth, harmonics: int) -> Array:
    """Coefficients of the accelerometers, harmonics 1 and up, without noise."""
    return read(truth, harmonics)[1][:, 1:, 1:]


def relative_change(changed: Array, plain: Array) -> float:
    """Rms of the change over that of the response, each channel scaled by its own; (records, channels, harmonics)."""
    off, whole = (np.sum(np.abs(a) ** 2, axis=(0, 2)) for a in (changed - plain, plain))
    return float(np.sqrt(np.mean(off / whole)))


def probe_rigs(rig: TrueRig, flaws: Flaws) -> dict[str, tuple[TrueRig, tuple[float, ...]]]:
    """By part the rig with a little of it alone, and the path of its modulus; `numerics` is the rig without any."""
    bare, still = other_numerics(rig, flaws), (0.0,) * len(flaws.path)
    found = {part: (imperfect(bare, flaws, {part: PROBE}), still) for part in (NUMERICS, *PARTS)}
    return found | {"drift": (bare, tuple(PROBE * x for x in flaws.path))}


@dataclass(frozen=True)
class Probed:
    """Change of a few records' response by each part at full strength, to first order, and what it is a change of."""

    changes: Mapping[str, Array]
    numerics: Array
    plain: Array

    def size(self, change: Array) -> float:
        return relative_change(self.plain + change, self.plain)

    def sizes(self, shares: Mapping[str, float]) -> dict[str, float]:
        """Of each part on its own."""
        parts = {part: self.size(shares[part] * change) for part, change in self.changes.items()}
        return parts | {NUMERICS: self.size(self.numerics)}

    def together(self, shares: Mapping[str, float]) -> float:
        return self.size(sum(shares[part] * change for part, change in self.changes.items()))


def probe(plain: Truth, good: Array, flaws: Flaws, settings: Settings, harmonics: int) -> Probed:
    """A little of each part, on a few of the good records, all in one batch."""
    picked = good[:: max(1, round(len(good) / PROBED))]
    asked, count = [plain.records[i] for i in picked], len(picked)
    cases = probe_rigs(plain.rig, flaws)
    rigs = [rig for one, path in cases.values() for rig in drifting([one] * count, [path[i] for i in picked])]
    truth = simulate_records(rigs, asked * len(cases), plain.steps, settings)
    kept = truth.converged.reshape(len(cases), count).all(axis=0)
    blocks = np.arange(len(cases)).repeat(count)
    seen = {}
    for i, (part, (rig, _)) in enumerate(cases.items()):
        seen[part] = response(replace(truth.where(blocks == i), rig=rig), harmonics)[kept]
    bare, before = seen[NUMERICS], response(plain, harmonics)[picked][kept]
    return Probed({part: (seen[part] - bare) / PROBE for part in PARTS}, bare - before, before)


def shares_of(probed: Probed, size: float, weights: Array) -> dict[str, float]:
    """Share of its full strength that each part takes.

    Parts that move the same frequencies add up or cancel: all are scaled once more to be of the size together.
    """
    wanted = dict(zip(PARTS, (size * np.sqrt(weights)).tolist(), strict=True))
    shares = {part: min(1.0, wanted[part] / max(probed.size(probed.changes[part]), 1e-300)) for part in PARTS}
    return scaled(shares, size / probed.together(shares))


def scaled(shares: Mapping[str, float], factor: float) -> dict[str, float]:
    return {part: min(1.0, share * factor) for part, share in shares.items()}


def background_of(
    plain: Truth, good: Array, asked: float, settings: Settings, harmonics: int, rng: np.random.Generator
) -> Background:
    """A background of about the size asked; `plain` is how the rig moves without, `good` are records fit to probe."""
    flaws = draw_flaws(plain.rig, len(plain.records), rng)
    weights = rng.dirichlet(np.ones(len(PARTS)))
    probed = probe(plain, good, flaws, settings, harmonics)
    made = realised(plain, good, flaws, shares_of(probed, asked, weights), settings, harmonics)
    if not 1 / MISSES < made.size / asked < MISSES:
        made = realised(plain, good, flaws, scaled(made.shares, asked / made.size), settings, harmonics)
    return replace(made, parts=probed.sizes(made.shares))


def realised(
    plain: Truth, good: Array, flaws: Flaws, shares: dict[str, float], settings: Settings, harmonics: int
) -> Background:
    """How the rig moves with these shares of its flaws, and how far that is from how it moves without."""
    rig = imperfect(other_numerics(plain.rig, flaws), flaws, shares)
    path = tuple(shares["drift"] * x for x in flaws.path)
    truth = replace(simulate_records(drifting(rig, path), plain.records, plain.steps, settings), rig=rig)
    both = good[truth.converged[good]]
    size = relative_change(response(truth, harmonics)[both], response(plain, harmonics)[both])
    return Background(rig, path, truth, shares, size)
