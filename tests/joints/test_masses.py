"""Lumped masses on bodies: modes, reactions, exact derivatives, motions in time, rig files."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hbm.balance.jointed import JointBalance
from hbm.cli import app
from hbm.errors import InputError
from hbm.fourier import Array, FourierBasis
from hbm.integration.jointed import joint_steady_state, state_at_phase_zero
from hbm.response.trace import steady_state
from hbm.stability.jointed import joint_stability
from models import Attachments, Jenkins, PointMass
from models.bodies import FiniteBeam, LumpedMass, MatrixBody, ModalModel, PortedModes
from models.jointed import JointedRig
from models.joints import Friction
from models.parts import Channel, Damping, Excitation
from models.published import paper_rig
from tests.joints.rigs import BEAM, TWO_MODES, beam_rig, loaded, made_up

LUMPS = (LumpedMass("y(0.3)", 0.05), LumpedMass("y(0.15)", 0.01))
ALPHA = Damping(10.0, high_mode_ratio=0.0)


def carrying(body: object, masses: tuple[LumpedMass, ...] = LUMPS, at: str = "y(0.555)") -> JointedRig:
    return JointedRig("laden", body, ALPHA, (), Excitation(1.0, at=at), masses=masses)


def in_the_matrix(beam: FiniteBeam) -> MatrixBody:
    """Matrices of a beam that hold the lumps."""
    bare = beam.matrices([0.15, 0.3, 0.555])
    mass = bare.mass.tolil()
    for lump, x in zip(LUMPS, (0.3, 0.15), strict=True):
        for motion in ("axial", "y"):
            at = bare.dofs.index(f"{motion}@{x!r}")
            mass[at, at] += lump.mass
    return MatrixBody(mass.tocsr(), bare.stiffness, bare.dofs, 40, fixed=bare.fixed)


def reactions(p: PortedModes, omega: float) -> Array:
    """Reactions per force at each place that swings."""
    dynamic = np.diag(p.omega_n**2 - omega**2) + 1j * omega * p.damping
    by_motion = -(omega**2) * p.reaction_inertia + 1j * omega * p.reaction_damping
    return np.asarray(by_motion @ np.linalg.solve(dynamic, p.rows.T) - p.reaction_share)


@pytest.mark.parametrize("ends", [("clamped", "supported"), ("free", "free")])
def test_lumps_on_a_beam_are_those_in_its_matrices(ends: tuple[str, str]) -> None:
    beam = FiniteBeam(replace(BEAM, modes=14), *ends)
    places, supports = ("y(0.555)", "y(0.3)"), ("y(0.606)",) if ends[1] == "supported" else ()
    found = carrying(beam).laden_at(places, supports).modes
    held = [f"y@{0.606!r}"] if supports else []
    full = in_the_matrix(beam).ported(["y@0.555", "y@0.3"], ALPHA, held)
    assert found.n == 14 and found.places == places
    assert found.omega_n[:6] == pytest.approx(full.omega_n[:6], rel=2e-6)
    assert np.sum(found.omega_n == 0.0) == (3 if ends[0] == "free" else 0)
    for hz in (5.0, 20.0, 60.0):
        exact = full.receptance(2 * np.pi * hz)
        assert np.abs(found.receptance(2 * np.pi * hz) - exact).max() < 1e-6 * np.abs(exact).max()
        if supports:
            assert reactions(found, 2 * np.pi * hz) == pytest.approx(reactions(full, 2 * np.pi * hz), rel=3e-5)


def test_a_lump_is_that_of_a_rig_with_one_contact() -> None:
    rig = paper_rig()
    rig = replace(rig, body=replace(rig.body, modes=6), attachments=Attachments(masses=(PointMass(0.04, 0.2),)))
    found = carrying(FiniteBeam(replace(rig.body, modes=12)), (LumpedMass("y(0.2)", 0.04),)).ported
    bending = found.omega_n[np.abs(found.rows[0]) > 1e-3]
    assert bending[:6] == pytest.approx(rig.structure.omega_n, rel=1e-4)


def test_a_lump_behind_a_flexibility_is_an_oscillator_on_an_oscillator() -> None:
    m, k, c, M = 2.0, 800.0, 4e-3, 0.5
    body = ModalModel(
        (float(np.sqrt(k / m)) / (2 * np.pi),), {"a": (m**-0.5,), "b": (m**-0.5,)}, ((0.0, 0.0), (0.0, c))
    )
    rigid = carrying(body, (LumpedMass("a", M), LumpedMass("a", M)), "a").ported
    assert rigid.omega_n == pytest.approx([np.sqrt(k / (m + 2 * M))], rel=1e-10)
    assert rigid.rows[0] == pytest.approx([(m + 2 * M) ** -0.5], rel=1e-10)
    stiffness, mass = np.array([[k + 1 / c, -1 / c], [-1 / c, 1 / c]]), np.diag([m, M])
    lowest = np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real.min())
    soft = carrying(body, (LumpedMass("b", M),), "b").laden_at(("a", "b")).modes
    assert soft.omega_n == pytest.approx([lowest], rel=1e-10)
    at_rest = np.linalg.inv(stiffness)  # which no mass changes
    assert soft.rows @ soft.rows.T / lowest**2 + soft.flexibility == pytest.approx(at_rest, rel=1e-9)


def test_no_mass_changes_nothing_and_all_translations_of_a_point_move_it() -> None:
    rig = beam_rig(Friction(Jenkins(0.4, 1e-6), 5.0))
    none = replace(rig, masses=(LumpedMass("y(0.3)", 0.0),))
    for f in fields(rig.structure):
        own = getattr(rig.structure, f.name)
        assert np.abs(getattr(none.structure, f.name) - own).max(initial=0.0) <= 1e-9 * np.abs(own).max(initial=1e-12)
    beam = rig.body
    assert beam.translations("y(0.3)") == ("axial(0.3)", "y(0.3)")
    assert beam.translations("axial(0.606)") == ("axial(0.606)",)  # the tip keeps its height
    matrices = replace(beam.matrices(), dofs=tuple(f"{i // 3}.{'x y rz'.split()[i % 3]}" for i in range(183)), fixed=())
    assert matrices.translations("7.y") == ("7.x", "7.y") and matrices.translations("7.rz") == ("7.rz",)
    assert ModalModel((3.0,), {"a.ux": (1.0,), "a.uz": (1.0,), "b": (1.0,)}).translations("a.uz") == ("a.ux", "a.uz")


def laden(rig: JointedRig, **more: object) -> JointedRig:
    return replace(rig, masses=(LumpedMass("a", 0.3), LumpedMass("e", 1e-3)), **more)


RIGS = {
    "ratios": laden(made_up(False, True), damping=Damping(modal_ratios=(0.0, 0.04, 0.05, 0.03))),
    "alpha": laden(made_up(False, False), damping=Damping(0.3, high_mode_from=3, stiffness_proportional=1e-3)),
    "matrix": laden(made_up(True, True)),
    "beam": replace(beam_rig(Friction(Jenkins(0.4, 1e-6), 5.0)), damping=Damping(3.0), masses=LUMPS),
}
KEYS = {
    "ratios": ("masses[1].mass", "modal.frequencies_hz[2]", "damping.modal_ratios[3]", "modal.flexibility[1][5]"),
    "alpha": ("masses[2].mass", "modal.frequencies_hz[4]", "damping.mass_proportional", "modal.ports.a[2]"),
    "matrix": ("masses[1].mass", "modal.damping_matrix[1][3]", "modal.ports.d[3]"),
    "beam": ("masses[1].mass", "masses[2].mass", "beam.youngs_modulus", "damping.mass_proportional"),
}


@pytest.mark.parametrize(("name", "key"), [(name, key) for name, keys in KEYS.items() for key in keys])
def test_derivatives_are_those_of_bodies_nearby(name: str, key: str) -> None:
    rig = RIGS[name]
    moving, change = rig.structure_changes(("joints.none", key))
    assert moving == [1]
    value = rig.number(key)

    def across(field: str, step: float) -> Array:
        up, down = (getattr(rig.with_number(key, value + sign * step).structure, field) for sign in (1, -1))
        return np.asarray((up - down) / (2 * step))

    moved = False
    for f in fields(rig.structure):
        step = 1e-4 * abs(value)
        nearby = (4 * across(f.name, step / 2) - across(f.name, step)) / 3
        own = np.abs(getattr(rig.structure, f.name)).max(initial=0.0)
        size = max(np.abs(nearby).max(initial=0.0), 1e-3 * own / abs(value))
        assert np.abs(getattr(change, f.name)[..., 0] - nearby).max(initial=0.0) <= 1e-6 * size, f.name
        moved |= bool(np.abs(nearby).max(initial=0.0) > 1e-5 * own / abs(value))
    assert moved


def test_harmonic_balance_and_time_integration_agree_about_a_rig_with_lumps() -> None:
    rig = laden(made_up(True, False), channels=(Channel("x", "acceleration", at="e"),))
    H = 25
    solution = steady_state(rig, 1.3, harmonics=H, samples=1024)
    assert abs(solution.energy_error) < 1e-6
    problem = JointBalance(rig, FourierBasis(H, 1024))
    period = joint_steady_state(rig, 1.3, steps_per_period=1024, start=state_at_phase_zero(problem, solution.state))
    for name in ("drive", "x", "rub.force", "spring.motion", "plane.force.1"):
        balanced, marched = solution[name].coefficients, period.history.coefficients(name, H)
        assert np.abs(balanced[1:] - marched[1:])[[0, 1, H, H + 1]].max() < 5e-3 * np.abs(balanced).max(), name
    stability, own = joint_stability(problem, solution.state), np.linalg.eigvals(period.monodromy)
    own = own[np.argsort(np.abs(own - 1.0))[stability.undying :]]
    assert np.abs(stability.multipliers).max() == pytest.approx(np.abs(own).max(), abs=0.02)


FILE = (
    TWO_MODES
    + """[[masses]]
