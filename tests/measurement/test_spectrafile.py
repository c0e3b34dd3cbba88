"""Spectra files: every digit back, and every departure from the contract in one line."""

import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hbm.errors import InputError
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from hbm.measurement.spectrafile import load_spectra, write_spectra
from hbm.rigfiles.load import load_rig
from models import Channel, Rig
from models.published import paper_rig

SHARED = Path(__file__).parents[3] / "shared" / "data" / "examples"
HEADING = "record,level,frequency_hz,channel,harmonic,cos,sin,std"
GOOD = "3,4.7,54.112,a1,1,-1.5,0.25,1e-3"


@pytest.fixture(scope="module")
def rig() -> Rig:
    channels = (
        Channel("force", "force", 0.555),
        Channel("a1", "acceleration", 0.1),
        Channel("a2", "acceleration", 0.4),
    )
    return replace(paper_rig(), channels=channels)


def drawn(rig: Rig, records: int = 3, H: int = 4) -> MeasuredSpectra:
    """Numbers that use every bit, with a harmonic and a channel of a record missing."""
    rng = np.random.default_rng(5)
    coefficients = {c.name: rng.standard_normal((records, 2 * H + 1)) / 3.0 for c in rig.channels}
    std = {c.name: rng.random((records, H + 1)) / 7.0 for c in rig.channels}
    coefficients["a1"][:, [2, H + 2]] = std["a1"][:, [2]] = np.nan
    coefficients["a2"][1], std["a2"][1] = np.nan, np.nan
    hz = 50.0 + rng.random(records)
    return spectra_of(rig, hz, 1.0 + rng.random(records), coefficients, std)


