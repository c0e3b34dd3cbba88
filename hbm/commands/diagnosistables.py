"""Tables that the command line prints of a diagnosis."""

from rich.console import Console
from rich.table import Table
from rich.text import Text

from hbm.commands.tables import print_lines, print_table
from hbm.files.diagnosed import Diagnosed
from hbm.files.diagnosispage import error_table, ranking_table
from hbm.files.diagnosissummary import verdict_line


def print_diagnosis(console: Console, found: Diagnosed) -> None:
    """Print the verdict and what is said first, the errors of the models, the causes that were fitted, the evidence."""
    d = found.diagnosis
    print_lines(console, [verdict_line(d), *(f"warning: {line}" for line in found.warnings)])
    console.print(_answers(found))
    for title, (headings, rows) in (("models", error_table(d)), ("causes", ranking_table(d))):
        shown = [h.replace(" [", "\n").rstrip("]") for h in (headings[:-1] if title == "causes" else headings)]
        if rows:
            print_table(console, title, shown, [row[: len(shown)] for row in rows])
    print_lines(console, found.evidence[len(found.warnings) :])


def _answers(found: Diagnosed) -> Table:
    """The six answers that are printed first, a row for each question."""
    table = Table.grid(padding=(0, 2))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for question, answer in found.answers().items():
        table.add_row(question, Text(answer))
    return table