at = "two"
mass = 0.25
[[joints]]
name = "pad"
law = "cubic-spring"
cubic = 1e9
at = "one"
[[channels]]
name = "a1"
quantity = "acceleration"
at = "one"
"""
)


def test_a_rig_file_has_masses(tmp_path: Path) -> None:
    rig = loaded(tmp_path, FILE)
    assert rig.masses == (LumpedMass("two", 0.25),)
    assert "lumped mass: 0.25 kg at two" in str(rig)
    assert rig.with_number("masses[1].mass", 0.3).masses[0].mass == 0.3
    assert rig.structure.omega_n[0] < 0.99 * 2 * np.pi * 16.0
    out = tmp_path / "curve.csv"
    numbers = ("--parameter", "masses[1].mass", "--from", "0.2", "--to", "0.3", "--frequency", "15", "--harmonics", "3")
    done = CliRunner().invoke(app, ["continue", str(tmp_path / "rig.toml"), *numbers, "--out", str(out)])
    assert done.exit_code == 0 and out.exists(), done.output


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("mass = 0.25", "mass = -0.25", r"masses\[1\].mass = -0.25; must be >= 0"),
        ("mass = 0.25", 'mass = "heavy"', r'masses\[1\].mass = "heavy"; must be a number'),
        ("mass = 0.25", "", r"masses\[1\].mass is missing; required keys are at, mass"),
        ("mass = 0.25", "mass = 1e13", r"masses\[1\].mass = 10000000000000.0; must be of magnitude <= 1e\+12 kg"),
        ('at = "two"', 'at = "too"', r'masses\[1\].at = "too"; ports are one, two; did you mean two\?'),
        ('at = "two"', 'at = "two - one"', r'masses\[1\].at = "two - one"; must be one place, a translation'),
        ('at = "two"', 'at = "4.rx"', r'masses\[1\].at = "4.rx"; must be one place, a translation'),
        ("two = [0.4, -0.6]", "two = [0.0, 0.0]", r"masses\[1\] at two, where nothing moves"),
    ],
)
def test_masses_that_are_none_are_refused(old: str, new: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        loaded(tmp_path, FILE.replace(old, new))
