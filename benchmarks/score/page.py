"""The table of a score in Markdown."""

from collections.abc import Mapping, Sequence

from benchmarks.score.rates import Row

COLUMNS = ("measure", "value", "of", "95 % interval", "ceiling", "ceiling, exact rig file")


def markdown(
    head: Mapping[str, object], rows: Sequence[Row], points: Mapping[str, Sequence[Mapping[str, float]]]
) -> str:
    """What was scored, a table per group, and the points of the reliability curve."""
    parts = [f"# Score of the diagnosis\n\n{', '.join(f'{name} {value}' for name, value in head.items())}\n"]
    for group in dict.fromkeys(row.group for row in rows):
        parts.append(f"## {group[0].upper()}{group[1:]}\n\n{table([row for row in rows if row.group == group])}\n")
    parts.append("## Reliability of confidence\n\n| | confidence | right | cases |\n|---|---:|---:|---:|")
    for what, found in points.items():
        parts += [f"| {what} | {p['confidence']:.3f} | {p['right']:.3f} | {p['cases']:.0f} |" for p in found]
    return "\n".join(parts) + "\n"


def table(rows: Sequence[Row]) -> str:
    """Rows of a group, with ceilings where one has them."""
    width = 4 if all(row.ceiling is None and row.exact is None for row in rows) else 6
    lines = [COLUMNS, ("---", *["---:"] * 5), *(cells(row) for row in rows)]
    return "\n".join(f"| {' | '.join(line[:width])} |" for line in lines)


def cells(row: Row) -> tuple[str, ...]:
    """A rate as k/n with its interval, a number over n values."""
    value = "" if row.value is None else f"{row.value:.3f}" if row.k is not None else f"{row.value:.4g}"
    of = f"{row.n}" if row.k is None else f"{row.k}/{row.n}"
    interval = "" if row.low is None or row.high is None or not row.n else f"{row.low:.3f} to {row.high:.3f}"
    return (row.name, value, of, interval, *("" if x is None else f"{x:.3g}" for x in (row.ceiling, row.exact)))
