"""Tables that the command line prints of results, of at most 80 columns, and lines beneath them."""

import inspect
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, fields
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from hbm.balance.contactloss import contact_lost
from hbm.errors import shortened, visible
from hbm.rigfiles.lawchoice import KnownLaw, known_law, plain
from hbm.rigfiles.schema import accepted_setting
from models.friction import describe
from models.jointed import AnyRig, JointedRig
from models.joints import JOINT_LAWS

if TYPE_CHECKING:
    from hbm.integration.history import TimeHistory
    from hbm.integration.jointed import JointHistory
    from hbm.measurement.harmonicestimate import HarmonicEstimate
    from hbm.modes.linear import LinearModes
    from hbm.response.assessment import Assessment
    from hbm.response.curve import ResponseCurve
    from hbm.response.loop import FrictionLoop

NAMES = ("cause", "record", "channel", "law", "example")
"""Headings of columns of names, which are shortened where a line has no room for them."""

TEXTS = (*NAMES, "verdict", "unit", "values", "about", "most by (tolerance)")
"""Headings of columns that hold no numbers."""

SHORTEST = 12
"""Characters that are left of a name."""

PROSE = ("about", "most by (tolerance)")
"""Heading of the column that may take several lines."""

LISTED = 20
"""Up to so many bifurcations of a curve are listed, more are counted."""

SETTLED = 5e-5
"""Change from one period to the next below which its per cent would be shown as 0.00."""

UNBOUNDED = 100_000
"""Characters of a line that has room for everything."""

EVERYWHERE = slice(None)

LAWS_FOOT = (
    "Columns: key of the rig file, value, unit, accepted values, meaning and source.",
    "Equations of friction: Hadji & Mureithi, Shock and Vibration 2019.",
)


def print_modes(console: Console, rig: AnyRig, modes: "LinearModes") -> None:
    """Print natural frequencies, damping, and what the modes left out contribute."""
    numbers = zip(modes.sliding_hz, modes.stuck_hz, modes.damping_ratio, modes.stuck_damping_ratio, strict=True)
    rows = [
        [str(i), f"{free:.3f}", dashed(held, ".3f"), f"{100 * ratio:.4g}", dashed(100 * lost, ".4g")]
        for i, (free, held, ratio, lost) in enumerate(numbers, start=1)
    ]
    if isinstance(rig, JointedRig):
        print_table(
            console, rig.name, ["mode", "free\nHz", "joined at rest\nHz", "damping free\n%", "damping joined\n%"], rows
        )
        gone = sum(map(math.isnan, modes.stuck_hz))
        rigid = [f"held rigidly when stuck: {gone} mode{'s' * (gone > 1)} fewer"] * bool(gone)
        slow = [f"mode {i} joined is damped beyond critical: it does not oscillate" for i in modes.overdamped]
        print_lines(console, [*map(str, rig.joints), *rigid, *slow])
        return
    print_table(console, rig.name, ["mode", "sliding\nHz", "stuck\nHz", "damping\n%"], [row[:-1] for row in rows])
    s = rig.structure
    held = "rigid" if math.isinf(modes.stiffness) else f"{modes.stiffness:.4g} N/m"
    print_lines(
        console,
        [
            f"contact stiffness when stuck: {held} ({rig.contact.law.name} in series with the residual compliance)",
            f"residual compliance at the contact: {s.compliance:.4g} m/N",
            f"static correction at the drive: {s.residual.drive_by_force:.4g} m/N by the force, "
            f"{s.residual.slip_by_force:.4g} m/N by the friction",
        ],
    )


def print_curves(console: Console, curves: Sequence["ResponseCurve"]) -> None:
    """Print what was found at each level, how accurate it is, why, and what to beware of."""
    first = curves[0].rig
    print_rows(console, first.headline, map(_response_row, curves))
    assessed = [(c, c.assessment) for c in curves if c.assessment is not None]
    print_rows(
        console,
        "numerical error of drive and contact forces, relative to the largest of each",
        (_numerics_row(c, known) for c, known in assessed),
    )
    for c, known in assessed:
        remarks = [known.reason, *contact_lost([p.off for p in c.points]), *(f"warning: {w}" for w in known.warnings)]
        print_lines(console, [f"{c.level:g} N: {remark}" for remark in remarks])
    for c in curves:
        print_lines(console, [f"{c.level:g} N: {line}" for line in _stability_lines(c)])


def stable_words(curve: "ResponseCurve") -> str:
    """How much of a curve is unstable."""
    if curve.stable is None or curve.doubtful is None:
        return "stability not worked out"
    unstable, doubtful = int((~curve.stable & ~curve.doubtful).sum()), int(curve.doubtful.sum())
    said = f"{unstable} of {len(curve.points)} points unstable" if unstable or doubtful else "stable everywhere"
    return (
        f"{said}, {doubtful} in doubt: too close to the unit circle, or finer numerics judge otherwise"
        if doubtful
        else said
    )


