"""A body with joints under a force of many lines: the balance without a dense matrix, its derivatives, diagnosis."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hbm import diagnose, joint_sensitivities, steady_state
from hbm.balance.lines import LineBalance
from hbm.diagnosis.calibrate import trusted
from hbm.diagnosis.jointscan import Scanned
from hbm.diagnosis.shortlist import elsewhere, hopeful
from hbm.files.diagnosed import Diagnosed
from hbm.files.diagnosisplates import diagnosis_plates
from hbm.fourier import MANY, Array, FourierBasis, sampled
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from hbm.outputerror.fit import fit_model
from hbm.outputerror.lines import ROUGH, line_campaign
from hbm.sensitivity.lines import line_changes
from models.bodies.modal import ModalModel
from models.causes.addedjoint import AddedJoint
from models.causes.joints import CubicStiffness, JointSlip, LocalSpring, QuinticStiffness, TwoSidedStop
from models.friction import Dahl, Iwan, Jenkins
from models.jointed import JointedRig
from models.joints import Clearance, CubicSpring, Dashpot, Friction, Joint, JointLaw, PolynomialSpring
from models.parts import Channel, Damping, Excitation

LINES = (1, 2, 3, 5, 6, 8, 11)
LAWS = (
    CubicSpring(4e8),
    Clearance(5e4, 1e-5),
    Friction(Jenkins(1.0, 2e-6), 0.8),
    Friction(Iwan(1.0, 3e5, elements=4), 0.8),
    Friction(Dahl(1.0, 3e5), 0.8),
)


def two_modes(*joints: Joint) -> JointedRig:
    """A body of two modes with three places."""
    body = ModalModel((31.0, 74.0), {"a": (0.9, 1.1), "b": (0.8, -1.2), "drive": (0.5, 0.3)})
    channels = (Channel("force", "force", at="drive"), Channel("x", "acceleration", at="a"))
    return JointedRig("two modes", body, Damping(modal_ratios=(0.02,)), joints, Excitation(3.0, at="drive"), channels)


def force_of(basis: FourierBasis, seed: int, lines: Array, size: float) -> Array:
    """Coefficients of a force with random phases on some lines."""
    phase, out = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(lines)), np.zeros(basis.size)
    out[lines], out[basis.H + lines] = size * np.cos(phase), size * np.sin(phase)
    return out


@pytest.fixture(params=LAWS, ids=lambda law: type(getattr(law, "law", law)).__name__)
def both(request: pytest.FixtureRequest) -> tuple[LineBalance, JointedRig]:
    """The balance of lines, and the same rig with the lines as harmonics of its force, of each law."""
    law: JointLaw = request.param
    return in_both(Joint("j", law, ("a",), ("b",)))


def in_both(*joints: Joint) -> tuple[LineBalance, JointedRig]:
    """The balance of lines with some joints, and the same rig with the lines as harmonics of its force."""
    rig, basis = two_modes(*joints), FourierBasis(24, 256)
    force = force_of(basis, 4, np.array(LINES), 0.7)
    unit = np.hypot(force[1], force[25])
    turn = np.exp(1j * np.arange(25) * np.angle(force[1] + 1j * force[25]))  # the dense balance has a cosine first
    turned = basis.real(basis.complex(force) * turn)
    tones = tuple((k, float(turned[k] / unit), float(turned[24 + k] / unit)) for k in LINES[1:])
    dense = replace(rig, excitation=replace(rig.excitation, amplitude=float(unit), harmonics=tones))
    return LineBalance(rig, basis, 9.0, turned), dense


def test_lines_and_the_dense_balance_have_one_solution(both: tuple[LineBalance, JointedRig]) -> None:
    lines, dense = both
    expected = steady_state(dense, 9.0, harmonics=24, samples=256).state
    found = lines.solved().state
    np.testing.assert_allclose(found.T, expected.T, atol=1e-7 * np.abs(expected.T).max())
    np.testing.assert_allclose(found.Q, expected.Q, atol=1e-7 * np.abs(expected.Q).max())


def test_derivatives_are_those_of_the_dense_balance(both: tuple[LineBalance, JointedRig]) -> None:
    lines, dense = both
    here, law = lines.solved(), [key for key in dense.numbers if key.startswith("joints.j.")]
    keys = ["modal.frequencies_hz[2]", "damping.modal_ratios[1]", "modal.ports.a[1]", "modal.ports.drive[2]", *law]
    solution = steady_state(dense, 9.0, harmonics=24, samples=256)
    expected = joint_sensitivities(dense, solution, keys)
    Q, T = line_changes(here, keys)
    for found, known in ((Q, expected.Q), (T, expected.T)):
        size = np.abs(known).max(axis=(0, 1))
        np.testing.assert_allclose(found / size, known / size, atol=2e-5)


def test_the_derivative_to_the_force_is_that_to_the_share_of_all_lines(both: tuple[LineBalance, JointedRig]) -> None:
    lines, dense = both
    expected = joint_sensitivities(dense, steady_state(dense, 9.0, harmonics=24, samples=256), ["excitation.amplitude"])
    for found, known in zip(
        line_changes(lines.solved(), ["excitation.amplitude"]), (expected.Q, expected.T), strict=True
    ):
        share = known * dense.excitation.amplitude
        np.testing.assert_allclose(found, share, atol=2e-5 * np.abs(share).max())


def test_springs_and_dashpots_beside_friction_answer_exactly() -> None:
    """They are eliminated: what is looked for is the friction alone, or nothing where there is none."""
    linear = Joint("held", PolynomialSpring(linear=-1e5), ("a",), ("b",)), Joint("d", Dashpot(4.0), ("a",))
    for joints in ((Joint("j", Friction(Iwan(1.0, 3e5, elements=4), 0.8), ("a",), ("b",)), *linear), linear):
        lines, dense = in_both(*joints)
        here, solution = lines.solved(), steady_state(dense, 9.0, harmonics=24, samples=256)
        np.testing.assert_allclose(here.state.T, solution.state.T, atol=1e-7 * np.abs(solution.state.T).max())
        keys = ["modal.frequencies_hz[2]", "modal.ports.a[1]", *(k for k in dense.numbers if k.startswith("joints."))]
        expected = joint_sensitivities(dense, solution, [key for key in keys if dense.number(key)])
        for found, known in zip(line_changes(here, expected.parameters), (expected.Q, expected.T), strict=True):
            size = np.abs(known).max(axis=(0, 1))
            np.testing.assert_allclose(found / size, known / size, atol=2e-5)


def test_rough_derivatives_are_near_the_exact_ones(both: tuple[LineBalance, JointedRig]) -> None:
    here, keys = both[0].solved(), ["modal.frequencies_hz[2]", "modal.ports.a[1]"]
    for rough, exact in zip(line_changes(here, keys, ROUGH), line_changes(here, keys), strict=True):
        np.testing.assert_allclose(rough, exact, atol=1e-2 * np.abs(exact).max())


def test_a_body_that_may_drift_has_the_mean_of_its_springs_alone() -> None:
    rig, basis = two_modes(Joint("j", CubicSpring(4e8), ("a",), ("b",))), FourierBasis(24, 256)
    free = replace(rig, body=ModalModel((0.0, 74.0), {"a": (0.9, 1.1), "b": (0.9, -1.2), "drive": (0.5, 0.3)}))
    state = LineBalance(free, basis, 9.0, force_of(basis, 4, np.array(LINES), 0.7)).solved().state
    k = basis.k[1:, None] * state.Omega
    inertia = -(k[:, 0] ** 2) * state.Q[1:, 0]
    pushed = (
        force_of(basis, 4, np.array(LINES), 0.7)[1:] * 0.5
    )  # the spring between places that move alike does nothing
    np.testing.assert_allclose(inertia, pushed, atol=1e-9)
    assert state.Q[0, 0] == 0.0


@pytest.mark.parametrize("H", [3, MANY + 1])
def test_samples_and_coefficients_are_those_of_the_matrices(H: int) -> None:
    basis, rng = sampled(H, 16), np.random.default_rng(1)
    c = rng.standard_normal((basis.size, 2))
    np.testing.assert_allclose(basis.samples(c), basis.synthesis @ c, atol=1e-10)
    s = rng.standard_normal((basis.N_t, 2))
    np.testing.assert_allclose(basis.coefficients(s), basis.analysis @ s, atol=1e-12)


# ------------------------------------------------------------------------------------------------ in time, diagnosed

HZ, H, F_N, RATIO, ROW = 0.5, 221, 33.0, 0.04, 1.3
"""Base frequency, lines, and the one mode of an oscillator."""


def marched(forces: Array, hidden: Callable[[Array], Array]) -> Array:
    """Displacements (records, 1024) of the oscillator over its second period under forces, integrated in time."""
    t = np.arange(1024) / 1024 / HZ
    w, phase, records = 2 * np.pi * F_N, 2 * np.pi * HZ * np.arange(H + 1), len(forces)
    c = np.hstack([forces[:, :1], forces[:, 1 : H + 1] - 1j * forces[:, H + 1 :]])

    def rate(now: float, y: Array) -> Array:
        q, v = y[:records], y[records:]
        F = (c @ np.exp(1j * phase * now)).real
        return np.concatenate([v, ROW * (F + hidden(ROW * q)) - 2 * RATIO * w * v - w**2 * q])

    start, times = np.zeros(2 * records), t + 1 / HZ
    found = solve_ivp(rate, (0.0, 2 / HZ), start, t_eval=times, rtol=1e-8, atol=1e-11, method="DOP853")
    return np.asarray(ROW * found.y[:records])


def oscillator(hz: float = F_N) -> JointedRig:
    """The linear rig."""
    channels = (Channel("force", "force", at="m"), Channel("x", "displacement", at="m"))
    body = ModalModel((hz,), {"m": (ROW,)})
    return JointedRig("oscillator", body, Damping(modal_ratios=(RATIO,)), (), Excitation(1.0, at="m"), channels)


def measured(hidden: Callable[[Array], Array], noise: float) -> MeasuredSpectra:
    """Five records of an odd multisine at two levels."""
    basis, rng, lines = FourierBasis(H, 1024), np.random.default_rng(7), np.arange(1, H + 1, 2)
    forces = np.array([force_of(basis, seed, lines, size) for seed, size in enumerate((4.0, 4.0, 8.0, 8.0, 8.0))])
    x = basis.coefficients(marched(forces, hidden).T).T
    std = np.full((5, H + 1), np.nan)
    std[:, lines] = noise * np.sqrt(np.mean(x**2))
    blank = np.isnan(np.concatenate([std, std[:, 1:]], axis=1))
    x = np.where(blank, np.nan, x + rng.standard_normal(x.shape) * noise * np.sqrt(np.mean(x**2)))
    exact = np.where(np.isnan(std), np.nan, 1e-9)
    force = np.where(blank, np.nan, forces)
    level = np.array([4.0, 4.0, 8.0, 8.0, 8.0])
    return spectra_of(oscillator(), np.full(5, HZ), level, {"force": force, "x": x}, {"force": exact, "x": std})


def test_lines_agree_with_integration_in_time() -> None:
    k3, lines, basis = 2e7, np.arange(1, H + 1, 2), FourierBasis(3 * H, 4096)  # the cube has lines up to three times
    (expected,) = marched(force_of(FourierBasis(H, 1024), 3, lines, 8.0)[None], lambda u: -k3 * u**3)
    force = force_of(basis, 3, lines, 8.0)
    rig = replace(oscillator(), joints=(Joint("k", CubicSpring(k3), ("m",)),))
    found = ROW * basis.samples(LineBalance(rig, basis, HZ, force).solved().state.Q)[::4, 0]
    linear = ROW * basis.samples(LineBalance(oscillator(), basis, HZ, force).solved().state.Q)[::4, 0]
    assert np.linalg.norm(linear - expected) > 0.1 * np.linalg.norm(expected)  # the spring matters
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_records_of_other_base_frequencies_are_solved_on_their_own_lines() -> None:
    """Far off, they are also solved from nothing, in case what was measured leads elsewhere."""
    basis, hz, rng = FourierBasis(2 * H, 2048), np.array([HZ, HZ / 2]), np.random.default_rng(3)
    tops, force, x = (H, 2 * H), np.full((2, basis.size), np.nan), np.full((2, basis.size), np.nan)
    for i, top in enumerate(tops):
        lines = np.concatenate([np.arange(1, top + 1), basis.H + np.arange(1, top + 1)])
        driven = force_of(basis, i, np.arange(1, top + 1), 1.0)
        response = ROW * LineBalance(oscillator(), basis, hz[i], driven).solved().state.Q[:, 0]
        noise = 1e-3 * np.sqrt(np.mean(response[lines] ** 2)) * rng.standard_normal(len(lines))
        force[i, lines], x[i, lines] = driven[lines], response[lines] + noise
    std = np.where(np.isnan(x[:, : basis.H + 1]), np.nan, 1e-3 * np.sqrt(np.nanmean(x**2, axis=1))[:, None])
    spectra = spectra_of(oscillator(), hz, np.ones(2), {"force": force, "x": x}, {"force": std * 0.0 + 1e-9, "x": std})
    model = trusted(oscillator(1.03 * F_N), ("x",), {"modal.frequencies_hz[1]": 0.03})
    found = fit_model(model, line_campaign(oscillator(1.03 * F_N), spectra), model.start, {})
    assert not found.missing
    assert found.white.chi2 == pytest.approx(len(found.white), rel=0.2)
    fitted = found.model.rig(found.x).number("modal.frequencies_hz[1]")
    assert fitted == pytest.approx(F_N, rel=1e-4)


def test_a_cubic_spring_is_named_from_lines() -> None:
    rig, spectra = oscillator(F_N * 1.004), measured(lambda u: -2e7 * u**3, 0.02)
    found = diagnose(rig, spectra, held_out=[2, 5])
    assert (found.verdict, found.cause, found.parameters["at"].value) == ("cause-found", "cubic-stiffness", "m")
    k3 = found.parameters["cubic"]
    assert isinstance(k3.value, float)
    assert abs(k3.value - 2e7) < 3 * k3.std < 0.3 * 2e7
    assert found.held_out_records == (2, 5)
    assert found.gain["held_out_nrmse_ratio"] < 0.3
    assert found.extended is not None
    assert found.extended.number("modal.frequencies_hz[1]") == pytest.approx(F_N, rel=2e-3)
    plates = {plate.name: plate for plate in diagnosis_plates(Diagnosed(found, rig, spectra))}
    assert list(plates) == ["lines", "gain", "ranking"]
    assert "record 2, which no fit has seen" in plates["lines"].caption
    rows = plates["lines"].columns
    (ax,) = plates["lines"].axes
    shown = rows["record"] == 2
    assert ax.get_ylim()[1] > np.abs(rows["measured_real"][shown] + 1j * rows["measured_imag"][shown]).max()
    for model, errors in found.errors.items():  # what is drawn is what the errors are made of
        own = (rows["model"] == model) & rows["held_out"]
        y, x = (rows[f"{what}_real"][own] + 1j * rows[f"{what}_imag"][own] for what in ("measured", "simulated"))
        assert np.linalg.norm(y - x) / np.linalg.norm(y) == pytest.approx(errors["held_out"].nrmse, rel=1e-6)


def test_no_cause_is_found_where_another_would_be_but_for_a_tolerance() -> None:
    """The frequency of the rig file is 2 % off, four of its tolerances: a stop looks like the spring within them."""
    rig, spectra = oscillator(F_N * 1.02), measured(lambda u: -2e7 * u**3, 0.02)
    found = diagnose(rig, spectra, held_out=[2, 5], causes=[CubicStiffness, TwoSidedStop])
    assert (found.verdict, found.cause) == ("main-cause", "two-sided-stop")
    (line,) = (line for line in found.evidence if "tolerances reach" in line)
    assert re.match(r"cubic-stiffness m alone would leave 1\.3 % where modal\.frequencies_hz\[1\] is 33\.00", line)
    known = dict.fromkeys(["modal.frequencies_hz[1]"], 0.02)
    again = diagnose(rig, spectra, held_out=[2, 5], causes=[CubicStiffness, TwoSidedStop], tolerances=known)
    assert (again.verdict, again.cause) == ("cause-found", "cubic-stiffness")


def test_quiet_lines_where_nothing_was_excited_do_not_outweigh_all_others() -> None:
    """Even lines that no cause of these makes: small, and of a noise that is smaller still."""
    found, even = measured(lambda u: -2e7 * u**3, 0.02), np.arange(2, H + 1, 2)
    i, rng = found.index("x"), np.random.default_rng(11)
    rms = float(np.sqrt(np.nanmean(found.coefficients[:, i] ** 2)))
    coefficients, std = found.coefficients.copy(), found.std.copy()
    for k in (even, H + even):
        coefficients[:, i, k] = 2e-3 * rms * rng.standard_normal((5, len(even)))
        coefficients[:, found.index("force"), k] = 0.0
    std[:, i, even], std[:, found.index("force"), even] = 2e-5 * rms, 1e-9
    diagnosis = diagnose(
        oscillator(F_N * 1.004),
        replace(found, coefficients=coefficients, std=std),
        held_out=[2, 5],
        causes=[CubicStiffness, LocalSpring],
    )
    assert diagnosis.cause == "cubic-stiffness"
    assert min(diagnosis.remainder.explained.values()) > 0.9


def test_nothing_is_named_where_lines_are_noise() -> None:
    found = diagnose(oscillator(F_N * 1.004), measured(lambda u: 0.0 * u, 0.02), held_out=[2, 5])
    assert (found.verdict, found.cause) == ("consistent", None)
    assert not found.remainder.structured


def test_nested_laws_and_many_places_of_one_leave_room_for_others() -> None:
    def score(cause: AddedJoint, drop: float) -> Scanned:
        return Scanned(cause, drop, 1.0, np.zeros(1), ({},))

    scores = [
        *(score(CubicStiffness(at), drop) for at, drop in (("a", 480.0), ("b", 470.0), ("c", 460.0))),
        *(score(JointSlip("a"), 300.0), score(LocalSpring("a"), 20.0)),
    ]
    labels = [s.cause.label for s in hopeful([*scores, score(QuinticStiffness("a"), 500.0)], 1000.0)]
    assert labels == ["cubic-stiffness a", "cubic-stiffness b", "joint-slip a"]
    labels = [s.cause.label for s in hopeful([*scores, score(QuinticStiffness("a"), 900.0)], 1000.0)]
    assert labels[:2] == ["quintic-stiffness a", "cubic-stiffness a"]
    others = [s.cause.label for s in elsewhere(CubicStiffness("b"), scores)]
    assert others == ["cubic-stiffness a", "cubic-stiffness c"]
    assert elsewhere(JointSlip("a"), scores) == elsewhere(QuinticStiffness("b"), scores) == []


def test_of_places_that_are_not_told_apart_those_that_move_most_are_tried() -> None:
    """A base that misses 10 standard deviations: falls of chi2 tell less than 900 of it; but not 6 % of the most."""
    scores = [
        Scanned(CubicStiffness(at), drop, 1.0, np.zeros(1), ({},), reach, 10.0)
        for at, drop, reach in (("a", 9000.0, 1e-9), ("b", 8900.0, 1e-3), ("c", 8800.0, 1e-4), ("d", 8400.0, 1.0))
    ]
    assert [s.cause.label for s in hopeful(scores, 1e4)] == ["cubic-stiffness b", "cubic-stiffness c"]
    told = [replace(s, deviation=1.0) for s in scores]
    assert [s.cause.label for s in hopeful(told, 1e4)] == ["cubic-stiffness a", "cubic-stiffness b"]


def test_of_laws_that_promise_alike_those_of_fewer_numbers_are_tried() -> None:
    """Of 8 readings 10 standard deviations off each number is worth 208 of chi2, of readings hardly off next to 0."""

    def order(deviation: float) -> list[str]:
        laws = [(JointSlip("a"), 710.0), (QuinticStiffness("a"), 705.0), (CubicStiffness("b"), 700.0)]
        return [
            s.cause.name for s in hopeful([Scanned(c, d, 1.0, np.ones(8), ({},), 1.0, deviation) for c, d in laws], 1e3)
        ]

    assert order(10.0) == ["cubic-stiffness", "joint-slip", "quintic-stiffness"]
    assert order(1.0) == ["joint-slip", "quintic-stiffness", "cubic-stiffness"]
