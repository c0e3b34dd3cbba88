"""Laws of joints over a period: derivatives against differences, friction against the law as one contact has it."""

import numpy as np
import pytest

from hbm.aft.force import Environment, LawOverPeriod
from hbm.aft.joint import JointOverPeriod
from hbm.aft.jointstep import values
from hbm.fourier import FourierBasis
from models import (
    LAWS as LISTED,
)
from models import (
    Coulomb,
    Dahl,
    Hybrid,
    Iwan,
    Jenkins,
    Karnopp,
    LuGre,
    SpringDamper,
    Stribeck,
    VelocityLimited,
    Viscous,
)
from models.friction import parameters
from models.joints import (
    Backlash,
    Clearance,
    CubicSpring,
    Dashpot,
    Friction,
    HystereticDamping,
    PlaneFriction,
    PolynomialSpring,
    Separation,
    Stop,
)
from models.joints.law import with_numbers

BASIS = FourierBasis(7, 256)
OMEGA = 1.3
FRICTION = {
    "jenkins": Jenkins(0.4, 0.3),
    "coulomb": Coulomb(0.4),
    "stribeck": Stribeck(0.5, 0.3, 0.4, 0.3),
    "dahl": Dahl(0.4, 3.0),
    "lugre": LuGre(0.5, 0.3, 0.4, 3.0, 0.05, 0.02),
    "iwan": Iwan(0.4, 3.0, spread=0.5, elements=4),
    "karnopp": Karnopp(0.5, 0.4, 0.2),
    "sdfm": SpringDamper(0.4, 3.0, 0.1),
    "vlfm": VelocityLimited(0.4, 0.2),
    "hybrid": Hybrid(0.5, 0.3, 0.4, 3.0, 30.0, 20.0, 0.05, 0.02),
    "viscous": Viscous(0.3),
}
LAWS = {
    "polynomial": (PolynomialSpring(1.0, 0.5, 2.0, 0.3, 0.1), 0.0),
    "cubic": (CubicSpring(2.0), 0.0),
    "dashpot": (Dashpot(0.3, 0.2), 0.0),
    "stop": (Stop(3.0, 0.1), 0.0),
    "separation": (Separation(0.6, 0.1), 0.0),
    "clearance": (Clearance(3.0, 0.1), 0.0),
    "loss factor": (HystereticDamping(0.4, 0.2), 0.0),
    "backlash": (Backlash(3.0, 0.4, 0.2), 0.0),
    "plane": (PlaneFriction(0.4, 2.0, 1.0, 0.8), 0.0),
    "normal port": (Friction(Jenkins(0.4, 0.3), 2.0, 1.5), 0.1),
    "open at rest": (Friction(Jenkins(0.4, 0.3), -0.5, 1.5, 2.0), 0.1),
    "plane, open at rest": (PlaneFriction(0.4, 2.0, -0.5, 0.8), 0.0),
    **{name: (Friction(law, 2.0), 0.2) for name, law in FRICTION.items()},
}


def _signals(ports: int, loaded: bool) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    signals, change = (rng.normal(size=(BASIS.size, 2 * ports + 1)) / (1 + BASIS.k[:, None] ** 2) for _ in range(2))
    for s in (signals, change):
        s[:, -1] *= 0.3 * loaded
    return signals, change


@pytest.mark.parametrize("name", LAWS)
def test_derivatives_of_the_coefficients_are_those_of_differences(name: str) -> None:
    law, C = LAWS[name]
    signals, change = _signals(law.ports, isinstance(law, Friction) and law.ports == 1)
    numbers, e = values(law), 1e-6

    def coefficients(
        of: object = law, s: np.ndarray = signals, Omega: float = OMEGA, compliance: float = C
    ) -> np.ndarray:
        f, closure = JointOverPeriod(of, BASIS, compliance).forces(s, Omega)
        assert closure < 1e-10
        return BASIS.analysis @ f

    joint = JointOverPeriod(law, BASIS, C)
    joint.forces(signals, OMEGA)
    found = joint.linearize(signals, OMEGA)
    scale = np.abs(coefficients()).max()
    by_signals = (coefficients(s=signals + e * change) - coefficients(s=signals - e * change)) / (2 * e)
    assert np.abs(np.einsum("amcs,cs->am", found.by_signals, change) - by_signals).max() < 1e-5 * scale
    by_Omega = (coefficients(Omega=OMEGA + e) - coefficients(Omega=OMEGA - e)) / (2 * e)
    assert np.abs(found.by_Omega - by_Omega).max() < 1e-5 * scale
    step = 0.1 * np.append(numbers, C) * np.random.default_rng(1).normal(size=len(numbers) + 1)
    up, down = (
        coefficients(with_numbers(law, iter(numbers + sign * e * step[:-1])), compliance=C + sign * e * step[-1])
        for sign in (1, -1)
    )
    along = joint.along(signals, OMEGA, step[:, None])[:, :, 0]
    assert np.abs(along - (up - down) / (2 * e)).max() < 1e-5 * scale


