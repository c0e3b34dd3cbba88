"""Laws with one more effect than those of rig files: what a diagnosis may find missing in a law.

Each keeps the numbers of the law it extends and adds its own, so that both can be fitted together; at the neutral value
of its own it is the law it extends. They have no name in rig files: `[[extensions]]` tables lead to them
(:mod:`models.causes`).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, fields, make_dataclass
from functools import lru_cache
from typing import Any, ClassVar

from models.friction.bristle import Dahl, Hybrid, LuGre
from models.friction.coulomb import Coulomb, Jenkins, Karnopp, Stribeck
from models.friction.elements import return_map, weakening
from models.friction.iwan import Iwan
from models.friction.law import Checked, ContactSample, Value, parameter, setting

SOURCE = "extension of a law"


@dataclass(frozen=True, eq=False)
class DistributedJenkins(Checked):
    """A Jenkins element as many, of one stiffness, their limits distributed: Iwan's model; spread 0 is the one."""

    name: ClassVar[str] = "coulomb-penalty+distributed"
    set_valued: ClassVar[bool] = False

    mu: Value = field(metadata=parameter("1", "friction coefficient of all elements together", "(18)"))
    critical_slip: Value = field(metadata=parameter("m", "elastic slip of a mean element", "(17), (19)"))
    spread: Value = field(
        metadata=parameter(
            "1", "half width of the limits' distribution over its mean", "Iwan 1966", upper=1.0, strict=False
        )
    )
    elements: int = field(default=10, kw_only=True, metadata=setting("number of Jenkins elements", "Iwan 1966"))

    @property
    def states(self) -> int:
        """Number of elements."""
        return self.elements

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Advance Iwan's elements of the same total stiffness."""
        stiffness = self.mu * now.P / self.critical_slip
        return Iwan(self.mu, stiffness, spread=self.spread, elements=self.elements).advance(z, before, now)


@dataclass(frozen=True, eq=False)
class WeakeningJenkins(Checked):
    """Stribeck's law (20) by its stiffness, which thus stays that of the Jenkins element whatever mu_static is."""

    name: ClassVar[str] = "coulomb-penalty+weakening"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = False
    ratio: ClassVar[Value] = 1.0

    mu_static: Value = field(metadata=parameter("1", "friction coefficient at rest", "(20)", at_least="mu"))
    mu: Value = field(metadata=parameter("1", "friction coefficient at high speed", "(20)"))
    stribeck_velocity: Value = field(metadata=parameter("m/s", "speed v_s over which friction falls", "(20)"))
    stiffness: Value = field(metadata=parameter("N/m", "tangential stiffness k_t", "(18)"))
    exponent: Value = field(default=2.0, kw_only=True, metadata=parameter("1", "Stribeck exponent delta", "(20)"))

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Return map with the limit of the present slip velocity."""
        mu = weakening(self.mu_static, self.mu, self.stribeck_velocity, self.exponent, now.v)
        return return_map(z, 1.0 / (1.0 / self.stiffness + now.C), mu, now, self.ratio)


@dataclass(frozen=True, eq=False)
class DampedDahl(Checked):
    """Dahl's bristles with LuGre's damping: LuGre with mu_static = mu."""

    name: ClassVar[str] = "dahl+damped"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = False

    mu: Value = field(metadata=parameter("1", "friction coefficient", "paper's reference 9"))
    stiffness: Value = field(metadata=parameter("N/m", "bristle stiffness sigma_0", "paper's references 9 and 19"))
    bristle_damping: Value = field(
        metadata=parameter("N s/m", "bristle damping sigma_1", "paper's reference 19", strict=False)
    )

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Advance LuGre's bristle."""
        bristles = LuGre(self.mu, self.mu, 1.0, self.stiffness, self.bristle_damping, 0.0)
        return bristles.advance(z, before, now)


# ---- any law of a kind

ASYMMETRIC = (Coulomb, Jenkins, Karnopp, Stribeck, Iwan, WeakeningJenkins)
"""Laws, their kin included, whose limits may depend on the direction."""

BESIDE_DASHPOT = (Jenkins, Stribeck, Dahl, LuGre, Hybrid, Iwan, DistributedJenkins, WeakeningJenkins, DampedDahl)
"""Laws that a dashpot may act beside: they remember of the sample before only where the contact was.

Not the set-valued ones: within a time step their compliance is that of the moving structure, not of a spring.
"""


@lru_cache
def asymmetric(law: type) -> type:
    """A law whose friction depends on the direction, class by class.

    Parameters
    ----------
    law : type
        One of `ASYMMETRIC`, or kin.

    Returns
    -------
    type
        The law with one more parameter, `ratio` = mu forward / mu backward at the same mean; forward is v > 0.

    Examples
    --------
    >>> asymmetric(Jenkins)(mu=0.5, critical_slip=4e-6, ratio=1.1).ratio
    1.1
    """
    known = parameter("1", "friction coefficient forward over that backward", SOURCE)
    return _extended(asymmetric, law, "asymmetric", "ratio", known)


@lru_cache
def beside_dashpot(law: type) -> type:
    """A law beside a dashpot, T = T_law - coefficient times the contact's velocity v + C dT/dt; class by class.

    Parameters
    ----------
    law : type
        One of `BESIDE_DASHPOT`, or kin.

    Returns
    -------
    type
        The law with one more parameter, `coefficient` [N s/m].

    Notes
    -----
    With dT/dt by the backward difference the dashpot's force is linear in that of the law, so that the law alone is
    shown another motion, reaction and compliance, and solves in closed form what it solves so by itself.
    """

    def advance(self: Any, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        c, yielding = self.coefficient, now.C / now.dt
        loose = now.v - yielding * before.T  # velocity of the contact, but for the present force
        shared = 1.0 + c * yielding
        c_seen = c / shared
        alone = now.T + c * (now.v + yielding * (now.T - before.T))
        seen = now._replace(
            u=now.u - now.C * c_seen * loose,
            rho=now.rho - now.eta * c_seen * loose,
            eta=now.eta / shared,
            C=now.C / shared,
            T=alone,
        )
        # such that the contact was where it was, and moves as it does: v + C' (T' - T'_before) / dt
        seen_before = before._replace(u=before.displacement, C=0.0, T=before.T + c * now.v)
        z_new, T = law.advance(self, z, seen_before, seen)  # type: ignore[attr-defined]
        return z_new, T - c_seen * (loose + yielding * T)

    known = parameter("N s/m", "viscous coefficient beside the law", SOURCE, strict=False)
    return _extended(beside_dashpot, law, "dashpot", "coefficient", known, advance=advance)


def _extended(
    maker: Callable[[type], type], law: type, word: str, name: str, known: dict[str, Any], **methods: Any
) -> type:
    """Dataclass of a law with one more parameter; its objects are pickled by how the class was made."""
    makers, base = getattr(law, "made_by", ((), law))
    namespace = {
        "__doc__": f"{law.__name__}, {word}.",
        "__module__": __name__,
        "__reduce__": lambda self: (_made, (*self.made_by, {f.name: getattr(self, f.name) for f in fields(self)})),
        "made_by": ((*makers, maker), base),
        "name": f"{law.name}+{word}",  # type: ignore[attr-defined]
        **methods,
    }
    more = [(name, Any, field(kw_only=True, metadata=known))]
    title = f"{word.title()}{law.__name__}"
    return make_dataclass(title, more, bases=(law,), namespace=namespace, frozen=True, eq=False)


def _made(makers: tuple[Callable[[type], type], ...], law: type, values: dict[str, Any]) -> Any:
    for maker in makers:
        law = maker(law)
    return law(**values)
