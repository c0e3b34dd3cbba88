"""Harmonics that a transient leaves in a record if it has not died out, by Floquet's theory, motion by motion.

A small disturbance of a steady state is a sum of motions exp(mu t) p(t), p periodic. Over a record of whole periods
each of them has a part at every harmonic: that at k Omega is the mean of exp(mu t) p(t) exp(-i k Omega t),

    sum_m P_m / (mu + i (m - k) Omega)

times a factor that is the same for all harmonics and channels. So the length of the record, and when it began, are in
one complex number for each motion, and need not be known.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import eig

from hbm.balance.equations import Balance
from hbm.balance.jointed import JointBalance
from hbm.balance.scaled import State
from hbm.balance.solution import PeriodicSolution
from hbm.channels import DERIVATIVES, turned
from hbm.fourier import Array, FourierBasis
from hbm.parallel import one_thread
from hbm.stability.floquet import Disturbance
from hbm.stability.jointed import along_solution
from models.jointed import AnyRig, JointedRig
from models.rig import Rig

Complex = npt.NDArray[np.complex128]

WAITED, FADED = 30, 1e-4
"""Periods that a transient has had to die out, at least; what is less than this share by then is none."""


@dataclass(frozen=True, eq=False)
class Transients:
    """Harmonics that a start from rest leaves in a record.

    Attributes
    ----------
    coefficients : (2H+1, c, m, 2) array
        a_0, a_1..a_H, b_1..b_H of each response channel, in its unit, for each motion; and for the same a quarter of a
        cycle later, zero where it does not oscillate.
    decay : (m,) array
        Rates at which they decay [1/s].
    """

    coefficients: Array
    decay: Array


@one_thread
def transients(rig: AnyRig, solution: PeriodicSolution, harmonics: int) -> Transients:
    """Work out the harmonics that transients leave, for a start from rest :data:`WAITED` periods before a record.

    Parameters
    ----------
    rig : Rig or JointedRig
        The rig of the solution.
    solution : PeriodicSolution
    harmonics : int
        H.

    Raises
    ------
    ValueError
        If the rig's clamp slips, or if it is rigid where it sticks: see :class:`hbm.stability.floquet.Disturbance`.
    ArithmeticError
        As :func:`hbm.stability.jointed.along_solution`.
    """
    exponents, seen = _at_joints(rig, solution) if isinstance(rig, JointedRig) else _at_contact(rig, solution)
    Omega, channels = solution.state.Omega, rig.response_channels
    orders = np.array([DERIVATIVES[c.quantity] for c in channels])
    left = _leaked(seen, exponents, Omega, harmonics, orders)
    basis = FourierBasis(harmonics, 2 * harmonics + 1)
    read = [turned(c, basis, basis.real(left[:, i]), Omega) for i, c in enumerate(channels)]
    return Transients(np.stack(read, axis=1), -exponents.real)


def _at_contact(rig: Rig, solution: PeriodicSolution) -> tuple[Complex, Complex]:
    """Exponents (m,) of what a start from rest excites, and displacements at the channels of each, (N_t, c, m)."""
    problem = Balance(rig, solution.basis, level=solution.level)
    exponents, p = _motions(problem, solution.state)
    s, channels = problem.structure, rig.response_channels
    rows = np.array([s.channel_rows[c.name] for c in channels])
    by_friction = np.array([s.residual.channels.get(c.name, (0.0, 0.0))[1] for c in channels])
    return exponents, rows @ p[:, : s.n] + by_friction[:, None] * p[:, [2 * s.n]]


def _motions(problem: Balance, state: State) -> tuple[Complex, Complex]:
    """Exponents (m,) of the motions that a start from rest excites, and their periodic parts (N_t, size, m)."""
    disturbance, basis, n = Disturbance(problem, state), problem.basis, problem.structure.n
    matrix, last = disturbance.monodromy, basis.synthesis[-1]
    start = np.zeros(len(matrix))
    start[: 2 * n] = -np.concatenate([last @ state.Q, state.Omega * (last @ basis.derivative(state.Q))])
    start[2 * n] = -disturbance.law.T[-1]
    exponents, starts = _excited(matrix, start, state.Omega)
    since = (basis.theta + basis.theta[1]) / state.Omega
    return exponents, disturbance.motion(starts) * np.exp(-np.outer(since, exponents))[:, None]


def _at_joints(rig: JointedRig, solution: PeriodicSolution) -> tuple[Complex, Complex]:
    """As :func:`_at_contact` of a rig with joints, by the time step along the solution."""
    along = along_solution(JointBalance(rig, solution.basis, level=solution.level), solution.state)
    steps = along.steps
    exponents, starts = _excited(along.monodromy, -along.start, solution.state.Omega)
    s, layout, m = rig.structure, along.layout, len(exponents)
    y = np.empty((len(steps), len(starts), 2 * m))
    y[0] = np.hstack([starts.real, starts.imag])  # a product of a real matrix with a complex one copies it first
    for k, step in enumerate(steps[:-1]):
        np.matmul(step, y[k], out=y[k + 1])
    parts = s.channels @ y[:, : s.n] + s.channels_by_joints @ y[:, layout.f]
    seen = parts[..., :m] + 1j * parts[..., m:]
    since = 2 * np.pi / solution.state.Omega * np.arange(len(steps)) / len(steps)
    return exponents, seen * np.exp(-np.outer(since, exponents))[:, None]


def _excited(matrix: Array, start: Array, Omega: float) -> tuple[Complex, Complex]:
    """Exponents (m,) of the motions of a monodromy that a start excites, and what is left of each later, (size, m).

    What has not moved by a share of :data:`FADED` until then is a mean that history decides.
    """
    multipliers, adjoint, vectors = eig(matrix, left=True)
    left = np.minimum(np.abs(multipliers), 1.0) ** WAITED
    still = np.abs(multipliers - 1.0) * WAITED < FADED
    kept = (multipliers.imag >= 0.0) & (left > FADED) & ~still  # one of each pair
    adjoint, vectors = adjoint[:, kept].conj(), vectors[:, kept]
    size = left[kept] * (start @ adjoint) / np.sum(adjoint * vectors, axis=0)
    return np.log(multipliers[kept].astype(complex)) * Omega / (2 * np.pi), vectors * size


def _leaked(p: Complex, exponents: Complex, Omega: float, H: int, orders: npt.NDArray[np.integer]) -> Complex:
    """Amplitudes of harmonics 0..H of the derivatives of exp(mu t) p(t), and of it a quarter of a cycle later.

    For p (N_t, c, m) and the orders of the derivatives (c,) it is (H+1, c, m, 2), in motions of one period.
    """
    N = len(p)
    rates = exponents + 1j * Omega * np.fft.fftfreq(N, 1.0 / N)[:, None]
    P = np.fft.fft(p, axis=0) / N * rates[:, None] ** orders[:, None]
    k = np.arange(-H, H + 1)
    parts = 1.0 / (rates - 1j * Omega * k[:, None, None])  # (2H+1, N_t, m)
    both = np.einsum("knm,ncm->kcm", parts, P, optimize=True) * Omega / (2 * np.pi)
    up, down = both[H:], both[H::-1].conj()
    later = np.where(exponents.imag != 0.0, 1j * (up - down), 0.0)
    left = np.stack([up + down, later], axis=-1)
    left[0] /= 2.0  # the mean is there once, other harmonics from both sides
    return left
