"""Bifurcations along a curve, against variational equations integrated by scipy; branches that leave there."""

import csv
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from matplotlib.figure import Figure
from rigs import HZ, CubicSpring, oscillator
from scipy.integrate import solve_ivp

from continuation import Kind
from hbm import force_response, steady_state
from hbm.balance.solution import PeriodicSolution
from hbm.figures import plot_frequency_response
from hbm.files.curves import companion, read_curves, write_curves
from hbm.response import bifurcations
from hbm.response.bifurcation import Bifurcation
from hbm.response.bifurcations import stability_of, with_stability
from hbm.response.branching import crossing, doubled
from hbm.response.curve import ResponseCurve
from hbm.response.trace import trace_frequency
from hbm.stability.along import crossings, hiding
from hbm.stability.multipliers import Stability
from models import Channel, Contact, Damping, Excitation, ModalBody, Rig
from models.published import paper_rig

Rate = Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""(t, y) -> y', dy'/dy."""

MASS, CUBIC, DASHPOT, PUSH = 0.05, 4 / 3 * 0.05, 0.2 * 0.05, 0.3 * 0.05


@dataclass(frozen=True, eq=False)
class EnergySink:
    """Cubic spring and dashpot between an oscillator and a small mass."""

    name: ClassVar[str] = "energy-sink"
    states: ClassVar[int] = 0
    set_valued: ClassVar[bool] = False

    cubic: Any
    damping: Any

    def advance(self, z: Any, before: Any, now: Any) -> tuple[Any, Any]:
        """Return no state and the force."""
        return z, -self.cubic * now.u**3 - self.damping * now.v


def energy_sink() -> Rig:
    """A linear oscillator with a small mass on a cubic spring, in 1:1 resonance (Gendelman & Starosvetsky 2007)."""
    return Rig(
        name="nonlinear energy sink",
        body=ModalBody((HZ, 1e-3 * HZ), ((1.0, 0.0),), (1.0, -1 / np.sqrt(MASS)), (1.0, 0.0)),
        damping=Damping(mass_proportional=0.0),
        contact=Contact(1.0, EnergySink(CUBIC, DASHPOT)),
        excitation=Excitation(PUSH),
        channels=(Channel("y", "displacement"),),
    )


def sink_rate(Omega: float) -> Rate:
    """Equations of the two masses themselves, (x, w, x', w'); the small one's own spring is 1e-6 of the main one's."""

    def rate(t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        (x, w, xt, wt), k = y, 1e-6
        held = CUBIC * (x - w) ** 3 + DASHPOT * (xt - wt)
        a, b = 3 * CUBIC * (x - w) ** 2, DASHPOT
        J = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-1 - a, a, -b, b], [0, 0, 0, 0]], dtype=float)
        J[3] = np.array([a, -a, b, -b]) / MASS - np.array([0, k, 0, 0])
        return np.array([xt, wt, PUSH * np.cos(Omega * t) - x - held, held / MASS - k * w]), J

    return rate


def duffing_rate(Omega: float, push: float, damping: float = 0.2) -> Rate:
    def rate(t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, v = y
        J = np.array([[0.0, 1.0], [-1 - 3 * x**2, -damping]])
        return np.array([v, push * np.cos(Omega * t) - damping * v - x - x**3]), J

    return rate


def shot(rate: Rate, start: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Periodic state near a start by shooting, and its multipliers, largest first."""
    n, y = len(start), start

    def both(t: float, z: np.ndarray) -> np.ndarray:
        f, J = rate(t, z[:n])
        return np.concatenate([f, (J @ z[n:].reshape(n, n)).ravel()])

    for _ in range(8):
        z = solve_ivp(both, (0.0, period), np.concatenate([y, np.eye(n).ravel()]), rtol=1e-9, atol=1e-11).y[:, -1]
        M, gap = z[n:].reshape(n, n), z[:n] - y
        if np.abs(gap).max() < 1e-8:
            break
        y = y - np.linalg.solve(M - np.eye(n), gap)
    assert np.abs(gap).max() < 1e-8
    values = np.linalg.eigvals(M)
    return y, values[np.argsort(-np.abs(values))]


def at_phase_zero(p: PeriodicSolution) -> np.ndarray:
    H = p.basis.H
    velocity = p.state.Omega * p.basis.derivative(p.state.Q)
    return np.concatenate([p.state.Q[: H + 1].sum(axis=0), velocity[: H + 1].sum(axis=0)])


def kinds(curve: ResponseCurve) -> list[str]:
    return [b.kind.value for b in curve.bifurcations]


@pytest.fixture(scope="module")
def sink() -> ResponseCurve:
    return with_stability(trace_frequency(energy_sink(), (0.95 * HZ, 1.05 * HZ), harmonics=5, samples=64, step_hz=2e-3))