def _stability_lines(curve: "ResponseCurve") -> list[str]:
    """How much of a curve is unstable, and where it bifurcates."""
    if curve.stable is None:
        return []
    if len(curve.bifurcations) <= LISTED:
        return [stable_words(curve), *map(str, curve.bifurcations)]
    counts = Counter(b.kind.value for b in curve.bifurcations)
    return [stable_words(curve), "bifurcations: " + ", ".join(f"{count} {kind}" for kind, count in counts.items())]


def _response_row(c: "ResponseCurve") -> dict[str, str]:
    return {
        "level\nN": f"{c.level:g}",
        "points": str(len(c.points)),
        "drive\nmm": f"{1e3 * c['drive'].peak.max():.4g}",
        "at\nHz": f"{c.peak.hz:.2f}",
        **force_cells(c),
        "folds": str(len(c.folds)),
    }


def force_cells(c: "ResponseCurve", points: slice = EVERYWHERE) -> dict[str, str]:
    """Largest forces of the contact, or of the joint with the largest, in some points of a curve."""
    if "normal" in c.rig.computed:
        normal = [p["normal"] for p in c.points[points]]
        return {
            "slip\nµm": f"{1e6 * c['slip'].peak[points].max():.3g}",
            "friction\nN": f"{c['friction'].peak[points].max():.3g}",
            "reaction\nN": f"{min(n.samples.min() for n in normal):.3g} to {max(n.peak for n in normal):.3g}",
        }
    if not c.rig.forces:
        return {}
    largest = {name: float(c[name].peak[points].max()) for name in c.rig.forces}
    name = max(largest, key=largest.__getitem__)
    return {"largest\njoint force": f"{largest[name]:.3g} {c[name].unit}", "in": name.replace(".force", "")}


def _numerics_row(c: "ResponseCurve", known: "Assessment") -> dict[str, str]:
    error, worst = known.error, known.error.worst
    assessed = math.isfinite(error.at_peak.total)  # else the worst of what could be is of points that matter less
    return {
        "level\nN": f"{c.level:g}",
        "H": str(c.basis.H),
        "samples": str(c.basis.N_t),
        "modes": str(c.rig.structure.n),
        "at the peak\n%": f"{100 * error.at_peak.total:.2f}" if assessed else "not assessed",
        "worst\n%": f"{100 * worst.total:.2f}" if assessed else "not assessed",
        "at\nHz": f"{worst.hz:.2f}" if assessed else "-",
        "loop\nclosure": f"{error.closure:.0e}",
    }


def counted(count: float, what: str) -> str:
    """So many of something.

    >>> counted(1, "point"), counted(2.5, "period")
    ('1 point', '2.5 periods')
    """
    return f"{count:.6g} {what}{'' if count == 1 else 's'}"


def print_history(console: Console, history: "TimeHistory | JointHistory") -> None:
    """Print the last period's peaks, how steady it is, and what to beware of."""
    from hbm.integration.history import TimeHistory

    title = f"{history.rig.name}, {history.level:g} N at {history.hz:g} Hz"
    rows = []
    for name, signal in history.channels.items():
        last = signal.values[-history.samples_per_period :]
        rows.append([name, f"{last.min():.4g}", f"{last.max():.4g}", signal.unit])
    print_table(console, title, ["channel", "least", "largest", "unit"], rows)
    periods = (len(history.time) - 1) / history.samples_per_period
    lasts = f"{counted(periods, 'period')}, {history.time[-1]:g} s"
    lines = [f"{len(history.time)} samples, {lasts}; the table is of the last period"]
    if math.isfinite(change := history.steadiness):
        said = "changes by less than 0.01%" if change < SETTLED else f"still changes by {change:.2%}"
        lines.append(f"drive displacement {said} from one period to the next")
    if isinstance(history, TimeHistory) and history.lift_off is not None:
        lines.append(
            f"warning: the tip would lift off from {history.lift_off:.5g} s on; the model keeps it on the support"
        )
    print_lines(console, lines)


def print_spectra(console: Console, records: Sequence["HarmonicEstimate"], levels: Sequence[float]) -> None:
    """Print the fundamental of each channel of each record, how sure and steady it is, and what to beware of."""
    for number, (record, level) in enumerate(zip(records, levels, strict=True), start=1):
        sine = all(q.harmonic == 1 for q in record.quality)
        rows = [
            {
                "channel": q.name,
                "fundamental\n|c1|" if sine else "strongest\n|ck|": f"{q.amplitude:.5g}",
                "std\n ": f"{q.std:.2g}",
                "unit": record.units.get(q.name) or "not stated",
                "trend\n%": dashed(100 * q.steadiness.change, ".2g"),
                "steady": ("yes" if q.steadiness.steady else "no") if math.isfinite(q.steadiness.p_steady) else "-",
                "between harmonics\n% of rms": f"{100 * q.leftover.share:.2g}",
            }
            for q in record.quality
        ]
        print_rows(console, f"record {number}: {record.source}, {level:.4g} N at {record.hz:.8g} Hz", rows)
        print_lines(console, str(record).splitlines())


