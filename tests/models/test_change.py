"""Derivatives of the structure: scaling laws, perturbation theory, and differences of receptances for every key."""

from dataclasses import replace

import numpy as np
import pytest
from changed import changed
from test_assembly import EI, H_ARM, HEAVY, SOFT, L, paper, receptance

from models import (
    Attachments,
    Channel,
    Contact,
    Damping,
    Frictionless,
    ModalBody,
    ModalStructure,
    PointMass,
    Resonator,
    Rig,
    structure_change,
    structure_scalars,
)
from models.published import PAPER_BEAM, PAPER_EXCITATION, paper_rig
from models.reduction import StructureChange

DAMPING = Damping(0.6, stiffness_proportional=1e-6)


def change(rig: Rig, key: str) -> StructureChange:
    return StructureChange(*(part[0] for part in structure_change(rig, (key,))))


def receptance_change(s: ModalStructure, d: StructureChange, omega: float) -> np.ndarray:
    """Derivative of :func:`test_assembly.receptance`, in the modes of the structure."""
    r, i_omega = s.reaction, 1j * omega
    elastic = i_omega**2 * r.inertia + i_omega * r.damping + r.stiffness
    rows = np.array([s.slip_row, s.excitation, *s.channel_rows.values(), elastic])
    d_elastic = i_omega**2 * d.inertia + i_omega * d.reaction_damping + d.reaction_stiffness
    d_rows = np.vstack([d.rows, d_elastic])
    stiffness = s.omega_n**2 + i_omega**2 + i_omega * s.damping
    q = rows[:2].T / stiffness[:, None]
    d_q = (d.rows[:2].T - (d.stiffness + i_omega**2 * d.mass + i_omega * d.damping) @ q) / stiffness[:, None]
    static = np.vstack([d.flexibility, [-d.friction_lever, -d.force_share]])
    return np.asarray(rows @ d_q + d_rows @ q + static)


def drawn(s: ModalStructure) -> np.ndarray:
    """Shortening and stretch of the motion in step with the force and with the friction, at 48 Hz."""
    q = np.array([s.excitation, s.slip_row]) / (s.omega_n**2 - 300.0**2)
    return np.concatenate([(q @ s.shortening @ q.T).ravel(), q @ s.reaction.stretch])


def drawn_change(s: ModalStructure, d: StructureChange) -> np.ndarray:
    stiffness = s.omega_n**2 - 300.0**2
    q = np.array([s.excitation, s.slip_row]) / stiffness
    d_q = (d.rows[[1, 0]] - q @ (d.stiffness - 300.0**2 * d.mass)) / stiffness
    G = d_q @ s.shortening @ q.T
    return np.concatenate([(G + G.T + q @ d.shortening @ q.T).ravel(), d_q @ s.reaction.stretch + q @ d.stretch])


RIGS = {
    "bare": paper(Attachments(), damping=DAMPING),
    "7 modes": paper(Attachments(), 7, damping=DAMPING),
    "ratios": paper(Attachments(), damping=Damping(0.0, (0.01, 0.02, 0.03, 0.01, 0.01), 1e-7)),
    "heavy": paper(HEAVY, damping=DAMPING),
    "soft": paper(SOFT, 8, damping=DAMPING),
    "turns": paper(replace(HEAVY, clamp_stiffness=2e3), damping=Damping(0.6, None, 1e-7, high_mode_from=3)),
    "no residual": paper(SOFT, damping=DAMPING, contact=replace(paper_rig().contact, residual_compliance=False)),
    "no G": paper(HEAVY, damping=DAMPING, contact=replace(paper_rig().contact, foreshortening=False)),
    "no R(t)": paper(SOFT, damping=DAMPING, contact=replace(paper_rig().contact, load_variation=0.0)),
}


def seen(rig: Rig, omega: float) -> np.ndarray:
    return np.concatenate([receptance(rig.structure, omega).ravel(), drawn(rig.structure)])


def seen_change(rig: Rig, key: str, omega: float) -> np.ndarray:
    s, d = rig.structure, change(rig, key)
    return np.concatenate([receptance_change(s, d, omega).ravel(), drawn_change(s, d)])


@pytest.mark.parametrize("omega", [330.0, 2000.0])
@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)
def test_every_derivative_is_that_of_the_receptance(rig, omega):
    """Central differences: what they err by falls with the square of the step, down to their rounding."""
    now = np.abs(seen(rig, omega))
    for key, (value, _) in structure_scalars(rig).items():
        size = value or 1e-6
        exact = size * seen_change(rig, key, omega)
        if key == "damping.mass_proportional" and rig.damping.modal_ratios is not None:
            assert not exact.any()  # ratios are in its place: with another value there would be no rig
            continue
        errors = []
        for step in (4e-4, 1e-4):
            up, down = (seen(changed(rig, key, value + moved * size), omega) for moved in (step, -step))
            errors.append(np.abs((up - down) / (2 * step) - exact))
        coarse, fine = errors
        # a receptance is rounded to 1e-12; by 16 where the next order does not show
        rounding = 1e-7 * np.abs(exact) + 1e-8 * now
        assert np.all((fine <= rounding) | (fine < coarse / 14.0)), key


