"""A linear body as joints see it: modes, and the rows of its ports."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np

from models.structure import Array

if TYPE_CHECKING:
    from models.friction.law import Parameter
    from models.parts import Damping


@dataclass(frozen=True, eq=False)
class PortedModes:
    """A body in mass-normalised modes, with the rows through which anything touches it.

    ``q'' + damping q' + omega_n^2 q = rows' f``; the motion at the ports is ``rows q + flexibility f``: the static
    response of the modes left out is kept, so that stiff joints need few modes. A support is a coordinate that the body
    cannot move along; its reaction, the force of the support on the body, is
    ``reaction_inertia q'' + reaction_damping q' - reaction_share f``, from the weak form tested with the static shape
    of a unit displacement of the support.

    Attributes
    ----------
    omega_n : (n,) array
        Natural frequencies [rad/s], ascending; 0 where the body moves as a rigid one.
    damping : (n, n) array
        Viscous damping between the modes [1/s].
    places : tuple of str, (p,)
        Names of the ports.
    rows : (p, n) array
        Displacement (or rotation) of each port per mode.
    flexibility : (p, p) array
        Symmetric: displacement of each port per force at each, beyond the modes kept [m/N].
    supports : tuple of str, (r,)
        Names of the supports whose reaction is known.
    reaction_inertia, reaction_damping : (r, n) array
    reaction_share : (r, p) array
        Displacement of each port per unit displacement of the support, at rest.
    """

    omega_n: Array
    damping: Array
    places: tuple[str, ...]
    rows: Array
    flexibility: Array
    supports: tuple[str, ...]
    reaction_inertia: Array
    reaction_damping: Array
    reaction_share: Array

    @property
    def n(self) -> int:
        """Number of modes."""
        return len(self.omega_n)

    @property
    def nothing(self) -> "PortedModes":
        """Zeros in place of its numbers: the derivative to what changes nothing."""
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        zeros: dict[str, Any] = {name: np.zeros_like(v) for name, v in own.items() if isinstance(v, np.ndarray)}
        return replace(self, **zeros)

    def receptance(self, omega: float) -> np.ndarray[tuple[int, int], np.dtype[np.complex128]]:
        """Motion of the ports per force at the ports that swings at `omega` [rad/s], (p, p) [m/N]."""
        dynamic = np.diag(self.omega_n**2 - omega**2) + 1j * omega * self.damping
        return np.asarray(self.rows @ np.linalg.solve(dynamic, self.rows.T) + self.flexibility)


DIRECTIONS = re.compile(r"(.+\.u?)[xyz]")
"""A translation by its name, ``12.y`` or ``12.uy``: those along the other axes are of the same point."""


def same_point(place: str, known: Collection[str]) -> tuple[str, ...]:
    """Translations of the point of a place, as far as names say.

    >>> same_point("12.y", ("12.x", "12.y", "12.rx", "7.x")), same_point("tip", ("tip",))
    (('12.x', '12.y'), ('tip',))
    """
    match = DIRECTIONS.fullmatch(place)
    named = [f"{match[1]}{axis}" for axis in "xyz"] if match else []
    return tuple(name for name in named if name in known) or (place,)


SIGNS = re.compile(r"\s*[+-]\s*")
"""What a sum of places has between them."""


def meant(place: str, known: Collection[str]) -> str:
    """What to try in place of a name that is not known; empty where none is near.

    >>> meant("a.9", ("a.1", "tip")), meant("a.1-tip", ("a.1", "tip")), meant("x", ("a.1", "tip"))
    ('; did you mean a.1?', '; in a sum, signs stand between blanks', '')
    """
    if SIGNS.search(place) and all(part in known for part in SIGNS.split(place)):
        return "; in a sum, signs stand between blanks"
    close = get_close_matches(place, known, n=1, cutoff=0.5)
    return f"; did you mean {close[0]}?" if close else ""


class PlaceError(ValueError):
    """A place or a support that a body does not have.

    Attributes
    ----------
    place : str
        Its name.
    accepted : str
        What the body has in its stead.
    """

    def __init__(self, message: str, place: str, accepted: str) -> None:
        super().__init__(message, place, accepted)
        self.place, self.accepted = place, accepted

    def __str__(self) -> str:
        """Say it without knowing who asked for the place."""
        return str(self.args[0])


class Body(Protocol):
    """A linear structure, whichever way it is given.

    Attributes
    ----------
    modes : int
        How many are kept.
    MODES : str
        Key of the rig file that asks for more; empty where there are none.
    """

    MODES: ClassVar[str]

    @property
    def modes(self) -> int:
        """How many are kept."""
        ...

    @property
    def damped_by_modes(self) -> bool:
        """Whether its modes have the damping of the rig: it brings no matrix of its own."""
        ...

    @property
    def numbers(self) -> "Mapping[str, tuple[float, Parameter]]":
        """What of it may be off or be followed, by the keys of the rig file, with unit and bounds."""
        ...

    def with_numbers(self, values: Mapping[str, float]) -> "Body":
        """Return the same body with other values of some of these."""
        ...

    def change(self, key: str, here: PortedModes, damping: "Damping") -> PortedModes:
        """Return the exact derivatives of its modes and rows `here` to one of these."""
        ...

    def translations(self, place: str) -> tuple[str, ...]:
        """Return the places that are translations of the point of one of them and can move; itself where none is."""
        ...

    def with_modes(self, modes: int, places: Sequence[str]) -> "Body":
        """Return the same body with another number of modes, or as many as it has where places of it are touched."""
        ...

    def ported(self, places: Sequence[str], damping: "Damping", supports: Sequence[str] = ()) -> PortedModes:
        """Return its modes with the rows of places, and of supports whose reaction is asked for.

        Raises
        ------
        ValueError
            If there is no such place or support.
        """
        ...


@runtime_checkable
class Everywhere(Protocol):
    """A body that has more places than anyone names.

    Attributes
    ----------
    spacing : float
        Between places that are tried of a continuum [m]; 0 where places are points.
    """

    @property
    def spacing(self) -> float:
        """Between places that are tried."""
        ...

    def elsewhere(self, places: Sequence[str]) -> tuple[str, ...]:
        """Return places apart from some: all that there are, or evenly along what has any number."""
        ...

    def along(self, place: str, aside: float) -> str:
        """Return the place so far on from one [m]; no further than a continuum reaches."""
        ...

    def everywhere(self, names: Sequence[str], places: Sequence[str]) -> tuple[Array, Array]:
        """Return the rows (f, n) of names in the modes with places, and their flexibility (f, p) to these."""
        ...


class Elastic:
    """Base of bodies whose stiffness as a whole is a number: a modulus, or a factor of a matrix.

    Attributes
    ----------
    STIFFNESS : str
        Key of that number in the rig file.
    """

    STIFFNESS: ClassVar[str]

    @property
    def damped_by_modes(self) -> bool:
        """Whether it brings no damping matrix."""
        raise NotImplementedError

    @property
    def _stiffness(self) -> "tuple[float, Parameter]":
        """That number, with unit and bounds."""
        raise NotImplementedError

    def _stiffened(self, value: float) -> Self:
        """The same with another one."""
        raise NotImplementedError

    @property
    def spacing(self) -> float:
        """Nothing: places are points."""
        return 0.0

    def along(self, place: str, aside: float) -> str:
        """Return the place itself."""
        return place

    @property
    def numbers(self) -> "Mapping[str, tuple[float, Parameter]]":
        """Its stiffness."""
        return {self.STIFFNESS: self._stiffness}

    def with_numbers(self, values: Mapping[str, float]) -> Self:
        """Return the same body with another stiffness, where there is one."""
        return self._stiffened(values[self.STIFFNESS]) if self.STIFFNESS in values else self

    def change(self, key: str, here: PortedModes, damping: "Damping") -> PortedModes:
        """Return the derivatives of its modes and rows `here` to its stiffness: shapes are what they are."""
        share = 1.0 / self._stiffness[0]
        moved = replace(here.nothing, omega_n=share * here.omega_n / 2, flexibility=-share * here.flexibility)
        if not self.damped_by_modes:
            return moved
        dampers, squares = damping.dampers(here.omega_n, np.arange(1, here.n + 1)), share * here.omega_n**2
        viscous = np.diag(dampers.slope * squares)
        # strain-rate damping is like the stiffness, which does no work on the static shape of a support
        by_velocity = here.reaction_inertia @ viscous
        return replace(moved, damping=viscous + np.diag(dampers.strain_rate * squares), reaction_damping=by_velocity)
