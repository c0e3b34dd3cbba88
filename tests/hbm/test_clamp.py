"""Friction in the clamp: closed forms, the clamp that never slips, the rigid one that does, and another simulator."""

from dataclasses import replace

import numpy as np
import pytest
from rigs import beam

import tests.truth as truth
from hbm.balance.clamp import ClampOverPeriod
from hbm.balance.problem import HarmonicBalance
from hbm.balance.slipping import SlippingBalance
from hbm.balance.solution import PeriodicSolution
from hbm.fourier import FourierBasis
from hbm.integration import integrate
from hbm.response.trace import steady_state
from hbm.sensitivity.derivatives import sensitivities
from hbm.symbolic import residual_function
from models import Attachments, Channel, Dahl, Jenkins, Rig, Viscous
from models.elements import ImpactStop, MidplaneStretching
from models.published import PAPER_BEAM, PAPER_PENALTY
from models.structure import SpringPort
from tests.truth.measure import coefficients

OWN = PAPER_BEAM.bending_stiffness / PAPER_BEAM.length


def clamped(stiffness: float, limit: float | None, law=PAPER_PENALTY, modes: int = 5, **contact: float) -> Rig:
    rig = beam(law, alpha=6.0, modes=modes, **contact)
    return replace(rig, attachments=Attachments(clamp_stiffness=stiffness, clamp_limit=limit))


def away(a: PeriodicSolution, b: PeriodicSolution) -> float:
    """Largest difference of two solutions, each channel relative to its peak."""
    return max(float(np.abs(a[n].coefficients - c.coefficients)[1:].max()) / c.peak for n, c in b.channels.items())


# ---- closed forms


@pytest.mark.parametrize("turned", [1.5e-4, 6e-4])
def test_a_prescribed_rotation_takes_the_area_of_masings_loop(turned) -> None:
    """4 L (theta - L / k), and no moment above the limit."""
    k, limit, basis = 5e3, 0.5, FourierBasis(200, 4096)
    clamp = ClampOverPeriod(SpringPort(np.array([k]), k, np.zeros(3)), limit, basis)
    Q = np.zeros((basis.size, 1))
    Q[1, 0], Q[0, 0] = turned, 0.3 * turned  # a mean is forgotten
    motion = clamp.motion(clamp.held(Q, np.zeros(basis.size), np.zeros(basis.size)), 300.0)
    assert motion.taken == pytest.approx(4 * limit * (turned - limit / k), rel=1e-4)
    assert np.abs(basis.synthesis @ motion.moment).max() == pytest.approx(limit, rel=1e-2)  # the series' own ripple
    np.testing.assert_allclose(motion.moment, k * (Q[:, 0] - motion.slid), atol=1e-12)


def test_a_port_is_the_structure_turned_in_its_clamp() -> None:
    """Moment and motion of a beam at rest whose clamp is turned by one: a propped cantilever behind its spring."""
    k, X, L = 5e3, 0.555, PAPER_BEAM.length
    rig = clamped(k, 1.0)
    port, s = rig.clamp, rig.structure
    modes = port.row / s.omega_n**2
    share = k / (k + 3 * OWN)
    assert port.stiffness - port.row @ modes == pytest.approx(3 * OWN * share, rel=1e-9)
    xi = X / L
    drive = L * (xi - 1.5 * xi**2 + 0.5 * xi**3) * share
    assert port.residual[1] + s.excitation @ modes == pytest.approx(drive, rel=1e-9)
    arm = rig.contact.radius + PAPER_BEAM.thickness / 2
    assert port.residual[0] + s.slip_row @ modes == pytest.approx(-0.5 * arm * share, rel=1e-9)
    reaction = rig.clamp.residual[-1] + s.reaction.stiffness @ modes
    assert reaction == pytest.approx(-3 * OWN / L * share, rel=1e-9)


# ---- limits


def test_a_clamp_that_never_slips_is_a_spring() -> None:
    for hz in (47.0, 56.0):
        spring = steady_state(clamped(5e3, None), hz, harmonics=9, samples=128)
        assert away(steady_state(clamped(5e3, 20.0), hz, harmonics=9, samples=128), spring) < 1e-8


