"""The notebooks run, say nothing that their cells do not assert, and are the same as script and as notebook."""

import json
import os
import re
import sys
import warnings
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
SCRIPTS = sorted((ROOT / "notebooks").glob("[0-9]*.py"))
BY_NAME = pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)


def read(path: Path) -> Any:
    """Script or notebook as a notebook."""
    import jupytext  # 3 s, which a worker that runs none of these need not wait for

    return jupytext.read(path)


def executed(script: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Run a script as a notebook, in a process of its own on the interpreter of this test.

    Whatever kernels are installed do not matter, nor what Jupyter warns about.
    """
    import nbclient

    kernel = folder / "kernels" / "of-this-test" / "kernel.json"
    kernel.parent.mkdir(parents=True)
    argv = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    kernel.write_text(json.dumps({"argv": argv, "display_name": "of this test", "language": "python"}))
    monkeypatch.setenv("JUPYTER_PATH", str(folder))
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])),
        "MPLBACKEND": "module://matplotlib_inline.backend_inline",  # figures belong in the notebook
        "OPENBLAS_NUM_THREADS": "1",  # more threads only wait for each other on matrices this small
    }
    environment.pop("PYTHONWARNINGS", None)
    where = {"metadata": {"path": str(script.parent)}}
    with warnings.catch_warnings(action="ignore"):
        run = nbclient.NotebookClient(read(script), kernel_name="of-this-test", timeout=900, resources=where)
        return run.execute(env=environment)


def printed(notebook: Any) -> list[str]:
    """Words that the cells print: numbers, how many are in a list, and the widths of columns are those of a machine."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    text = "".join(o.get("text") or o.get("data", {}).get("text/plain", "") for o in outputs)
    return re.findall(r"[^\W\d_]{2,}", re.sub(r"\d[\d.]*(e[-+]?\d+)?", "", text))


def complaints(notebook: Any) -> list[Any]:
    """Errors, and what went to stderr."""
    outputs = (output for cell in notebook.cells for output in cell.get("outputs", []))
    return [o for o in outputs if o.output_type == "error" or o.get("name") == "stderr"]


def figures(notebook: Any) -> int:
    outputs = (output for cell in notebook.cells for output in cell.get("outputs", []))
    return sum("image/png" in output.get("data", {}) for output in outputs)


def test_there_are_notebooks():
    assert len(SCRIPTS) >= 2


@pytest.mark.slow
@BY_NAME
def test_every_cell_runs_and_every_number_holds(script, tmp_path, monkeypatch):
    found = executed(script, tmp_path, monkeypatch)
    stored = read(script.with_suffix(".ipynb"))
    assert figures(found) == figures(stored) > 0
    assert printed(found) == printed(stored), "store it anew as CONTRIBUTING.md says, and read the prose around it"
    assert not complaints(found)


@BY_NAME
def test_notebook_has_the_cells_of_its_script(script):
    cells = [
        [(cell.cell_type, cell.source) for cell in notebook.cells]
        for notebook in (read(script), read(script.with_suffix(".ipynb")))
    ]
    assert cells[0] == cells[1]


@BY_NAME
def test_notebook_was_run_from_top_to_bottom_and_is_small(script):
    path = script.with_suffix(".ipynb")
    code = [cell for cell in read(path).cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert not complaints(read(path))
    assert path.stat().st_size < 1_000_000
