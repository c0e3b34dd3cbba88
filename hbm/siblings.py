"""``models`` and ``continuation`` under both of their names, wherever they are.

In the sources they stand beside ``hbm``, as ``models`` and ``continuation``. In a wheel they are ``hbm.models`` and
``hbm.continuation``, so that no ``models.py`` of a user hides them. Each name works in both places and means the same
modules. In a wheel ``import models`` finds what else is called so first: it is the user's own where there is one.
"""

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

NAMES = ("continuation", "models")
INSIDE = (Path(__file__).parent / NAMES[0]).is_dir()
OTHER_NAMES = {name: f"hbm.{name}" for name in NAMES} if INSIDE else {f"hbm.{name}": name for name in NAMES}
"""Other name to the one that the modules have here."""


class _Aliases(MetaPathFinder, Loader):
    """Finds modules by their other name; what is loaded is the module itself, once."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        for other, name in OTHER_NAMES.items():
            if fullname == other and PathFinder.find_spec(fullname, path) is None:
                return ModuleSpec(fullname, self, loader_state=import_module(name).__spec__)
            ours = sys.modules.get(other) is not None and sys.modules[other] is sys.modules.get(name)
            if ours and fullname.startswith(f"{other}."):
                found = find_spec(name + fullname.removeprefix(other))
                return None if found is None else ModuleSpec(fullname, self, loader_state=found)
        return None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return import_module(spec.loader_state.name)

    def exec_module(self, module: ModuleType) -> None:
        """Give the module back the spec of its own name, which it has lost on being imported by the other."""
        state = module.__spec__.loader_state if module.__spec__ else None
        if isinstance(state, ModuleSpec):
            module.__spec__ = state


def install() -> None:
    """Look for modules by their other names too."""
    if not any(isinstance(finder, _Aliases) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Aliases())
