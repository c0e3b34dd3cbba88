"""A fitted friction law in plain numbers, as its report needs it, and the columns of its tables."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hbm.figures.identification import ParameterByLevel
from hbm.files.inversereport import with_std
from hbm.files.outputs import Columns, columns_of
from hbm.fourier import Array
from hbm.identification.known import Known
from hbm.identification.lawfit import LawFit
from hbm.identification.rigerrors import RigErrors
from hbm.identification.spectra import SpectraFit
from hbm.inverse.reconstruction import Reconstruction


@dataclass(frozen=True)
class Value:
    """An identified parameter with its standard deviation, nan where it is not known, and unit."""

    name: str
    value: float
    std: float
    unit: str


@dataclass(frozen=True, eq=False)
class IdentifiedLaw:
    """A fitted friction law as its report needs it.

    Attributes
    ----------
    law : str
    values : tuple of Value
    chi2_reduced : float
    bic : float
        That laws are compared by.
    held_out : float
        Relative error of friction on records the law was not fitted to; nan where none were held out.
    range_error : float
        Obj (24) of the paper: mean squared difference of the ranges of the friction force [N^2].
    slip, friction : (r, N) array
        Signals that it predicts for the reconstruction's records [m], [N]; nan where a record was held out.
    by_level : tuple of ParameterByLevel
    """

    law: str
    values: tuple[Value, ...]
    chi2_reduced: float
    bic: float
    held_out: float
    range_error: float
    slip: Array
    friction: Array
    by_level: tuple[ParameterByLevel, ...] = field(default=())


def identified_law(
    fit: LawFit, reconstruction: Reconstruction, bic: float, by_level: Mapping[float, LawFit] | None = None
) -> IdentifiedLaw:
    """A fitted law as its report needs it.

    Parameters
    ----------
    fit : LawFit
        Fitted to records of the reconstruction.
    reconstruction : Reconstruction
    bic : float
        That laws are compared by.
    by_level : mapping of float to LawFit, optional
        The same law fitted to each level alone.
    """
    from scipy.signal import resample  # it takes long, and a diagnosis that shows its values so needs none

    places = [reconstruction.index(int(record)) for record in fit.records]
    fitted = {}
    for name, samples in {"slip": fit.loops.fitted_slip, "friction": fit.loops.fitted_friction}.items():
        fitted[name] = np.full((len(reconstruction), len(reconstruction.phase)), np.nan)
        fitted[name][places] = resample(samples, len(reconstruction.phase), axis=1)
    return IdentifiedLaw(
        law=fit.name,
        values=tuple(Value(p.name, p.value, p.std, p.unit) for p in fit.parameters.entries),
        chi2_reduced=fit.quality.chi2_reduced,
        bic=bic,
        held_out=np.nan if fit.held_out is None else fit.held_out.relative_error,
        range_error=fit.objective,
        by_level=tuple(_by_level(fit, by_level or {})),
        **fitted,
    )


def law_warnings(fit: LawFit) -> list[str]:
    """Warnings about a fit, a line each."""
    quality, lines = fit.quality, []
    if not quality.fits:
        lines.append(
            f"does not fit, misfit {quality.chi2_reduced:.3g} per degree of freedom; standard deviations are "
            f"multiplied by {quality.inflation:.3g}"
        )
    lines += [f"{p.name} is not determined, {p.undetermined}" for p in fit.parameters.entries if p.undetermined]
    return [f"{fit.name}: {line}" for line in (*lines, *fit.notes)]


def _by_level(fit: LawFit, by_level: Mapping[float, LawFit]) -> Iterator[ParameterByLevel]:
    """Parameters that were fitted to each level."""
    for p in fit.parameters.entries if by_level else ():
        if not p.held:
            found = [alone[p.name] for alone in by_level.values()]
            value, std = np.array([[one.value, one.std] for one in found]).T
            yield ParameterByLevel(fit.name, p.name, p.unit, np.array(list(by_level)), value, std, p.value, p.std)


UNDETERMINED = 10.0
"""A parameter is not determined where its standard deviation is so many times as large as its value."""


def value_text(v: Value) -> str:
    """A value with its standard deviation and unit, a power of ten before both where it is large or small.

    >>> value_text(Value("critical_slip", 4.1506e-6, 2.1e-8, "m"))
    '(4.151 ± 0.021)e-6 m'
    >>> value_text(Value("mu", 0.52, 0.0013, "1"))
    '0.5200 ± 0.0013'
    >>> value_text(Value("critical_slip", 7e-11, 440.0, "m"))
    '7e-11 ± 4e+02 m, not determined'
    """
    unit = "" if v.unit in ("", "1") else f" {v.unit}"
    if np.isfinite(v.std) and v.std > UNDETERMINED * abs(v.value):
        return f"{v.value:.1g} ± {v.std:.1g}{unit}, not determined"
    power = int(np.floor(np.log10(abs(v.value)))) if v.value else 0
    if -3 <= power <= 3:
        return with_std(v.value, v.std) + unit
    scaled = with_std(v.value / 10.0**power, v.std / 10.0**power)
    return f"({scaled})e{power}{unit}" if "±" in scaled else f"{scaled}e{power}{unit}"


def ranked(laws: Sequence[IdentifiedLaw]) -> list[IdentifiedLaw]:
    """Laws in the order of their BIC, the best first."""
    return sorted(laws, key=lambda law: law.bic)


def law_columns(laws: Sequence[IdentifiedLaw]) -> Columns:
    """Columns of ``laws.csv``: a row per law, the best first; `obj_24` is the paper's objective [N^2]."""
    rows = [(law.law, law.chi2_reduced, law.bic, law.held_out, law.range_error) for law in ranked(laws)]
    return columns_of(("law", "chi2_reduced", "bic", "held_out_error", "obj_24"), rows)


def parameter_columns(laws: Sequence[IdentifiedLaw]) -> Columns:
    """Columns of ``parameters.csv``: value and std of every parameter, level blank where it is of all levels."""
    rows: list[tuple[str, str, str, float, float, float]] = []
    for law in ranked(laws):
        rows += [(law.law, v.name, v.unit, np.nan, v.value, v.std) for v in law.values]
        for p in law.by_level:
            each = zip(p.level.tolist(), p.value.tolist(), p.std.tolist(), strict=True)
            rows += [(law.law, p.name, p.unit, *numbers) for numbers in each]
    return columns_of(("law", "parameter", "unit", "level", "value", "std"), rows)


def output_error_columns(fit: SpectraFit) -> Columns:
    """Columns of ``output_error.csv``: parameters of the law fitted to the spectra themselves."""
    rows = [(fit.name, p.name, p.unit, p.value, p.std) for p in fit.parameters.entries]
    return columns_of(("law", "parameter", "unit", "value", "std"), rows)


def rig_error_columns(errors: RigErrors) -> Columns:
    """Columns of ``rig_errors.csv``: a row for each number of the rig file and each parameter of the best law.

    `tolerance` is relative, of a delay in seconds; `left` is the share of it that sensors leave, `expected` how many
    tolerances larger they ask for the number to be; `change` is that of the parameter with a number a tolerance larger.
    """
    names = list(zip(errors.names, errors.units, strict=True))
    rows = [
        (errors.law, *number, name, unit, float(change[i]))
        for number, change in zip(errors.known.rows, errors.changes.values(), strict=True)
        for i, (name, unit) in enumerate(names)
    ]
    return columns_of(("law", *Known.ROW, "parameter", "unit", "change"), rows)
