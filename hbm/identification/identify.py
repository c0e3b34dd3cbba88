"""Identification of friction laws from reconstructed contact signals; :func:`identify` is the entry."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from hbm.errors import InputError, expect_rig
from hbm.fourier import Array
from hbm.identification.comparison import Comparison, compare
from hbm.identification.fit import Judged, LeastSquares, fit, uncertainty, whitened
from hbm.identification.judgement import fitted_parameters
from hbm.identification.lawfit import HeldOut, LawFit, Loops, Quality
from hbm.identification.start import Candidate, Scales, candidate, scales_of
from hbm.inverse.contactforce import to_samples
from hbm.inverse.observed import Observed, observe
from hbm.inverse.reconstruction import Reconstruction
from hbm.parallel import one_thread
from models.display import Displayed
from models.friction import FrictionLaw
from models.plausible import quiet
from models.rig import Rig

LAWS = ("coulomb-penalty", "stribeck", "dahl", "lugre")
"""Laws that the paper identifies."""

HELD = ("stribeck.exponent",)
"""Parameters that are not fitted unless asked for: the paper prescribes the exponent of the Stribeck law."""

FOLDS = 5
"""Parts of the records that are held out in turn, where none are named."""

FOLD_STEP = 0.05
"""Held out, a coordinate (a logarithm, mostly) that the records leave open moves by about this much at most."""

PHASES = 256
"""Phases of the loops."""

OnProgress = Callable[[str, float], None]
"""Told what is done in words, and the fraction of the work that is done."""


@dataclass(frozen=True, eq=False)
class Identification(Displayed):
    """Friction laws fitted to the same reconstructed records.

    Attributes
    ----------
    fits : dict of str to LawFit
        By the names asked for.
    comparison : Comparison
        Which is best, and which cannot be told from it.
    levels : dict of float to dict of str to LawFit
        Fits to the records of each nominal force [N]; empty unless asked for.
    """

    fits: Mapping[str, LawFit]
    comparison: Comparison
    levels: Mapping[float, Mapping[str, LawFit]]

    def __getitem__(self, name: str) -> LawFit:
        """Fit by the law's name."""
        return self.fits[name]

    @property
    def best(self) -> LawFit:
        """Fit of the best law."""
        return self.fits[self.comparison.ranking[0].name]

    def __repr__(self) -> str:
        """Report of every law, best first, then the comparison."""
        ordered = [str(self.fits[entry.name]) for entry in self.comparison.ranking]
        return "\n\n".join([*ordered, str(self.comparison)])


@one_thread
@quiet()
def identify(
    rig: Rig,
    reconstruction: Reconstruction,
    laws: Sequence[str | type | FrictionLaw] = LAWS,
    *,
    held_out: Iterable[int | str] | None = None,
    hold: Iterable[str] = HELD,
    by_level: bool = False,
    on_progress: OnProgress | None = None,
) -> Identification:
    """Fit friction laws to reconstructed contact signals, and compare them.

    Each law is shown the reconstructed slip and reaction; what it predicts of harmonics 1..H of the friction force is
    compared with what was reconstructed, weighted by the covariance of the difference: noise of the force, and of the
    slip through the law's slope. The mean is left out, accelerometers do not see it. Harmonics of the slip above those
    measured follow from the law's own force and the structure (:mod:`hbm.inverse.observed`).

    Parameters
    ----------
    rig : Rig
        Its law's parameters are not used; a law of its class takes over its settings.
    reconstruction : Reconstruction
        Reconstruction of records on this rig.
    laws : sequence of str, law class, or law
        Names in :data:`models.LAWS` or ``file.py:Class``; a law with parameters is where its fit starts.
    held_out : iterable of int, optional
        Records that no fit sees and all are scored on. Where omitted, each fifth of the records is held out in turn,
        with parameters one Gauss-Newton step from those of all records.
    hold : iterable of str
        Parameters that are not fitted, wherever a law has them, or of one law, as ``stribeck.exponent``.
    by_level : bool
        Fit the records of each nominal force by themselves too.
    on_progress : callable, optional
        Called with what is done and the fraction done.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        If a law, a parameter held or a record is unknown, or a law cannot be fitted to this contact.

    References
    ----------
    docs/theory/equations.md sections 3 and 5; (24).
    """
    expect_rig(rig, "identify")
    if not isinstance(reconstruction, Reconstruction):
        given = type(reconstruction).__name__
        raise InputError(f"identify: reconstruction is a {given}; must be a Reconstruction, as reconstruct returns")
    held = None if held_out is None else _held(reconstruction, held_out)
    scales, observed = scales_of(reconstruction), observe(reconstruction)
    candidates = _candidates(laws, rig, scales, tuple(hold))
    forces = sorted({r.level for r in observed.records}) if by_level else []
    total, done = len(candidates) * (1 + len(forces)), 0

    def fitted(of: Candidate, records: Observed, where: str, score: npt.NDArray[np.bool_] | None) -> LawFit:
        nonlocal done

        def report(step: str) -> None:
            if on_progress is not None:
                on_progress(f"{of.label}{where}: {step}", done / total)

        result = _fit_law(of, records, scales, score, report)
        done += 1
        return result

    fits = {c.label: fitted(c, observed, "", held) for c in candidates}
    levels = {
        force: {
            c.label: fitted(
                replace(c, x=c.coordinates.of(_values(fits[c.label]))),
                observed.of(np.array([r.level == force for r in observed.records])),
                f" at {force:g} N",
                None,
            )
            for c in candidates
        }
        for force in forces
    }
    if on_progress is not None:
        on_progress("done", 1.0)
    return Identification(fits, compare(list(fits.values()), float(scales.fastest)), levels)