def test_scaling_a_beam_in_E_and_density_scales_its_frequencies():
    s = paper_rig().structure
    by_E, by_rho = change(paper_rig(), "beam.youngs_modulus"), change(paper_rig(), "beam.density")
    np.testing.assert_allclose(210e9 * by_E.stiffness, np.diag(s.omega_n**2), rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(7800.0 * by_rho.stiffness, -np.diag(s.omega_n**2), rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(
        7800.0 * by_rho.rows, -0.5 * np.vstack([s.slip_row, s.excitation, *s.channel_rows.values()])
    )
    # all static flexibility, the axial one too, is inversely proportional to E
    assert 210e9 * by_E.flexibility[0, 0] == pytest.approx(-s.compliance, rel=1e-10)


def test_a_small_mass_lowers_frequencies_as_rayleigh_says():
    """d lambda = -lambda phi(x)^2 m, whatever the coordinates: dK - lambda dM on the diagonal."""
    rig = paper(Attachments(masses=(PointMass(0.0, 0.4),)))
    s, d = rig.structure, change(rig, "attachments.masses[0].mass")
    by_eigenvalue = d.stiffness.diagonal() - s.omega_n**2 * d.mass.diagonal()
    np.testing.assert_allclose(by_eigenvalue, -(s.omega_n**2) * PAPER_BEAM.shapes(np.array([0.4]))[0] ** 2, rtol=1e-9)
    np.testing.assert_allclose(d.damping, 0.06 * d.mass, rtol=1e-9, atol=1e-14)  # alpha acts on it


def test_a_clamp_that_gives_a_little_lets_its_moment_turn():
    """At 1e7 N m/rad, -k^2 d lambda / dk = (E I phi''(0))^2 to first order in E I / (k L) = 1e-5."""
    rig = paper(Attachments(clamp_stiffness=1e7))
    s, d = rig.structure, change(rig, "attachments.clamp_stiffness")
    by_eigenvalue = d.stiffness.diagonal() - s.omega_n**2 * d.mass.diagonal()
    expected = (EI * PAPER_BEAM.shapes(np.zeros(1), 2)[0]) ** 2
    np.testing.assert_allclose(1e14 * by_eigenvalue, expected, rtol=1e-3)


def test_a_tip_spring_stiffens_as_the_slip_row_says():
    rig = paper(Attachments(tip_stiffness=0.0))
    d, s = change(rig, "attachments.tip_stiffness"), rig.structure
    np.testing.assert_allclose(d.stiffness, np.outer(s.slip_row, s.slip_row) / H_ARM**2, rtol=1e-12)
    turning = s.compliance - L / (210e9 * 0.03888 * 0.00478)
    assert d.flexibility[0, 0] == pytest.approx(-((turning / H_ARM) ** 2), rel=1e-6)  # in parallel with the rest


def test_modes_may_coincide():
    """A light resonator tuned to the first mode: the split is not differentiable in order, the structure is."""
    hz = float(paper_rig().structure.omega_n[0] / (2 * np.pi))
    rig = paper(Attachments(resonators=(Resonator(1e-12, hz, 0.3),)))
    d = change(rig, "attachments.resonators[0].frequency_hz")
    assert all(np.isfinite(part).all() for part in d)
    assert np.abs(d.stiffness).max() < 1.01 * 2 * (2 * np.pi) ** 2 * hz
    assert np.abs(d.damping).max() < 1e-6


def test_a_modal_body_has_derivatives_to_its_damping_only():
    body = ModalBody((50.0, 80.0), ((1.0, 2.0),), (0.1, 0.2), (1.0, 1.0))
    rig = Rig(
        "two", body, Damping(0.1), Contact(10.0, Frictionless()), PAPER_EXCITATION, (Channel("y", "displacement"),)
    )
    assert list(structure_scalars(rig)) == [
        "damping.mass_proportional",
        "damping.stiffness_proportional",
        "damping.high_mode_ratio",
    ]
    np.testing.assert_allclose(change(rig, "damping.mass_proportional").damping, np.eye(2))
    beta = change(rig, "damping.stiffness_proportional").damping
    np.testing.assert_allclose(beta, np.diag((2 * np.pi * np.array([50.0, 80.0])) ** 2))
    with pytest.raises(ValueError, match=r"^two: is given by its modes; must be a beam$"):
        _ = rig.layout
    with pytest.raises(ValueError, match=r"^two: has attachments and is given by its modes; must be a beam$"):
        _ = replace(rig, attachments=Attachments(tip_stiffness=1.0)).structure
