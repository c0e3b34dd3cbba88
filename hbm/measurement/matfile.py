"""MAT files looked through before SciPy reads them: damaged sparse matrices end the process there, without a word.

Layout of version 5: "MAT-File Format", The MathWorks; tags of 8 bytes with a type and a size, or both in 4.
"""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hbm.labelled import extra
from hbm.textfiles import StrPath

HEADER = 128
ORDERS = {b"\x00\x01IM": "<", b"\x01\x00MI": ">"}
"""Byte orders by version 5 as the heading says it."""
MATRIX, COMPRESSED = 14, 15
NUMBERS = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13})
TEXTS = frozenset({16, 17, 18})
SPARSE = 5


def load_mat(path: StrPath) -> dict[str, Any]:
    """Variables of a MAT file, versions 4 to 7.

    Raises
    ------
    NotImplementedError
        If it is of version 7.3.
    Exception
        Whatever SciPy makes of a damaged file; ValueError where reading it would end the process.
    """
    from scipy.io import loadmat

    refuse_broken(path)
    variables: dict[str, Any] = loadmat(path, spmatrix=False)
    return variables


def load_variables(path: StrPath) -> dict[str, Any]:
    """Variables of a MAT file of any version: vectors without dimensions of one, structs as dictionaries.

    Raises
    ------
    InputError
        If it is of version 7.3 and pymatreader is not installed.
    Exception
        As :func:`load_mat`, and whatever h5py makes of a damaged file.
    """
    from scipy.io import loadmat

    refuse_broken(path)
    try:
        variables: dict[str, Any] = loadmat(path, spmatrix=False, simplify_cells=True)
    except NotImplementedError:  # HDF5
        variables = extra("pymatreader", str(path)).read_mat(path)
    return variables


def refuse_broken(path: StrPath) -> None:
    """Refuse a file that would end the process.

    Raises
    ------
    ValueError
    """
    if not is_whole(Path(path).read_bytes()):
        raise ValueError(f"{path} is damaged")


def is_whole(content: bytes) -> bool:
    """Whether all parts of a file of version 5 are within it, and sparse matrices have rows, columns and numbers."""
    order = ORDERS.get(content[HEADER - 4 : HEADER])
    try:
        return order is None or all(_holds(kind, data, order) for kind, data in _parts(content[HEADER:], order))
    except (struct.error, zlib.error, ValueError):
        return False


def _holds(kind: int, data: bytes, order: str) -> bool:
    if kind == COMPRESSED:
        return all(_holds(*part, order) for part in _parts(zlib.decompress(data), order))
    if kind != MATRIX:
        return kind in NUMBERS | TEXTS
    if not data:
        return True
    (_, flags), *rest = _parts(data, order)
    sparse = struct.unpack(f"{order}I", flags[:4])[0] & 0xFF == SPARSE
    if sparse:
        (_, shape), _, (_, rows), (_, starts), (_, numbers), *_ = rest
        columns = struct.unpack(f"{order}2i", shape)[1]
        if len(starts) != 4 * (columns + 1) or any(kind not in NUMBERS for kind, _ in rest):
            return False
        used = int(struct.unpack(f"{order}i", starts[-4:])[0])
        return 0 <= 4 * used <= len(rows) and used <= len(numbers)
    return all(_holds(*part, order) for part in rest)


def _parts(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Type and content of each part."""
    at = 0
    while at < len(data):
        (tag,) = struct.unpack_from(f"{order}I", data, at)
        if tag >> 16:
            kind, begin, size = tag & 0xFFFF, at + 4, tag >> 16
            at += 8
        else:
            kind, begin, size = tag, at + 8, struct.unpack_from(f"{order}I", data, at + 4)[0]
            at = begin + size + (-size % 8 if kind != COMPRESSED else 0)
        if begin + size > len(data):
            raise ValueError
        yield kind, data[begin : begin + size]