def test_neimark_sacker_of_an_energy_sink(sink: ResponseCurve) -> None:
    """Multipliers of the masses' own equations: a pair on the unit circle where it is said to be."""
    assert kinds(sink) == ["Neimark-Sacker", "fold", "Neimark-Sacker", "fold"]
    scale = np.array([1.0, 1 / np.sqrt(MASS)] * 2)
    for b in sink.bifurcations:
        if b.kind is Kind.NEIMARK_SACKER:
            Omega = 2 * np.pi * b.hz
            _, found = shot(sink_rate(Omega), at_phase_zero(b.solution) * scale, 2 * np.pi / Omega)
            pair = found[np.abs(found.imag) > 0.1]
            assert np.abs(pair[0]) == pytest.approx(1.0, abs=2e-3)
            ours = b.stability.multipliers
            assert max(np.abs(ours - m).min() for m in found) < 5e-3
            assert abs(b.multiplier) == pytest.approx(1.0, abs=1e-3) and b.multiplier.imag > 0.1
            assert b.special.located


def test_too_many_to_be_resolved_are_named_by_the_points_behind(sink: ResponseCurve, monkeypatch) -> None:
    monkeypatch.setattr(bifurcations, "MOST", 3)
    again = with_stability(sink)
    assert kinds(again) == kinds(sink)
    assert not any(b.special.located for b in again.bifurcations)
    assert [b.behind for b in again.bifurcations] == [b.behind for b in sink.bifurcations]
    assert all(b.solution is sink.points[b.behind] for b in again.bifurcations)
    ax = Figure().add_subplot()
    plot_frequency_response(again, ax)
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["0.015 N", "unstable", "fold"]


def test_stability_changes_where_bifurcations_are(sink: ResponseCurve) -> None:
    """But for the fold and the pair between the first two, where some multiplier is outside already."""
    changes = np.flatnonzero(np.diff(sink.stable.astype(int))) + 1
    at = {b.behind for b in sink.bifurcations}
    assert sink.stable[0] and sink.stable[-1]
    assert set(changes.tolist()) <= at
    outside = [s.unstable for s in sink.stability]
    assert max(outside) == 3  # the pair, and one between the folds


def test_beyond_a_neimark_sacker_the_amplitude_is_modulated(sink: ResponseCurve) -> None:
    """Its equations in time, from beside the periodic motion: on the stable side they return, beyond they never do."""
    first = next(b for b in sink.bifurcations if b.kind is Kind.NEIMARK_SACKER)

    def strayed(point: PeriodicSolution, periods: int) -> float:
        Omega = 2 * np.pi * point.hz
        y = at_phase_zero(point) * np.array([1.0, 1 / np.sqrt(MASS)] * 2)
        rate, t = sink_rate(Omega), 2 * np.pi / Omega * np.arange(periods + 1)
        path = solve_ivp(lambda t, y: rate(t, y)[0], (0, t[-1]), 1.05 * y, t_eval=t, rtol=1e-5, atol=1e-7).y
        return float(np.abs(path[:2, -30:].T - y[:2]).max() / np.abs(y[:2]).max())

    def point_at(hz: float) -> PeriodicSolution:
        return sink.points[int(np.argmin(np.abs(sink.hz[: first.behind + 40] - hz)))]

    assert strayed(point_at(0.985 * HZ), 150) < 0.01
    assert strayed(point_at(1.002 * HZ), 150) > 0.3


@pytest.fixture(scope="module")
def broken() -> tuple[ResponseCurve, Bifurcation, ResponseCurve]:
    """Where the symmetry of x'' + 0.2 x' + x + x^3 = 30 cos Omega t breaks (Parlitz & Lauterborn 1985)."""
    rig = oscillator(CubicSpring(1.0), damping=0.2, amplitude=30.0)
    curve = with_stability(trace_frequency(rig, (2.6 * HZ, 2.2 * HZ), harmonics=15, samples=128))
    at = next(b for b in curve.bifurcations if b.kind is Kind.BRANCH_POINT)
    end = curve.problem.lam_at(1.6 * HZ)
    further = replace(curve.branch, settings=replace(curve.branch.settings, lam_min=end, lam_end=end))
    return curve, at, with_stability(crossing(replace(curve, branch=further), at)[0])


