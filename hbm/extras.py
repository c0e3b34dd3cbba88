"""Packages of the extra ``io``: imported where they are used, missed in one line."""

from importlib import import_module
from typing import Any

from hbm.errors import InputError


def extra(package: str, where: str) -> Any:
    """Import a package that the core does without.

    Parameters
    ----------
    package : str
        Name of the module.
    where : str
        File that needs it, for the message.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        return import_module(package)
    except ImportError:
        raise InputError(f"{where}: needs {package}; install it with: pip install 'casadi-hbm[io]'") from None
