"""Exact one-step maps of linear modes under forces that are linear over the step."""

import numpy as np
from scipy.linalg import expm

from models.structure import Array, ModalStructure


def propagators(structure: ModalStructure, Omega: float, dt: float) -> Array:
    """Exact one-step maps of every mode.

    Parameters
    ----------
    structure : ModalStructure
    Omega : float
        Frequency of the force [rad/s].
    dt : float
        Step [s].

    Returns
    -------
    (n, 2, 6) array
        (q, q') at the end of the step from its inputs at the start: q [m], q' [m/s], a generalised force that
        stays [N], one that grows from 0 to 1 N over the step, and cos and sin of the phase of the unit force.
    """
    w, n = structure.omega_n, structure.n
    scale = np.maximum(w, 1.0 / dt)  # modal displacement as a velocity, so that all entries are of order one
    M = np.zeros((n, 6, 6))
    M[:, 0, 1] = scale * dt
    M[:, 1, 0] = -(w**2) / scale * dt
    M[:, 1, 1] = -structure.damping * dt
    M[:, 1, 2] = M[:, 1, 4] = M[:, 2, 3] = 1.0
    M[:, 4, 5], M[:, 5, 4] = -Omega * dt, Omega * dt
    E = np.asarray(expm(M))[:, :2]
    E[:, :, 2:] *= dt
    E[:, :, 0] *= scale[:, None]
    E[:, 0] /= scale[:, None]
    return E


def weights(E: Array, dt: float, radius: float | None) -> tuple[float, dict[str, Array]]:
    """Weights of the friction force at both ends of the step.

    Linear interpolation leaves a contact that sticks without compliance unstable: with q = q' + ... = 0 at the
    end of each step the force follows ``f_new = -6 q' / dt - 2 f_old``, spectral radius 2 + sqrt(3), like the
    linear acceleration method. Then the force is delayed by ``delay`` steps and its weight in q raised, which
    for slow modes is the generalised-alpha method of Wood, Bossak and Zienkiewicz; second order remains.

    Parameters
    ----------
    E : (n, 2, 6) array
        From :func:`propagators`.
    dt : float
        Step [s].
    radius : float or None
        Spectral radius of a rigid contact, 0..1; None for linear interpolation.

    Returns
    -------
    delay : float
        In steps.
    dict of str to (n,) array
        `q_old`, `q_new` [s2], `v_old`, `v_new` [s].
    """
    delay = 0.0 if radius is None else (1.0 - radius) / (1.0 + radius)
    raised = 0.0 if radius is None else (1.0 / 12.0 + delay**2 / 4.0) * dt**2
    hold, ramp = E[:, :, 2], E[:, :, 3]
    new = ramp + delay * hold
    new[:, 0] += raised
    old = hold - new
    return delay, {"q_old": old[:, 0], "v_old": old[:, 1], "q_new": new[:, 0], "v_new": new[:, 1]}
