"""Numbers of a rig: what they may be off by, and other values of them."""

from collections.abc import Collection, Mapping

from hbm.sensitivity.scalars import ALPHA, FRICTION, LOAD, sensor_scalars
from models.change import Scalar, drift_scalars, element_scalars, structure_scalars
from models.friction import describe, parameters
from models.numbers import with_number
from models.rig import Rig

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


def tolerances(rig: Rig, channels: Collection[str] = ()) -> dict[str, float]:
    """Numbers of a rig that are calibrated, and the standard deviation of each: relative, but of a delay in seconds.

    Parameters
    ----------
    rig : Rig
    channels : collection of str
        Channels of motion that were measured.
    """
    known = nominal_scalars(rig)
    law = {key: TOLERANCES.get(key, TOLERANCES["friction"]) for key in known if key.startswith(FRICTION)}
    others = {key: std for key, std in TOLERANCES.items() if key in known}
    if rig.damping.modal_ratios is not None:
        others.pop(ALPHA, None)
    numbers = {key: std for key, std in (law | others).items() if known[key] > 0.0}
    places = [key for key in ("excitation.position", *(f"channels.{c}.position" for c in channels)) if key in known]
    numbers |= {key: TOLERANCES["position"] / known[key] for key in places if known[key] > 0.0}
    for c in channels:
        numbers |= {f"channels.{c}.gain": TOLERANCES["gain"], f"channels.{c}.delay": TOLERANCES["delay"]}
    return numbers


def nominal_scalars(rig: Rig) -> dict[str, float]:
    """Numbers of a rig by their keys."""
    return {key: float(scalar.value) for key, scalar in _scalars(rig).items()}


def unit_of(rig: Rig, key: str) -> str:
    """SI unit of a number of a rig."""
    return _scalars(rig)[key].unit


def _scalars(rig: Rig) -> dict[str, Scalar]:
    law = zip(describe(type(rig.contact.law)).items(), parameters(rig.contact.law).values(), strict=True)
    return {
        **{FRICTION + name: Scalar(value, p.unit) for (name, p), value in law},
        LOAD: Scalar(rig.contact.normal_load, "N"),
        **sensor_scalars(rig),
        **structure_scalars(rig),
        **element_scalars(rig),
        **drift_scalars(rig),
    }


def with_values(rig: Rig, values: Mapping[str, float]) -> Rig:
    """The rig with other values of some of its numbers."""
    for key, value in values.items():
        rig = with_number(rig, key, value)
    return rig
