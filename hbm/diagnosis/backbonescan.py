"""Amplitudes of a decay with forces at places: what joints that may not have been modelled are scored by.

A small force on the motion of a mode shifts its complex frequency by the work that it does, in phase and in quadrature.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from hbm.diagnosis.backbonecampaign import BackboneCampaign
from hbm.diagnosis.jointscan import PushedRecord, Scanned, scanned, tried_ends
from hbm.fourier import Array
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.records import Record
from hbm.sensitivity.jointforces import Ends, motion_between
from models.causes.addedjoint import AddedJoint
from models.jointed import JointedRig


def backbone_scan(base: Evaluation, campaign: BackboneCampaign, causes: Sequence[AddedJoint]) -> Iterator[Scanned]:
    """Score candidates on the amplitudes of a decay, as :func:`hbm.diagnosis.jointscan.scan` does on records."""
    rig = base.model.rig(base.x)
    if not isinstance(rig, JointedRig) or not (ends := tried_ends(rig, causes)):
        return
    records = [_pushed(r, base, campaign, rig, ends) for r in campaign.data.records]
    yield from scanned(base, records, ends, causes)


def _pushed(
    record: Record, base: Evaluation, campaign: BackboneCampaign, rig: JointedRig, ends: Sequence[Ends]
) -> PushedRecord:
    solution, own = base.found[record.number].solution, base.white.record == record.number
    motion = solution.basis.complex(motion_between(rig, solution, ends).T)[1]
    modes = solution.basis.complex(solution.state.Q)[1]
    omega = 2 * np.pi * solution.hz
    shift = -motion.conj() / (
        np.linalg.norm(modes) ** 2 * 4 * np.pi * omega
    )  # of the complex frequency [Hz], per force
    std = campaign.std(record).ravel()
    return PushedRecord(
        base.white.residual[own],
        base.white.jacobian[own],
        [_parts(s) / std[:, None] for s in shift],
        motion[:, None],
        np.abs(motion),
        omega,
        omega,
    )


def _parts(shift: complex) -> Array:
    """Shift of frequency and half bandwidth by the cosine and the sine of a force, (2, 2)."""
    return np.array([[shift.real, shift.imag], [shift.imag, -shift.real]])
