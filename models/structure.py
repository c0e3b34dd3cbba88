"""The structure without its friction: natural modes and the rows that couple them to the contact."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reaction:
    """Normal reaction of the support as a linear form of the motion.

    ``R = P + inertia.q'' + damping.q' + stiffness.q + T (stretch.q - friction_lever) - force_share F``
    (docs/theory/equations.md section 2, the weak form tested with the static tip-load shape).
    All rows are zero where the reaction is held constant.

    Attributes
    ----------
    inertia : (n,) array
        Integral of rho A phi_i s [kg per unit of mass-normalised q].
    damping : (n,) array
        Same row times the viscous damping of each mode; strain-rate damping like the stiffness.
    stiffness : (n,) array
        Elastic forces on the support [N per unit of q]: of attached springs, of a clamp that turns, of a support that
        yields; zero for the bare beam.
    stretch : (n,) array
        Integral of phi_i' s' [-].
    force_share : float
        s(X_f), share of the excitation carried by the support [-].
    friction_lever : float
        h s'(L), normal force per friction force [-].
    """

    inertia: Array
    damping: Array
    stiffness: Array
    stretch: Array
    force_share: float
    friction_lever: float

    @staticmethod
    def constant(n: int) -> "Reaction":
        """Return the reaction R = P of a structure with `n` modes."""
        zero = np.zeros(n)
        return Reaction(zero, zero, zero, zero, 0.0, 0.0)

    def times(self, scale: float) -> "Reaction":
        """The reaction with its variation scaled."""
        return Reaction(
            scale * self.inertia,
            scale * self.damping,
            scale * self.stiffness,
            scale * self.stretch,
            scale * self.force_share,
            scale * self.friction_lever,
        )

    @property
    def varies(self) -> bool:
        """Whether R differs from the static load at all."""
        rows = (self.inertia, self.stiffness, self.stretch)
        return bool(any(row.any() for row in rows) or self.force_share or self.friction_lever)


@dataclass(frozen=True, eq=False)
class ResidualFlexibility:
    """Static response of the modes left out, beyond the contact's own compliance (mode acceleration).

    Attributes
    ----------
    slip_by_force : float
        Modal slip per excitation force, and by reciprocity drive displacement per friction force [m/N].
    drive_by_force : float
        Drive displacement per excitation force [m/N].
    channels : dict of str to (float, float)
        Displacement of each response channel per excitation force and per friction force [m/N].
    """

    slip_by_force: float = 0.0
    drive_by_force: float = 0.0
    channels: dict[str, tuple[float, float]] = field(default_factory=dict)


class SpringPort(NamedTuple):
    """Port at which a displacement is imposed within a spring; or its derivatives to p parameters, p first.

    The spring is part of the structure: that of a clamp that turns, or of a support. A displacement imposed in it loads
    the structure.

    Attributes
    ----------
    row : (n,) array
        Load of the spring per mode [N or N m per unit of q]; by reciprocity, modal force per slid displacement.
    stiffness : float or (p,) array
        Load that a slid displacement takes back while the modes are held [N/m or N m/rad].
    residual : (3 + c,) array
        Slip, drive, channels and reaction per slid displacement, beyond the modes.
    """

    row: Array
    stiffness: Any
    residual: Array


@dataclass(frozen=True, eq=False)
class ModalStructure:
    """A linear structure in mass-normalised modes; it knows no friction law.

    ``q_i'' + damping_i q_i' + omega_n_i^2 q_i = F excitation_i + T (slip_row - shortening q)_i`` (4),
    and the modal slip is ``u = slip_row.q - q'.shortening.q / 2 + residual.slip_by_force F``: one map takes T to
    the modes and the modes to u, so power is conserved exactly.

    Attributes
    ----------
    omega_n : (n,) array
        Natural frequencies with the contact sliding freely [rad/s], ascending.
    damping : (n,) array
        Damping coefficient of each mode [1/s], 2 zeta omega_n.
    slip_row : (n,) array
        du/dq at rest, h phi_i'(L) for the beam.
    shortening : (n, n) array
        G, integral of phi_i' phi_j' [1/(kg m)]; zeros without foreshortening.
    excitation : (n,) array
        phi_i(X_f).
    compliance : float
        C_res, axial and omitted-mode compliance in series with the contact [m/N].
    reaction : Reaction
        Normal reaction as a form of the motion.
    channel_rows : dict of str to (n,) array
        phi_i at the position of each response channel.
    residual : ResidualFlexibility
        Motion that the modes left out add.
    """

    omega_n: Array
    damping: Array
    slip_row: Array
    shortening: Array
    excitation: Array
    compliance: float
    reaction: Reaction
    channel_rows: dict[str, Array] = field(default_factory=dict)
    residual: ResidualFlexibility = ResidualFlexibility()

    @property
    def n(self) -> int:
        """Number of modes."""
        return len(self.omega_n)

    @property
    def joints(self) -> Array:
        """The slip row as that of the one port, (1, n)."""
        return self.slip_row[None, :]

    @property
    def flexibility_to_force(self) -> Array:
        """Slip per excitation force beyond the modes, (1,), and by reciprocity of the drive per friction force."""
        return np.array([self.residual.slip_by_force])

    def damps(self, shape: Array) -> float:
        """Damping 2 zeta omega of a mass-normalised shape (n,) [1/s]."""
        return float(shape @ (self.damping * shape))


def modal_damping(
    omega_n: Array,
    mass_proportional: float = 0.0,
    modal_ratios: tuple[float, ...] | None = None,
    high_mode_ratio: float = 0.02,
    high_mode_from: int = 6,
    numbers: npt.NDArray[np.intp] | None = None,
) -> Array:
    """Viscous damping coefficients of the modes, without the strain-rate part.

    Parameters
    ----------
    omega_n : (n,) array
        Natural frequencies [rad/s].
    mass_proportional : float
        alpha [1/s] (25).
    modal_ratios : tuple of float, optional
        Damping ratios, one per mode or one for all; replace everything else.
    high_mode_ratio : float
        Damping ratio of the modes from `high_mode_from` (counted from 1) up; 0 leaves them at alpha.
    high_mode_from : int
        First mode that carries `high_mode_ratio`.
    numbers : (n,) array of int, optional
        Which mode of the beam each one counts as; 1, 2... where omitted.

    Returns
    -------
    (n,) array
        2 zeta_i omega_i [1/s].

    Raises
    ------
    ValueError
        If `modal_ratios` has neither one entry nor one per mode.
    """
    numbers = np.arange(1, len(omega_n) + 1) if numbers is None else numbers
    if modal_ratios is not None:
        if len(modal_ratios) not in (1, numbers.max()):
            raise ValueError(f"modal_ratios has {len(modal_ratios)} entries; must have 1 or {numbers.max()}")
        return np.asarray(2.0 * np.resize(modal_ratios, numbers.max())[numbers - 1] * omega_n)
    damping = np.full(len(omega_n), float(mass_proportional))
    if high_mode_ratio > 0.0:
        high = numbers >= high_mode_from
        damping[high] = 2.0 * high_mode_ratio * omega_n[high]
    return damping
