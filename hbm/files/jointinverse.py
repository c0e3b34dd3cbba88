"""Everything about reconstructed joint forces in one folder: tables, arrays, figures, one HTML page.

The files are those of a rig with one contact (:mod:`hbm.files.inversefiles`), with a set of columns for each port:
``tip.force``, ``tip.force_std``, ``tip.motion``, ``tip.motion_std``.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hbm.figures.jointinverse import plot_joint_loops, plot_joint_signals, representative
from hbm.figures.page import Page, Section, Table, page_html
from hbm.figures.style import closed
from hbm.files.figurefiles import Plate, plate_contents, plate_files
from hbm.files.inversefiles import FILES as TABLES
from hbm.files.inversefiles import (
    NETCDF_FILE,
    PARTS,
    SIGNAL_FILE,
    array_bytes,
    estimate_columns,
    has_netcdf,
    record_columns,
)
from hbm.files.inversereport import OVERSHOOT, PAGE_FILE, with_std
from hbm.files.outputs import Columns, columns_text
from hbm.files.rigerrors import FILES as RIG_FILES
from hbm.files.rigerrors import Contents, rig_error_contents, rig_error_section
from hbm.files.version import installed_version
from hbm.identification.contacterrors import ContactErrors
from hbm.inverse.jointreconstruction import JointReconstruction
from hbm.inverse.reconstruction import CONSISTENT

PLATES = ("joint_loops", "joint_signals")
FILES = (*TABLES, *RIG_FILES, PAGE_FILE, *(name for plate in PLATES for name in plate_files(plate)))
"""All files that can be in the folder."""

JOINT_HEADINGS = ("joint", "port", "force peak", "motion peak", "energy lost, most in a record")
JOINT_NOTE = (
    "peaks over all records, without the means; ± is one standard deviation there, by noise and harmonics above; "
    f"{OVERSHOOT}"
)


def joint_inverse_contents(
    found: JointReconstruction,
    records: Sequence[int] | None = None,
    errors: ContactErrors | None = None,
    nominal: Path | None = None,
) -> Contents:
    """Contents of the files of reconstructed joint forces, by their names in the folder.

    Parameters
    ----------
    found : JointReconstruction
    records : sequence of int, optional
        Records to draw; of each level the one that moves most where omitted.
    errors : ContactErrors, optional
        What the rig file is uncertain by, in these.
    nominal : Path, optional
        The rig file, as of :func:`hbm.files.rigerrors.rig_error_contents`.
    """
    found = found if errors is None else found.with_rig_std(errors.std)
    chosen = representative(found) if records is None else list(records)
    plates = _plates(found, chosen)
    arrays = found.arrays()
    contents: Contents = {
        SIGNAL_FILE: columns_text(_over_phase(found, found.spectra.records.tolist())),
        "energy.csv": columns_text(energy_columns(found)),
        "harmonics.csv": columns_text(harmonic_columns(found)),
        "reconstruction.mat": array_bytes(".mat", *arrays),
    }
    if has_netcdf():
        contents[NETCDF_FILE] = array_bytes(".nc", *arrays)
    contents |= {} if errors is None else rig_error_contents(errors, nominal)
    return contents | {PAGE_FILE: page_html(_page(found, plates, errors))} | plate_contents(plates)


def _places(found: JointReconstruction, records: Sequence[int]) -> list[int]:
    return [found.index(record) for record in records]


def _over_phase(found: JointReconstruction, records: Sequence[int], *, whole: bool = False) -> Columns:
    """Signals over the period, a row per record and phase; with the first phase again at the end where `whole`."""
    places = _places(found, records)
    phase = np.append(found.phase, 1.0) if whole else found.phase
    columns = record_columns(found, np.repeat(places, len(phase)))
    columns["phase"] = np.tile(phase, len(places))
    for name, signal in found.signals.items():
        parts = {"": signal.samples, "_std": signal.std} | ({"_rig_std": signal.rig_std} if whole else {})
        for part, values in parts.items():
            if values is not None:
                columns[f"{name}{part}"] = np.concatenate([closed(values[i]) if whole else values[i] for i in places])
    return columns


def energy_columns(found: JointReconstruction) -> Columns:
    """Columns of ``energy.csv``: a row per record."""
    columns = record_columns(found, np.arange(len(found)))
    for name, energy in found.energies.items():
        columns |= estimate_columns(name, energy)
    return columns | {"chi2_reduced": found.misfit.reduced}


def harmonic_columns(found: JointReconstruction) -> Columns:
    """Columns of ``harmonics.csv``: a row per record and harmonic; blank where the sensors tell nothing."""
    r, k = np.indices((len(found), found.spectra.H + 1)).reshape(2, -1)
    columns = {**record_columns(found, r), "harmonic": k}
    for name, signal in found.signals.items():
        c = signal.complex[r, k]
        parts = (c.real, np.where(k, -c.imag, c.real), np.abs(c), signal.coefficient_std[r, k])
        columns |= {f"{name}_{part}": values for part, values in zip(PARTS, parts, strict=True)}
    return columns


# --------------------------------------------------------------------------------------------------------------- page


def _plates(found: JointReconstruction, records: Sequence[int]) -> list[Plate]:
    columns = _over_phase(found, records, whole=True)
    return [
        Plate(
            PLATES[0],
            "Loops of the joints",
            "Force over motion at each port, without their means; one colour a record. Bands: 95 %, dark by noise and "
            "the harmonics above those measured, light by what the rig file may be off by too.",
            plot_joint_loops(found, records),
            columns,
        ),
        Plate(
            PLATES[1],
            "Signals over the period",
            "Force and motion at each port, without their means, with 95 % bands as of the loops.",
            plot_joint_signals(found, records),
            columns,
        ),
    ]


def joint_table(found: JointReconstruction) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table by ports, as printed and as on the page."""
    rig, rows = found.rig, []
    ports = zip(rig.forces, rig.motions, rig.units, strict=True)
    for joint in rig.joints:
        energy = found.energy[joint.name]
        most = int(energy.value.argmax())
        for i in range(joint.law.ports):
            force, motion, units = next(ports)
            peaks = (
                f"{_peak(found, name, scale)} {prefix}{unit}"
                for name, scale, prefix, unit in ((force, 1.0, "", units[1]), (motion, 1e6, "µ", units[0]))
            )
            lost = "" if i else f"{with_std(1e3 * energy.value[most], 1e3 * energy.std[most])} mJ"
            rows.append([joint.name, str(i + 1), *peaks, lost])
    return list(JOINT_HEADINGS), rows


