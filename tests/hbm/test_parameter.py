"""Continuation along any number of a rig: against steady states, secants of the residual, and closed forms."""

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import pytest
from rich.console import Console
from rigs import beam, oscillator

from continuation import Kind, refine
from hbm.balance.solution import PeriodicSolution
from hbm.commands.parametertables import print_parameter_curve
from hbm.fourier import FourierBasis
from hbm.integration.handover import state_at_phase_zero
from hbm.integration.integrate import steady_state as shoot
from hbm.response import bifurcations
from hbm.response.accuracy import frequency_response
from hbm.response.bifurcations import stability_of, with_stability
from hbm.response.start import first_solution
from hbm.response.trace import force_response, steady_state, trace_frequency
from hbm.tracking.parameter import ParameterBalance, parameter_key
from hbm.tracking.parameterresponse import parameter_response
from models import ContactSample, Rig
from models.attachments import Attachments, PointMass, Resonator
from models.bodies.modal import ModalModel
from models.friction import parameter
from models.jointed import JointedRig
from models.joints import CubicSpring, Joint
from models.parts import Damping, Excitation
from models.published import PAPER_DAHL, paper_rig


@dataclass(frozen=True, eq=False)
class Cubic:
    """T = -gamma u^3 with what a continuation wants to know of gamma."""

    name: ClassVar[str] = "cubic"
    states: ClassVar[int] = 0
    set_valued: ClassVar[bool] = False

    gamma: Any = field(metadata=parameter("N/m3", "cubic stiffness", "Duffing"))

    def advance(self, z: Any, before: ContactSample, now: ContactSample) -> tuple[Any, Any]:
        """Return no state and the restoring force."""
        return z, -self.gamma * now.u**3


ATTACHED = replace(
    beam(),
    attachments=Attachments(
        clamp_stiffness=5e3,
        clamp_limit=0.3,
        support_stiffness=1e7,
        masses=(PointMass(0.05, 0.3),),
        resonators=(Resonator(0.02, 60.0, 0.4),),
    ),
)
KEYS = [
    (beam(), "contact.friction.mu"),
    (beam(PAPER_DAHL), "contact.friction.stiffness"),
    (beam(), "contact.normal_load"),
    (beam(), "excitation.amplitude"),
    (beam(), "frequency_hz"),
    (beam(), "damping.mass_proportional"),
    (beam(), "beam.length"),
    (ATTACHED, "beam.density"),
    (ATTACHED, "attachments.resonators[0].frequency_hz"),
    (ATTACHED, "attachments.masses[0].position"),
    (ATTACHED, "attachments.clamp_limit"),
]


@pytest.mark.parametrize(("rig", "key"), KEYS, ids=[key for _, key in KEYS])
def test_newton_step_is_that_of_the_whole_residual(rig: Rig, key: str) -> None:
    """Along any direction of unknowns and number together, away from a solution: a secant, 1e-6 wide, is its truth."""
    begin = 50.0 if key == "frequency_hz" else rig.number(key)
    known = parameter_key(rig, key, 50.0, 6.5)
    problem = ParameterBalance(rig, known, (begin, 1.1 * begin), FourierBasis(5, 64), hz=50.0, level=6.5)
    x = first_solution(problem.first, problem.first.lam_at(50.0))
    rng = np.random.default_rng(0)
    x, lam = x * (1.0 + 1e-3 * rng.standard_normal(x.size)), 0.03
    row, rhs = rng.standard_normal((2, x.size))
    here = problem.linearize(x, lam)
    dx, dlam = here.solve_bordered(row, 0.3, rhs, 0.7)
    assert row @ dx + 0.3 * dlam == pytest.approx(0.7, abs=1e-9)
    h = 1e-6 / max(np.abs(dx).max(), abs(dlam))
    secant = (problem.residual(x + h * dx, lam + h * dlam) - problem.residual(x - h * dx, lam - h * dlam)) / (2 * h)
    # the elimination of a bare beam leaves weak foreshortening out of the matrix, which costs it a few per mille
    allowed = 1e-6 if rig is ATTACHED else 2e-2
    np.testing.assert_allclose(secant, rhs, atol=allowed * np.abs(rhs).max())


@pytest.mark.parametrize(
    ("rig", "key"),
    [(beam(), "contact.friction.critical_slip"), (beam(PAPER_DAHL), "contact.radius"), (ATTACHED, "beam.thickness")],
)
def test_derivative_to_the_number_is_exact(rig: Rig, key: str) -> None:
    begin = rig.number(key)
    problem = ParameterBalance(
        rig, parameter_key(rig, key, 50.0, 6.5), (begin, 1.1 * begin), FourierBasis(5, 64), hz=50.0, level=6.5
    )
    x = 1.01 * first_solution(problem.first, problem.first.lam_at(50.0))
    J_lam = problem.linearize(x, 0.02).J_lam
    secant = (problem.residual(x, 0.02 + 1e-5) - problem.residual(x, 0.02 - 1e-5)) / 2e-5
    np.testing.assert_allclose(J_lam, secant, atol=1e-6 * np.abs(secant).max())


