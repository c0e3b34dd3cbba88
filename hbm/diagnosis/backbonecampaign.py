"""A measured backbone beside that of a rig: frequency and damping of a mode over the amplitude of a channel.

A record is one amplitude. Its one reading is the complex frequency of the decay in Hz: the frequency less a reference,
and half the bandwidth, which is the rate of the decay. An error of this reading relative to the half bandwidth
is that of the force that keeps the motion up at its resonance.
"""

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from continuation import ConvergenceError
from hbm.balance.scaled import State
from hbm.errors import InputError
from hbm.fourier import Array, FourierBasis
from hbm.measurement.decay import Decay, damping_ratio, decay_rate
from hbm.modes.backbone import NonlinearMode
from hbm.modes.decaying import at_channel, near_states, over_channel, rate_of
from hbm.modes.linear import linear_modes
from hbm.modes.sensitivity import decay_changes
from hbm.outputerror.floored import FlooredCampaign
from hbm.outputerror.numerics import Grid, Numerics
from hbm.outputerror.records import Measurement, Record
from hbm.outputerror.simulated import FAILURES, Simulated, States
from hbm.response.budget import Budget
from models.jointed import AnyRig, JointedRig

BASIS = FourierBasis(7, 128)
"""Harmonics and samples of the motions; a diagnosis says what twice as many of both would change."""

BUDGET, ALONE = Budget(points=100), Budget(points=300)
"""A branch takes 20 points for two decades, and 60 where something sets in; one that folds is none of a decay. Many are
tried over a rig that has been solved, which may take longer itself."""


@dataclass(frozen=True, eq=False)
class BackboneCampaign(FlooredCampaign):
    """Amplitudes of a decay.

    Attributes
    ----------
    mode : int
        Number of the mode, counted from 1.
    reference : float
        Frequency from which frequencies are counted [Hz].
    """

    floor_of: ClassVar[str] = "the complex frequency at each amplitude"

    mode: int = 1
    reference: float = 0.0

    @property
    def described(self) -> str:
        """The amplitudes in words."""
        return f"{len(self.data.records)} amplitudes of {self.data.channels[0]}"

    @property
    def amplitudes_held(self) -> Array:
        """Amplitude of the channel in each record, (r,)."""
        return np.array([r.level for r in self.data.records])

    def simulate(
        self, rig: AnyRig, keys: Sequence[str], starts: States, needed: Collection[int] = ()
    ) -> dict[int, Simulated]:
        """As of any campaign: all amplitudes, along the nonlinear mode of the rig, or none, which is an error."""
        try:
            return self._simulated(self._motions(rig, starts), keys)
        except FAILURES as failed:
            held = self.amplitudes_held
            raise ConvergenceError(
                f"the nonlinear mode of the rig was not found at all amplitudes, {self.data.channels[0]} = "
                f"{held.min():.3g} to {held.max():.3g}: {failed}; see hbm backbone for how far it goes, and take "
                "amplitudes beyond out of the table"
            ) from None

    def _motions(self, rig: AnyRig, starts: States) -> NonlinearMode:
        """Motions at all amplitudes: from those before, or along the mode where there are none of such a rig."""
        channel, held, basis = self.data.channels[0], self.amplitudes_held, self.numerics.working.basis
        states = [starts[r.number] for r in self.data.records if r.number in starts]
        if len(states) == len(held) and all(s.T.shape == (basis.size, len(rig.motions)) for s in states):
            relief = 4 * np.pi * np.array([float(r.measured[1, 0, 0]) for r in self.data.records])
            with suppress(*FAILURES):
                return near_states(rig, basis, states, relief, channel, held)
        budget = BUDGET if states else ALONE
        branch = over_channel(rig, self.mode, channel, (float(held.min()), float(held.max())), basis, budget)
        return at_channel(branch, channel, held)

    def _simulated(self, motions: NonlinearMode, keys: Sequence[str]) -> dict[int, Simulated]:
        channel = self.data.channels[0]
        half, decaying, rate = motions.hz * motions.damping_ratio, motions.decaying_hz, rate_of(motions, channel)
        # how much faster the channel falls than what is lost says; it hardly changes with the numbers of a rig
        falls = np.divide(rate, 2 * np.pi * half, out=np.ones(len(half)), where=half != 0.0)
        found = {}
        for i, (r, by) in enumerate(zip(self.data.records, decay_changes(motions, channel, keys), strict=True)):
            nothing, by_half = np.zeros(r.measured.shape), by.relief / (4 * np.pi)
            by_hz = (motions.hz[i] * by.hz - half[i] * by_half) / decaying[i]
            found[r.number] = Simulated(
                solution=motions.points[i],
                amplitudes=_reading(float(decaying[i]) - self.reference, float(falls[i] * half[i])),
                by_keys=np.array([by_hz, falls[i] * by_half])[:, None, None],
                by_force=nothing,
                by_hz=nothing,
                by_tones=None,
                by_history=None,
                by_transients=None,
                Q_by_keys=by.Q,
                T_by_keys=by.T,
            )
        return found

    def worst(self, found: Mapping[int, Simulated]) -> str:
        """The largest errors of frequency and damping ratio, in words."""
        hz, ratio = [], []
        for r in self.data.records:
            real, simulated = self._frequency(r.measured), self._frequency(found[r.number].amplitudes)
            hz.append(abs(simulated[0] / real[0] - 1.0))
            ratio.append(abs(simulated[1] / real[1] - 1.0))
        return f", frequency within {100 * max(hz):.2g} % and damping ratio within {100 * max(ratio):.2g} %"

    def _frequency(self, reading: Array) -> tuple[float, float]:
        """Frequency [Hz] and damping ratio of a reading."""
        hz = self.reference + float(reading[0, 0, 0])
        return hz, float(damping_ratio(hz, reading[1, 0, 0]))


