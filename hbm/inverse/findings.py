"""Findings of a check of the sensors in words, a line each, with numbers."""

from collections.abc import Iterator

import numpy as np
from scipy import special

from hbm.inverse.faults import Fault
from hbm.inverse.readings import Others, Readings, even
from hbm.inverse.reconstruction import CONSISTENT
from hbm.inverse.resolution import harmonics
from hbm.inverse.sensing import UNKNOWN_FORCE
from hbm.measurement.spectra import MeasuredSpectra
from models.rig import Rig

DEAD = 0.05
"""A channel is called dead that reads less than this share of what the others imply."""

FORCE_FREE = (
    f"force: not measured; its fundamental is free within {UNKNOWN_FORCE:g} times the level, its phase unknown, its "
    "higher harmonics count as zero"
)
"""The warning where no channel measured the force."""


def sentence(fault: Fault, rig: Rig, before: Readings, after: Readings) -> str:
    """Sentence about a fault, with the misfit of the sensors before and after."""
    fell = f"misfit of the sensors {before.everyone.reduced:.3g} -> {after.everyone.reduced:.3g} per degree of freedom"
    said = ", or ".join(
        _said(f, rig).removeprefix(f"{fault.channel}: " if i else "")
        for i, f in enumerate((fault, *fault.alternatives))
    )
    return f"{said}; {fell}; {'exchanged back' if fault.other else 'left out'}"


def unit_sentence(said: str, force: str, before: float, after: float) -> str:
    """Sentence about a unit in which the sensors would agree; their misfits per degree of freedom."""
    return (
        f"units: the sensors read as if {said}, with which converted the misfit of the sensors falls "
        f"{before:.3g} -> {after:.3g} per degree of freedom; convert them, or leave "
        f"{force} out if it alone is wrong: nothing found here is right as they are"
    )


def sign_sentence(force: str, before: Readings, after: Readings) -> str:
    """Sentence about a force of the opposite sign, where something else is wrong too."""
    return (
        f"{force}: has it the opposite sign? With it turned over the misfit of the sensors falls "
        f"{before.everyone.reduced:.3g} -> {after.everyone.reduced:.3g} per degree of freedom"
    )


def _said(fault: Fault, rig: Rig) -> str:
    name, value, std = fault.channel, fault.value, fault.std
    if fault.cause == "sensor-dead" or (fault.cause == "sensor-gain" and abs(value) < DEAD):
        return f"{name}: dead, reads {_sure(value, std)} times what the other channels imply"
    if fault.cause == "sensor-gain":
        return f"{name}: reads {_sure(value, std)} times what the other channels imply"
    if fault.cause == "sensor-delay":
        return f"{name}: {'lags' if value > 0 else 'leads'} the other channels by {_sure(abs(value), std, 1e6)} us"
    if fault.cause == "sensor-position":
        nominal = next(c.position for c in rig.channels if c.name == name)
        return f"{name}: sits at {_sure(value, std, 1e3)} mm by the other channels, not at {1e3 * nominal:g} mm"
    if fault.cause == "swapped-channels":
        return f"{name} and {fault.other}: exchanged"
    if fault.cause == "sensor-noise":
        return f"{name}: scatters {_sure(value, std)} times as much as its stated standard deviation"
    return f"{name}: contradicts the others, {value:.1f} standard deviations rms; no gain, delay or place explains it"


def _sure(value: float, std: float, scale: float = 1.0) -> str:
    """A value and its standard deviation, to two digits of the latter."""
    value, std = scale * value, scale * std
    digits = min(max(1 - int(np.floor(np.log10(std))), 0), 9) if 0.0 < std < np.inf else 3
    return f"{value:.{digits}f} +- {std:.{digits}f}"


def disagreement(base: Readings, left_out: bool) -> Iterator[str]:
    """Misfit that is left and is no channel's fault."""
    everyone = base.everyone
    if len(base.seen.channels) < 2 or everyone.dof < 1.0:
        yield (
            f"{len(base.seen.channels)} response channel{'s' if len(base.seen.channels) > 1 else ''} and "
            f"{'a' if base.channels[-1] in base.seen.spectra.channels else 'no'} measured force: "
            "nothing is left to check the sensors and the structure by"
        )
        return
    reduced, stated = everyone.reduced, base.as_stated  # less scatter than stated shows only beside what is stated
    low, high = special.chdtr(stated.dof, stated.chi2), special.chdtrc(everyone.dof, everyone.chi2)
    if min(low, high) > CONSISTENT:
        return
    scatter = "standard deviations of {}: the sensors scatter {} times what is stated, all alike; stated too {}"
    if low < high:
        yield scatter.format(base.seen.spectra.noise, _times(stated), "large")
    elif _alike(base):
        yield scatter.format(base.seen.spectra.noise, _times(everyone), "small")
    else:
        yield (
            f"the sensors contradict the structure{' still' if left_out else ''}: misfit {reduced:.3g} per degree of "
            f"freedom, {np.sqrt(reduced):.2g} standard deviations rms; {_worst(base)}; no fault of "
            f"{'one channel' if len(base.seen.channels) > 2 else 'a channel can be told from others that'} explains it"
        )


def _times(everyone: Others) -> str:
    """How many times what is stated sensors scatter."""
    return _sure(np.sqrt(everyone.reduced), np.sqrt(everyone.reduced / (2.0 * everyone.dof)))


def _alike(base: Readings) -> bool:
    """Whether channels, harmonics and records scatter alike, as where only standard deviations are wrong."""
    error, free = np.abs(base.residual) ** 2, 2.0 * (np.sign(base.weight) - base.leverage)
    sums = ((0, 1), (0, 2), (1, 2))
    return all(even(error.sum(axis=axes), free.sum(axis=axes)) for axes in sums)


def _worst(base: Readings) -> str:
    """Place of the largest misfit."""
    error = np.sum(np.abs(base.residual) ** 2, axis=2)
    r, k = np.unravel_index(int(np.argmax(error)), error.shape)
    spectra = base.seen.spectra
    share = error[r, k] / error.sum()
    return f"largest at {spectra.hz[r]:.4g} Hz, {spectra.level[r]:.3g} N, harmonic {k + 1} ({100 * share:.0f} %)"


def assumed(rig: Rig, spectra: MeasuredSpectra) -> Iterator[str]:
    """Assumptions about signals that some channels did not measure; together where they lack the same harmonics."""
    force = rig.force_among(spectra.channels)
    if force is None:
        yield FORCE_FREE
    measured = {name: spectra.measured[:, i, 1:] for i, name in enumerate(spectra.channels)}
    responses = [name for name in spectra.channels if name != force]
    nobody = [k for k in range(spectra.H) if not any(measured[name][:, k].any() for name in responses)]
    lacks: dict[str, list[str]] = {}
    for name in spectra.channels:
        seen = measured[name]
        known = [] if name == force else nobody
        never = [k for k in range(spectra.H) if not seen[:, k].any() and k not in known]
        partly = [k for k in range(spectra.H) if seen[:, k].any() and not seen[:, k].all()]
        for missing, where in ((never, ""), (partly, " in all records")):
            if missing:
                effect = "taken for zero" if name == force else "left to the other channels"
                sentence = f"{harmonics(missing)} not measured{where}; {effect}"
                lacks.setdefault(sentence, []).append(name)
    for sentence, names in lacks.items():
        yield f"{', '.join(names)}: {sentence}"
