"""A body in modes as the joints, the excitation and the channels of a rig see it."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from models.structure import Array


@dataclass(frozen=True, eq=False)
class JointedStructure:
    """A body in modes as its joints, its excitation and its channels see it.

    ``q'' + damping q' + omega_n^2 q = joints' f + excitation F``, and the motion at the joints is
    ``joints q + flexibility f + flexibility_to_force F``.

    Attributes
    ----------
    omega_n : (n,) array
        Natural frequencies without the joints [rad/s].
    damping : (n, n) array
        [1/s]
    joints : (m, n) array
        Relative displacement at each port of each joint, in turn, per mode.
    flexibility : (m, m) array
        The same per force at each, beyond the modes [m/N].
    excitation : (n,) array
        Drive displacement per mode.
    flexibility_to_force : (m,) array
        Motion at the joints per excitation force beyond the modes, and by reciprocity of the drive per joint force.
    drive_by_force : float
        Drive displacement per excitation force beyond the modes.
    channels : (c, n) array
        Displacement at each response channel per mode.
    channels_by_joints : (c, m) array
    channels_by_force : (c,) array
        The same per force at the joints and at the drive, beyond the modes.
    loads_inertia, loads_damping : (j, n) array
        What the reaction that loads each joint differs by from that at rest, per modal acceleration and velocity; zero
        where a joint has no reaction to load it.
    loads_by_joints : (j, m) array
    loads_by_force : (j,) array
        The same per force at the joints and at the drive.
    """

    omega_n: Array
    damping: Array
    joints: Array
    flexibility: Array
    excitation: Array
    flexibility_to_force: Array
    drive_by_force: float
    channels: Array
    channels_by_joints: Array
    channels_by_force: Array
    loads_inertia: Array
    loads_damping: Array
    loads_by_joints: Array
    loads_by_force: Array

    @property
    def n(self) -> int:
        """Number of modes."""
        return len(self.omega_n)

    def stacked(self, changes: "Sequence[JointedStructure]") -> "JointedStructure":
        """Changes of this structure in one, along a last axis."""
        found: dict[str, Any] = {f.name: np.zeros((*np.shape(getattr(self, f.name)), 0)) for f in fields(self)}
        if changes:
            found = {name: np.stack([getattr(c, name) for c in changes], axis=-1) for name in found}
        return JointedStructure(**found)

    def acted_on(self, port: int) -> "JointedStructure":
        """The same with its excitation at a port of its joints, where it acts beside the force of the law."""
        return replace(
            self,
            excitation=self.joints[port],
            flexibility_to_force=self.flexibility[port],
            drive_by_force=float(self.flexibility[port, port]),
            channels_by_force=self.channels_by_joints[:, port],
            loads_by_force=self.loads_by_joints[:, port],
        )

    def damps(self, shape: Array) -> float:
        """Damping 2 zeta omega of a mass-normalised shape (n,) [1/s]."""
        return float(shape @ self.damping @ shape)
