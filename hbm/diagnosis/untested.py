"""A cause that no record held out tells of: which of the records fitted would test it."""

from collections.abc import Iterator

from hbm.diagnosis.decide import DECISIVE
from hbm.diagnosis.remainder import MOST
from hbm.outputerror.campaign import Campaign
from hbm.outputerror.whitened import Whitened


def to_hold_out(name: str, before: Whitened, after: Whitened, campaign: Campaign) -> Iterator[str]:
    """Say which to hold out: of the records that show a cause, every second after the clearest.

    The clearest one is left among those fitted: without any that shows a cause none is found.

    Parameters
    ----------
    name : str
        Of the cause.
    before, after : Whitened
        The records fitted beside the model without it, and with it.
    campaign : Campaign
    """
    taken = {number: before.deviance(number) - after.deviance(number) for number in after.spreads}
    clear = sorted((n for n in taken if taken[n] > DECISIVE), key=taken.__getitem__, reverse=True)
    label = {r.number: r.name for r in campaign.data.records}
    if len(clear) > 1:
        chosen = " ".join(str(label[number]) for number in clear[1::2][:MOST])
        yield f"Records that would test {name}, held out: --hold-out {chosen}."
    else:
        alone = f": record {label[clear[0]]} alone" if clear else ""
        yield f"Too few records show {name} clearly{alone}; measure more of that kind, and hold out some."