def test_symmetry_breaks_at_a_branch_point(broken) -> None:
    _, at, aside = broken
    assert np.abs(at.solution.state.Q[::2][: at.solution.basis.H // 2]).max() < 1e-9  # even harmonics
    assert at.multiplier == pytest.approx(1.0, abs=2e-3)
    assert max(abs(p.state.Q[0, 0]) for p in aside.points) > 0.1
    # at the frequency where the symmetric motion has lost its stability another one has it
    Omega = 2 * np.pi * at.hz
    _, found = shot(duffing_rate(Omega, 30.0), at_phase_zero(at.solution), 2 * np.pi / Omega)
    assert found[0] == pytest.approx(1.0, abs=5e-3)


def test_period_doubles_and_its_branch_is_followed(broken) -> None:
    _, _, aside = broken
    at = next(b for b in aside.bifurcations if b.kind is Kind.PERIOD_DOUBLING)
    Omega = 2 * np.pi * at.hz
    _, found = shot(duffing_rate(Omega, 30.0), at_phase_zero(at.solution), 2 * np.pi / Omega)
    assert found[0] == pytest.approx(-1.0, abs=5e-3)
    twice = with_stability(doubled(aside, at))
    p = max(twice.points, key=lambda p: np.abs(p.state.Q[1]).max())  # the odd harmonics of half the frequency
    assert np.abs(p.state.Q[1]).max() > 0.05 * np.abs(p.state.Q).max()
    Omega = 2 * np.pi * p.hz
    assert p.state.Omega == pytest.approx(Omega / 2)
    y, found = shot(duffing_rate(Omega, 30.0), at_phase_zero(p), 4 * np.pi / Omega)
    np.testing.assert_allclose(y, at_phase_zero(p), atol=5e-3 * np.abs(y).max())
    ours = stability_of(twice.rig, p).multipliers[:2]
    np.testing.assert_allclose(np.sort(ours.real), np.sort(found.real), atol=5e-2)
    assert abs(p.energy_error) < 1e-6


def test_branching_wants_the_right_kind(sink: ResponseCurve) -> None:
    for follow, kind in ((crossing, "branch point"), (doubled, "period doubling")):
        with pytest.raises(ValueError, match=rf"branching: Neimark-Sacker at .* Hz, 0.015 N; must be a {kind}"):
            follow(sink, sink.bifurcations[0])


def test_a_curve_says_where_it_is_stable_in_files_and_figures(sink: ResponseCurve, tmp_path: Path) -> None:
    path = tmp_path / "sink.csv"
    write_curves(path, [sink])
    with path.open() as file:
        rows = [row for row in csv.DictReader(file) if row["channel"] == "y"]
    assert [row["stable"] for row in rows] == [str(int(s)) for s in sink.stable]
    assert np.array_equal(read_curves(path)[0].stable == 1.0, sink.stable)
    said = json.loads(companion(path).read_text())["levels"][0]["bifurcations"]
    assert [(b["kind"], b["frequency_hz"]) for b in said] == [(b.kind.value, b.hz) for b in sink.bifurcations]
    assert all(sink.points[b["before_point"] - 1].hz != b["frequency_hz"] for b in said)
    ax = Figure().add_subplot()
    plot_frequency_response(sink, ax)
    marks = {str(line.get_label()): line for line in ax.lines}
    assert list(marks["_Neimark-Sacker"].get_xdata()) == [b.hz for b in sink.bifurcations if "Neimark" in b.kind.value]
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["0.015 N", "unstable", "fold", "Neimark-Sacker"]


@pytest.mark.slow
def test_bifurcations_do_not_depend_on_the_window() -> None:
    """Of the paper's beam: the same list within 1 mHz from windows of other ends and directions.

    At 47.59 Hz a kink turns the curve back by 1.3 mHz, which some sweeps step over and some do not: it is in none.
    """
    lists, kinks = [], []
    for window in ((40.0, 65.0), (65.0, 40.0), (45.0, 60.0), (47.5, 52.5)):
        curve = with_stability(trace_frequency(paper_rig(), window, harmonics=19, samples=256))
        assert curve.stable is not None
        assert curve.doubtful is not None
        inside = (curve.hz > 47.6) & (curve.hz < 52.5)
        assert (~curve.stable & ~curve.doubtful)[inside].any()
        lists.append(sorted((b.hz, b.kind.value) for b in curve.bifurcations))
        assert not (~curve.stable & ~curve.doubtful)[curve.hz < 48.0].any()
        kinks.append(any(p.fold and abs(curve.value_at(p.lam) - 47.59) < 0.01 for p in curve.branch.points))
    assert any(kinks)
    first = lists[0]
    assert {kind for _, kind in first} == {"Neimark-Sacker", "period doubling", "fold"}
    for other in lists[1:]:
        assert [kind for _, kind in other] == [kind for _, kind in first]
        np.testing.assert_allclose([hz for hz, _ in other], [hz for hz, _ in first], rtol=0.0, atol=1e-3)


def known_to(error: float, *growths: float) -> list[Stability]:
    """Points of one real multiplier each, of such growths."""
    return [Stability(np.array([-np.exp(g) + 0j]), 1.0, error=error) for g in growths]


def test_only_what_rises_above_the_error_crosses_for_certain() -> None:
    hz = 50.0 + 1e-3 * np.arange(5)
    low, high = known_to(1e-3, -5e-3, -5e-3, 5e-4, -5e-3, -5e-3), known_to(1e-3, -5e-3, -5e-3, 4e-3, 4e-3, -5e-3)
    across, doubtful = crossings(low, hz, 0, slow=False)
    assert across == []
    assert np.flatnonzero(doubtful).tolist() == [2]
    across, doubtful = crossings(high, hz, 0, slow=False)
    assert across == [(1, 2), (3, 4)]
    assert not doubtful.any()


def test_a_crossing_so_slow_that_it_has_no_place_is_in_doubt() -> None:
    slowly = known_to(1e-3, -5e-3, -5e-4, 5e-4, 5e-3)
    assert crossings(slowly, 50.0 + 1e-2 * np.arange(4), 0, slow=False)[0] == [(0, 3)]
    for slow, named in ((False, []), (True, [(0, 3)])):
        across, doubtful = crossings(slowly, 50.0 + 1e-1 * np.arange(4), 0, slow=slow)
        assert across == named
        assert np.flatnonzero(doubtful).tolist() == [1, 2]


@pytest.mark.parametrize("within", [(3.0, 6.6), (6.6, 5.0)])
def test_where_stability_is_lost_along_the_force_is_told_with_its_bounds(
    within: tuple[float, float], tmp_path: Path
) -> None:
    """Of the paper's beam multipliers come so slowly to the unit circle that the place is known to 1 % alone."""
    rig = paper_rig()
    curve = with_stability(force_response(rig, 48.385, within, harmonics=9))
    lost, found = sorted(curve.bifurcations, key=lambda b: b.level)
    assert {lost.kind.value, found.kind.value} == {"Neimark-Sacker"}
    for b, before, behind in ((lost, False, True), (found, True, False)):
        assert b.span is not None
        low, high = b.span
        assert low < b.level < high < 1.03 * low
        assert f"({low:.4g} to {high:.4g})" in str(b)
        for level, unstable in ((0.998 * low, before), (1.002 * high, behind)):
            there = stability_of(rig, steady_state(rig, 48.385, level=level, harmonics=9, start=b.solution))
            assert bool(there.unstable) is unstable
    write_curves(tmp_path / "c.csv", [curve])
    (saved,) = read_curves(tmp_path / "c.csv")
    assert [tuple(b["between"]) for b in saved.summary["bifurcations"]] == [b.span for b in curve.bifurcations]


def test_steps_are_halved_where_a_multiplier_could_cross_and_return() -> None:
    hz = 50.0 + np.arange(4)
    steep, flat = known_to(1e-4, -5e-2, -2.9e-2, -8e-3, -5e-3), known_to(1e-4, -5e-2, -5e-2, -5e-2, -5e-2)
    assert hiding(steep, np.arange(4.0), hz).tolist() == [False, True, True]
    assert not hiding(flat, np.arange(4.0), hz).any()
    assert hiding(known_to(1e-3, -1e-4, -1e-4), np.arange(2.0), hz[:2]).all()  # it grazes the circle
    assert not hiding(known_to(1e-3, -1e-4, -1e-4), np.arange(2.0), np.array([50.0, 50.01])).any()
    # a pair comes to the real axis and turns back: where it met, one of it may have left
    pair = [Stability(0.99 * np.exp(1j * np.array([a, -a])), 1.0, error=1e-3) for a in (2.68, 2.72, 3.13, 2.9)]
    assert hiding(pair, np.arange(4.0), np.full(4, 50.0)).tolist() == [False, True, True]


def test_a_narrow_step_beside_points_as_close_as_their_error_is_no_jump() -> None:
    """Of the paper's beam behind its fold at 48.675 Hz, downwards: a bubble of 14 mHz, met by no point."""
    growths = (-2e-3, -1e-3, -1e-3, -1.03e-2, -6.8e-3)
    hz = np.array([48.67537, 48.67535, 48.66062, 48.65554, 48.6493])
    arclength = np.array([1.06309, 1.06382, 1.08383, 1.08633, 1.08882])
    assert hiding(known_to(2e-3, *growths), arclength, hz)[1]
    leaping = known_to(2e-3, -9e-2, -9e-2, -1e-2, -1e-2, -1e-2)  # where a sample starts to slip
    assert not hiding(leaping, np.arange(5.0), 50.0 + 1e-3 * np.arange(5)).any()
