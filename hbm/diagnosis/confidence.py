"""How sure a verdict is: how often such ones were right, and whether anything is missing at all."""

import numpy as np

from hbm.diagnosis.decide import Decision, evidence, inside, seconded
from hbm.diagnosis.search import Search
from hbm.outputerror.background import weights
from hbm.outputerror.evaluation import Evaluation

FORETOLD = 0.8
"""Share of the misfit of the records held out that a cause explains, from which on it counts as foretold."""

RELIABLE = {
    "foretold": 0.98,
    "noise": 0.75,
    "cause-found": 0.79,
    "main-cause": 0.36,
    "unexplained": 0.92,
    "consistent": 0.98,
    "within": 0.72,
}
"""How often verdicts are right: a cause that leaves noise alone and foretells the records held out, one that leaves
noise alone, one that leaves a background, a main cause, and so on; `within` where numbers within their tolerances
explain what is missed. Right ones and one more, of all and two more, in 357 cases; docs/theory/diagnosis.md says which
were counted."""


def rivals(decision: Decision, best: Evaluation) -> list[Evaluation]:
    """Models that a repetition may decide for in place of the best; what contains that would have to be decisive.

    Of two causes the first gives the name: with another second one it is the same.
    """
    others = [e for e in decision.fits if e is best or not seconded(best, e)]
    return [decision.base, *(e for e in others if not inside(e, [best]))]


def nothing_missing(search: Search, decision: Decision) -> float:
    """Probability that nothing is missing, of odds before as blind cases had them; the candidates share theirs."""
    base, before = decision.base, RELIABLE["consistent"]
    fits = [evidence(e) - evidence(base) for e in decision.fits]
    beside = fits or [-s.gain for s in search.screenings[-1].scores if s.drop > 0.0]
    dearer = 2.0 * np.log(max(len(search.candidates), 1) * before / (1.0 - before))
    return float(weights([0.0, *(b + dearer for b in beside)])[0])
