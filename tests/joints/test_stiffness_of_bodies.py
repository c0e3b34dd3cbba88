"""The stiffness of a whole body as a number: a Young's modulus, or the factor of a stiffness matrix."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hbm.errors import InputError
from hbm.outputerror.nominal import tolerances
from hbm.response.trace import steady_state
from hbm.sensitivity.jointed import joint_sensitivities
from models.beam import Beam
from models.bodies.finite import FiniteBeam
from models.bodies.matrix import MatrixBody, Method
from models.bodies.ported import Body, PortedModes
from models.jointed import JointedRig
from models.parts import Damping
from tests.joints.rigs import loaded

BEAM = FiniteBeam(Beam(0.6, 0.04, 0.005, 210e9, 7800.0, 4))
PLACES = ("y(0.25)", "slope(0.6)", "y(0.5)")
DAMPINGS = (Damping(0.3), Damping(modal_ratios=(0.02,), stiffness_proportional=1e-5))
FIELDS = ("omega_n", "damping", "rows", "flexibility", "reaction_inertia", "reaction_damping", "reaction_share")
FILE = """
name = "two sliders"
beam = { length = 0.606, width = 0.03888, thickness = 0.00478, youngs_modulus = 210e9, density = 7800.0, modes = 6 }
damping = { modal_ratios = [0.01] }
excitation = { amplitude = 20.0, position = 0.555 }
channels = [{ name = "a1", quantity = "acceleration", position = 0.3 }]
[[joints]]
name = "bolt"
law = "coulomb-penalty"
mu = 0.1
critical_slip = 1e-4
normal_load = 40.0
at = "y(0.25)"
"""


def matrix_body(reduction: Method = "modes", *, dashpots: bool = False) -> MatrixBody:
    """A chain of masses on ground, with names."""
    n = 9
    K = np.diag(np.full(n, 2.0)) - np.diag(np.ones(n - 1), 1) - np.diag(np.ones(n - 1), -1)
    M = np.diag(np.linspace(1.0, 2.0, n))
    C = 0.01 * K + 0.02 * M if dashpots else None
    names = tuple(f"{i}.x" for i in range(n))
    return MatrixBody(M, 100.0 * K, names, modes=4, damping_matrix=C, fixed=("0.x",), reduction=reduction)


BODIES: list[tuple[Body, tuple[str, ...], tuple[str, ...]]] = [
    (BEAM, PLACES, ("y(0.6)",)),
    (matrix_body(), ("3.x", "8.x"), ("0.x",)),
    (matrix_body("craig-bampton"), ("3.x", "8.x"), ("0.x",)),
    (matrix_body(dashpots=True), ("3.x", "8.x"), ("0.x",)),
]


def signed(modes: PortedModes, like: PortedModes) -> PortedModes:
    """The same modes with the signs of others: each may be turned round."""
    sign = np.sign(np.sum(modes.rows * like.rows, axis=0))
    turned = {"rows": modes.rows * sign, "damping": modes.damping * np.outer(sign, sign)}
    of_supports = {name: getattr(modes, name) * sign for name in ("reaction_inertia", "reaction_damping")}
    return replace(modes, **turned, **of_supports)


@pytest.mark.parametrize("damping", DAMPINGS, ids=["alpha", "ratios"])
@pytest.mark.parametrize(("body", "places", "supports"), BODIES, ids=["beam", "modes", "craig-bampton", "dashpots"])
def test_derivatives_are_those_of_bodies_nearby(
    body: Body, places: tuple[str, ...], supports: tuple[str, ...], damping: Damping
) -> None:
    ((key, (value, _)),) = body.numbers.items()
    here, step = body.ported(places, damping, supports), 1e-4 * value
    change = body.change(key, here, damping)
    up, down = (body.with_numbers({key: value + h}).ported(places, damping, supports) for h in (step, -step))
    for name in FIELDS:
        difference = (getattr(up, name) - getattr(down, name)) / (2 * step)
        size = np.abs(getattr(here, name)).max() / value
        assert getattr(change, name) == pytest.approx(difference, rel=1e-6, abs=1e-7 * size + 1e-300), name


@pytest.mark.parametrize("reduction", ["modes", "craig-bampton"])
def test_a_factor_is_that_of_the_matrix(reduction: Method) -> None:
    body, places = matrix_body(reduction), ("3.x", "8.x")
    stiffer = replace(body, stiffness=1.3 * body.stiffness).ported(places, DAMPINGS[1], ("0.x",))
    for other in (body.with_numbers({"matrix.stiffness_factor": 1.3}), replace(body, stiffness_factor=1.3)):
        found = signed(other.ported(places, DAMPINGS[1], ("0.x",)), stiffer)
        for name in FIELDS:
            expected = getattr(stiffer, name)
            assert getattr(found, name) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max()), name
        assert other.receptance_error(places, DAMPINGS[1], [0.5]) == pytest.approx(
            replace(body, stiffness=1.3 * body.stiffness).receptance_error(places, DAMPINGS[1], [0.5]), rel=1e-6
        )


def test_a_modulus_is_that_of_the_elements() -> None:
    """Beside matrices assembled with it."""
    stiffer = replace(BEAM, beam=replace(BEAM.beam, youngs_modulus=180e9))
    names = ("y@0.25", "slope@0.6", "y@0.5")
    assembled = stiffer.matrices((0.25, 0.5)).ported(names, DAMPINGS[0], ("y@0.6",))
    found = signed(stiffer.ported(PLACES, DAMPINGS[0], ("y(0.6)",)), assembled)
    for name in FIELDS:
        expected = getattr(assembled, name)
        assert getattr(found, name) == pytest.approx(expected, rel=1e-7, abs=1e-8 * np.abs(expected).max()), name


@pytest.fixture
def rig(tmp_path: Path) -> JointedRig:
    return loaded(tmp_path, FILE)


@pytest.mark.parametrize("text", [FILE, FILE.replace("modes = 6", "modes = 2").replace("1e-4", "1e-6")], ids=["6", "2"])
def test_responses_follow_the_modulus(tmp_path: Path, text: str) -> None:
    """Two modes leave much to residual flexibility, which acts within the law too."""
    rig, key = loaded(tmp_path, text), "beam.youngs_modulus"
    assert rig.number(key) == 210e9 and tolerances(rig)[key] == 0.01
    here, step = steady_state(rig, 55.0, harmonics=7, samples=256), 1e-5 * 210e9
    found = joint_sensitivities(rig, here, [key])
    up, down = (
        steady_state(rig.with_number(key, 210e9 + h), 55.0, harmonics=7, samples=256, start=here) for h in (step, -step)
    )
    for name in ("a1", "bolt.force", "bolt.motion"):
        difference = (up[name].coefficients - down[name].coefficients) / (2 * step)
        near = pytest.approx(difference, rel=1e-4, abs=1e-5 * np.abs(difference).max())
        assert found[name].coefficients[:, 0] == near, name
        peak = (up[name].peak - down[name].peak) / (2 * step)
        assert found[name].peak[0] == pytest.approx(peak, rel=1e-3, abs=1e-7 * here[name].peak / 210e9), name


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_a_stiffness_that_is_none_is_refused(value: float, rig: JointedRig) -> None:
    for body in (matrix_body(), BEAM):
        (key,) = body.numbers
        with pytest.raises(ValueError, match=r"(stiffness_factor|youngs_modulus)"):
            body.with_numbers({key: value})
    with pytest.raises((ValueError, InputError), match="youngs_modulus"):
        rig.with_numbers({"beam.youngs_modulus": value})
