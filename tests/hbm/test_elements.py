"""Nonlinear elements along the beam, and force distortion: closed forms, time integrators, another simulator."""

from dataclasses import replace

import numpy as np
import pytest
from rigs import beam, oscillator
from scipy.integrate import solve_ivp

import tests.truth as truth
from continuation import DenseLinearization
from hbm.balance.jacobian import CompleteBalance
from hbm.balance.problem import HarmonicBalance, State
from hbm.balance.solution import PeriodicSolution
from hbm.errors import InputError
from hbm.fourier import FourierBasis
from hbm.integration import integrate
from hbm.integration.handover import state_at_phase_zero
from hbm.integration.timestep import Stepper
from hbm.response.trace import steady_state, trace_frequency
from hbm.sensitivity.derivatives import sensitivities
from hbm.symbolic import residual_function
from models import Attachments, Channel, Dahl, Damping, Element, Frictionless, Jenkins, PointMass, Rig, Viscous
from models.elements import ELEMENTS, ImpactStop, MidplaneStretching, QuadraticDrag
from models.published import PAPER_BEAM, PAPER_PENALTY
from tests.truth.measure import coefficients

DRIVE, STOP = 0.555, 0.4
ALL = (MidplaneStretching(3e8), QuadraticDrag(100.0), ImpactStop(5e-5, 2e4, STOP))


def one_mode(*elements: Element, alpha: float = 6.0, force: float = 1.0) -> Rig:
    """The beam sliding freely, in its first mode alone."""
    rig = beam(Frictionless(), alpha=alpha, modes=1, residual_compliance=False, foreshortening=False)
    return replace(rig, elements=elements, excitation=replace(rig.excitation, amplitude=force))


def with_elements(law=PAPER_PENALTY, elements=ALL, modes: int = 4, **fields) -> Rig:
    return replace(beam(law, alpha=6.0, modes=modes), elements=elements, **fields)


SPAN = np.linspace(0.0, PAPER_BEAM.length, 20001)


def first_shape(order: int = 0) -> np.ndarray:
    return replace(PAPER_BEAM, modes=1).shapes(SPAN, order)[:, 0]


# ---- closed forms


def duffing_cubic(stiffness: float) -> float:
    """Coefficient of q^3 in the equation of the first mode: k/2 times the square of Int phi'^2."""
    return stiffness / 2 * float(np.trapezoid(first_shape(1) ** 2, SPAN)) ** 2


