"""``[damping]`` of rig files of either kind."""

from collections.abc import Iterator

from hbm.rigfiles.schema import Complaint, DampingTable
from models import Damping


def damped_twice(table: DampingTable) -> Iterator[Complaint]:
    """Complaint about alpha beside the ratios that replace it."""
    if table.modal_ratios is not None and table.mass_proportional is not None:
        both = "and damping.mass_proportional are both present"
        yield Complaint(("damping", "modal_ratios"), both, "must have one of them")


def damping_of(table: DampingTable) -> Damping:
    """The damping that a table says."""
    entries = table.model_dump(exclude={"mass_proportional", "modal_ratios"})
    ratios = None if table.modal_ratios is None else tuple(table.modal_ratios)
    return Damping(mass_proportional=table.mass_proportional or 0.0, modal_ratios=ratios, **entries)
