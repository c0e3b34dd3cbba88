"""One implicit time step of a rig, exact for its linear modes, with the friction law solved at its end.

Each mode is propagated exactly under the cosine force and under a generalised friction force that is linear
over the step. The friction at the end of the step then moves the contact by an amount proportional to it: the
step's own compliance kappa stands in series with the contact and the law's return mapping does the rest
(:meth:`models.FrictionLaw.advance`). What remains implicit, limits that depend on the slip velocity and the
foreshortening, is solved by a fixed number of Newton iterations whose residual every step returns. Forces of nonlinear
elements are linear over the step too, and linearised about the last motion found in each iteration.

Start with :class:`Stepper`: a rig at one frequency and step, ready to march.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hbm.aft.step import form, law_step
from hbm.balance.elements import described_elements, element_numbers, stacked
from hbm.integration.propagation import propagators, weights
from hbm.integration.stepfunction import Shape, evaluate, lineariser, marcher
from models import Rig
from models.friction import parameters
from models.structure import Array, ModalStructure

GROWTH_TOLERANCE = 1e-7  # per step about rest
RESIDUAL_TOLERANCE = 1e-8  # of the largest force
DISSIPATION = (None, 0.5, 0.2, 0.0)  # spectral radii tried in turn, None: linear interpolation


@dataclass(frozen=True, eq=False)
class Stepper:
    """A rig at one frequency, force amplitude and step: marches states (q, q', friction, z), flattened.

    Attributes
    ----------
    rig : Rig
    hz, level : float
        Frequency [Hz] and amplitude [N] of the cosine force.
    steps_per_period : int
    phase : float
        Phase of the force at step 0 [rad].
    radius : float or None
        See :func:`weights`.
    """

    rig: Rig
    hz: float
    level: float
    steps_per_period: int
    phase: float = 0.0
    radius: float | None = None

    @staticmethod
    def stable(rig: Rig, hz: float, level: float, steps_per_period: int, phase: float = 0.0) -> "Stepper":
        """Least dissipative stepper that is stable about rest, with the contact stuck.

        Raises
        ------
        ArithmeticError
            If none is; more steps per period resolve the modes that the rigid contact destabilises.
        """
        for radius in DISSIPATION:
            stepper = Stepper(rig, hz, level, steps_per_period, phase, radius)
            growth = stepper.growth
            if growth <= 1.0 + GROWTH_TOLERANCE:
                return stepper
        raise ArithmeticError(
            f"time step: at {steps_per_period} steps per period a stuck contact grows by {growth - 1:.1e} per step; "
            f"must be below {GROWTH_TOLERANCE:g}; try {2 * steps_per_period} steps, or residual_compliance = true"
        )

    @property
    def dt(self) -> float:
        """Step [s]."""
        return 1.0 / (self.hz * self.steps_per_period)

    @cached_property
    def shape(self) -> Shape:
        """Key of the compiled step."""
        structure, law = self.rig.structure, self.rig.contact.law
        if self.rig.clamp is not None:
            raise ValueError(
                f"time step: {self.rig.name} has a clamp that slips; must have none, or a joint at slope(0) for it"
            )
        return Shape(
            form=form(law),
            states=law_step(law).memory_size,
            modes=structure.n,
            foreshortened=bool(structure.shortening.any()),
            reaction_varies=structure.reaction.varies,
            dissipative=self.radius is not None,
            elements=described_elements(self.rig),
            law=law,
        )

    @cached_property
    def _propagators(self) -> Array:
        return propagators(self.rig.structure, 2 * np.pi * self.hz, self.dt)

    @cached_property
    def parameters(self) -> Array:
        """Run-time parameters in the order of :attr:`Shape.layout`, then those of the law."""
        s, E = self.rig.structure, self._propagators
        delay, force_weights = weights(E, self.dt, self.radius)
        values: dict[str, Array | float] = {
            **force_weights,
            "qq": E[:, 0, 0],
            "qv": E[:, 0, 1],
            "vq": E[:, 1, 0],
            "vv": E[:, 1, 1],
            "slip_row": s.slip_row,
            "shortening": s.shortening.ravel(),
            "dt": self.dt,
            "delay": delay,
            "compliance": s.compliance,
            "slip_by_force": s.residual.slip_by_force,
            "load": self.rig.contact.normal_load,
            **_reaction_rows(s),
            **(_element_rows(self.rig, E) if self.rig.acting else {}),
        }
        law = np.array(list(parameters(self.rig.contact.law).values()), dtype=float)
        return np.concatenate([np.atleast_1d(values[name]) for name in self.shape.layout] + [law])

    def drive(self, steps: int) -> Array:
        """Response (q, q') of the modes to the force over each step, force and rate at its end, (steps, 2n+3).

        And last, the force at its start.
        """
        theta = self.phase + 2 * np.pi * (np.arange(steps + 1) % self.steps_per_period) / self.steps_per_period
        s, Omega = self.rig.structure, 2 * np.pi * self.hz
        excitation = replace(self.rig.excitation, amplitude=self.level)
        moved = np.zeros((2 * s.n, steps))
        for k, a, b in excitation.tones:  # a cos + b sin, and a quarter of a period earlier
            E = self._propagators if k == 1 else propagators(s, k * Omega, self.dt)
            cosine, sine = np.cos(k * theta[:-1]), np.sin(k * theta[:-1])
            start = np.stack([a * cosine + b * sine, a * sine - b * cosine])
            response = np.moveaxis(E[:, :, 4:], 1, 0) * s.excitation[:, None]
            moved += response.reshape(-1, 2) @ start
        end = [excitation.force(theta[1:]), Omega * excitation.force(theta[1:], 1)]
        return np.vstack([self.level * moved, *end, excitation.force(theta[:-1])]).T

    def march(self, x: Array, steps: int) -> tuple[Array, Array, float]:
        """Advance a state.

        Parameters
        ----------
        x : (size,) array
            State at step 0 of this stepper's phase, or a whole number of periods later.
        steps : int

        Returns
        -------
        X : (steps, size) array
            States at the end of each step.
        T : (steps,) array
            Friction force there [N].
        residual : float
            Largest residual of the implicit relation [N].

        Raises
        ------
        ArithmeticError
            If the relation is not solved, as where friction falls too fast with speed for the step.
        """
        X, T, residuals = evaluate(marcher(self.shape, steps), x, self.drive(steps), self.parameters)
        residual = float(np.max(residuals))
        allowed = RESIDUAL_TOLERANCE * max(self.level, self.rig.contact.normal_load, float(np.max(np.abs(T))))
        allowed += self._rounding * float(np.max(np.abs(X[:, : self.shape.modes])))
        if not residual <= allowed:  # also when not a number
            raise ArithmeticError(
                f"time step: contact residual {residual:.1e} N at {self.hz:g} Hz; must be below {allowed:.1e} N; "
                f"try more than {self.steps_per_period} steps per period"
            )
        return X, T[:, 0], residual

    @cached_property
    def _rounding(self) -> float:
        """Error of T from the rounding of q where only the compliance of the step gives way [N/m]."""
        s = self.rig.structure
        _, force_weights = weights(self._propagators, self.dt, self.radius)
        compliance = s.compliance + float(s.slip_row**2 @ force_weights["q_new"])
        return float(10 * np.finfo(float).eps * np.sum(np.abs(s.slip_row)) / compliance) if compliance > 0.0 else 0.0

    def linearised(self, x: Array, X: Array, T: Array) -> Array:
        """Jacobian of each step of a march from `x` that gave `X` and `T`, (steps, size, size)."""
        steps, size = X.shape
        before = np.vstack([x, X[:-1]])
        ends = X[:, : 2 * self.shape.modes]
        (J,) = evaluate(lineariser(self.shape, steps), before, T, ends, self.drive(steps), self.parameters)
        return np.swapaxes(J.reshape(steps, size, size), 1, 2)

    @property
    def growth(self) -> float:
        """Spectral radius of one unforced step about rest."""
        x, T = np.zeros(self.shape.size), np.zeros(1)
        J = replace(self, level=0.0).linearised(x, x[None], T)[0]
        return float(np.max(np.abs(np.linalg.eigvals(J))))


def _reaction_rows(structure: ModalStructure) -> dict[str, Array | float]:
    """R = P + R_force F - R_q.q - R_v.q' + T (eta + eta_q.q), with q'' from the equation of motion (4)."""
    r = structure.reaction
    return {
        "R_q": r.inertia * structure.omega_n**2 - r.stiffness,
        "R_v": r.inertia * structure.damping - r.damping,
        "R_force": float(r.inertia @ structure.excitation) - r.force_share,
        "eta": float(r.inertia @ structure.slip_row) - r.friction_lever,
        "eta_q": r.stretch - structure.shortening @ r.inertia,
    }


def _element_rows(rig: Rig, E: Array) -> dict[str, Array | float]:
    """Rows of the elements, their shares in the reaction, and the weights of their forces."""
    s = rig.structure
    rows, share, weight, static = stacked(rig.element_rows)
    _, force_weights = weights(E, 0.0, None)
    return {
        **{f"element_{name}": value for name, value in force_weights.items()},
        "element_rows": rows.ravel(order="F"),
        "element_reaction": rows @ s.reaction.inertia - share,
        "element_weight": weight,
        "element_by_force": static[:, 0],
        "element_numbers": element_numbers(rig),
        "force_per_modal": 1.0 / float(np.max(np.abs(s.excitation))),
    }
