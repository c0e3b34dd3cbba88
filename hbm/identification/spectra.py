"""Output error: parameters of a friction law from the measured spectra themselves, through the whole forward model.

Each record's steady state is solved at its measured force and compared with the measured responses; derivatives are
those of the harmonic balance. Slower than :func:`hbm.identification.identify.identify`, from whose result it starts,
and free of what the reconstruction assumes.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from continuation import ConvergenceError, Correction
from hbm.balance.solution import PeriodicSolution
from hbm.balance.tones import harmonics_for, holding
from hbm.fourier import Array, FourierBasis, default_samples
from hbm.identification.fit import uncertainty, whitened
from hbm.identification.identify import HELD
from hbm.identification.judgement import fitted_parameters
from hbm.identification.lawfit import FittedParameter, FittedParameters, LawFit, Quality
from hbm.identification.start import Candidate, Scales, candidate, scales_of
from hbm.inverse.observed import SAMPLES
from hbm.inverse.reconstruct import reconstruct
from hbm.inverse.reconstruction import Reconstruction
from hbm.inverse.sensing import Complex
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.records import Measurement, Record, force_columns, measurement_of, parts, solve_record
from hbm.parallel import one_thread
from hbm.sensitivity.derivatives import changes_where_solved
from models.friction import FrictionLaw
from models.plausible import quiet
from models.rig import Rig
from models.scalars import FORCE

HARMONICS = (15, 25, 35, 51)
"""Harmonics that are tried, until more change the answer by little."""

RESOLVED = 0.5
"""Numerics are fine where they move no coefficient of the probed records by more than this, in standard deviations."""

PROBED = 3
"""Records on which numerics are judged: those that slip fastest."""

ROUNDS = 3
"""Renewals of the covariance, at most."""

STEPS = 6
"""Steps of least squares per renewal, at most."""

AT_REST = 0.05
"""Parameters rest when a renewal moves them by less than this part of their standard deviation."""

OnProgress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class SpectraFit:
    """A friction law fitted to measured spectra through the forward model; r records, c channels, harmonics 1..H.

    Attributes
    ----------
    name : str
    law : FrictionLaw
        With the fitted values.
    parameters : FittedParameters
    quality : Quality
    channels : tuple of str, (c,)
    records : (r,) int array
        Those whose steady state was found.
    chi2 : (r,) array
        Misfit of each record.
    residual : (r, c, H) complex array
        Measured less simulated, in the channel's unit; the phase is that of the force. nan where not measured.
    solutions : tuple of PeriodicSolution, (r,)
        On the fitted law; the force is the cosine of each.
    failures : tuple of str
        Records whose steady state was not found, and why.
    numerics : str
        Harmonics, samples and modes, and what they leave.
    """

    name: str
    law: FrictionLaw
    parameters: FittedParameters
    quality: Quality
    channels: tuple[str, ...]
    records: npt.NDArray[np.int64]
    chi2: Array
    residual: Complex
    solutions: tuple[PeriodicSolution, ...]
    failures: tuple[str, ...]
    numerics: str

    def __getitem__(self, name: str) -> FittedParameter:
        """Parameter by name."""
        return self.parameters[name]

    def __repr__(self) -> str:
        """Report in the manner of lmfit."""
        lines = [f"[[Law]] {self.name}, {len(self.records)} records, fitted to spectra", str(self.quality)]
        return "\n".join([*lines, str(self.parameters), f"    {self.numerics}", *(f"    {f}" for f in self.failures)])


@one_thread
@quiet()
def fit_spectra(
    rig: Rig,
    spectra: MeasuredSpectra,
    law: LawFit | FrictionLaw,
    *,
    reconstruction: Reconstruction | None = None,
    harmonics: int | None = None,
    hold: Iterable[str] = HELD,
    on_progress: OnProgress | None = None,
) -> SpectraFit:
    """Fit a friction law to measured spectra through the harmonic balance of the whole rig.

    Parameters
    ----------
    rig : Rig
        Its own law is not used.
    spectra : MeasuredSpectra
    law : LawFit or FrictionLaw
        Result of :func:`identify`, or a law with parameters near the truth.
    reconstruction : Reconstruction, optional
        Reconstruction of these spectra. Steady states start from it, which decides their branch. Made where omitted.
    harmonics : int, optional
        Harmonics of the simulation; where omitted, as many as keep the numerical error below the noise.
    hold : iterable of str
        Parameters that are not fitted.
    on_progress : callable, optional
        Called with what is done and the fraction done.

    Returns
    -------
    SpectraFit

    Raises
    ------
    ConvergenceError
        If the steady state of no record is found.
    """
    seen = reconstruct(rig, spectra) if reconstruction is None else reconstruction
    scales = scales_of(seen)
    given = law.law if isinstance(law, LawFit) else law
    of = candidate(given, given, scales, hold)
    tell = on_progress if on_progress is not None else lambda doing, done: None
    data = measurement_of(seen)
    H, numerics = _numerics(seen.rig, data, of, harmonics)
    model = _Forward(seen.rig, data, of, H)
    x, jacobian = _search(model, of, tell)
    return _result(model, of, x, jacobian, numerics, scales)


# ---- simulation


@dataclass(frozen=True, eq=False)
class _Simulated:
    """Steady state of a record at coordinates x, and its derivatives; amplitudes as (2, c, H) real numbers."""

    x: Array
    solution: PeriodicSolution
    amplitudes: Array
    by_x: Array
    by_force: Array

    def at(self, x: Array) -> Array:
        """Amplitudes along the tangent."""
        return np.asarray(self.amplitudes + self.by_x @ (x - self.x))


class _Forward:
    """Steady states of all records, each from its last one."""

    def __init__(self, rig: Rig, data: Measurement, of: Candidate, H: int) -> None:
        self.rig, self.data, self.of = rig, data, of
        self.basis = FourierBasis(H, max(SAMPLES, default_samples(H)))
        self.found: dict[int, _Simulated] = {}
        self.failed: dict[int, str] = {}
        self.evaluations = 0

    @property
    def failures(self) -> list[tuple[str, str]]:
        """Names of the records that failed, and why."""
        return [(r.name, self.failed[r.number]) for r in self.data.records if r.number in self.failed]

    def simulate(self, x: Array) -> list[_Simulated | None]:
        """Every record at coordinates: its steady state, else the last one found; None where there never was one."""
        rig = replace(self.rig, contact=replace(self.rig.contact, law=self.of.at(x)))
        for record in self.data.records:
            last = self.found.get(record.number)
            if last is not None and np.array_equal(last.x, x):
                continue
            if last is None and record.number in self.failed:
                continue
            self._advance(rig, record, x, last)
        return [self.found.get(record.number) for record in self.data.records]

    def _advance(self, rig: Rig, record: Record, x: Array, last: _Simulated | None) -> None:
        self.evaluations += 1
        try:
            solved = solve_record(rig, self.basis, record, None if last is None else last.solution.state)
            self.found[record.number] = self._differentiated(*solved, x)
            self.failed.pop(record.number, None)
        except (ConvergenceError, ArithmeticError, ValueError) as reason:
            self.failed[record.number] = str(reason)

    def _differentiated(self, solution: PeriodicSolution, found: Correction, x: Array) -> _Simulated:
        by = changes_where_solved(found, solution, None)
        by_law = self.of.coordinates.slopes(x)
        slopes = [by[name].coefficients for name in self.data.channels]
        p, force, H = len(by_law), by.parameters.index(FORCE), self.data.H
        return _Simulated(
            x=x.copy(),
            solution=solution,
            amplitudes=self._amplitudes(solution),
            by_x=np.stack([parts(self.basis, s[:, :p] @ by_law, H) for s in slopes], axis=1),
            by_force=np.stack([parts(self.basis, s[:, force], H) for s in slopes], axis=1),
        )

    def _amplitudes(self, solution: PeriodicSolution) -> Array:
        return np.stack(
            [parts(self.basis, solution[name].coefficients, self.data.H) for name in self.data.channels], axis=1
        )


def _numerics(rig: Rig, data: Measurement, of: Candidate, harmonics: int | None) -> tuple[int, str]:
    """Harmonics whose increase moves the fastest slipping records by less than the noise."""
    least = max(data.H + 1, holding(rig, 1))
    tried = tuple(H for H in HARMONICS if H >= least) or (max(least, 2 * data.H),)
    if harmonics is not None:
        tried = (harmonics_for(rig, harmonics, "fit_spectra"),)
    probed = replace(data, records=tuple(data.records[i] for i in np.argsort(-data.speed)[:PROBED]))
    coarse, change, chosen = _probe(rig, probed, of, tried[0]), np.inf, tried[-1]
    for H, finer in zip(tried, (*tried[1:], 2 * tried[-1] + 1), strict=True):
        fine = _probe(rig, probed, of, finer)
        changes = [
            float(np.nanmax(np.abs(a - b) / record.std))
            for a, b, record in zip(coarse, fine, probed.records, strict=True)
            if a is not None and b is not None
        ]
        change, coarse = max(changes, default=np.inf), fine
        if change < RESOLVED:
            chosen = H
            break
    N_t = max(SAMPLES, default_samples(chosen))
    return chosen, (
        f"simulated with {chosen} harmonics, {N_t} samples, {rig.structure.n} modes; more harmonics move the fastest "
        f"{len(probed.records)} records by at most {change:.2g} standard deviations"
    )


def _probe(rig: Rig, probed: Measurement, of: Candidate, H: int) -> list[Array | None]:
    model = _Forward(replace(rig, contact=replace(rig.contact, law=of.law)), probed, of, H)
    out: list[Array | None] = []
    for record in probed.records:
        try:
            solution, _ = solve_record(model.rig, model.basis, record, None)
            out.append(model._amplitudes(solution))
        except ConvergenceError:
            out.append(None)
    return out


# ---- least squares


def _search(model: _Forward, of: Candidate, tell: OnProgress) -> tuple[Array, Array]:
    """Coordinates of least chi2, and the whitened Jacobian there, (m, n)."""
    x, steps = of.x, 0
    for _ in range(ROUNDS):
        roots = _roots(model, x)

        def residuals(x: Array, roots: list[Array] = roots) -> Array:
            nonlocal steps
            steps += 1
            tell(f"evaluation {steps}", min(steps / (ROUNDS * STEPS), 1.0))
            return np.concatenate([r.ravel() for r in _white(model, x, roots)[0]])

        result = least_squares(
            residuals,
            x,
            lambda x, roots=roots: np.concatenate(_white(model, x, roots)[1]),
            bounds=of.coordinates.bounds,
            xtol=1e-7,
            ftol=1e-5,
            max_nfev=STEPS,
        )
        moved, x = result.x - x, result.x
        if np.all(np.abs(moved) <= AT_REST * np.sqrt(np.diag(uncertainty(of, result.jac)))):
            break
    return x, result.jac


def _simulated(model: _Forward, x: Array) -> list[tuple[Record, _Simulated]]:
    found = zip(model.data.records, model.simulate(x), strict=True)
    pairs = [(record, simulated) for record, simulated in found if simulated is not None]
    if not pairs:
        reasons = "; ".join(f"record {name}: {reason}" for name, reason in model.failures[:3])
        raise ConvergenceError(f"fit_spectra: the steady state of no record was found; {reasons}")
    return pairs


def _roots(model: _Forward, x: Array) -> list[Array]:
    """Cholesky factor of the covariance of each record: noise of the responses, and of the force through the model."""
    return [_root(record, simulated) for record, simulated in _simulated(model, x)]


def _root(record: Record, simulated: _Simulated) -> Array:
    listed = record.listed
    variance = np.broadcast_to(record.std**2, listed.shape)[listed]
    columns = force_columns(record, simulated.amplitudes, simulated.by_force)[:, listed]
    return np.asarray(np.linalg.cholesky(np.diag(variance) + columns.T @ columns))


def _white(model: _Forward, x: Array, roots: list[Array]) -> tuple[list[Array], list[Array]]:
    """Residuals of each record in standard deviations, and their derivatives."""
    residuals, slopes = [], []
    for (record, simulated), root in zip(_simulated(model, x), roots, strict=True):
        listed = record.listed
        both = np.column_stack([(record.measured - simulated.at(x))[listed], -simulated.by_x[listed]])
        white = whitened(root[None], both[None])[0]
        residuals.append(white[:, 0])
        slopes.append(white[:, 1:])
    return residuals, slopes


def _result(model: _Forward, of: Candidate, x: Array, jacobian: Array, numerics: str, scales: Scales) -> SpectraFit:
    pairs = [(r, s) for r, s in _simulated(model, x) if r.number not in model.failed]
    white, _ = _white(model, x, _roots(model, x))
    numbers = [r.number for r, _ in _simulated(model, x)]
    chi2 = np.array([w @ w for w, number in zip(white, numbers, strict=True) if number not in model.failed])
    points = sum(int(r.listed.sum()) for r, _ in pairs)
    quality = Quality(float(chi2.sum()), points, len(x), model.evaluations)
    covariance = uncertainty(of, jacobian) * quality.inflation**2
    residual = [record.measured - simulated.amplitudes for record, simulated in pairs]
    return SpectraFit(
        name=of.label,
        law=of.at(x),
        parameters=fitted_parameters(of.coordinates, x, covariance, scales),
        quality=quality,
        channels=model.data.channels,
        records=np.array([record.number for record, _ in pairs]),
        chi2=chi2,
        residual=np.array([r[0] + 1j * r[1] for r in residual]),
        solutions=tuple(simulated.solution for _, simulated in pairs),
        failures=tuple(f"record {name}: left out; {reason}" for name, reason in model.failures),
        numerics=numerics,
    )
