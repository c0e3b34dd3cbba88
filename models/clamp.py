"""A clamp that slips: the law of its friction, and where it acts on a structure whose clamp is a spring.

The moment of a clamp of stiffness k that turns by theta and has slid by s is M = k (theta - s), within its limit. The
spring is part of the structure; the slid rotation is a load k s on it. Seen from the clamp, the structure answers
``M = row.q + residual[0] T + residual[1] F - stiffness s``, and what is slid moves everything else by the same numbers,
so that power is conserved exactly. Nothing in this is large or small where k is, up to a rigid clamp that slips.
"""

from dataclasses import dataclass, field
from typing import ClassVar

from models.friction.elements import clip
from models.friction.law import ContactSample, Value, parameter


@dataclass(frozen=True, eq=False)
class SlippingClamp:
    """Jenkins element on the rotation of the clamp, as a law of T = -M [N m]; its state is the rotation slid [rad].

    It is shown the rotation ``u = M_held / stiffness``, with the moment M_held if nothing had slid.
    """

    name: ClassVar[str] = "clamp-friction"
    states: ClassVar[int] = 1
    set_valued: ClassVar[bool] = False

    limit: Value = field(metadata=parameter("N m", "largest moment", "catalogue of causes"))
    stiffness: Value = field(metadata=parameter("N m/rad", "moment that a slid rotation takes back", "this module"))

    def advance(self, z: Value, before: ContactSample, now: ContactSample) -> tuple[Value, Value]:
        """Exact stick-slip return mapping."""
        T = clip(self.stiffness * (z - now.u), -self.limit, self.limit)
        return now.u + T / self.stiffness, T
