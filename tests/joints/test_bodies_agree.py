"""The paper's beam in four descriptions, closed form, finite elements, modes with residuals, matrices: one answer."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.response.trace import steady_state
from models import Jenkins
from models.bodies import FiniteBeam, ModalModel
from models.jointed import JointedRig
from models.joints import Friction, Joint
from models.published import paper_rig

LAW = Jenkins(0.52, 4.146e-6)
H, N_T = 15, 512


@pytest.mark.parametrize("loaded", [False, True])
def test_the_paper_beam_is_one_beam(loaded: bool) -> None:
    rig = paper_rig()
    contact = replace(rig.contact, law=LAW, load_variation=float(loaded), foreshortening=False)
    rig = replace(rig, contact=contact, channels=())
    L, h = rig.body.length, contact.radius + rig.body.thickness / 2
    slip, drive = f"{h!r}*slope({L!r}) + axial({L!r})", f"y({rig.excitation.position!r})"
    beam = FiniteBeam(rig.body)
    excitation = replace(rig.excitation, at=drive)

    def jointed(body: object, at: str, where: str, loaded_by: str) -> JointedRig:
        joint = Joint("tip", Friction(LAW, contact.normal_load), (at,), loaded_by=loaded_by if loaded else "")
        return JointedRig("paper", body, rig.damping, (joint,), replace(excitation, at=where))

    finite = jointed(beam, slip, drive, "y(0.606)")
    ported = finite.ported
    model = ModalModel(
        tuple((ported.omega_n / (2 * np.pi)).tolist()),
        {name: tuple(row) for name, row in zip(ported.places, ported.rows.tolist(), strict=True)},
        tuple(map(tuple, ported.flexibility.tolist())),
        None,
        {name: tuple(row) for name, row in zip(ported.supports, ported.reaction_inertia.tolist(), strict=True)},
        {name: tuple(row) for name, row in zip(ported.supports, ported.reaction_share.tolist(), strict=True)},
    )
    modal = jointed(model, slip, drive, "y(0.606)")
    matrices = beam.matrices([rig.excitation.position])  # of 60 Hermite elements
    named = f"{h!r}*slope@{L!r} + axial@{L!r}"
    matrix = jointed(matrices, named, f"y@{rig.excitation.position!r}", f"y@{L!r}")
    for hz in (46.0, 49.0, 52.0):
        expected = steady_state(rig, hz, harmonics=H, samples=N_T)
        for other in (finite, modal, matrix):
            found = steady_state(other, hz, harmonics=H, samples=N_T)
            for a, b in (("drive", "drive"), ("friction", "tip.force"), ("slip", "tip.motion")):
                apart = np.abs(expected[a].coefficients - found[b].coefficients)[1:].max()
                assert apart < 1e-3 * expected[a].amplitude[1], (hz, b)