def test_a_clamp_that_slips_takes_energy_and_the_balance_is_closed() -> None:
    rig, spring = clamped(5e3, 0.8), clamped(5e3, None)
    solution = steady_state(rig, 49.0, harmonics=11, samples=256)
    clamp = HarmonicBalance(rig, solution.basis).kinematics(solution.state).clamp
    supplied = np.pi * solution.level * solution["drive"].coefficients[12]
    assert abs(solution.energy_error) < 1e-8
    assert clamp.taken > 0.1 * supplied  # it matters
    assert away(solution, steady_state(spring, 49.0, harmonics=11, samples=256)) > 0.1


def test_a_rigid_clamp_slips_too() -> None:
    """What is left of the spring falls in proportion to its yielding."""
    found = steady_state(clamped(1e9 * OWN, 0.8), 50.0, harmonics=7, samples=128)
    left = [away(steady_state(clamped(k * OWN, 0.8), 50.0, harmonics=7, samples=128), found) for k in (1e5, 1e6)]
    assert left[0] < 1e-3
    assert left[1] == pytest.approx(left[0] / 10, rel=0.1)
    assert away(steady_state(clamped(1e9 * OWN, None), 50.0, harmonics=7, samples=128), found) > 0.1


# ---- derivatives


@pytest.mark.parametrize(
    "elements",
    [(), (MidplaneStretching(3e8),), (ImpactStop(2e-6, 1e5, 0.3),)],
    ids=["alone", "beside an element", "beside a stop"],
)
@pytest.mark.parametrize("parameter", ["frequency", "force"])
def test_newton_matrix_is_the_derivative(parameter, elements) -> None:
    """Taylor remainder; samples pass the kinks of the clamp one by one, hence less than second order."""
    rig = replace(clamped(2e3, 0.2, Viscous(100.0), modes=3), elements=elements)
    basis = FourierBasis(5, 4096)
    problem = HarmonicBalance(rig, basis, parameter=parameter, hz=51.0)
    x, lam = problem.pack(steady_state(rig, 51.0, harmonics=5, samples=4096).state)
    rng = np.random.default_rng(2)
    direction, row = rng.standard_normal(problem.size) * np.abs(x).max(), rng.standard_normal(problem.size)
    here = problem.linearize(x, lam)
    assert isinstance(here.newton, SlippingBalance)
    assert isinstance(here.newton.held, SlippingBalance) == any(isinstance(e, ImpactStop) for e in elements)  # it acts
    assert np.abs(here.newton.slid - np.eye(basis.size) / problem.clamp.port.stiffness).max() > 1e-5  # it slips
    columns = here.newton.solve_columns(row, 1.0, np.eye(problem.size), 0.0)
    last = here.solve_bordered(row, 1.0, np.zeros(problem.size), 1.0)
    inverse = np.column_stack([np.vstack(columns), np.append(*last)])
    assert here.determinant_sign(row, 1.0) == np.linalg.slogdet(inverse)[0]
    sizes, remainders = 2.0 ** -np.arange(7, 13), []
    for h in sizes:
        d_x, d_lam = h * direction, 0.1 * h
        moved = problem.residual(x + d_x, lam + d_lam) - here.residual
        again, d_again = here.solve_bordered(row, 1.0, moved, float(row @ d_x + d_lam))
        remainders.append(max(np.abs(again - d_x).max(), abs(d_again - d_lam)))
    assert np.polyfit(np.log(sizes), np.log(remainders), 1)[0] > 1.6


KEYS = [
    "attachments.clamp_stiffness",
    "attachments.clamp_limit",
    "beam.length",
    "beam.thickness",
    "contact.radius",
    "contact.load_variation",
    "contact.normal_load",
    "contact.friction.mu",
    "damping.mass_proportional",
    "excitation.amplitude",
    "excitation.position",
    "channels.a3.position",
]


@pytest.fixture(scope="module", params=["all that yields", "modes alone"])
def differentiated(request):
    alone = request.param == "modes alone"
    law = Dahl(mu=0.5, stiffness=1e7)
    rig = clamped(2e3, 0.3, law, modes=4, residual_compliance=not alone, load_variation=0.8)
    rig = replace(rig, excitation=replace(rig.excitation, amplitude=3.0, harmonics=((3, 0.05, -0.1),)))
    solution = steady_state(rig, 51.0, harmonics=7)
    clamp = HarmonicBalance(rig, solution.basis).kinematics(solution.state).clamp
    assert clamp.taken > 1e-5
    return rig, solution, sensitivities(rig, solution, (*KEYS, "frequency_hz"))


