"""From a rig and measured spectra to a diagnosis: calibrate, screen, fit, decide, and score on records held out.

:func:`diagnose` is the entry. Only the records to fit reach a fit; those held out are opened once, at the end.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial

import numpy as np

from hbm.diagnosis.conclusion import Conclusion
from hbm.diagnosis.flooredsearch import FlooredSearch
from hbm.diagnosis.heldout import choose_held_out
from hbm.diagnosis.linescan import line_scan
from hbm.diagnosis.remainder import percent
from hbm.diagnosis.search import Search
from hbm.diagnosis.standing import OnProgress
from hbm.diagnosis.unfitted import asked_for, unfitted, why_unfitted, why_unraced
from hbm.diagnosis.unnamed import unnamed_place
from hbm.diagnosis.verdict import Diagnosis
from hbm.errors import InputError, expect_rig
from hbm.fourier import MANY
from hbm.measurement.repeatability import repeatability_of, unrepeatable
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.lines import line_campaign
from hbm.parallel import one_thread
from hbm.rigfiles.causes import named_cause
from models import causes as catalogue
from models.causes.cause import Cause, candidates_of
from models.jointed import AnyRig, JointedRig
from models.parts import alike
from models.plausible import quiet

HALF = "What explains the records first fitted does not hold for those held out: every second of these is fitted too."


@one_thread
@quiet()
def diagnose(
    rig: AnyRig,
    spectra: MeasuredSpectra,
    *,
    held_out: Iterable[int | str] | None = None,
    causes: Iterable[str | Cause | type[Cause]] | None = None,
    tolerances: Mapping[str, float] | None = None,
    repeatability: float = 0.0,
    on_progress: OnProgress | None = None,
    executor: Executor | None = None,
) -> Diagnosis:
    """Say what a simulation gets wrong, which missing effect explains it, and what the extended model gains.

    Parameters
    ----------
    rig : Rig or JointedRig
        The nominal rig.
    spectra : MeasuredSpectra
    held_out : iterable of int or str, optional
        Records that no fit sees; where omitted a level and a frequency band, see :mod:`hbm.diagnosis.heldout`. Where
        what explains the others does not hold for these, every second of them is fitted too, by the best causes alone.
    causes : iterable of str, Cause or class, optional
        Candidates, classes of them, or names as of docs/reference/causes.md, ``parameter:<key>`` and ``file.py:Class``
        among them; a file that is named is run. The whole catalogue and every nominal value where omitted.
    tolerances : mapping of str to float, optional
        Relative standard deviations of numbers of the rig file, by their keys, 0 for one that is exact. Within these
        nothing is called wrong. Those not given are as in :data:`hbm.outputerror.nominal.TOLERANCES`.
    repeatability : float
        Share of its response by which the structure differs from one mounting to the next, 0.01 for 1 %. It counts as
        noise, as do what the rig file states of a channel and what records measured more than once show, whichever is
        largest.
    on_progress : callable, optional
        Called with what is done and the fraction done.
    executor : concurrent.futures.Executor, optional
        Simulates records side by side, in processes for a gain; one after the other where omitted.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        If a cause or the key of a tolerance is none of the rig, no response was measured, a record to hold out is not
        there, a rig cannot be told from its measurements, or it has a force per unit at a level that was not measured.
    ConvergenceError
        If the steady state of no record is found.
    """
    expect_rig(rig, "diagnose", joints=True)
    if not isinstance(spectra, MeasuredSpectra):
        given = f'"{spectra}"' if isinstance(spectra, str) else type(spectra).__name__
        raise InputError(
            f"diagnose: spectra = {given}; must be MeasuredSpectra, as load_spectra(file, rig) returns; "
            "a decay is for diagnose_backbone"
        )
    _expect_levels(rig, spectra)
    numbered = [level for level, _ in rig.excitation.force_gain]
    held = choose_held_out(spectra, numbered) if held_out is None else tuple(spectra.numbers(held_out))
    tell = on_progress or (lambda doing, done: None)
    causes = None if causes is None else list(causes)
    candidates = list(candidates_among(rig, causes))
    shares = repeatability_of(rig, spectra, repeatability)
    spectra = unrepeatable(spectra, shares)

    beside = (*_unrepeatable(shares), *spectra.warnings)
    place = unnamed_place(rig, spectra.split(held)[0] if held else spectra)
    if place is not None and (joints := place.joints(causes)):
        rig, candidates, beside = place.probed, [*candidates, *joints], (*beside, str(place))

    def conclude(held: tuple[int, ...], among: Sequence[Cause], before: int = 0) -> Conclusion:
        train, unseen = spectra.split(held) if held else (spectra, None)
        search = Search(rig, train, among, tolerances, tell, executor, before)
        return Conclusion(search, search.decide(), unseen, held)

    if isinstance(rig, JointedRig) and spectra.H > MANY:
        train, unseen = spectra.split(held) if held else (spectra, None)
        campaign = line_campaign(rig, train, executor)
        hidden = None if unseen is None else line_campaign(rig, unseen, executor)
        search = FlooredSearch(rig, campaign, hidden, line_scan, candidates, tolerances, tell)
        why = partial(why_unraced, search)
        diagnosis = search.diagnosis()
    else:
        found = conclude(held, candidates)
        why = partial(why_unfitted, found.search)
        if held_out is None and found.untold:
            tell("half as many records held out", 0.0)
            found, beside = conclude(held[1::2], found.contenders, found.search.tried), (HALF, *beside)
        diagnosis = found.diagnosis()
    records = tuple(spectra.labels_of(np.array(diagnosis.held_out_records, dtype=int)).tolist())
    missing = unfitted(asked_for(candidates, causes), diagnosis, why)
    evidence = (*beside, *diagnosis.evidence, *missing)
    return replace(diagnosis, held_out_records=records, evidence=evidence, noise=spectra.noise)


def _expect_levels(rig: AnyRig, spectra: MeasuredSpectra) -> None:
    known = np.unique(spectra.level).tolist()
    for i, (level, _) in enumerate(rig.excitation.force_gain, 1):
        if not any(alike(level, other) for other in known):
            accepted = ", ".join(f"{other:g}" for other in known)
            raise InputError(f"{rig.name}: excitation.force_gain[{i}]: level {level:g}; must be one of {accepted}")


def _unrepeatable(shares: Mapping[str, float]) -> Iterator[str]:
    told = ", ".join(f"{name} {percent(share)}" for name, share in shares.items() if share > 0.0)
    if told:
        yield f"What does not repeat from one mounting to the next counts as noise, of the response of {told}."


def candidates_among(rig: AnyRig, causes: Iterable[str | Cause | type[Cause]] | None) -> Iterator[Cause]:
    """Candidates for a rig: some causes, of a class all that there are of it, or the whole catalogue.

    Raises
    ------
    InputError
        If there is no cause of a name, or nothing in the rig that it can act on.
    """
    for cause in catalogue.CAUSES.values() if causes is None else causes:
        if isinstance(cause, str):
            yield from _named(rig, cause)
        else:
            yield from candidates_of(cause, rig) if isinstance(cause, type) else (cause,)


def _named(rig: AnyRig, name: str) -> list[Cause]:
    """Candidates of a name, at least one."""
    try:
        cause = named_cause(name)
    except InputError as refused:
        raise InputError(f'diagnose: causes has "{name}"; {refused}') from None
    one = not isinstance(cause, type)
    possible = list(candidates_of(type(cause) if one else cause, rig))
    found = [c for c in possible if c.label == name] if one else possible
    if not found:
        labels = ", ".join(c.label for c in possible)
        accepted = f"must be one of {labels}" if one else "there is nothing in this rig it can act on"
        raise InputError(f'diagnose: causes has "{name}"; {accepted}')
    return found
