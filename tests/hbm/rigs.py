"""Rigs of the tests: unit oscillators for closed forms, and the paper's beam."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from models import (
    Channel,
    Contact,
    ContactSample,
    Damping,
    Excitation,
    ForceBalance,
    FrictionLaw,
    Frictionless,
    Karnopp,
    ModalBody,
    Rig,
    Stribeck,
    Viscous,
)
from models.published import (
    ASSUMED_HYBRID,
    ASSUMED_IWAN,
    ASSUMED_SDFM,
    ASSUMED_VLFM,
    PAPER_COULOMB,
    PAPER_DAHL,
    PAPER_LUGRE,
    PAPER_PENALTY,
    paper_rig,
)

HZ = 1.0 / (2.0 * np.pi)  # one radian per second

ON_THE_BEAM: list[FrictionLaw] = [
    Frictionless(),
    Viscous(300.0),
    PAPER_COULOMB,
    PAPER_PENALTY,
    ASSUMED_VLFM,
    # with a larger fall at the edge of the band curves cannot be traced
    Karnopp(0.495, 0.49, 6.101e-4),
    ForceBalance(0.495, 0.49, 6.101e-4),
    ASSUMED_SDFM,
    # as the paper's, but falling from 0.52 to 0.49: from 0.48 to 0.16 the upper modes are excited
    Stribeck(0.52, 0.49, 2e-3, critical_slip=4.146e-6),
    PAPER_DAHL,
    PAPER_LUGRE,
    ASSUMED_HYBRID,
    ASSUMED_IWAN,
]
"""Every law, with parameters whose curves can be traced."""


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