def assert_same(a: MeasuredSpectra, b: MeasuredSpectra) -> None:
    assert a.channels == b.channels
    for name in ("records", "level", "hz", "coefficients", "std"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def test_records_of_noise_alone_are_named(rig: Rig) -> None:
    spectra = drawn(rig, records=5)
    spectra = replace(spectra, std=np.full_like(spectra.std, 0.05))
    assert spectra.silent == () == spectra.warnings
    off, noise = [1, 4], 0.05 * np.random.default_rng(6).standard_normal(spectra.coefficients.shape)
    coefficients = spectra.coefficients.copy()
    coefficients[off] = noise[off]
    said = replace(spectra, coefficients=coefficients, names=tuple("abcde"))
    assert said.silent == (f"records b, e of {said.source}: every channel reads noise alone; was the shaker off?",)
    assert said.warnings == (f"Records b, e of {said.source}: every channel reads noise alone; was the shaker off.",)
    louder = coefficients.copy()
    louder[off, spectra.index("force"), 1] = 0.5
    assert replace(spectra, coefficients=louder).silent == ()  # the shaker was on: sensors are dead


# ----------------------------------------------------------------------------------------------------------- round trip


@pytest.mark.parametrize("ending", ["csv", "npz", "nc", "mat"])
def test_every_bit_comes_back(ending: str, rig: Rig, tmp_path: Path) -> None:
    spectra = drawn(rig)
    write_spectra(tmp_path / f"s.{ending}", spectra)
    assert_same(load_spectra(tmp_path / f"s.{ending}", rig), spectra)
    assert [p.name for p in tmp_path.iterdir()] == [f"s.{ending}"]


def test_the_file_is_the_contract(rig: Rig, tmp_path: Path) -> None:
    spectra = drawn(rig)
    write_spectra(tmp_path / "s.csv", spectra)
    lines = (tmp_path / "s.csv").read_text().splitlines()
    assert lines[0] == HEADING
    assert len(lines) == 1 + spectra.measured.sum()
    a, std = spectra.coefficients[0, 0], spectra.std[0, 0]
    state = f"1,{float(spectra.level[0])!r},{float(spectra.hz[0])!r},force"
    assert lines[1] == f"{state},0,{float(a[0])!r},0.0,{float(std[0])!r}"
    assert lines[3] == f"{state},2,{float(a[2])!r},{float(a[4 + 2])!r},{float(std[2])!r}"


@pytest.mark.parametrize(("delimiter", "point"), [(";", "."), (";", ","), ("\t", "."), ("\t", ",")])
def test_columns_may_be_separated_as_in_exports(delimiter: str, point: str, rig: Rig, tmp_path: Path) -> None:
    write_spectra(tmp_path / "ours.csv", drawn(rig))
    text = (tmp_path / "ours.csv").read_text() + "# record 1: it, so to speak, settled\n"
    (tmp_path / "ours.csv").write_text(text)
    heading, *rows = text.replace(",", delimiter).splitlines()
    theirs = [heading, *(row.replace(".", point) for row in rows[:-1]), text.splitlines()[-1]]
    (tmp_path / "theirs.csv").write_text("\n".join(theirs))
    ours, other = (load_spectra(tmp_path / f"{name}.csv", rig) for name in ("ours", "theirs"))
    assert np.array_equal(ours.coefficients, other.coefficients, equal_nan=True)
    assert np.array_equal(ours.std, other.std, equal_nan=True)
    assert other.notes == ours.notes == ((1, "it, so to speak, settled"),)


@pytest.mark.parametrize("without", [(), ("std",)])
def test_columns_may_be_in_any_order(without: tuple[str, ...], rig: Rig, tmp_path: Path) -> None:
    write_spectra(tmp_path / "ours.csv", drawn(rig))
    table = [line.split(",") for line in (tmp_path / "ours.csv").read_text().splitlines()]
    order = [i for i, name in enumerate(table[0]) if name not in without]
    for name, at in (("ours", order), ("theirs", order[::-1])):
        text = "\n".join(",".join(row[i] for i in at) for row in table) + "\n# record 1: noisy, it is said\n"
        (tmp_path / f"{name}.csv").write_text(text)
    ours, other = (load_spectra(tmp_path / f"{name}.csv", rig, repeatability=0.01) for name in ("ours", "theirs"))
    assert_same(ours, other)
    assert other.notes == ours.notes == ((1, "noisy, it is said"),)


@pytest.mark.parametrize("cell", ["-1.234,5", "-1,234.5", "1,234,567"])
def test_separators_of_thousands_are_refused(cell: str, rig: Rig, tmp_path: Path) -> None:
    (tmp_path / "s.csv").write_text(f"{HEADING}\n{GOOD}\n".replace(",", ";").replace("-1.5", cell))
    with pytest.raises(InputError, match=f'line 2: cos = "{cell}"; must be a number'):
        load_spectra(tmp_path / "s.csv", rig)


def test_order_of_rows_and_numbers_of_records_are_free(rig: Rig, tmp_path: Path) -> None:
    rows = ["7,2,51,a1,1,3,4,0.1", "2,4,50,force,1,1,2,0.5", "7,2,51,force,0,5,0,0.2", "", "2,4,50,a1,3,6,-7,0.3"]
    (tmp_path / "s.csv").write_text("\n".join([HEADING, *rows]), encoding="utf-8-sig")
    spectra = load_spectra(tmp_path / "s.csv", rig)
    assert (spectra.records.tolist(), spectra.level.tolist(), spectra.hz.tolist()) == ([2, 7], [4.0, 2.0], [50.0, 51.0])
    assert (spectra.channels, spectra.H) == (("force", "a1"), 3)
    assert spectra.measured.sum() == 4
    assert spectra.complex("a1")[[0, 1], [3, 1]].tolist() == [6 + 7j, 3 - 4j]
    assert spectra.coefficients[1, 0, 0] == 5.0


@pytest.mark.parametrize("ending", ["csv", "npz", "nc", "mat"])
def test_records_may_have_names_that_hold_many(ending: str, rig: Rig, tmp_path: Path) -> None:
    """In the order of the file; one of a sweep is named with its frequency, and its level where that is not enough."""
    rows = [
        *("up,2,51,a1,1,3,4,0.1", "up,2,50,a1,1,1,2,0.5", "rest,1,50,a1,1,5,6,0.2", "up,2,51,force,1,2,0,0.1"),
        *("up,3,51,a1,1,7,8,0.3", "# record rest: a1 is not steady"),
    ]
    (tmp_path / "s.csv").write_text("\n".join([HEADING, *rows]))
    first = load_spectra(tmp_path / "s.csv", rig)
    write_spectra(tmp_path / f"t.{ending}", first)
    spectra = load_spectra(tmp_path / f"t.{ending}", rig)
    assert_same(spectra, first)
    assert spectra.labels.tolist() == ["up@51Hz@2N", "up@50Hz", "rest", "up@51Hz@3N"]
    assert (spectra.records.tolist(), spectra.hz.tolist()) == ([1, 2, 3, 4], [51.0, 50.0, 50.0, 51.0])
    assert spectra.coefficients[:, 1, 1].tolist() == [3.0, 1.0, 5.0, 7.0]
    train, held = spectra.split(["up"])
    assert (train.labels.tolist(), held.labels.tolist()) == (["rest"], ["up@51Hz@2N", "up@50Hz", "up@51Hz@3N"])
    assert spectra.select(records=["up@50Hz"]).coefficients[0, 1, 1] == 1.0
    assert train.warnings == (f"Record rest of {tmp_path / f't.{ending}'}: a1 is not steady.",)
    with pytest.raises(InputError, match=r"no record down; records are up@51Hz@2N, up@50Hz, rest, up@51Hz@3N"):
        spectra.select(records=["down"])


def test_four_thousand_harmonics_are_read(rig: Rig, tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    H = 4096
    spectra = spectra_of(
        rig, np.array([0.05]), np.ones(1), {"a1": rng.standard_normal((1, 2 * H + 1))}, {"a1": np.ones((1, H + 1))}
    )
    write_spectra(tmp_path / "s.csv", spectra)
    assert_same(load_spectra(tmp_path / "s.csv", rig), spectra)


@pytest.mark.skipif(not SHARED.is_dir(), reason="the example measurements of ../shared are not here")
def test_the_example_measurements_are_read_as_they_are() -> None:
    """Against NumPy's own reader."""
    files = sorted(SHARED.glob("*/spectra.csv"))
    assert len(files) == 5
    for file in files:
        spectra = load_spectra(file, load_rig(file.with_name("rig.toml")))
        table = np.genfromtxt(file, delimiter=",", names=True, dtype=None, encoding="utf-8")
        assert spectra.measured.sum() == len(table)
        i = np.searchsorted(spectra.records, table["record"])
        j = np.array([spectra.channels.index(name) for name in table["channel"]])
        k = table["harmonic"]
        np.testing.assert_array_equal(spectra.coefficients[i, j, k], table["cos"])
        np.testing.assert_array_equal(spectra.coefficients[i, j, spectra.H + k][k > 0], table["sin"][k > 0])
        np.testing.assert_array_equal(spectra.std[i, j, k], table["std"])
        np.testing.assert_array_equal(spectra.hz[i], table["frequency_hz"])


def test_a_line_costs_no_more_in_a_longer_file(tmp_path: Path) -> None:
    """Ten times as many lines take ten times as many calls of Python functions."""
    names = [Channel(f"c{i}", "acceleration", 0.05 * i + 0.05) for i in range(7)]
    rig = replace(paper_rig(), channels=tuple(names))
    rng = np.random.default_rng(1)

    def calls(records: int) -> int:
        spectra = spectra_of(
            rig,
            np.linspace(40.0, 60.0, records),
            np.full(records, 2.0),
            {c.name: rng.standard_normal((records, 19)) for c in names},
            {c.name: np.ones((records, 10)) for c in names},
        )
        write_spectra(tmp_path / "s.csv", spectra)
        counted = Counter[str]()
        sys.setprofile(lambda _frame, event, _argument: counted.update([event]))
        try:
            load_spectra(tmp_path / "s.csv", rig)
        finally:
            sys.setprofile(None)
        return counted["call"]

    calls(6)  # imports
    assert calls(60) < 11 * calls(6)


# ------------------------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", f": is empty; must have the columns {HEADING}"),
        (HEADING, ": no rows; must have at least one coefficient"),
        (HEADING.replace(",level", ""), f" line 1: no column level; must be {HEADING}"),
        (f"{HEADING},phase\n", f' line 1: unknown column "phase"; must be {HEADING}'),
        (
            "record,level,frequency_hz,channel,harmonic,cos,sin,std,std",
            f" line 1: columns are record,level,frequency_hz,channel,harmonic,cos,sin,std,std; must be {HEADING}",
        ),
        ("3,4.7,54.112,a1,1,-1.5,0.25", " line 3: 7 entries; must have 8"),
        ("3,4.7,54.112,a1,1,-1.5,0.25,1e-3,9", " line 3: 9 entries; must have 8"),
        (
            "3: 5,4.7,54.112,a1,2,-1.5,0.25,1e-3",
            ' line 3: record = "3: 5"; must be a whole number, or a name of at most 100 characters without ": "',
        ),
        ("3,0,54.112,a1,2,1,2,1e-3", " line 3: level = 0; must be a number > 0 [N]"),
        ("3,inf,54.112,a1,2,1,2,1e-3", " line 3: level = inf; must be a number > 0 [N]"),
        ("3,x,54.112,a1,2,1,2,1e-3", ' line 3: level = "x"; must be a number > 0 [N]'),
        ("3,4.7,-54,a1,2,1,2,1e-3", " line 3: frequency_hz = -54; must be a number > 0 [Hz]"),
        ("3,4.7,nan,a1,2,1,2,1e-3", " line 3: frequency_hz = nan; must be a number > 0 [Hz]"),
        ("3,4.7,54.112,a7,2,1,2,1e-3", ' line 3: channel "a7" is not in the rig; channels are force, a1, a2'),
        (
            '3,4.7,54.112,"a\n1",2,1,2,1e-3',
            ' line 3: channel "a\\n1" is not in the rig; channels are force, a1, a2',
        ),
        ("3,4.7,54.112,a1,-1,1,2,1e-3", " line 3: harmonic = -1; must be a whole number from 0 to 8192"),
        ("3,4.7,54.112,a1,1.5,1,2,1e-3", ' line 3: harmonic = "1.5"; must be a whole number'),
        ("3,4.7,54.112,a1,999999999,1,2,1e-3", " line 3: harmonic = 999999999; must be a whole number from 0 to 8192"),
        (
            "3,4.7,54.112,a1,2,nan,2,1e-3",
            " line 3: cos = nan; must be finite, harmonics not measured are left out",
        ),
        ("3,4.7,54.112,a1,2,1,-inf,1e-3", " line 3: sin = -inf; must be finite, harmonics not measured are left out"),
        ("3,4.7,54.112,a1,2,,2,1e-3", ' line 3: cos = ""; must be a number'),
        ("3,4.7,54.112,a1,0,1,2,1e-3", " line 3: sin of harmonic 0 = 2; must be 0"),
        (
            "3,4.7,54.112,a1,2,1,2,",
            ": record 3, a1, harmonic 2 has no std; must be > 0, for each of cos and sin; measure records of its level "
            "and frequency more than once, or state --repeatability PERCENT",
        ),
        (
            "3,4.7,54.112,a1,2,1,2,0",
            " line 3: std = 0; must be > 0, for each of cos and sin; "
            "estimate it from the time history with hbm spectra",
        ),
        (
            "3,4.7,54.112,a1,2,1,2,nan",
            " line 3: std = nan; must be > 0, for each of cos and sin; "
            "estimate it from the time history with hbm spectra",
        ),
        ("3,4.7,54.112,a1,1,1,2,1e-3", " line 3: record 3, a1, harmonic 1 a second time; must be once in a file"),
        (
            "3,4.7,54.113,a2,1,1,2,1e-3",
            " line 3: record 3 has frequency 54.113 Hz and before 54.112 Hz; must be the same in a record",
        ),
        (
            "3,4.8,54.112,a2,1,1,2,1e-3",
            " line 3: record 3 has level 4.8 N and before 4.7 N; must be the same in a record",
        ),
        (
            '3,4.7,54.112,"a1,2,1,2,1e-3' + "x" * 140_000,
            ": cannot be read (field larger than field limit (131072)); must be a spectra file (CSV)",
        ),
    ],
)
def test_a_bad_file_is_refused_in_one_line(text: str, line: str, rig: Rig, tmp_path: Path) -> None:
    """Texts that are a row come after a good one, in line 3."""
    path = tmp_path / "spectra.csv"
    path.write_text(f"{HEADING}\n{GOOD}\n{text}\n" if text[:1] == "3" else text)
    with pytest.raises(InputError) as refused:
        load_spectra(path, rig)
    assert str(refused.value) == f"{path}{line}"


