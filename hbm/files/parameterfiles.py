"""A file of a response along one number of the rig, read: the one curve of it, with the number first."""

from dataclasses import dataclass

from hbm.errors import InputError
from hbm.files.curves import SavedCurve, read_curves
from hbm.fourier import Array
from hbm.textfiles import StrPath


@dataclass(frozen=True, eq=False)
class SavedParameterCurve:
    """A curve along a number, read from a file.

    Attributes
    ----------
    parameter, unit : str
        Key of the number and its unit, empty without the companion.
    values : (points,) array
        Values of the number followed.
    curve : SavedCurve
        Everything else; its level is that of the first point.
    """

    parameter: str
    unit: str
    values: Array
    curve: SavedCurve

    def __repr__(self) -> str:
        """As the curve."""
        return repr(self.curve)


def read_parameter_curve(path: StrPath) -> SavedParameterCurve:
    """Read a file of one curve along a number; :func:`hbm.read_curves` reads those of several as well.

    Parameters
    ----------
    path : str or path
        CSV file of :func:`hbm.write_curves` or ``hbm continue``.

    Raises
    ------
    InputError
        If the file is not one, or holds several.
    """
    curves = read_curves(path)
    if len(curves) != 1:
        raise InputError(f"{path}: {len(curves)} curves; must be one, read_curves reads several")
    (curve,) = curves
    return SavedParameterCurve(curve.parameter, curve.unit, curve.values, curve)
