"""Rows that couple the beam to its contact, against static solutions and exact frequencies."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

from models import Channel, Damping, ModalBody, ModalStructure, Rig
from models.published import PAPER_BEAM, PAPER_RADIUS, paper_rig
from models.structure import modal_damping

RIG = paper_rig()
L = PAPER_BEAM.length
EI = 210e9 * 0.03888 * 0.00478**3 / 12
EA = 210e9 * 0.03888 * 0.00478
H_ARM = PAPER_RADIUS + 0.00478 / 2
K_T = 1.04e7


def with_contact(**switches: bool) -> Rig:
    return replace(RIG, contact=replace(RIG.contact, **switches))


def static(structure: ModalStructure, load: np.ndarray) -> np.ndarray:
    return load / structure.omega_n**2


# ------------------------------------------------------------------------------------------- slip and shortening


def test_shortening_is_the_form_the_paper_prints() -> None:
    """G_ij = phi_j'(L) phi_i(L) - Int phi_j'' phi_i dx, by parts from Int phi_i' phi_j' dx."""
    nodes, weights = np.polynomial.legendre.leggauss(200)
    x, weights = L * (nodes + 1) / 2, L * weights / 2
    tip = np.array([L])
    boundary = np.outer(PAPER_BEAM.shapes(tip)[0], PAPER_BEAM.shapes(tip, 1)[0])
    printed = boundary - PAPER_BEAM.shapes(x).T @ (weights[:, None] * PAPER_BEAM.shapes(x, 2))
    G = RIG.structure.shortening
    np.testing.assert_allclose(G, printed, rtol=1e-11, atol=1e-11 * np.abs(G).max())
    np.testing.assert_allclose(G, G.T, rtol=1e-15)


def test_slip_row_is_the_tip_slope_times_the_arm() -> None:
    step = 1e-7
    slope = (0.0 - PAPER_BEAM.shapes(np.array([L - step]))[0]) / step  # y(L) = 0
    np.testing.assert_allclose(RIG.structure.slip_row, H_ARM * slope, rtol=1e-5)


def test_excitation_and_channel_rows_are_shapes_there() -> None:
    structure = RIG.structure
    # two libraries of elementary functions
    np.testing.assert_allclose(structure.excitation, PAPER_BEAM.shapes(np.array([0.555]))[0], rtol=1e-15)
    np.testing.assert_allclose(structure.channel_rows["a3"], PAPER_BEAM.shapes(np.array([0.3]))[0], rtol=1e-15)
    assert list(structure.channel_rows) == [f"a{i}" for i in range(1, 7)]


def test_switches_remove_what_they_name() -> None:
    assert not with_contact(foreshortening=False).structure.shortening.any()
    assert with_contact(residual_compliance=False).structure.compliance == 0.0
    assert not with_contact(load_variation=0.0).structure.reaction.varies
    assert RIG.structure.reaction.varies


# --------------------------------------------------------------------------------------------- residual compliance


def test_static_tip_rotation_of_the_modes_tends_to_beam_theory() -> None:
    """The modal sum of phi_i'(L)^2 / omega_i^2 tends to L / (4 E I), from below and like 1/n."""
    full = L / (4 * EI)
    assert full == pytest.approx(2.0388e-3, rel=3e-5)  # docs/theory/equations.md section 2
    carried = []
    for modes in (5, 20, 80):
        structure = RIG.with_modes(modes).structure
        carried.append(float(np.sum((structure.slip_row / H_ARM / structure.omega_n) ** 2)))
    assert carried[0] == pytest.approx(1.7521e-3, rel=3e-5)  # docs/theory/equations.md section 2
    missing = full - np.array(carried)
    assert (missing > 0).all()
    # terms fall like 1/b^2 with b = (i + 1/4) pi, so the rest is 2 L/(EI) / (pi^2 (n + 3/4)) and smaller orders
    rest = 2 * L / EI / (np.pi**2 * (np.array([5, 20, 80]) + 0.75))
    np.testing.assert_allclose(missing, rest, rtol=5e-3)


def test_residual_compliance_is_the_missing_rotation_and_the_axial_strain() -> None:
    expected = L / EA + H_ARM**2 * (2.0388e-3 - 1.7521e-3)
    assert RIG.structure.compliance == pytest.approx(expected, rel=2e-4)  # five printed digits, differenced
    many = RIG.with_modes(400).structure.compliance
    assert many == pytest.approx(L / EA, rel=0.02)  # rest of the rotation falls like 1/n


