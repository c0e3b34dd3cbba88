"""Iwan's parallel Jenkins elements: microslip that spreads over the contact."""

from dataclasses import dataclass, field
from typing import ClassVar, Literal

import casadi as ca

from models.friction.elements import clip, sides
from models.friction.law import Checked, ContactSample, Value, parameter, setting

SOURCE = "Iwan 1966"


@dataclass(frozen=True, eq=False)
class Iwan(Checked):
    """Jenkins elements in parallel, of equal stiffness and different limits; together mu R and `stiffness`.

    States: the anchors [m]. The limits are uniform in (1 - spread .. 1 + spread) mu R / elements, each element at
    the middle of its share, or in proportion to the given `limits`.
    """

    name: ClassVar[str] = "iwan"
    set_valued: ClassVar[bool] = False
    ratio: ClassVar[Value] = 1.0

    mu: Value = field(metadata=parameter("1", "friction coefficient of all elements together", SOURCE))
    stiffness: Value = field(metadata=parameter("N/m", "stiffness of all elements together", SOURCE))
    spread: Value = field(
        default=1.0,
        kw_only=True,
        metadata=parameter(
            "1", "half width of the limits' distribution over its mean", SOURCE, upper=1.0, strict=False
        ),
    )
    elements: int = field(default=10, kw_only=True, metadata=setting("number of Jenkins elements", SOURCE))
    distribution: Literal["uniform"] = field(
        default="uniform", kw_only=True, metadata=setting("distribution of the limits", SOURCE)
    )
    limits: tuple[float, ...] = field(
        default=(),
        kw_only=True,
        metadata=setting(
            "limit of each element, in any unit: only their ratios count",
            SOURCE,
            instead_of=("elements", "distribution", "spread"),
        ),
    )

    @property
    def states(self) -> int:
        """Number of elements."""
        return len(self.limits) or self.elements

    @property
    def shares(self) -> Value:
        """Share of each element in mu R, (elements,)."""
        if self.limits:
            return ca.DM(self.limits) / sum(self.limits)
        n = self.elements
        middles = ca.DM([(2 * i + 1) / n - 1.0 for i in range(n)])
        return (1.0 + self.spread * middles) / n

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Return map of every element under the displacement of the contact they share."""
        stiffness, limit = self.stiffness / self.states, now.reaction * self.shares
        forward, backward = sides(self.mu, self.ratio)
        T = clip(stiffness * (z - now.displacement), -forward * limit, backward * limit)
        return now.displacement + T / stiffness, ca.sum1(T)
