"""Systems whose solution curves are known in closed form."""

from typing import Any

import numpy as np

from continuation import DenseProblem, DenseTwoParameterProblem

Array = Any


class Counted:
    """A problem that counts what is asked of it."""

    def __init__(self, problem: Any) -> None:
        self.problem, self.residuals, self.linearizations = problem, 0, 0

    def residual(self, x: Array, lam: float) -> Array:
        """Pass on."""
        self.residuals += 1
        return self.problem.residual(x, lam)

    def linearize(self, x: Array, lam: float) -> Any:
        """Pass on."""
        self.linearizations += 1
        return self.problem.linearize(x, lam)


def scalar(f: Any, f_x: Any, f_lam: Any) -> DenseProblem:
    """One equation in one unknown, from f(x, lam) and its two derivatives."""
    return DenseProblem(
        lambda x, lam: np.array([f(x[0], lam)]),
        lambda x, lam: (np.array([[f_x(x[0], lam)]]), np.array([f_lam(x[0], lam)])),
    )


def s_curve() -> DenseProblem:
    """x^3 - x = lam; folds at x = -+1/sqrt(3), lam = +-2/(3 sqrt(3))."""
    return scalar(lambda x, lam: x**3 - x - lam, lambda x, lam: 3.0 * x**2 - 1.0, lambda x, lam: -1.0)


def circle(radius: float) -> DenseProblem:
    """x^2 + lam^2 = radius^2."""
    return scalar(lambda x, lam: x**2 + lam**2 - radius**2, lambda x, lam: 2.0 * x, lambda x, lam: 2.0 * lam)


def spiral(pitch: float) -> DenseProblem:
    """lam = cos t + pitch t, x = (sin t, t): a helix; folds where sin t = pitch."""
    return DenseProblem(
        lambda x, lam: np.array([x[0] - np.sin(x[1]), np.cos(x[1]) + pitch * x[1] - lam]),
        lambda x, lam: (np.array([[1.0, -np.cos(x[1])], [0.0, pitch - np.sin(x[1])]]), np.array([0.0, -1.0])),
    )


def duffing(zeta: float, gamma: float, force: float) -> DenseProblem:
    """One-harmonic Duffing: x = (a, b), lam = Omega; (1 - O^2) a + 2 zeta O b + 3/4 gamma A^2 a = F, and b alike."""

    def residual(x: Array, lam: float) -> Array:
        k = 1.0 - lam**2 + 0.75 * gamma * (x @ x)
        return np.array([k * x[0] + 2.0 * zeta * lam * x[1] - force, k * x[1] - 2.0 * zeta * lam * x[0]])

    def jacobian(x: Array, lam: float) -> tuple[Array, Array]:
        k = 1.0 - lam**2 + 0.75 * gamma * (x @ x)
        turn = 2.0 * zeta * lam * np.array([[0.0, 1.0], [-1.0, 0.0]])
        J_lam = -2.0 * lam * x + 2.0 * zeta * np.array([x[1], -x[0]])
        return k * np.eye(2) + turn + 1.5 * gamma * np.outer(x, x), J_lam

    return DenseProblem(residual, jacobian)


def bent_line(before: Array, behind: Array, corner: Array, rng: np.random.Generator) -> DenseProblem:
    """Continuous piecewise linear F on y = (x, lam), zero on corner - s before and corner + s behind, s >= 0.

    J = A (I - t t') before the plane n . (y - corner) = 0 and J + c n' behind it, with c chosen so that the
    tangent there is `behind`; n points along both tangents.
    """
    size = before.size - 1
    across = before + behind
    noise = rng.standard_normal(size + 1)
    plane = np.linalg.qr(np.array([before, behind]).T)[0]
    normal = across / np.linalg.norm(across) + 0.3 * (noise - plane @ (plane.T @ noise)) / np.sqrt(size + 1.0)
    J = rng.standard_normal((size, size + 1)) @ (np.eye(size + 1) - np.outer(before, before))
    kink = -J @ behind / (normal @ behind)

    def residual(x: Array, lam: float) -> Array:
        y = np.append(x, lam) - corner
        return J @ y + kink * max(0.0, normal @ y)

    def jacobian(x: Array, lam: float) -> tuple[Array, Array]:
        y = np.append(x, lam) - corner
        slope = J + np.outer(kink, normal) if normal @ y > 0.0 else J
        return slope[:, :-1], slope[:, -1]

    return DenseProblem(residual, jacobian)


def scalar_of_two(f: Any, slopes: Any, slopes_of_f_x: Any) -> tuple[DenseTwoParameterProblem, Any]:
    """One equation in one unknown and two parameters, its derivatives, and those of f_x, with respect to x, lam, mu."""

    def jacobian(x: Array, lam: float, mu: float) -> tuple[Array, Array, Array]:
        f_x, f_lam, f_mu = slopes(x[0], lam, mu)
        return np.array([[f_x]]), np.array([f_lam]), np.array([f_mu])

    def second(x: Array, lam: float, mu: float, v: Array, directions: Array) -> Array:
        return v[0] * np.array([slopes_of_f_x(x[0], lam, mu)]) @ directions

    return DenseTwoParameterProblem(lambda x, lam, mu: np.array([f(x[0], lam, mu)]), jacobian), second