def test_a_copy_of_a_record_is_refused(rig: Rig, tmp_path: Path) -> None:
    """A file that was appended to itself has no scatter, and each of its records twice."""
    spectra, file = drawn(rig), tmp_path / "s.csv"
    write_spectra(file, spectra)
    heading, *rows = file.read_text().splitlines()
    again = [f"{int(row.split(',')[0]) + 3},{row.split(',', 1)[1]}" for row in rows]
    file.write_text("\n".join([heading, *rows, *again]))
    with pytest.raises(InputError, match=r"s\.csv: record 4 is a copy of record 1; must be measured anew, or left out"):
        load_spectra(file, rig)


def test_what_is_not_a_spectra_file_is_refused(rig: Rig, tmp_path: Path) -> None:
    binary = tmp_path / "b.csv"
    binary.write_bytes(b"record,\xff\xfe")
    folder = tmp_path / "s.nc"
    folder.mkdir()
    said = {
        tmp_path / "no.csv": "no such file; must be a spectra file",
        folder: "is a directory; must be a spectra file",
        tmp_path / "s.xlsx": "not a spectra file; must end in .csv or .npz or .nc or .mat",
        binary: "cannot be read ('utf-8' codec can't decode byte 0xff in position 7: invalid start byte); "
        "must be a spectra file (CSV)",
    }
    for path, what in said.items():
        with pytest.raises(InputError) as refused:
            load_spectra(path, rig)
        assert str(refused.value) == f"{path}: {what}"


