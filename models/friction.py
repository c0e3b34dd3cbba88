"""Friction laws, each one symbolic definition that serves every solver.

A law advances its internal state over one sample of the contact's motion and returns the friction
force (:meth:`FrictionLaw.advance`). The harmonic balance marches it over a period, the time integrator
over a step; derivatives come from CasADi. A law that holds its state at the end of the sample and its
force for the same instant needs nothing else.

Signs: u and v are the *modal* slip and slip velocity, T the force on the beam, opposing v. The contact
sees the series compliance C (C_res, and inside a time step the dynamic compliance of the step):
its own displacement is u + C T. The reaction is R = rho + eta T at each instant, so that the implicit
relation between T and R is solved inside the law (:func:`limits`).
"""

from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, NamedTuple, Protocol

import casadi as ca

Value = Any  # a float or a CasADi expression: laws are written once for both


class ContactSample(NamedTuple):
    """What a law is told about one instant.

    Attributes
    ----------
    u : modal slip [m], without the part C T that the law itself causes.
    v : modal slip velocity [m/s].
    rho, eta : normal reaction R = rho + eta T, [N] and [-].
    C : series compliance [m/N], >= 0.
    P : static normal load [N], to which nominal stiffnesses refer.
    dt : time since the previous sample [s].
    """

    u: Value
    v: Value
    rho: Value
    eta: Value
    C: Value
    P: Value
    dt: Value


class FrictionLaw(Protocol):
    """A friction law: a frozen dataclass whose fields are its parameters (numbers or CasADi symbols)."""

    name: ClassVar[str]
    states: ClassVar[int]
    set_valued: ClassVar[bool]

    def advance(self, z: Value, s: ContactSample) -> tuple[Value, Value]:
        """Advance the internal state `z` (states,) to sample `s`; return it and the force T [N]."""
        ...


@dataclass(frozen=True)
class Parameter:
    """What is known of one parameter of a law; kept in the metadata of the law's dataclass field.

    Attributes
    ----------
    unit : str
        SI unit, "1" for a pure number.
    meaning : str
        A few words.
    source : str
        Equation of the paper, or reference.
    lower : float
        Lower bound.
    strict : bool
        Whether the bound itself is excluded.
    at_least : str or None
        Another parameter of the same law that this one must not fall below.
    """

    unit: str
    meaning: str
    source: str
    lower: float = 0.0
    strict: bool = True
    at_least: str | None = None

    @property
    def bound(self) -> str:
        """Lower bound in words, such as ``> 0``."""
        return f"{'>' if self.strict else '>='} {self.lower:g}"


def parameter(unit: str, meaning: str, source: str, **bounds: Any) -> dict[str, Parameter]:
    """Metadata of a law's dataclass field; `bounds` as in :class:`Parameter`."""
    return {"parameter": Parameter(unit, meaning, source, **bounds)}


def describe(law: type) -> dict[str, Parameter]:
    """Parameters of a law class with their units, bounds and sources, in field order.

    >>> {name: (p.unit, p.bound) for name, p in describe(Jenkins).items()}
    {'mu': ('1', '> 0'), 'critical_slip': ('m', '> 0')}
    """
    return {f.name: f.metadata["parameter"] for f in fields(law)}


def parameters(law: FrictionLaw) -> dict[str, float]:
    """Parameters of a law by name, in the order every solver passes them."""
    return {f.name: getattr(law, f.name) for f in fields(law)}  # type: ignore[arg-type]


def with_symbols(law: FrictionLaw) -> tuple[FrictionLaw, Any]:
    """Copy a law with its parameters replaced by CasADi symbols; return it and the (p,) SX vector."""
    names = list(parameters(law))
    p = ca.SX.sym("p", len(names))
    return replace(law, **{name: p[i] for i, name in enumerate(names)}), p  # type: ignore[type-var]


def limits(mu: Value, s: ContactSample) -> tuple[Value, Value]:
    """Lowest and highest friction force, -mu R and mu R with R = rho + eta T solved for T.

    A reaction that would be negative (the tip would lift off) leaves no friction.
    """
    pressed = ca.fmax(s.rho, 0.0)
    return -mu * pressed / (1.0 + mu * s.eta), mu * pressed / (1.0 - mu * s.eta)


def return_map(z: Value, stiffness: Value, mu: Value, s: ContactSample) -> tuple[Value, Value]:
    """Jenkins element with its anchor at `z`: exact stick-slip return mapping.

    The anchor stays while the spring force is within the limits and is dragged along otherwise.
    """
    low, high = limits(mu, s)
    T = ca.fmin(ca.fmax(stiffness * (z - s.u), low), high)
    return s.u + T / stiffness, T


