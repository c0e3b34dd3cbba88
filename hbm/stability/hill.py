"""Hill's method: Floquet exponents from Fourier series.

A disturbance exp(lambda t) p(t), p periodic, of y' = A(t) y turns Hill's infinite determinant into an eigenvalue
problem of the harmonics of A, cut to some of p. Every exponent appears in copies lambda + i k Omega, each with its p
shifted by k harmonics, and those near the cut are wrong. Kept is, of each family, the copy whose p is centred on
harmonic 0, which the cut hurts least (the criterion of the most symmetric eigenvector: Lazarus & Thomas, C. R.
Mecanique 338 (2010) 510; Guillot, Lazarus, Thomas, Vergez & Cochelin, J. Comput. Phys. 416 (2020) 109477).

:func:`hill` judges balances whose forces remember nothing. Where a law remembers, its loop does not close over the
period of a disturbance that grows: from sample to sample the state must be taken back by exp(-lambda dt), which makes
the problem nonlinear in lambda. :class:`HillMatrix` is that matrix, singular at the exponents; with the loop closed
over each period instead, `loop = 0`, it is the naive one, which is wrong away from lambda = 0.
"""

import numpy as np
import numpy.typing as npt

from hbm.balance.equations import Balance
from hbm.balance.scaled import State
from hbm.fourier import Array
from hbm.parallel import one_thread
from hbm.stability.floquet import Disturbance
from hbm.stability.multipliers import Stability

Complex = npt.NDArray[np.complex128]

CONGRUENT = 1e-3
"""Multipliers that differ by less, of their own size, may be copies of one."""

SECANTS, CLOSE = 30, 1e-10
"""Most steps to an exponent, and the last of them, as a fraction of Omega."""


def hill_exponents(A: Array, period: float, harmonics: int) -> Complex:
    """Floquet exponents of y' = A(t) y, A periodic.

    Parameters
    ----------
    A : (N, n, n) array
        At equally spaced instants of one period.
    period : float
        [s].
    harmonics : int
        Harmonics of the periodic part of a disturbance; fewer than N / 4.

    Returns
    -------
    (n,) array of complex
        One of each family, the one of the most symmetric eigenvector.

    Examples
    --------
    >>> bool(np.isclose(hill_exponents(np.full((16, 1, 1), -0.5), 2.0, 2)[0], -0.5))
    True
    """
    n, h = A.shape[1], harmonics
    if not 1 <= h < len(A) / 4:
        raise ValueError(f"hill: {h} harmonics of {len(A)} samples; must be at least 1, and fewer than a quarter")
    k = np.arange(-h, h + 1)
    c = np.fft.fft(A, axis=0) / len(A)
    matrix = c[k[:, None] - k]  # (2h+1, 2h+1, n, n)
    matrix[np.arange(2 * h + 1), np.arange(2 * h + 1)] -= 2j * np.pi / period * k[:, None, None] * np.eye(n)
    values, vectors = np.linalg.eig(matrix.transpose(0, 2, 1, 3).reshape(n * (2 * h + 1), -1))
    share = (np.abs(vectors.reshape(2 * h + 1, n, -1)) ** 2).sum(axis=1)
    centre = np.abs(k @ share) / share.sum(axis=0)
    return _one_of_each(values[np.argsort(centre, kind="stable")], period, n)


def _one_of_each(candidates: Complex, period: float, n: int) -> Complex:
    """First n candidates that are no copies of one before, shifted by whole harmonics."""
    kept: list[complex] = []
    for value in candidates:
        shifts = [(value - other) * period / (2j * np.pi) for other in kept]
        copies = (abs(s - round(s.real)) * 2 * np.pi < CONGRUENT and round(s.real) != 0 for s in shifts)
        if not any(copies):
            kept.append(complex(value))
        if len(kept) == n:
            break
    return np.array(kept)


@one_thread
def hill(problem: Balance, state: State) -> Stability:
    """Stability of a solution of a balance by Hill's method, for forces that remember nothing.

    Parameters
    ----------
    problem : Balance
    state : State
        Solves it.

    Raises
    ------
    ValueError
        If friction remembers, or as :func:`hbm.stability.multipliers.floquet`.
    """
    disturbance, period = Disturbance(problem, state), 2 * np.pi / state.Omega
    if disturbance.law.remembers:
        raise ValueError(f"hill: {problem.rig.contact.law.name} remembers; must not; take the monodromy")
    exponents = hill_exponents(disturbance.rate, period, problem.basis.H)
    multipliers = np.exp(exponents * period)
    return Stability(multipliers[np.argsort(-np.abs(multipliers))], period, error=1.0 / problem.basis.N_t**2)


class HillMatrix:
    """Hill's matrix of a solution of a balance, right also for laws that remember.

    Unknowns are the complex harmonics -H..H of the disturbed modes, (2H+1) n; equations their balances of force, each
    divided by its dynamic stiffness.

    Parameters
    ----------
    problem : Balance
    state : State
        Solves it.
    """

    def __init__(self, problem: Balance, state: State) -> None:
        self.problem, self.state, self.disturbance = problem, state, Disturbance(problem, state)
        self.k = np.arange(-problem.basis.H, problem.basis.H + 1)
        self._wave = np.exp(1j * np.outer(problem.basis.theta, self.k))

    def at(self, exponent: complex, loop: complex | None = None) -> Complex:
        """The matrix at an exponent [1/s].

        Parameters
        ----------
        exponent : complex
        loop : complex, optional
            Exponent with which the loop of the law closes; that of the disturbance where omitted, 0 is naive.
        """
        s, n, wave = self.problem.structure, self.problem.structure.n, self._wave
        rate = exponent + 1j * self.state.Omega * self.k  # (2H+1,)
        moved = np.einsum("tk,ij->tkij", wave, np.eye(n)).reshape(*wave.shape, n, n)
        # samples (q, q') of unit harmonics of each mode, (N_t, 2n, (2H+1) n)
        q = moved.transpose(0, 2, 1, 3)
        y = np.concatenate([q, q * rate[:, None]], axis=1).reshape(len(wave), 2 * n, -1)
        force = self.disturbance.forces(y, np.exp(-(exponent if loop is None else loop) * self._dt))
        series = np.tensordot(wave.conj().T, force, axes=1).reshape(-1, force.shape[2]) / len(wave)
        stiffness = rate[:, None] ** 2 + s.damping * rate[:, None] + s.omega_n**2
        return np.asarray(np.eye(stiffness.size) - series / stiffness.reshape(-1, 1))

    @property
    def _dt(self) -> float:
        return 2 * np.pi / (self.state.Omega * self.problem.basis.N_t)

    def exponent(self, guess: complex, loop: complex | None = None) -> complex:
        """Exponent near a guess [1/s], by secants on what the matrix lacks to be singular.

        Raises
        ------
        ArithmeticError
            If none is found.
        """
        size, Omega = self.k.size * self.problem.structure.n, self.state.Omega
        row, column = np.random.default_rng(0).standard_normal((2, size))

        def lacking(value: complex) -> complex:
            return complex(1.0 / (row @ np.linalg.solve(self.at(value, loop), column)))

        a, b = guess, guess + 1e-4 * Omega
        f, g = lacking(a), lacking(b)
        for _ in range(SECANTS):
            if abs(b - a) < CLOSE * Omega or g == f:
                return b
            a, b, f = b, b - g * (b - a) / (g - f), g
            if not abs(b - guess) < Omega:
                break
            g = lacking(b)
        raise ArithmeticError(f"hill: no exponent found near {guess:.6g} 1/s; start closer")