@pytest.mark.parametrize(
    ("rig", "key", "values"),
    [
        (beam(), "contact.friction.mu", (0.45, 0.6)),
        (beam(), "beam.length", (0.60, 0.61)),
        (beam(), "excitation.amplitude", (4.0, 7.0)),
        (beam(), "frequency_hz", (50.0, 51.0)),
    ],
)
def test_points_are_steady_states_of_their_rig(rig: Rig, key: str, values: tuple[float, float]) -> None:
    hz = None if key == "frequency_hz" else 51.0
    curve = parameter_response(rig, key, values, hz=hz, harmonics=5)
    assert curve.complete
    assert curve.values[[0, -1]].tolist() == list(values)
    for i in (0, len(curve.points) // 2, -1):
        value, point = float(curve.values[i]), curve.points[i]
        there = rig if hz is None else rig.with_number(key, value)
        alone = steady_state(there, hz or value, harmonics=5, start=point)
        assert point.hz == alone.hz and point.level == pytest.approx(alone.level)
        for name, channel in alone.channels.items():
            np.testing.assert_allclose(point[name].samples, channel.samples, atol=1e-7 * max(channel.peak, 1e-12))


def test_signs_of_modes_follow_where_a_resonator_is_tuned_through_the_beam() -> None:
    """Modes 1 and 2 change places there; the largest entry of a mode, which gives a rig's modes their signs, jumps."""
    rig = replace(beam(), attachments=Attachments(resonators=(Resonator(0.05, 60.0, 0.58),)))
    known = parameter_key(rig, "attachments.resonators[0].frequency_hz", 44.0, 1.0)
    problem = ParameterBalance(rig, known, (40.0, 70.0), FourierBasis(1, 32), hz=44.0, level=1.0)
    before = signed = problem.first.rig.reduction.kept
    flips = 0
    for lam in np.linspace(0.0, 1.0, 101):
        there = problem.at(float(lam))
        kept, signs = there.rig.reduction.kept, problem.signs(there, float(lam))[: there.structure.n]
        flips += int(np.any(np.einsum("dn,dn->n", before, kept) < 0.0))
        assert np.all(np.einsum("dn,dn->n", signed, kept * signs) > 0.0)
        before, signed = kept, kept * signs
    assert flips > 0


def marched(point: PeriodicSolution, rig: Rig) -> complex:
    """Largest multiplier by time integration."""
    return complex(shoot(rig, point.hz, start=state_at_phase_zero(point), steps_per_period=2048).multipliers[0])


def test_the_period_doubles_before_the_jump_as_it_does_in_time() -> None:
    curve = with_stability(parameter_response(paper_rig(), "frequency_hz", (48.65, 48.663), harmonics=19))
    assert curve.stability is not None
    for i in (0, -1):
        point, known = curve.points[i], curve.stability[i]
        assert known.multipliers[0] == pytest.approx(stability_of(paper_rig(), point).multipliers[0], rel=1e-9)
        assert known.stable == (abs(marched(point, paper_rig())) < 1.0)
    assert curve.stability[-1].multipliers[0] == pytest.approx(marched(curve.points[-1], paper_rig()), abs=3e-3)
    (found,) = curve.bifurcations
    assert found.kind is Kind.PERIOD_DOUBLING
    assert curve.value_at(found.special.lam) == pytest.approx(48.6607, abs=2e-3)


def test_a_stretch_that_more_samples_judge_otherwise_is_in_doubt(monkeypatch: pytest.MonkeyPatch) -> None:
    found = parameter_response(paper_rig(), "contact.friction.mu", (0.5238, 0.5233), hz=48.7, harmonics=17)
    finely = with_stability(found)
    assert finely.stable is not None
    assert finely.stable.all()
    monkeypatch.setattr(bifurcations, "SAMPLES", 0)  # judged on the samples of the curve alone
    curve = with_stability(found)
    assert curve.stable is not None
    assert curve.doubtful is not None
    assert curve.doubtful.any()
    assert not curve.stable[curve.doubtful].any()
    i = int(np.argmax(curve.doubtful))
    assert abs(marched(curve.points[i], paper_rig().with_number("contact.friction.mu", float(curve.values[i])))) < 1.0
    assert not curve.bifurcations


def test_folds_along_a_parameter_of_the_law_are_those_of_the_closed_form() -> None:
    """Duffing, one term: gamma(A) = (F cos phi / A - 1 + W^2) 4/3 / A^2 turns where the closed form does."""
    d, F, W = 0.1, 0.3, 1.5
    rig = oscillator(Cubic(30.0), damping=d, amplitude=F)
    curve = parameter_response(rig, "contact.friction.gamma", (30.0, 0.05), hz=W / (2 * np.pi), harmonics=1)
    A = np.linspace(0.05, 2.0, 400001)[None]  # on the resonant side cos phi = +-sqrt(1 - (d W A / F)^2)
    cosine = np.sqrt(np.maximum(1.0 - (d * W * A / F) ** 2, 0.0)) * np.array([[1.0], [-1.0]])
    gamma = (F * cosine / A - 1.0 + W**2) * 4.0 / (3.0 * A**2)
    inside = (d * W * A[0] < F)[1:-1]
    turns = [
        float(branch[1:-1][inside][i])
        for branch in gamma
        for i in np.flatnonzero(((branch[1:-1] - branch[:-2]) * (branch[2:] - branch[1:-1]) < 0.0)[inside])
    ]
    found = [gamma for gamma in turns if 0.05 < gamma < 30.0]
    folds = [curve.along.value_at(fold.lam) for fold in refine(curve.along, curve.branch)]
    assert len(found) == len(folds) == 2
    np.testing.assert_allclose(sorted(folds), sorted(found), rtol=1e-6)
    where = {str(b).partition(",")[0] for b in with_stability(curve).bifurcations}
    assert where == {f"fold at contact.friction.gamma = {gamma:.6g} N/m3" for gamma in found}


@pytest.mark.parametrize(
    ("key", "values", "options", "refusal"),
    [
        ("contact.friction.muu", (0.3, 0.6), {"hz": 50.0}, "did you mean contact.friction.mu?"),
        ("contact.mu", (0.3, 0.6), {"hz": 50.0}, "did you mean contact.friction.mu?"),
        ("contact.friction.mu", (-0.3, 0.6), {"hz": 50.0}, "contact.friction.mu = -0.3; must be > 0"),
        ("contact.friction.mu", (0.3, 0.3), {"hz": 50.0}, "contact.friction.mu from 0.3 to 0.3; must differ"),
        (
            "contact.friction.mu",
            (0.3, 0.6),
            {},
            "contact.friction.mu: no frequency; must be given unless",
        ),
        ("frequency_hz", (50.0, 51.0), {"hz": 50.0}, "frequency = 50 Hz and parameter frequency_hz"),
        ("beam.length", (0.5, 0.6), {"hz": 50.0}, "beam.length = 0.5; must be >= 0.58"),
    ],
)
def test_what_cannot_be_followed_is_refused(
    key: str, values: tuple[float, float], options: dict[str, Any], refusal: str
) -> None:
    with pytest.raises(ValueError, match=key) as refused:
        parameter_response(paper_rig(), key, values, **options)
    assert refusal in str(refused.value)


def duffing(force: float) -> JointedRig:
    """A hardening oscillator that jumps between 10 and 20 Hz."""
    spring = Joint("spring", CubicSpring(1e9), ("a",))
    body, damping = ModalModel((10.0,), {"a": (1.0,)}), Damping(modal_ratios=(0.01,))
    return JointedRig("duffing", body, damping, (spring,), Excitation(force, at="a"))


def test_along_the_force_points_and_folds_are_those_of_a_force_response() -> None:
    """With a step of its own the curve along the force had over ten times as many points."""
    force, rig = (0.05, 8.0), duffing(1.0)
    plain = force_response(rig, 15.0, force, harmonics=3)
    curve = parameter_response(rig, "excitation.amplitude", force, hz=15.0, harmonics=3)
    assert len(plain.folds) == 2 and curve.folds == pytest.approx(plain.folds, rel=1e-5)
    assert len(curve.points) < 1.5 * len(plain.points)
    assert (plain.past_start, curve.past_start) == ("", "")


def test_the_peak_along_a_number_is_found() -> None:
    """That over the frequency, in whatever steps the curve goes."""
    curve = parameter_response(duffing(0.01), "frequency_hz", (9.0, 11.0), harmonics=3)
    assert curve.peak["drive"].peak == pytest.approx(
        trace_frequency(duffing(0.01), (9.9, 10.1)).peak["drive"].peak, rel=1e-5
    )


def test_a_curve_says_where_it_folds_back_past_its_start() -> None:
    rig = duffing(1.0)
    _, low = force_response(rig, 15.0, (0.05, 8.0), harmonics=3).folds
    curve = parameter_response(rig, "excitation.amplitude", (1.2 * low, 8.0), hz=15.0, harmonics=3)
    assert curve.complete and curve.values.min() == pytest.approx(low, rel=1e-3)
    said = f"the curve folds back past its start at {1.2 * low:.6g} N, to {curve.values.min():.6g} N"
    assert curve.past_start == said and repr(curve).endswith(said)
    console = Console(record=True, width=200)
    print_parameter_curve(console, curve)
    assert f"warning: {said}" in console.export_text()
    sweep = frequency_response(rig, (20.0, 8.0), harmonics=3)
    assert sweep.past_start == f"the curve folds back past its start at 20 Hz, to {sweep.hz.max():.6g} Hz"
    assert sweep.past_start in sweep.assessment.warnings
