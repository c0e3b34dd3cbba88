"""Tables that the command line prints of a reconstruction and of friction laws identified from it."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from hbm.commands.tables import print_lines, print_table
from hbm.files.inversereport import LEVEL_NOTE, level_table
from hbm.files.jointinverse import JOINT_NOTE, joint_table
from hbm.files.rigerrors import CALIBRATED_FILE, HEADINGS, NOTE
from hbm.identification.contacterrors import ContactErrors
from hbm.inverse.jointreconstruction import JointReconstruction
from hbm.inverse.reconstruction import Reconstruction

if TYPE_CHECKING:
    from hbm.files.identifiedlaw import IdentifiedLaw


def print_reconstruction(console: Console, reconstruction: Reconstruction) -> None:
    """Print what was found at each level, and what to beware of."""
    headings, rows = level_table(reconstruction)
    title = f"{reconstruction.rig.name}, {reconstruction.formulation}"
    print_table(console, title, list(map(_stacked, headings)), rows)
    print_lines(console, [LEVEL_NOTE, *(f"warning: {warning}" for warning in reconstruction.warnings)])


def print_contact_errors(console: Console, errors: ContactErrors, out: Path) -> None:
    """Print what the rig file is uncertain by, and the numbers that sensors ask for."""
    print_table(console, "what the rig file may be off by", list(HEADINGS), [list(row) for row in errors.told])
    where = f": see {out / CALIBRATED_FILE}" if errors.known.asked else ""
    print_lines(console, [NOTE, *filter(None, [errors.known.asks + where])])


def print_joint_reconstruction(console: Console, found: JointReconstruction) -> None:
    """Print what was found at each port, and what to beware of."""
    headings, rows = joint_table(found)
    print_table(console, f"{found.rig.name}, joint forces in {len(found)} records", headings, rows)
    print_lines(console, [JOINT_NOTE, *(f"warning: {warning}" for warning in found.warnings)])


def print_laws_found(
    console: Console, reconstruction: Reconstruction, laws: Sequence["IdentifiedLaw"], warnings: Sequence[str]
) -> None:
    """Print how laws fit, the best first, with their parameters, and what to beware of."""
    from hbm.files.identifyreport import law_table

    headings, rows = law_table(laws)
    title = f"{reconstruction.rig.name}, {len(reconstruction)} records"
    print_table(console, title, list(map(_stacked, headings[:-1])), [row[:-1] for row in rows])
    print_lines(console, [f"{row[0]}: {row[-1]}" for row in rows])
    print_lines(console, [f"warning: {warning}" for warning in warnings])


def _stacked(heading: str) -> str:
    """A heading of two lines: the unit, and the second of two words, below."""
    return heading.replace(" [", "\n").rstrip("]").replace("worst ", "worst\n").replace("BIC ", "BIC\n")
