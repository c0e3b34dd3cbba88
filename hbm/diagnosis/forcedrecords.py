"""Records in standard deviations, with what forces at places and readings of sensors do to them."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from hbm.balance.solution import PeriodicSolution
from hbm.diagnosis.jointplaces import joint_places_of
from hbm.diagnosis.places import CONTACT, AnyPlace, Complex, all_at_once, places_of, sensor
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.records import Measurement, Record, parts
from hbm.outputerror.whitened import uncorrelated
from hbm.sensitivity.derivatives import disturbed
from hbm.sensitivity.jointforces import pushed
from models.jointed import AnyRig, JointedRig
from models.parts import UNITS


def record_places(rig: AnyRig, data: Measurement) -> list[AnyPlace]:
    """Where a force may be missing, and the sensors."""
    unit = {c.name: UNITS[c.quantity] for c in rig.channels}
    forces = joint_places_of(rig) if isinstance(rig, JointedRig) else places_of(rig)
    return [*forces, *(sensor(name, unit[name]) for name in data.channels)]


class WhiteRecord:
    """A record in standard deviations: its misfit, what calibrated numbers and forces at each place do to it.

    Parameters
    ----------
    record : Record
    e : Evaluation
    campaign : Campaign
    places : sequence of Place
        Of the rig as it is in the record.
    columns : (2, c, H, p 2 H + r) array
        Change of the amplitudes with cosines, then sines of harmonics 1..H at each of p places, and with what else acts
        beside each of these.
    """

    def __init__(
        self, record: Record, e: Evaluation, campaign: Campaign, places: Sequence[AnyPlace], columns: Array
    ) -> None:
        self.record, simulated = record, e.found[record.number]
        own = e.white.record == record.number
        self.residual, self.jacobian = e.white.residual[own], e.white.jacobian[own]
        noise, std = campaign.correlated(record, simulated), campaign.listed_std(record)
        white = uncorrelated(noise, columns[record.listed] / std[:, None])
        *self.columns, self.beside = np.split(white, 2 * campaign.data.H * np.arange(1, len(places) + 1), axis=1)
        self.seen = [p.seen(simulated.solution)[1 : campaign.data.H + 1] for p in places]


class Response(NamedTuple):
    """What cosines, then sines of harmonics 1..H at each of p places do, and at the contact or at m ports of joints.

    Attributes
    ----------
    channels : (2, c, H, (p + m) 2 H) array
        Change of the amplitudes of the channels.
    seen : tuple of (H, (1 + m) 2 H) complex array or None
        Change of what each place's own is held against, also with those forces; None where that is not known.
    """

    channels: Array
    seen: tuple[Complex | None, ...]


class Placed(WhiteRecord):
    """A record in standard deviations, and how what is held against a force at each place changes with it."""

    def __init__(
        self, record: Record, e: Evaluation, campaign: Campaign, places: Sequence[AnyPlace], response: Response
    ) -> None:
        super().__init__(record, e, campaign, places, response.channels)
        self.changes = response.seen
        own = e.white.record == record.number
        self.size = float(np.linalg.norm(e.white.measured[own] / campaign.listed_std(record)))

    def held_against(self, i: int, forces: Array, left: Array) -> tuple[Complex, float]:
        """Amplitudes (H,) of what the force found at the i-th place is held against, and how uncertain they are.

        The model moves as the records do only with the forces (2 H or more,), that of the place first; `left` is what
        they miss then, in standard deviations.
        """
        change = self.changes[i]
        if change is None:
            return self.seen[i], float(np.linalg.norm(self.residual)) / self.size
        return self.seen[i] + change[:, : len(forces)] @ forces, float(np.linalg.norm(left)) / self.size


def response_of(data: Measurement, rig: AnyRig, solution: PeriodicSolution) -> Response:
    """What forces at the places of the rig of a record do, and what is added to the readings of the sensors."""
    change, seen = _pushed(rig, data, solution)
    readings = [_of_reading(i, len(data.channels), data.H) for i in range(len(data.channels))]
    places, known = np.split(read_by(data, solution, change), [2 * data.H * len(seen)], axis=3)
    of_sensors = (np.concatenate([own[:, i], known[:, i]], axis=2) for i, own in enumerate(readings))
    read = [real + 1j * imag for real, imag in of_sensors]
    return Response(np.concatenate([places, *readings, known], axis=3), (*seen, *read))


def _pushed(
    rig: AnyRig, data: Measurement, solution: PeriodicSolution
) -> tuple[Mapping[str, Array], Sequence[Complex | None]]:
    """Change of the channels by forces at each place, then at what rubs, and of the motion there where it is known."""
    if not isinstance(rig, JointedRig):
        places = places_of(rig)
        change = disturbed(rig, solution, all_at_once(places, solution, data.H))
        again = 2 * data.H * (places[0].name == CONTACT)
        return {name: np.hstack([by, by[:, :again]]) for name, by in change.items()}, [None] * len(places)
    ends = [place.ends for place in joint_places_of(rig)]
    found, basis = pushed(rig, solution, ends, data.H, at_joints=True), solution.basis
    by_own = (np.delete(moved, [j for j in range(len(ends)) if j != i], axis=1) for i, moved in enumerate(found.moved))
    return found.channels, [basis.complex(by.reshape(len(by), -1))[1 : data.H + 1] for by in by_own]


def read_by(data: Measurement, solution: PeriodicSolution, change: Mapping[str, Array]) -> Array:
    """Change of the amplitudes (2, c, H, p) of the channels, from that of the coefficients."""
    return np.stack([parts(solution.basis, change[name], data.H) for name in data.channels], axis=1)


def _of_reading(channel: int, channels: int, H: int) -> Array:
    """Amplitudes (2, c, H) of one channel with its own cosines and sines (2 H)."""
    out = np.zeros((2, channels, H, 2 * H))
    out[0, channel, :, :H] = np.eye(H)
    out[1, channel, :, H:] = -np.eye(H)
    return out
