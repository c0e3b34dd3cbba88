"""Weighted least squares of one law: residuals of records in standard deviations, and the search for parameters.

The covariance of a residual depends on the law's slope, so on its parameters (effective variance). It is held while
least squares moves the parameters, then renewed, until they rest.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg
from scipy.optimize import least_squares

from hbm.fourier import Array, sampled
from hbm.identification.closure import Answer, LawOnRecords
from hbm.identification.start import Candidate
from hbm.inverse.observed import Observed

ROUNDS = 5
"""Renewals of the covariance, at most."""

AT_REST = 0.05
"""Parameters rest when a renewal moves them by less than this part of their standard deviation."""

PRECISE = 1e-5
"""Least squares ends when chi2 falls by less than this part of it; a law that does not fit need not be that precise."""

STEPS = 15
"""Steps of least squares per renewal, at most."""

WORSE = 2.0
"""A renewal of the covariance that raises chi2 by more than this factor is taken back."""

TELLING = 6
"""Records on which starts are compared, at most."""

COARSE = 256
"""Samples per period on which starts are compared, and from whose fit the last one starts."""

AGREE = 2
"""Starts that end at the best fit before no more are tried."""

STRANGE = 4.0
"""Records count less where their chi2 is more than this many times that of the others: some states hang on a thread."""

SAME = 1.0
"""Fits agree where their chi2 differs by no more."""

OnStep = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Judged:
    """A law with parameters beside records.

    Attributes
    ----------
    x : (n,) array
        Coordinates of the free parameters.
    answers : tuple of Answer
    residuals : (r, c) array
        Reconstructed less predicted force [N].
    white : (r, c) array
        The same in standard deviations, uncorrelated.
    jacobian : (r, c, n) array
        Derivatives of `white` to the coordinates, the covariance held.
    strangeness : (r,) array
        Factor on the standard deviations of a record that fits much worse than the others.
    """

    x: Array
    answers: tuple[Answer, ...]
    residuals: Array
    white: Array
    jacobian: Array
    strangeness: Array

    @property
    def chi2(self) -> Array:
        """Misfit of each record, with its standard deviations as they are, (r,)."""
        return np.asarray(np.sum(self.white**2, axis=1) * self.strangeness**2)


class LeastSquares:
    """Least-squares problem of one law over records."""

    def __init__(self, candidate: Candidate, observed: Observed) -> None:
        self.candidate, self.observed = candidate, observed
        self.model = LawOnRecords(candidate.law, observed)
        self._at: tuple[Array, list[Answer]] | None = None

    def answers(self, x: Array) -> list[Answer]:
        """Force of the law in every record at coordinates; remembers the last."""
        if self._at is None or not np.array_equal(self._at[0], x):
            values = self.candidate.coordinates.values(x)
            self._at = x.copy(), [self.model.answer(r, values) for r in self.observed.records]
        return self._at[1]

    def residuals(self, x: Array) -> Array:
        """Reconstructed less predicted force, (r, c) [N]."""
        pairs = zip(self.observed.records, self.answers(x), strict=True)
        return np.array([self.model.residual(record, answer) for record, answer in pairs])

    def slopes(self, x: Array) -> Array:
        """Derivatives of the residuals to the coordinates, (r, c, n)."""
        values, by_x = self.candidate.coordinates.values(x), self.candidate.coordinates.slopes(x)

        def slope(i: int, answer: Answer) -> Array:
            record = self.observed.records[i]
            return self.model.residual_change(record, self.model.by_parameters(record, answer, values) @ by_x)

        return np.array([slope(i, answer) for i, answer in enumerate(self.answers(x))])

    def roots(self, x: Array) -> Array:
        """Lower factors of the covariances at coordinates, (r, c, c)."""
        pairs = zip(self.observed.records, self.answers(x), strict=True)
        return np.array([self.model.root(record, answer) for record, answer in pairs])

    def by_noise(self, x: Array) -> float:
        """The chi2 per coefficient that noise alone makes, 1 at most."""
        records = self.observed.records
        chi2 = sum(self.model.by_noise(record, answer) for record, answer in zip(records, self.answers(x), strict=True))
        return min(chi2 / max(sum(record.informed for record in records), 1.0), 1.0)

    def weights(self, x: Array) -> tuple[Array, Array]:
        """Factors of the covariances, enlarged for strange records; and the factor of each record, (r,)."""
        roots = self.roots(x)
        chi2 = np.sum(whitened(roots, self.residuals(x)[..., None]) ** 2, axis=(1, 2))
        strangeness = self._strangeness(chi2)
        return roots * strangeness[:, None, None], strangeness

    def _strangeness(self, chi2: Array) -> Array:
        slips = np.array([record.slips for record in self.observed.records])
        among = chi2[slips] if slips.any() else chi2
        usual = max(float(np.median(among)), chi2_scale(self.observed))
        return np.sqrt(np.maximum(chi2 / (STRANGE * usual), 1.0))

    def judge(self, x: Array) -> Judged:
        """The law at coordinates beside the records."""
        (roots, strangeness), residuals = self.weights(x), self.residuals(x)
        both = whitened(roots, np.concatenate([residuals[..., None], self.slopes(x)], axis=2))
        return Judged(x, tuple(self.answers(x)), residuals, both[..., 0], both[..., 1:], strangeness)

    def search(self, x: Array, rounds: int = ROUNDS) -> Array:
        """Coordinates of the least chi2 near `x`, the covariance renewed until they rest.

        Where a law is far from the records, a renewal can make them much worse; then those before stand.
        """
        least, best = np.inf, x
        for _ in range(rounds):
            roots, _ = self.weights(x)
            chi2 = float(np.sum(whitened(roots, self.residuals(x)[..., None]) ** 2))
            if not chi2 <= WORSE * least:
                return best
            least, best = (chi2, x) if chi2 < least else (least, best)
            reduced = max(chi2 / (len(self.observed.records) * chi2_scale(self.observed)), 1.0)
            result = least_squares(
                lambda x, roots=roots: whitened(roots, self.residuals(x)[..., None]).ravel(),
                x,
                lambda x, roots=roots: whitened(roots, self.slopes(x)).reshape(-1, len(x)),
                bounds=self.candidate.coordinates.bounds,
                xtol=1e-8,
                ftol=min(PRECISE * reduced, 1e-3),
                gtol=1e-10,
                max_nfev=STEPS,
            )
            moved, x = result.x - x, result.x
            if np.all(np.abs(moved) <= AT_REST * np.sqrt(reduced * np.diag(uncertainty(self.candidate, result.jac)))):
                break
        return x


def uncertainty(candidate: Candidate, jacobian: Array) -> Array:
    """Covariance of the coordinates, (n, n), of a whitened Jacobian (..., n).

    Where the records say nothing, the range in which a parameter is looked for does.
    """
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    low, high = candidate.coordinates.bounds
    width = np.where(np.isfinite(high - low), high - low, 1e6)
    return np.asarray(np.linalg.inv(flat.T @ flat + np.diag(1.0 / width**2)))


def chi2_scale(observed: Observed) -> float:
    """chi2 of a record by noise alone: the coefficients compared."""
    return float(len(observed.compared))


def whitened(roots: Array, columns: Array) -> Array:
    """Columns (r, c, n) of each record divided by its Cholesky factor (r, c, c)."""
    return np.array([linalg.solve_triangular(L, b, lower=True) for L, b in zip(roots, columns, strict=True)])


def fit(candidate: Candidate, observed: Observed, on_step: OnStep | None = None) -> tuple[LeastSquares, Judged]:
    """Fit a law to records, from several starts where the problem needs it.

    Starts are compared on the records that tell most, coarsely sampled; the best is then fitted to all records, first
    coarsely sampled too.

    Parameters
    ----------
    candidate : Candidate
    observed : Observed
    on_step : callable, optional
        Told in words what is done.

    Returns
    -------
    LeastSquares
        The problem.
    Judged
        Its solution.
    """
    problem = LeastSquares(candidate, observed)
    x = _best_start(candidate, _telling(observed), on_step)
    if on_step is not None:
        on_step("all records")
    x = LeastSquares(candidate, _coarse(observed)).search(x)
    if on_step is not None:
        on_step("all records, finely sampled")
    return problem, problem.judge(problem.search(x))


def _best_start(candidate: Candidate, telling: Observed, on_step: OnStep | None) -> Array:
    problem = LeastSquares(candidate, telling)
    found: list[tuple[float, Array]] = []
    for i, start in enumerate([candidate.x, *candidate.starts()]):
        if on_step is not None:
            on_step(f"start {i + 1}")
        if not np.all(np.isfinite(problem.residuals(start))):
            continue
        x = problem.search(start, rounds=2)
        found.append((float(problem.judge(x).chi2.sum()), x))
        least = min(chi2 for chi2, _ in found)
        if sum(chi2 - least < SAME + 1e-3 * least for chi2, _ in found) >= AGREE:
            break
    return min(found, key=lambda pair: pair[0])[1] if found else candidate.x


def _telling(observed: Observed) -> Observed:
    """A few records, coarsely sampled: those that slip, spread over them; else any."""
    slips = np.array([record.slips for record in observed.records])
    among = np.flatnonzero(slips) if slips.any() else np.arange(len(slips))
    speed = np.array([record.Omega * np.abs(record.signals[1:, 0]).max() for record in observed.records])
    ordered = among[np.argsort(speed[among])]
    picked = ordered[np.unique(np.linspace(0, len(ordered) - 1, TELLING).round().astype(int))]
    keep = np.isin(np.arange(len(slips)), picked)
    return _coarse(observed.of(keep))


def _coarse(observed: Observed) -> Observed:
    return replace(observed, basis=sampled(observed.basis.H, COARSE))