def backbone_campaign(rig: AnyRig, decay: Decay, rows: Sequence[int], reference: float) -> BackboneCampaign:
    """Some amplitudes of a decay, by the numbers of their rows.

    Raises
    ------
    InputError
        If the rig has no joints, or not the channel of the decay.
    """
    if not isinstance(rig, JointedRig):
        raise InputError(
            f"{rig.name}: has one contact; a decay is diagnosed with a rig with [[joints]] or [modal] ports"
        )
    if decay.channel not in [c.name for c in rig.response_channels]:
        names = ", ".join(c.name for c in rig.response_channels)
        raise InputError(f"{decay.source}: channel {decay.channel}; must be one of the rig: {names}")
    records = tuple(_record(decay, number, reference) for number in rows)
    stuck = linear_modes(rig).stuck_hz
    mode = 1 + int(np.nanargmin(np.abs(stuck - float(decay.hz[np.argmin(decay.amplitude)]))))
    grid = Grid(BASIS, rig.structure.n)
    data = Measurement(records, (decay.channel,), 1, decay.amplitude[np.array(rows) - 1])
    return BackboneCampaign(data, Numerics(grid, grid, grid, 0.0), mode=mode, reference=reference)


def _record(decay: Decay, number: int, reference: float) -> Record:
    i = number - 1
    hz, ratio, amplitude = float(decay.hz[i]), float(decay.damping_ratio[i]), float(decay.amplitude[i])
    return Record(
        number=number,
        name=str(number),
        hz=hz,
        force=amplitude,
        force_std=0.0,
        measured=_reading(hz - reference, float(decay_rate(hz, ratio))),
        std=_reading(float(decay.hz_std[i]), float(decay.damping_ratio_std[i]) * hz),
        start=State(np.zeros((1, 0)), np.zeros((1, 0)), 2 * np.pi * hz, 1.0),
        distortion=np.full((2, 0), np.nan),
        distortion_std=np.full(0, np.nan),
        level=amplitude,
    )


def _reading(hz: float, half: float) -> Array:
    """Frequency and half bandwidth as the two parts of the fundamental of one channel, (2, 1, 1)."""
    return np.array([hz, half])[:, None, None]
