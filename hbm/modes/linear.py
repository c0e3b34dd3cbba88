"""Linear modes of a rig, with the contact sliding freely and stuck."""

from dataclasses import dataclass

import numpy as np

from hbm.balance.touching import Touching, elastic, first_of, first_sliding
from hbm.errors import expect_rig
from models.display import Displayed
from models.jointed import AnyRig, JointedRig
from models.rig import Rig
from models.structure import Array


@dataclass(frozen=True, eq=False)
class LinearModes(Displayed):
    """Natural modes of a rig.

    Attributes
    ----------
    sliding_hz, stuck_hz : (n,) array
        Natural frequencies with the contact sliding freely, and held by its stiffness [Hz].
        A rigidly held contact or joint takes a mode away: the last entries are nan then.
    damping_ratio, stuck_damping_ratio : (n,) array
        Damping ratios of the sliding modes, and of those that are held with what touches losing what it does under
        small motions [-]. Where that damps, they are complex modes of s: |s| is their natural frequency and -Re s / |s|
        the ratio. Two real s, a ratio of 1 and more, are one mode that does not oscillate.
    stiffness : float
        Contact stiffness at rest, in series with the compliance [N/m]; inf where the contact is held rigidly, nan of
        several joints.
    """

    sliding_hz: Array
    stuck_hz: Array
    damping_ratio: Array
    stuck_damping_ratio: Array
    stiffness: float

    @property
    def overdamped(self) -> list[int]:
        """Numbers of the modes, from 1, that do not oscillate once they are held: what touches damps them too much."""
        return [i for i, ratio in enumerate(self.stuck_damping_ratio, start=1) if ratio >= 1.0]

    def __repr__(self) -> str:
        """Frequencies, sliding and stuck, and damping: with a contact sliding, with joints without and with them."""
        columns = self.sliding_hz, self.stuck_hz, self.damping_ratio, self.stuck_damping_ratio
        rows = enumerate(zip(*columns, strict=True), start=1)
        if np.isnan(self.stiffness):
            form = "  {}  {:10.6g}  {:9.3%}  {:10.6g}  {:9.3%}"
            lines = [form.format(i, free, ratio, held, lost) for i, (free, held, ratio, lost) in rows]
            return "\n".join(["linear modes", "   free [Hz]    damping  joined [Hz]  damping", *lines])
        lines = [f"  {i}  {free:10.6g}  {held:10.6g}  {ratio:10.3%}" for i, (free, held, ratio, _) in rows]
        held = "held rigidly" if np.isinf(self.stiffness) else f"contact stiffness {self.stiffness:.4g} N/m"
        return "\n".join([f"linear modes, {held}", "   sliding [Hz]  stuck [Hz]     damping", *lines])


def linear_modes(rig: AnyRig) -> LinearModes:
    """Natural modes of a rig, sliding and stuck; with joints, without them and with their stiffness at rest.

    At rest joints that push, such as a pressed stop, are in balance with the body.

    Parameters
    ----------
    rig : Rig or JointedRig

    Returns
    -------
    LinearModes

    Raises
    ------
    ArithmeticError
        If the joints find no balance at rest.

    Examples
    --------
    >>> from hbm.models.published import paper_rig
    >>> float(linear_modes(paper_rig()).sliding_hz[0].round(3))
    47.842
    """
    expect_rig(rig, "linear_modes", joints=True)
    s, touching = rig.structure, Touching(rig)
    omega, held = touching.damped()
    missing = np.full(s.n - len(omega), np.nan)
    return LinearModes(
        sliding_hz=s.omega_n / (2 * np.pi),
        stuck_hz=np.append(omega, missing) / (2 * np.pi),
        damping_ratio=np.array([s.damps(mode) for mode in np.eye(s.n)]) / (2 * elastic(s.omega_n)),
        stuck_damping_ratio=np.append(held, missing),
        stiffness=float("nan") if isinstance(rig, JointedRig) else touching.at_contact,
    )


BESIDE = (0.85, 1.35, 1.1)
"""A sweep begins at this part of the first sliding resonance; it ends beyond this part of it, and of the stuck one."""


def sliding_to_stuck(rig: AnyRig) -> tuple[float, float]:
    """Range of frequencies in which the first resonance lies however much the contact slides [Hz]."""
    sliding, stuck = first_sliding(rig), first_of(stuck_modes(rig)[0])
    begin, end, beyond = BESIDE
    low, high = begin * np.nanmin([sliding, stuck]), np.nanmax([end * sliding, beyond * stuck])
    return float(low) / (2 * np.pi), float(high) / (2 * np.pi)


def contact_stiffness(rig: Rig) -> float:
    """Tangential stiffness of the contact at rest, in series with the structure's compliance [N/m].

    It is asked of the friction law itself, at the first sliding resonance; a law that holds the contact rigidly leaves
    the compliance alone, or no motion at all (inf).
    """
    return Touching(rig).at_contact


def stuck_modes(rig: AnyRig) -> tuple[Array, Array]:
    """Natural frequencies [rad/s] and shapes with what touches held: :meth:`Touching.modes`."""
    return Touching(rig).modes()
