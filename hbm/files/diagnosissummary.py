"""The summary of a diagnosis: six answers for a reader who stops there, as printed and as on the first screen.

What is wrong, why, what was added to the model, what that gains on records no fit has seen, what remains, and what to
measure next.
"""

import math
from collections.abc import Iterator, Sequence

from hbm.diagnosis.calibrate import moved
from hbm.diagnosis.discrepancy import MOST_LISTED, Discrepancy
from hbm.diagnosis.fullfits import distorted
from hbm.diagnosis.misfit import misfit
from hbm.diagnosis.remainder import first_of, nearly_all, percent, within_noise
from hbm.diagnosis.verdict import NOTHING_TELLS, Diagnosis, Estimate
from hbm.files.identifiedlaw import Value, value_text
from hbm.outputerror.evaluation import Evaluation
from models.causes.cause import Cause

VERDICTS = {
    "consistent": "Consistent",
    "cause-found": "Cause found",
    "main-cause": "Main cause",
    "unexplained": "Unexplained",
}
"""Verdicts in words."""

WRONG, ADDED, REMAINS, NEXT = "What is wrong", "Added to the model", "What remains", "What to measure next"
"""Questions."""

NEW_MOUNTING = (
    "Mount the structure anew and repeat some records: only that tells whether what remains is the structure itself. "
    "{} is stated with --repeatability."
)

FORCE_FIRST = (
    'First put [[extensions]] with cause = "force-distortion" into the rig file and diagnose again: harmonics of the '
    "force were measured that the simulation leaves out, and what they do hides what else is missing."
)

MOST_MOVED = 3
"""Numbers that calibration moved are named in the summary at most."""

MOST_DOUBTED = 4
"""Records that are to be measured again, by name at most."""

MOST_IN = "most in records "
"""Beginning of the place of a remainder that names records."""


def verdict_line(d: Diagnosis) -> str:
    """The verdict, the cause with what is not told from it, and how sure it is."""
    cause = "" if d.cause is None else f" {d.cause}{d.alternatives},"
    rest = "; the rest is unexplained" if d.verdict == "main-cause" else ""
    return f"{VERDICTS[d.verdict]}:{cause} {d.belief} (confidence {d.confidence:.2f}){rest}."


def first_screen(
    d: Diagnosis, force: Discrepancy | None, where: str, noise: float, doubted: Sequence[str] = ()
) -> dict[str, str]:
    """The six answers by their questions.

    Parameters
    ----------
    d : Diagnosis
    force : Discrepancy or None
        Force that the model lacks.
    where : str
        Name of the signal that shows the misfit best, in words.
    noise : float
        Relative error that noise alone makes, on the records held out if there are any; 0 where it is not known.
    doubted : sequence of str
        Names of records that something speaks against: they are not steady, a channel is clipped.
    """
    return {
        WRONG: _wrong(d, where),
        "Why": " ".join(_why(d, force)),
        ADDED: _added(d),
        "Gain": _gain(d, noise),
        REMAINS: d.remainder.sentence,
        NEXT: " ".join(_next(d, force, doubted)),
    }


def text(p: Estimate) -> str:
    """A parameter with its standard deviation and unit."""
    return p.value if isinstance(p.value, str) else value_text(Value("", p.value, p.std, p.unit))


def _wrong(d: Diagnosis, where: str) -> str:
    nominal, calibrated = (percent(d.errors[name]["train"].nrmse) for name in ("nominal", "calibrated"))
    missed = f"rig file misses the records fitted by {nominal} of their response, and by {calibrated} once calibrated"
    if d.verdict != "consistent":
        return f"The {missed}{f', most clearly in {where}' if where else ''}."
    if d.remainder.structured:
        more = f"of which {percent(d.remainder.size)} are more" if d.remainder.size else "as a whole no more"
        return f"Little. The {missed}, {more} than noise."
    if d.room:
        return f"Nothing but what a room does. The {missed}: beside a drift noise alone is left."
    if _told_by_numbers(d):
        return f"Numbers of the rig file, within their tolerances. The {missed}: what is left then is noise."
    return f"Nothing. The {missed}, which is noise."


def _why(d: Diagnosis, force: Discrepancy | None) -> Iterator[str]:
    if d.extended_fit is not None:
        e = d.extended_fit
        yield "; beside it ".join(_said(d, e, i) for i in range(len(e.model.causes))) + f".{_ties(d)}"
    elif d.verdict == "unexplained":
        asked = d.tried or not d.remainder.missed
        yield "No cause that was tried takes most of the misfit." if asked else "The records fitted ask for no cause."
        yield from _missing(force)
    elif d.remainder.structured:
        yield "No cause that was tried takes most of what is left."
    elif d.room:
        yield d.room
    elif _fits_as_it_is(d):
        yield "No cause that was tried makes the records decisively likelier."
    elif told := _told_by_numbers(d):
        which = ", ".join(told)
        yield f"Numbers of the rig file that moved within their tolerances explain the difference, most of all {which}."
    else:
        yield "No number of the rig file had to move much, and no cause that was tried makes the records likelier."


