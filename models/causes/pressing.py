"""What presses a joint that rubs varies with the motion along its normal."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

from models.causes.addedjoint import SMALL, WIDEST, ends_of, reach, turned
from models.causes.cause import Cause, Unknown
from models.jointed import JointedRig
from models.joints import Friction, Joint
from models.joints.joint import terms

SHARES = (1.0, 10.0, 100.0, 1000.0)
"""Starts of the stiffness, in units of the excitation over the largest motion along the normal: that of the body there
is half that unit over the damping ratio."""


@dataclass(frozen=True)
class NormalContact(Cause):
    """An elastic contact along a normal, which presses friction that the rig file has under a constant load.

    Attributes
    ----------
    joint : str
        Name of the joint that rubs.
    at, to : str
        Its normal direction, which presses it where `at` moves towards `to`; the ground where that is empty.
    """

    name: ClassVar[str] = "normal-contact"
    meaning: ClassVar[str] = (
        "the load on a joint that rubs is that of an elastic contact: it varies with the motion along a normal, "
        "pushes back there, and is gone where the contact opens"
    )
    looks_like: ClassVar[str] = "a spring along the normal, friction that varies; even and odd harmonics where it opens"
    confused_with: ClassVar[str] = "one-sided-stop, local-spring"
    check: ClassVar[str] = "put a load cell under the joint, or raise its load by a known amount and repeat the records"
    placed: ClassVar[bool] = True
    rigs: ClassVar[tuple[type, ...]] = (JointedRig,)

    joint: str
    at: str
    to: str = ""

    @classmethod
    def candidates(cls, rig: JointedRig) -> Iterator[Self]:
        """Offer it along every direction but its own, either way round, of friction whose load is constant."""
        for j in rig.joints:
            if isinstance(j.law, Friction) and not j.varying_load:
                yield from (cls(j.name, *ends) for pair in _normals(rig, j) for ends in (pair, turned(pair)))

    @property
    def label(self) -> str:
        """Name, joint and normal."""
        return f"{self.name} {self.joint} {self.at}" + f" to {self.to}" * bool(self.to)

    def unknowns(self, rig: JointedRig) -> tuple[Unknown, ...]:
        """Stiffness of the contact."""
        unit = rig.excitation.amplitude / reach(rig, self.at, self.to)[0]
        starts = tuple(unit * share for share in (SMALL, *SHARES))
        key = f"joints.{self.joint}.normal_stiffness"
        return (Unknown("stiffness", "N/m", key, 0.0, WIDEST * unit, 0.0, starts),)

    def extend(self, rig: JointedRig, values: Mapping[str, float]) -> JointedRig:
        """Give the joint its normal."""
        return replace(rig, joints=tuple(self._pressed(j, values) if j.name == self.joint else j for j in rig.joints))

    def _pressed(self, j: Joint, values: Mapping[str, float]) -> Joint:
        law: Any = replace(j.law, normal_stiffness=values["stiffness"])  # type: ignore[type-var]  # a Friction
        return replace(j, law=law, at=(*j.at[:1], self.at), to=(*j.to[:1], self.to) if j.to else ())


def _normals(rig: JointedRig, j: Joint) -> list[tuple[str, str]]:
    """Pairs of ends, of the ground where the joint is on it, along which its contact may be pressed.

    Where names say which directions a point has, of the point that rubs alone.
    """
    ((at, to),) = j.ends
    points = [{place for _, end in terms(e) for place in rig.body.translations(end)} for e in (at, to)]
    pairs = [pair for pair in ends_of(rig) if bool(pair[1]) == bool(to)]
    if len(points[0]) > 1:
        pairs = [p for p in pairs if p[0] in points[0] and (not to or p[1] in points[1])]
    return [p for p in pairs if p not in ((at, to), (to, at))]
