"""What the sensors of a rig with joints say of each other: in which unit they would agree, or which is at fault.

No laws are used: joint forces are free, and what channels read beyond as many is checked. So a channel is named where
all others agree without it, and a unit where all agree once converted.
"""

from collections.abc import Callable

import numpy as np

from hbm.inverse.findings import unit_sentence
from hbm.inverse.reconstruction import Misfit
from hbm.inverse.units import FALL, OPPOSITE, UNITS, agreeing
from hbm.measurement.spectra import MeasuredSpectra
from models.jointed import JointedRig

APART = 10.0
"""Without any other channel so many times as much must be left as without the one at fault."""

Read = Callable[[JointedRig, MeasuredSpectra], Misfit]


def joint_sensors(rig: JointedRig, spectra: MeasuredSpectra, before: Misfit, read: Read) -> tuple[str, ...]:
    """Findings about sensors that contradict each other: a unit, else a channel; none where neither explains it.

    Parameters
    ----------
    rig : JointedRig
    spectra : MeasuredSpectra
    before : Misfit
        What they leave.
    read : callable
        Misfit of other spectra.
    """
    found = _unit(rig, spectra, before, read) or _fault(rig, spectra, before, read)
    return (found,) if found else ()


def _unit(rig: JointedRig, spectra: MeasuredSpectra, before: Misfit, read: Read) -> str:
    """The finding about a unit in which the sensors would agree; empty where there is none."""

    def chi2(left: Misfit) -> float:
        return float(left.chi2.sum())

    def explains(left: Misfit, chance: float) -> bool:
        return FALL * _excess(left) < _excess(before) and chi2(before) - chi2(left) > chance

    found = agreeing(rig, spectra, (*UNITS, OPPOSITE), lambda other: read(rig, other), chi2, explains)
    if found is None:
        return ""
    unit, left = found
    return unit_sentence(unit.said, str(rig.force_among(spectra.channels)), _reduced(before), _reduced(left))


def _fault(rig: JointedRig, spectra: MeasuredSpectra, before: Misfit, read: Read) -> str:
    """The finding about one channel that contradicts all others; empty where there is none, or none can be told."""
    spare = before.channels[:-1] if len(before.channels) - 2 > rig.ports else ()  # without one some must be left over
    without = {name: read(rig, spectra.without(name)) for name in spare}
    left = sorted(without, key=lambda name: _excess(without[name]))
    if len(left) < 2:
        return ""
    best, second = (_excess(without[name]) for name in left[:2])
    if not (FALL * best < _excess(before) and APART * best < second):
        return ""
    return (
        f"{left[0]}: contradicts the other channels, without which the misfit of the sensors falls "
        f"{_reduced(before):.3g} -> {_reduced(without[left[0]]):.3g} per degree of freedom; check its gain, sign, "
        "place and direction, or leave it out"
    )


def _reduced(misfit: Misfit) -> float:
    """Misfit per degree of freedom of all records; nan without any."""
    expected = float(misfit.expected.sum())
    return float(misfit.chi2.sum()) / expected if expected > 0.0 else np.nan


def _excess(misfit: Misfit) -> float:
    """What of it noise does not explain; at least its own scatter."""
    expected = float(misfit.expected.sum())
    scatter = np.sqrt(2.0 / expected) if expected > 0.0 else np.nan
    return max(_reduced(misfit) - 1.0, float(scatter))
