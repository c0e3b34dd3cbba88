"""Units that all responses, or the force, may be in by mistake: tried where the force contradicts the responses.

A factor common to all responses is a gain of the force as well, for friction and reaction are not measured. A gain that
is a factor between two units is likelier a unit: no channel is at fault then, and none is left out.
"""

from collections.abc import Callable
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy.constants import g

from hbm.inverse.faults import Fault, explanations, times
from hbm.inverse.readings import Readings
from hbm.measurement.spectra import MeasuredSpectra
from models.jointed import AnyRig
from models.rig import Rig

SURE = 20.0
"""A unit is believed that makes the measurement so much more likely: twice the logarithm, less the price of choice."""

FALL = 30.0
"""Factor by which the misfit must fall where something else is left."""

CLOSE, NEAR = 3.0, 0.05
"""The gain that is left of the force must be 1 within so many standard deviations, or to this share: no two units are
as close, and sensors may be off by that besides."""

MOTION = ("acceleration", "velocity", "displacement")


class Unit(NamedTuple):
    """What channels may be in by mistake: their quantities, in words, and the factor to what they must be in."""

    quantities: tuple[str, ...]
    said: str
    factor: float

    def converted(self, rig: AnyRig, spectra: MeasuredSpectra) -> MeasuredSpectra:
        """Spectra in the units that they must be in, if these are the ones they are in."""
        for c in rig.channels:
            if c.name in spectra.channels and c.quantity in self.quantities:
                spectra = times(spectra, c.name, np.full((len(spectra), spectra.H + 1), self.factor + 0j))
        return spectra


UNITS = (
    Unit(("acceleration",), "all accelerations are in g instead of m/s2", g),
    Unit(MOTION, "all responses are in mm instead of m", 1e-3),
    Unit(MOTION, "all responses are rms values instead of amplitudes", 2.0**0.5),
    Unit(("force",), "the force is in kgf instead of N", g),
    Unit(("force",), "the force is in kN instead of N", 1e3),
    Unit(("force",), "the force is an rms value instead of an amplitude", 2.0**0.5),
)

OPPOSITE = Unit(("force",), "the force has the opposite sign", -1.0)
"""No unit, but mistaken alike."""


def with_gain(rig: AnyRig, channel: str, gain: float) -> list[str]:
    """What is in which unit where a channel seems to read a multiple of the truth, in words; nothing for other gains.

    Responses that all read a multiple are a gain of the force, the other way round.
    """
    quantity, known = next(c.quantity for c in rig.channels if c.name == channel), {c.quantity for c in rig.channels}
    own = [(unit.said, 1.0 / unit.factor) for unit in UNITS if quantity in unit.quantities]
    if quantity == "force":
        own += [(unit.said, unit.factor) for unit in UNITS if (known - {"force"}) & set(unit.quantities)]
    else:
        own = [(f"its values are {said.partition(' are ')[2]}", factor) for said, factor in own]
    return [said for said, factor in own if abs(gain / factor - 1.0) < NEAR]


def mistaken(
    rig: Rig, spectra: MeasuredSpectra, base: Readings, read: Callable[[MeasuredSpectra], Readings]
) -> tuple[Unit, Readings] | None:
    """The unit in which the sensors would agree, with what they read in it; none where they do not in any.

    Parameters
    ----------
    rig : Rig
    spectra : MeasuredSpectra
        Force and responses that contradict each other.
    base : Readings
        Of these.
    read : callable
        Readings of spectra.
    """
    measured = {c.quantity for c in rig.channels if c.name in spectra.channels}
    possible = [unit for unit in UNITS if measured & set(unit.quantities)] if "force" in measured else []
    if not possible or not _off(base):
        return None
    tried = [(unit, read(unit.converted(rig, spectra))) for unit in possible]
    chance = SURE + 2.0 * np.log(len(possible))
    holding = [(unit, other) for unit, other in tried if _explains(other, base, chance)]
    force = base.channels[-1]
    return min(holding, key=lambda pair: (off_level(pair[1].seen.spectra, force), pair[1].everyone.chi2), default=None)


def _off(readings: Readings) -> bool:
    """Whether the force reads another multiple of what the responses imply than one, beyond doubt."""
    if len(readings.seen.channels) < 2:  # one response does not tell friction from force
        return False
    right, _, gain = _force(readings)
    return right.chi2 - gain.chi2 > SURE


def _explains(other: Readings, base: Readings, chance: float) -> bool:
    """Whether the sensors agree once converted, but for what is wrong otherwise."""
    before, after = base.everyone, other.everyone
    explained = after.agree or FALL * after.excess < before.excess
    return explained and before.chi2 - after.chi2 > chance and _one_to_one(other)


def off_level(spectra: MeasuredSpectra, force: str) -> float:
    """How far the force is from its nominal level, in decades to one digit: tells its unit from that of responses."""
    share = np.nanmedian(np.abs(spectra.complex(force)[:, 1]) / spectra.level)
    return round(abs(float(np.log10(max(share, 1e-9)))), 1)


def _one_to_one(readings: Readings) -> bool:
    """Whether the force reads what the responses imply: one that is dead agrees with these in any coarse unit."""
    right, dead, gain = _force(readings)
    scale = max(gain.chi2 / readings.count(gain.channel), 1.0)  # an imperfect explanation is less sure
    close = right.chi2 - gain.chi2 < CLOSE**2 * scale or abs(gain.value - 1.0) < NEAR
    return close and dead.chi2 - right.chi2 > SURE * scale


def _force(readings: Readings) -> tuple[Fault, Fault, Fault]:
    """The force as it is, as if it were dead, and with a gain, beside what the responses say of it."""
    name = readings.channels[-1]
    right, dead, gain = islice(explanations(readings, name, readings.others((name,))), 3)
    return right, dead, gain
