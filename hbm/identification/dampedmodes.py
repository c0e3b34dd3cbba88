"""Modes that damp one another: a full damping matrix between modes, where responses at a known drive ask for it.

A dashpot or a joint between two points takes hold of all modes that move there: modes with shapes P of the undamped
structure obey q'' + D q' + diag(omega^2) q = P_drive f, and D is not diagonal. Fitted as normal modes they are off by
many of their deviations, most those that are close. D is symmetric and takes energy only: D = L L^T, L being lower
triangular.

Modes stand in groups, each with a full block of D; normal modes are groups of one. Two groups are joined where what is
left asks for it most, as long as the Bayesian information criterion falls; the first two where it is beyond doubt.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from hbm.fourier import Array
from hbm.identification.beyond import beyond_of
from hbm.identification.modalproblem import Problem
from hbm.identification.modes import CERTAIN, Modes
from hbm.identification.projection import POSITIVE, STEPS, as_reals
from hbm.measurement.responses import Complex

HASTE = 40
"""Steps after which it is told whether groups are better joined; the last fit goes on to its end."""

TINY = 1e-30
"""Step along the imaginary axis by which numbers are differentiated."""

Groups = tuple[tuple[int, ...], ...]
Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Coupled:
    """Unknowns of modes in groups: frequencies, L, shapes and residuals of channels, and turns.

    Attributes
    ----------
    problem : Problem
        Responses, weighted, with the residual terms and the turns that are sought.
    drive : int
        Channel at the place of the force.
    groups : tuple of tuple of int
        Modes that damp one another.
    omega : (r,) array
        [rad/s].
    L : (r, r) array
        Lower triangular, of D = L L^T [1/s].
    shapes : (c, r) array
        Mass-normalised.
    rest : (c, q) array
        Flexibilities of residuals.
    turns : (1 + c,) array
        See :class:`.projection.Projection`.
    """

    problem: Problem
    drive: int
    groups: Groups
    omega: Array
    L: Array
    shapes: Array
    rest: Array
    turns: Array

    @property
    def modes(self) -> int:
        """How many there are."""
        return len(self.omega)

    @property
    def damping(self) -> Array:
        """D (r, r)."""
        return np.asarray(self.L @ self.L.T)

    @cached_property
    def _places(self) -> tuple[Indices, Indices]:
        """Rows and columns of L that are unknown."""
        pairs = [(a, b) for group in self.groups for a in group for b in group if b <= a]
        rows, columns = np.array(pairs, dtype=np.intp).T
        return rows, columns

    @property
    def x(self) -> Array:
        """All unknowns."""
        parts = [self.omega, self.L[self._places], self.shapes, self.rest, self.turns[self.problem.sought]]
        return np.concatenate([np.ravel(part) for part in parts])

    def _at(self, x: Array) -> "Coupled":
        (c, r), q, entries = self.shapes.shape, self.rest.shape[1], len(self._places[0])
        omega, lower, shapes, rest, sought = np.split(x, np.cumsum([r, entries, c * r, c * q]))
        L, turns = np.zeros(self.L.shape, x.dtype), self.turns.astype(x.dtype)
        L[self._places], turns[self.problem.sought] = lower, sought
        return replace(self, omega=omega, L=L, shapes=shapes.reshape(c, r), rest=rest.reshape(c, q), turns=turns)

    # ---- responses

    @cached_property
    def _moved(self) -> tuple[Complex, Complex]:
        """Modes per force at the drive, (n, r), and at each channel, (n, r, c)."""
        omega = self.problem.together.omega[:, None, None]
        stiffness = np.eye(self.modes) * (self.omega**2 - omega**2) + 1j * omega * self.damping
        driven = np.broadcast_to(self.shapes.T.astype(complex), (len(omega), *self.shapes.T.shape))
        at_channels = np.linalg.solve(stiffness, driven)
        return at_channels[:, :, self.drive], at_channels

    @cached_property
    def _residuals(self) -> Complex:
        return self.problem.together.columns(np.empty((0, 2)))

    @cached_property
    def left(self) -> Complex:
        """What is left of the measured, (n, c), of the noise 1."""
        weighted = self.problem.together
        motion = self._moved[0] @ self.shapes.T + self._residuals @ self.rest.T
        return weighted.whitened(weighted.measured - weighted.turned(self.turns) * motion)

    def _of_damping(self, rows: Indices, columns: Indices, ends: Array) -> Complex:
        """Effect on channels of -i omega (e_row end^T + end e_row^T) q, (n, c, entries), for `ends` (r, entries)."""
        q, at = self._moved
        by_end, of_end = q @ ends, np.einsum("nrj,re->nje", at, ends)
        omega = self.problem.together.omega[:, None, None]
        across = at[:, rows].transpose(0, 2, 1) * by_end[:, None] + of_end * q[:, None, rows]
        return np.asarray(-1j * omega * across)

    def _slopes(self, more: Complex | None = None) -> Array:
        """Derivatives of what is left to x, real parts above imaginary ones, (2 n c, p), and to `more` motions."""
        weighted, (q, at), (c, r) = self.problem.together, self._moved, self.shapes.shape
        rows, columns = self._places
        of_omega = -2.0 * self.omega * at.transpose(0, 2, 1) * q[:, None]
        of_shapes = np.einsum("jk,nr->njkr", np.eye(c), q)
        of_shapes[:, :, self.drive] += at.transpose(0, 2, 1)
        of_rest = np.einsum("jk,nq->njkq", np.eye(c), self._residuals)
        motion = q @ self.shapes.T + self._residuals @ self.rest.T
        back = -self.problem.together.omega / weighted.middle
        of_turns = np.concatenate(
            [1j * motion[:, :, None], 1j * np.einsum("jk,nj,n->njk", np.eye(c), motion, back)], axis=2
        )[:, :, self.problem.sought]
        n = len(q)
        parts = [
            of_omega,
            self._of_damping(rows, columns, self.L[:, columns]),
            of_shapes.reshape(n, c, c * r),
            of_rest.reshape(n, c, -1),
            of_turns,
        ]
        moved = np.concatenate(parts if more is None else [*parts, more], axis=2)
        slopes = weighted.whitened(-weighted.turned(self.turns)[:, :, None] * moved)
        return as_reals(slopes).reshape(-1, slopes.shape[2])

    # ---- how good

    @property
    def chi2(self) -> float:
        """Weighted sum of squares."""
        return float(np.sum(np.abs(self.left) ** 2))

    @property
    def bic(self) -> float:
        """Bayesian information criterion, as that of :class:`.modalproblem.Problem`."""
        return self.problem.criterion(self.chi2, len(self.x))

    @property
    def misfit(self) -> float:
        """What is left, in noise variances."""
        return self.problem.per_number(self.chi2, len(self.x))

    def fitted(self, steps: int) -> "Coupled":
        """The most likely from here, or as near to it as so many steps come."""

        def residuals(x: Array) -> Array:
            return as_reals(self._at(x).left).ravel()

        with np.errstate(all="ignore"):
            fit = least_squares(residuals, self.x, jac=lambda x: self._at(x)._slopes(), x_scale="jac", max_nfev=steps)
        return self._at(fit.x)

    def beside_beyond(self) -> "Coupled":
        """The same with the mode above the band where these modes ask for it: normal ones asked for another."""
        if not self.problem.together.beyond:
            return self
        slopes = self.problem.with_share(self._slopes(), self.rest, self.turns)
        size = np.linalg.norm(slopes, axis=0)
        step = np.linalg.lstsq(slopes / size, -as_reals(self.left).ravel(), rcond=None)[0][-1] / size[-1]
        problem = self.problem.with_beyond(self.problem.together.beyond + step)
        return replace(self, problem=problem).fitted(STEPS)

    def joined(self) -> "Coupled | None":
        """The same with two groups made one, where a pair of modes asks for it most; the first pair beyond doubt."""
        group = {mode: i for i, modes in enumerate(self.groups) for mode in modes}
        pairs = [pair for pair in combinations(range(self.modes), 2) if group[pair[0]] != group[pair[1]]]
        if not pairs:
            return None
        rows, columns = np.array(pairs, dtype=np.intp).T
        slopes = self._slopes(self._of_damping(rows, columns, np.eye(self.modes)[:, columns]))
        own, others = slopes[:, : len(self.x)], slopes[:, len(self.x) :]
        size = np.linalg.norm(own, axis=0)
        basis = np.linalg.qr(own / np.where(size > 0.0, size, 1.0))[0]
        others = others - basis @ (basis.T @ others)
        pulls = (others.T @ as_reals(self.left).ravel()) ** 2 / np.maximum(np.sum(others**2, axis=0), POSITIVE[0])
        best = int(pulls.argmax())
        if len(self.groups) == self.modes and pulls[best] < CERTAIN**2 * self.problem.noise(self.misfit):
            return None
        first, second = (group[mode] for mode in pairs[best])
        kept = [modes for i, modes in enumerate(self.groups) if i not in (first, second)]
        return replace(self, groups=(*kept, tuple(sorted(self.groups[first] + self.groups[second]))))

    def described(self) -> Modes:
        """Modes in the order of their frequencies, with standard deviations."""
        whole = self.problem.covariance(self._slopes(), self.rest, self.turns, self.misfit)
        covariance, share = whole[: len(self.x), : len(self.x)], self.problem.together.beyond
        order, middle = np.argsort(self.omega), self.problem.together.middle
        ahead = np.where(self.shapes[self.drive] < 0.0, -1.0, 1.0)  # shapes are written along the force

        def numbers(x: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], ...]:
            at = self._at(x)
            omega, D, own = at.omega[order], (ahead * at.damping * ahead[:, None])[order][:, order], at.shapes[:, order]
            ratio, A = 0.5 * np.diag(D) / omega, own * own[[self.drive]]
            return omega / (2 * np.pi), ratio, A, D, at.rest[:, 0], at.rest[:, 2] * middle**2, at.turns

        found = numbers(self.x)
        moved = [numbers(self.x + 1j * TINY * one) for one in np.eye(len(self.x))]  # all are polynomials: exact
        std = []
        for i, value in enumerate(found):
            slopes = np.stack([change[i].imag / TINY for change in moved], axis=-1)
            variance = np.einsum("...i,ij,...j->...", slopes, covariance, slopes)
            std.append(np.sqrt(np.maximum(variance, 0.0)).reshape(value.shape))
        hz, ratio, A, D, above, below, turns = zip(found, std, strict=True)
        return Modes(
            responses=self.problem.responses,
            hz=hz[0],
            hz_std=hz[1],
            ratio=ratio[0],
            ratio_std=ratio[1],
            A=A[0],
            A_std=A[1],
            above=above[0],
            above_std=above[1],
            beside=self.rest[:, 1] / middle**2,
            below=below[0],
            below_std=below[1],
            phase=float(turns[0][0]),
            phase_std=float(turns[1][0]),
            delays=turns[0][1:] / middle,
            delays_std=turns[1][1:] / middle,
            chi2_reduced=self.misfit,
            damping=D[0],
            damping_std=D[1],
            beyond=beyond_of(self.rest, share, middle, whole, self._of_square) if share else None,
        )

    @property
    def _of_square(self) -> Indices:
        """Where the residuals that go with the square of the frequency are among the unknowns, (c,)."""
        (c, r), q = self.shapes.shape, self.rest.shape[1]
        first: Indices = r + len(self._places[0]) + c * r + np.arange(c) * q
        return first + 1


def coupled(problem: Problem, x: Array, modes: int, drive: str) -> Coupled | None:
    """Modes that damp one another, from normal ones of a problem; none where these do as well."""
    normal = _normal(problem, x, modes, list(problem.responses.channels).index(drive))
    if normal is None:
        return None
    best, bic = normal, problem.bic(x, modes)
    while further := best.joined():
        further = further.fitted(HASTE)
        if further.bic >= bic:
            break
        best, bic = further, further.bic
    return None if best is normal else best.fitted(STEPS).beside_beyond().beside_beyond()


def _normal(problem: Problem, x: Array, modes: int, drive: int) -> Coupled | None:
    """Normal modes as they were fitted; None where the drive moves against the force in one."""
    poles, flexibility = problem.poles(x, modes), problem.flexibility(x, modes)
    omega = 2 * np.pi * poles[:, 0]
    A = flexibility[:, :modes] * omega**2
    if (A[drive] <= 0.0).any():
        return None
    return Coupled(
        problem=problem,
        drive=drive,
        groups=tuple((mode,) for mode in range(modes)),
        omega=omega,
        L=np.diag(np.sqrt(2.0 * poles[:, 1] * omega)),
        shapes=A / np.sqrt(A[drive]),
        rest=flexibility[:, modes:],
        turns=problem.turns(x),
    )