@pytest.mark.parametrize("key", [*KEYS, "frequency_hz"])
def test_derivatives_are_those_of_solutions_again(differentiated, key) -> None:
    """Central differences of solutions found again, 1e-10 of the force over a step of 1e-6."""
    rig, solution, s = differentiated
    i, h = s.parameters.index(key), 1e-6

    def again(factor: float) -> PeriodicSolution:
        start = {"harmonics": 7, "start": solution}
        if key == "frequency_hz":
            return steady_state(rig, 51.0 * factor, **start)
        return steady_state(rig.with_number(key, rig.number(key) * factor), 51.0, **start)

    above, below = again(1 + h), again(1 - h)
    for name in ("a1", "a3", "drive", "slip", "friction", "normal"):
        difference = (above[name].coefficients - below[name].coefficients) / (2 * h * s.values[i])
        exact, size = s[name].coefficients[:, i], np.abs(solution[name].coefficients[1:]).max() / abs(s.values[i])
        np.testing.assert_allclose(exact, difference, rtol=0, atol=2e-3 * np.abs(difference).max() + 3e-5 * size)


# ---- the independent simulator

FRICTION = {"mu": 0.52, "critical_slip": 4.15e-6}


@pytest.mark.parametrize(
    ("stiffness", "limit", "hz", "level"), [(500.0, 0.4, 47.0, 6.5), (1e4, 0.6, 54.0, 4.0)], ids=["soft", "stiff"]
)
def test_agrees_with_the_independent_simulator(stiffness, limit, hz, level) -> None:
    """Harmonics 1 to 9 of all accelerometers and of friction; of the reaction, which feels the inertia of all modes."""
    true = replace(truth.table_1(truth.Coulomb(**FRICTION)), effects=(truth.ClampFriction(limit, stiffness),))
    quick = truth.Settings(ramp=8, hold=3, coarse=64, tolerance=1e-6)
    seen = truth.simulate_records(true, [truth.Record(level, hz)], steps=256, settings=quick)
    assert seen.usable.all()
    channels = tuple(Channel(s.name, "acceleration", s.position) for s in true.sensors)
    rig = replace(clamped(stiffness, limit, Jenkins(**FRICTION), modes=8), channels=channels)
    rig = replace(rig, damping=replace(rig.damping, mass_proportional=true.alpha))
    signals = {s.name: seen.acceleration[0, j] for j, s in enumerate(true.sensors)}

    def missed(found: PeriodicSolution, signals: dict[str, np.ndarray]) -> float:
        spectra = {name: coefficients(signal, 9)[1:] for name, signal in signals.items()}
        largest = max(np.abs(c).max() for c in spectra.values())
        own = {name: found[name].coefficients for name in signals}
        H = len(found["a1"].coefficients) // 2
        gaps = [np.abs(c[1:10] + 1j * c[H + 1 : H + 10] - spectra[name]).max() for name, c in own.items()]
        return float(max(gaps) / largest)

    coarse = steady_state(rig, hz, level=level, harmonics=5, samples=128)
    ours = steady_state(rig, hz, level=level, harmonics=31, samples=512, start=coarse)
    assert missed(ours, signals) < 3e-3
    assert missed(ours, {"friction": seen.T[0]}) < 5e-3
    assert missed(ours, {"normal": seen.R[0]}) < 1e-2
    spring = replace(rig, attachments=Attachments(clamp_stiffness=stiffness))
    assert missed(steady_state(spring, hz, level=level, harmonics=9), signals) > 0.1  # it slips


# ---- refusals


def test_refusals() -> None:
    rig = clamped(5e3, 0.8)
    with pytest.raises(ValueError, match=r"has a clamp that slips; must have none"):
        integrate.simulate(rig, 51.0, duration=0.1)
    with pytest.raises(ValueError, match=r"the symbolic residual knows friction only"):
        residual_function(HarmonicBalance(rig, FourierBasis(3, 64)))
    with pytest.raises(ValueError, match=r"has a clamp_limit and no clamp_stiffness; must have both, or no limit"):
        _ = replace(rig, attachments=Attachments(clamp_limit=0.8)).clamp