def _fits_as_it_is(d: Diagnosis) -> bool:
    """Whether the rig file leaves noise alone, before calibration."""
    if d.nominal is None or d.campaign is None:
        return False
    if d.floored:
        return within_noise(d.campaign.whiten(d.nominal.found, d.nominal.by_x))
    return misfit(d.nominal, d.campaign).fits


def _told_by_numbers(d: Diagnosis) -> list[str]:
    """Numbers that moved most, where the rig file as it is does not fit."""
    return [] if _fits_as_it_is(d) or not d.calibrated else list(moved(d.calibrated)[:MOST_MOVED])


def _missing(force: Discrepancy | None) -> Iterator[str]:
    """The place of the force that is missing, or the places, if they can be told."""
    if force is None or not force.explainable:
        return
    share, known = nearly_all(force.share(force.best)), force.known
    if known is not None and (force.two or force.own):
        said, most = str(known), ", more than one at any other place" if force.own else ""
        yield f"{said[0].upper()}{said[1:]} would explain {nearly_all(known.share)} of it{most}."
    if force.own:
        return
    if known is not None and force.two:
        beside = "them" if known.several else "it"
        yield f"Beside {beside} an unknown {_unknown(force)} would explain {share} of the rest."
    else:
        yield f"An unknown {_unknown(force)} would explain {share} of it."
    if len(force.alike) > 1:
        yield "These records do not tell these places apart."


def _unknown(force: Discrepancy) -> str:
    """What may be missing at the places that are not told apart.

    The kinds of places differ: a clamp moves, a beam is pushed, a sensor reads.
    """
    named = force.alike[: 1 + MOST_LISTED]
    by_kind = {p.place.kind: [q.place.name for q in named if q.place.kind == p.place.kind] for p in named}
    return " or ".join(f"{kind} at {' or '.join(names)}" for kind, names in by_kind.items()) + _others(force)


def _others(force: Discrepancy) -> str:
    """How many more places there are that are not told apart."""
    more = len(force.alike) - 1 - MOST_LISTED
    return f" or at {more} other place{'s' * (more > 1)}" if more > 0 else ""


def _said(d: Diagnosis, e: Evaluation, i: int) -> str:
    """A cause in words, with its numbers and those of the rig file; the first cause has standard deviations."""
    cause, known = e.model.causes[i], d.parameters if i == 0 else {}
    unknowns = {u.name: u for u in e.model.unknowns[i]}
    numbers = []
    for name, value in e.model.values(e.x, i).items():
        found = text(known.get(name, Estimate(value, unit=unknowns[name].unit)))
        numbers.append(f"{name} {found}{_instead_of(unknowns[name].neutral)}")
    told = f" ({', '.join(numbers)})" if numbers else ""
    alike = f", which these records cannot tell from {' or '.join(d.seconds)}" if i == 1 and d.seconds else ""
    return f"{cause.label}{told}{alike}: {cause.meaning}"


def _ties(d: Diagnosis) -> str:
    return f" These records cannot tell it from {', '.join(d.not_separable)}." if d.not_separable else ""


def meaning(d: Diagnosis) -> str:
    """Meaning of the causes that were found, and what they cannot be told from; nothing where none was found."""
    e = d.extended_fit
    if e is None:
        return ""
    return f"This means: {'; beside it '.join(cause.meaning for cause in e.model.causes)}.{_ties(d)}"


def numbers(d: Diagnosis) -> list[list[str]]:
    """Rows of the table of what was added: cause, number, value with standard deviation and unit, and the rig file's.

    Standard deviations are known of the first cause.
    """
    e = d.extended_fit
    if e is None:
        return []
    rows = []
    for i, cause in enumerate(e.model.causes):
        known, neutral = d.parameters if i == 0 else {}, {u.name: u for u in e.model.unknowns[i]}
        for name, value in e.model.values(e.x, i).items():
            u = neutral[name]
            before = f"{u.neutral:.4g}" if math.isfinite(u.neutral) else "-"
            said = cause.label.partition("parameter:")[2] or name
            rows.append([cause.label, said, text(known.get(name, Estimate(value, unit=u.unit))), before])
    return rows


def _instead_of(neutral: float) -> str:
    """Value of the rig file in words, where it has one."""
    return f" instead of {neutral:.4g}" if math.isfinite(neutral) and neutral != 0.0 else ""


def _added(d: Diagnosis) -> str:
    e = d.extended_fit
    if e is None:
        nearest = " The candidates that came nearest are in candidates/; do not believe them."
        return f"Nothing.{nearest if d.verdict == 'unexplained' and d.tried else ''}"
    calibrated = sum(f.cause < 0 for f in e.model.free)
    causes = " and ".join(cause.label for cause in e.model.causes)
    rest = f"{calibrated} numbers of the rig file are calibrated beside it" if calibrated else "nothing else is changed"
    return f"extended.toml is the rig file with {causes}; {rest}.{_more_modes(d)}"


