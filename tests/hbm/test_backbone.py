"""Backbones against closed forms, linear modes, and free decays by time integration."""

from dataclasses import replace

import numpy as np
import pytest
from rigs import CubicSpring, beam, oscillator
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from hbm.figures.backbone import plot_backbone_over_responses, plot_backbones
from hbm.fourier import Array, FourierBasis
from hbm.integration.handover import state_at_phase_zero
from hbm.integration.integrate import simulate
from hbm.modes.accuracy import numerical_change
from hbm.modes.backbone import NonlinearMode, nonlinear_mode, phase_resonance
from hbm.modes.epmc import DriveAmplitude, ForcedMotion, FreeMotion
from hbm.modes.linear import linear_modes, stuck_modes
from hbm.response.trace import steady_state, trace_frequency
from hbm.tracking.peaks import PeakLost, follow_peak
from models import Attachments, Coulomb, Dahl, Frictionless, Jenkins, Rig, Viscous
from models.elements import MidplaneStretching
from models.published import paper_rig
from tests.decay import cycles_of
from tests.slopes import check_motion

DAHL = Dahl(mu=0.5, stiffness=1e7)
JENKINS = Jenkins(mu=0.5, critical_slip=0.5 / 0.37)  # on the unit oscillator a stiffness of 0.37


def lifting(rig: Rig) -> Rig:
    """On a load on which the tip of the test is off its support for most of the period."""
    return replace(rig, contact=replace(rig.contact, normal_load=100.0, lift_off=True))


# ---- the system that is solved


@pytest.mark.parametrize("kind", [FreeMotion, ForcedMotion])
@pytest.mark.parametrize(
    "rig",
    [
        beam(DAHL),
        replace(beam(DAHL), elements=(MidplaneStretching(1e6),)),
        replace(beam(DAHL), attachments=Attachments(clamp_stiffness=1e4, clamp_limit=3.0)),
        beam(Coulomb(mu=0.5)),
        lifting(beam(DAHL)),
    ],
    ids=["dahl", "elements", "clamp", "set-valued", "lift-off"],
)
def test_derivative_of_the_residual(rig: Rig, kind: type[DriveAmplitude]) -> None:
    check_motion(kind(rig, FourierBasis(3, 64)), -3.7)


# ---- closed forms


def test_linear_beam_has_its_frequencies_and_damping_at_any_amplitude() -> None:
    rig = beam(Frictionless())
    exact = linear_modes(rig)
    for mode in (1, 2):
        found = nonlinear_mode(rig, mode, amplitudes=(1e-5, 1e-3), harmonics=3)
        assert found.complete
        np.testing.assert_allclose(found.hz, exact.sliding_hz[mode - 1], rtol=1e-10)
        np.testing.assert_allclose(found.damping_ratio, exact.damping_ratio[mode - 1], rtol=1e-6)
        np.testing.assert_allclose(found.decay_rate, 0.3, rtol=1e-6)  # alpha / 2
        np.testing.assert_allclose(found.participation[:, mode - 1], 1.0, rtol=1e-9)


def test_linear_phase_resonance_has_the_force_of_the_closed_form() -> None:
    found = phase_resonance(oscillator(Viscous(0.1), damping=0.06, amplitude=1.0), amplitudes=(0.1, 10.0), harmonics=3)
    np.testing.assert_allclose(2 * np.pi * found.hz, 1.0, rtol=1e-6)  # samples of the dashpot
    np.testing.assert_allclose(found.force, 0.16 * found.amplitude, rtol=1e-4)
    np.testing.assert_allclose(found.damping_ratio, 0.08, rtol=1e-4)


def _duffing(amplitude: Array, gamma: float) -> Array:
    """Frequency of y'' + y + gamma y^3 = 0 at the largest y."""
    hardening = gamma * amplitude**2
    return np.asarray(np.pi * np.sqrt(1 + hardening) / (2 * ellipk(hardening / (2 * (1 + hardening)))))


def test_duffing_backbone_is_the_elliptic_integral() -> None:
    rig = oscillator(CubicSpring(1.0), damping=0.02, amplitude=1.0)
    found = nonlinear_mode(rig, amplitudes=(0.01, 3.0))
    crest = np.array([p["drive"].samples.max() for p in found.points])  # the samples meet it: the motion is symmetric
    np.testing.assert_allclose(2 * np.pi * found.hz, _duffing(crest, 1.0), rtol=1e-9)
    np.testing.assert_allclose(4 * np.pi * found.hz * found.damping_ratio, 0.02, rtol=1e-7)


