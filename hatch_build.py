"""What the wheel holds: ``hbm`` alone, with ``models`` and ``continuation`` inside it, and the examples as data.

As top-level packages of an environment they would be hidden by whatever ``models.py`` the user's folder has, and would
overwrite the ``models`` of other distributions. Their imports, in the sources ``from models.rig import Rig``, become
``from hbm.models.rig import Rig``; nothing else is changed. :mod:`hbm.siblings` has the names for both places.
"""

import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

MOVED = ("continuation", "models")
EXAMPLES = (".toml", ".py", ".csv", ".md")
FROM = re.compile(rf"^(\s*from )({'|'.join(MOVED)})(?=[. ])", re.MULTILINE)
WHOLE = re.compile(rf"^\s*import ({'|'.join(MOVED)})\b.*$", re.MULTILINE)


class Moved(BuildHookInterface[Any]):
    """Files of the wheel with their imports rewritten."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Put the files into the wheel; an editable installation uses the sources as they are."""
        if version == "editable":
            return
        self.rewritten = Path(tempfile.mkdtemp())
        root = Path(self.root)
        places = {"hbm": "hbm", **{name: f"hbm/{name}" for name in MOVED}}
        for package, place in places.items():
            for file in sorted((root / package).rglob("*")):
                if file.is_file() and "__pycache__" not in file.parts:
                    self._add(file, f"{place}/{file.relative_to(root / package).as_posix()}", build_data)
        for file in sorted((root / "examples").rglob("*")):
            if file.suffix in EXAMPLES and "__pycache__" not in file.parts:
                self._add(file, f"hbm/{file.relative_to(root).as_posix()}", build_data)

    def _add(self, file: Path, target: str, build_data: dict[str, Any]) -> None:
        if file.suffix != ".py":
            build_data["force_include"][str(file)] = target
            return
        text = file.read_text(encoding="utf-8")
        whole = WHOLE.search(text)
        if whole:
            raise ValueError(f"{file}: {whole[0].strip()!r} cannot be moved; must be from ... import ...")
        made = self.rewritten / target
        made.parent.mkdir(parents=True, exist_ok=True)
        made.write_text(FROM.sub(r"\1hbm.\2", text), encoding="utf-8")
        build_data["force_include"][str(made)] = target

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what was written on the way."""
        if version != "editable":
            shutil.rmtree(self.rewritten)
