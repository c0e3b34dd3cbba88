"""Exact derivatives of a rig's structure to the numbers of its rig file."""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from models.assembly import Assembly, assembled_changes
from models.elements import ElementRows, Ports, element_rows_change
from models.parts import Excitation
from models.reduction import StructureChange
from models.rig import DAMPING, Rig
from models.structure import SpringPort

VARIATION = "contact.load_variation"
CLAMP_STIFFNESS = "attachments.clamp_stiffness"
SUPPORT_STIFFNESS = "attachments.support_stiffness"
LOAD = "contact.normal_load"


def is_of_contact(key: str) -> bool:
    """Whether a number is the load or one of the friction law: the structure does not know it."""
    return key == LOAD or key.startswith("contact.friction.")


class Scalar(NamedTuple):
    """A number of a rig and its unit."""

    value: float
    unit: str


def structure_scalars(rig: Rig) -> dict[str, Scalar]:
    """Numbers that decide the linear structure of a rig, with the keys of its rig file.

    >>> from hbm.models.published import paper_rig
    >>> structure_scalars(paper_rig())["channels.a3.position"]
    Scalar(value=0.3, unit='m')
    """
    return {key: Scalar(value, accepted.unit) for key, (value, accepted) in rig.structural.items()}


def tone_scalars(excitation: Excitation) -> dict[str, Scalar]:
    """Coefficients of the harmonics of the force over its amplitude, with keys like ``excitation.harmonics[0].cos``."""
    tones = enumerate(excitation.harmonics)
    return {
        f"excitation.harmonics[{i}].{name}": Scalar(value, "1")
        for i, (_, *values) in tones
        for name, value in zip(("cos", "sin"), values, strict=True)
    }


def elements_change(rig: Rig, keys: tuple[str, ...]) -> list[ElementRows]:
    """Derivatives of :attr:`Rig.element_rows` to numbers of the rig, p parameters first."""
    if rig.beam is None or not rig.acting:
        return []
    change = structure_change(rig, keys)
    ports = rig.reduction.ports(rig.beam.length)._replace(support=rig.support, load=rig.contact.normal_load)
    length, load = (np.array([float(key == name) for key in keys]) for name in ("beam.length", LOAD))
    points = change.rows[:, change.rows.shape[1] - len(ports.rows) :]
    moved = Ports(
        points,
        change.share,
        change.drawn_in,
        change.drawn_stretch,
        length,
        ports.channels,
        support_change(rig, keys),
        load,
    )
    return element_rows_change(rig.acting, ports, moved, rig.beam.modes)


@lru_cache(maxsize=64)  # the same in all records of a fit
def clamp_change(rig: Rig, keys: tuple[str, ...]) -> SpringPort | None:
    """Derivatives of :attr:`Rig.clamp` to numbers of the rig, p parameters first."""
    return None if rig.clamp is None else _port_change(rig, keys, rig.layout.at_clamp, CLAMP_STIFFNESS)


@lru_cache(maxsize=64)
def support_change(rig: Rig, keys: tuple[str, ...]) -> SpringPort | None:
    """Derivatives of :attr:`Rig.support` to numbers of the rig, p parameters first."""
    return None if rig.support is None else _port_change(rig, keys, rig.layout.at_support, SUPPORT_STIFFNESS)


def _port_change(rig: Rig, keys: tuple[str, ...], at: int, spring: str) -> SpringPort:
    """Derivatives of the port of a spring with a key, at a coordinate, p parameters first."""
    stiffness = float(rig.layout.scalars()[spring])
    own, still = _assembly_changes(rig, keys), _still(rig)
    changes = [rig.reduction.port_change(own.get(key, still), at, stiffness, float(key == spring)) for key in keys]
    if VARIATION in keys:  # of the reaction alone
        whole = replace(rig, contact=replace(rig.contact, load_variation=1.0)).reduction.port(at, stiffness)
        changes[keys.index(VARIATION)].residual[-1] = whole.residual[-1]
    return SpringPort(*(np.array(parts) for parts in zip(*changes, strict=True)))


def _assembly_changes(rig: Rig, keys: tuple[str, ...]) -> dict[str, Assembly]:
    """Derivatives of the assembly of a beam to those of some numbers of the rig that it depends on."""
    places = {} if rig.beam is None else dict(zip(rig.layout_keys, rig.layout.scalars(), strict=True))
    own = [key for key in keys if key in places]
    changes = assembled_changes(rig.layout, residual=rig.contact.residual_compliance) if own else {}
    return {key: changes[places[key]] for key in own}


def _still(rig: Rig) -> Assembly:
    """A change of nothing in the assembly of a rig."""
    return Assembly(*(np.zeros_like(part) for part in rig.reduction.assembly))


@lru_cache(maxsize=64)
def structure_change(rig: Rig, keys: tuple[str, ...]) -> StructureChange:
    """Exact derivatives of a rig's structure to some of its numbers, by automatic differentiation of its assembly.

    Parameters
    ----------
    rig : Rig
    keys : tuple of str
        From :func:`structure_scalars`; any other changes nothing.

    Returns
    -------
    StructureChange

    Examples
    --------
    Stiffer by one per cent of E, each omega_n^2 is higher by one per cent:

    >>> from hbm.models.published import paper_rig
    >>> rig = paper_rig()
    >>> by_E = structure_change(rig, ("beam.youngs_modulus",)).stiffness[0] * 210e9
    >>> (by_E.diagonal() / rig.structure.omega_n**2).round(12)
    array([1., 1., 1., 1., 1.])
    """
    reduction, own, still = rig.reduction, _assembly_changes(rig, keys), _still(rig)
    nothing: list[StructureChange] = []  # the same for all that change nothing

    def change(key: str) -> StructureChange:
        table, _, name = key.partition(".")
        if key in own:
            return reduction.change(own[key])
        if key == VARIATION:
            return reduction.change_of_load_variation(still)
        if table == "damping" and name in DAMPING:
            return reduction.change(
                still, rig.damping.dampers_change(name, np.sqrt(reduction.squares), rig.mode_numbers)
            )
        if not nothing:
            nothing.append(reduction.change(still))
        return nothing[0]

    return StructureChange.stacked([change(key) for key in keys])