@pytest.mark.parametrize("name", FRICTION)
def test_friction_of_a_joint_is_that_of_a_contact(name: str) -> None:
    law, C = FRICTION[name], 0.2
    signals, _ = _signals(1, loaded=True)
    signals[:, 1] = signals[:, 0]
    f, _ = JointOverPeriod(Friction(law, 2.0), BASIS, C).forces(signals, OMEGA)
    seen = np.zeros((BASIS.size, 4))
    seen[:, 0], seen[:, 1], seen[:, 2] = signals[:, 0], OMEGA * BASIS.derivative(signals[:, 0]), signals[:, 2]
    seen[0, 2] += 2.0
    environment = Environment(C, 2.0, np.array([float(v) for v in parameters(law).values()]))
    T, _ = LawOverPeriod(law, BASIS).force(seen, OMEGA, environment)
    assert np.abs(T - f[:, 0]).max() < 1e-10 * np.abs(T).max()


def test_friction_in_a_plane_along_one_direction_is_a_jenkins_element() -> None:
    signals, _ = _signals(3, loaded=False)
    signals[:, 1:3] = 0.0
    f, _ = JointOverPeriod(PlaneFriction(0.4, 3.0, 2.0, 0.7), BASIS).forces(signals, OMEGA)
    one = JointOverPeriod(Friction(Jenkins(0.4, 0.4 * 2.0 / 3.0), 2.0), BASIS).forces(signals[:, [0, 3, 6]], OMEGA)[0]
    assert np.abs(f[:, 0] - one[:, 0]).max() < 1e-12
    assert not f[:, 1].any()


def test_friction_in_a_plane_keeps_within_its_circle_and_is_the_same_turned() -> None:
    signals, _ = _signals(3, loaded=False)
    signals[:, 2] *= 30.0
    law = PlaneFriction(0.4, 3.0, 2.0, 4.0)
    f = JointOverPeriod(law, BASIS).forces(signals, OMEGA)[0].copy()
    N = np.maximum(2.0 + 4.0 * (BASIS.synthesis @ signals[:, 2]), 0.0)
    assert (N == 0.0).any()  # it separates
    assert (np.hypot(f[:, 0], f[:, 1]) <= 0.4 * N * (1 + 1e-12)).all()
    assert np.allclose(f[:, 2], 2.0 - N)
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, s], [-s, c]])
    turned = signals.copy()
    turned[:, :2] = signals[:, :2] @ turn
    assert np.allclose(JointOverPeriod(law, BASIS).forces(turned, OMEGA)[0][:, :2], f[:, :2] @ turn, atol=1e-12)


def test_a_circle_under_a_constant_load_loses_what_it_should() -> None:
    """Round a circle of radius a, all slipping: the force is mu N against a velocity it lags by acos(...) no more."""
    a, mu, N, k = 3.0, 0.4, 2.0, 50.0
    signals = np.zeros((BASIS.size, 7))
    signals[1, 0], signals[BASIS.H + 1, 1] = a, a
    f = JointOverPeriod(PlaneFriction(mu, k, N, 0.0), BASIS).forces(signals, OMEGA)[0]
    # the anchor runs on a circle of its own, mu N / k from the contact and square to its own path
    velocity = np.column_stack([-a * np.sin(BASIS.theta), a * np.cos(BASIS.theta)])
    lost = -np.mean(np.sum(f[:, :2] * velocity, axis=1)) * 2 * np.pi
    anchor = np.sqrt(a**2 - (mu * N / k) ** 2)
    assert lost == pytest.approx(2 * np.pi * mu * N * anchor, rel=1e-3)


def test_friction_in_a_plane_is_of_first_order_where_its_force_turns() -> None:
    """Round a circle, all slipping: the force comes half a sample late.

    Contact, anchor and centre make a right angle at the anchor, which runs on a circle of its own.
    """
    a, mu, N, k = 3.0, 0.4, 2.0, 0.5
    anchor = np.sqrt(a**2 - (mu * N / k) ** 2)
    errors = []
    for N_t in (256, 512, 1024):
        basis = FourierBasis(1, N_t)
        signals = np.zeros((basis.size, 7))
        signals[1, 0], signals[2, 1] = a, a
        f = JointOverPeriod(PlaneFriction(mu, k, N, 0.0), basis).forces(signals, OMEGA)[0]
        exact = k * (anchor * np.exp(-1j * np.arccos(anchor / a)) - a) * np.exp(1j * basis.theta)
        errors.append(np.abs(f[:, 0] + 1j * f[:, 1] - exact).max() / (mu * N))
    assert errors == pytest.approx([np.pi / 256, np.pi / 512, np.pi / 1024], rel=0.01)


