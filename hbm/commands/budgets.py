"""Budgets of the commands: their options, and how a run ends that has spent them."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Annotated

import typer

from hbm import interrupts
from hbm.commands.options import positive, whole

if TYPE_CHECKING:
    from hbm.response.budget import Budget

LARGEST_CURVE = 20_000  # points

MaxPoints = Annotated[str, typer.Option(metavar="N", help="Most points of a curve; it ends there, and is kept.")]
TraceSeconds = Annotated[
    str, typer.Option("--max-seconds", metavar="S", help="Longest trace by the clock; a curve ends there, and is kept.")
]
RunSeconds = Annotated[
    str,
    typer.Option("--max-seconds", metavar="S", help="Longest run by the clock; it ends there, and nothing is written."),
]


def budget_of(command: str, points: str, seconds: str) -> "Budget":
    """Budget of a curve, of the texts of its options."""
    from hbm.response.budget import Budget

    return Budget(whole(command, "--max-points", points, LARGEST_CURVE), seconds_of(command, seconds))


def seconds_of(command: str, text: str) -> float:
    """Seconds of a run, of the text of its option."""
    return positive(command, "--max-seconds", text, "s")


def within(command: str, seconds: float, doing: Callable[[], str], advice: str) -> AbstractContextManager[None]:
    """End the command where what is done here takes longer; half of it would be no result.

    Parameters
    ----------
    command : str
    seconds : float
    doing : callable
        What is being done, in words.
    advice : str
        What to try.
    """

    def spent() -> str:
        return f"{command}: stopped after {seconds:g} s, its budget, {doing()}; nothing written; {advice}"

    return interrupts.within(seconds, spent)
