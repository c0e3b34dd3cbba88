"""Results as labelled arrays (xarray) and tables (pandas), for who goes on from there; packages of the extra ``io``."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

from hbm.errors import InputError

Array = npt.NDArray[np.float64]

Variables = Mapping[str, tuple[Sequence[str], Any, str]]
"""Dimensions, values and unit by name; no unit where it is empty."""

EACH = "each channel in its own unit, which the coordinate unit gives"


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


def dataset(where: str, variables: Variables, coordinates: Variables, **attributes: Any) -> Any:
    """Make an xarray.Dataset whose variables know their units; where each channel has its own, a comment says so.

    Raises
    ------
    InputError
        If xarray is not installed.
    """
    own = {"comment": EACH} if "unit" in coordinates else {}

    def named(entries: Variables) -> dict[str, Any]:
        return {
            name: (dims, values, {"units": unit} if unit else own if "channel" in dims and name in variables else {})
            for name, (dims, values, unit) in entries.items()
        }

    return extra("xarray", where).Dataset(named(variables), named(coordinates), attributes)


def common(units: Sequence[str]) -> str:
    """The unit that all channels have; empty where they differ.

    >>> common(["m", "m"]), common(["m", "N"])
    ('m', '')
    """
    return units[0] if len(set(units)) == 1 else ""


def frame(where: str, columns: Mapping[str, Any]) -> Any:
    """Make a pandas.DataFrame of columns of one length.

    Raises
    ------
    InputError
        If pandas is not installed.
    """
    return extra("pandas", where).DataFrame(dict(columns))


def coefficient_names(H: int) -> list[str]:
    """Names of Fourier coefficients in their order: a0, a1..aH, b1..bH."""
    return [f"a{k}" for k in range(H + 1)] + [f"b{k}" for k in range(1, H + 1)]


def coefficient_columns(coefficients: Array) -> dict[str, Array]:
    """Columns of coefficients (..., 2H+1), one by name, flat."""
    names = coefficient_names(coefficients.shape[-1] // 2)
    return {name: coefficients[..., i].ravel() for i, name in enumerate(names)}


def repeated(values: Any, times: int) -> Array:
    """Each entry so many times in a row."""
    return np.repeat(np.asarray(values), times)
