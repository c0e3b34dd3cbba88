"""Curves and steady states against closed forms and published values."""

from dataclasses import replace

import numpy as np
import pytest
from rigs import HZ, CubicSpring, beam, oscillator

from hbm.balance.problem import HarmonicBalance
from hbm.balance.solution import describe
from hbm.fourier import FourierBasis
from hbm.response.steps import CURVE_TOLERANCE
from hbm.response.trace import force_response, solve_near, steady_state, trace_frequency
from models import Coulomb, Frictionless, Jenkins, Stribeck, Viscous


def test_linear_oscillator_matches_its_closed_form():
    rig = oscillator(Frictionless(), damping=0.02, amplitude=0.3)
    curve = trace_frequency(rig, (0.5 * HZ, 1.6 * HZ), harmonics=3)
    Omega = 2 * np.pi * curve.hz
    exact = 0.3 / (1.0 - Omega**2 + 0.02j * Omega)
    a = curve["y"].coefficients
    # 1e-10 of the peak
    assert np.abs(a[:, 1] - 1j * a[:, 4] - exact).max() < 1e-10 * np.abs(exact).max()
    assert np.abs(a[:, [0, 2, 3, 5, 6]]).max() < 1e-10
    assert curve.hz[-1] == 1.6 * HZ


def test_phase_and_rms_of_a_point_match_their_closed_form():
    """y = Re c exp(i theta): it lags by the angle of c, and by the force's own is 0; its mean square is |c|^2 / 2."""
    rig = oscillator(Frictionless(), damping=0.02, amplitude=0.3)
    curve = trace_frequency(rig, (0.5 * HZ, 1.6 * HZ), harmonics=3)
    Omega = 2 * np.pi * curve.hz
    exact = 0.3 / (1.0 - Omega**2 + 0.02j * Omega)
    signals = [p["y"] for p in curve.points]
    assert [s.phase[1] for s in signals] == pytest.approx(np.angle(exact), abs=1e-8)
    assert [s.rms for s in signals] == pytest.approx(np.abs(exact) / np.sqrt(2.0), rel=1e-8)
    assert signals[0].phase.shape == (4,)
    assert curve["y"].phase[5].tolist() == signals[5].phase.tolist()
    assert curve["y"].rms.tolist() == [s.rms for s in signals]


def test_linear_beam_matches_its_modal_sum():
    rig = beam(Frictionless())
    s = rig.structure
    state = steady_state(rig, 51.0, harmonics=3)
    Omega = 2 * np.pi * 51.0
    receptance = 1.0 / (s.omega_n**2 - Omega**2 + 1j * Omega * s.damping)
    # foreshortening makes no force where T = 0; the omitted modes answer statically
    exact = 6.5 * (s.excitation @ (receptance * s.excitation) + s.residual.drive_by_force)
    a = state.channels["drive"].coefficients
    assert a[1] - 1j * a[4] == pytest.approx(exact, rel=1e-9)


def test_viscous_contact_matches_its_closed_form():
    rig = oscillator(Viscous(0.4), damping=0.1, amplitude=1.0)
    curve = trace_frequency(rig, (0.5 * HZ, 1.6 * HZ), harmonics=1)
    Omega = 2 * np.pi * curve.hz
    a = curve["y"].coefficients
    assert a[:, 1] - 1j * a[:, 2] == pytest.approx(1.0 / (1.0 - Omega**2 + 0.5j * Omega), rel=1e-6)


def test_duffing_one_term_closed_form():
    """One-term harmonic balance: (1 - W^2 + 3/4 gamma A^2)^2 A^2 + (d W A)^2 = F^2 (Nayfeh & Mook 1979, ch. 4)."""
    d, F, gamma = 0.1, 0.5, 1.0
    curve = trace_frequency(oscillator(CubicSpring(gamma), damping=d, amplitude=F), (0.5 * HZ, 2.5 * HZ), harmonics=1)
    W, A = 2 * np.pi * curve.hz, curve["y"].amplitude[:, 1]
    balance = ((1.0 - W**2 + 0.75 * gamma * A**2) * A) ** 2 + (d * W * A) ** 2
    assert balance == pytest.approx(np.full_like(W, F**2), rel=1e-8)
    assert len(curve.folds) == 2
    # folds: discriminant of the cubic in A^2, found independently by a dense scan of its real roots
    scan = np.linspace(1.0, 2.4, 28001)
    roots = [np.roots([9 / 16, 1.5 * (1 - w**2), (1 - w**2) ** 2 + (d * w) ** 2, -(F**2)]) for w in scan]
    triple = scan[[np.count_nonzero(np.abs(r.imag) < 1e-9) == 3 for r in roots]]
    assert sorted(2 * np.pi * f for f in curve.folds) == pytest.approx([triple[0], triple[-1]], abs=2e-3)


