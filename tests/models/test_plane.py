"""Plane finite elements beside closed forms: patch test, beam theory, Hertz."""

import numpy as np
import pytest

pytest.importorskip("skfem")

from models import Damping
from models.plane import ELEMENTS, HalfCylinder, PlaneBeam, beam_mesh
from models.plane.elements import Material

E, NU, RHO, WIDTH = 210e9, 0.3, 7800.0, 0.03888
LENGTH, THICKNESS, RADIUS = 0.606, 0.00478, 0.005
STEEL = Material(E, NU, RHO, WIDTH, "plane-stress")
BENDS = ("CPS4I", "CPS8", "CPS8R", "CPS6")
INERTIA = WIDTH * THICKNESS**3 / 12


def beam(**changed):
    known = {"length": LENGTH, "thickness": THICKNESS, "width": WIDTH, "youngs_modulus": E, "density": RHO}
    return PlaneBeam(**(known | changed))


def tip_deflection(element, columns, rows):
    """Per unit force at the end of the neutral axis, over that of beam theory."""
    model = beam(element=element, columns=columns, rows=rows).model(modes=3)
    place = f"{model.at(LENGTH)}.y"
    return model.body.ported([place], Damping()).receptance(0.0).real[0, 0] / (LENGTH**3 / (3 * E * INERTIA))


@pytest.mark.parametrize("state", ["plane-stress", "plane-strain"])
@pytest.mark.parametrize("name", ELEMENTS)
def test_constant_strain_is_exact_on_distorted_elements(name, state):
    """Patch test: linear displacements need no force inside, and have the energy of that strain."""
    mesh = beam_mesh(0.02, THICKNESS, 5, 2, HalfCylinder(0.012, RADIUS, spacing=1e-4, even=2))
    material = Material(E, NU, RHO, WIDTH, state)
    found = ELEMENTS[name].assemble(mesh, material)
    strain = np.array([[1e-3, 4e-4], [4e-4, -5e-4]])
    u = (strain @ found.places)[found.along, np.arange(found.places.shape[1])]
    force = found.stiffness @ u
    scale = np.abs(found.stiffness).max() * np.abs(u).max()
    x, y = found.places
    on_arc = np.hypot(x - 0.012, y + THICKNESS / 2) > 0.9 * RADIUS
    inside = (np.abs(y) < THICKNESS / 2 - 1e-9) & (x > 1e-9) & (x < 0.02 - 1e-9)
    inside |= (y < -THICKNESS / 2 - 1e-9) & ~on_arc
    assert inside.sum() > 100
    assert np.abs(force[inside]).max() < 1e-9 * scale
    nu = NU / (1 - NU) if state == "plane-strain" else NU
    modulus = E / (1 - NU**2) if state == "plane-strain" else E
    stress = modulus / (1 - nu**2) * ((1 - nu) * strain + nu * np.trace(strain) * np.eye(2))
    area = found.mass.sum() / 2 / RHO / WIDTH
    assert u @ force == pytest.approx(np.sum(stress * strain) * area * WIDTH, rel=1e-9)


@pytest.mark.parametrize("name", ELEMENTS)
def test_rigid_motion_costs_nothing(name):
    mesh = beam_mesh(0.02, THICKNESS, 5, 2, HalfCylinder(0.012, RADIUS, spacing=1e-4, even=2))
    found = ELEMENTS[name].assemble(mesh, STEEL)
    turned = np.where(found.along == 0, -found.places[1], found.places[0])
    assert np.abs(found.stiffness @ turned).max() < 1e-10 * np.abs(found.stiffness).max() * np.abs(turned).max()
    assert found.mass.sum() == pytest.approx(2 * RHO * WIDTH * (0.02 * THICKNESS + np.pi * RADIUS**2 / 2), rel=2e-3)


@pytest.mark.parametrize("name", BENDS)
def test_cantilever_is_beam_theory(name):
    """Deflection under an end load and first frequency; the clamp holds the thickness too: 0.3 % at 30 elements."""
    assert tip_deflection(name, 30, 2) == pytest.approx(1.0, abs=3e-3)
    hz = beam(element=name, columns=30, rows=2).model(modes=1).body.ported([], Damping()).omega_n[0] / (2 * np.pi)
    theory = 1.8751040687**2 / (2 * np.pi * LENGTH**2) * np.sqrt(E * INERTIA / (RHO * WIDTH * THICKNESS))
    assert hz == pytest.approx(theory, rel=2e-3)


def test_linear_elements_lock_in_bending_and_reduced_ones_are_soft():
    """4 nodes: parasitic shear of an element of ratio a = length / height, 1 / (1 + (1 - nu) a^2 / 2) as a grows.

    With one point of integration each row is a bar: 1 - 1 / rows^2 of the stiffness is left.
    """
    rows = 2
    assert tip_deflection("CPS4R", 120, rows) == pytest.approx(1 / (1 - 1 / rows**2), rel=5e-3)
    for columns in (30, 60):
        assert tip_deflection("CPS4", columns, 2) < 0.5
        assert tip_deflection("CPS3", columns, 2) < tip_deflection("CPS4", columns, 2)


