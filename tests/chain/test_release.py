"""What is released says the same in every place: version, dependencies, Python."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
RECIPE = (ROOT / "conda" / "meta.yaml").read_text()


def test_the_version_is_the_same_everywhere() -> None:
    version = PROJECT["version"]
    assert f'version = "{version}"' in RECIPE
    assert f"version: {version}" in (ROOT / "CITATION.cff").read_text()
    assert f"## [{version}] - " in (ROOT / "CHANGELOG.md").read_text()


def test_the_conda_recipe_has_the_dependencies_of_the_wheel() -> None:
    run = RECIPE.partition("  run:\n")[2].partition("\ntest:")[0]
    listed = {line.strip(" -").replace(" ", "").replace("-base", "") for line in run.splitlines() if line.strip()}
    assert listed == {*PROJECT["dependencies"], f"python{PROJECT['requires-python']}"}


def test_the_workflow_tries_every_python_that_is_supported() -> None:
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    tried = re.search(r"python: \[(.+)\]", workflow)
    assert tried is not None
    assert tried[1].split(", ")[0].strip('"') == PROJECT["requires-python"].removeprefix(">=")
