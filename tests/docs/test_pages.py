"""Pages do what they say: their Python runs, their rig files load, their commands exist; and they read easily."""

import re
import tomllib
from pathlib import Path
from statistics import median
from typing import Any

import prose
import pytest
import typer
from generated import tables
from generated.fill import PAGES as FILLED
from generated.fill import REFERENCE, filled
from generated.tables import keys

from hbm.cli import app
from hbm.errors import InputError
from hbm.rigfiles import joints, schema
from hbm.rigfiles.load import load_rig, rig_of_table
from models.causes.addedjoint import reach
from models.causes.joints import JOINT_CAUSES

ROOT = prose.ROOT
PAGES = [path for path in prose.pages() if not path.name.startswith("0")]
BLOCK = re.compile(r"(<!-- not run: [^\n]+ -->\n)?^```(\w+)\n(.*?)^```$", re.M | re.S)
ELSEWHERE = {
    "own_law.md",
    "own_cause.md",
}  # tests of their own run these, tests/test_own_law.py, tests/test_own_cause.py
MEDIAN = 18  # words of a sentence


def blocks(path: Path, *languages: str) -> list[tuple[str, str]]:
    """Language and text of the fenced blocks of a page that are run."""
    found = BLOCK.findall(path.read_text(encoding="utf-8"))
    return [(language, text) for left_out, language, text in found if language in languages and not left_out]


def with_blocks(*languages: str) -> Any:
    """The pages that have such blocks."""
    pages = [path for path in PAGES if path.name not in ELSEWHERE and blocks(path, *languages)]
    return pytest.mark.parametrize("path", pages, ids=lambda path: str(path.relative_to(ROOT)))


