"""The interface of a friction law, and the metadata of its parameters.

A law advances its internal state from one sample of the contact's motion to the next and returns the friction
force (:meth:`FrictionLaw.advance`). The harmonic balance marches it over a period, the time integrator over a
step; derivatives come from CasADi.

Signs: u and v are the *modal* slip and slip velocity, T the force on the beam, opposing v. The contact sees the series
compliance C (C_res, and inside a time step of a set-valued law the dynamic compliance of the step): its own
displacement is u + C T. The reaction is R = rho + eta T at each instant. Both relations make T implicit. A law may
solve them itself, in closed form (:func:`models.friction.elements.limits`); or it uses `now.displacement` and
`now.reaction`, which depend on `now.T`, and whoever calls it closes T = law(T) by Newton's method
(:mod:`hbm.aft.step`).
"""

from collections.abc import Iterator
from dataclasses import MISSING, Field, dataclass, fields, replace
from typing import Any, ClassVar, NamedTuple, Protocol, TypeVar

import casadi as ca

from models.bounds import bounded
from models.plausible import of_parameter, plausible

Described = TypeVar("Described")
Value = Any  # a float or a CasADi expression: laws are written once for both


class ContactSample(NamedTuple):
    """The information that a law gets about one instant.

    Attributes
    ----------
    u : modal slip [m], without the part C T that the law itself causes.
    v : modal slip velocity [m/s].
    rho, eta : normal reaction R = rho + eta T, [N] and [-].
    C : series compliance [m/N], >= 0.
    P : static normal load [N], to which nominal stiffnesses refer.
    dt : time since the previous sample [s].
    T : friction force [N]; at the present instant the one that the law itself is to return.
    """

    u: Value
    v: Value
    rho: Value
    eta: Value
    C: Value
    P: Value
    dt: Value
    T: Value = 0.0

    @property
    def displacement(self) -> Value:
        """Displacement of the contact itself, u + C T [m]."""
        return self.u + self.C * self.T

    @property
    def reaction(self) -> Value:
        """Normal reaction R = rho + eta T, none where the tip would lift off [N]."""
        return ca.fmax(self.rho + self.eta * self.T, 0.0)


class FrictionLaw(Protocol):
    """A friction law: a frozen dataclass whose fields are its parameters (numbers or CasADi symbols)."""

    name: ClassVar[str]
    set_valued: ClassVar[bool]

    @property
    def states(self) -> int:
        """Number of internal states."""
        ...

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Advance the internal state `z` (states,) from sample `before` to `now`; return it and the force T [N]."""
        ...


@dataclass(frozen=True)
class Parameter:
    """Metadata of one parameter of a law, kept in the law's dataclass field.

    Attributes
    ----------
    unit : str
        SI unit, "1" for a pure number.
    meaning : str
        A few words.
    source : str
        Equation of the paper, or reference.
    lower, upper : float
        Bounds.
    strict : bool
        Whether the lower bound itself is excluded.
    at_least : str or None
        Another parameter of the same law that this one must not fall below.
    """

    unit: str
    meaning: str
    source: str
    lower: float = 0.0
    upper: float = float("inf")
    strict: bool = True
    at_least: str | None = None

    @property
    def bound(self) -> str:
        """Bounds in words, such as ``> 0`` or ``> 0 and <= 1``; ``any`` where there is none."""
        if self.lower == -float("inf"):
            return "any" if self.upper == float("inf") else f"<= {self.upper:g}"
        lower = f"{'>' if self.strict else '>='} {self.lower:g}"
        return lower if self.upper == float("inf") else f"{lower} and <= {self.upper:g}"


@dataclass(frozen=True)
class Setting:
    """A choice that decides the form of a law, not a number it can be differentiated to.

    Attributes
    ----------
    meaning : str
        A few words.
    source : str
        Equation of the paper, or reference.
    instead_of : tuple of str
        Other fields of the law that have no meaning where this one is given.
    """

    meaning: str
    source: str
    instead_of: tuple[str, ...] = ()


def parameter(unit: str, meaning: str, source: str, **bounds: Any) -> dict[str, Parameter]:
    """Metadata of a law's dataclass field; `bounds` as in :class:`Parameter`."""
    return {"parameter": Parameter(unit, meaning, source, **bounds)}


def setting(meaning: str, source: str, **more: Any) -> dict[str, Setting]:
    """Metadata of a dataclass field that is a choice; `more` as in :class:`Setting`."""
    return {"setting": Setting(meaning, source, **more)}


def describe(law: type) -> dict[str, Parameter]:
    """Parameters of a law class with their units, bounds and sources, in field order.

    >>> from hbm.models import Jenkins
    >>> {name: (p.unit, p.bound) for name, p in describe(Jenkins).items()}
    {'mu': ('1', '> 0'), 'critical_slip': ('m', '> 0')}
    """
    unknown = Parameter("?", "not described", "", lower=-float("inf"))
    return {f.name: f.metadata.get("parameter", unknown) for f in fields(law) if "setting" not in f.metadata}


def settings(law: type) -> dict[str, "Field[Any]"]:
    """Dataclass fields of a law class that are choices, in field order."""
    return {f.name: f for f in fields(law) if "setting" in f.metadata}


def defaults(law: type) -> dict[str, Any]:
    """Fields of a law class that need not be given, with their values."""
    return {f.name: f.default for f in fields(law) if f.default is not MISSING}


def idle(law: object) -> set[str]:
    """Fields of a law without a meaning beside a setting that is given, such as the spread of given limits."""
    given = (f for name, f in settings(type(law)).items() if getattr(law, name) != f.default)
    return {other for f in given for other in f.metadata["setting"].instead_of}


def parameters(law: object) -> dict[str, float]:
    """Parameters of a law (or of a nonlinear element) by name, in the order every solver passes them."""
    names = describe(type(law)).keys() - idle(law)
    return {f.name: getattr(law, f.name) for f in fields(law) if f.name in names}  # type: ignore[arg-type]


def chosen(law: object) -> dict[str, Any]:
    """Settings of a law (or of a nonlinear element) by name."""
    return {name: getattr(law, name) for name in settings(type(law))}


def with_symbols(law: Described) -> tuple[Described, Any]:
    """Copy a law (or a nonlinear element) with CasADi symbols for its parameters; return it and the (p,) SX vector."""
    names = list(parameters(law))
    p = ca.SX.sym("p", len(names))
    return replace(law, **{name: p[i] for i, name in enumerate(names)}), p  # type: ignore[type-var]


def check_parameters(law: FrictionLaw) -> None:
    """Refuse a law with a number out of its bounds.

    Raises
    ------
    ValueError
        With the number and its bounds.
    """
    for name, known in describe(type(law)).items():
        where, value = f"{type(law).__name__}: {name}", getattr(law, name)
        bounded(where, value, known.lower, known.upper, known.strict)
        plausible(where, value, of_parameter(name, known.unit))


def quantities_of(law: object, table: str) -> Iterator[tuple[str, str, Any]]:
    """Key of the rig file, quantity of :mod:`models.plausible`, and value of each parameter of a law."""
    for name, known in describe(type(law)).items():
        yield f"{table}.{name}", of_parameter(name, known.unit), getattr(law, name)


class Checked:
    """A law that is refused where it is made with a number out of its bounds."""

    def __post_init__(self) -> None:
        """Check every parameter."""
        check_parameters(self)  # type: ignore[arg-type]  # of the laws that inherit
