"""The interface of a joint's law: forces at a few ports from the motion there, symbolic, for every solver.

A law advances its internal state from one sample of the motion to the next and returns the forces on the body along its
ports. Harmonic balance marches it over a period, time integration over a step; derivatives come from CasADi.
"""

from collections.abc import Iterator
from dataclasses import Field, fields, is_dataclass, replace
from typing import Any, ClassVar, NamedTuple, Protocol, TypeVar

import casadi as ca

from models.bounds import bounded
from models.friction.law import Parameter, idle
from models.plausible import of_parameter, plausible

Value = Any  # a float or a CasADi expression: laws are written once for both

Law = TypeVar("Law")


class JointSample(NamedTuple):
    """The information that a law gets about one instant.

    Attributes
    ----------
    u, v : (ports,)
        Displacements and velocities at the ports [m, m/s].
    load : scalar
        How the reaction that loads the joint differs from its static load [N].
    C : scalar
        Own compliance of the first port [m/N], not contained in u, of a law that takes it into account (`folds`).
    dt : scalar
        Time since the previous sample [s].
    f : (ports,)
        Forces on the body [N]; at the present instant those that the law itself is to return.
    """

    u: Value
    v: Value
    load: Value
    C: Value
    dt: Value
    f: Value


class JointLaw(Protocol):
    """A law of a joint: a frozen dataclass whose fields are its parameters (numbers or CasADi symbols)."""

    name: ClassVar[str]

    @property
    def ports(self) -> int:
        """At how many displacements it acts."""
        ...

    @property
    def states(self) -> int:
        """Number of internal states."""
        ...

    @property
    def folds(self) -> bool:
        """Whether it takes the compliance of its first port into account itself."""
        ...

    @property
    def set_valued(self) -> bool:
        """Whether it needs that compliance."""
        ...

    @property
    def drifting(self) -> int:
        """At how many of its first ports no place is its own: the forces there know only where the motion has been."""
        ...

    def advance(self, z: Value, before: JointSample, now: JointSample) -> tuple[Value, list[Value]]:
        """Advance the internal state `z` (states,) from sample `before` to `now`; return it and the forces (ports,)."""
        ...


class Memoryless:
    """Base of laws that answer the present instant alone; one that is out of its bounds is refused where it is made.

    A law gives its ``force(u, v)`` as a list over its ports.
    """

    ports: ClassVar[int] = 1
    states: ClassVar[int] = 0
    folds: ClassVar[bool] = False
    set_valued: ClassVar[bool] = False
    drifting: ClassVar[int] = 0

    def __post_init__(self) -> None:
        """Refuse numbers out of their bounds."""
        check_bounds(self)

    def force(self, u: Value, v: Value) -> list[Value]:
        """Forces on the body along the ports."""
        raise NotImplementedError

    def advance(self, z: Value, before: JointSample, now: JointSample) -> tuple[Value, list[Value]]:
        """Answer the present instant."""
        return z, self.force(now.u, now.v)


def check_bounds(law: Any) -> None:
    """Refuse a law with a number out of the bounds in its fields.

    Raises
    ------
    ValueError
        With the number and its bounds.
    """
    for f in fields(law):
        known, value = f.metadata.get("parameter"), getattr(law, f.name)
        if isinstance(known, Parameter) and value is not None:
            where = f"{type(law).__name__}: {f.name}"
            bounded(where, value, known.lower, known.upper, known.strict)
            plausible(where, value, of_parameter(f.name, known.unit))


def numbers(law: Any) -> dict[str, float]:
    """Parameters of a law by name, in the order every solver passes them; those of a law within it among them.

    >>> from hbm.models import Jenkins
    >>> from hbm.models.joints import Friction
    >>> numbers(Friction(Jenkins(0.3, 1e-6), 50.0))
    {'mu': 0.3, 'critical_slip': 1e-06, 'normal_load': 50.0}
    """
    found: dict[str, float] = {}
    for f in _numbered(law):
        value = getattr(law, f.name)
        found |= numbers(value) if is_dataclass(value) else {f.name: value}
    return found


def _numbered(law: Any) -> "list[Field[Any]]":
    """Fields of a law that are numbers, or a law within it; those without a meaning in this one are none."""
    without = idle(law)
    return [
        f
        for f in fields(law)
        if "setting" not in f.metadata and f.name not in without and getattr(law, f.name) is not None
    ]


def described(law: Any) -> dict[str, Parameter]:
    """Metadata of the parameters of a law, by their names as :func:`numbers` has them."""
    unknown = Parameter("?", "not described", "", lower=-float("inf"))
    found: dict[str, Parameter] = {}
    for f in _numbered(law):
        value = getattr(law, f.name)
        found |= described(value) if is_dataclass(value) else {f.name: f.metadata.get("parameter", unknown)}
    return found


def with_numbers(law: Law, values: Iterator[Any]) -> Law:
    """Copy a law with other parameters, in the order of :func:`numbers`."""
    changed: dict[str, Any] = {}
    for f in _numbered(law):
        value = getattr(law, f.name)
        changed[f.name] = with_numbers(value, values) if is_dataclass(value) else next(values)
    return replace(law, **changed)  # type: ignore[type-var]


def with_symbols(law: Law) -> tuple[Law, Any]:
    """Copy a law with CasADi symbols for its parameters; return it and the (p,) SX vector."""
    p = ca.SX.sym("p", len(numbers(law)))
    return with_numbers(law, iter(ca.vertsplit(p))), p


Form = tuple[type, tuple[tuple[str, Any], ...]]


def form(law: Any) -> Form:
    """Choices that decide the instructions of a law: its class and settings. Parameters are run-time inputs."""
    parts: list[tuple[str, Any]] = []
    for f in fields(law):
        value = getattr(law, f.name)
        if is_dataclass(value):
            parts.append((f.name, form(value)))
        elif "setting" in f.metadata:
            parts.append((f.name, value))
        elif value is None:
            parts.append((f.name, None))
    return type(law), tuple(parts)


def of_form(made_of: Form) -> Any:
    """A law of a form, with ones for its parameters."""
    law, parts = made_of
    known = {
        name: of_form(part) if isinstance(part, tuple) and len(part) == 2 and isinstance(part[0], type) else part
        for name, part in parts
    }
    return law(**{f.name: known.get(f.name, 1.0) for f in fields(law)})