def short_deflection(element, rows):
    """Of a beam ten times as long as thick, in squares, under a unit load at the end."""
    model = beam(length=10 * THICKNESS, element=element, columns=10 * rows, rows=rows).model(modes=2)
    return model.body.ported([f"{model.at(10 * THICKNESS)}.y"], Damping()).receptance(0.0).real[0, 0]


@pytest.fixture(scope="module")
def exact_deflection():
    return short_deflection("CPS8", 16)


@pytest.mark.parametrize("name", ["CPS4", "CPS3"])
def test_deflection_converges_in_second_order(name, exact_deflection):
    """The error of the energy falls with the area of the elements, and from below: displacements are assumed."""
    errors = np.array([exact_deflection - short_deflection(name, rows) for rows in (4, 8, 16)])
    assert np.all(errors > 0.0)
    # second order but for the corners of the clamp, where stresses are singular
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all(orders > 1.6)
    assert np.all(orders < 2.1)


def test_plane_strain_stiffens_by_poisson():
    hz = [
        beam(element="CPS8", columns=60, rows=2, state=state).model(modes=1).body.ported([], Damping()).omega_n[0]
        for state in ("plane-stress", "plane-strain")
    ]
    assert hz[1] / hz[0] == pytest.approx(1 / np.sqrt(1 - NU**2), rel=1e-3)


@pytest.fixture(scope="module")
def resting():
    cylinder = HalfCylinder(LENGTH, RADIUS, spacing=5e-6, even=20)
    return beam(length=LENGTH + RADIUS, cylinder=cylinder, state="plane-strain").model(modes=6)


def test_contact_at_rest_is_that_of_hertz(resting):
    """Line contact of a cylinder with a rigid plane: half width and pressure of Hertz, the load carried whole.

    A hundred times the paper's load is ten times as wide, so that elements ten times as large resolve it.
    """
    load, count, spacing = 8300.0, 41, 5e-6
    forces = np.maximum(resting.resting(count, load, 1e13), 0.0)
    assert forces.sum() == pytest.approx(load, rel=1e-3)
    half = np.sqrt(4 * load / WIDTH * RADIUS / (np.pi * E / (1 - NU**2)))
    at = (np.arange(count) - count // 2) * spacing
    hertz = 2 * load / (np.pi * half) * np.sqrt(np.maximum(1 - (at / half) ** 2, 0.0)) * spacing
    np.testing.assert_allclose(forces, hertz, atol=0.06 * hertz.max())
    np.testing.assert_allclose(forces, forces[::-1], atol=0.06 * hertz.max())  # the beam leans a little
    assert np.ptp(at[forces > 0.0]) / 2 == pytest.approx(half, abs=spacing)


def test_reduced_to_a_thousandth_of_the_receptance(resting):
    places = [f"{resting.contacts(1)[0]}.{d}" for d in "xy"] + [f"{resting.at(0.555)}.y"]
    body = resting.body.with_modes(12, places)
    assert body.receptance_error(places, Damping(mass_proportional=0.06), [52.0, 500.0]) < 1e-3


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rows": 3}, "PlaneBeam: rows = 3; must be even, so that nodes lie on the neutral axis"),
        ({"element": "CPS5"}, 'PlaneBeam: element = "CPS5"; must be one of CPS4, CPS4R, '),
        ({"thickness": -1.0}, "PlaneBeam: thickness = -1; must be > 0"),
        ({"state": "plain"}, 'Material: state = "plain"; must be one of plane-stress, plane-strain'),
        ({"poissons_ratio": 0.5}, "Material: poissons_ratio = 0.5; must be >= 0 and <= 0.499"),
    ],
)
def test_refused_at_birth(changed, message):
    with pytest.raises(ValueError, match="^" + message.replace(".", r"\.")):
        beam(**changed)


def test_nodes_lie_at_the_stations():
    cylinder = HalfCylinder(LENGTH, RADIUS)
    model = beam(length=LENGTH + RADIUS, cylinder=cylinder, columns=30, rows=2, stations=(0.555, 0.3)).model(modes=2)
    x = np.unique(model.mesh.p[0])
    assert {0.3, 0.555} <= set(x.round(12))
    assert np.diff(x[x <= LENGTH - RADIUS]).max() < 1.5 * LENGTH / 30
    with pytest.raises(ValueError, match=r"^PlaneBeam: station = 0\.604; must be > 0 and < 0\.601 m"):
        beam(length=LENGTH + RADIUS, cylinder=cylinder, stations=(0.604,)).model()


def test_half_cylinder_must_lie_under_the_beam():
    with pytest.raises(ValueError, match=r"reaches from 0\.601 to 0\.611 m; must lie under the beam, 0 to 0\.606 m"):
        beam(cylinder=HalfCylinder(LENGTH, RADIUS)).model()
    with pytest.raises(ValueError, match="has no half cylinder"):
        beam(columns=5).model().contacts(1)
    with pytest.raises(ValueError, match=r"spacing = 0\.001; must be < 0\.00025 m for 5 nodes"):
        HalfCylinder(LENGTH, RADIUS, spacing=1e-3)
