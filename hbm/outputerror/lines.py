"""Records under a force of many lines beside what a rig with joints makes of them.

A multisine has hundreds or thousands of lines in one record. Its force is put in as measured, line by line. Standard
deviations of the force go through the linear rig to the channels and are added to theirs there, line by line.
"""

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, Self

import numpy as np

from continuation import ConvergenceError
from hbm.balance.lines import EXACT, LineBalance, LinesHere
from hbm.balance.scaled import State
from hbm.balance.solution import PeriodicSolution, describe_joints
from hbm.channels import factor
from hbm.errors import InputError
from hbm.fourier import MANY, Array, sampled
from hbm.inverse.sensing import Complex, readings
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.floored import FlooredCampaign
from hbm.outputerror.numerics import Grid, Numerics
from hbm.outputerror.records import Measurement, Record, parts
from hbm.outputerror.simulated import FAILURES, Simulated, Solutions, States, in_record, states
from hbm.sensitivity.lines import LineChannels, line_changes
from models.jointed import AnyRig, JointedRig

ROUGH = 1e-4
"""Accuracy of derivatives in a race, relative: least squares that follow them end as near as races are told apart."""


@dataclass(frozen=True, eq=False)
class LineCampaign(FlooredCampaign):
    """Records of many lines, all simulated up to the same frequency, or further to their own highest line.

    Attributes
    ----------
    forces : dict of int to (2H+1,) array
        Coefficients of the force of each record [N], up to there.
    accuracy : float
        Of derivatives.
    """

    floor_of: ClassVar[str] = "the rms of the lines of a channel on each of them"

    forces: Mapping[int, Array] = field(default_factory=dict)
    accuracy: float = EXACT

    @property
    def described(self) -> str:
        """The records in words."""
        lines = int(np.max([r.listed[0].any(axis=0).sum() for r in self.data.records]))
        return f"{len(self.data.records)} records of up to {lines} lines"

    def simulate(
        self, rig: AnyRig, keys: Sequence[str], starts: States, needed: Collection[int] = ()
    ) -> dict[int, Simulated]:
        """As of any campaign; what the force is uncertain by is in the standard deviations of the channels."""
        task = partial(_simulated, rig, self.finer, self.data.channels, self.forces, tuple(keys), self.accuracy)
        return self._found(partial(map, task), starts, needed)

    def solve(self, rig: AnyRig, last: Solutions) -> dict[int, PeriodicSolution]:
        """As of any campaign: each record on its own lines."""
        return {number: s.solution for number, s in self.simulate(rig, (), states(last)).items()}

    def reconstructed(self, rig: AnyRig) -> dict[int, PeriodicSolution]:
        """As of any campaign, from nothing: what was measured on their lines is no start on more of them."""
        return self.solve(rig, {})

    def roughly(self) -> Self:
        """The same for a race, in which derivatives need not be exact."""
        return replace(self, accuracy=ROUGH)

    @property
    def finer(self) -> int:
        """How many times the harmonics of a record it is simulated with."""
        return self.numerics.working.basis.H // self.data.H

    def balance(self, rig: JointedRig, record: Record) -> LineBalance:
        """The balance of a rig in a record."""
        return _balance(rig, self.finer, record, self.forces[record.number])


