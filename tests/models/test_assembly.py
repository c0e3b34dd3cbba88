"""A beam with attachments: frequency equations, statics, finite elements typed anew, balances of forces and moments."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

from models import Attachments, Channel, Damping, PointMass, PointSpring, Resonator, Rig
from models.published import PAPER_BEAM, PAPER_RADIUS, paper_rig
from models.structure import ModalStructure

L, EI = PAPER_BEAM.length, 210e9 * 0.03888 * 0.00478**3 / 12
RHO_A, EA = 7800.0 * 0.03888 * 0.00478, 210e9 * 0.03888 * 0.00478
H_ARM = PAPER_RADIUS + 0.00478 / 2
X_F = 0.555
HEAVY = Attachments(
    masses=(PointMass(0.05, 0.4), PointMass(0.02, 0.15)),
    springs=(PointSpring(3e3, 0.25),),
    resonators=(Resonator(0.03, 70.0, 0.3), Resonator(0.02, 2000.0, 0.5)),
    tip_stiffness=60.0,
)
SOFT = replace(HEAVY, clamp_stiffness=2e3, support_stiffness=2e5)


def paper(attachments: Attachments, modes: int = 5, **changes: object) -> Rig:
    return replace(paper_rig(), attachments=attachments, **changes).with_modes(modes)


# ------------------------------------------------------------------------------------------- frequency equations


def exact_hz(clamp: float, tip: float, support: float, count: int) -> np.ndarray:
    """Roots of the frequency equation of a beam on rotational springs at both ends and a vertical one at its tip.

    Timoshenko, Vibration Problems in Engineering; y = a cos + b sin + c cosh + d sinh. inf is rigid.
    """

    def determinant(b: float) -> float:
        c, s, C, S = np.cos(b), np.sin(b), np.cosh(b), np.sinh(b)
        deflection, slope = np.array([c, s, C, S]), b * np.array([-s, c, S, C])
        moment, shear = b**2 * np.array([-c, -s, C, S]), b**3 * np.array([s, -c, S, C])
        turn, bend = b * np.array([0.0, 1.0, 0.0, 1.0]), b**2 * np.array([-1.0, 0.0, 1.0, 0.0])
        rows = np.array(
            [
                [1.0, 0.0, 1.0, 0.0],
                turn if np.isinf(clamp) else bend - clamp * L / EI * turn,
                moment + tip * L / EI * slope,
                deflection if np.isinf(support) else shear - support * L**3 / EI * deflection,
            ]
        )
        return float(np.linalg.det(rows / np.abs(rows).max(axis=1)[:, None]))

    grid = np.linspace(0.05, 5.0 + np.pi * count, 3000)
    values = [determinant(b) for b in grid]
    changes = [i for i in range(len(grid) - 1) if values[i] * values[i + 1] < 0.0]
    roots = np.array([brentq(determinant, grid[i], grid[i + 1], xtol=1e-13) for i in changes])[:count]
    return np.asarray((roots / L) ** 2 * np.sqrt(EI / RHO_A) / (2 * np.pi))


@pytest.mark.parametrize(
    ("clamp", "tip", "support"),
    [
        *((k, 0.0, np.inf) for k in (1e-3, 1e2, 1e4, 1e7, 1e10)),
        *((np.inf, k, np.inf) for k in (0.0, 1e2, 1e4, 1e6)),
        *((np.inf, 0.0, k) for k in (1e3, 1e5, 1e7, 1e9, 1e12)),
        (5e2, 30.0, 1e5),
    ],
)
def test_springs_at_the_ends_give_the_frequencies_of_the_frequency_equation(clamp, tip, support):
    """Ritz with 25 beam modes and static shapes: from above, 1e-11 to 6e-6, most where the tip is free or turns."""
    attached = Attachments(
        clamp_stiffness=None if np.isinf(clamp) else clamp,
        tip_stiffness=tip,
        support_stiffness=None if np.isinf(support) else support,
    )
    hz = paper(attached).structure.omega_n[:4] / (2 * np.pi)
    np.testing.assert_allclose(hz, exact_hz(clamp, tip, support, 4), rtol=1e-5)


def test_a_clamp_tends_to_a_hinge_and_to_rigid():
    """sin b = 0; and the bare beam, off by what a compliance lets through: d omega^2 = -(E I phi''(0))^2 / k."""
    hinged = paper(Attachments(clamp_stiffness=1e-6)).structure.omega_n
    np.testing.assert_allclose(hinged[:4], (np.arange(1, 5) * np.pi / L) ** 2 * np.sqrt(EI / RHO_A), rtol=1e-7)
    stiff, bare = paper(Attachments(clamp_stiffness=1e7)).structure, paper_rig().structure
    moment = EI * PAPER_BEAM.shapes(np.zeros(1), 2)[0]
    # second order in E I / (k L) = 1e-5; the eigenvalues carry 1e-14
    np.testing.assert_allclose(stiff.omega_n**2 - bare.omega_n**2, -(moment**2) / 1e7, rtol=1e-3)
    np.testing.assert_allclose(stiff.reaction.inertia, bare.reaction.inertia, rtol=1e-3)


def test_a_support_tends_to_rigid_with_its_reaction():
    """Off by what a compliance lets through, like 1 / k: 3 E I / (k L^3) = 1e-8 at 1e11 N/m, times curvatures."""
    stiff, bare = paper(Attachments(support_stiffness=1e11), 6).structure, paper_rig().with_modes(6).structure
    np.testing.assert_allclose(receptance(stiff, 330.0), receptance(bare, 330.0), rtol=1e-5)
    np.testing.assert_allclose(stiff.reaction.stretch[:4], bare.reaction.stretch[:4], rtol=1e-4)


def receptance(structure: ModalStructure, omega: float) -> np.ndarray:
    """Of slip, drive, channels and reaction (3 + c) to friction and force, products of motion left out, (3 + c, 2)."""
    s, r, i_omega = structure, structure.reaction, 1j * omega
    elastic = i_omega**2 * r.inertia + i_omega * r.damping + r.stiffness
    rows = np.array([s.slip_row, s.excitation, *s.channel_rows.values(), elastic])
    static = [[s.compliance, s.residual.slip_by_force], [s.residual.slip_by_force, s.residual.drive_by_force]]
    static += [[by_T, by_F] for by_F, by_T in s.residual.channels.values()]
    static += [[-r.friction_lever, -r.force_share]]
    stiffness = s.omega_n**2 + i_omega**2 + i_omega * s.damping
    return np.asarray(rows @ (rows[:2] / stiffness).T + np.array(static))


def test_attachments_of_no_size_change_nothing():
    none = Attachments(
        tip_stiffness=0.0,
        masses=(PointMass(0.0, 0.4),),
        springs=(PointSpring(0.0, 0.25),),
        resonators=(Resonator(0.0, 70.0, 0.3), Resonator(0.0, 3000.0, 0.3)),
    )
    damping = Damping(0.06, stiffness_proportional=1e-7)
    with_none, bare = (paper(a, 7, damping=damping).structure for a in (none, Attachments()))
    assert with_none.n == bare.n + 1  # the resonator within the modes kept; it counts as none of them where they damp
    for hz in (0.0, 47.0, 400.0):
        expected = receptance(bare, 2 * np.pi * hz)
        # residual flexibility of 7 modes by 27: what cancels there
        np.testing.assert_allclose(receptance(with_none, 2 * np.pi * hz), expected, rtol=1e-9)


def test_one_damping_ratio_per_mode_stays_with_the_modes_of_the_beam():
    ratios = (0.01, 0.02, 0.03, 0.04, 0.05)
    light = Attachments(resonators=(Resonator(1e-12, 100.0, 0.3),))
    s = paper(light, damping=Damping(modal_ratios=ratios)).structure
    np.testing.assert_allclose(s.damping / (2 * s.omega_n), [0.01, 0.01, 0.02, 0.03, 0.04, 0.05], rtol=1e-9)


# ------------------------------------------------------------------------------------------------------ statics


@pytest.mark.parametrize("support", [None, 1e5])
@pytest.mark.parametrize("clamp", [None, 300.0])
def test_reaction_to_static_loads_is_that_of_a_beam_on_a_spring(clamp, support):
    """Force method: the reaction closes the gap that force and end moment open at the tip of the cantilever."""
    rig = paper(Attachments(clamp_stiffness=clamp, support_stiffness=support), 8)
    turn = 0.0 if clamp is None else 1.0 / clamp
    yields = 0.0 if support is None else 1.0 / support
    lifted = L**3 / (3 * EI) + L**2 * turn + yields
    by_force = X_F**2 * (3 * L - X_F) / (6 * EI) + X_F * L * turn
    by_moment = L**2 / (2 * EI) + L * turn
    expected = -np.array([H_ARM * by_moment, by_force]) / lifted
    np.testing.assert_allclose(receptance(rig.structure, 0.0)[-1].real, expected, rtol=1e-8)


def test_reaction_to_static_loads_shares_them_with_a_spring_beside():
    """Two unknowns: a spring of stiffness k at a, and the reaction; influence coefficients of the cantilever."""
    a, k = 0.25, 3e3

    def by_force(x: float, at: float) -> float:
        near, far = min(x, at), max(x, at)
        return near**2 * (3 * far - near) / (6 * EI)

    def by_moment(x: float) -> float:
        return x**2 / (2 * EI)

    flexibility = np.array([[by_force(L, L), by_force(L, a)], [by_force(a, L), by_force(a, a) + 1 / k]])
    opened = np.array(
        [[H_ARM * by_moment(L), by_force(L, X_F)], [H_ARM * by_moment(a), by_force(a, X_F)]]
    )  # at the tip and at the spring, by unit T and F
    expected = -np.linalg.solve(flexibility, opened)[0]
    found = receptance(paper(Attachments(springs=(PointSpring(k, a),))).structure, 0.0)[-1].real
    np.testing.assert_allclose(found, expected, rtol=1e-9)


# ------------------------------------------------------------------------------------------------ finite elements


class FiniteElements:
    """Hermite beam elements with the attachments as matrices on their nodes."""

    def __init__(self, attached: Attachments, places: list[float]) -> None:
        self.attached = attached
        points = {0.0, L, X_F, *places}
        points |= {e.position for kind in (attached.masses, attached.springs, attached.resonators) for e in kind}
        ends = np.array(sorted(points))
        parts = [np.linspace(a, b, 1 + int(np.ceil((b - a) / 0.012)))[:-1] for a, b in pairwise(ends)]
        self.x = np.concatenate([*parts, [L]])
        beam = 2 * len(self.x)
        self.size = beam + len(attached.resonators)
        self.M, self.K, self.G = (np.zeros((self.size, self.size)) for _ in range(3))
        for i, h in enumerate(np.diff(self.x)):
            at = np.ix_(range(2 * i, 2 * i + 4), range(2 * i, 2 * i + 4))
            t = np.diag([1.0, h, 1.0, h])
            mass = [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
            bend = [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
            slope = [[36, 3, -36, 3], [3, 4, -3, -1], [-36, -3, 36, -3], [3, -1, -3, 4]]
            self.M[at] += RHO_A * h / 420 * t @ mass @ t
            self.K[at] += EI / h**3 * t @ bend @ t
            self.G[at] += 1 / (30 * h) * t @ slope @ t
        self.tip = beam - 2
        for body in attached.masses:
            self.M[self.y(body.position), self.y(body.position)] += body.mass
        for spring in attached.springs:
            self.K[self.y(spring.position), self.y(spring.position)] += spring.stiffness
        for z, swinging in enumerate(attached.resonators, start=beam):
            k = swinging.mass * (2 * np.pi * swinging.frequency_hz) ** 2
            at = np.ix_([self.y(swinging.position), z], [self.y(swinging.position), z])
            self.K[at] += k * np.array([[1, -1], [-1, 1]])
            self.M[z, z] += swinging.mass
        self.K[self.tip + 1, self.tip + 1] += attached.tip_stiffness or 0.0
        self.K[1, 1] += attached.clamp_stiffness or 0.0
        self.K[self.tip, self.tip] += attached.support_stiffness or 0.0
        held = [0, *([1] if attached.clamp_stiffness is None else [])]
        held += [self.tip] if attached.support_stiffness is None else []
        self.free = np.setdiff1d(np.arange(self.size), held)

    def y(self, x: float) -> int:
        return 2 * int(np.abs(self.x - x).argmin())

    def receptance(self, omega: float, alpha: float, beta: float, places: list[float]) -> np.ndarray:
        """As :func:`receptance`."""
        Z = self.K - omega**2 * self.M + 1j * omega * (alpha * self.M + beta * self.K)
        loads = np.zeros((self.size, 2))
        loads[self.tip + 1, 0], loads[self.y(X_F), 1] = H_ARM, 1.0
        Y = np.zeros((self.size, 2), dtype=complex)
        Y[self.free] = np.linalg.solve(Z[np.ix_(self.free, self.free)], loads[self.free])
        k = self.attached.support_stiffness
        # the support's force on the beam: what its row lacks; of a spring with its damper
        normal = (Z @ Y - loads)[self.tip] if k is None else -k * (1 + 1j * omega * beta) * Y[self.tip]
        slip = H_ARM * Y[self.tip + 1] + [L / EA, 0.0]
        return np.array([slip, *(Y[self.y(x)] for x in (X_F, *places)), normal])


PLACES = [c.position for c in paper_rig().response_channels]


@pytest.mark.parametrize("hz", [1.0, 45.0, 68.0, 140.0, 400.0])
@pytest.mark.parametrize("attached", [HEAVY, SOFT, replace(HEAVY, clamp_stiffness=2e3)], ids=["heavy", "soft", "turns"])
def test_beam_with_everything_attached_moves_as_finite_elements_do(attached, hz):
    """Friction and force to every channel and the reaction, damped by alpha and beta.

    Modes beyond the 25 kept answer statically, without inertia and damping: 1e-5 near the first mode, like frequency^2.
    """
    alpha, beta = 20.0, 1e-6
    damping = Damping(alpha, stiffness_proportional=beta, high_mode_ratio=0.0)
    found = receptance(paper(attached, 25, damping=damping).structure, 2 * np.pi * hz)
    expected = FiniteElements(attached, PLACES).receptance(2 * np.pi * hz, alpha, beta, PLACES)
    error = np.abs(found - expected) / np.abs(expected).max(axis=1)[:, None]
    assert error.max() < 2e-5 * max(1.0, hz / 60.0) ** 2


@pytest.mark.parametrize("attached", [HEAVY, SOFT, replace(HEAVY, clamp_stiffness=2e3)], ids=["heavy", "soft", "turns"])
def test_shortening_is_that_of_finite_element_modes(attached):
    """Also the vertical pull of the friction on the support, Int phi' s' dx."""
    fe, s = FiniteElements(attached, PLACES), paper(attached, 8).structure
    at = np.ix_(fe.free, fe.free)
    squares, shapes = eigh(fe.K[at], fe.M[at], subset_by_index=[0, 3])
    np.testing.assert_allclose(s.omega_n[:4], np.sqrt(squares), rtol=3e-6)
    modes = np.zeros((fe.size, 4))
    modes[fe.free] = shapes
    modes *= np.sign(modes[fe.y(X_F)] * s.excitation[:4])
    scale = np.abs(s.shortening[:4, :4]).max()
    np.testing.assert_allclose(s.shortening[:4, :4], modes.T @ fe.G @ modes, rtol=0, atol=1e-5 * scale)
    if attached.support_stiffness is None:
        lift = np.zeros(fe.size)
        lift[: fe.tip + 2 : 2], lift[1 : fe.tip + 2 : 2] = (PAPER_BEAM.tip_load_shape(fe.x, order) for order in (0, 1))
        np.testing.assert_allclose(s.reaction.stretch[:4], lift @ fe.G @ modes, rtol=1e-4)


# -------------------------------------------------------------------------------------------------------- balance


@pytest.mark.parametrize("hz", [20.0, 60.0, 150.0])
def test_moments_about_a_hinge_balance_the_angular_momentum(hz):
    """Reaction, force, friction, springs and the inertia along the beam, seen by sensors at quadrature points."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    x, weights = L * (nodes + 1) / 2, L * weights / 2
    k, m, k_tip = 3e3, 0.05, 60.0
    attached = Attachments(
        clamp_stiffness=1e-9,
        tip_stiffness=k_tip,
        masses=(PointMass(m, 0.4),),
        springs=(PointSpring(k, 0.25),),
    )
    places = [*x, 0.4, 0.25]
    channels = tuple(Channel(f"y{i}", "displacement", place) for i, place in enumerate(places))
    rig = paper(attached, 25, channels=channels, damping=Damping(high_mode_ratio=0.0))
    omega = 2 * np.pi * hz
    H = receptance(rig.structure, omega).real
    turn = (H[0] - [L / EA, 0.0]) / H_ARM
    along, at_mass, at_spring, R = H[2 : 2 + len(x)], H[-3], H[-2], H[-1]
    moments = R * L + [H_ARM, X_F] - k * 0.25 * at_spring - k_tip * turn
    momentum = -(omega**2) * (RHO_A * (weights * x) @ along + m * 0.4 * at_mass)
    # inertia of the modes left out
    np.testing.assert_allclose(moments, momentum, rtol=0, atol=5e-6 * (hz / 20.0) ** 2 * np.abs(R * L).max())