def test_a_wrong_ending_writes_nothing(rig: Rig, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        write_spectra(tmp_path / "s.txt", drawn(rig))
    assert (
        str(refused.value)
        == f"{tmp_path / 's.txt'}: not a spectra file; must end in .csv or .npz or .nc or .mat or .uff"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_band_leaves_out_responses_beyond_it_and_keeps_the_force(rig: Rig) -> None:
    rng, hz = np.random.default_rng(3), np.array([10.0, 20.0, 40.0])
    coefficients = {name: rng.standard_normal((3, 11)) for name in ("force", "a1")}
    whole = spectra_of(rig, hz, np.ones(3), coefficients, {name: np.ones((3, 6)) for name in coefficients})
    band = whole.between(15.0, 21.0, ["a1"])
    assert band.records.tolist() == [1, 2] and band.H == 4  # 42 Hz are four times the lowest frequency
    assert [np.flatnonzero(row).tolist() for row in band.measured[:, band.index("a1")]] == [[2], [1]]
    assert band.complex("a1")[0, 2] == whole.complex("a1")[0, 2] and np.isnan(band.complex("a1")[0, 3])
    assert np.array_equal(band.complex("force")[0], whole.complex("force")[0, :5])
    assert np.array_equal(band.complex("force")[1, :3], whole.complex("force")[1, :3])
    assert np.isnan(band.complex("force")[1, 3:]).all()  # 60 and 80 Hz
    with pytest.raises(InputError, match="no response between 300 and 400 Hz; they are from 10 to 200 Hz"):
        whole.between(300.0, 400.0, ["a1"])
