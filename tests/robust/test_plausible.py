"""Numbers that nothing real has are refused; numbers that look like another unit are warned of."""

import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hbm.cli import app
from hbm.errors import InputError
from hbm.measurement.recording import recording
from hbm.measurement.spectrafile import load_spectra
from hbm.rigfiles.load import load_rig
from models import Jenkins
from models.bodies.matrix import MatrixBody
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import CubicSpring, Joint
from models.parts import Damping, Excitation
from models.plausible import RANGES, PlausibilityWarning, doubt, impossible
from models.published import paper_rig

ROOT = Path(__file__).parents[2]
BEAM = (ROOT / "examples" / "paper_beam.toml").read_text(encoding="utf-8")
FOLDER = ROOT / "examples" / "undecided_beam"
SPECTRA = (FOLDER / "spectra.csv").read_text(encoding="utf-8")


def rig_file(folder: Path, old: str, new: str) -> Path:
    assert old in BEAM
    path = folder / "rig.toml"
    path.write_text(BEAM.replace(old, new), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("width = 0.03888", "width = 1e300", "beam.width = 1e+300; must be between 1e-10 and 100000 m: an atom is"),
        ("width = 0.03888", "width = 1e-320", "beam.width = 1e-320; must be between 1e-10 and 100000 m"),
        ("density = 7800.0", "density = 1e-30", "beam.density = 1e-30; must be between 0.01 and 1e+06 kg/m3: aerogels"),
        ("thickness = 0.00478", "thickness = 1e-12", "beam.thickness = 1e-12; must be between 1e-10 and"),
        ("radius = 0.005", "radius = 1e10", "contact.radius = 10000000000.0; must be between 1e-10 and"),
        ("mu = 0.52", "mu = 1e300", "contact.friction.mu = 1e+300; must be between 1e-12 and 1e+06: superlubricity"),
        ('law = "coulomb-penalty"', 'law = "stribeck"\nexponent = 1000', "contact.friction.exponent = 1000"),
        ("amplitude = 6.5", "amplitude = 1e-320", "excitation.amplitude = 1e-320; must be between 1e-18 and"),
    ],
)
def test_what_nothing_real_has_is_refused_with_its_range_and_reason(old, new, said, tmp_path) -> None:
    path = rig_file(tmp_path, old, new)
    with pytest.raises(InputError) as refused:
        load_rig(path)
    assert str(refused.value).startswith(f"{path}: {said}")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "length = 0.606 ",
            "length = 606.0 ",
            "beam.length = 606 m; usual are 0.001 to 100 m; is it meant in mm (0.606 m)?",
        ),
        (
            "210e9",
            "70.0",
            "beam.youngs_modulus = 70 Pa; usual are 1e+06 to 2e+12 Pa; is it meant in GPa (7e+10 Pa)?",
        ),
        (
            "density = 7800.0",
            "density = 7.8",
            "beam.density = 7.8 kg/m3; usual are 10 to 25000 kg/m3; is it meant in g/cm3 (7800 kg/m3)?",
        ),
        (
            "210e9",
            "210e3",
            "beam.youngs_modulus = 210000 Pa; usual are 1e+06 to 2e+12 Pa; is it meant in MPa (2.1e+11 Pa)?",
        ),
        (
            "density = 7800.0",
            "density = 7.8e4",
            "beam.density = 78000 kg/m3; usual are 10 to 25000 kg/m3; check it",
        ),
        (
            "thickness = 0.00478",
            "thickness = 0.7",
            "beam.thickness = 0.7 m; usual are less than beam.length (0.606 m); check both",
        ),
        (
            "radius = 0.005",
            "radius = 0.65",
            "contact.radius = 0.65 m; usual are less than beam.length (0.606 m); check both",
        ),
        (
            "critical_slip = 4.15e-6",
            "critical_slip = 0.0095",
            "contact.friction.critical_slip = 0.0095 m; usual are less than beam.thickness (0.00478 m); check both",
        ),
        (
            "mass_proportional = 0.06",
            "mass_proportional = 700.0",
            "damping.mass_proportional = 700 1/s; usual are less than critical damping of the first mode "
            "(601.199 1/s); check both",
        ),
    ],
)
def test_what_looks_like_another_unit_is_warned_of_in_one_line(old, new, said, tmp_path) -> None:
    path = rig_file(tmp_path, old, new)
    with pytest.warns(PlausibilityWarning) as caught:
        load_rig(path)
    assert [str(w.message) for w in caught] == [f"{path}: {said}"]
    result = CliRunner().invoke(app, ["modes", str(path)], prog_name="hbm")
    assert (result.exit_code, result.stderr) == (0, f"warning: {path}: {said}\n")