def test_midplane_stretching_backbone_is_the_elliptic_integral() -> None:
    rig = replace(beam(Frictionless(), modes=1), elements=(MidplaneStretching(2e6),))
    s = rig.structure
    found = nonlinear_mode(rig, amplitudes=(1e-4, 3e-2), harmonics=7)
    crest = np.array([np.abs(p["drive"].samples).max() for p in found.points]) / s.excitation[0]
    gamma = 1e6 * s.shortening[0, 0] ** 2 / s.omega_n[0] ** 2
    assert gamma * crest[-1] ** 2 > 1.0  # far beyond its linear range
    np.testing.assert_allclose(2 * np.pi * found.hz / s.omega_n[0], _duffing(crest, gamma), rtol=1e-5)


def _jenkins(A: Array) -> tuple[Array, Array]:
    """Frequency of the oscillator with one Jenkins element by its describing function, and energy lost in a period."""
    k, u_crit = 0.37, 0.5 / 0.37
    theta = np.arccos(1 - 2 * u_crit / np.maximum(A, u_crit))
    stiffness = np.where(A > u_crit, k / np.pi * (theta - np.sin(2 * theta) / 2), k)
    Omega = np.sqrt(1 + stiffness)
    return Omega, 4 * 0.5 * np.maximum(A - u_crit, 0.0) + np.pi * 0.002 * Omega * A**2


@pytest.fixture(scope="module")
def jenkins() -> NonlinearMode:
    rig = oscillator(JENKINS, damping=0.002, amplitude=1.0)
    return nonlinear_mode(rig, amplitudes=(0.5, 200.0), harmonics=1, samples=2048)


def test_jenkins_oscillator_of_one_harmonic_has_its_describing_function(jenkins: NonlinearMode) -> None:
    found, A, u_crit = jenkins, jenkins.amplitude, 0.5 / 0.37
    Omega, loss = _jenkins(A)
    np.testing.assert_allclose(2 * np.pi * found.hz, Omega, rtol=1e-5)  # samples
    np.testing.assert_allclose(found.lost, loss, rtol=1e-4)
    np.testing.assert_allclose(found.damping_ratio, loss / (2 * np.pi * (Omega * A) ** 2), rtol=1e-4)
    assert A[np.argmax(found.damping_ratio)] == pytest.approx(2 * u_crit, rel=0.15)  # of the friction alone, about


# ---- the beam


def test_drawn_damping_is_the_closed_form_between_the_motions_too(jenkins: NonlinearMode) -> None:
    """Straight lines between the motions that were solved are 1.5 % off; one backbone needs no list."""
    _, damping, _ = plot_backbones(jenkins)
    line = max(damping.lines, key=lambda line: len(line.get_xdata()))
    A = np.geomspace(1.5, 190.0, 1000)  # beyond the kink where slip begins
    Omega, loss = _jenkins(A)
    drawn = np.exp(np.interp(np.log(A), np.log(line.get_xdata()), np.log(line.get_ydata())))
    np.testing.assert_allclose(drawn, 100 * loss / (2 * np.pi * (Omega * A) ** 2), rtol=2e-3)


def test_drawn_responses_are_the_closed_form_between_their_points_too() -> None:
    """Straight lines between the points that were solved are 10 % off beside this resonance.

    The curve is within 1.5e-3 of the motion, and lines within 1e-3 of the curve, along and across it: some times that
    on the flanks of a resonance of 3 %.
    """
    curve = trace_frequency(oscillator(Frictionless(), damping=0.06, amplitude=1.0), (0.1, 0.25), harmonics=3)
    (line,) = plot_backbone_over_responses([], [curve]).lines
    hz = np.linspace(0.1, 0.25, 1000)
    w = 2 * np.pi * hz
    drawn = np.interp(hz, line.get_xdata(), line.get_ydata())
    np.testing.assert_allclose(drawn, 1.0 / np.abs(1.0 - w**2 + 0.06j * w), rtol=1e-2)


@pytest.fixture(scope="module")
def mode() -> NonlinearMode:
    return nonlinear_mode(beam(), amplitudes=(1e-6, 1.2e-3), harmonics=11)


def test_stick_limit_is_the_stuck_mode(mode: NonlinearMode) -> None:
    rig = mode.rig
    omega, shapes = stuck_modes(rig)
    assert mode.hz[0] == pytest.approx(omega[0] / (2 * np.pi), rel=1e-7)
    assert mode.damping_ratio[0] == pytest.approx(
        float(shapes[:, 0] @ (rig.structure.damping * shapes[:, 0])) / (2 * omega[0]), rel=1e-6
    )
    assert mode.rubbed[0] < 1e-9 * mode.lost[0]


