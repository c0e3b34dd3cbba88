"""Joints that are worth a fit, of those that were scored to first order."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from hbm.diagnosis.decide import TIED, held_by
from hbm.diagnosis.jointscan import Scanned
from hbm.diagnosis.remainder import LEFT
from hbm.diagnosis.turns import HOPELESS
from models.causes.cause import Cause

FITTED, PLACES = 7, 2
"""Joints that are fitted, and places of each law, at most."""

SAME = 1e-6
"""Of the fall of chi2 that a law promises: a place where it differs by less is the same one."""

NEAR = 0.95
"""Share of the fall that a law promises where it fits best, from which on another place is not told from that."""


def hopeful(scores: Sequence[Scanned], missed: float) -> list[Scanned]:
    """Joints worth a fit, of each law at few places: alike at all of them, one law would leave no room for others.

    A law that holds a simpler one, and promises to leave hardly less of what is missed, is none. One that promises the
    very same elsewhere, as a stop the other way round may, is tried once. Of places that are not told apart, such as
    all of a single mode, those that move most come first: what a score to first order promises holds where the smallest
    force does it, and nowhere else where the whole effect is large.
    """
    left = {s.cause.label: missed - s.drop for s in scores}
    plain = [
        s
        for s in scores
        if not any(left[s.cause.label] > LEFT * left.get(name, np.inf) for name in held_by(s.cause) - {s.cause.label})
    ]
    best, at, out = max((s.drop for s in plain), default=0.0), Counter[str](), list[Scanned]()
    for s in sorted(plain, key=lambda s: (-_promise(s, plain), -s.reach)):
        if any(_same(s, o) for o in out):
            continue
        at[s.cause.name] += 1
        if s.drop >= HOPELESS * best and at[s.cause.name] <= PLACES:
            out.append(s)
    return out[:FITTED]


def _promise(s: Scanned, scores: Sequence[Scanned]) -> float:
    """Fall of chi2 by a law where it does most, of places that are not told from that one; else by it here.

    Less what so many numbers take of noise as large as the misfit, as BIC counts it: few readings tell no laws apart.
    """
    most, variance = max(o.drop for o in scores if o.cause.name == s.cause.name), s.deviation**2
    drop = most if s.drop >= max(NEAR * most, most - TIED * variance) else s.drop
    return drop - variance * len(s.cause.numbers) * float(np.log(len(s.signature)))


def elsewhere(best: Cause, scores: Sequence[Scanned]) -> list[Scanned]:
    """The law that fits best at other places that a score to first order does not tell from its own."""
    own = next((s for s in scores if s.cause == best), None)
    if own is None:
        return []
    others = [s for s in scores if s.cause.name == best.name and s.drop >= NEAR * own.drop and not _same(s, own)]
    return sorted(others, key=lambda s: -s.drop)


def alike(named: Cause, scores: Sequence[Scanned]) -> list[Cause]:
    """Where else a law promises the very same: what moves in one mode alone does not tell where it acts."""
    own = next((s for s in scores if s.cause == named), None)
    return [] if own is None else [s.cause for s in scores if s is not own and _same(s, own)]


def _same(one: Scanned, other: Scanned) -> bool:
    """Whether two scores are of one law and promise the very same."""
    return one.cause.name == other.cause.name and bool(np.isclose(other.drop, one.drop, rtol=SAME))
