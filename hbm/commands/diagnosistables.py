"""What the command line prints of a diagnosis."""

from rich.console import Console

from hbm.commands.tables import print_lines, titled_table
from hbm.results.diagnosisfiles import Diagnosed, error_table, ranking_table


def print_diagnosis(console: Console, found: Diagnosed) -> None:
    """Print the verdict, the errors of the models, the causes that were fitted, and the evidence."""
    d = found.diagnosis
    print_lines(console, [str(d).splitlines()[0]])
    print_lines(console, [f"warning: {line}" for line in found.warnings])
    for title, (headings, rows) in (("models", error_table(d)), ("causes", ranking_table(d))):
        columns = headings[:-1] if title == "causes" else headings
        table = titled_table(title, *(heading.replace(" [", "\n").rstrip("]") for heading in columns))
        for row in rows:
            table.add_row(*row[: len(columns)])
        if rows:
            console.print(table)
    if d.not_separable:
        print_lines(console, [f"not told apart: {', '.join(d.not_separable)}", f"to tell them apart: {d.separate_by}"])
    print_lines(console, found.evidence[len(found.warnings) :])