def print_laws(console: Console, laws: Sequence[Any], *, detailed: bool) -> None:
    """Print laws with their parameters, and of each the first line it is described by, or all of them."""
    for law in laws:
        known, paragraphs = known_law(law), _paragraphs(law)
        console.print(Text.assemble((law.name, "bold"), (_beside(law, known), "dim")), highlight=False)
        for paragraph in paragraphs if detailed else paragraphs[:1]:
            _indented(console, Text(paragraph))
            if detailed:
                console.print()
        _indented(console, _parameter_table(law, known))
        console.print()
    print_lines(console, LAWS_FOOT)


def _beside(law: type, known: KnownLaw | None) -> str:
    """What stands beside the name of a law: where it may stand, or where its values are from."""
    if law in JOINT_LAWS.values():
        return "  in [[joints]] only"
    return f"  {known.source if known else 'no values are known'}" if fields(law) else ""


def _paragraphs(law: type) -> list[str]:
    """Describe a law by its docstring: paragraphs without their line ends, equations as they are."""
    blocks = (inspect.getdoc(law) or "").replace("`", "").split("\n\n")
    return [block if block.startswith(" ") else " ".join(block.split()) for block in blocks]


def _indented(console: Console, what: Any) -> None:
    console.print(Padding(what, (0, 0, 0, 2)), highlight=False)


def _parameter_table(law: type, known: KnownLaw | None) -> Table:
    table = Table.grid(padding=(0, 2, 0, 0))
    for least, justify in ((17, "left"), (8, "right"), (5, "left"), (5, "left")):
        table.add_column(justify=justify, min_width=least, no_wrap=True)  # type: ignore[arg-type]
    table.add_column()
    for f in fields(law):
        value = getattr(known.law if known else law, f.name, ())
        shown = "-" if value == () else plain(value)
        table.add_row(*map(Text, (f.name, shown, *_unit_bound_and_meaning(law, f))))
    return table


def _unit_bound_and_meaning(law: type, f: "Field[Any]") -> tuple[str, str, str]:
    optional = "" if f.default in (MISSING, ()) else f"; {plain(f.default)} if left out"
    p = describe(law).get(f.name)
    if p is not None:
        bound = f">= {p.at_least}" if p.at_least else p.bound
        return "" if p.unit == "1" else p.unit, bound, f"{p.meaning}; {p.source}{optional}"
    s = f.metadata["setting"]
    others = f"; instead of {', '.join(s.instead_of)}" if s.instead_of else ""
    return "", accepted_setting(law, f.name), f"{s.meaning}; {s.source}{optional}{others}"


def print_loops(console: Console, loops: Sequence["FrictionLoop"], sets: Sequence[str]) -> None:
    """Print the largest force and the energy lost per period of some laws' loops, and their sets of parameters."""
    first = loops[0]
    amplitude = f"{1e6 * (first.u.max() - first.u.min()) / 2:g}"
    headings = ["law", "largest force\nN", "lost per period\nmJ", "values"]
    rows = [
        [loop.law.name, f"{abs(loop.T).max():.4g}", f"{1e3 * loop.dissipated:.4g}", name]
        for loop, name in zip(loops, sets, strict=True)
    ]
    print_table(console, f"slip of {amplitude} µm at {first.hz:g} Hz, load {first.load:g} N", headings, rows)


def print_rows(console: Console, title: str, rows: Iterable[Mapping[str, str]]) -> None:
    """Print a table of rows that name their columns, if there are any."""
    listed = list(rows)
    if listed:
        print_table(console, title, list(listed[0]), [list(row.values()) for row in listed])


def print_table(console: Console, title: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table without lines between its columns, numbers to the right; names in it are shown as they are.

    Where a line has no room for all, the longest names are shortened, so that no number is.
    """
    console.print(Text(visible(title), "bold"), soft_wrap=True)  # a title of the table would be wrapped to its width
    cells = [[visible(cell) for cell in row] for row in rows]
    table = _table(headings, cells)
    excess = console.measure(table, options=console.options.update(width=UNBOUNDED)).maximum - console.width
    named = [i for i, heading in enumerate(headings) if heading in NAMES]
    if excess > 0 and named and not set(PROSE) & set(headings):
        widths = {i: max(len(row[i]) for row in cells) for i in named}
        longest = max(named, key=lambda i: widths[i])
        most = max(widths[longest] - excess, SHORTEST)
        table = _table(headings, [[shortened(c, most) if i == longest else c for i, c in enumerate(r)] for r in cells])
    console.print(table)


def _table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for heading in headings:
        table.add_column(Text(heading), justify="left" if heading in TEXTS else "right", no_wrap=heading not in PROSE)
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def dashed(value: float, form: str) -> str:
    """A number, or a dash where it is not known."""
    return format(value, form) if math.isfinite(value) else "-"


def print_lines(console: Console, lines: Iterable[str]) -> None:
    """Print lines as they are; only a terminal wraps them."""
    for line in lines:
        console.print(visible(line), markup=False, highlight=False, soft_wrap=True)