def test_every_listed_law_is_tried() -> None:
    tried = {law.name for law in FRICTION.values()}
    assert set(LISTED) <= tried | {"fbfm", "none"}  # Karnopp's by another name; nothing


def test_a_contact_open_at_rest_is_a_stop_behind_its_gap_that_rubs() -> None:
    stiffness, gap = 1.5, 0.3
    signals, _ = _signals(2, loaded=False)
    signals[:, 1::2] *= 3.0
    mu, nominal = 0.4, 2.0
    f = JointOverPeriod(Friction(Coulomb(mu), -stiffness * gap, stiffness, nominal), BASIS, 0.1).forces(signals, OMEGA)[
        0
    ]
    stop = JointOverPeriod(Stop(stiffness, gap), BASIS).forces(signals[:, [1, 3, 4]], OMEGA)[0][:, 0]
    assert 0.1 < np.mean(stop < 0.0) < 0.9  # it opens and closes
    np.testing.assert_allclose(f[:, 1], stop, atol=1e-12)
    assert np.all(np.abs(f[:, 0]) <= mu * -stop + 1e-9)
    assert np.ptp(f[:, 0]) > 0.1


def test_open_at_rest_needs_a_gap_and_a_load_to_refer_to() -> None:
    told = r"^Friction: normal_load = -1; must be >= 0; a contact that is open at rest has normal_stiffness and ref"
    with pytest.raises(ValueError, match=told):
        Friction(Jenkins(0.4, 0.3), -1.0, 2.0)
    with pytest.raises(ValueError, match=r"^PlaneFriction: normal_load = -1; must be >= 0"):
        PlaneFriction(0.4, 2.0, -1.0, 0.0)


@pytest.mark.parametrize(("times", "within"), [(1.0, 1e-9), (1 / 3, 0.02), (3.0, 0.02), (0.1, 0.04), (10.0, 0.04)])
def test_a_loss_factor_loses_the_same_at_any_frequency_and_stiffens_as_causality_asks(
    times: float, within: float
) -> None:
    """Complex stiffness i h within a part `within`; Kramers and Kronig: it stiffens by 2/pi h ln(f / reference)."""
    loss, u = 0.4, np.zeros((BASIS.size, 3))
    u[1, :2] = 1.0
    basis = FourierBasis(7, 4096)
    f = -basis.complex(
        basis.analysis @ JointOverPeriod(HystereticDamping(loss, 0.2), basis).forces(u, 2 * np.pi * 0.2 * times)[0]
    )
    stiffness = f[1, 0]
    assert stiffness.imag == pytest.approx(loss, rel=within + 1e-5)
    assert stiffness.real == pytest.approx(2.0 / np.pi * loss * np.log(times), abs=(within + 1e-4) * loss)
    assert np.abs(f[2:]).max() < 1e-4 * loss  # it is linear


def test_a_cycle_through_a_play_loses_four_times_the_limit_times_what_slides() -> None:
    """Back and forth by 2 U: the play and the spring (2 limit / k) take their part; the limit has the rest."""
    limit, k, play, U = 0.4, 3.0, 0.2, 1.0
    u = np.zeros((BASIS.size, 3))
    u[1, :2] = U
    basis = FourierBasis(7, 8192)
    f = JointOverPeriod(Backlash(k, limit, play), basis).forces(u, OMEGA)[0][:, 0]
    lost = -np.mean(f * (basis.synthesis @ basis.derivative(u[:, 0]))) * 2 * np.pi
    assert lost == pytest.approx(2 * limit * (2 * U - play - 2 * limit / k), rel=1e-5)
    assert np.mean(f == 0.0) > 0.05  # within the play nothing acts


def test_a_play_of_nothing_is_a_jenkins_element() -> None:
    signals, _ = _signals(1, loaded=False)
    f = JointOverPeriod(Backlash(0.8 / 0.3, 0.8, 0.0), BASIS).forces(signals, OMEGA)[0]
    one = JointOverPeriod(Friction(Jenkins(0.4, 0.3), 2.0), BASIS).forces(signals, OMEGA)[0]
    assert np.abs(f - one).max() < 1e-12
