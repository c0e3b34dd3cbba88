"""Rig files that are too large are refused before they cost minutes and gigabytes."""

from pathlib import Path

import pytest

from hbm import load_rig
from hbm.errors import InputError

MEASURED = Path(__file__).parents[2] / "examples" / "measured_beam" / "rig.toml"


def test_more_channels_than_a_rig_can_have(tmp_path: Path) -> None:
    channel = '\n[[channels]]\nname = "x{}"\nquantity = "acceleration"\nposition = 0.1\n'
    path = tmp_path / "rig.toml"
    path.write_text(MEASURED.read_text() + "".join(channel.format(i) for i in range(1000)))
    with pytest.raises(InputError, match=r"rig\.toml: channels is an array; must have at most 1000 entries$"):
        load_rig(path)


def test_a_file_that_is_no_rig_file_by_its_size(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(MEASURED.read_text() + "# " + "x" * 4_000_000)
    with pytest.raises(InputError, match=r"rig\.toml: 4 MB; must be <= 4 MB, a rig file \(TOML\); matrices stand in"):
        load_rig(path)
