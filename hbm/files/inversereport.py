"""Everything about a reconstruction in one folder: tables, figures, the numbers of each figure, one HTML page.

:func:`inverse_contents` makes the files; :data:`FILES` names all there can be.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hbm.figures import inverse as figures
from hbm.figures import trust
from hbm.figures.page import Page, Section, Table, page_html
from hbm.figures.style import AxesArray, closed
from hbm.files import inversefiles, rigerrors
from hbm.files.figurefiles import Plate, plate_contents, plate_files
from hbm.files.inversefiles import energy_columns, reconstruction_contents, record_columns
from hbm.files.outputs import Columns
from hbm.files.version import installed_version
from hbm.identification.contacterrors import ContactErrors
from hbm.inverse.reconstruction import Reconstruction

Records = Sequence[int] | None


@dataclass(frozen=True)
class Drawing:
    """A plate of the page in the making.

    Attributes
    ----------
    name, heading, caption : str
    draw : function of a reconstruction and records
    columns : function of a reconstruction and records
        Columns that are drawn, in SI units.
    """

    name: str
    heading: str
    caption: str
    draw: Callable[[Reconstruction, Records], AxesArray]
    columns: Callable[[Reconstruction, Records], Columns]

    def plate(self, reconstruction: Reconstruction, records: Records) -> Plate:
        """The figure with its numbers."""
        axes, columns = self.draw(reconstruction, records), self.columns(reconstruction, records)
        return Plate(self.name, self.heading, self.caption, axes, columns)


# ------------------------------------------------------------------------------------------- the numbers of the figures


def loop_columns(reconstruction: Reconstruction, records: Records = None) -> Columns:
    """Closed loops of the records drawn: phase, slip and friction with standard deviations."""
    chosen = figures.representative(reconstruction) if records is None else records
    return _over_phase(reconstruction, chosen, ("slip", "friction"))


def signal_columns(reconstruction: Reconstruction, records: Records = None) -> Columns:
    """Signals of the records drawn over a whole period, with standard deviations."""
    chosen = figures.representative(reconstruction, 1) if records is None else records
    return _over_phase(reconstruction, chosen, [name for name, _ in figures.SIGNAL_ROWS])


def _over_phase(reconstruction: Reconstruction, chosen: Sequence[int], names: Sequence[str]) -> Columns:
    places = [reconstruction.index(record) for record in chosen]
    phase = np.append(reconstruction.phase, 1.0)
    columns = record_columns(reconstruction, np.repeat(places, len(phase)))
    columns |= {"slips": np.repeat(reconstruction.slips[places], len(phase)), "phase": np.tile(phase, len(places))}
    for name in names:
        signal = reconstruction[name]
        columns[name] = np.concatenate([closed(signal.samples[i]) for i in places])
        columns[f"{name}_std"] = np.concatenate([closed(signal.std[i]) for i in places])
        if signal.rig_std is not None:
            columns[f"{name}_rig_std"] = np.concatenate([closed(signal.rig_std[i]) for i in places])
    return columns


def harmonic_columns(reconstruction: Reconstruction, records: Records = None) -> Columns:
    """Amplitudes of friction harmonics of the records drawn, their standard deviations and the noise floor."""
    chosen = figures.representative(reconstruction, 1) if records is None else records
    k = np.arange(1, reconstruction.H + 1)
    places = [reconstruction.index(record) for record in chosen]
    i, harmonic = np.repeat(places, len(k)), np.tile(k, len(places))
    return {
        **record_columns(reconstruction, i),
        "harmonic": harmonic,
        "amplitude": reconstruction["friction"].amplitude[i, harmonic],
        "std": reconstruction["friction"].coefficient_std[i, harmonic],
        "noise_floor": trust.noise_floor(reconstruction)[i, harmonic],
    }


def misfit_columns(reconstruction: Reconstruction, _: Records = None) -> Columns:
    """Misfit of each record, what noise alone seldom passes, and that of each channel, in the order drawn."""
    order = trust.misfit_order(reconstruction)
    shares = trust.channel_misfit(reconstruction)[order]
    return {
        "place": np.arange(1, len(order) + 1),
        **record_columns(reconstruction, order),
        "chi2_reduced": reconstruction.misfit.reduced[order],
        "limit": trust.misfit_limit(reconstruction)[order],
        **{f"channel_{name}": shares[:, j] for j, name in enumerate(reconstruction.misfit.channels)},
    }


def resolution_columns(reconstruction: Reconstruction, _: Records = None) -> Columns:
    """Least, median and largest friction, resolution and condition of each harmonic."""
    columns: dict[str, npt.NDArray[Any]] = {"harmonic": np.arange(1, reconstruction.H + 1)}
    shown = {
        "friction": reconstruction["friction"].amplitude,
        "resolution": reconstruction.resolution,
        "condition": reconstruction.condition,
    }
    for name, values in shown.items():
        parts = zip(("least", "median", "largest"), trust.quantiles(values[:, 1:]), strict=True)
        columns |= {f"{name}_{part}": numbers for part, numbers in parts}
    return columns


DRAWINGS = (
    Drawing(
        "loops",
        "Friction loops",
        "Friction force over slip, one period, a row of panels per force level. Bands: 95 %, dark by noise and the "
        "harmonics above those measured, light by what the rig file may be off by too. Where the contact sticks the "
        "mean of both is unknown and counts as zero.",
        figures.plot_reconstructed_loops,
        loop_columns,
    ),
    Drawing(
        "signals",
        "Signals over the period",
        "Friction, reaction, slip and slip velocity with 95 % bands as of the loops; of each level the record that "
        "slips most, unless records were named. P is the static normal load.",
        figures.plot_signals,
        signal_columns,
    ),
    Drawing(
        "harmonics",
        "Harmonics of the friction force",
        "Filled: above what the noise of the sensors alone makes in 5 % of the cases (grey). Hollow: lost in it, there "
        "a prior says what is likely. Bars: 95 %.",
        trust.plot_friction_harmonics,
        harmonic_columns,
    ),
    Drawing(
        "energy",
        "Energy and wear",
        "Energy that friction takes per cycle, and the wear work rate, the mean of R |v|, with 95 % bars. Hollow: the "
        "contact sticks; the work rate there is of its elastic slip.",
        lambda r, _: trust.plot_energy(r),
        lambda r, _: energy_columns(r),
    ),
    Drawing(
        "misfit",
        "Do the sensors agree with the structure?",
        "Misfit per degree of freedom, 1 where only noise is left. Above the limit noise is no explanation: a sensor, "
        "or the structure of the rig file, is wrong; the darkest rows and the frequencies say where to look.",
        lambda r, _: trust.plot_misfit(r),
        misfit_columns,
    ),
    Drawing(
        "resolution",
        "What the sensors can tell",
        "Left: standard deviation of a friction harmonic by the sensors alone, beside the friction that was found. "
        "Right: condition number of telling friction from the excitation. Lines: median of the records; bands: range.",
        lambda r, _: trust.plot_resolution(r),
        resolution_columns,
    ),
)

LEVEL_HEADINGS = (
    *("level [N]", "records", "slipping", "friction peak [N]", "slip ± [µm]", "energy lost [mJ]"),
    *("misfit", "worst misfit"),
)
OVERSHOOT = (
    "peaks are those of the harmonics measured: their series overshoots a limit at which friction slides, by about "
    "18 % where it jumps"
)
"""The series of a square wave peaks at 2 Si(pi) / pi = 1.179 times it, J. W. Gibbs, Nature 59 (1899) 606."""

LEVEL_NOTE = (
    "friction, slip, energy: the largest of the level; ± is one standard deviation, by noise and harmonics above; "
    f"misfit: median, 1 is noise alone; {OVERSHOOT}"
)

PAGE_FILE = "report.html"
FILES = (*inversefiles.FILES, *rigerrors.FILES, PAGE_FILE, *(name for d in DRAWINGS for name in plate_files(d.name)))
"""All files that can be in the folder."""


# -------------------------------------------------------------------------------------------------------------- folder


def inverse_contents(
    reconstruction: Reconstruction,
    records: Records = None,
    errors: ContactErrors | None = None,
    nominal: Path | None = None,
) -> dict[str, str | bytes]:
    """Contents of the files of a reconstruction, by their names in the folder.

    Parameters
    ----------
    reconstruction : Reconstruction
    records : sequence of int, optional
        Records to draw; `representative` ones where omitted.
    errors : ContactErrors, optional
        What the rig file is uncertain by, in this reconstruction.
    nominal : Path, optional
        The rig file, as of :func:`hbm.files.rigerrors.rig_error_contents`.
    """
    r = reconstruction if errors is None else reconstruction.with_rig_std(errors.std)
    plates = [drawing.plate(r, records) for drawing in DRAWINGS]
    contents = reconstruction_contents(r) | ({} if errors is None else rigerrors.rig_error_contents(errors, nominal))
    return contents | {PAGE_FILE: page_html(inverse_page(r, plates, errors))} | plate_contents(plates)


def inverse_page(reconstruction: Reconstruction, plates: Sequence[Plate], errors: ContactErrors | None = None) -> Page:
    """The page about a reconstruction, with its figures."""
    r = reconstruction
    levels = Section("Levels", table=Table(*level_table(r), LEVEL_NOTE), csv=("energy.csv",))
    return Page(
        title=f"{r.rig.name}: what happens at the contact",
        lead=(
            f"Friction force, reaction and slip, reconstructed from {len(r.misfit.channels)} sensors "
            f"({', '.join(r.misfit.channels)}) by inverse harmonic balance. Every number has its standard deviation.",
        ),
        warnings=r.warnings,
        summary=_key_numbers(r),
        sections=[
            levels,
            *([] if errors is None else [rigerrors.rig_error_section(errors)]),
            *(plate.section for plate in plates),
            _files_section(),
        ],
        foot=f"hbm {installed_version()}, hbm inverse; spectra: {r.spectra.source}",
    )


def level_table(reconstruction: Reconstruction) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table by levels, as printed and as on the page."""
    r = reconstruction
    energy = r.energy_per_cycle
    peak = np.abs(r["friction"].samples).argmax(axis=1)
    friction, friction_std = (part[np.arange(len(r)), peak] for part in (r["friction"].samples, r["friction"].std))
    slip = np.ptp(r["slip"].samples, axis=1) / 2
    rows = []
    for level in np.unique(r.spectra.level):
        own = np.flatnonzero(r.spectra.level == level)
        i, j = own[np.abs(friction[own]).argmax()], own[energy.value[own].argmax()]
        misfit = r.misfit.reduced[own]
        row = [f"{level:g}", str(len(own)), str(int(r.slips[own].sum())), with_std(abs(friction[i]), friction_std[i])]
        row += [f"{1e6 * slip[own].max():.3g}", with_std(1e3 * energy.value[j], 1e3 * energy.std[j])]
        rows.append(
            [*row, *(f"{part:.2f}" if np.isfinite(part) else "-" for part in (np.median(misfit), misfit.max()))]
        )
    return list(LEVEL_HEADINGS), rows


