"""What is seen on a terminal: a bar that is one, titles on one line, numbers that say no more than is known."""

import io

import numpy as np
import pytest
from rich.console import Console

from hbm.commands.progress import BAR, Work
from hbm.commands.tables import print_table
from hbm.files.identifiedlaw import Value, value_text


def printed(width: int) -> tuple[Console, io.StringIO]:
    text = io.StringIO()
    return Console(width=width, file=text, force_terminal=True, color_system=None), text


@pytest.mark.parametrize("width", [60, 100])
def test_the_bar_keeps_its_width_beside_many_words(width: int) -> None:
    console, text = printed(width)
    work = Work()
    work.show("fitting stribeck-weakening beside a wrong normal load and whatever else is to be told of it here", 0.999)
    console.print(work.bar.get_renderable())
    (line,) = text.getvalue().rstrip().splitlines()
    assert line.count("━") >= BAR - 1
    assert len(line) <= width


def test_a_bar_does_not_go_back_where_a_search_begins_anew() -> None:
    work = Work()
    for doing, done in (("screening", 0.5), ("screening again", 0.3)):
        work.show(doing, done)
    (task,) = work.bar.tasks
    assert (task.description, task.completed) == ("screening again", 0.5)


def test_a_title_is_one_line_above_a_narrow_table() -> None:
    console, text = printed(100)
    title = "record 1: recordings/run_48.5Hz_2N.csv, 2 N at 48.5 Hz"
    print_table(console, title, ["n"], [["1"]])
    assert text.getvalue().splitlines()[0] == title


NUMBERS = ["0", "299.6", "5.41e+04"]


@pytest.mark.parametrize("width", [60, 80, 120])
def test_long_names_are_shortened_and_numbers_are_not(width: int) -> None:
    console, text = printed(width)
    causes = [" + ".join(f"parameter:damping.modal_ratios[{i}]" for i in range(n, 13)) for n in (1, 12, 8)]
    rows = [[cause, number, "3.14"] for cause, number in zip(causes, NUMBERS, strict=True)]
    print_table(console, "causes", ["cause", "BIC above best", "held-out error\n%"], rows)
    lines = text.getvalue().splitlines()
    assert max(map(len, lines)) <= width
    assert "BIC above best" in text.getvalue() and "held-out error" in text.getvalue()
    shown = [line.split() for line in lines if line.lstrip().startswith("parameter:")]
    assert [row[-2:] for row in shown] == [[number, "3.14"] for number in NUMBERS]
    assert all(line.count("…") <= 1 for line in lines)
    assert (causes[1] in text.getvalue()) == (width > 60)  # what has room is not shortened


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Value("sigma1", 7e-11, 440.0, "N s/m"), "7e-11 ± 4e+02 N s/m, not determined"),
        (Value("sigma1", 0.0, 3.0, "1"), "0 ± 3, not determined"),
        (Value("mu", 0.52, 0.0013, "1"), "0.5200 ± 0.0013"),
        (Value("mu", 0.52, float(np.nan), "1"), "0.52"),
    ],
)
def test_a_parameter_is_said_as_well_as_it_is_known(value: Value, text: str) -> None:
    assert value_text(value) == text