def test_duffing_peak_of_eight_codes():
    """H = 7, N = 128: eight codes agree on these peaks, max|y| 2.31747 and H1 2.23571 at 2.2115 rad/s."""
    rig = oscillator(CubicSpring(1.0), damping=0.1, amplitude=0.5)
    curve = trace_frequency(rig, (0.5 * HZ, 2.5 * HZ), harmonics=7, samples=128)
    # the largest of 128 samples misses the maximum by up to (pi/128)^2/2 = 3e-4
    assert curve["y"].peak.max() == pytest.approx(2.31747, rel=3e-4)
    first = curve["y"].amplitude[:, 1]
    # the largest of their points; ours are placed at the top
    assert first.max() == pytest.approx(2.23571, rel=2e-4)
    assert 2 * np.pi * curve.hz[first.argmax()] == pytest.approx(2.2115, rel=1e-3)
    assert len(curve.folds) == 2


def den_hartog_amplitude(beta: float, ratio: float) -> float:
    """Den Hartog's exact steady state with dry friction without stops, m = k = F = 1 (Trans. ASME 53, 1931)."""
    V = 1.0 / (1.0 - beta**2)
    U = np.sin(np.pi / beta) / (beta * (1.0 + np.cos(np.pi / beta)))
    return float(np.sqrt(V**2 - (ratio * U) ** 2))


@pytest.mark.parametrize(("beta", "ratio"), [(0.8, 0.2), (0.9, 0.4), (1.2, 0.3)])
def test_set_valued_coulomb_matches_den_hartog(beta, ratio):
    """No spring anywhere in the contact. The force jumps at each reversal, so that the error falls as 1/H."""
    rig = oscillator(Coulomb(ratio), damping=0.0, amplitude=1.0)
    exact = den_hartog_amplitude(beta, ratio)
    errors = [
        abs(steady_state(rig, beta * HZ, harmonics=H, samples=1024).channels["y"].peak - exact) / exact for H in (9, 27)
    ]
    assert errors[1] < 0.005
    assert errors[1] < errors[0] / 2.0


def test_set_valued_coulomb_sticks_exactly():
    """Below the slip force the mass does not move at all; it is not a spring."""
    rig = oscillator(Coulomb(1.5), damping=0.1, amplitude=1.0)
    state = steady_state(rig, 0.9 * HZ, harmonics=9)
    assert np.abs(state.channels["slip"].samples).max() < 1e-9
    assert state.channels["friction"].amplitude[1] == pytest.approx(1.0, abs=1e-9)


def test_lent_compliance_matters_less_than_the_harmonics_left_out():
    rig = oscillator(Coulomb(0.6), damping=0.05, amplitude=1.0)
    reference, finer = (steady_state(rig, 0.5 * HZ, harmonics=H, samples=1024) for H in (9, 19))
    problem = HarmonicBalance(rig, FourierBasis(9, 1024))
    lent = problem.dynamic_lagrangian / 2
    problem.environment = replace(problem.environment, compliance=problem.environment.compliance - lent)
    problem.dynamic_lagrangian -= lent
    lam = problem.lam_at(0.5 * HZ)
    halved = describe(problem, solve_near(problem, lam, reference), lam)
    a, b, c = (p.channels["y"].samples for p in (reference, halved, finer))
    assert 0.0 < np.abs(a - b).max() < np.abs(a - c).max()


@pytest.mark.parametrize("law", [Jenkins(0.52, 4.15e-6), Coulomb(0.52)], ids=lambda law: law.name)
def test_energy_balance_closes_at_every_point(law):
    curve = trace_frequency(beam(law), (44.0, 56.0), harmonics=9)
    assert max(abs(p.energy_error) for p in curve.points) < 1e-6
    assert curve.complete


