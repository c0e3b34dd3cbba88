"""Linear modes of a rig, with the contact sliding freely and stuck."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.linalg import null_space

from hbm.aft.jointstep import JointStep, values
from hbm.aft.step import law_step
from hbm.errors import expect_rig
from models.display import Displayed
from models.friction import parameters
from models.jointed import AnyRig, JointedRig
from models.rig import Rig
from models.structure import Array

SMALL_SLIP = 1e-12
"""Slip that no law takes for sliding [m]."""


@dataclass(frozen=True, eq=False)
class LinearModes(Displayed):
    """Natural modes of a rig.

    Attributes
    ----------
    sliding_hz, stuck_hz : (n,) array
        Natural frequencies with the contact sliding freely, and held by its stiffness [Hz].
        A rigidly held contact takes a mode away: the last entry is nan then.
    damping_ratio : (n,) array
        Damping ratios of the sliding modes [-].
    stiffness : float
        Contact stiffness at rest, in series with the compliance [N/m]; inf where the contact is held rigidly, nan of
        several joints.
    """

    sliding_hz: Array
    stuck_hz: Array
    damping_ratio: Array
    stiffness: float

    def __repr__(self) -> str:
        """Frequencies, sliding and stuck, and damping."""
        lines = [
            f"  {i}  {free:10.6g}  {stuck:10.6g}  {ratio:10.3%}"
            for i, (free, stuck, ratio) in enumerate(
                zip(self.sliding_hz, self.stuck_hz, self.damping_ratio, strict=True), start=1
            )
        ]
        if np.isnan(self.stiffness):
            return "\n".join(["linear modes", "   free [Hz]  joined [Hz]     damping", *lines])
        held = "held rigidly" if np.isinf(self.stiffness) else f"contact stiffness {self.stiffness:.4g} N/m"
        return "\n".join([f"linear modes, {held}", "   sliding [Hz]  stuck [Hz]     damping", *lines])


def linear_modes(rig: AnyRig) -> LinearModes:
    """Natural modes of a rig, sliding and stuck; with joints, without them and with their stiffness at rest.

    Parameters
    ----------
    rig : Rig or JointedRig

    Returns
    -------
    LinearModes

    Examples
    --------
    >>> from models.published import paper_rig
    >>> float(linear_modes(paper_rig()).sliding_hz[0].round(3))
    47.842
    """
    expect_rig(rig, "linear_modes", joints=True)
    s, (omega, _) = rig.structure, stuck_modes(rig)
    elastic = np.where(s.omega_n > 0.0, s.omega_n, np.inf)
    return LinearModes(
        sliding_hz=s.omega_n / (2 * np.pi),
        stuck_hz=np.append(omega, np.full(s.n - len(omega), np.nan)) / (2 * np.pi),
        damping_ratio=np.array([s.damps(mode) for mode in np.eye(s.n)]) / (2 * elastic),
        stiffness=float("nan") if isinstance(rig, JointedRig) else contact_stiffness(rig),
    )


BESIDE = (0.85, 1.35, 1.1)
"""A sweep begins at this part of the first sliding resonance; it ends beyond this part of it, and of the stuck one."""


def sliding_to_stuck(rig: AnyRig) -> tuple[float, float]:
    """Range of frequencies in which the first resonance lies however much the contact slides [Hz]."""
    found = linear_modes(rig)
    elastic = found.sliding_hz > 0.0
    sliding, stuck = float(found.sliding_hz[elastic][0]), found.stuck_hz[elastic][0]
    begin, end, beyond = BESIDE
    return begin * sliding, float(np.nanmax([end * sliding, beyond * stuck]))


def contact_stiffness(rig: Rig) -> float:
    """Tangential stiffness of the contact at rest, in series with the structure's compliance [N/m].

    It is asked of the friction law itself, by a slip too small to slide; a law that holds the contact
    rigidly leaves the compliance alone, or no motion at all (inf).
    """
    C = rig.structure.compliance
    law = rig.contact.law
    if law.set_valued:
        return 1.0 / C if C > 0.0 else np.inf
    P, step = rig.contact.normal_load, law_step(law)
    rest, moved = [0.0, 0.0, P, 0.0], [SMALL_SLIP, 0.0, P, 0.0]
    known = [np.zeros(step.states), [*rest, 0.0], C, moved, [C, P, 1e-4], list(parameters(law).values())]
    force, slope = step.function.factory("at_rest", step.function.name_in(), ["force", "jac:force:T"])(0.0, *known)
    return (
        abs(float(force) / (1.0 - float(slope))) / SMALL_SLIP
    )  # the slip is too small for a law to be anything but linear


def stuck_modes(rig: AnyRig) -> tuple[Array, Array]:
    """Natural frequencies (m,) [rad/s] and mass-normalised shapes (n, m) with what touches held by its stiffness.

    Where one contact is held rigidly they are those of the motions without slip, m = n - 1.
    """
    s, K = rig.structure, stiffness_at_rest(rig)
    rigid = np.isinf(K).any()
    free = null_space(s.joints) if rigid else np.eye(s.n)
    held = 0.0 if rigid else s.joints.T @ K @ s.joints
    squares, shapes = np.linalg.eigh(free.T @ (np.diag(s.omega_n**2) + held) @ free)
    return np.sqrt(np.maximum(squares, 0.0)), np.asarray(free @ shapes)


def stiffness_at_rest(rig: AnyRig) -> Array:
    """Stiffness of all that touches at rest, seen by the modes, (m, m) [N/m]; inf of a contact that is held rigidly."""
    return joint_stiffness(rig) if isinstance(rig, JointedRig) else np.array([[contact_stiffness(rig)]])


RIGIDLY = 1e6
"""How much stiffer than the modes a set-valued law holds its port, where the body does not yield."""


def joint_stiffness(rig: JointedRig) -> Array:
    """Stiffness of the joints at rest, seen by the modes, (m, m) [N/m]: in series with what the modes leave out."""
    s, m = rig.structure, rig.ports
    K, at = np.zeros((m, m)), 0
    for j in rig.joints:
        here = slice(at, at + j.law.ports)
        if j.law.set_valued:
            K[at, at] = RIGIDLY * float(s.omega_n[-1] ** 2 / (s.joints[at] @ s.joints[at]))
        else:
            step = JointStep(j.law)
            slope = ca.jacobian(step.force, step.now)[:, : j.law.ports]
            known = [step.z, step.f, step.f_before, step.now, step.before, step.environment, step.p]
            rest = [np.zeros(k.shape[0]) for k in known[:5]]
            K[here, here] = -ca.Function("slope", known, [slope])(*rest, [1e-4, 0.0], values(j.law)).full()
        at += j.law.ports
    return np.asarray(K @ np.linalg.inv(np.eye(m) + s.flexibility @ K))
