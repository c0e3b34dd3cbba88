"""The finite element library, scikit-fem, missed in one line where it is not installed."""

from importlib import import_module
from typing import Any


def _library() -> Any:
    try:
        return import_module("skfem")
    except ImportError:
        raise ImportError("models.plane: needs scikit-fem; install it with: pip install 'casadi-hbm[fem]'") from None


skfem = _library()
