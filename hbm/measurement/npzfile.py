"""NumPy archives as they are read everywhere: whole, without code, and closed where they are damaged too."""

from pathlib import Path
from typing import Any

import numpy as np

from hbm.errors import InputError
from hbm.textfiles import StrPath, damage


def load_npz(path: StrPath, accepted: str = "must be a NumPy archive (npz)") -> dict[str, Any]:
    """Arrays of a NumPy archive by name.

    Raises
    ------
    InputError
        If it cannot be read; `accepted` says what could be.
    """
    try:
        with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return dict(archive)
    except Exception as refused:  # NumPy lets through whatever zip, pickle and its own headers raise
        raise InputError(f"{path}: cannot be read ({damage(refused)}); {accepted}") from None