def _values(fit: LawFit) -> dict[str, float]:
    return {name: entry.value for name, entry in fit.parameters.items()}


def _held(reconstruction: Reconstruction, held_out: Iterable[int | str]) -> npt.NDArray[np.bool_]:
    keep = np.zeros(len(reconstruction), dtype=bool)
    keep[[reconstruction.index(record) for record in held_out]] = True
    if keep.all() or not keep.any():
        found = "all records are" if keep.all() else "no record is"
        raise InputError(f"identify: {found} held out; must be some of them")
    return keep


def _candidates(
    laws: Sequence[str | type | FrictionLaw], rig: Rig, scales: Scales, hold: tuple[str, ...]
) -> list[Candidate]:
    if not laws:
        raise InputError("identify: no law to fit; name at least one")
    made = [candidate(law, rig.contact.law, scales, hold) for law in laws]
    labels = [c.label for c in made]
    for label in labels:
        if labels.count(label) > 1:
            raise InputError(f"identify: law {label} is named twice; must be once")
    known = {name for c in made for name in c.coordinates.parameters}
    of_laws = {f"{c.law.name}.{name}" for c in made for name in c.coordinates.parameters}
    for name in hold:
        if name not in known | of_laws and name not in HELD:
            raise InputError(
                f"identify: no law has a parameter {name} to hold; parameters are {', '.join(sorted(known))}"
            )
    return made


# ---- one law


def _fit_law(
    of: Candidate,
    observed: Observed,
    scales: Scales,
    held: npt.NDArray[np.bool_] | None,
    on_step: Callable[[str], None],
) -> LawFit:
    """Fit, and score on records held out."""
    training = observed if held is None else observed.of(~held)
    problem, found = fit(of, training, on_step)
    on_step("held-out records")
    score = _in_folds(problem, found) if held is None else _on_others(of, found, observed.of(held))
    return _law_fit(problem, found, score, scales)


def _law_fit(problem: LeastSquares, found: Judged, score: HeldOut | None, scales: Scales) -> LawFit:
    observed, of = problem.observed, problem.candidate
    informed = sum(record.informed for record in observed.records)
    by_noise = problem.by_noise(found.x)
    quality = Quality(float(found.chi2.sum()), informed, len(found.x), problem.model.evaluations, by_noise)
    basis, H = observed.basis, observed.measured
    amplitudes = np.array([basis.complex(answer.T)[: H + 1] for answer in found.answers])
    loops = _loops(observed, amplitudes)
    return LawFit(
        name=of.label,
        law=of.at(found.x),
        parameters=fitted_parameters(
            of.coordinates, found.x, uncertainty(of, found.jacobian) * quality.inflation**2, scales
        ),
        quality=quality,
        records=np.array([record.number for record in observed.records]),
        chi2=found.chi2,
        residual=found.residuals[:, :H] - 1j * found.residuals[:, H:],
        predicted=amplitudes,
        range_error=(np.ptp(loops.friction, axis=1) - np.ptp(loops.fitted_friction, axis=1)) ** 2,
        loops=loops,
        held_out=score,
        notes=tuple(_notes(problem, found)),
    )


