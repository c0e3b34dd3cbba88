"""Parameters from coordinates and their covariance: values, standard deviations, and those not determined."""

import numpy as np

from hbm.fourier import Array
from hbm.identification.coordinates import Coordinates
from hbm.identification.lawfit import FittedParameter, FittedParameters
from hbm.identification.start import Scales

AT_BOUND = 1e-3
"""A coordinate is at its bound when it is this close."""


def fitted_parameters(coordinates: Coordinates, x: Array, covariance: Array, scales: Scales) -> FittedParameters:
    """Parameters of a law at fitted coordinates.

    Parameters
    ----------
    coordinates : Coordinates
    x : (n,) array
    covariance : (n, n) array
        Covariance of the coordinates.
    scales : Scales
        For slip speeds in reasons.
    """
    by_x = coordinates.slopes(x)
    of_parameters = by_x @ covariance @ by_x.T
    values, std = coordinates.values(x), np.sqrt(np.diag(of_parameters))
    reasons = _reasons(
        coordinates, x, np.sqrt(np.diag(covariance)), dict(zip(coordinates.parameters, std, strict=True))
    ) | _not_reached(coordinates, scales)
    speeds = f"; slip speeds in these records peak between {scales.slowest:.2g} and {scales.fastest:.2g} m/s"
    entries = tuple(
        FittedParameter(
            name,
            p.unit,
            float(v),
            float(s),
            name in coordinates.held,
            reasons[name] + (speeds if p.unit == "m/s" else "") if name in reasons else "",
        )
        for (name, p), v, s in zip(coordinates.parameters.items(), values, std, strict=True)
    )
    return FittedParameters(entries, of_parameters)


def _reasons(coordinates: Coordinates, x: Array, std_x: Array, std: dict[str, float]) -> dict[str, str]:
    """Reasons why parameters are not determined, by name."""
    values = dict(zip(coordinates.parameters, coordinates.values(x), strict=True))
    low, high = coordinates.bounds
    reasons = {}
    for i, name in enumerate(coordinates.free):
        p = coordinates.parameters[name]
        at_bound = min(x[i] - low[i], high[i] - x[i]) < AT_BOUND
        if p.at_least is not None and x[i] - low[i] < 2 * std_x[i]:
            reasons[name] = f"within 2 std of {p.at_least}, which it cannot fall below"
        elif not p.strict and x[i] - low[i] < 2 * std_x[i]:
            why = "no effect of it is seen" if p.lower == 0.0 else "which it cannot fall below"
            reasons[name] = f"within 2 std of {p.lower:g}, {why}"
        elif at_bound:
            reasons[name] = "at the end of the range it was looked for in"
        elif 2 * std[name] > abs(values[name]):
            reasons[name] = "its std exceeds its value" if std[name] > abs(values[name]) else "within 2 std of 0"
    return reasons


def _not_reached(coordinates: Coordinates, scales: Scales) -> dict[str, str]:
    """Reasons why limits of friction are not determined where no record slips: no linear deviation says so."""
    if not scales.sticks_at:
        return {}
    seen = scales.sticks_at * scales.load
    limit = f"no record slips, friction is seen up to {seen:.3g} N, {scales.sticks_at:.2g} times the reaction"
    limits = [name for name in coordinates.free if coordinates.parameters[name].unit == "1" and name.startswith("mu")]
    slip = f"no record slips, elastic slip is seen up to {seen / scales.stiffness:.2g} m"
    return dict.fromkeys(limits, limit) | dict.fromkeys({"critical_slip"} & coordinates.free.keys(), slip)