@with_blocks("python", "toml")
def test_python_runs_and_rig_files_load(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    scope: dict[str, Any] = {"__name__": "__main__"}
    for language, text in blocks(path, "python", "toml"):
        if language == "python":
            exec(compile(text, str(path), "exec"), scope)
        elif "name" in tomllib.loads(text):  # a whole rig file, not a part of one
            Path("rig.toml").write_text(text, encoding="utf-8")
            load_rig("rig.toml")


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_and_their_options_exist(path: Path) -> None:
    commands: Any = typer.main.get_command(app)
    text = re.sub(r"\\\n\s*", " ", path.read_text(encoding="utf-8"))
    shell = "\n".join(
        block for _, _, block in re.findall(r"^( *)```(sh|bash|console)\n(.*?)^\1```$", text, re.M | re.S)
    )
    inline = re.findall(r"`(hbm [a-z][^`]*)`", text)
    for line in [*re.findall(r"(?<![\w./-])hbm [a-z]+[^\n#&|]*", shell), *inline]:
        _, name, *rest = line.split()
        if name not in commands.commands:
            assert not name.isalpha(), f"{line}: no such command"
            continue
        options = {o for p in commands.commands[name].params for o in (*p.opts, *p.secondary_opts)} | {"--help"}
        for word in re.findall(r"(?<!\S)\[?(--[a-z-]+)", " ".join(rest)):
            assert word in options, f"{line}: {name} has no option {word}"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_half_of_the_sentences_are_short(path: Path) -> None:
    found = prose.lengths(path)
    assert not found or median(found) <= MEDIAN


def test_words_are_counted_by_sentence() -> None:
    page = "# T\n\nOne two three. Four `a b` five,\nsix: seven!\n\n- An item of five words\n\n| row |\n\n$$\nx\n$$\n"
    assert [s.split() for s in prose.sentences(page)] == [
        ["One", "two", "three."],
        ["Four", "x", "five,", "six:", "seven!"],
        ["An", "item", "of", "five", "words"],
    ]


@pytest.mark.parametrize("name", tables.TABLES)
def test_reference_tables_are_made_and_have_entries(name: str) -> None:
    assert tables.TABLES[name]().count("\n") > 2


def test_every_table_of_the_schema_is_in_the_reference() -> None:
    pages = [
        (ROOT / "docs" / "reference" / f"{name}.md").read_text(encoding="utf-8") for name in ("rig_files", "joints")
    ]
    named = [name for page in pages for name in re.findall(r"<!-- generated: keys of (.+) -->", page)]
    assert sorted(named) == sorted(tables.SCHEMAS)


@pytest.mark.parametrize("page", FILLED)
def test_tables_of_keys_in_the_pages_are_those_of_the_schema(page: str) -> None:
    """They are read without Sphinx, too; PYTHONPATH=docs python -m generated.fill writes them."""
    text = (REFERENCE / page).read_text(encoding="utf-8")
    assert filled(text) == text


def test_every_key_of_a_rig_file_has_a_section() -> None:
    page = (ROOT / "docs" / "reference" / "rig_files.md").read_text(encoding="utf-8")
    headings = set(re.findall(r"^## `\[+(\w+)\]+`$", page, re.M)) | {
        "name",
        "joints",
    }  # joints have a page of their own
    roots = (schema.BeamRig, schema.ModalRig, joints.JointedRigTable)
    assert {key for root in roots for key in root.model_fields} == headings


def test_bounds_of_a_key_are_those_of_the_schema() -> None:
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", tables.keys("beam"), re.M))
    assert rows["length"].startswith("number | m | required | > 0 |")
    assert rows["modes"].startswith("whole number |  | `5` | ≥ 1, ≤ 1000 |")
    assert rows["root"].startswith("text |  | `clamped` | `clamped` or `supported` or `free` |")


@pytest.mark.parametrize(
    ("rig", "table", "name"),
    [
        ("paper_beam", "excitation", "excitation"),
        ("paper_beam", "channels", "channels"),
        ("jointed_beam", "excitation", "excitation with joints"),
        ("jointed_beam", "channels", "channels with joints"),
    ],
)
def test_keys_of_a_table_are_those_that_its_kind_of_rig_takes(rig: str, table: str, name: str) -> None:
    """A key that no rig has is refused with those that this kind of rig takes: the keys of the page."""
    path = ROOT / "examples" / f"{rig}.toml"
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    entry = tables[table][0] if isinstance(tables[table], list) else tables[table]
    entry["none_such"] = 1.0
    with pytest.raises(InputError) as refused:
        rig_of_table(tables, str(path))
    taken = re.findall(r"accepted keys are ([\w, ]+)", str(refused.value))[0].split(", ")
    assert sorted(re.findall(r"^\| `(\w+)` \|", keys(name), re.M)) == sorted(taken)


def test_positions_on_a_beam_with_a_contact_are_off_its_clamp() -> None:
    for name in ("excitation", "channels"):
        rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", keys(name), re.M))
        assert re.match(r"number \| m \| required \| > 0 \| .* at most `beam\.length`", rows["position"])


def test_every_number_of_a_rig_with_a_contact_is_in_the_reference() -> None:
    """It is a key of the tables, a parameter of the law, or named on the page."""
    page = (ROOT / "docs" / "reference" / "rig_files.md").read_text(encoding="utf-8")
    known = tables.known_keys()
    for key in load_rig(ROOT / "examples" / "paper_beam.toml").numbers:
        table, *_, last = key.split(".")
        if not key.startswith("contact.friction.") and last not in known[table]:
            assert f"`{re.sub(r'[.]a[0-9][.]', '.a1.', key)}`" in page


def test_bounds_of_joints_that_may_be_missing_are_those_of_the_fits() -> None:
    """The words of the page, computed with the force and the motion of a rig."""
    rig = load_rig(ROOT / "examples" / "jointed_beam.toml")
    rows = re.findall(r"^\| `(\S+)` \| `(\w+)` \| [^|]+ \| [^|]+ \| (.*) \|$", tables.causes_of_joints(), re.M)
    said = {(cause, name): words for cause, name, words in rows}
    tried = 0
    for kind in JOINT_CAUSES:
        cause = next(iter(kind.candidates(rig)), None)
        for unknown in () if cause is None else cause.unknowns(rig):
            span, _, size = said[kind.name, unknown.name].partition(" times ")
            A, omega = reach(rig, cause.at, cause.to)
            code = re.sub("[²³⁵]", lambda power: f"**{'⁰¹²³⁴⁵'.index(power[0])}", size).replace(" ", "*")
            unit = eval(code or "1", {"F": rig.excitation.amplitude, "A": A, "ω": omega})
            lower, upper = (float(end) * unit for end in span.split(" to "))
            assert (unknown.lower, unknown.upper) == pytest.approx((lower, upper), rel=1e-12)
            tried += 1
    assert tried > len(JOINT_CAUSES)


def test_every_command_has_its_usage_and_example_as_code() -> None:
    text, commands = tables.TABLES["commands"](), typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert re.findall(r"^## `hbm ([a-z]+)`$", text, re.M) == list(commands)
    assert re.findall(r"^```console\n\$ hbm ([a-z]+) [^`]*\n```$", text, re.M) == list(commands)
    assert all(re.search(rf"^Example: `hbm {name} [^`]+`$", text, re.M) for name in commands)


def test_types_of_keys_are_in_words() -> None:
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]*) \|", tables.keys("modal with joints"), re.M))
    assert rows["frequencies_hz"] == "array of numbers"
    assert rows["ports"] == "table of arrays of numbers"
    assert rows["flexibility"] == "array of arrays of numbers"


@pytest.mark.parametrize("package", ["hbm", "models", "continuation"])
def test_every_public_name_is_in_the_reference(package: str) -> None:
    import importlib

    page = {"hbm": "python"}.get(package, package)
    text = (ROOT / "docs" / "reference" / f"{page}.md").read_text(encoding="utf-8")
    shown = {name.rpartition(".")[2] for name in re.findall(r"^\.\. auto\w+:: (\S+)", text, re.M)}
    assert set(importlib.import_module(package).__all__) - {"Array"} <= shown