def stuck_hz(structure: ModalStructure, compliance: float) -> float:
    """First frequency with the contact a spring 1 / (1/k_t + compliance)."""
    spring = 1.0 / (1.0 / K_T + compliance)
    stiffness = np.diag(structure.omega_n**2) + spring * np.outer(structure.slip_row, structure.slip_row)
    return float(np.sqrt(eigh(stiffness, np.eye(structure.n), eigvals_only=True)[0]) / (2 * np.pi))


def exact_stuck_hz(compliance: float) -> float:
    """First root of the clamped beam whose pinned end has a rotational spring, Timoshenko's frequency equation."""
    spring = H_ARM**2 / (1.0 / K_T + compliance)

    def determinant(b: float) -> float:
        # y = A (cosh - cos) + B (sinh - sin) at z = b: y = 0, E I y'' + k y' = 0
        c, s, C, S = np.cos(b), np.sin(b), np.cosh(b), np.sinh(b)
        stiff = spring * L / (EI * b)
        return float((C - c) * (S + s + stiff * (C - c)) - (S - s) * (C + c + stiff * (S + s)))

    b = brentq(determinant, 3.92, 4.7299)  # pinned 3.9266, clamped 4.7300
    return float((b / L) ** 2 * np.sqrt(EI / (7800.0 * 0.03888 * 0.00478)) / (2 * np.pi))


def test_stuck_first_frequency_of_the_paper() -> None:
    """57.73 Hz with 5 modes; 56.780 Hz with all rotation 56.004 Hz with axial strain too; docs/theory/equations.md."""
    structure = RIG.structure
    assert stuck_hz(structure, 0.0) == pytest.approx(57.728, abs=5e-4)
    assert exact_stuck_hz(0.0) == pytest.approx(56.780, abs=5e-4)
    assert exact_stuck_hz(L / EA) == pytest.approx(56.004, abs=5e-4)


@pytest.mark.parametrize("modes", [5, 10, 50])
def test_residual_compliance_makes_few_modes_enough(modes: int) -> None:
    structure = RIG.with_modes(modes).structure
    # what remains is the inertia of the modes left out: 5.3e-4 Hz with 5 modes, falling like their number to the -4
    assert stuck_hz(structure, structure.compliance) == pytest.approx(
        exact_stuck_hz(L / EA), abs=6e-4 * (5 / modes) ** 4
    )
    assert stuck_hz(structure, structure.compliance - L / EA) == pytest.approx(
        exact_stuck_hz(0.0), abs=6e-4 * (5 / modes) ** 4
    )


# --------------------------------------------------------------------------------------------------------- reaction


def slow_reaction(rig: Rig, force: float, friction: float, omega: float) -> float:
    """Amplitude of R - P under in-phase harmonic loads far below the first mode, stretch left out."""
    structure, reaction = rig.structure, rig.structure.reaction
    q = (force * structure.excitation + friction * structure.slip_row) / (structure.omega_n**2 - omega**2)
    inertia = -(omega**2) * reaction.inertia @ q
    return float(inertia - reaction.force_share * force - reaction.friction_lever * friction)


@pytest.mark.parametrize("at", [0.1, 0.3, 0.555])
def test_reaction_to_a_static_force_is_the_textbook_one(at: float) -> None:
    """An upward force F at a takes F a^2 (3 L - a) / (2 L^3) off the reaction of the propped cantilever."""
    rig = replace(RIG.with_modes(50), excitation=replace(RIG.excitation, position=at))
    textbook = -6.5 * at**2 * (3 * L - at) / (2 * L**3)
    assert slow_reaction(rig, 6.5, 0.0, omega=1e-3) == pytest.approx(textbook, rel=1e-8)


def test_reaction_to_a_static_end_moment_is_the_textbook_one() -> None:
    """A moment M = h T at the prop of a propped cantilever changes its reaction by -3 M / (2 L)."""
    assert slow_reaction(RIG, 0.0, 40.0, omega=1e-3) == pytest.approx(-1.5 * H_ARM * 40.0 / L, rel=1e-8)


def exact_dynamic_reaction(at: float, omega: float) -> float:
    """Reaction of the propped beam to a harmonic unit force at `at`: closed form of the differential equation."""
    beta = (7800.0 * 0.03888 * 0.00478 * omega**2 / EI) ** 0.25

    def krylov(z: float) -> tuple[float, float, float, float]:
        c, s, C, S = np.cos(z), np.sin(z), np.cosh(z), np.sinh(z)
        return (C + c) / 2, (S + s) / 2, (C - c) / 2, (S - s) / 2

    k1, k2, k3, k4 = krylov(beta * L)
    f1, f2, _, f4 = krylov(beta * (L - at))
    # y = A k3 + B k4 + step force; y(L) = 0, y''(L) = 0; shear E I y'''(L) is the support's upward force with sign -
    force = 1.0 / (EI * beta**3)
    A, B = np.linalg.solve([[k3, k4], [k1, k2]], [-force * f4, -force * f2])
    third = beta**3 * (A * k4 + B * k1 + force * f1)
    return float(-EI * third)