def test_slip_limit_is_the_sliding_mode() -> None:
    rig = beam(modes=2, load_variation=0.0, foreshortening=False)
    slides = nonlinear_mode(rig, amplitudes=(2e-4, 1e-1), harmonics=9).at([1e-1])
    exact, P = linear_modes(rig), rig.contact.normal_load
    assert slides.hz[0] == pytest.approx(exact.sliding_hz[0], rel=1e-4)
    slip = slides.points[0]["slip"].peak
    assert slides.rubbed[0] == pytest.approx(4 * 0.52 * P * (slip - 4.15e-6), rel=1e-3)  # Coulomb's loop
    assert slides.damping_ratio[0] - exact.damping_ratio[0] == pytest.approx(
        slides.rubbed[0] / (2 * np.pi * (slides.lost[0] / (2 * np.pi * slides.damping_ratio[0]))), rel=1e-3
    )


def test_onset_of_slip_is_bracketed_by_motions() -> None:
    """There the damping has a corner: a step of 9 % over it drew slip at amplitudes at which the contact sticks."""
    found = nonlinear_mode(paper_rig(), amplitudes=(1e-6, 2e-4))
    slips = found.rubbed > 1e-6 * found.lost
    first = int(np.argmax(slips))
    assert not slips[:first].any()
    assert found.amplitude[first] < 1.01 * found.amplitude[first - 1]


def test_figure_shows_the_linear_limits(mode: NonlinearMode) -> None:
    frequency, damping, _ = plot_backbones([mode])
    linear = linear_modes(mode.rig)
    for ax, limits in ((frequency, (linear.stuck_hz[0], linear.sliding_hz[0])), (damping, ())):
        drawn = {float(np.ravel(line.get_ydata())[0]): len(line.get_xdata()) for line in ax.lines}
        assert max(drawn.values()) == len(mode.dense.points)
        assert all(any(y == pytest.approx(limit) for y in drawn) for limit in limits)
    np.testing.assert_allclose(frequency.lines[-1].get_xdata(), 1e3 * mode.dense.amplitude)


def test_each_limit_has_its_own_label(mode: NonlinearMode) -> None:
    """Beside its line however close the other is: the damping of this mode is less when it slides."""
    frequency, damping, _ = plot_backbones([mode])
    frequency.figure.canvas.draw()
    for ax in (frequency, damping):
        labels = sorted((text for text in ax.texts if text.get_text().strip() != "lift-off"), key=lambda t: t.xy[1])
        assert {label.get_text() for label in labels} == set(mode.rig.limits)
        below, above = (label.get_window_extent() for label in labels)
        lower, upper = (ax.transData.transform((1.0, label.xy[1]))[1] for label in labels)
        assert below.y1 <= lower + 1.0 and above.y0 >= upper - 1.0
    held = {text.get_text(): text.xy[1] for text in damping.texts}[mode.rig.limits[0]]
    assert held == pytest.approx(100 * mode.damping_ratio[0], rel=1e-4)


def test_windows_of_a_linear_mode_do_not_make_its_frequencies_look_apart() -> None:
    rig = beam(Frictionless())
    frequency, damping, response = plot_backbones([nonlinear_mode(rig, amplitudes=(1e-6, 1e-5), harmonics=3)])
    frequency.figure.draw_without_rendering()
    for axis in (frequency.yaxis, damping.yaxis, response.xaxis):
        low, high = axis.get_view_interval()
        assert high / low > 1.0009
        assert not axis.get_offset_text().get_text()


def test_what_is_lost_is_friction_and_damping(mode: NonlinearMode) -> None:
    for p, lost, rubbed in zip(mode.points, mode.lost, mode.rubbed, strict=True):
        Omega = 2 * np.pi * p.hz
        velocity = Omega * p.basis.derivative(p.state.Q)
        damped = np.pi / Omega * float(np.sum(mode.rig.structure.damping * velocity**2))
        assert lost == pytest.approx(damped + rubbed, rel=2e-3)  # the loop's area by samples
    shares = mode.rubbed / mode.lost
    assert shares.max() > 0.9


