"""Whether the sensors agree with each other and the structure, and which of them is at fault if not.

:func:`check_sensors` is the entry. A channel is blamed where three things hold together: all others agree without it,
one named fault (:mod:`hbm.inverse.faults`) makes it agree too, and neither a fault of another channel nor a small error
of the rig file (:mod:`hbm.inverse.rivals`) does as well. Where the structure itself is wrong no channel is blamed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from hbm.inverse.contactforce import likeliest, nonlinear_forces
from hbm.inverse.faults import Fault, explanations, with_std
from hbm.inverse.findings import DEAD, assumed, disagreement, sentence, sign_sentence, unit_sentence
from hbm.inverse.readings import Coupling, Others, Readings, by_noise, even, readings
from hbm.inverse.rivals import structure_score
from hbm.inverse.sensing import Complex, Sensing, sensing
from hbm.inverse.units import OPPOSITE, mistaken
from hbm.measurement.spectra import MeasuredSpectra
from models.change import structure_change
from models.rig import Rig

SURE = 20.0
"""A fault is believed that makes the measurement so much more likely: twice the logarithm, less the price of choice."""

SUSPECT = 15.0
"""Squared significance from which a channel is looked into though all agree within the noise."""

FALL = 30.0
"""Factor by which the misfit must fall where something is left that is no fault of a channel."""

APART = 10.0
"""Twice the logarithm by which a fault is more likely than any fault of another channel."""

ONLY = 0.2
"""A channel that scatters is blamed where leaving out any other leaves at least this share of the misfit."""

TURNED = 3.0
"""Factor by which what contradicts falls where the sign of the force is turned over: of two signs one is as likely
beforehand as a cable is exchanged."""

ROUNDS = 12
CLOSE = 0.1
GROWS = 3.0
"""Turns in which the product of friction and motion is found, at most, until no reading changes by more [std], and
while its changes do not grow like this from turn to turn."""

FITTED = ("sensor-gain", "sensor-delay", "sensor-position")
"""Faults that have a number."""

ENOUGH = 4
"""Response channels that must be left for a second fault to be looked for beside the first."""


@dataclass(frozen=True, eq=False)
class SensorCheck:
    """Result of a check of the sensors.

    Attributes
    ----------
    faults : tuple of Fault
        Channels at fault, the worst first.
    findings : tuple of str
        A line each, with numbers: faults, contradictions, what is assumed of what was not measured.
    spectra : MeasuredSpectra
        Without the channels at fault; exchanged ones are exchanged back.
    before, after : float
        Misfit per degree of freedom of all channels, and of those left; nan without degrees of freedom.
    unit : str
        The finding about a unit that is not the one that numbers must be in; empty where there is none.
    opposite : bool
        Whether the force contradicts the structure less with its sign turned over, whatever else is wrong.
    """

    faults: tuple[Fault, ...]
    findings: tuple[str, ...]
    spectra: MeasuredSpectra
    before: float
    after: float
    unit: str = ""
    opposite: bool = False

    def __repr__(self) -> str:
        return "\n".join(self.findings) or f"the sensors agree: misfit {self.after:.2f} per degree of freedom"

    def with_force(self, rig: Rig, spectra: MeasuredSpectra) -> MeasuredSpectra:
        """What was checked without the channels at fault, but for a force that reads a multiple: divided by that.

        A force that seems to have the opposite sign is turned over.
        """
        if self.opposite:
            spectra = OPPOSITE.converted(rig, spectra)
        for fault in self.faults:
            of_force = rig.force_among((fault.channel,)) is not None
            multiple = of_force and fault.cause == "sensor-gain" and abs(fault.value) > DEAD
            spectra = fault.corrected(rig, spectra)[1] if multiple else _mended(fault, rig, spectra)
        return spectra


def check_sensors(rig: Rig, spectra: MeasuredSpectra) -> SensorCheck:
    """Find channels that contradict the others, and say how.

    Raises
    ------
    InputError
        If no response was measured.
    """
    usable, faults, lines, unit = spectra, list[Fault](), list[str](), ""
    base = first = _readings(rig, spectra)
    while fresh := _one(rig, usable, base) or _two(rig, usable, base):
        if unit := _unit(rig, usable, base, fresh):
            break
        for fault in fresh:
            usable = _mended(fault, rig, usable)
            base, before = _readings(rig, usable), base
            lines.append(sentence(fault, rig, before, base))
        faults += fresh
    unit = unit or _unit(rig, usable, base, ())
    turned = None if unit else _turned_over(rig, usable, base)
    lines += [*([unit] if unit else disagreement(base, bool(faults))), *assumed(rig, spectra)]
    lines += [] if turned is None else [sign_sentence(base.channels[-1], base, turned)]
    misfits = first.everyone.reduced, base.everyone.reduced
    return SensorCheck(tuple(faults), tuple(lines), usable, *misfits, unit, opposite=turned is not None)


def _unit(rig: Rig, spectra: MeasuredSpectra, base: Readings, faults: Sequence[Fault]) -> str:
    """Which unit all responses, or the force, seem to be in; nothing where a sensor is at fault."""
    force = base.channels[-1]
    if not all(fault.channel == force and fault.cause in ("sensor-gain", "sensor-dead") for fault in faults):
        return ""
    found = mistaken(rig, spectra, base, lambda other: _readings(rig, other))
    if found is None:
        return ""
    unit, converted = found
    return unit_sentence(unit.said, force, base.everyone.reduced, converted.everyone.reduced)


def _turned_over(rig: Rig, spectra: MeasuredSpectra, base: Readings) -> Readings | None:
    """Readings with the sign of the force turned over, where these contradict the structure far less."""
    if rig.force_among(spectra.channels) is None or base.everyone.agree:
        return None
    other = _readings(rig, OPPOSITE.converted(rig, spectra))
    return other if TURNED * max(other.everyone.excess, 0.0) < base.everyone.excess else None


def _readings(rig: Rig, spectra: MeasuredSpectra) -> Readings:
    """Readings beside the motion; the product of friction and motion is found in turns while they come closer."""
    seen = sensing(rig, spectra)
    straight = replace(seen, rig=_straight(seen.rig))
    none = np.zeros(seen.stiffness.shape, dtype=complex)
    coupling, change = Coupling(none, none, np.zeros(len(spectra))), np.inf
    for _ in range(ROUNDS if seen.structure.shortening.any() or rig.elements else 0):
        fresh = _coupling(seen, straight, coupling)
        moved = seen.by_modal_forces(fresh.forces - coupling.forces)
        before, change = change, float(np.abs(seen.weight * moved).max())
        if change > GROWS * before:  # what the sensors read is no motion of this structure
            break
        coupling = fresh
        if change < CLOSE:
            break
    measured = rig.force_among(spectra.channels) is not None
    return readings(seen if measured else _unsure(seen, coupling), coupling, seen)


def _coupling(seen: Sensing, straight: Sensing, before: Coupling) -> Coupling:
    """What friction and motion make together, of friction and motion found beside `before`."""
    left = replace(straight, measured=seen.measured - seen.by_modal_forces(before.forces))
    found = likeliest(left, np.zeros(len(seen.spectra)))
    q = found.q + before.forces / seen.stiffness
    size = np.linalg.norm(found.friction[:, 1:], axis=1) / np.sqrt(2.0)
    most = seen.rig.contact.normal_load  # of a mean, whatever the friction
    forces = nonlinear_forces(seen, found.friction, q)
    return Coupling(forces, -q @ seen.structure.shortening, np.minimum(size, most))


def _straight(rig: Rig) -> Rig:
    """The rig without what depends on the motion nonlinearly."""
    return replace(rig, contact=replace(rig.contact, foreshortening=False), elements=())


def _unsure(seen: Sensing, coupling: Coupling) -> Sensing:
    """The same, sensors trusted less where they see the product of motion and a friction that is hardly known."""
    left = replace(seen, rig=_straight(seen.rig), measured=seen.measured - seen.by_modal_forces(coupling.forces))
    found = likeliest(left, np.zeros(len(seen.spectra)))
    share = np.linalg.norm(found.factor[:, 1, 0], axis=1) / np.maximum(np.abs(found.friction[:, 1]), 1e-9)
    seen_of_it = share[:, None, None] * np.abs(seen.weight * seen.by_modal_forces(coupling.forces))
    return replace(seen, weight=seen.weight / np.hypot(1.0, seen_of_it))


def _mended(fault: Fault, rig: Rig, spectra: MeasuredSpectra) -> MeasuredSpectra:
    """Spectra without a channel at fault; exchanged ones back in their places."""
    return fault.corrected(rig, spectra)[1] if fault.other else spectra.without(fault.channel)


# ---- who is at fault


@dataclass(frozen=True, eq=False)
class _Left:
    """A channel left out: readings with the motion found without it, and what the others say."""

    channel: str
    readings: Readings
    others: Others

    @property
    def excess(self) -> float:
        """Misfit of the others beyond noise."""
        return self.others.excess


@dataclass(frozen=True, eq=False)
class _Case:
    """A fault of a channel, beside what the others say."""

    fault: Fault
    left: _Left

    @property
    def score(self) -> float:
        return self.left.others.chi2 + self.fault.score

    @property
    def involved(self) -> set[str]:
        return {self.fault.channel, self.fault.other}

    @property
    def excess(self) -> float:
        """Misfit of all channels beyond noise that the fault does not explain."""
        return self.left.excess + self.fault.chi2 - self.left.readings.count(self.fault.channel)


def _one(rig: Rig, spectra: MeasuredSpectra, base: Readings) -> list[Fault]:
    """The channel at fault, the two that are exchanged, or none."""
    everyone = base.everyone
    agree = everyone.agree
    names = [name for name in base.channels if name in spectra.channels]
    if len(base.seen.channels) < 2 or (agree and max(_significance(base, name) for name in names) < SUSPECT):
        return []
    lefts = [_without(rig, spectra, base, name, agree) for name in names]
    cases = list(_cases(lefts))
    best = min(cases, key=lambda case: case.score)
    if not _convincing(best, cases, lefts, everyone) and not agree:
        cases += _exchanged(rig, spectra, base)
        best = min(cases, key=lambda case: case.score)
    if not _convincing(best, cases, lefts, everyone) or structure_score(rig, base) - best.score < APART:
        return []
    return [_measured(best, cases, everyone.excess)]


def _without(rig: Rig, spectra: MeasuredSpectra, base: Readings, channel: str, agree: bool) -> _Left:
    """A channel left out; where sensors contradict, the motion is found anew."""
    beside = base if agree else readings(base.seen, _readings(rig, spectra.without(channel)).coupling)
    return _Left(channel, beside, beside.others((channel,)))


def _cases(lefts: list[_Left]) -> Iterator[_Case]:
    """Faults of the channels, as far as they can compete: a score is never less than the misfit of the others."""
    best = np.inf
    for left in sorted(lefts, key=lambda left: left.others.chi2):
        if left.others.chi2 > best + APART:
            return
        for fault in explanations(left.readings, left.channel, left.others):
            if fault.cause:
                best = min(best, left.others.chi2 + fault.score)
                yield _Case(fault, left)


def _exchanged(rig: Rig, spectra: MeasuredSpectra, base: Readings) -> Iterator[_Case]:
    """Pairs of channels of one quantity, exchanged back.

    The product of friction and motion is small: a pair that does not agree better beside it as it is was not exchanged.
    """
    quantity = {c.name: c.quantity for c in rig.channels}
    for a, b in combinations(base.seen.channels, 2):
        if quantity[a] == quantity[b]:
            fault = Fault("swapped-channels", a, other=b)
            back = fault.corrected(rig, spectra)[1]
            if readings(sensing(rig, back), base.coupling).everyone.chi2 >= base.everyone.chi2:
                continue
            trial = _readings(rig, back)
            others = trial.others((a,))
            added = trial.everyone.chi2 - others.chi2
            yield _Case(replace(fault, chi2=added, score=added), _Left(a, trial, others))


def _convincing(best: _Case, cases: list[_Case], lefts: list[_Left], everyone: Others) -> bool:
    """Whether the others agree without the channel, the fault explains it, and nothing else does as well."""
    rivals = [case.score for case in cases if not case.involved & best.involved]
    price = 2.0 * np.log(4 * len(lefts) + len(lefts) ** 2 / 2)
    unsure = everyone.chi2 - best.score < SURE + price or min(rivals, default=np.inf) - best.score < APART
    if unsure or best.left.others.dof < 1.0:
        return False
    excess = everyone.excess
    others_agree = best.left.others.agree
    if best.fault.cause == "sensor-noise":  # explains anything: all others must agree, and only without this one
        rest = [left.excess for left in lefts if left.channel not in best.involved]
        force = best.fault.channel not in best.left.readings.seen.channels
        return not force and min(rest) > ONLY * excess and (others_agree or FALL * best.left.excess < excess)
    explained = by_noise(best.fault.chi2, best.left.readings.count(best.fault.channel))
    return FALL * best.excess < excess or (others_agree and explained)


def _two(rig: Rig, spectra: MeasuredSpectra, base: Readings) -> list[Fault]:
    """Two channels without which all others agree, each at fault beside these."""
    excess = base.everyone.excess
    if len(base.seen.channels) < ENOUGH + 2 or base.everyone.agree:
        return []
    left = {pair: base.others(pair).chi2 for pair in combinations(base.seen.channels, 2)}
    pair = min(left, key=left.__getitem__)
    others = _readings(rig, spectra.without(pair[0]).without(pair[1])).everyone
    if not others.agree or FALL * others.excess > excess:
        return []
    found = list[Fault]()
    for own, other in (pair, pair[::-1]):
        rest = spectra.without(other)
        found += [fault for fault in _one(rig, rest, _readings(rig, rest)) if fault.channel == own]
    return found if len(found) == len(pair) else []


def _measured(case: _Case, cases: list[_Case], excess: float) -> Fault:
    """The fault with the uncertainty of its parameter, and what else about the channel would explain it as well."""
    if case.fault.cause == "sensor-noise":  # what only scatters is told from what is wrong
        if _white(case):
            return case.fault
        # a structure that is not quite this one leaves a rest beside a fault that is most of what is wrong
        own = [c for c in cases if c.involved == case.involved and c.fault.cause in FITTED]
        most = [c for c in own if FALL * c.excess < excess]
        if not most:
            return replace(case.fault, cause="sensor-unknown")
        case = min(most, key=lambda c: c.score)
    same = [c for c in cases if c.involved == case.involved and c is not case and c.score - case.score < APART]
    fitted = [c.fault for c in same if c.fault.cause in FITTED]
    if case.fault.cause == "sensor-dead":
        fitted = []
    left = case.left
    alternatives = tuple(with_std(fault, left.readings, left.others) for fault in fitted)
    return replace(with_std(case.fault, left.readings, left.others), alternatives=alternatives)


def _white(case: _Case) -> bool:
    """Whether what a channel is off by scatters alike at all harmonics."""
    error, variance = case.left.readings.against(case.fault.channel, case.left.others)
    return even(np.sum(np.abs(error) ** 2 / variance, axis=0), 2.0 * np.sum(variance > 0.0, axis=0))


def _significance(base: Readings, channel: str) -> float:
    """Squared significance of a gain, a delay or a shift of a channel to first order, whichever is largest."""
    j, state = base.channels.index(channel), base.everyone.state
    error, variance = base.against(channel, base.others((channel,)))
    fitted = np.einsum("rks,rks->rk", base.rows[:, :, j], state)
    changes = [fitted, -1j * base.k_Omega * fitted]
    if base.seen.rig.beam is not None and channel in base.seen.channels:
        changes.append(_by_position(base, j, state[..., :2]))
    projected = [float(np.sum((c.conj() * error).real / variance)) ** 2 for c in changes]
    power = [float(np.sum(np.abs(c) ** 2 / variance)) for c in changes]
    return max(a / b if b > 0.0 else 0.0 for a, b in zip(projected, power, strict=True))


def _by_position(base: Readings, j: int, state: Complex) -> Complex:
    """Change of a channel's reading per metre along the beam, by the modes kept."""
    seen, name = base.seen, base.seen.channels[j]
    place = 2 + [c.name for c in seen.rig.response_channels].index(name)  # behind the slip and the drive
    slope = structure_change(seen.rig, (f"channels.{name}.position",)).rows[0, place]
    pushes = np.stack([seen.structure.slip_row, seen.structure.excitation])
    q = (state @ pushes + base.coupling.forces[:, 1:]) / seen.stiffness[:, 1:]
    return np.asarray(base.weight[:, :, j] * seen.factor[:, 1:, j] * (q @ slope))
