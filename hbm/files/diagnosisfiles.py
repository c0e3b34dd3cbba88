"""Everything about a diagnosis in one folder: the verdict, the extended rig, figures with their numbers, one HTML page.

docs/reference/data_files.md lists the files. :func:`diagnosis_contents` makes them; :data:`FILES` names all that there
can be, but for the candidates of a verdict `unexplained`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hbm.figures.compared import MODELS
from hbm.figures.page import page_html
from hbm.files.diagnosed import Diagnosed
from hbm.files.diagnosiscolumns import error_columns, force_columns, ranking_columns, traced_columns
from hbm.files.diagnosispage import ERROR_FILE, PARTS, RANKING_FILE, diagnosis_page
from hbm.files.diagnosisplates import CURVE_FILE, PLATES, diagnosis_plates
from hbm.files.extendedrig import EXTENDED_FILE, rigs_of
from hbm.files.figurefiles import plate_contents, plate_files
from hbm.files.outputs import columns_text, json_text

DIAGNOSIS_FILE, PAGE_FILE, FORCE_FILE = "diagnosis.json", "report.html", "missing_force.csv"
FILES = (
    DIAGNOSIS_FILE,
    EXTENDED_FILE,
    PAGE_FILE,
    ERROR_FILE,
    RANKING_FILE,
    FORCE_FILE,
    CURVE_FILE,
    *(name for plate in PLATES for name in plate_files(plate)),
)
"""All files that can be in the folder, but for candidates."""


def diagnosis_contents(
    found: Diagnosed, nominal: Path, named: Mapping[type, str] | None = None
) -> dict[str, str | bytes]:
    """Contents of the files of a diagnosis, by their names in the folder.

    Parameters
    ----------
    found : Diagnosed
    nominal : Path
        Rig file, which the extended one repeats.
    named : mapping of type to str, optional
        Names of causes of one's own, ``file.py:Class``; the files are copied beside the extended rig.
    """
    plates = diagnosis_plates(found)
    contents: dict[str, str | bytes] = {
        DIAGNOSIS_FILE: json_text(diagnosis_table(found)),
        ERROR_FILE: columns_text(error_columns(found.diagnosis)),
        RANKING_FILE: columns_text(ranking_columns(found.diagnosis)),
    }
    contents |= rigs_of(found.diagnosis, nominal, named or {})
    if found.force is not None and found.force.explainable:
        contents[FORCE_FILE] = columns_text(found.labelled(force_columns(found.force)))
    if found.traced:
        contents[CURVE_FILE] = columns_text(traced_columns(found.traced))
    return contents | {PAGE_FILE: page_html(diagnosis_page(found, plates))} | plate_contents(plates)


def diagnosis_table(found: Diagnosed) -> dict[str, Any]:
    """The diagnosis file: every key is there, None where a number is not known."""
    table = found.diagnosis.json()
    errors = {model: {part: {} for part in PARTS} | table["errors"].get(model, {}) for model in MODELS}
    if "extended" not in table["errors"]:
        errors["extended"] = {}
    return table | {"errors": errors, "evidence": list(found.evidence)}
