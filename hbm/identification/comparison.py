"""Comparison of fitted laws: the best one, and those that cannot be told from it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from hbm.identification.lawfit import LawFit

CLEAR = 6.0
"""Difference of BIC from which laws count as told apart."""

SIGNIFICANT = 2.0
"""A law is worse on held-out records where its excess of chi2 is so many standard errors."""


@dataclass(frozen=True)
class Ranked:
    """One law beside the best.

    Attributes
    ----------
    name : str
    bic : float
        Bayesian information criterion, with chi2 in units of the best law's reduced chi2 where no law fits.
    delta_chi2, delta_bic : float
        More than the best law's, in the same units.
    held_out_excess, held_out_error : float
        chi2 on held-out records more than the best law's, and the standard error of that; nan where none were.
    separable : bool
        Whether the records tell it from the best.
    verdict : str
        In words.
    """

    name: str
    bic: float
    delta_chi2: float
    delta_bic: float
    held_out_excess: float
    held_out_error: float
    separable: bool
    verdict: str


@dataclass(frozen=True)
class Comparison:
    """Laws in order, best first.

    Attributes
    ----------
    ranking : tuple of Ranked
    not_separable : tuple of str
        Laws that the records cannot tell from the best.
    verdict : str
        In sentences.
    """

    ranking: tuple[Ranked, ...]
    not_separable: tuple[str, ...]
    verdict: str

    def __repr__(self) -> str:
        """List the laws, then the verdict."""
        width = max(len(r.name) for r in self.ranking)
        scored = not any(np.isnan(r.held_out_excess) for r in self.ranking)
        head = f"    {'law':<{width}}  {'d chi2':>10}  {'d BIC':>10}"
        head += f"  {'held out, d chi2':>20}" if scored else ""
        rows = [
            f"    {r.name:<{width}}  {r.delta_chi2:>10.4g}  {r.delta_bic:>10.4g}"
            + (f"  {r.held_out_excess:>10.4g} +/- {r.held_out_error:<6.2g}" if scored else "")
            for r in self.ranking
        ]
        return "\n".join(["[[Comparison]]", head, *rows, self.verdict])


def compare(fits: Sequence[LawFit], fastest: float) -> Comparison:
    """Rank laws fitted to the same records, by BIC; held-out records decide what BIC leaves open.

    Where no law fits within the noise, chi2 is counted in units of the best reduced chi2: misfit of the model is not
    evidence between models.

    Parameters
    ----------
    fits : sequence of LawFit
    fastest : float
        Largest slip speed in the records [m/s].
    """
    unit = max(1.0, min(fit.quality.inflation**2 for fit in fits))
    ordered = sorted(fits, key=lambda fit: _bic(fit, unit))
    best = ordered[0]
    ranking = tuple(_ranked(fit, best, unit, fastest) for fit in ordered)
    same = tuple(entry.name for entry in ranking[1:] if not entry.separable)
    return Comparison(ranking, same, " ".join(_sentences(best, ranking, unit)))


def _bic(fit: LawFit, unit: float) -> float:
    return fit.quality.chi2 / unit + fit.quality.bic - fit.quality.chi2


def _ranked(fit: LawFit, best: LawFit, unit: float, fastest: float) -> Ranked:
    delta_chi2 = (fit.quality.chi2 - best.quality.chi2) / unit
    delta_bic = _bic(fit, unit) - _bic(best, unit)
    excess, error = _held_out(fit, best, unit)
    penalty = delta_bic - delta_chi2
    worse = excess > max(SIGNIFICANT * error, CLEAR)
    # parameters that gain nothing do not make a law wrong: it holds the best one as a special case
    separable = bool(worse or min(delta_bic, delta_chi2) >= CLEAR)
    return Ranked(
        fit.name,
        _bic(fit, unit),
        delta_chi2,
        delta_bic,
        excess,
        error,
        separable,
        _words(fit, best, delta_chi2, penalty, excess, error, separable, fastest),
    )


def _held_out(fit: LawFit, best: LawFit, unit: float) -> tuple[float, float]:
    if fit.held_out is None or best.held_out is None:
        return np.nan, np.nan
    by_record = (fit.held_out.chi2 - best.held_out.chi2) / unit
    return float(by_record.sum()), float(np.sqrt(len(by_record)) * by_record.std())


def _words(
    fit: LawFit,
    best: LawFit,
    delta_chi2: float,
    penalty: float,
    excess: float,
    error: float,
    separable: bool,
    fastest: float,
) -> str:
    held_out = "" if np.isnan(excess) else f", on held-out records by {excess:+.3g} +/- {error:.2g}"
    if fit is best:
        return f"{fit.name} is the best law"
    if separable:
        return f"{fit.name} is worse: chi2 differs by {delta_chi2:+.4g}{held_out}, BIC by {delta_chi2 + penalty:+.4g}"
    more = fit.quality.free - best.quality.free
    extra = "" if more <= 0 else f", with {more} parameter{'s' if more > 1 else ''} more"
    undetermined = [e for e in fit.parameters.entries if e.undetermined]
    units = ["" if e.unit == "1" else f" {e.unit}" for e in undetermined]
    open_ones = [f"{e.name} = {e.value:.3g}{u}: {e.undetermined}" for e, u in zip(undetermined, units, strict=True)]
    why = f" ({'; '.join(open_ones)})" if open_ones else f" (largest slip speed {fastest:.2g} m/s)"
    return f"{fit.name} cannot be told from it: chi2 differs by {delta_chi2:+.3g}{held_out}{extra}{why}"


def _sentences(best: LawFit, ranking: Sequence[Ranked], unit: float) -> Iterable[str]:
    quality = best.quality
    score = "" if best.held_out is None else f", {best.held_out.chi2_reduced:.3g} per coefficient held out"
    floor = f"; {quality.floor}" if quality.floor else ""
    yield f"{best.name} is the best of {len(ranking)} laws (reduced chi2 {quality.chi2_reduced:.3g}{score}{floor})."
    if unit > 1.0:
        yield (
            f"No law fits within the noise (p = {quality.probability:.1g}): standard deviations are multiplied by "
            f"{quality.inflation:.2g}, and differences of chi2 are counted in units of {unit:.3g}."
        )
    for entry in ranking[1:]:
        yield f"{entry.verdict}."
