"""The wheel: installed alone, in folders that have a models.py of their own, from the script and in other processes."""

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RIG = "rig.toml"
USERS_OWN = 'raise RuntimeError("this is the user\'s own module")\n'

BUILD = "import sys; from hatchling.build import build_wheel; print(build_wheel(sys.argv[1]))"

EXAMPLES = """
from typer.testing import CliRunner
from hbm.cli import app

copies = [["examples", name] for name in ("diagnosed_beam", "paper_beam_bouc_wen.toml")]
for args in (["examples"], *copies, ["modes", "paper_beam_bouc_wen.toml", "--allow-code"]):
    print(CliRunner().invoke(app, args).output)
"""

WORKER = """
from hbm import load_rig
from hbm.parallel import Helped

if __name__ == "__main__":
    with Helped(1) as executor:
        print(executor.submit(load_rig, "rig.toml").result().name)
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the contents of the wheel, as in an environment it was installed into."""
    folder = tmp_path_factory.mktemp("wheel")
    built = subprocess.run(
        [sys.executable, "-c", BUILD, str(folder)], cwd=ROOT, capture_output=True, text=True, check=True
    )
    site = folder / "site"
    with zipfile.ZipFile(folder / built.stdout.split()[-1]) as wheel:
        wheel.extractall(site)
    # other packages are those of this environment, without the checkout that is installed in it
    (site / "sitecustomize.py").write_text(
        f"import sys\nsys.path[:] = [p for p in sys.path if p != {str(ROOT)!r}]\n"
        f"sys.meta_path[:] = [f for f in sys.meta_path if 'editable' not in repr(f)]\n"
    )
    return site


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A user's folder, with modules that are called like ours."""
    for name in ("models.py", "continuation.py"):
        (tmp_path / name).write_text(USERS_OWN)
    (tmp_path / RIG).write_bytes((ROOT / "examples" / "one_mode.toml").read_bytes())
    return tmp_path


def python(site: Path, folder: Path, *args: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(site), "MPLBACKEND": "agg"}
    found = subprocess.run(
        [sys.executable, *args], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
    return found.stdout


def test_the_wheel_has_one_top_level_package(installed: Path) -> None:
    found = {p.name for p in installed.iterdir() if p.suffix != ".dist-info" and p.name != "sitecustomize.py"}
    assert found == {"hbm"}


def test_a_rig_is_loaded_beside_modules_of_the_same_names(installed: Path, folder: Path) -> None:
    code = "import hbm; rig = hbm.load_rig('rig.toml'); print(type(rig).__module__, hbm.ConvergenceError.__module__)"
    assert python(installed, folder, "-c", code) == "hbm.models.rig hbm.continuation.branch\n"


@pytest.mark.parametrize("name", ["bouc_wen", "own_cause"])
def test_files_of_the_guides_run_beside_an_installation(installed: Path, folder: Path, name: str) -> None:
    (folder / f"{name}.py").write_bytes((ROOT / "examples" / f"{name}.py").read_bytes())
    assert python(installed, folder, "-c", f"import {name}; print({name}.__name__)") == f"{name}\n"


def test_the_script_and_other_processes_run_beside_them(installed: Path, folder: Path) -> None:
    script = (
        "import sys; sys.path.insert(0, ''); sys.argv = ['hbm', 'modes', 'rig.toml']; from hbm.cli import main; main()"
    )
    assert "one mode" in python(installed, folder, "-c", script)
    (folder / "run.py").write_text(WORKER)
    assert python(installed, folder, "run.py") == "one mode\n"


def test_the_users_own_module_stays_the_users(installed: Path, folder: Path) -> None:
    (folder / "models.py").write_text("mine = 1\n")
    code = "import hbm.models, models; from models import mine; print(mine, hbm.models.Rig.__name__)"
    assert python(installed, folder, "-c", code) == "1 Rig\n"


def test_both_names_are_the_same_modules(installed: Path, tmp_path: Path) -> None:
    code = (
        "import hbm, models.rig, continuation, hbm.models.rig as rig; from models.friction.law import parameter; "
        "print(models.rig is rig, continuation is hbm.continuation, rig.__spec__.name, models.__name__)"
    )
    assert python(installed, tmp_path, "-c", code) == "True True hbm.models.rig hbm.models\n"


def test_both_names_are_the_same_modules_in_the_sources() -> None:
    import hbm.continuation
    import hbm.models.rig

    import continuation
    import models.rig

    assert hbm.models.rig is models.rig
    assert hbm.continuation is continuation
    assert models.rig.__spec__ is not None
    assert models.rig.__spec__.name == "models.rig"


def test_a_name_that_is_nowhere_is_not_found() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"hbm\.models\.nowhere"):
        __import__("hbm.models.nowhere")


def test_examples_of_docstrings_import_what_an_installation_has(installed: Path, folder: Path) -> None:
    """Beside a user's own ``models.py``, which ``import models`` means there."""
    lines = [
        line
        for file in (installed / "hbm").rglob("*.py")
        for line in re.findall(r">>> ((?:from|import) .*)", file.read_text(encoding="utf-8"))
    ]
    assert "from hbm.models import Jenkins" in lines
    python(installed, folder, "-c", "\n".join(sorted(set(lines))))


def test_examples_are_listed_and_copied_without_the_sources(installed: Path, tmp_path: Path) -> None:
    said = python(installed, tmp_path, "-c", EXAMPLES)
    assert "bifurcations.py" in said
    assert "wrote bouc_wen.py" in said
    assert "stuck" in said
    assert (tmp_path / "diagnosed_beam" / "spectra.csv").is_file()


def test_an_example_never_overwrites(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from typer.testing import CliRunner

    from hbm.cli import app

    monkeypatch.chdir(tmp_path)
    run = CliRunner()
    assert run.invoke(app, ["examples", "one_mode.toml"]).stdout == "wrote one_mode.toml\n"
    assert (
        run.invoke(app, ["examples", "jointed_beam"]).stdout == "wrote jointed_beam.toml\n"
    )  # its ending may be left off
    again = run.invoke(app, ["examples", "one_mode.toml"])
    assert (again.exit_code, again.stderr) == (2, "examples: one_mode.toml is there already; must be new, try --out\n")
    assert run.invoke(app, ["examples", "none.toml"]).stderr.startswith('examples: "none.toml"; must be one of ')


def test_an_example_brings_the_file_of_its_law(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from typer.testing import CliRunner

    from hbm.cli import app

    monkeypatch.chdir(tmp_path)
    run, rig = CliRunner(), "paper_beam_bouc_wen.toml"
    assert run.invoke(app, ["examples", rig]).stdout == f"wrote {rig}\nwrote bouc_wen.py\n"
    again = run.invoke(app, ["examples", rig, "--out", "again.toml"])
    assert again.stdout == "wrote again.toml\n"  # the law is there
    (tmp_path / "bouc_wen.py").write_text("mine", encoding="utf-8")
    refused = run.invoke(app, ["examples", rig, "--out", "third.toml"])
    assert refused.stderr == "examples: bouc_wen.py is there already; must be new, try --out\n"
    assert not (tmp_path / "third.toml").exists()