def test_free_decay_while_the_contact_slides(mode: NonlinearMode) -> None:
    """Amplitude and frequency over time, from a millimetre to a third of it: damping ratio 1 to 3 %."""
    start = mode.at([1e-3])
    history = simulate(mode.rig, start.hz[0], level=0.0, duration=0.24, start=state_at_phase_zero(start.points[0]))
    cycles = cycles_of(history.time, history.channels["drive"].values)
    amplitudes = np.geomspace(3e-4, 1e-3, 12)
    along = mode.at(amplitudes)
    rate = np.interp(np.log(cycles[:, 2]), np.log(amplitudes), along.decay_rate)
    hz = np.interp(np.log(cycles[:, 2]), np.log(amplitudes), along.hz)
    inside = slice(1, -1)
    measured = -(np.log(cycles[2:, 2]) - np.log(cycles[:-2, 2])) / (cycles[2:, 0] - cycles[:-2, 0])
    # averaging neglects the square of the change per cycle, (2 pi D)^2 / 2: 0.2 to 2 %
    np.testing.assert_allclose(measured, rate[inside], rtol=0.05)
    assert np.median(measured / rate[inside]) == pytest.approx(1.0, abs=0.015)
    np.testing.assert_allclose(cycles[:, 1], hz, rtol=2.5e-3)


def test_no_decay_rate_where_the_drive_does_not_stand_for_the_motion(mode: NonlinearMode) -> None:
    """Beside the internal resonance near 54 Hz, where the branch turns back; there is one where a mode is alone."""
    told = ~np.isnan(mode.decay_rate)
    by_loss = 2 * np.pi * mode.hz * mode.damping_ratio
    assert len(mode.folds) > 2 and 0.0 < told.mean() < 1.0
    assert told[mode.amplitude < 2e-5].all() and told[mode.amplitude > 1e-4].all()
    assert (mode.decay_rate[told] > 0.0).all() and (mode.decay_rate[told] < 2.5 * by_loss[told]).all()
    single = nonlinear_mode(oscillator(JENKINS, damping=1e-4, amplitude=1.0), amplitudes=(4.0, 66.0))
    assert np.isfinite(single.decay_rate).all()


def test_modes_are_not_refined_where_all_are_kept(mode: NonlinearMode) -> None:
    single = nonlinear_mode(oscillator(JENKINS, damping=1e-4, amplitude=1.0), amplitudes=(4.0, 8.0), harmonics=3)
    change = numerical_change(single)
    assert change.modes is None and set(change.by_source) == {"harmonics", "samples"}
    assert np.isfinite(numerical_change(mode, 0).modes).all()


def test_free_decay_while_the_contact_sticks(mode: NonlinearMode) -> None:
    start = mode.at([1e-5])
    history = simulate(mode.rig, start.hz[0], level=0.0, duration=0.4, start=state_at_phase_zero(start.points[0]))
    cycles = cycles_of(history.time, history.channels["drive"].values)
    rate = -np.polyfit(cycles[:, 0], np.log(cycles[:, 2]), 1)[0]
    assert np.mean(cycles[:, 1]) == pytest.approx(start.hz[0], rel=1e-4)
    assert rate == pytest.approx(start.decay_rate[0], rel=0.02)


def test_free_decay_of_a_jenkins_oscillator() -> None:
    """The time at which the amplitude has fallen to a tenth, by the decay rate and by marching."""
    rig = oscillator(JENKINS, damping=1e-4, amplitude=1.0)
    mode = nonlinear_mode(rig, amplitudes=(4.0, 66.0))
    start, amplitudes = mode.at([60.0]), np.geomspace(5.0, 60.0, 25)
    along = mode.at(amplitudes)

    def fall(_: float, log: Array) -> Array:
        return np.asarray(-np.interp(log, np.log(amplitudes), along.decay_rate))

    history = simulate(rig, start.hz[0], level=0.0, duration=185.0, start=state_at_phase_zero(start.points[0]))
    cycles = cycles_of(history.time, history.channels["drive"].values)
    predicted = solve_ivp(fall, (0.0, 185.0), [np.log(60.0)], t_eval=cycles[:, 0], rtol=1e-8).y[0]
    late = cycles[:, 2] > 6.0
    np.testing.assert_allclose(cycles[late, 2], np.exp(predicted[late]), rtol=0.06)
    early = cycles[:, 2] > 15.0
    np.testing.assert_allclose(cycles[early, 2], np.exp(predicted[early]), rtol=0.015)


# ---- phase resonance and peaks


def test_phase_resonance_lies_on_the_frequency_response() -> None:
    rig = beam(modes=2)
    backbone = phase_resonance(rig, amplitudes=(1e-6, 4e-4), harmonics=7).at([3e-5, 1e-4, 3e-4])
    for p, force in zip(backbone.points, backbone.force, strict=True):
        assert p.level == pytest.approx(force, rel=1e-9)
        again = steady_state(rig, p.hz, level=p.level, harmonics=7, start=p)
        np.testing.assert_allclose(again["drive"].coefficients, p["drive"].coefficients, atol=1e-7 * p["drive"].peak)
        assert abs(again["drive"].coefficients[1]) < 1e-7 * p["drive"].peak  # in quadrature