@pytest.mark.parametrize("hz", [20.0, 52.0, 100.0, 250.0])
def test_reaction_to_a_dynamic_force_is_that_of_the_differential_equation(hz: float) -> None:
    omega = 2 * np.pi * hz
    rig = RIG.with_modes(50)
    # R - P is the support's upward force with P taken as the preload
    assert slow_reaction(rig, 1.0, 0.0, omega) == pytest.approx(exact_dynamic_reaction(0.555, omega), rel=1e-5)


def test_reaction_carries_the_vertical_pull_of_friction_along_the_bent_beam() -> None:
    """Row of T q: Int phi_i' s' dx, here against a fine trapezoidal sum."""
    x = np.linspace(0.0, L, 20001)
    integrand = PAPER_BEAM.shapes(x, 1) * PAPER_BEAM.tip_load_shape(x, 1)[:, None]
    np.testing.assert_allclose(RIG.structure.reaction.stretch, np.trapezoid(integrand, x, axis=0), rtol=1e-6)


def test_reaction_damping_is_the_force_of_distributed_damping_on_the_same_shape() -> None:
    reaction = RIG.structure.reaction
    np.testing.assert_allclose(reaction.damping, 0.06 * reaction.inertia, rtol=1e-14)


# ---------------------------------------------------------------------------------------------------------- damping


def test_high_modes_carry_two_percent_unless_told_otherwise() -> None:
    omega_n = np.linspace(300.0, 9000.0, 8)
    damping = modal_damping(omega_n, 0.06)
    np.testing.assert_array_equal(damping[:5], 0.06)
    np.testing.assert_allclose(damping[5:] / (2 * omega_n[5:]), 0.02, rtol=1e-14)
    np.testing.assert_array_equal(modal_damping(omega_n, 0.06, high_mode_ratio=0.0), 0.06)
    np.testing.assert_array_equal(modal_damping(omega_n, 0.06, high_mode_from=9), 0.06)


def test_modal_ratios_replace_everything_else() -> None:
    omega_n = np.array([10.0, 20.0])
    np.testing.assert_allclose(modal_damping(omega_n, 0.06, (0.01, 0.02), 0.5, 1), [0.2, 0.8], rtol=1e-14)
    np.testing.assert_allclose(modal_damping(omega_n, 0.06, (0.01,)), [0.2, 0.4], rtol=1e-14)
    with pytest.raises(ValueError, match=r"^modal_ratios has 3 entries; must have 1 or 2$"):
        modal_damping(omega_n, modal_ratios=(0.1, 0.1, 0.1))


def test_strain_rate_damping_adds_beta_omega_squared_and_stays_out_of_the_reaction() -> None:
    plain, damped = RIG.structure, replace(RIG, damping=Damping(0.06, stiffness_proportional=1e-6)).structure
    np.testing.assert_allclose(damped.damping - plain.damping, 1e-6 * plain.omega_n**2, rtol=1e-9)
    np.testing.assert_array_equal(damped.reaction.damping, plain.reaction.damping)


# ------------------------------------------------------------------------------------------------------ modal bodies


def test_modal_body_is_taken_as_given() -> None:
    channels = (Channel("f", "force"), Channel("a", "acceleration"), Channel("d", "displacement"))
    body = ModalBody((50.0, 80.0), ((1.0, 1.0), (2.0, 3.0), (4.0, 5.0)), (0.1, 0.2), (1.0, 1.0))
    rig = replace(RIG, body=body, channels=channels, damping=Damping(modal_ratios=(0.01,)))
    structure = rig.structure
    np.testing.assert_allclose(structure.omega_n, [100 * np.pi, 160 * np.pi], rtol=1e-15)
    np.testing.assert_allclose(structure.damping, 0.02 * structure.omega_n, rtol=1e-14)
    np.testing.assert_array_equal(structure.slip_row, [0.1, 0.2])
    assert {k: list(v) for k, v in structure.channel_rows.items()} == {"a": [2.0, 3.0], "d": [4.0, 5.0]}
    assert structure.compliance == 0.0
    assert not structure.shortening.any()
    assert not structure.reaction.varies
    assert rig.with_modes(9) is rig


def test_more_modes_keep_the_lower_ones() -> None:
    five, nine = RIG.structure, RIG.with_modes(9).structure
    np.testing.assert_allclose(nine.omega_n[:5], five.omega_n, rtol=1e-15)
    np.testing.assert_allclose(nine.shortening[:5, :5], five.shortening, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(nine.reaction.inertia[:5], five.reaction.inertia, rtol=1e-11)
