"""Rigs of the tests: unit oscillators for closed forms, and the paper's beam."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from models import Channel, Contact, ContactSample, Damping, Excitation, FrictionLaw, ModalBody, Rig
from models.published import PAPER_PENALTY, paper_rig

HZ = 1.0 / (2.0 * np.pi)  # one radian per second


def oscillator(law: FrictionLaw, *, damping: float, amplitude: float, load: float = 1.0) -> Rig:
    """Return y'' + damping y' + y = amplitude cos(Omega t) + T."""
    return Rig(
        name="oscillator",
        body=ModalBody((HZ,), ((1.0,),), (1.0,), (1.0,)),
        damping=Damping(mass_proportional=damping),
        contact=Contact(load, law),
        excitation=Excitation(amplitude),
        channels=(Channel("y", "displacement"),),
    )


@dataclass(frozen=True, eq=False)
class CubicSpring:
    """A law of one's own: T = -gamma u^3, no memory. With it an oscillator is a Duffing oscillator."""

    name: ClassVar[str] = "cubic"
    states: ClassVar[int] = 0
    set_valued: ClassVar[bool] = False

    gamma: Any

    def advance(self, z: Any, before: ContactSample, now: ContactSample) -> tuple[Any, Any]:
        """Return no state and the restoring force."""
        return z, -self.gamma * now.u**3


def beam(law: FrictionLaw = PAPER_PENALTY, *, alpha: float = 0.6, modes: int = 5, **contact: float) -> Rig:
    """Return the paper's beam with finite transients: alpha [1/s] ten times the paper's, contact switches as given."""
    rig = paper_rig(law)
    return replace(rig, damping=Damping(mass_proportional=alpha), contact=replace(rig.contact, **contact)).with_modes(
        modes
    )