def test_force_of_the_nonlinear_mode_is_that_of_phase_resonance() -> None:
    rig = beam(modes=1)  # no other mode to take part
    amplitudes = (1e-5, 1e-4, 5e-4)
    free, forced = (
        trace(rig, amplitudes=(1e-6, 6e-4), harmonics=9).at(amplitudes) for trace in (nonlinear_mode, phase_resonance)
    )
    np.testing.assert_allclose(free.force, forced.force, rtol=0.02)
    # at 5 % damping the two differ: the force acts in the fundamental, the damping taken away in every harmonic
    np.testing.assert_allclose(free.hz, forced.hz, rtol=6e-3)


def test_motion_at_a_force() -> None:
    backbone = phase_resonance(beam(modes=1), amplitudes=(1e-6, 3e-4), harmonics=5)
    found = backbone.at_force([0.5, 2.0])
    np.testing.assert_allclose(found.force, [0.5, 2.0], rtol=1e-9)
    assert found.complete
    unknown = "numerical error not estimated here, but by numerical_change(it)"
    assert str(found).endswith(f" Hz; each solved at its amplitude or force; {unknown}")
    assert str(backbone).endswith(f" Hz; {backbone.branch.message}; {unknown}")
    with pytest.raises(
        ValueError, match=r"backbone: (amplitude|force) = \S+ (m|N); must lie between \S+ and \S+ (m|N)$"
    ):
        backbone.at_force([1e3])


def test_peak_of_an_oscillator_is_the_closed_form() -> None:
    rig = oscillator(Frictionless(), damping=0.2, amplitude=1.0)
    peaks = follow_peak(rig, [0.1, 0.15, 0.2], "damping.mass_proportional", channel="y", harmonics=1)
    D = peaks.values / 2
    np.testing.assert_allclose(2 * np.pi * peaks.hz, np.sqrt(1 - 2 * D**2), rtol=1e-6)
    np.testing.assert_allclose(peaks.height, 1 / (2 * D * np.sqrt(1 - D**2)), rtol=1e-6)
    np.testing.assert_allclose(peaks.slope, -(1 - 2 * D**2) / (4 * D**2 * (1 - D**2) ** 1.5), rtol=1e-4)


def test_peak_followed_against_load_is_the_top_of_the_response() -> None:
    rig, H = beam(modes=1), 5
    start = steady_state(rig, 50.0, harmonics=H)
    peaks = follow_peak(rig, [83.0, 95.0], "contact.normal_load", start=start, harmonics=H)
    there = replace(rig, contact=replace(rig.contact, normal_load=95.0))
    beside = [
        steady_state(there, peaks.hz[-1] + off, harmonics=H, start=peaks.points[-1])["drive"].peak
        for off in (-0.1, -0.03, 0.03, 0.1)
    ]
    assert max(beside) < peaks.height[-1]
    assert min(beside) > 0.98 * peaks.height[-1]  # near enough to see a top
    rise = (peaks.height[1] - peaks.height[0]) / 12.0
    assert min(peaks.slope) < rise < max(peaks.slope) < 0.0


def test_a_peak_that_is_lost_carries_what_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    number = Rig.with_number

    def cut(rig: Rig, key: str, value: float) -> Rig:
        if value > 90.0:
            raise ArithmeticError("no such load")
        return number(rig, key, value)

    rig = beam(modes=1)
    start = steady_state(rig, 50.0, harmonics=3)
    monkeypatch.setattr(Rig, "with_number", cut)
    with pytest.raises(PeakLost, match=r"no such load; contact\.normal_load reached 90 on the way to 95") as lost:
        follow_peak(rig, [83.0, 87.0, 95.0], "contact.normal_load", start=start, harmonics=3)
    peaks = lost.value.peaks
    assert list(peaks.values) == [83.0, 87.0, 90.0]  # half steps from 87 to 95, and a half of the second
    assert len(peaks.points) == len(peaks.slope) == 3


def test_amplitudes_and_modes_are_checked() -> None:
    with pytest.raises(ValueError, match=r"amplitudes 0\.001 to 0\.0001 m; must be > 0 and grow"):
        nonlinear_mode(beam(), amplitudes=(1e-3, 1e-4))
    with pytest.raises(ValueError, match="mode = 6; must be from 1 to 5"):
        nonlinear_mode(beam(), 6)