def line_campaign(rig: JointedRig, spectra: MeasuredSpectra, executor: Executor | None = None) -> LineCampaign:
    """Records of spectra of many lines.

    Raises
    ------
    InputError
        If no response, or no force, was measured.
    """
    seen = readings(rig, spectra)
    if not seen.force.any():
        raise InputError(f"{spectra.source}: has no force channel; records of more than {MANY} harmonics must have one")
    records, forces = [], {}
    for i, number in enumerate(spectra.records.tolist()):
        response = _linear(rig, seen.channels, seen.i_omega[i])
        listed = seen.weight[i].T > 0.0  # (c, H+1)
        noise = np.where(listed, 1.0 / np.where(listed, seen.weight[i].T, 1.0), np.nan)
        std = np.hypot(noise, np.abs(response) * seen.force_std[i])
        amplitudes = np.where(listed, seen.measured[i].T, np.nan)
        seen_or_forced = np.flatnonzero(listed.any(axis=0) | (seen.force[i] != 0.0))
        top = max(int(spectra.H * spectra.hz.min() / spectra.hz[i]), int(seen_or_forced.max(initial=1)))
        forces[number], own = _coefficients(seen.force[i, : top + 1]), slice(1, top + 1)
        records.append(
            Record(
                number=number,
                name=spectra.label(number),
                hz=float(spectra.hz[i]),
                force=float(np.sqrt(np.sum(np.abs(seen.force[i]) ** 2) / 2.0)),
                force_std=0.0,
                measured=np.array([amplitudes.real, np.where(listed, amplitudes.imag, np.nan)])[:, :, own],
                std=std[:, own],
                start=State(np.zeros((1, 0)), np.zeros((1, 0)), 2 * np.pi * float(spectra.hz[i]), 1.0),
                distortion=np.full((2, top - 1), np.nan),
                distortion_std=np.full(top - 1, np.nan),
                level=float(spectra.level[i]),
            )
        )
    grid = Grid(sampled(max(len(f) // 2 for f in forces.values()), 0), rig.structure.n)
    speed = np.array([r.force for r in records])
    data = Measurement(tuple(records), seen.channels, grid.basis.H, speed)
    return LineCampaign(data, Numerics(grid, grid, grid, 0.0), executor=executor, forces=forces)


def _coefficients(amplitudes: Complex) -> Array:
    return np.concatenate([amplitudes.real, -amplitudes.imag[1:]])


def _linear(rig: JointedRig, channels: Sequence[str], i_omega: Complex) -> Complex:
    """Frequency response (c, H+1) of channels of a rig without its joints to the excitation."""
    s, own = rig.structure, {c.name: (i, c) for i, c in enumerate(rig.response_channels)}
    rate = i_omega[1:, None, None]
    stiffness = np.diag(s.omega_n**2) + rate * s.damping + rate**2 * np.eye(s.n)
    Q = np.linalg.solve(stiffness, np.broadcast_to(s.excitation[:, None], (len(rate), s.n, 1)))[:, :, 0]
    rows = [own[name] for name in channels]
    moved = [factor(c, i_omega[1:]) * (Q @ s.channels[i] + s.channels_by_force[i]) for i, c in rows]
    return np.pad(moved, ((0, 0), (1, 0)))  # no channel tells a mean


def receptances(here: LinesHere, channels: Sequence[str], places: int) -> tuple[Complex, Complex]:
    """Readings (p, c, H+1) of channels, and motion (p, H+1) there, per force at each of the last p ports."""
    problem, s = here.problem, here.problem.structure
    rate = 1j * problem.Omega * np.arange(problem.basis.H + 1)
    forces = here.closed[:, :, -places:]  # (H+1, m, p)
    moved = (problem.yielding[:, -places:] @ forces).diagonal(axis1=1, axis2=2)
    Q = problem.modes.between(np.eye(s.n), s.joints) @ forces
    named = {c.name: (i, c) for i, c in enumerate(problem.rig.response_channels)}
    read = []
    for name in channels:
        i, c = named[name]
        seen = np.einsum("n,hnp->hp", s.channels[i], Q) + np.einsum("m,hmp->hp", s.channels_by_joints[i], forces)
        read.append(factor(c, rate)[:, None] * seen)
    return np.array(read).transpose(2, 0, 1), moved.T


def line_state(balance: LineBalance, last: State | None) -> LinesHere:
    """Steady state of a record, from the last one, if need be with more joints that do not push yet, or from nothing.

    Raises
    ------
    ConvergenceError
        If it is not found.
    """
    size, ports = balance.basis.size, len(balance.own)
    if last is None or not ports or len(last.T) != size or not 0 < last.T.shape[1] <= ports:
        return balance.solved()
    known = np.zeros((size, ports))
    known[:, : last.T.shape[1]] = last.T
    try:
        return balance.solved(known)
    except ConvergenceError:
        if last.T.shape[1] == ports:
            raise
        return balance.solved()


def _balance(rig: JointedRig, finer: int, record: Record, force: Array) -> LineBalance:
    """The balance of a rig in a record, on so many times its harmonics."""
    H = len(force) // 2
    # four samples a period of the highest line: the cube of a motion does not fold back on it
    basis = sampled(finer * H, 0)
    excitation = np.zeros(basis.size)
    excitation[: H + 1], excitation[basis.H + 1 : basis.H + H + 1] = force[: H + 1], force[H + 1 :]
    return LineBalance(rig, basis, record.hz, excitation * rig.excitation.gain(record.level))


def _simulated(
    rig: AnyRig,
    finer: int,
    channels: Sequence[str],
    forces: Mapping[int, Array],
    keys: tuple[str, ...],
    accuracy: float,
    record: Record,
    last: State | None,
) -> Simulated | None:
    """One record with derivatives to keys; None where no steady state is found."""
    assert isinstance(rig, JointedRig)  # of which alone a campaign of lines is made
    try:
        here = line_state(_balance(rig, finer, record, forces[record.number]), last)
        solution: PeriodicSolution = describe_joints(here.problem, here.state, record.hz)
        own, by_keys = in_record(rig, keys, record)
        Q, T = line_changes(here, own, accuracy)
    except FAILURES:
        return None
    by_keys[-1] /= record.force_on(rig)  # the balance counts its force in shares of all lines
    by = LineChannels(here.problem, solution, own, Q, T)
    basis, H = solution.basis, record.measured.shape[2]
    amplitudes = [parts(basis, solution[name].coefficients, H) for name in channels]
    slopes = [parts(basis, by[name].coefficients @ by_keys, H) for name in channels]
    nothing = np.zeros(record.measured.shape)
    return Simulated(
        solution=solution,
        amplitudes=np.stack(amplitudes, axis=1),
        by_keys=np.stack(slopes, axis=1),
        by_force=nothing,
        by_hz=nothing,
        by_tones=None,
        by_history=None,
        by_transients=None,
        Q_by_keys=Q @ by_keys,
        T_by_keys=T @ by_keys,
    )