@pytest.mark.parametrize(("ratio", "meant"), [("0.5", "0.005"), ("5.0", "0.05")])
def test_a_damping_ratio_in_percent_is_warned_of_once(
    ratio: str, meant: str, tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where other rigs are made of the one that was read."""
    monkeypatch.setattr("models.plausible._said", set())
    path = rig_file(tmp_path, "mass_proportional = 0.06", f"modal_ratios = [{ratio}]")
    with pytest.warns(PlausibilityWarning) as caught:
        load_rig(path).with_modes(8)
    said = f"{path}: damping.modal_ratios[1] = {float(ratio):g}; usual are <= 0.2; is it meant in % ({meant})?"
    assert [str(w.message) for w in caught] == [said]


def test_rigs_made_in_python_are_held_against_the_same_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("models.plausible._said", set())
    rig = paper_rig()
    with pytest.raises(ValueError, match=r"Beam: length = 1e\+300; must be between 1e-09 and 100000 m: an atom"):
        replace(rig.body, length=1e300)
    with pytest.raises(ValueError, match=r"Jenkins: critical_slip = 1e-320; must be between"):
        Jenkins(mu=0.5, critical_slip=1e-320)
    heavy = replace(rig.body, length=606.0)
    places = replace(rig, body=heavy, excitation=replace(rig.excitation, position=500.0))
    with pytest.warns(PlausibilityWarning, match="beam.length = 606 m"):
        monkeypatch.setattr("models.plausible._said", set())
        replace(places, name="again")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        replace(places, name="said once")


def test_modes_that_nothing_damps_are_warned_of(monkeypatch: pytest.MonkeyPatch) -> None:
    joint = Joint("cable", CubicSpring(1e9), at=("a",))

    def warned_of(damping: Damping) -> list[str]:
        monkeypatch.setattr("models.plausible._said", set())
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            JointedRig("one", ModalModel((10.0,), {"a": (1.0,)}), damping, (joint,), Excitation(1.0, at="a"))
        return [str(w.message) for w in caught]

    (said,) = warned_of(Damping())
    assert said.startswith("damping is 0 in the lowest modes, only joints damp them; usual are modal_ratios")
    given = (Damping(0.1), Damping(modal_ratios=(0.0,)), Damping(stiffness_proportional=1e-5))
    for damping in (*given, Damping(high_mode_from=1)):
        assert not warned_of(damping)


@pytest.mark.parametrize(
    ("mass", "stiffness", "said"),
    [
        (1.0, 1e300, r"the largest entry of stiffness = 1e\+300; must be of magnitude <= 1e\+30 SI"),
        (1e-300, 1.0, "the largest entry of mass = 1e-300; must be between 1e-50"),
        (1.0, 1e-100, "a natural frequency = .*; must be between 1e-09 and"),
    ],
)
def test_matrices_of_no_structure_are_refused(mass: float, stiffness: float, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        MatrixBody(np.array([[mass]]), np.array([[stiffness]]), ("1",), modes=1).ported(["1"], Damping())


@pytest.mark.parametrize(
    ("step", "reading", "said"),
    [
        (1e-3, 1e-300, "h: the largest of a is 1e-300; must be between 1e-30 and"),
        (1e-300, 1.0, "h: the mean step of time is 1e-300; must be between 1e-18"),
    ],
)
def test_histories_that_no_one_measured_are_refused(step: float, reading: float, said: str) -> None:
    with pytest.raises(InputError, match=said):
        recording("h", step * np.arange(9), {"a": reading * np.ones(9)})


def test_the_examples_are_usual() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for path in sorted((ROOT / "examples").glob("**/*.toml")):
            load_rig(path, allow_code=True)


@pytest.mark.parametrize("quantity", RANGES)
def test_the_usual_is_possible_and_each_range_says_why(quantity: str) -> None:
    known = RANGES[quantity]
    assert known.possible[0] <= known.usual[0] or known.usual[0] == 0.0
    assert known.usual[1] <= known.possible[1] or known.usual[1] == float("inf")
    assert known.reason
    middle = 1.0 if known.usual == (0.0, float("inf")) else known.usual[1] / 2
    assert impossible(quantity, middle) is None and doubt(quantity, middle) is None
    assert impossible(quantity, 2 * known.possible[1]) is not None


@pytest.mark.parametrize(
    ("line", "column", "entry", "said"),
    [
        (2, 5, "1e308", "cos = 1e+308; must be of magnitude <= 1e+15 m/s2: particles"),
        (1, 1, "1e-320", "level = 1e-320; must be between 1e-18 and 1e+12 N"),
        (1, 2, "1e300", "frequency_hz = 1e+300; must be between 1e-09 and 1e+13 Hz"),
        (2, 7, "1e-300", "std = 1e-300; must be >= 6.34e-20 beside cos"),
        (2, 7, "1e-320", "std = 1e-320; must be >= 6.34e-20 beside cos"),
    ],
)
def test_what_no_measurement_gives_is_refused(line, column, entry, said, tmp_path) -> None:
    rows = [row.split(",") for row in SPECTRA.splitlines()]
    if column in (1, 2):  # of a record
        for row in rows[1:]:
            row[column] = entry
    rows[line][column] = entry
    path = tmp_path / "spectra.csv"
    path.write_text("\n".join(map(",".join, rows)))
    with pytest.raises(InputError) as refused:
        load_spectra(path, load_rig(FOLDER / "rig.toml"))
    assert str(refused.value).startswith(f"{path} line {line + 1}: {said}"), str(refused.value)


def test_spectra_of_harmonic_0_alone_are_refused(tmp_path: Path) -> None:
    heading, *rows = [row.split(",") for row in SPECTRA.splitlines()]
    rows = [[*row[:4], "0", row[5], "0", row[7]] for row in rows]
    path = tmp_path / "spectra.csv"
    path.write_text("\n".join(map(",".join, [heading, *rows])))
    with pytest.raises(InputError, match=r"has harmonic 0 alone; must have the fundamental, harmonic 1$"):
        load_spectra(path, load_rig(FOLDER / "rig.toml"))


LEVERS = "must be between 1e-12 and 100000: a lever is between"


@pytest.mark.parametrize(
    ("weight", "accepted"),
    [("1e400", "must be finite"), ("nan", "must be finite"), ("1e300", LEVERS), ("1e-300", LEVERS)],
)
def test_weights_of_places_are_levers(weight: str, accepted: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    text = (ROOT / "examples" / "jointed_beam.toml").read_text()
    path.write_text(text.replace('at = "y(0.3)"', f'at = "{weight}*y(0.3)"'))
    with pytest.raises(InputError, match=re.escape(f'place "{weight}*y(0.3)": weight {weight}; {accepted}')):
        load_rig(path)


def test_friction_without_load_is_no_friction(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    text = (ROOT / "examples" / "jointed_beam.toml").read_text(encoding="utf-8")
    path.write_text(text.replace("normal_load = 4.0", "normal_load = 0.0"), encoding="utf-8")
    with pytest.raises(InputError, match=r"joint clamp: Friction: normal_load = 0 and no reference_load; must have"):
        load_rig(path)
