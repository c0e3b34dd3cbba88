"""Records of many lines with forces at places: what joints that may not have been modelled are scored by.

Lines are apart: a force at one of them is read at that one alone, through the linear structure and through springs and
dashpots that stand for the joints that are there already (:mod:`hbm.balance.lines`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from hbm.balance.lines import LinesHere
from hbm.diagnosis.jointscan import PushedRecord, Scanned, scanned, tried_ends
from hbm.diagnosis.places import Complex
from hbm.fourier import Array
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.lines import LineCampaign, receptances
from hbm.outputerror.records import Record
from hbm.sensitivity.jointforces import Ends
from models.causes.addedjoint import AddedJoint
from models.jointed import JointedRig
from models.joints import Joint, PolynomialSpring


def line_scan(base: Evaluation, campaign: LineCampaign, causes: Sequence[AddedJoint]) -> Iterator[Scanned]:
    """Score candidates on records of many lines, as :func:`hbm.diagnosis.jointscan.scan` does on others."""
    rig = base.model.rig(base.x)
    if not isinstance(rig, JointedRig) or not (ends := tried_ends(rig, causes)):
        return
    records = [_pushed(r, base, campaign, rig, ends) for r in campaign.data.records if r.number in base.found]
    yield from scanned(base, records, ends, causes)


def _pushed(
    record: Record, base: Evaluation, campaign: LineCampaign, rig: JointedRig, ends: Sequence[Ends]
) -> PushedRecord:
    here = _with_places(record, base, campaign, rig, ends)
    basis, std, own = here.problem.basis, campaign.std(record), base.white.record == record.number
    top = 1 + int(np.flatnonzero(record.listed.any(axis=(0, 1))).max())  # above it nothing is compared
    by_places, moved = receptances(here, campaign.data.channels, len(ends))
    signals = np.stack([s[:, 0] for s in here.signals[-len(ends) :]], axis=1)
    there = basis.complex(signals)[1 : top + 1].T  # (p, H)
    listed, std = record.listed[..., :top], std[..., :top]
    seen = by_places[:, :, 1 : top + 1] * np.where(np.isfinite(std), 1.0 / std, 0.0)  # (p, c, H)
    missed = np.zeros(listed.shape)
    missed[listed] = base.white.residual[own]
    amplitudes = missed[0] + 1j * missed[1]
    size = np.sum(np.abs(seen) ** 2, axis=1)
    force = np.sum(seen.conj() * amplitudes, axis=1) / np.where(size > 0.0, size, 1.0)
    motion = there + moved[:, 1 : top + 1] * force
    waves = [basis.real(np.pad(m, (1, basis.H - top))[:, None]) for m in motion]
    largest = np.array([float(np.abs(basis.samples(w)).max()) for w in waves])
    rate = float(np.linalg.norm(motion * np.arange(1, top + 1))) / max(float(np.linalg.norm(motion)), 1e-300)
    omega = 2 * np.pi * record.hz
    return PushedRecord(
        base.white.residual[own],
        base.white.jacobian[own],
        [_Lines(s, listed) for s in seen],
        motion,
        largest,
        omega * rate,
        omega,
    )


class _Lines:
    """Readings (m,) in standard deviations of a force, line by line."""

    def __init__(self, seen: Complex, listed: npt.NDArray[np.bool_]) -> None:
        self.seen, self.listed = seen, listed

    def __matmul__(self, force: Array) -> Array:
        cosine, sine = np.split(force, 2)
        read = self.seen * (cosine - 1j * sine)
        return np.asarray(np.array([read.real, read.imag])[self.listed])


def _with_places(
    record: Record, base: Evaluation, campaign: LineCampaign, rig: JointedRig, ends: Sequence[Ends]
) -> LinesHere:
    """The steady state of a record with joints at places that do not push."""
    idle = [Joint(f"place {i}", PolynomialSpring(), (at,), (to,) if to else ()) for i, (at, to) in enumerate(ends)]
    balance = campaign.balance(replace(rig, joints=(*rig.joints, *idle)), record)
    known = base.found[record.number].solution.state.T
    return balance.law(np.hstack([known, np.zeros((balance.basis.size, len(ends)))]))
