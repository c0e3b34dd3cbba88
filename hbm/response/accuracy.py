"""How far a curve is from the exact answer of its equations, and how many harmonics it needs.

Everything here is measured, not assumed: some points of the curve are solved again with more harmonics,
more samples and more modes, and the change is the estimate.
"""

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from continuation import ConvergenceError
from hbm.balance.balanced import balanced
from hbm.balance.problem import balance_of
from hbm.balance.solution import PeriodicSolution, describe
from hbm.balance.tones import harmonics_for, holding
from hbm.errors import expect_level, expect_positive
from hbm.fourier import Array, FourierBasis, default_samples
from hbm.response.assessment import Assessment, NumericalError, Probe, worst_of
from hbm.response.budget import Budget, OnPoint
from hbm.response.curve import ResponseCurve
from hbm.response.trace import scout_frequency, solve_near, sweep_of, trace_frequency
from models.jointed import AnyRig, JointedRig
from models.jointedstructure import JointedStructure
from models.rig import Rig

TOLERANCE = 5e-3
"""Largest accepted change of drive displacement and friction force, relative to their peak on the curve."""

LADDER = (7, 9, 11, 13, 15, 17, 19, 23, 27, 33, 39, 47)
"""Harmonics tried by :func:`frequency_response`."""

LEAST = 1e-4
"""Errors of a force that does less than this part of what the largest does to the body are relative to this part: no
sensor has 80 dB to see it with."""

SAMPLES_LIMIT = 4096
SPREAD = 16
"""Points spread over a curve that are solved again to estimate its error."""

ESTIMATE = 0.1
"""Part of a curve's seconds that the estimate of its error may take: points that open take seconds each to solve again,
others milliseconds."""


def frequency_response(
    rig: AnyRig,
    hz: tuple[float, float] | None = None,
    *,
    level: float | None = None,
    harmonics: int | None = None,
    tolerance: float = TOLERANCE,
    on_point: OnPoint | None = None,
    budget: Budget | None = None,
) -> ResponseCurve:
    """Frequency response curve with its numerical error.

    Parameters
    ----------
    rig : Rig
    hz : (float, float), optional
        Where to start and to end [Hz]; 0.85 to 1.35 of the first sliding resonance where omitted.
    level : float, optional
        Force amplitude [N]; the rig's where omitted.
    harmonics : int, optional
        H; where omitted it is raised until the curve's drive displacement and friction force change
        less than `tolerance`, from what holds the force.
    tolerance : float
        Accepted change relative to the peak.
    on_point : callable, optional
        Progress: called with frequency and point number.
    budget : Budget, optional
        Most points of the curve, and seconds: the choice of harmonics takes up to half of them. The estimate of the
        error may take a tenth as many more, and the point that it is at.

    Returns
    -------
    ResponseCurve
        With its `assessment`.

    Raises
    ------
    InputError
        If the force has a harmonic above H.
    continuation.ConvergenceError
        If there is no first solution.
    """
    sweep = sweep_of(rig, hz, "frequency_response")
    expect_level(level, "frequency_response")
    expect_positive(tolerance, "tolerance", "frequency_response", "relative")
    budget, began = budget or Budget(), time.monotonic()
    if harmonics is None:
        H, N_t, reason = choose_harmonics(rig, sweep, level=level, tolerance=tolerance, seconds=0.5 * budget.left)
    else:
        H = harmonics_for(rig, harmonics, "frequency_response")
        N_t, reason = default_samples(H), f"H = {H} as asked for"
    budget = budget.after(time.monotonic() - began)
    curve = trace_frequency(rig, sweep, level=level, harmonics=H, samples=N_t, on_point=on_point, budget=budget)
    error = estimate_error(curve, ESTIMATE * budget.seconds)
    return replace(curve, assessment=Assessment(error, reason, tuple(_warnings(curve, error, tolerance))))