def test_force_curve_meets_frequency_curve():
    rig = beam()
    by_force = force_response(rig, 46.0, (0.5, 6.5), harmonics=9)
    by_frequency = trace_frequency(rig, (40.0, 46.0), harmonics=9)
    assert by_force.force[-1] == 6.5
    assert by_frequency.hz[-1] == 46.0
    assert by_force["drive"].coefficients[-1] == pytest.approx(by_frequency["drive"].coefficients[-1], abs=1e-12)


@pytest.mark.parametrize("finer", [1, 3, 5, 10])
def test_corner_where_a_second_slip_phase_is_born(finer):
    """A 7:1 superharmonic resonance of mode 3: other codes stall at this corner with fine steps."""
    rig = beam(load_variation=0.0, residual_compliance=False, foreshortening=False)
    curve = trace_frequency(rig, (46.8, 48.6), harmonics=9, step_hz=0.8 / finer)
    assert curve.complete
    assert min(abs(hz - 47.678) for hz in curve.corners) < 1e-3


def test_peak_of_five_codes():
    """Constant load, no foreshortening, no residual compliance: five codes agree on this peak (mm, Hz)."""
    rig = beam(load_variation=0.0, residual_compliance=False, foreshortening=False)
    curve = trace_frequency(rig, (40.0, 80.0), harmonics=9, step_hz=0.2)
    assert curve["drive"].peak.max() * 1e3 == pytest.approx(0.175954, rel=1e-4)
    assert curve.peak.hz == pytest.approx(49.362, abs=5e-3)
    assert curve["drive"].amplitude[:, 1].max() * 1e3 == pytest.approx(0.187409, rel=1e-4)


def test_lift_off_is_reported():
    rig = beam(Viscous(500.0))
    curve = trace_frequency(rig, (46.5, 49.0), harmonics=5)
    ((low, high),) = curve.lift_off
    assert 47.5 < low < high < 48.2
    lowest = np.array([p.channels["normal"].samples.min() for p in curve.points])
    assert np.all((lowest < 0.0) == ((curve.hz >= low) & (curve.hz <= high)))


def test_work_rate_and_loss_of_a_jenkins_loop():
    """Loop area 4 mu R (U - mu R / k_t); the slip travels 4 U a period, on the spring or sliding."""
    point = steady_state(oscillator(Jenkins(0.35, 0.35), damping=0.02, amplitude=1.0), 0.9 * HZ, harmonics=31)
    U = point["slip"].peak
    assert U > 0.5
    assert point.friction_loss == pytest.approx(4 * 0.35 * (U - 0.35), rel=1e-3)  # 512 samples cut the corners
    assert point.work_rate == pytest.approx(point.hz * 4 * U, rel=1e-3)


def test_stuck_coulomb_contact_does_no_work():
    point = steady_state(beam(Coulomb(0.49)), 42.0, harmonics=9)
    assert point["friction"].peak > 30.0
    # against 17 mW of the modal slip, rounding only
    assert point.work_rate < 1e-12
    assert abs(point.friction_loss) < 1e-15


@pytest.mark.parametrize(
    "law",
    [Viscous(20.0), Jenkins(0.52, 4.15e-6), Stribeck(0.57, 0.52, 5e-3, critical_slip=4.15e-6)],
    ids=lambda law: law.name,
)
def test_a_curve_is_known_between_its_points(law) -> None:
    """Beside a fine one it is drawn to the tolerance, in units of sweep and peak."""
    rig, hz = beam(law), (44.0, 56.0)
    curve = trace_frequency(rig, hz, harmonics=9, samples=128)
    fine = trace_frequency(rig, hz, harmonics=9, samples=128, step_hz=12.0 / 500)
    assert len(fine.points) > 5 * len(curve.points)
    scale = np.array([12.0, fine["drive"].peak.max()])
    drawn, true = (np.column_stack([c.hz, c["drive"].peak]) / scale for c in (curve.dense, fine))
    start, along = drawn[:-1], np.diff(drawn, axis=0)
    there = true[:, None] - start
    share = np.clip((there * along).sum(axis=2) / (along**2).sum(axis=1), 0.0, 1.0)
    assert np.linalg.norm(there - share[..., None] * along, axis=2).min(axis=1).max() < CURVE_TOLERANCE