def _peak(found: JointReconstruction, name: str, scale: float) -> str:
    signal = found[name]
    r, i = np.unravel_index(int(np.abs(signal.samples).argmax()), signal.samples.shape)
    return with_std(scale * abs(float(signal.samples[r, i])), scale * float(signal.std[r, i]))


def _page(found: JointReconstruction, plates: Sequence[Plate], errors: ContactErrors | None) -> Page:
    spectra, consistent = found.spectra, np.count_nonzero(found.probability > CONSISTENT)
    sensors = ", ".join(found.misfit.channels[:-1])
    return Page(
        title=f"{found.rig.name}: what happens at the joints",
        lead=(
            f"Forces and motions at {found.rig.ports} ports, reconstructed by inverse harmonic balance from the force "
            f"and {len(found.misfit.channels) - 1} sensors ({sensors}); no law is assumed. Every number has its "
            "standard deviation.",
        ),
        warnings=found.warnings,
        summary=[
            ("Records", f"{len(found)}, {spectra.hz.min():g} to {spectra.hz.max():g} Hz, harmonics to {spectra.H}"),
            ("Sensors explained by noise", f"{consistent} of {len(found)} records"),
            ("Body", f"{found.rig.structure.n} modes"),
        ],
        sections=[
            Section("Joints", table=Table(*joint_table(found), JOINT_NOTE), csv=("energy.csv",)),
            *([] if errors is None else [rig_error_section(errors)]),
            *(plate.section for plate in plates),
            Section(
                "How to read the files",
                text=(
                    "SI units throughout. Every _std is one standard deviation by noise, every _rig_std one by the rig "
                    "file; bands in figures are 1.96 of them.",
                    "reconstruction.csv: the signals over the period. energy.csv: a row per record. harmonics.csv: "
                    "cosine, sine and amplitude of each harmonic. reconstruction.mat, and reconstruction.nc where "
                    "h5netcdf is installed: all of it as arrays, with units.",
                    "Means are not known: no accelerometer sees them. Positive forces act on the body along its port.",
                ),
                csv=TABLES[:3],
            ),
        ],
        foot=f"hbm {installed_version()}, hbm inverse; spectra: {spectra.source}",
    )
