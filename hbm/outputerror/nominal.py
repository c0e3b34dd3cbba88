"""Numbers of a rig: what they may be off by, and other values of them."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from hbm.errors import InputError, expect_not_negative
from models.causes.parameter import STIFFNESSES
from models.jointed import AnyRig, JointedRig
from models.jointednumbers import GAINS
from models.rig import Rig
from models.scalars import ALPHA, FORCE, FRICTION, LOAD

TOLERANCES = {
    "beam.youngs_modulus": 0.01,
    LOAD: 0.02,
    ALPHA: 0.05,
    FRICTION + "mu": 0.02,
    FRICTION + "mu_static": 0.02,
    "friction": 0.05,
    "gain": 0.005,
    "delay": 2e-6,
    "position": 5e-4,
}
"""What numbers of a rig file are off by in a rig that nobody would call wrong, relative standard deviations.

`friction` stands for every other parameter of a friction law; `gain`, `delay` [s] and `position` [m] for those of every
channel and of the excitation, absolute.
"""


FREQUENCY, RATIO, SHAPE = 0.005, 0.2, 0.03
"""Tolerances of what is identified of modes: frequencies and damping ratios, relative; and entries of shapes, relative
to the largest of their mode."""

FORCE_GAIN = 0.1
"""Tolerance of a force per unit of what was measured in its place, which nobody has calibrated."""

DELAY = ".delay"
"""Ending of the keys of what is known to a time, not to a share of itself."""

SHAPES, BETWEEN, RESIDUALS = "modal.ports.", "modal.damping_matrix[", "modal.flexibility["
"""Beginnings of the keys of entries of shapes, of the damping between modes, and of residual flexibility."""


def tolerances(
    rig: AnyRig, channels: Collection[str] = (), stated: Mapping[str, float] | None = None, where: str = "tolerances"
) -> dict[str, float]:
    """Numbers of a rig that are calibrated, and the standard deviation of each: relative, but of a delay in seconds.

    Parameters
    ----------
    rig : Rig
    channels : collection of str
        Channels that were measured; those of motion count.
    stated : mapping of str to float, optional
        What goes before the usual tolerance of a number; 0 for one that is exact, and not calibrated.
    where : str
        Who asks, for the message.

    Raises
    ------
    InputError
        If one is stated of what is no number of the rig, or of 0 that is no delay; or none >= 0 is.
    """
    measured = [c.name for c in rig.response_channels if c.name in channels]
    found = _of_joints(rig, measured) if isinstance(rig, JointedRig) else _of_contact(rig, measured)
    known = nominal_scalars(rig)
    for key, std in (stated or {}).items():
        if not (known.get(key) or (key in known and key.endswith(DELAY))):
            accepted = ", ".join(name for name, number in known.items() if number)
            raise InputError(f"{where}: tolerance of {key}; must be of a number of the rig file, not 0: {accepted}")
        expect_not_negative(std, f"tolerance of {key}", where, "s" if key.endswith(DELAY) else "relative")
        found[key] = float(std)
    return {key: std for key, std in found.items() if std > 0.0}


def _of_contact(rig: Rig, measured: Sequence[str]) -> dict[str, float]:
    known = nominal_scalars(rig)
    law = {key: TOLERANCES.get(key, TOLERANCES["friction"]) for key in known if key.startswith(FRICTION)}
    others = {key: std for key, std in TOLERANCES.items() if key in known}
    if rig.damping.modal_ratios is not None:
        others.pop(ALPHA, None)
    numbers = {key: std for key, std in (law | others).items() if known[key] > 0.0}
    places = [key for key in ("excitation.position", *(f"channels.{c}.position" for c in measured)) if key in known]
    numbers |= {key: TOLERANCES["position"] / known[key] for key in places if known[key] > 0.0}
    return numbers | _of_channels(measured)


def _of_channels(channels: Sequence[str]) -> dict[str, float]:
    found: dict[str, float] = {}
    for c in channels:
        found |= {f"channels.{c}.gain": TOLERANCES["gain"], f"channels.{c}.delay": TOLERANCES["delay"]}
    return found


def _of_joints(rig: JointedRig, measured: Sequence[str]) -> dict[str, float]:
    """Tolerances of a rig with joints: of modes as far as anything touches them, and of the laws of the joints.

    Those that the rig states go first; what it states to be exact is held. Of a port that nothing touches it may state
    how its shapes are known: they move once a joint that was not modelled acts there. A damping matrix and residual
    flexibility are exact but where it states how their entries are known.
    """
    found: dict[str, float] = {}
    largest = np.abs(rig.ported.rows).max(axis=0)
    places = {f"{SHAPES}{place}[{i}]": size for place in rig.places for i, size in enumerate(largest, 1)}
    for key, value in nominal_scalars(rig).items():
        if key.startswith(SHAPES):
            if places.get(key, 0.0) > 0.0:
                found[key] = SHAPE * float(places[key]) / (abs(value) or 1.0)
        elif key.startswith("modal.frequencies_hz"):
            found[key] = FREQUENCY
        elif key in STIFFNESSES:
            found[key] = TOLERANCES["beam.youngs_modulus"]
        elif key.startswith("joints.") and value > 0.0:
            name = key.rpartition(".")[2]
            of_contact = LOAD if name == "normal_load" else FRICTION + name
            found[key] = TOLERANCES.get(of_contact, TOLERANCES["friction"])
        elif key.startswith("damping.modal_ratios") and value > 0.0:
            found[key] = RATIO
        elif key == ALPHA and value > 0.0:
            found[key] = TOLERANCES[ALPHA]
        elif key.startswith(GAINS):
            found[key] = FORCE_GAIN
    stated = SHAPES, BETWEEN, RESIDUALS
    found |= {key: std for key, std in rig.tolerances.items() if key in found or key.startswith(stated)}
    return found | _of_channels(measured)


def nominal_scalars(rig: AnyRig) -> dict[str, float]:
    """Numbers of a rig by their keys, but for the force: that is what each record says."""
    return {key: float(value) for key, (value, _) in rig.numbers.items() if key != FORCE}
