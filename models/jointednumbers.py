"""Numbers of a rig with joints by the keys of its rig file: read, changed, and what each does to its structure.

Modes count from 1, as in messages about a rig file: ``modal.frequencies_hz[2]`` is that of the second mode.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from models.bodies.ported import PortedModes
from models.bounds import refuse_text
from models.friction.law import Parameter
from models.joints.joint import Joint
from models.joints.law import described, numbers, with_numbers
from models.numbers import OF_FORCE, no_such_number
from models.parts import Channel, Damping, Excitation

if TYPE_CHECKING:
    from models.jointed import JointedRig

FORCE, ALPHA = "excitation.amplitude", "damping.mass_proportional"
RATIO = re.compile(r"damping\.modal_ratios\[(\d+)\]")
MASS = re.compile(r"masses\[(\d+)\]\.mass")
GAINS = "excitation.force_gain["
"""Beginning of the keys of forces per unit of what stands for them, by level."""


def scalars(rig: "JointedRig") -> dict[str, tuple[float, Parameter]]:
    """All numbers of a rig by their keys, with unit and bounds."""
    found = {
        f"joints.{j.name}.{name}": (float(value), described(j.law)[name])
        for j in rig.joints
        for name, value in numbers(j.law).items()
    }
    found[FORCE] = rig.excitation.amplitude, Parameter("N", "force amplitude", "")
    gain = Parameter("1", "force per unit of what was measured in its place, at a level", "")
    found |= {f"{GAINS}{i}]": (value, gain) for i, (_, value) in enumerate(rig.excitation.force_gain, 1)}
    found |= rig.body.numbers
    lumped = Parameter("kg", "lumped mass", "", strict=False)
    found |= {f"masses[{i}].mass": (lump.mass, lumped) for i, lump in enumerate(rig.masses, 1)}
    if rig.body.damped_by_modes:
        found |= _of_damping(rig)
    return found | rig.of_measuring


def _of_damping(rig: "JointedRig") -> dict[str, tuple[float, Parameter]]:
    if rig.damping.modal_ratios is None:
        return {ALPHA: (rig.damping.mass_proportional, Parameter("1/s", "alpha", "(25)", strict=False))}
    ratio = Parameter("1", "damping ratio", "", strict=False)
    return {f"damping.modal_ratios[{i}]": (value, ratio) for i, value in enumerate(_ratios(rig), 1)}


def _ratios(rig: "JointedRig") -> list[float]:
    """Damping ratio of each mode, one for all among them."""
    return list(np.resize(np.array(rig.damping.modal_ratios), rig.ported.n).tolist())


def with_scalars(rig: "JointedRig", values: Mapping[str, float]) -> "JointedRig":
    """The rig with other values of some of its numbers.

    Raises
    ------
    KeyError
        If there is no such number.
    ValueError
        If a value is text, or not accepted.
    """
    known = rig.numbers
    for key in values:
        if key not in known:
            raise no_such_number(key, known, rig.name)
        refuse_text(key, values[key])
    own = rig.body.numbers
    body = rig.body.with_numbers({key: value for key, value in values.items() if key in own})
    return replace(
        rig,
        body=body,
        damping=_damping(rig, values),
        joints=tuple(_joint(j, values) for j in rig.joints),
        excitation=_excitation(rig.excitation, values),
        channels=tuple(_channel(c, values) for c in rig.channels),
        masses=tuple(
            replace(lump, mass=values.get(f"masses[{i}].mass", lump.mass)) for i, lump in enumerate(rig.masses, 1)
        ),
        drift=tuple(replace(d, rate=values.get(f"drift[{i}].rate", d.rate)) for i, d in enumerate(rig.drift)),
    )


def _excitation(e: Excitation, values: Mapping[str, float]) -> Excitation:
    gains = tuple((level, values.get(f"{GAINS}{i}]", gain)) for i, (level, gain) in enumerate(e.force_gain, 1))
    of_channel = values.get(OF_FORCE, e.channel_gain)
    return replace(e, amplitude=values.get(FORCE, e.amplitude), force_gain=gains, channel_gain=of_channel)


def _damping(rig: "JointedRig", values: Mapping[str, float]) -> Damping:
    if ALPHA in values:
        return replace(rig.damping, mass_proportional=values[ALPHA])
    if not any(RATIO.fullmatch(key) for key in values):
        return rig.damping
    ratios = [values.get(f"damping.modal_ratios[{i}]", ratio) for i, ratio in enumerate(_ratios(rig), 1)]
    return replace(rig.damping, modal_ratios=tuple(ratios))


def _joint(j: Joint, values: Mapping[str, float]) -> Joint:
    known = numbers(j.law)
    new = {name: values.get(f"joints.{j.name}.{name}", value) for name, value in known.items()}
    return j if new == known else replace(j, law=with_numbers(j.law, iter(new.values())))


def _channel(c: Channel, values: Mapping[str, float]) -> Channel:
    gain, delay = (values.get(f"channels.{c.name}.{name}", getattr(c, name)) for name in ("gain", "delay"))
    return c if (gain, delay) == (c.gain, c.delay) else replace(c, gain=gain, delay=delay)


def modes_change(rig: "JointedRig", key: str) -> PortedModes:
    """Exact derivatives of the modes and rows of a rig's body to one of its numbers, zero to those it does not hold."""
    inertia = np.zeros(len(rig.laden.inertia))
    if (of_mass := MASS.fullmatch(key)) is not None:
        inertia[[lump == int(of_mass[1]) - 1 for lump in rig.laden.lumps]] = 1.0
    return rig.laden.change(_bare_change(rig, key), inertia, float(key == ALPHA))


def _bare_change(rig: "JointedRig", key: str) -> PortedModes:
    """The same without its masses."""
    p = rig.laden.bare
    if key in rig.body.numbers:
        return rig.body.change(key, p, rig.damping)
    none = p.nothing
    ratio = RATIO.fullmatch(key)
    if ratio is None and key != ALPHA:
        return none
    if ratio is not None:
        viscous = np.where(np.arange(1, p.n + 1) == int(ratio[1]), 2.0 * p.omega_n, 0.0)
    else:
        viscous = rig.damping.dampers_change("mass_proportional", p.omega_n, np.arange(1, p.n + 1)).viscous
    return replace(none, damping=np.diag(viscous), reaction_damping=p.reaction_inertia * viscous)
