"""Stability of periodic solutions by their Floquet multipliers.

:func:`stability` judges one solution, :func:`floquet` the state of a balance.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from hbm.balance.equations import Balance
from hbm.balance.scaled import State
from hbm.fourier import Array
from hbm.parallel import one_thread
from hbm.stability.floquet import Disturbance
from models.display import Displayed

Complex = npt.NDArray[np.complex128]

ROUNDING = 1e-9
"""A multiplier counts as outside of the unit circle beyond this."""

SLIPPING = 2.0
"""Friction that slips starts and ceases to at samples: multipliers err by up to this over the samples per period."""


@dataclass(frozen=True, eq=False)
class Stability(Displayed):
    """Fate of a small disturbance of a periodic solution.

    Attributes
    ----------
    multipliers : (size,) array of complex
        Floquet multipliers of modes and friction states, the largest first. Those of a contact that sticks are left
        out, `undying`.
    period : float
        [s].
    undying : int
        How many multipliers are 1 because a contact that sticks keeps the mean friction its history left: a family of
        solutions, along which nothing grows.
    error : float
        How far the magnitude of a multiplier may be off, for the samples.
    """

    multipliers: Complex
    period: float
    undying: int = 0
    error: float = ROUNDING

    @cached_property
    def exponents(self) -> Complex:
        """Floquet exponents of the multipliers that are not zero [1/s]; imaginary part up to half of 2 pi / period."""
        return np.asarray(np.log(self.multipliers[np.abs(self.multipliers) > 0.0]) / self.period)

    @cached_property
    def magnitudes(self) -> Array:
        """Magnitudes of the multipliers, (size,)."""
        return np.abs(self.multipliers)

    @cached_property
    def growths(self) -> Array:
        """Logarithms of the magnitudes, (size,); minus infinity of a multiplier that is zero."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(self.magnitudes))

    @property
    def largest(self) -> float:
        """Largest magnitude of a multiplier."""
        return float(self.magnitudes[0])

    @cached_property
    def unstable(self) -> int:
        """How many multipliers lie outside of the unit circle."""
        return int(np.count_nonzero(self.magnitudes > 1.0 + ROUNDING))

    @property
    def stable(self) -> bool:
        """Whether every disturbance fades, but for what a contact that sticks keeps."""
        return self.unstable == 0

    def __repr__(self) -> str:
        """Say it in words."""
        verdict = "stable" if self.stable else f"unstable ({self.unstable} multipliers outside of the unit circle)"
        kept = f"; {self.undying} kept by what sticks" if self.undying else ""
        return f"{verdict}, largest multiplier {self.multipliers[0]:.6g}{kept}"


def of_monodromy(matrix: Array, period: float, undying: int = 0, error: float = ROUNDING) -> Stability:
    """Stability from the derivative of a state after a period to that before.

    Parameters
    ----------
    matrix : (size, size) array
    period : float
        [s].
    undying : int
        How many multipliers nearest to 1 belong to what sticks.
    error : float
        Error of the multipliers.
    """
    values = np.linalg.eigvals(matrix).astype(complex)
    values = values[np.argsort(np.abs(values - 1.0))[undying:]]
    return Stability(values[np.argsort(-np.abs(values))], period, undying, error)


@one_thread
def floquet(problem: Balance, state: State) -> Stability:
    """Stability of a solution of a balance, from the monodromy of modes and friction states.

    Parameters
    ----------
    problem : Balance
    state : State
        Solves it.

    Raises
    ------
    ValueError
        If the clamp slips.
    """
    disturbance = Disturbance(problem, state)
    period, undying = 2 * np.pi / state.Omega, disturbance.law.undying
    return of_monodromy(disturbance.monodromy, period, undying, _error(disturbance))


def _error(disturbance: Disturbance) -> float:
    """Error of the multipliers: of first order where a law slips, of second where nothing does."""
    law, samples = disturbance.law, disturbance.problem.basis.N_t
    slips = law.remembers and not 0 < law.undying == law.by_states.shape[2]
    return SLIPPING / samples if slips else 1.0 / samples**2
