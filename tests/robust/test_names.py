"""Names from files are shown as they are: on the terminal, on pages, in figures and in messages."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner, Result

from hbm.cli import app
from hbm.commands.progress import Work
from hbm.errors import InputError
from hbm.figures import plot_curves
from hbm.figures.page import Page, Section, Table, page_html
from hbm.measurement.exchange import write_recording
from hbm.measurement.historyfile import load_history
from hbm.measurement.recording import recording
from hbm.response.trace import trace_frequency
from hbm.rigfiles.load import load_rig

ROOT = Path(__file__).parents[2]
ONE_MODE = (ROOT / "examples" / "one_mode.toml").read_text(encoding="utf-8")
NAME = "[/nope] [bold]b[/bold] <b>x</b> $\\frac$ $"
HOSTILE = NAME + " \x1b[2J\x00\r\n\u202e"
SEEN = NAME + r" \x1b[2J\x00\r\n\u202e"


def rig_file(folder: Path, name: str = HOSTILE, channel: str = "a1") -> Path:
    path = folder / "rig.toml"
    text = ONE_MODE.replace('"one mode"', json.dumps(name)).replace('"a1"', json.dumps(channel))
    path.write_text(text, encoding="utf-8")
    return path


def run(*args: object) -> Result:
    return CliRunner().invoke(app, [str(a) for a in args], prog_name="hbm")


def flat(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.parametrize(
    "command",
    [
        ("modes",),
        ("frf", "--from", "48", "--to", "52", "--harmonics", "3", "--no-stability"),
        ("simulate", "--frequency", "50", "--duration", "0.1"),
    ],
    ids=lambda command: command[0],
)
def test_the_terminal_shows_a_name_as_it_is(command: tuple[str, ...], tmp_path: Path) -> None:
    result = run(command[0], rig_file(tmp_path, channel="[/a] $\\x$"), *command[1:])
    assert result.exit_code == 0, result.stderr
    assert flat(SEEN) in flat(result.stdout)
    assert result.stdout.replace("\n", "").isprintable()
    if command[0] == "simulate":
        assert "[/a] $\\x$" in result.stdout


def test_figures_take_no_name_for_a_formula(tmp_path: Path) -> None:
    rig = load_rig(rig_file(tmp_path))
    axes = plot_curves(trace_frequency(rig, (49.0, 51.0), harmonics=1))
    figure = axes[0].figure
    figure.canvas.draw()  # a formula that is none would fail here
    assert r"\frac" in axes[0].get_title(loc="left")


def test_pages_escape_what_they_show() -> None:
    table = Table(["<i>h</i>"], [["<script>alert(1)</script>"]])
    page = page_html(
        Page(title="<script>", lead=["a & b"], sections=[Section("<b>", text=["<img src=x>"], table=table)])
    )
    for tag in ("<script>alert", "<img src=x", "<i>h", "<b>"):
        assert tag not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page


def test_a_message_is_one_visible_line(tmp_path: Path) -> None:
    path = rig_file(tmp_path, channel="a\x1b[31m")
    with pytest.raises(InputError) as refused:
        load_rig(path)
    assert str(refused.value).isprintable()
    assert r"channels[2].name = " in str(refused.value)
    stderr = run("modes", path).stderr
    assert stderr.rstrip("\n").isprintable() and stderr.count("\n") == 1


def test_progress_takes_no_name_for_markup() -> None:
    work, shown = Work(), io.StringIO()
    work.show("trying [/nope]", 0.5)
    Console(file=shown, width=100).print(work.bar.get_renderable())
    assert "trying [/nope]" in shown.getvalue()


def test_a_uff_file_takes_no_name_that_breaks_its_lines(tmp_path: Path) -> None:
    recorded = recording("source", np.arange(10) / 10.0, {"a\nb": np.arange(10.0)})
    with pytest.raises(InputError, match=r'channel "a\\nb"; must be ASCII'):
        write_recording(tmp_path / "a.uff", recorded)


def test_channels_of_a_history_are_shown_as_they_are(tmp_path: Path) -> None:
    t = np.arange(200) / 1000.0
    file, out = tmp_path / "history.csv", tmp_path / "spectra.csv"
    rows = [f"{x},{np.cos(40 * np.pi * x)}" for x in t]
    file.write_text("\n".join(["time_s,[/nope]\x1b[31m", *rows]), encoding="utf-8")
    assert list(load_history(file).channels) == ["[/nope]\x1b[31m"]
    result = run("spectra", file, "--fundamental", "20", "--level", "1", "--harmonics", "3", "--out", out)
    assert result.exit_code == 0, result.stderr
    assert r"[/nope]\x1b[31m" in result.stdout
    assert result.stdout.replace("\n", "").isprintable()


@pytest.mark.parametrize("key", ["mass", "stiffness", "damping", "dofs"])
def test_files_of_matrices_are_named_without_control_characters(key: str, tmp_path: Path) -> None:
    entries = {"mass": "M.npz", "stiffness": "K.npz"} | {key: "a\0.npz"}
    tables = "\n".join(f"{name} = {json.dumps(value)}" for name, value in entries.items())
    path = tmp_path / "rig.toml"
    path.write_text(
        f'name = "x"\n[matrix]\n{tables}\n[[joints]]\nname = "j"\nlaw = "cubic-spring"\ncubic = 1.0\nat = "1"\n'
        '[excitation]\namplitude = 1.0\nat = "1"\n'
    )
    with pytest.raises(InputError, match=rf"matrix.{key} = .*; must be a name without control characters$"):
        load_rig(path)