LARGE = 1e7
"""From such a standard deviation on numbers are powers of ten: in full they are wider than any table."""


def with_std(value: float, std: float) -> str:
    """A number and its standard deviation, to two digits of the latter.

    >>> with_std(47.2634, 0.1283)
    '47.26 ± 0.13'
    >>> with_std(9.68281604e10, 4788824590.0)
    '9.683e+10 ± 4.8e+09'
    """
    if std >= LARGE:
        return f"{value:.4g} ± {std:.2g}"
    if not (np.isfinite(std) and std > 0.0):
        return f"{value:.4g}"
    digits = max(0, 1 - int(np.floor(np.log10(std))))
    return f"{round(value, digits) + 0.0:.{digits}f} ± {std:.{digits}f}"


def _key_numbers(r: Reconstruction) -> list[tuple[str, str]]:
    spectra = r.spectra
    most = int(np.argmax(r.energy_per_cycle.value))
    consistent = int(r.misfit.consistent.sum())
    return [
        ("Records", f"{len(r)}, {spectra.hz.min():g} to {spectra.hz.max():g} Hz, harmonics to {r.H}"),
        ("Slipping", f"{int(r.slips.sum())} of {len(r)}"),
        (
            "Most energy per cycle",
            f"{with_std(1e3 * r.energy_per_cycle.value[most], 1e3 * r.energy_per_cycle.std[most])} mJ, "
            f"{spectra.level[most]:g} N at {spectra.hz[most]:g} Hz",
        ),
        ("Sensors explained by noise", f"{consistent} of {len(r)} records"),
        ("Structure", f"{r.rig.structure.n} modes; formulation: {r.formulation}"),
    ]


def _files_section() -> Section:
    return Section(
        "How to read the files",
        text=(
            "SI units throughout. Every _std is one standard deviation by noise, every _rig_std one by the rig file; "
            "bands and bars in figures are 1.96 of them.",
            "reconstruction.csv: the signals over the period. energy.csv: a row per record. harmonics.csv: cosine, "
            "sine and amplitude of each harmonic, the resolution of the sensors and the condition number. "
            "reconstruction.mat, and reconstruction.nc where h5netcdf is installed: all of it as arrays, with units.",
            "Where a record's sensors contradict the structure beyond noise, its standard deviations are widened "
            "by the square root of its misfit.",
        ),
        csv=inversefiles.FILES[:3],
    )
