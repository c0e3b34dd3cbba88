"""Tables that ``hbm continue`` prints of a curve."""

from rich.console import Console

from continuation import Kind
from hbm.commands.tables import LISTED, counted, force_cells, print_lines, print_rows, stable_words
from hbm.tracking.parameterresponse import ParameterCurve


def print_parameter_curve(console: Console, curve: ParameterCurve) -> None:
    """Print the first point, the last, the highest and the folds, and how accurate they are."""
    values, top = curve.values, curve.points.index(curve.peak)
    number = curve.parameter.rpartition(".")[2] + ("" if curve.unit == "1" else f"\n{curve.unit}")
    rows = [
        {
            "point": name,
            number: f"{values[i]:.6g}",
            "drive\nmm": f"{1e3 * curve['drive'].peak[i]:.4g}",
            **force_cells(curve, slice(i, i + 1)),
        }
        for name, i in (("first", 0), ("highest", top), ("last", len(values) - 1))
    ]
    print_rows(console, curve.rig.headline, rows)
    lines = [f"{counted(len(values), 'point')} at {' and '.join(curve.held)}; {curve.reason}"]
    lines += [f"fold at {curve.parameter} = {value:.6g}" for value in curve.folds]
    lines += [
        f"{b.kind.value} at {curve.parameter} = {curve.value_at(b.special.lam):.6g}"
        for b in curve.bifurcations[:LISTED]
        if b.kind is not Kind.FOLD
    ]
    if curve.stable is not None:
        lines.append(stable_words(curve))
    lines += [f"warning: {curve.past_start}"] if curve.past_start else []
    lines += [f"corner at {curve.parameter} = {value:.6g}" for value in curve.corners]
    lines += [f"warning: the tip would lift off from {low:.5g} to {high:.5g}" for low, high in curve.lift_off]
    lines += [
        f"warning: a law is not solved at its samples from {low:.5g} to {high:.5g}" for low, high in curve.unsolved
    ]
    lines.append(f"more harmonics, samples and modes change the ends and the peak by {curve.error:.2%}")
    print_lines(console, lines)