def choose_harmonics(
    rig: AnyRig,
    hz: tuple[float, float],
    *,
    level: float | None = None,
    tolerance: float = TOLERANCE,
    seconds: float = Budget.seconds,
) -> tuple[int, int, str]:
    """Fewest harmonics and samples of the ladder that keep the curve within the tolerance.

    Parameters
    ----------
    rig, hz, level, tolerance
        As for :func:`frequency_response`.
    seconds : float
        Time for the coarse curve that tells where the peaks are; they are those of as much of it as there is by then.

    Returns
    -------
    H, N_t : int
    reason : str
    """
    pilot = scout_frequency(rig, hz, level=level, budget=Budget(seconds=seconds))
    (where, found), scales, what = _telling_points(pilot), scales_of(pilot.rig, pilot.points), _in_words(rig)
    for H in ladder(rig):
        N_t = default_samples(finer(H))
        found = [p for p in _solve_again(found, rig, H, N_t) if p is not None]
        refined = _solve_again(found, rig, finer(H), N_t)
        changes = [relative_change(a, b, scales) for a, b in zip(found, refined, strict=True) if b is not None]
        if not changes:
            H = holding(rig)
            return H, default_samples(H), f"H = {H}: the peaks could not be solved again with more to judge by"
        change = max(changes)
        if change < tolerance:
            N_t, moved = _choose_samples(rig, found, H, scales, tolerance)
            reason = (
                f"H = {H}: at {where} {finer(H)} harmonics change {what} by {change:.2%} of its largest, "
                f"{2 * N_t} samples by {moved:.2%} (tolerance {tolerance:.2%})"
            )
            return H, N_t, reason
    return H, default_samples(H), f"H = {H}, the most that is tried: still {change:.2%} from {finer(H)} harmonics"


def _telling_points(curve: ResponseCurve) -> tuple[str, list[PeriodicSolution]]:
    """Peaks of a curve, by which to choose harmonics and samples; and what they are, in words.

    Where the tip lifts off they are no prediction, and resolving them would cost the rest of the curve dearly: then the
    largest motion that keeps the contact stands for them.
    """
    found = [curve.points[i] for i in sorted(peaks(curve))]
    in_contact = [p for p in curve.points if not p.lift_off]
    if not in_contact or not any(p.lift_off for p in found):
        return "the peaks", found
    largest = max(in_contact, key=lambda p: p.channels["drive"].peak)
    return "the largest motion that keeps the contact", [p for p in found if not p.lift_off] or [largest]


def ladder(rig: AnyRig) -> tuple[int, ...]:
    """Harmonics to try, the fewest first: a force that has harmonics of its own is held by all of them."""
    least = holding(rig, LADDER[0])
    return (least, *(H for H in LADDER if H > least))


def finer(H: int) -> int:
    """Harmonics that H are compared with."""
    return 2 * H + 1


def _choose_samples(
    rig: AnyRig,
    found: Sequence[PeriodicSolution],
    H: int,
    scales: dict[str, float],
    tolerance: float,
) -> tuple[int, float]:
    """Fewest samples whose doubling changes the probed points by less than half the tolerance; and that change."""
    N_t = default_samples(H)
    coarse = _solve_again(found, rig, H, N_t)
    while True:
        fine = _solve_again(found, rig, H, 2 * N_t)
        changes = [relative_change(a, b, scales) for a, b in zip(coarse, fine, strict=True) if a is not None]
        change = float(np.nanmax(changes)) if changes else np.inf
        if change < tolerance / 2 or 2 * N_t > SAMPLES_LIMIT:
            return N_t, change
        N_t, coarse = 2 * N_t, fine


def judged(rig: AnyRig) -> list[str]:
    """Signals whose change is measured: motion of the drive, and every force where the rig touches."""
    return ["drive", *rig.forces]


def _in_words(rig: AnyRig) -> str:
    """What is judged."""
    return "drive displacement or friction force" if isinstance(rig, Rig) else "drive displacement or a joint's force"


def peaks(curve: ResponseCurve) -> set[int]:
    """Where drive displacement and friction force are largest."""
    return {int(np.argmax(curve[name].peak)) for name in judged(curve.rig)}