def _more_modes(d: Diagnosis) -> str:
    """What a beam needs to be simulated as the records were, where its rig file keeps fewer modes."""
    if d.extended is None or d.campaign is None or d.extended.beam is None:
        return ""
    taken = d.campaign.numerics.working.modes
    if taken <= d.extended.beam.modes:
        return ""
    return f" The records took {taken} modes: set modes = {taken} in its [beam] for the same accuracy."


def _gain(d: Diagnosis, noise: float) -> str:
    count = len(d.held_out_records)
    part, records = "train", "records fitted (none was held out)"
    if count:
        part, records = "held_out", f"{count} record{'s' * (count > 1)} held out"
    models = {
        "nominal": "with the rig file as it is",
        "calibrated": "with it calibrated",
        "extended": f"with {d.cause}",
    }
    known = [(d.errors[name][part].nrmse, said) for name, said in models.items() if part in d.errors.get(name, {})]
    told = [f"{percent(nrmse)} {said}" for nrmse, said in known]
    alone = f"; {percent(noise)} by {d.noise} alone" if noise > 0.0 else ""
    return f"{'' if 'extended' in d.errors else 'None. '}Error on the {records}: {', '.join(told)}{alone}."


def _next(d: Diagnosis, force: Discrepancy | None, doubted: Sequence[str]) -> Iterator[str]:
    if doubted and d.remainder.structured:
        yield f"First measure again what is warned of below: {_named(doubted)}."
    if d.not_separable:
        advice = d.separate_by or NOTHING_TELLS
        yield f"To tell {d.cause} from {d.not_separable[0]}: {advice}."
    if d.extended_fit is not None:
        yield from _checks(d.extended_fit.model.causes)
    left_out = d.verdict in ("main-cause", "unexplained") and _distorted(d)
    if left_out:
        yield FORCE_FIRST
    if d.verdict == "main-cause":
        if not left_out:
            yield "For the rest, run hbm diagnose on extended.toml: it places the force that is still missing."
    elif d.verdict == "unexplained":
        yield from _where_to_look(d, force)
    elif d.remainder.structured:
        yield NEW_MOUNTING.format(f"What does not repeat{' beyond what counts already' if d.noise != 'noise' else ''}")
    elif d.room:
        yield "Note the temperature of the structure beside each record, or repeat some of the first at the end."
    elif d.verdict == "consistent":
        yield "Nothing for these records. Levels, modes and harmonics that were not measured may still show something."


def _distorted(d: Diagnosis) -> bool:
    """Whether harmonics of the force were measured that the model of the verdict does not apply."""
    if d.campaign is None or d.floored or d.nominal is None:
        return False
    rig = d.nominal.model.nominal if d.extended is None else d.extended
    return distorted(d.campaign) and not rig.excitation.measured_harmonics


def _named(records: Sequence[str]) -> str:
    """Some records by name, and how many more there are."""
    return f"{'record' if len(records) == 1 else 'records'} {first_of(records, MOST_DOUBTED)}"


def _checks(causes: Sequence[Cause]) -> Iterator[str]:
    """Experiments that would confirm causes; where a user's own cause names none, what confirms any."""
    checks: dict[str, list[str]] = {}
    for cause in causes:
        checks.setdefault(getattr(cause, "check", "") or Cause.check, []).append(cause.label)
    for check, labels in checks.items():
        yield f"To confirm {' and '.join(labels)}: {check}."


def _where_to_look(d: Diagnosis, force: Discrepancy | None) -> Iterator[str]:
    if d.remainder.missed:
        yield "What is wrong shows in the records held out alone: hold out fewer of them, so that some are fitted."
        return
    records = [place.removeprefix(MOST_IN) for place in d.remainder.places if place.startswith(MOST_IN)]
    yield f"Add records where most remains{f': {records[0]}' if records else ''}."
    if force is not None and force.explainable:
        yield _places(force)
    else:
        yield "More accelerometers would place the force that is missing."


def _places(force: Discrepancy) -> str:
    """Where to look for what is missing."""
    place, names = force.best.place, " or ".join(p.place.name for p in force.alike[: 1 + MOST_LISTED]) + _others(force)
    if force.known is not None and force.own:
        return f"Look at {force.known.at}: the missing {'forces are' if force.known.several else 'force is'} there."
    known = force.known if force.two else None
    most = known is not None and known.share < force.best.share - known.share  # beside it, the place explains more
    first = "Look at" if known is None or most else f"Look at {known.at} and at"
    then = f", then at {known.at}" if known is not None and most else ""
    if len(force.alike) > 1:
        return f"{first} {names}, which these records do not tell apart{then}."
    if known is not None:
        return f"{first} {names}{then}: what is missing is there, if it is at two places."
    return f"{first} {names}: the missing {place.kind} is there, if it is at one place."
