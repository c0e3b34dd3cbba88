"""What small harmonic forces at places of a body with joints do: receptances of its linearised steady state."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from hbm.balance.scaled import force_shape
from hbm.balance.solution import PeriodicSolution
from hbm.channels import read
from hbm.fourier import Array
from hbm.parallel import one_thread
from hbm.sensitivity.jointed import followed, forces_change, linearized
from models.jointed import JointedRig
from models.joints.joint import GROUND
from models.parts import Channel

Ends = tuple[str, str]
"""Two places of a body, or a place and the ground."""


class Pushed(NamedTuple):
    """What cosines, then sines of harmonics 1..H of a force between two places do, for each of p such pairs.

    Attributes
    ----------
    channels : dict of str to (2H'+1, p 2 H) array
        Coefficients of what each response channel reads.
    moved : (q, 2H'+1, p, 2 H) array
        Relative displacement of each pair of places; q is less than p where forces at joints come after them.
    """

    channels: dict[str, Array]
    moved: Array


@one_thread
def pushed(
    rig: JointedRig, solution: PeriodicSolution, ends: Sequence[Ends], H: int, *, at_joints: bool = False
) -> Pushed:
    """What forces on the body between pairs of places do, on the first of each and back on the second.

    Parameters
    ----------
    rig : JointedRig
        The rig of the solution.
    solution : PeriodicSolution
    ends : sequence of (str, str), (q,)
    H : int
    at_joints : bool
        Whether forces at the ports of the joints, beside those of their laws, come after the pairs.

    Raises
    ------
    ArithmeticError
        At a fold.
    """
    places, probed = probed_at(rig, ends)
    here, s, basis = linearized(probed, solution), probed.structure, solution.basis
    unit = np.zeros((basis.size, 2 * H))
    unit[1 : H + 1, :H] = unit[basis.H + 1 : basis.H + H + 1, H:] = np.eye(H)
    acting = [replace(probed, excitation=replace(rig.excitation, at=place)).structure for place in places]
    acting += [s.acted_on(port) for port in range(len(s.joints))] if at_joints else []
    Q, f = followed(here, np.hstack([forces_change(here, unit, at) for at in acting]))
    moved = np.einsum("cn,knp->ckp", s.channels, Q) + np.einsum("cm,kmp->ckp", s.channels_by_joints, f)
    by_place = moved.reshape(*moved.shape[:2], len(acting), 2 * H)
    by_place += np.einsum("ec,kh->ckeh", np.array([at.channels_by_force for at in acting]), unit)
    signs = between(places, ends)
    pairs = np.einsum("pe,ckeh->ckph", block_diag(signs, np.eye(len(acting) - len(places))), by_place)
    channels = {
        c.name: read(c, basis, pairs[i].reshape(basis.size, -1), here.state.Omega)
        for i, c in enumerate(rig.response_channels)
    }
    return Pushed(channels, np.einsum("qe,ekph->qkph", signs, pairs[len(rig.response_channels) :]))


def motion_between(rig: JointedRig, solution: PeriodicSolution, ends: Sequence[Ends]) -> Array:
    """Coefficients (p, 2H+1) of the relative displacements of pairs of places in a steady state [m]."""
    places, probed = probed_at(rig, ends)
    s, state, own = probed.structure, solution.state, len(rig.response_channels)
    force = state.F * force_shape(rig.excitation, solution.basis, 1)
    there = s.channels @ state.Q.T + s.channels_by_joints @ state.T.T + np.outer(s.channels_by_force, force)
    return np.asarray(between(places, ends) @ there[own:])


def probed_at(rig: JointedRig, ends: Sequence[Ends]) -> tuple[list[str], JointedRig]:
    """Places of pairs, each once, and the rig with a probe of the displacement at each, which come last."""
    places = list(dict.fromkeys(place for pair in ends for place in pair if place != GROUND))
    probes = tuple(Channel(f"probe of {place}", "displacement", at=place) for place in places)
    return places, replace(rig, channels=(*rig.channels, *probes))


def between(places: Sequence[str], ends: Sequence[Ends]) -> Array:
    """Signs with which places make relative displacements of pairs, (p, e)."""
    return np.array([[float(place == one) - float(place == other) for place in places] for one, other in ends])