def probes(curve: ResponseCurve) -> list[PeriodicSolution]:
    """Points worth solving again: the peak, that of each force, the one with the strongest high harmonics, some spread.

    The peak is the first; the others are in order of travel.
    """
    tail = np.linalg.norm(curve["drive"].amplitude[:, 2 * curve.basis.H // 3 :], axis=1)
    spread = np.linspace(0, len(curve.points) - 1, SPREAD).astype(int).tolist()
    others = [curve.points[i] for i in sorted({*peaks(curve), int(np.argmax(tail)), *spread})]
    return [curve.peak, *(p for p in others if p is not curve.peak)]


def estimate_error(curve: ResponseCurve, seconds: float = math.inf) -> NumericalError:
    """Estimate the numerical error of a curve by solving some of its points again, refined.

    No point but the peak is begun later than `seconds`; those that are left out are counted.
    """
    chosen = probes(curve)
    table = _probed(curve.rig, chosen, scales_of(curve.rig, curve.points), seconds)
    return NumericalError(table, table[0], max(p.closure for p in curve.points), len(chosen))


def error_of(rig: AnyRig, solution: PeriodicSolution) -> Probe:
    """Numerical error of one periodic solution: what more harmonics, samples and modes change, relative to its peaks.

    Parameters
    ----------
    rig : Rig
    solution : PeriodicSolution
        A solution of this rig.

    Returns
    -------
    Probe
        An error is nan, "not estimated", where nothing is found near the solution with finer numerics: then it may be
        one of these harmonics, samples and modes alone.

    Raises
    ------
    ValueError
        If the solution is not one of this rig.
    """
    balanced(balance_of(rig, solution.basis, level=solution.level, periods=solution.periods), solution, "error_of")
    return _probed(rig, [solution], scales_of(rig, [solution]))[0]


def _probed(
    rig: AnyRig, found: Sequence[PeriodicSolution], scales: dict[str, float], seconds: float = math.inf
) -> tuple[Probe, ...]:
    """Changes of solutions with finer numerics, as many as there is time for.

    The sources are told apart at the first, and where the change is largest.
    """
    H, N_t, n = found[0].basis.H, found[0].basis.N_t, rig.structure.n
    finer_H, finer_N, finer_rig = finer(H), 2 * N_t, rig.with_modes(2 * n)
    shares = {
        "harmonics": (rig, finer_H, N_t if N_t > 4 * finer_H else finer_N),
        "samples": (rig, H, finer_N),
        "modes": (finer_rig, H, N_t),
    }
    ends = time.monotonic() + seconds

    def change(point: PeriodicSolution, rig: AnyRig, H: int, N_t: int) -> float:
        return relative_change(point, _solve_again([point], rig, H, N_t)[0], scales)

    def told_apart(i: int) -> Probe:
        sources = [name for name in shares if name != "modes" or finer_rig.structure.n > n]
        return replace(table[i], **{name: change(found[i], *shares[name]) for name in sources})

    table: list[Probe] = []
    for point in found:
        if table and time.monotonic() > ends:
            break
        total = change(point, finer_rig, finer_H, finer_N)
        table.append(Probe(point.hz, harmonics=math.nan, samples=math.nan, modes=math.nan, total=total))
        if point is found[0]:
            table[0] = told_apart(0)
    worst = table.index(worst_of(table))
    if worst and time.monotonic() <= ends:
        table[worst] = told_apart(worst)
    return tuple(table)


def _solve_again(found: Sequence[PeriodicSolution], rig: AnyRig, H: int, N_t: int) -> list[PeriodicSolution | None]:
    """Solve points on another discretisation, each at its frequency; None where that fails."""
    if not found:
        return []
    problem = balance_of(rig, FourierBasis(H, N_t), level=found[0].level, periods=found[0].periods)
    out: list[PeriodicSolution | None] = []
    for start in found:
        lam = problem.lam_at(start.hz)
        try:
            out.append(describe(problem, solve_near(problem, lam, start), lam))
        except ConvergenceError:
            out.append(None)
    return out


def scales_of(rig: AnyRig, points: Sequence[PeriodicSolution]) -> dict[str, float]:
    """Scales for changes of signals: their peaks; for ports of a joint, that of the largest of its forces.

    A force that does nearly nothing to the body, such as rounding leaves of one that symmetry forbids, has the scale of
    one that does something.
    """
    joints = {name: name.partition(".force")[0] for name in judged(rig)}
    peaks = {name: max(p.channels[name].peak for p in points) for name in joints}
    scales = {name: max(peak for other, peak in peaks.items() if joints[other] == joints[name]) for name in peaks}
    return scales if isinstance(rig, Rig) else {**scales, **_felt(rig, points, scales)}


def _felt(rig: JointedRig, points: Sequence[PeriodicSolution], scales: dict[str, float]) -> dict[str, float]:
    """Scales of forces at joints, at least such as do a part `LEAST` of what the largest does to the body.

    What a force does is told by the work it does where it acts, |receptance| force^2: forces and moments compare.
    """
    names = rig.forces
    receptances = np.array([np.abs(_receptance(rig.structure, 2 * np.pi * p.hz)) for p in points])
    forces = np.array([[*(p.channels[name].peak for name in names), abs(p.state.F)] for p in points])
    largest = np.sqrt((receptances * forces**2).max())
    by_unit = np.sqrt(receptances.max(axis=0))[:-1]
    least = np.divide(LEAST * largest, by_unit, out=np.zeros(len(names)), where=by_unit > 0.0)
    return {name: max(scales[name], float(force)) for name, force in zip(names, least, strict=True)}


def _receptance(s: JointedStructure, omega: float) -> Array:
    """Motion of the bare body where a force acts, per force there: at every port, then at the excitation."""
    rows = np.vstack([s.joints, s.excitation])
    dynamic = np.diag(s.omega_n**2 - omega**2) + 1j * omega * s.damping
    static = np.append(s.flexibility.diagonal(), s.drive_by_force)
    return np.asarray(np.sum(rows.T * np.linalg.solve(dynamic, rows.T), axis=0) + static)


def difference(a: PeriodicSolution, b: PeriodicSolution, channel: str) -> float:
    """Largest difference of a channel over the period at the phases both solutions sample."""
    sa, sb = a.channels[channel].samples, b.channels[channel].samples
    common = int(np.gcd(len(sa), len(sb)))
    return float(np.abs(sa[:: len(sa) // common] - sb[:: len(sb) // common]).max())


def relative_change(before: PeriodicSolution, after: PeriodicSolution | None, scales: dict[str, float]) -> float:
    """Largest relative difference over the judged channels."""
    if after is None:
        return float("nan")
    return max(difference(before, after, name) / scale for name, scale in scales.items() if scale > 0.0)


def _warnings(curve: ResponseCurve, error: NumericalError, tolerance: float) -> Iterable[str]:
    H, worst, what = curve.basis.H, error.worst, _in_words(curve.rig)
    lifted = ", where the tip would lift off" if curve.peak.lift_off else ""
    if error.at_peak.modes > tolerance:
        more = curve.rig.with_modes(2 * curve.rig.structure.n)
        key = more.body.MODES
        advice = "" if lifted or not key else f": set {key} = {more.body.modes}"
        share = f"{error.at_peak.modes:.2%} of its largest"
        yield f"at the peak {more.structure.n} modes change {what} by {share}{lifted}{advice}"
    if error.at_peak.harmonics > tolerance:
        yield f"at the peak {finer(H)} harmonics change {what} by {error.at_peak.harmonics:.2%} of its largest{lifted}"
    if error.largest("samples") > tolerance:
        yield f"{2 * curve.basis.N_t} samples change {what} by up to {error.largest('samples'):.2%} of its largest"
    if len(error.probes) < error.chosen:
        yield f"the numerical error is that of {len(error.probes)} of {error.chosen} points: its time was over"
    if error.lost:
        numerics = f"{finer(H)} harmonics, {2 * curve.basis.N_t} samples and more modes"
        peak = ", the peak among them" if np.isnan(error.at_peak.total) else ""
        where = f"{len(error.lost)} of {len(error.probes)} points{peak}"
        yield f"the numerical error is not assessed at {where}: nothing was found near them with {numerics}"
    if worst.total > 2 * tolerance and worst is not error.at_peak:
        cause = "modes" if worst.modes > worst.harmonics else "harmonics"
        yield f"near {worst.hz:.5g} Hz the error reaches {worst.total:.1%}, mostly for want of {cause}"
    if curve.past_start:
        yield curve.past_start
    for low, high in curve.lift_off:
        least = min(p.channels["normal"].samples.min() for p in curve.points)
        yield (
            f"the tip would lift off from {low:.5g} to {high:.5g} Hz (normal reaction down to {least:.3g} N); "
            "the model keeps it on the support there"
        )
    for low, high in curve.walking:
        most = max(p.unheld for p in curve.points)
        yield (
            f"from {low:.5g} to {high:.5g} Hz friction pushes the body along: nothing balances its mean, up to "
            f"{most:.2g} of the excitation; no motion is periodic there, simulate it in time instead"
        )
    for low, high in curve.unsolved:
        yield (
            f"from {low:.5g} to {high:.5g} Hz a law is not solved at its samples, up to {error.closure:.1%} of its "
            "force is open: no solutions there, try more samples"
        )
    if not curve.complete:
        yield f"partial curve: {curve.branch.message}"