def _notes(problem: LeastSquares, found: Judged) -> Iterable[str]:
    missed = [r.name for r, a in zip(problem.observed.records, found.answers, strict=True) if not a.balanced]
    if missed:
        yield (
            f"records {', '.join(missed)}: the motion above harmonic {problem.observed.measured} that goes with the "
            "law was not found, and is left out there"
        )
    strange = [
        f"{record.name} ({chi2:.0f})"
        for record, chi2, times in zip(problem.observed.records, found.chi2, found.strangeness, strict=True)
        if times > 1.0
    ]
    if strange:
        yield f"records that fit much worse than the others count less in the parameters; chi2: {', '.join(strange)}"


def _loops(observed: Observed, amplitudes: npt.NDArray[np.complex128]) -> Loops:
    """Loops of the reconstruction and of the law, harmonics 0..H."""
    H, basis = observed.measured, observed.basis
    friction = np.array([basis.complex(record.friction)[: H + 1] for record in observed.records])
    modal_slip = np.array([basis.complex(record.signals[:, 0])[: H + 1] for record in observed.records])
    forces = (friction, amplitudes)
    slips = (modal_slip + observed.compliance * force for force in forces)
    slip, fitted_slip, T, fitted_T = (to_samples(signal, PHASES) for signal in (*slips, *forces))
    return Loops(slip, T, fitted_slip, fitted_T)


# ---- records held out


def _on_others(of: Candidate, found: Judged, others: Observed) -> HeldOut:
    """Score on records that the fit has not seen."""
    problem = LeastSquares(of, others)
    residuals = problem.residuals(found.x)
    white = whitened(problem.roots(found.x), residuals[..., None])[..., 0]
    return _held_out(others, residuals, white, "named records, fitted without them")


def _in_folds(problem: LeastSquares, found: Judged) -> HeldOut | None:
    """Score each fifth of the records with the parameters of the others, one Gauss-Newton step from those of all."""
    observed = problem.observed
    folds = _folds(observed)
    if len(set(folds)) < 2:
        return None
    residuals, white = np.empty_like(found.residuals), np.empty_like(found.white)
    low, high = problem.candidate.coordinates.bounds
    for fold in sorted(set(folds)):
        test, flat = folds == fold, found.jacobian[folds != fold].reshape(-1, len(found.x))
        stiff = flat.T @ flat + np.eye(len(found.x)) / FOLD_STEP**2
        step = -np.linalg.solve(stiff, flat.T @ found.white[folds != fold].ravel())
        part = LeastSquares(problem.candidate, observed.of(test))
        part.model.start_from(problem.model)
        x = np.clip(found.x + step, low, high)
        residuals[test] = part.residuals(x)
        white[test] = whitened(part.roots(x), residuals[test][..., None])[..., 0]
    return _held_out(observed, residuals, white, f"each of {len(set(folds))} parts in turn")


def _folds(observed: Observed) -> npt.NDArray[np.intp]:
    """Part of each record: levels and frequencies spread over all parts."""
    order = np.lexsort((np.array([r.hz for r in observed.records]), np.array([r.level for r in observed.records])))
    folds = np.empty(len(order), dtype=np.intp)
    folds[order] = np.arange(len(order)) % min(FOLDS, len(order))
    return folds


def _held_out(observed: Observed, residuals: Array, white: Array, how: str) -> HeldOut:
    measured = np.array([record.friction[observed.compared] for record in observed.records])
    return HeldOut(
        records=np.array([record.number for record in observed.records]),
        chi2=np.sum(white**2, axis=1),
        informed=np.array([record.informed for record in observed.records]),
        relative_error=float(np.linalg.norm(residuals) / np.linalg.norm(measured)),
        how=how,
    )
