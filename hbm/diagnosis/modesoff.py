"""Modes that are a little off: no structure has each natural frequency and damping ratio that its model gives it.

A number of a cause may hang on one resonance, such as that of an upper mode which a superharmonic passes through. No
number of a rig file moves that mode alone, and what a background leaves of the response elsewhere says little of it.
"""

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from hbm.balance.solution import PeriodicSolution
from hbm.diagnosis.forcedrecords import read_by
from hbm.fourier import Array
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.nominal import FREQUENCY, RATIO
from hbm.sensitivity.derivatives import disturbed
from hbm.sensitivity.moving import Disturbance
from models.jointed import JointedRig
from models.rig import Rig


def by_modes(e: Evaluation, campaign: Campaign) -> tuple[Array, Array]:
    """What one tolerance of the natural frequency, and of the damping ratio, of each mode does to records.

    In standard deviations beside the background of the campaign. No columns of rigs whose modes are numbers of the rig
    file themselves.

    Returns
    -------
    (m, n) array, (m, n) array
        Of frequencies and of ratios.
    """
    rig = campaign.numerics.working.rig(e.model.rig(e.x))
    if isinstance(rig, JointedRig):
        return np.zeros((len(e.white), 0)), np.zeros((len(e.white), 0))
    campaign = replace(campaign, corrections=e.corrections)
    file = replace(rig, damping=e.model.nominal.damping)  # what a cause adds to the damping is its own
    columns = {}
    for r in campaign.data.records:
        if r.number in e.found:
            own = r.rig(rig)
            assert isinstance(own, Rig)
            solution = e.found[r.number].solution
            columns[r.number] = read_by(campaign.data, solution, _change(own, solution, file.structure.damping))
    found = {n: replace(s, by_keys=np.concatenate([s.by_keys, columns[n]], axis=-1)) for n, s in e.found.items()}
    added = next(iter(columns.values())).shape[-1]
    white = campaign.whiten(found, block_diag(e.by_x, np.eye(added)))
    frequencies, ratios = np.split(white.jacobian[:, e.by_x.shape[1] :], 2, axis=1)
    return frequencies, ratios


def _change(rig: Rig, solution: PeriodicSolution, damping: Array) -> dict[str, Array]:
    """Of the coefficients of the channels, (2H+1, 2 n)."""
    s, state, basis = rig.structure, solution.state, solution.basis
    spring = 2.0 * FREQUENCY * s.omega_n**2 * state.Q
    damper = RATIO * damping * state.Omega * basis.derivative(state.Q)
    own = np.eye(s.n)
    none = np.zeros((basis.size, 2 * s.n))
    forces = np.concatenate([-spring[:, :, None] * own, -damper[:, :, None] * own], axis=2)
    return disturbed(rig, solution, Disturbance(forces, none, none, none, {}))
