"""Bodies given by matrices: modes against closed forms, both reductions against all degrees of freedom."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from models import Beam
from models.bodies import FiniteBeam, MatrixBody, ModalModel, pencil
from models.bodies.pencil import added, factors
from models.parts import Damping

BEAM = Beam(0.606, 0.03888, 0.00478, 210e9, 7800.0, 6)
RATIO = Damping(modal_ratios=(0.01,))
HZ = (5.0, 30.0, 70.0, 120.0)


def chain(masses: int, *, free: bool = False, modes: int = 4, reduction: str = "modes") -> MatrixBody:
    """Unit masses on unit springs, fixed at one end or afloat."""
    n = masses + (0 if free else 1)
    K = sparse.diags_array([2.0 * np.ones(n), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1]).tolil()
    K[0, 0] = K[n - 1, n - 1] = 1.0
    names = tuple(f"{i}.x" for i in range(n))
    fixed = () if free else (names[0],)
    return MatrixBody(sparse.eye_array(n), K.tocsr(), names, modes=modes, fixed=fixed, reduction=reduction)


def test_frequencies_of_a_chain_are_those_of_the_closed_form() -> None:
    n, modes = 40, np.arange(1, 5)
    found = chain(n).ported(["40.x"], RATIO)
    assert found.omega_n == pytest.approx(2 * np.sin((2 * modes - 1) * np.pi / (2 * (2 * n + 1))), rel=1e-10)
    afloat = chain(n, free=True).ported(["0.x"], RATIO)
    assert afloat.omega_n[0] == 0.0
    assert afloat.omega_n[1:] == pytest.approx(2 * np.sin(modes[:3] * np.pi / (2 * n)), rel=1e-9)


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("reduction", ["modes", "craig-bampton"])
def test_reduced_receptances_are_those_of_all_degrees_of_freedom(free: bool, reduction: str) -> None:
    n = 40
    body = chain(n, free=free, modes=8, reduction=reduction)
    places = ["7.x", "20.x", "39.x"]
    damping = Damping(mass_proportional=0.01, high_mode_ratio=0.0)
    found = body.ported(places, damping)
    keep = [i for i, name in enumerate(body.dofs) if name not in body.fixed]
    at = [keep.index(body.dofs.index(place)) for place in places]
    K = body.stiffness.toarray()[np.ix_(keep, keep)]
    for omega in (0.02, 0.05, 0.1):
        dynamic = K - omega**2 * np.eye(len(keep)) + 0.01j * omega * np.eye(len(keep))
        full = np.linalg.inv(dynamic)[np.ix_(at, at)]
        assert np.linalg.norm(found.receptance(omega) - full) < 5e-3 * np.linalg.norm(full)
    assert body.receptance_error(places, damping, [0.02 / 6.28, 0.1 / 6.28]) < 5e-3


@pytest.mark.parametrize(("reduction", "most"), [("modes", 6), ("craig-bampton", 4)])
def test_there_are_no_more_modes_than_masses_that_are_free_of_places(reduction: str, most: int) -> None:
    places = ["2.x", "6.x"]
    more = chain(6, reduction=reduction).with_modes(20, places)
    assert more.modes == most
    assert more.ported(places, RATIO).n == 6


def test_at_rest_nothing_is_left_out() -> None:
    body = chain(40, modes=3)
    found = body.ported(["10.x", "40.x"], RATIO)
    static = found.rows @ np.diag(found.omega_n**-2.0) @ found.rows.T + found.flexibility
    assert static == pytest.approx(np.array([[10.0, 10.0], [10.0, 40.0]]), rel=1e-9)  # springs in series to the wall


def test_reactions_are_those_of_the_full_model() -> None:
    body = FiniteBeam(BEAM)
    places, damping = ["y(0.555)", "slope(0.606)"], Damping(mass_proportional=0.6, high_mode_ratio=0.0)
    found = body.with_modes(40, places).ported(places, damping, ["y(0.606)"])
    matrices = body.matrices([0.555])
    names, L = list(matrices.dofs), 0.606
    held = {"axial@0.0", "y@0.0", "slope@0.0", f"y@{L!r}"}
    keep = [i for i, name in enumerate(names) if name not in held]
    M, K = (m.toarray() for m in (matrices.mass, matrices.stiffness))
    tip, drive = names.index(f"y@{L!r}"), keep.index(names.index("y@0.555"))
    for hz in HZ:
        w = 2 * np.pi * hz
        dynamic = (K - w**2 * M + 0.6j * w * M)[:, keep]
        x = np.linalg.solve(dynamic[keep], np.eye(len(keep))[drive])
        # in the modes: the weak form, with the force at the drive
        q = found.rows[0] / (found.omega_n**2 - w**2 + 1j * w * found.damping.diagonal())
        reaction = (-(w**2) * found.reaction_inertia + 1j * w * found.reaction_damping) @ q - found.reaction_share[:, 0]
        assert reaction[0] == pytest.approx(dynamic[tip] @ x, rel=2e-3)


def test_the_beam_is_the_one_of_the_closed_form() -> None:
    found = FiniteBeam(BEAM).ported(["y(0.555)", "slope(0.606)", "axial(0.606)"], RATIO)
    assert found.omega_n == pytest.approx(BEAM.natural_frequencies(), rel=2e-5)
    assert np.abs(found.rows[0]) == pytest.approx(np.abs(BEAM.shapes(np.array([0.555]))[0]), rel=1e-3)
    EI, EA, L = BEAM.bending_stiffness, BEAM.youngs_modulus * BEAM.area, BEAM.length
    carried = np.sum((found.rows[1] / found.omega_n) ** 2)
    assert carried + found.flexibility[1, 1] == pytest.approx(L / (4 * EI), rel=1e-8)
    assert found.flexibility[2, 2] == pytest.approx(L / EA, rel=1e-8)


def test_a_damping_matrix_and_ratios_that_agree_are_the_same() -> None:
    body = chain(30, modes=5)
    with_matrix = MatrixBody(
        body.mass, body.stiffness, body.dofs, modes=5, fixed=body.fixed, damping_matrix=0.02 * body.mass
    )
    one = body.ported(["9.x"], Damping(mass_proportional=0.02, high_mode_ratio=0.0))
    other = with_matrix.ported(["9.x"], Damping())
    assert other.damping == pytest.approx(one.damping, abs=1e-12)


@pytest.mark.parametrize("entries", [np.zeros((3, 3)), np.diag([0.0, 2.0, 0.0]), np.ones((3, 3)) - 1e-9 * np.eye(3)])
def test_damping_of_some_motions_alone_is_damping(entries: np.ndarray) -> None:
    body = MatrixBody(np.eye(3), np.diag([1.0, 2.0, 3.0]), ("a", "b", "c"), modes=3, damping_matrix=entries)
    assert body.ported(["a"], Damping()).damping == pytest.approx(entries)


def test_twenty_thousand_degrees_of_freedom_are_reduced() -> None:
    """A plate of springs: its lowest mode that of the closed form."""
    n = 141
    one = sparse.diags_array([2.0 * np.ones(n), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1])
    eye = sparse.eye_array(n)
    K = sparse.kron(one, eye) + sparse.kron(eye, one)
    body = MatrixBody(sparse.eye_array(n * n), K.tocsc(), tuple(f"{i}.z" for i in range(n * n)), modes=10)
    found = body.ported(["70.z", "9940.z"], RATIO)
    assert found.omega_n[0] == pytest.approx(np.sqrt(8) * np.sin(np.pi / (2 * (n + 1))), rel=1e-8)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"stiffness": np.ones((3, 2))}, "stiffness is 3 x 2; must be square"),
        ({"stiffness": np.eye(4)}, "stiffness is 4 x 4; must be 3 x 3"),
        ({"stiffness": np.array([[2.0, 1, 0], [0, 2, 0], [0, 0, 2]])}, "must be symmetric"),
        ({"stiffness": np.diag([1.0, np.nan, 1.0])}, "must be finite"),
        ({"dofs": ("a", "b")}, "dofs has 2 names; must have 3"),
        ({"dofs": ("a", "b", "b")}, 'dofs has "b" twice'),
        ({"fixed": ("d",)}, 'fixed has "d"; must be of dofs'),
        ({"modes": 0}, "modes"),
        ({"mass": np.array([[1.0, 2, 0], [2, 1, 0], [0, 0, 1]])}, "mass is indefinite"),
        ({"mass": np.array([[1.0, 1 + 1e-7, 0], [1 + 1e-7, 1, 0], [0, 0, 1]])}, "mass is indefinite"),
        ({"mass": np.zeros((3, 3))}, "mass is zero; must be > 0 somewhere"),
        (
            {"damping_matrix": np.diag([1.0, -2.0, 1.0])},
            "damping_matrix is -2 on its diagonal at b; must be > 0, or nothing in that row",
        ),
        (
            {"damping_matrix": np.array([[1.0, 2, 0], [2, 1, 0], [0, 0, 1]])},
            "damping_matrix is indefinite, with its diagonal scaled to 1 an eigenvalue is -1; must be >= 0",
        ),
        ({"reduction": "guyan"}, 'reduction = "guyan"'),
    ],
)
def test_what_is_no_body_is_refused(change: dict, said: str) -> None:
    given = {"mass": np.eye(3), "stiffness": np.diag([1.0, 2.0, 3.0]), "dofs": ("a", "b", "c"), "modes": 2}
    with pytest.raises(ValueError, match=said):
        MatrixBody(**(given | change))


def test_places_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match=r'place "99\.x"'):
        chain(5).ported(["99.x"], RATIO)
    with pytest.raises(ValueError, match="is fixed"):
        chain(5).ported(["0.x"], RATIO)
    with pytest.raises(ValueError, match=r'no place "y\(0.7\)" on the beam'):
        FiniteBeam(BEAM).ported(["y(0.7)"], RATIO)
    with pytest.raises(ValueError, match="must be the same or further apart"):
        FiniteBeam(BEAM).ported(["y(0.3)", "y(0.30001)"], RATIO)
    with pytest.raises(ValueError, match='no port "b"; there are a'):
        ModalModel((1.0,), {"a": (1.0,)}).ported(["b"], RATIO)


def test_modes_given_up_are_kept_at_rest() -> None:
    whole = ModalModel((1.0, 2.0, 5.0), {"a": (1.0, 0.5, 0.2), "b": (0.3, -1.0, 0.4)})
    few = whole.with_modes(2, ["a", "b"]).ported(["a", "b"], RATIO)
    every = whole.ported(["a", "b"], RATIO)
    assert few.receptance(0.0) == pytest.approx(every.receptance(0.0), rel=1e-12)


@pytest.mark.parametrize("reduction", ["modes", "craig-bampton"])
@pytest.mark.parametrize("beta", [0.0, 3.0])
def test_the_error_of_a_reduction_is_that_against_a_model_damped_in_all_its_modes(reduction: str, beta: float) -> None:
    """Beside alpha M + beta K of all degrees of freedom, inverted; what is cut is damped where beta is not 0."""
    n, alpha, omega = 40, 0.002, 0.12
    body = chain(n, modes=5, reduction=reduction)
    places, damping = ["7.x", "20.x"], Damping(alpha, stiffness_proportional=beta, high_mode_ratio=0.0)
    K = body.stiffness.toarray()[1:, 1:]
    full = np.linalg.inv(K - omega**2 * np.eye(n) + 1j * omega * (alpha * np.eye(n) + beta * K))[
        np.ix_([6, 19], [6, 19])
    ]
    off = np.linalg.norm(body.ported(places, damping).receptance(omega) - full) / np.linalg.norm(full)
    assert body.receptance_error(places, damping, [omega / (2 * np.pi)]) == pytest.approx(off, rel=1e-6)
    assert off > 1e-4 or beta == 0.0


def fine(stiffness: sparse.csc_array | None = None, fixed: tuple[str, ...] = ()) -> MatrixBody:
    """A chain of six light masses on stiff springs, with numbers that need all digits."""
    body = chain(6)
    K = 1e6 / 3.0 * body.stiffness if stiffness is None else stiffness
    return MatrixBody(0.01 / 3.0 * body.mass, K, body.dofs, modes=2, fixed=fixed)


def test_mass_and_stiffness_that_are_each_other_are_doubted() -> None:
    body = fine(fixed=("0.x",))
    right, wrong = (
        [d.doubt for d in b.proportions] for b in (body, replace(body, mass=body.stiffness, stiffness=body.mass))
    )
    assert right == [None]
    assert "are the two exchanged?" in wrong[0]
    assert [d.doubt for d in chain(40).proportions] == [None]  # of unit masses on unit springs


def test_single_precision_is_named_where_it_may_have_made_a_stiffness_indefinite() -> None:
    K = fine().stiffness.toarray()
    K[0, 0] *= 1.0 - 1e-6
    said = "stiffness is indefinite.*must have no negative eigenvalue"
    with pytest.raises(ValueError, match=f"{said}; its entries are rounded to single precision.*in double$"):
        fine(stiffness=sparse.csc_array(K.astype(np.float32))).ported(["3.x"], RATIO)
    with pytest.raises(ValueError, match=f"{said}$"):
        fine(stiffness=sparse.csc_array(K)).ported(["3.x"], RATIO)
    K[0, 0] *= 0.9  # more than rounding does
    with pytest.raises(ValueError, match=f"{said}$"):
        fine(stiffness=sparse.csc_array(K.astype(np.float32))).ported(["3.x"], RATIO)
    with pytest.raises(ValueError, match=f"{said}$"):  # few digits are no rounding
        fine(stiffness=sparse.csc_array(np.diag([-1.0, *[2.0] * 6]))).ported(["3.x"], RATIO)


def test_what_a_boundary_condition_holds_is_fixed_or_said() -> None:
    """Abaqus writes 1e36 there."""
    K = fine().stiffness.toarray()
    K[0, 0] = 1e36
    held = sparse.csc_array(K)
    found = fine(stiffness=held, fixed=("0.x",)).ported(["3.x"], RATIO)
    assert found.omega_n == pytest.approx(fine(fixed=("0.x",)).ported(["3.x"], RATIO).omega_n, rel=1e-12)
    said = "stiffness is 1e\\+36 on its diagonal at 0.x, as Abaqus .*; must be in fixed, or generated without boundary"
    with pytest.raises(ValueError, match=said):
        fine(stiffness=held)
    K[0, 1] = K[1, 0] = 1e36
    with pytest.raises(ValueError, match="the largest entry of stiffness = 1e\\+36; must be of magnitude"):
        fine(stiffness=sparse.csc_array(K), fixed=("0.x",))


@pytest.mark.parametrize("n", [9, 20, 36])
def test_what_no_spring_holds_but_inertia_couples_moves_as_a_rigid_one(n: int) -> None:
    """Its frequency is 0, not what rounding makes of its shape: of 1e-16 Hz no structure is."""
    K = 1e9 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    K[n // 3] = K[:, n // 3] = 0.0
    mass = (4 * np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1)) / 6
    found = MatrixBody(mass, K, tuple(f"{i}.x" for i in range(n)), modes=3).ported(["0.x"], RATIO)
    assert found.omega_n[0] == 0.0
    assert found.omega_n[1] > 1e3


def test_matrices_as_complex_numbers_are_real_where_they_have_no_imaginary_part() -> None:
    body = chain(3, modes=3)
    same = replace(body, stiffness=body.stiffness.astype(complex), mass=body.mass.toarray().astype(complex))
    assert same.ported(["1.x"], RATIO).omega_n == pytest.approx(body.ported(["1.x"], RATIO).omega_n)
    with pytest.raises(ValueError, match="stiffness is complex; must be real"):
        replace(body, stiffness=(1 + 0.02j) * body.stiffness)


def test_of_half_a_matrix_it_is_said_how_to_complete_it() -> None:
    body = chain(3, modes=3)
    half = sparse.tril(body.stiffness)
    with pytest.raises(
        ValueError, match=r"must be symmetric; of one half A .*, A \+ A.T - diags_array\(A.diagonal\(\)\)"
    ):
        replace(body, stiffness=half)
    whole = half + half.T - sparse.diags_array(half.diagonal())
    assert abs(replace(body, stiffness=whole).stiffness - body.stiffness).max() == 0.0
    askew = body.stiffness.tolil()
    askew[0, 1] *= 2.0
    with pytest.raises(ValueError, match=r"must be symmetric$"):
        replace(body, stiffness=askew)


def test_a_sum_keeps_the_zeros_that_are_stored() -> None:
    """Degrees of freedom of a node that stay coupled are ordered together: factors of bricks have half the entries."""
    at, other = ([0, 0, 1, 2], [0, 1, 1, 2]), ([0, 1, 2, 2], [0, 0, 1, 2])
    one = sparse.csc_array(([1.0, 0.0, 2.0, 3.0], at), shape=(3, 3))
    two = sparse.csc_array(([4.0, 0.0, -5.0, -3.0], other), shape=(3, 3))
    found = added(one, two)
    assert found.nnz == 6
    assert np.array_equal(found.toarray(), one.toarray() + two.toarray())


@pytest.mark.parametrize("library", [True, False], ids=["dissected", "by-degree"])
@pytest.mark.parametrize("pivoting", [0.0, 0.1])
def test_factors_in_any_order_solve_and_tell_the_signs(
    pivoting: float, library: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pencil, "FEW", 0)
    if library:
        pytest.importorskip("pymetis", reason="needs pip install 'casadi-hbm[solids]'")
    else:
        monkeypatch.setitem(sys.modules, "pymetis", None)
    n = 12
    one = sparse.diags_array([2.0 * np.ones(n), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1])
    eye = sparse.eye_array(n)
    plate = (sparse.kron(one, eye) + sparse.kron(eye, one)).tocsc()
    load = np.random.default_rng(4).standard_normal((n * n, 2))
    found = factors(plate, pivoting)
    assert sorted(found.order) == list(range(n * n))
    assert (list(found.order) == sorted(found.order)) is not library
    assert plate @ found.solve(load) == pytest.approx(load, abs=1e-12)
    assert plate @ found.solve(load[:, 0]) == pytest.approx(load[:, 0], abs=1e-12)
    lowest = 8.0 * np.sin(np.pi / (2 * (n + 1))) ** 2
    assert not factors(plate - 0.99 * lowest * sparse.eye_array(n * n), 0.0).negative
    assert factors(plate - 1.01 * lowest * sparse.eye_array(n * n), 0.0).negative
