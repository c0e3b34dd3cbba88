"""The extended rig of a diagnosis as a rig file: the nominal file as it is, with an extension for each cause."""

from pathlib import Path

from hbm.diagnosis.verdict import Diagnosis
from hbm.errors import InputError
from hbm.files.diagnosisfiles import extensions_of
from hbm.rigfiles.write import write_extended_rig
from hbm.textfiles import StrPath, why


def write_extended(path: StrPath, nominal: StrPath, diagnosis: Diagnosis) -> Path:
    """Write the extended rig of a diagnosis, as ``hbm diagnose`` writes ``extended.toml``.

    Parameters
    ----------
    path : str or path
        Rig file to write; :func:`hbm.load_rig` reads it back.
    nominal : str or path
        Rig file that was diagnosed. Its text is kept, and extensions are added beneath it.
    diagnosis : Diagnosis

    Returns
    -------
    Path

    Raises
    ------
    InputError
        If the diagnosis names no cause, or a file cannot be read or written; nothing is written then.
    """
    if diagnosis.extended is None:
        raise InputError(
            f"write_extended: the verdict is {diagnosis.verdict}; must name a cause to have an extended rig"
        )
    try:
        return write_extended_rig(path, nominal, extensions_of(diagnosis, {}))
    except OSError as refused:
        raise InputError(f"write_extended: {refused.filename}: {why(refused)}; must be a rig file") from None