def duffing_force(rig: Rig, cubic: float, Omega: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Force amplitude of the one-term harmonic balance of q'' + alpha q' + w^2 q + cubic q^3 = phi F cos."""
    s = rig.structure
    dynamic = s.omega_n[0] ** 2 - Omega**2 + 0.75 * cubic * a**2
    return a * np.hypot(dynamic, s.damping[0] * Omega) / abs(s.excitation[0])


def test_one_term_of_the_stretched_beam_is_duffings_through_both_folds() -> None:
    k = 2e8
    rig = one_mode(MidplaneStretching(k), alpha=3.0)
    curve = trace_frequency(rig, (44.0, 60.0), harmonics=1, samples=64, step_hz=0.5)
    assert curve.branch.complete
    a = np.array([np.hypot(*p.state.Q[1:, 0]) for p in curve.points])
    Omega = 2 * np.pi * np.array([p.hz for p in curve.points])
    assert (np.diff(np.sign(np.diff(Omega))) != 0).sum() == 2  # over the fold and back
    # the quadrature of this test has 1e-8, Newton 1e-10 of the force
    np.testing.assert_allclose(duffing_force(rig, duffing_cubic(k), Omega, a), 1.0, rtol=1e-6)


def test_drag_takes_eight_thirds() -> None:
    """Int_0^T c |a Omega phi cos|^3 dt = 8/3 c a^3 Omega^2 |phi|^3, over the beam."""
    c = 500.0
    rig = one_mode(QuadraticDrag(c))
    solution = steady_state(rig, 47.5, harmonics=1, samples=1024)
    a, Omega = np.hypot(*solution.state.Q[1:, 0]), 2 * np.pi * 47.5
    elements = HarmonicBalance(rig, solution.basis).elements
    forces = elements.along_rows(solution.state.Q, Omega, solution.state.F * np.eye(3)[1]) @ elements.rows
    taken = -np.pi * forces[1:, 0] @ solution.basis.derivative(solution.state.Q)[1:, 0]
    cubed = float(np.trapezoid(np.abs(first_shape()) ** 3, SPAN))
    assert taken == pytest.approx(8 / 3 * c * a**3 * Omega**2 * cubed, rel=1e-6)
    assert taken > 0.2 * np.pi * a * abs(rig.structure.excitation[0])  # it matters


@pytest.mark.parametrize("elements", [ALL[:1], ALL[1:2], ALL[2:], ALL], ids=[*ELEMENTS, "all"])
def test_energy_is_balanced(elements) -> None:
    solution = steady_state(with_elements(elements=elements), 54.0, harmonics=11, samples=512)
    assert abs(solution.energy_error) < 1e-6
    assert abs(solution["normal"].coefficients[1]) > 1.0


# ---- other integrators


def test_stop_against_a_time_integrator() -> None:
    gap, k, force, hz = 3e-5, 3e4, 1.0, 46.0
    rig = replace(one_mode(ImpactStop(gap, k, STOP), force=force), damping=Damping(modal_ratios=(0.03,)))
    found = steady_state(rig, hz, harmonics=40, samples=2048)
    phi, at_drive = replace(PAPER_BEAM, modes=1).shapes(np.array([STOP, DRIVE]))[:, 0]
    w, Omega = 2 * np.pi * 47.8418, 2 * np.pi * hz
    w = float(PAPER_BEAM.natural_frequencies()[0])

    def rate(t: float, y: np.ndarray) -> list[float]:
        pushed = -k * phi * max(phi * y[0] - gap, 0.0) + force * at_drive * np.cos(Omega * t)
        return [y[1], pushed - 0.06 * w * y[1] - w**2 * y[0]]

    T = 1 / hz
    t = 80 * T + np.arange(512) * T / 512
    q = solve_ivp(rate, (0.0, 81 * T), [0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-13, max_step=T / 200).y[0]
    assert phi * q.max() > 1.3 * gap  # it touches
    expected, c = coefficients(q, 9), found.state.Q[:, 0]
    ours = np.concatenate([c[:1], c[1:10] + 1j * c[41:50]])
    np.testing.assert_allclose(ours, expected, atol=2e-6 * np.abs(expected).max())


@pytest.mark.parametrize("elements", [ALL[2:], ALL], ids=["impact-stop", "all"])
def test_time_integration_finds_the_same_steady_state(elements) -> None:
    """The first seven harmonics to 1e-3 of the largest, what 15 leave, where the elements make 6 % or more."""
    rig = with_elements(elements=elements, modes=3)
    balanced, plain = (steady_state(r, 54.0, harmonics=15, samples=256) for r in (rig, replace(rig, elements=())))
    marched = integrate.steady_state(rig, 54.0, steps_per_period=512, start=state_at_phase_zero(balanced))
    assert marched.converged and marched.iterations <= 3
    made = []
    for channel in ("drive", "slip", "friction", "normal", "a1"):
        kept = [*range(int(channel == "a1"), 8), *range(16, 23)]  # an acceleration has no mean
        theirs, without = (s[channel].coefficients[kept] for s in (balanced, plain))
        ours = marched.history.coefficients(channel, 15)[kept]
        np.testing.assert_allclose(ours, theirs, atol=1e-3 * np.abs(ours).max(), err_msg=channel)
        made.append(np.abs(without - ours).max() / np.abs(ours).max())
    assert min(made) > 0.06


def test_steps_are_of_second_order() -> None:
    """From rest over a tenth of a period, with a stop that stays in touch, against steps eight times as fine."""
    pressed = (MidplaneStretching(3e9), QuadraticDrag(3000.0), ImpactStop(-1e-3, 1e4, STOP))
    rig = with_elements(Viscous(100.0), pressed, modes=3)

    def end(steps: int) -> np.ndarray:
        return integrate.simulate(rig, 54.0, level=20.0, duration=0.1 / 54.0, steps_per_period=steps).state.flat[:6]

    coarse, half = (np.abs(end(steps) - end(10240)).max() for steps in (640, 1280))
    assert coarse / half == pytest.approx(4.0, rel=0.1)


def test_derivative_of_a_step_is_that_of_steps_again() -> None:
    rig = with_elements(elements=(*ALL[:2], ImpactStop(-1e-5, 1e6, STOP)), modes=3)
    stepper = Stepper.stable(rig, 54.0, 20.0, 512)
    x = stepper.march(np.zeros(stepper.shape.size), 100)[0][-1]
    X, T, _ = stepper.march(x, 1)
    moved = np.repeat([1e-9, 1e-6, 0.0], [3, 3, x.size - 6]) * np.random.default_rng(5).standard_normal(x.size)
    up, down = (stepper.march(x + sign * moved, 1)[0][0] for sign in (1, -1))
    exact, difference = stepper.linearised(x, X, T)[0] @ moved, (up - down) / 2
    for part in (slice(3), slice(3, 6), slice(6, 7)):
        np.testing.assert_allclose(exact[part], difference[part], atol=1e-6 * np.abs(exact[part]).max())


def test_distorted_force_in_the_time_integrator() -> None:
    rig = beam(PAPER_PENALTY, alpha=6.0, modes=3)
    rig = replace(rig, excitation=replace(rig.excitation, harmonics=((2, 0.05, 0.02), (3, -0.1, 0.2))))
    balanced = steady_state(rig, 56.0, harmonics=31, samples=1024)
    marched = integrate.steady_state(rig, 56.0, steps_per_period=2048).history
    for name in ("drive", "friction", "normal", "force", "a3"):
        signal = balanced[name].coefficients
        expected = marched.coefficients(name, 31)
        np.testing.assert_allclose(signal[:8], expected[:8], atol=2e-3 * np.abs(signal[1:]).max())
        np.testing.assert_allclose(signal[32:39], expected[32:39], atol=2e-3 * np.abs(signal[1:]).max())


# ---- force distortion


def test_distorted_force_of_a_linear_oscillator() -> None:
    rig = oscillator(Viscous(0.1), damping=0.1, amplitude=0.4)
    rig = replace(rig, excitation=replace(rig.excitation, harmonics=((3, 0.2, -0.5),)))
    solution = steady_state(rig, 0.4 / (2 * np.pi), harmonics=5)
    s, y = 3j * 0.4, solution["y"].coefficients
    response = 0.4 * (0.2 + 0.5j) / (s**2 + 0.2 * s + 1)  # a - i b
    assert y[3] - 1j * y[8] == pytest.approx(response, rel=1e-9)
    assert solution.energy_error == pytest.approx(0.0, abs=1e-12)
    plain = replace(rig, excitation=replace(rig.excitation, harmonics=()))
    assert steady_state(plain, 0.4 / (2 * np.pi), harmonics=2)["y"].coefficients[1] == pytest.approx(y[1], rel=1e-9)
    with pytest.raises(InputError, match=r"steady_state: harmonics = 2 and harmonic 3 in excitation.harmonics"):
        steady_state(rig, 0.4 / (2 * np.pi), harmonics=2)


def test_distorted_force_in_the_symbolic_residual() -> None:
    rig = beam(PAPER_PENALTY, modes=3)
    rig = replace(rig, excitation=replace(rig.excitation, harmonics=((2, 0.05, 0.02), (3, -0.1, 0.2))))
    problem = HarmonicBalance(rig, FourierBasis(5, 128))
    x, lam = 0.1 * np.random.default_rng(1).standard_normal(problem.size), problem.lam_at(51.0)
    symbolic = residual_function(problem)(x, lam, problem.environment.parameters).full().ravel()
    np.testing.assert_allclose(symbolic, problem.residual(x, lam), atol=1e-9 * np.abs(symbolic).max())


# ---- derivatives


def at_random(rig: Rig, parameter) -> tuple[HarmonicBalance, np.ndarray, float, np.ndarray]:
    problem = HarmonicBalance(rig, FourierBasis(5, 2048), parameter=parameter, hz=51.0)
    rng = np.random.default_rng(2)
    start = steady_state(rig, 51.0, harmonics=5, samples=2048).state
    x, lam = problem.pack(State(start.Q, start.T, start.Omega, start.F))
    return problem, x, lam, rng.standard_normal(problem.size) * np.abs(x).max()


@pytest.mark.parametrize("parameter", ["frequency", "force"])
@pytest.mark.parametrize("elements", [ALL[:1], ALL[1:2], ALL[2:], ALL], ids=[*ELEMENTS, "all"])
def test_newton_matrix_is_the_derivative(elements, parameter) -> None:
    """Taylor remainder of second order, beside a smooth contact; samples pass the kinks of stop and drag one by one."""
    rig = with_elements(Viscous(100.0), elements)
    problem, x, lam, direction = at_random(rig, parameter)
    here = problem.linearize(x, lam)
    row = np.random.default_rng(3).standard_normal(problem.size)
    sizes, remainders = 2.0 ** -np.arange(6, 13), []
    for h in sizes:  # what the matrix takes for the step that was made
        d_x, d_lam = h * direction, 0.1 * h
        moved = problem.residual(x + d_x, lam + d_lam) - here.residual
        again, d_again = here.solve_bordered(row, 1.0, moved, float(row @ d_x + d_lam))
        remainders.append(max(np.abs(again - d_x).max(), abs(d_again - d_lam)))
    slope = np.polyfit(np.log(sizes), np.log(remainders), 1)[0]
    assert slope > (1.95 if elements == ALL[:1] else 1.7)


@pytest.mark.parametrize("parameter", ["frequency", "force"])
@pytest.mark.parametrize("elements", [(), ALL[:1], ALL[1:2], ALL[2:], ALL], ids=["none", *ELEMENTS, "all"])
def test_elimination_solves_the_complete_system(elements, parameter) -> None:
    """On a steady state of everything there is, up to weak coupling that the elimination leaves out."""
    ends = Attachments(support_stiffness=1e6, masses=(PointMass(0.02, 0.2),))
    plain = replace(beam(Dahl(mu=0.5, stiffness=1e7), alpha=6.0, modes=4), attachments=ends)
    rig = replace(plain, elements=elements)
    solution = steady_state(rig, 50.0, harmonics=9, samples=256)
    problem = HarmonicBalance(rig, solution.basis, parameter=parameter, hz=50.0)
    here = problem.linearize(*problem.pack(solution.state))
    complete = CompleteBalance(problem, here.state, here.kin, here.contact, here.by_T, here.slope)
    np.testing.assert_array_equal(complete.by_unknowns, here.complete)
    dense = DenseLinearization(
        here.residual, complete.by_unknowns, problem.by_parameter(here.state, here.contact, here.slope)
    )
    rng = np.random.default_rng(4)
    row, right = rng.standard_normal(problem.size), rng.standard_normal(problem.size)
    expected, found = dense.solve_bordered(row, 1.0, right, 0.5), here.solve_bordered(row, 1.0, right, 0.5)
    np.testing.assert_allclose(found[0], expected[0], atol=2e-2 * np.abs(expected[0]).max())
    assert found[1] == pytest.approx(expected[1], rel=2e-2)
    assert here.determinant_sign(row, 1.0) == dense.determinant_sign(row, 1.0) != 0


def test_sensitivities_hold_with_an_element_that_does_next_to_nothing() -> None:
    plain = beam(Dahl(mu=0.5, stiffness=1e7), alpha=6.0, modes=4)
    solution = steady_state(plain, 50.0, harmonics=7)
    idle = replace(plain, elements=(MidplaneStretching(1e-6),))
    kept, all_of_it = (sensitivities(rig, solution, ("beam.length", "contact.friction.mu")) for rig in (plain, idle))
    np.testing.assert_allclose(all_of_it.Q, kept.Q, atol=1e-9 * np.abs(kept.Q).max())


def test_a_stop_that_stays_open_changes_nothing() -> None:
    plain = beam(Dahl(mu=0.5, stiffness=1e7), alpha=6.0, modes=4)
    solution = steady_state(plain, 50.0, harmonics=7)
    reach = float(np.abs(solution["drive"].samples).max())
    rigs = [replace(plain, elements=(ImpactStop(gap, 1e4, 0.3),)) for gap in (10 * reach, 0.1 * reach)]
    open_, closing = (HarmonicBalance(rig, solution.basis) for rig in rigs)
    x, lam = open_.pack(solution.state)
    assert open_.linearize(x, lam).slope is None
    assert closing.linearize(x, lam).slope is not None
    expected = HarmonicBalance(plain, solution.basis).residual(x, lam)
    np.testing.assert_allclose(open_.residual(x, lam), expected, atol=1e-14)


def test_a_stop_that_stays_open_does_not_enter_the_system_of_one_that_closes() -> None:
    plain = beam(Dahl(mu=0.5, stiffness=1e7), alpha=6.0, modes=4)
    reach = float(np.abs(steady_state(plain, 50.0, harmonics=7)["drive"].samples).max())
    closing, idle = ImpactStop(0.1 * reach, 1e4, 0.3), ImpactStop(10 * reach, 1e4, 0.3)
    solution = steady_state(replace(plain, elements=(closing,)), 50.0, harmonics=7)
    steps = []
    for elements in ((closing,), (idle, closing, replace(idle, position=0.5))):
        problem = HarmonicBalance(replace(plain, elements=elements), solution.basis)
        here = problem.linearize(*problem.pack(solution.state))
        assert len(here.slope.at_points.rows) == 1
        right = np.random.default_rng(2).standard_normal(problem.size)
        steps.append(here.solve_bordered(np.zeros(problem.size), 1.0, right, 0.0)[0])
    np.testing.assert_allclose(steps[1], steps[0], atol=1e-12 * np.abs(steps[0]).max())


def changed(rig: Rig, key: str, factor: float) -> Rig:
    table, _, name = key.partition(".")
    if table.startswith("elements"):
        i = int(table[9:-1])
        new = replace(rig.elements[i], **{name: getattr(rig.elements[i], name) * factor})
        return replace(rig, elements=(*rig.elements[:i], new, *rig.elements[i + 1 :]))
    if table == "contact" and "." in name:
        law = rig.contact.law
        new = replace(law, **{name.partition(".")[2]: getattr(law, name.partition(".")[2]) * factor})
        return replace(rig, contact=replace(rig.contact, law=new))
    attribute = {"beam": "body"}.get(table, table)
    part = getattr(rig, attribute)
    return replace(rig, **{attribute: replace(part, **{name: getattr(part, name) * factor})})


KEYS = [
    "elements[0].axial_stiffness",
    "elements[1].coefficient",
    "elements[2].gap",
    "elements[2].stiffness",
    "elements[2].position",
    "beam.length",
    "beam.thickness",
    "beam.density",
    "contact.radius",
    "contact.normal_load",
    "contact.friction.mu",
    "damping.mass_proportional",
    "excitation.amplitude",
    "excitation.position",
]


@pytest.fixture(scope="module")
def differentiated():
    """A rig with everything, above all a force with harmonics."""
    rig = with_elements(Dahl(mu=0.5, stiffness=1e7))
    rig = replace(rig, excitation=replace(rig.excitation, amplitude=3.0, harmonics=((3, 0.05, -0.1),)))
    solution = steady_state(rig, 52.0, harmonics=7)
    return rig, solution, sensitivities(rig, solution, (*KEYS, "frequency_hz"))


@pytest.mark.parametrize("key", [*KEYS, "frequency_hz"])
def test_derivatives_are_those_of_solutions_again(differentiated, key) -> None:
    """Central differences of solutions found again, 1e-10 of the force over a step of 1e-6."""
    rig, solution, s = differentiated
    i, h = s.parameters.index(key), 1e-6

    def again(factor: float) -> PeriodicSolution:
        start = {"harmonics": 7, "start": solution}
        if key == "frequency_hz":
            return steady_state(rig, 52.0 * factor, **start)
        return steady_state(changed(rig, key, factor), 52.0, **start)

    above, below = again(1 + h), again(1 - h)
    for name in ("a1", "a4", "drive", "slip", "friction", "normal", "force"):
        difference = (above[name].coefficients - below[name].coefficients) / (2 * h * s.values[i])
        exact, size = s[name].coefficients[:, i], np.abs(solution[name].coefficients[1:]).max() / abs(s.values[i])
        np.testing.assert_allclose(exact, difference, rtol=0, atol=2e-3 * np.abs(difference).max() + 3e-5 * size)


# ---- the independent simulator

FRICTION = {"mu": 0.52, "critical_slip": 4.15e-6}
HARMONIC = ((2, 0.05 * np.cos(0.7), 0.05 * np.sin(0.7)), (3, 0.1 * np.cos(-0.4), 0.1 * np.sin(-0.4)))
SAME = {
    "midplane-stretching": ((truth.MidplaneStretching(3e8),), (), (MidplaneStretching(3e8),), ()),
    "quadratic-drag": ((truth.QuadraticDrag(300.0),), (), (QuadraticDrag(300.0),), ()),
    "impact-stop": ((truth.ImpactStop(5e-5, 5e3, STOP),), (), (ImpactStop(5e-5, 5e3, STOP),), ()),
    "force-distortion": ((), (truth.Tone(2, 0.05, 0.7), truth.Tone(3, 0.1, -0.4)), (), HARMONIC),
}


@pytest.mark.parametrize("effect", SAME)
def test_agrees_with_the_independent_simulator(effect) -> None:
    """Harmonics 1 to 9 of all accelerometers and of friction; of the reaction, which feels the inertia of all modes."""
    hidden, tones, elements, harmonics = SAME[effect]
    true = replace(truth.table_1(truth.Coulomb(**FRICTION)), effects=hidden, distortion=tones)
    records = [truth.Record(6.5, hz) for hz in ((53.0, 60.0) if "stop" in effect else (52.0, 58.0))]
    quick = truth.Settings(ramp=8, hold=3, coarse=64, tolerance=1e-6)
    seen = truth.simulate_records(true, records, steps=256, settings=quick)
    assert seen.usable.all()
    channels = tuple(Channel(s.name, "acceleration", s.position) for s in true.sensors)
    plain = replace(beam(Jenkins(**FRICTION), modes=8), channels=channels)
    rig = replace(plain, elements=elements, excitation=replace(plain.excitation, harmonics=harmonics))
    for i, record in enumerate(seen.records):
        ours = steady_state(rig, record.hz, level=record.level, harmonics=21, samples=512)
        signals = {s.name: seen.acceleration[i, j] for j, s in enumerate(true.sensors)}

        def missed(found: PeriodicSolution, signals: dict[str, np.ndarray]) -> float:
            spectra = {name: coefficients(signal, 9)[1:] for name, signal in signals.items()}
            largest = max(np.abs(c).max() for c in spectra.values())
            own = {name: found[name].coefficients for name in signals}
            gaps = [np.abs(c[1:10] + 1j * c[22:31] - spectra[name]).max() for name, c in own.items()]
            return float(max(gaps) / largest)

        assert missed(ours, signals) < 3e-3
        assert missed(ours, {"friction": seen.T[i]}) < 3e-3
        assert missed(ours, {"normal": seen.R[i]}) < 1e-2
        if i == 0:  # it matters
            assert missed(steady_state(plain, record.hz, harmonics=21, samples=512), signals) > 2e-2


# ---- refusals


def test_refusals() -> None:
    rig = with_elements()
    with pytest.raises(ValueError, match=r"has nonlinear elements; the symbolic residual knows friction only"):
        residual_function(HarmonicBalance(rig, FourierBasis(3, 64)))
    with pytest.raises(ValueError, match=r"elements: 20 samples for 5 harmonics; must be more than 4 per harmonic"):
        HarmonicBalance(rig, FourierBasis(5, 20))
    modal = replace(oscillator(Viscous(0.1), damping=0.1, amplitude=1.0), elements=ALL)
    with pytest.raises(ValueError, match=r"oscillator: has elements and is given by its modes; must be a beam"):
        _ = modal.structure
    with pytest.raises(ValueError, match=r"excitation.harmonics: numbers \[1\]; must be whole, 2 or more, each once"):
        replace(rig.excitation, harmonics=((1, 1.0, 0.0),))
