"""Python that a rig file names is run with leave alone, and from its own folder alone."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from continuation import ConvergenceError
from hbm.cli import app
from hbm.errors import InputError
from hbm.response.trace import steady_state
from hbm.rigfiles.load import load_rig
from models.plausible import RANGES

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "paper_beam_bouc_wen.toml"
LAW = (ROOT / "examples" / "bouc_wen.py").read_text(encoding="utf-8")
LEAVE = "if you trust it, allow it with --allow-code, HBM_ALLOW_CODE=1 or load_rig(path, allow_code=True)"


@pytest.fixture(autouse=True)
def without_leave(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HBM_ALLOW_CODE", raising=False)


def rig_naming(folder: Path, name: str, tables: str = "") -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / "rig.toml"
    path.write_text(EXAMPLE.read_text(encoding="utf-8").replace("bouc_wen.py:BoucWen", name) + tables, encoding="utf-8")
    return path


def marking(path: Path) -> Path:
    """A law that leaves a mark when its file is run; returns the mark."""
    mark = path.with_suffix(".ran")
    path.write_text(f"open({str(mark)!r}, 'w').close()\n{LAW}", encoding="utf-8")
    return mark


def test_a_law_that_a_rig_file_names_is_not_run_without_leave(tmp_path: Path) -> None:
    mark, rig = marking(tmp_path / "own.py"), rig_naming(tmp_path, "own.py:BoucWen")
    expected = (
        f'{rig}: contact.friction.law = "own.py:BoucWen"; would run the Python file {tmp_path / "own.py"}; {LEAVE}'
    )
    with pytest.raises(InputError) as refused:
        load_rig(rig)
    assert str(refused.value) == expected
    result = CliRunner().invoke(app, ["modes", str(rig)], prog_name="hbm")
    assert (result.exit_code, result.stderr, result.stdout) == (2, f"{expected}\n", "")
    assert not mark.exists()


def test_leave_is_an_argument_an_option_or_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mark, rig = marking(tmp_path / "own.py"), rig_naming(tmp_path, "own.py:BoucWen")
    assert load_rig(rig, allow_code=True).contact.law.name == "bouc-wen"
    assert mark.exists()
    assert CliRunner().invoke(app, ["modes", str(rig), "--allow-code"]).exit_code == 0
    monkeypatch.setenv("HBM_ALLOW_CODE", "1")
    assert load_rig(rig).contact.law.name == "bouc-wen"
    with pytest.raises(InputError, match="would run"):
        load_rig(rig, allow_code=False)
    monkeypatch.setenv("HBM_ALLOW_CODE", "0")
    with pytest.raises(InputError, match="would run"):
        load_rig(rig)


@pytest.mark.parametrize("name", ["../own.py", "{outside}/own.py", "link.py", "linked/own.py"])
def test_a_file_outside_the_folder_is_never_run(name: str, tmp_path: Path) -> None:
    mark, folder = marking(tmp_path / "own.py"), tmp_path / "rig"
    rig = rig_naming(folder, f"{name.format(outside=tmp_path)}:BoucWen")
    (folder / "link.py").symlink_to(tmp_path / "own.py")
    (folder / "linked").symlink_to(tmp_path)
    with pytest.raises(InputError) as refused:
        load_rig(rig, allow_code=True)
    said = f"is the Python file {tmp_path / 'own.py'}; must be in the folder of the rig file, {folder}"
    assert str(refused.value).endswith(said)
    assert not mark.exists()


def test_causes_and_joints_ask_too(tmp_path: Path) -> None:
    mark = marking(tmp_path / "own.py")
    rig = rig_naming(tmp_path, "bouc_wen.py:BoucWen", '\n[[extensions]]\ncause = "own.py:Cause"\n')
    rig.write_text(rig.read_text(encoding="utf-8").replace("bouc_wen.py:BoucWen", "dahl").replace("exponent", "#"))
    rig.write_text("\n".join(line for line in rig.read_text().split("\n") if not line.startswith("beta")))
    with pytest.raises(InputError, match=r"extensions\[1\].cause = .* would run the Python file"):
        load_rig(rig)
    joints = (ROOT / "examples" / "jointed_beam.toml").read_text(encoding="utf-8")
    rig.write_text(joints.replace('"impact-stop"', '"own.py:BoucWen"'))
    with pytest.raises(InputError, match=r"joints\[3\].law = .* would run the Python file .*allow_code=True\)$"):
        load_rig(rig)
    assert not mark.exists()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (r"own\u0000.py:Law", "must name a file without control characters"),
        (r"own\n.py:Law", "must name a file without control characters"),
        ("x" * 300 + ".py:Law", "there is no file"),
        ("loop.py:Law", "there is no file"),
    ],
)
def test_names_that_are_no_files_are_refused_in_one_line(name: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "loop.py").symlink_to(tmp_path / "loop.py")
    rig = rig_naming(tmp_path, name)
    with pytest.raises(InputError, match=message) as refused:
        load_rig(rig, allow_code=True)
    assert str(refused.value).isprintable()


def test_the_command_and_its_workers_import_nothing_from_the_working_folder(tmp_path: Path) -> None:
    """A module of the standard library's name lies there; each process that imported it would leave a mark."""
    for name in ("socket", "random", "pickle", "casadi", "hbm", "models"):
        (tmp_path / f"{name}.py").write_text(f"open('{name}.ran', 'w').close()\nraise SystemExit(3)\n")
    code = (
        "import hbm.cli, hbm.parallel, os, sys\n"
        "if __name__ == '__main__':\n"
        "    hbm.cli.app = lambda **_: None\n"
        "    hbm.cli.main()\n"
        "    with hbm.parallel.Helped(1) as process:\n"
        "        print(process.submit(abs, -3).result())\n"
    )
    script = tmp_path / "bin" / "command.py"  # as a console script: its own folder is searched, the working one is not
    script.parent.mkdir()
    script.write_text(code)
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")} | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.returncode) == ("3\n", 0), done.stderr
    assert not list(tmp_path.glob("*.ran"))


@pytest.mark.slow
def test_a_law_that_runs_out_of_numbers_ends_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Powers of 1000 underflow: what one history of the contact gives as numbers, another does not."""
    monkeypatch.delitem(RANGES, "exponent")  # which refuses it
    rig = load_rig(EXAMPLE, allow_code=True)
    law = replace(rig.contact.law, exponent=1000.0)
    with pytest.raises(ConvergenceError, match=r"first solution: none at 44\.493 Hz"):
        steady_state(replace(rig, contact=replace(rig.contact, law=law)), 44.493, harmonics=5)