@dataclass(frozen=True, eq=False)
class Frictionless:
    """No friction: T = 0."""

    name: ClassVar[str] = "none"
    states: ClassVar[int] = 0
    set_valued: ClassVar[bool] = False

    def advance(self, z: Value, s: ContactSample) -> tuple[Value, Value]:
        """Return no state and no force."""
        return z, 0.0 * s.u


@dataclass(frozen=True, eq=False)
class Coulomb:
    """Set-valued Coulomb friction (15): sticks exactly, slips at mu R.

    The contact point itself does not move while it sticks; what moves is the structure's compliance C
    in series with it, which must be positive. Where a structure brings none, the harmonic
    balance supplies it and takes it back (dynamic Lagrangian, :mod:`hbm.residual`).
    """

    name: ClassVar[str] = "coulomb-lagrange"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = True

    mu: Value = field(metadata=parameter("1", "friction coefficient", "(15)"))

    def advance(self, z: Value, s: ContactSample) -> tuple[Value, Value]:
        """Return map of the series compliance alone."""
        return return_map(z, 1.0 / s.C, self.mu, s)


@dataclass(frozen=True, eq=False)
class Jenkins:
    """Coulomb friction with elastic slip, penalty form (16)-(19); k_t = mu P / critical_slip."""

    name: ClassVar[str] = "coulomb-penalty"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = False

    mu: Value = field(metadata=parameter("1", "friction coefficient", "(18)"))
    critical_slip: Value = field(metadata=parameter("m", "elastic slip u_crit at which sliding starts", "(17), (19)"))

    def advance(self, z: Value, s: ContactSample) -> tuple[Value, Value]:
        """Return map of the tangential spring in series with the structure."""
        stiffness = 1.0 / (self.critical_slip / (self.mu * s.P) + s.C)
        return return_map(z, stiffness, self.mu, s)


@dataclass(frozen=True, eq=False)
class Stribeck:
    """Friction that falls with sliding speed (20), sticking branch as penalty with mu_static.

    The limit mu(v) R applies at every instant; k_t = mu_static P / critical_slip; exponent 1 is the decay law.
    """

    name: ClassVar[str] = "stribeck"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = False

    mu_static: Value = field(metadata=parameter("1", "friction coefficient at rest", "(20)", at_least="mu"))
    mu: Value = field(metadata=parameter("1", "friction coefficient at high speed", "(20)"))
    stribeck_velocity: Value = field(metadata=parameter("m/s", "speed v_s over which friction falls", "(20)"))
    exponent: Value = field(
        default=2.0, kw_only=True, metadata=parameter("1", "Stribeck exponent delta; 1 is the decay law", "(20)")
    )
    critical_slip: Value = field(metadata=parameter("m", "elastic slip u_crit at which sliding starts", "(17), (20)"))

    def coefficient(self, v: Value) -> Value:
        """Friction coefficient at slip velocity `v` [m/s]."""
        # |v| smoothed far below any velocity that matters: |v|^exponent has no derivative at 0 for exponent <= 1
        speed = ca.sqrt((v / self.stribeck_velocity) ** 2 + 1e-16)
        return self.mu + (self.mu_static - self.mu) * ca.exp(-(speed**self.exponent))

    def advance(self, z: Value, s: ContactSample) -> tuple[Value, Value]:
        """Return map with the limit of the present slip velocity."""
        stiffness = 1.0 / (self.critical_slip / (self.mu_static * s.P) + s.C)
        return return_map(z, stiffness, self.coefficient(s.v), s)


@dataclass(frozen=True, eq=False)
class Viscous:
    """Viscous contact, T = -coefficient times the contact's velocity v + C dT/dt.

    In series with the compliance C this is a Maxwell element; integrated exactly for a velocity
    that is linear between samples. State: T and v of the previous sample.
    """

    name: ClassVar[str] = "viscous"
    states: ClassVar[int] = 2
    set_valued: ClassVar[bool] = False

    coefficient: Value = field(
        metadata=parameter("N s/m", "viscous coefficient of the contact", "linear reference law", strict=False)
    )

    def advance(self, z: Value, s: ContactSample) -> tuple[Value, Value]:
        """Advance the Maxwell element; without compliance T = -coefficient v."""
        T_old, v_old = z[0], z[1]
        x = s.dt / ca.fmax(self.coefficient * s.C, 1e-9 * s.dt)  # relaxation times per sample
        decay = ca.exp(-x)
        T = decay * T_old - self.coefficient * (s.v - decay * v_old - (s.v - v_old) * (1.0 - decay) / x)
        return ca.vertcat(T, s.v), T


LAWS: dict[str, type] = {law.name: law for law in (Frictionless, Coulomb, Jenkins, Stribeck, Viscous)}
