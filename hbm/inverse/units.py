"""Units that all responses, or the force, may be in by mistake: tried where sensors contradict each other.

A factor common to all responses is a gain of the force as well, for friction and reaction are not measured. A gain that
is a factor between two units is likelier a unit: no channel is at fault then, and none is left out.
"""

from collections.abc import Callable, Sequence
from itertools import islice
from typing import NamedTuple, TypeVar

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


Left = TypeVar("Left")
"""What sensors leave unexplained, by whatever reads them."""


def agreeing(
    rig: AnyRig,
    spectra: MeasuredSpectra,
    units: Sequence[Unit],
    read: Callable[[MeasuredSpectra], Left],
    chi2: Callable[[Left], float],
    explains: Callable[[Left, float], bool],
) -> tuple[Unit, Left] | None:
    """The unit in which the sensors would agree, with what they leave in it; none where they do not in any.

    Of several it is that in which the force is nearest to its level, then that which leaves least.

    Parameters
    ----------
    rig : Rig or JointedRig
    spectra : MeasuredSpectra
        Sensors that contradict each other. Without a force among them no unit is told: it may be of that unit too.
    units : sequence of Unit
        Those to try.
    read : callable
        What the sensors leave of spectra.
    chi2 : callable
        The misfit of that.
    explains : callable
        Whether a unit explains the contradiction, by what is left in it and the fall of chi2 that choice alone makes.
    """
    force = rig.force_among(spectra.channels)
    measured = {c.quantity for c in rig.channels if c.name in spectra.channels}
    possible = [unit for unit in units if measured & set(unit.quantities)]
    if force is None or not possible:
        return None
    converted = [(unit, unit.converted(rig, spectra)) for unit in possible]
    tried = [(unit, other, read(other)) for unit, other in converted]
    chance = SURE + 2.0 * np.log(len(possible))
    holding = [
        ((_off_level(other, force), chi2(left)), unit, left) for unit, other, left in tried if explains(left, chance)
    ]
    return min(holding, key=lambda found: found[0])[1:] if holding else None


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
    if rig.force_among(spectra.channels) is None or not _off(base):
        return None
    return agreeing(
        rig,
        spectra,
        UNITS,
        read,
        lambda other: other.everyone.chi2,
        lambda other, chance: _explains(other, base, chance),
    )


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


def _off_level(spectra: MeasuredSpectra, force: str) -> float:
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
