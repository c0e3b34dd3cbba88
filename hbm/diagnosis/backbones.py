"""From a rig and a measured backbone to a diagnosis: which joint bends frequency and damping over the amplitude.

The rig's own backbone is its damped nonlinear normal mode, which a free decay runs along (docs/theory/backbones.md).
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from hbm.diagnosis.backbonecampaign import backbone_campaign
from hbm.diagnosis.backbonescan import backbone_scan
from hbm.diagnosis.diagnose import candidates_among
from hbm.diagnosis.flooredsearch import FlooredSearch
from hbm.diagnosis.standing import OnProgress
from hbm.diagnosis.unfitted import asked_for, unfitted, why_unraced
from hbm.diagnosis.verdict import Diagnosis
from hbm.errors import InputError, expect_rig
from hbm.measurement.decay import Decay
from hbm.parallel import one_thread
from models.causes.cause import Cause
from models.jointed import AnyRig
from models.plausible import quiet

FEWEST = 6
"""Amplitudes of a decay, at least."""

THIRD = 3
"""One amplitude in so many is held out, from the second on."""


@one_thread
@quiet()
def diagnose_backbone(
    rig: AnyRig,
    decay: Decay,
    *,
    held_out: Iterable[int | str] | None = None,
    causes: Iterable[str | Cause | type[Cause]] | None = None,
    tolerances: Mapping[str, float] | None = None,
    on_progress: OnProgress | None = None,
) -> Diagnosis:
    """Say what a simulation gets wrong of a free decay, and which joint that was not modelled explains it.

    Parameters
    ----------
    rig : JointedRig
        Nominal; its mode nearest to the frequency of the smallest amplitude is the one that decays.
    decay : Decay
        Frequency and damping ratio over the amplitude of a channel of the rig.
    held_out : iterable of int, optional
        Numbers of amplitudes that no fit sees, in the order of the decay, from 1; where omitted every third.
    causes, tolerances, on_progress
        As for :func:`hbm.diagnose`. Only joints that may be missing, and numbers of the rig file that may be wrong, are
        tried.

    Returns
    -------
    Diagnosis
        Its records are amplitudes, and the response is their complex frequency: frequency less the mean of those
        fitted, and half the bandwidth.

    Raises
    ------
    InputError
        If there are too few amplitudes, one to hold out is not there, or the rig has not the channel.
    ConvergenceError
        If the rig has no nonlinear mode over these amplitudes.
    """
    expect_rig(rig, "diagnose_backbone", joints=True)
    if len(decay) < FEWEST:
        raise InputError(f"{decay.source}: {len(decay)} amplitudes; must be {FEWEST} at least")
    hidden = _rows(decay, range(2, len(decay) + 1, THIRD) if held_out is None else held_out)
    fitted = [int(n) for n in decay.records if n not in hidden]
    if len(fitted) < FEWEST // 2:
        raise InputError(f"{decay.source}: {len(fitted)} amplitudes are left to fit; must be {FEWEST // 2} at least")
    reference = float(np.mean(decay.hz[np.array(fitted) - 1]))
    campaign, unseen = (
        backbone_campaign(rig, decay, rows, reference) if rows else None for rows in (fitted, sorted(hidden))
    )
    assert campaign is not None  # some are left to fit
    tell = on_progress or (lambda doing, done: None)
    causes = None if causes is None else list(causes)
    candidates = list(candidates_among(rig, causes))
    search = FlooredSearch(rig, campaign, unseen, backbone_scan, candidates, tolerances, tell)
    found = search.diagnosis()
    missing = unfitted(asked_for(candidates, causes), found, partial(why_unraced, search))
    return replace(found, evidence=(*found.evidence, *missing))


def _rows(decay: Decay, named: Iterable[int | str]) -> set[int]:
    """Numbers of amplitudes."""
    found = set()
    for name in named:
        number = int(name) if str(name).isdecimal() else 0
        if not 1 <= number <= len(decay):
            raise InputError(f"{decay.source}: no amplitude {name} to hold out; must be from 1 to {len(decay)}")
        found.add(number)
    return found
