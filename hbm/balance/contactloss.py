"""For how long of a period contacts that may separate are open."""

from collections.abc import Mapping, Sequence

from hbm.fourier import Array
from models.joints import Joint


def joints_open(joints: Sequence[Joint], ports: Sequence[slice], forces: Array) -> dict[str, float]:
    """Share of the period for which each joint is open, by "joint NAME"; of forces at the samples (N_t, m) [N]."""
    shares = {}
    for joint, at in zip(joints, ports, strict=True):
        if hasattr(joint.law, "separated"):  # an own law need not
            shares[f"joint {joint.name}"] = float(joint.law.separated(forces[:, at]).mean())
    return shares


def contact_lost(shares: Sequence[Mapping[str, float]]) -> list[str]:
    """A line for each contact that is open for a share of the period in one motion, or in some of several."""
    most = "up to " if len(shares) > 1 else ""
    largest = {name: max(of[name] for of in shares) for name in shares[0]}
    return [f"{name} is out of contact for {most}{share:.0%} of the period" for name, share in largest.items() if share]
