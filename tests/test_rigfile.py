"""Rig files: what is accepted, and the one line that refuses the rest."""

import tomllib
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import ClassVar

import pytest

from hbm.errors import InputError
from hbm.rigfiles.load import load_rig, rig_from_dict
from models import LAWS, Beam, ModalBody, Rig
from models.friction import Parameter, chosen, describe, parameter, parameters, settings
from models.published import (
    ASSUMED_IWAN,
    PAPER_COULOMB,
    PAPER_DAHL,
    PAPER_DECAY,
    PAPER_PENALTY,
    PAPER_STRIBECK,
    paper_rig,
)

EXAMPLES = Path(__file__).parents[1] / "examples"

BEAM = """\
name = "beam"
[beam]
length = 0.606
width = 0.03888
thickness = 0.00478
youngs_modulus = 210e9
density = 7800.0
[damping]
mass_proportional = 0.06
[contact]
radius = 0.005
normal_load = 83.0
[contact.friction]
law = "coulomb-penalty"
mu = 0.52
critical_slip = 4.15e-6
[excitation]
position = 0.555
amplitude = 6.5
[[channels]]
name = "force"
quantity = "force"
position = 0.555
[[channels]]
name = "a1"
quantity = "acceleration"
position = 0.10
"""

MODAL = """\
name = "modal"
[modal]
frequencies_hz = [50.0, 120.0]
shapes = [[1.0, 1.0], [0.5, -0.5]]
contact_shape = [2.0, 3.0]
excitation_shape = [1.0, 1.0]
[damping]
modal_ratios = [0.01, 0.02]
[contact]
normal_load = 10.0
[contact.friction]
law = "none"
[excitation]
amplitude = 1.0
[[channels]]
name = "force"
quantity = "force"
[[channels]]
name = "a1"
quantity = "acceleration"
"""

STRIBECK = """\
law = "stribeck"
mu_static = 0.477
mu = 0.161
stribeck_velocity = 6e-4
critical_slip = 4e-6
"""
IWAN = 'law = "iwan"\nmu = 0.5\nstiffness = 1e7\n'
SPREAD, ELEMENTS, LIMITS = (f": contact.friction.{key}" for key in ("spread", "elements", "limits"))
PENALTY = 'law = "coulomb-penalty"\nmu = 0.52\ncritical_slip = 4.15e-6\n'

BEAM_KEYS = "length, width, thickness, youngs_modulus, density, modes"
CONTACT_KEYS = "normal_load, friction, radius, variable_normal_load, residual_compliance, foreshortening, lift_off"
LAW_NAMES = (
    "coulomb-lagrange, coulomb-penalty, vlfm, karnopp, sdfm, fbfm, stribeck, dahl, lugre, hybrid, iwan, viscous, none, "
    "or file.py:Class"
)

# (base, text replaced, replacement, message after "<path>")
REFUSED = {
    # numbers out of range
    "negative mu": (BEAM, "mu = 0.52", "mu = -0.2", ": contact.friction.mu = -0.2; must be > 0"),
    "zero mu": (BEAM, "mu = 0.52", "mu = 0", ": contact.friction.mu = 0; must be > 0"),
    "negative length": (BEAM, "length = 0.606", "length = -1.0", ": beam.length = -1.0; must be > 0"),
    "zero thickness": (BEAM, "thickness = 0.00478", "thickness = 0.0", ": beam.thickness = 0.0; must be > 0"),
    "negative radius": (BEAM, "radius = 0.005", "radius = -0.005", ": contact.radius = -0.005; must be >= 0"),
    "no load": (BEAM, "normal_load = 83.0", "normal_load = 0.0", ": contact.normal_load = 0.0; must be > 0"),
    "no modes": (BEAM, "density", "modes = 0\ndensity", ": beam.modes = 0; must be >= 1 and <= 1000"),
    "too many modes": (BEAM, "density", "modes = 9999\ndensity", ": beam.modes = 9999; must be >= 1 and <= 1000"),
    "negative damping": (BEAM, "= 0.06\n", "= -0.06\n", ": damping.mass_proportional = -0.06; must be >= 0"),
    "negative critical slip": (
        BEAM,
        "= 4.15e-6",
        "= -4.15e-6",
        ": contact.friction.critical_slip = -4.15e-06; must be > 0",
    ),
    "nan": (BEAM, "density = 7800.0", "density = nan", ": beam.density = nan; must be finite"),
    "infinite": (BEAM, "amplitude = 6.5", "amplitude = inf", ": excitation.amplitude = inf; must be finite"),
    "infinite mu": (BEAM, "mu = 0.52", "mu = -inf", ": contact.friction.mu = -inf; must be finite"),
    # wrong types
    "text for a number": (BEAM, "width = 0.03888", 'width = "0.04"', ': beam.width = "0.04"; must be a number'),
    "true for a number": (BEAM, "mu = 0.52", "mu = true", ": contact.friction.mu = true; must be a number"),
    "true for a count": (BEAM, "density", "modes = true\ndensity", ": beam.modes = true; must be a whole number"),
    "fraction for a count": (BEAM, "density", "modes = 5.0\ndensity", ": beam.modes = 5.0; must be a whole number"),
    "one for true": (
        BEAM,
        "radius",
        "foreshortening = 1\nradius",
        ": contact.foreshortening = 1; must be true or false",
    ),
    "date for a number": (BEAM, "0.606", "1979-05-27", ": beam.length = 1979-05-27; must be a number"),
    "array for a number": (BEAM, "0.606", "[0.606]", ": beam.length is an array; must be a number"),
    "huge integer": (BEAM, "0.606", "1" * 400, f": beam.length = {'1' * 77}...; must be a number"),
    "number for a name": (BEAM, 'name = "beam"', "name = 3", ": name = 3; must be a text in quotes"),
    "number for a table": (
        MODAL,
        '[contact.friction]\nlaw = "none"',
        "friction = 3",
        ": contact.friction = 3; must be a table",
    ),
    "table for the channels": (
        MODAL,
        MODAL[MODAL.index("[[channels]]") :],
        '[channels]\nname = "a1"',
        ": channels is a table; must be an array of tables, [[channels]]",
    ),
    "number for a law": (BEAM, '"coulomb-penalty"', "3", f": contact.friction.law = 3; must be one of {LAW_NAMES}"),
    # unknown and missing keys
    "misspelt key": (
        BEAM,
        "length =",
        "lenght =",
        f": beam.lenght is unknown; accepted keys are {BEAM_KEYS}; did you mean length?",
    ),
    "strange key": (
        BEAM,
        "length =",
        "colour = 1\nlength =",
        f": beam.colour is unknown; accepted keys are {BEAM_KEYS}",
    ),
    "key with a line break": (
        BEAM,
        "length =",
        '"a\\nb" = 1\nlength =',
        f': beam."a\\nb" is unknown; accepted keys are {BEAM_KEYS}',
    ),
    "misspelt table": (
        BEAM,
        "[beam]",
        "[baem]",
        ": baem is unknown; accepted keys are name, beam, damping, contact, excitation, channels, extensions, "
        "modal (instead of beam); did you mean beam?",
    ),
    "misspelt switch": (
        BEAM,
        "radius",
        "foreshortning = true\nradius",
        f": contact.foreshortning is unknown; accepted keys are {CONTACT_KEYS}; did you mean foreshortening?",
    ),
    "no length": (
        BEAM,
        "length = 0.606\n",
        "",
        ": beam.length is missing; required keys are length, width, thickness, youngs_modulus, density",
    ),
    "no name": (
        BEAM,
        'name = "beam"\n',
        "",
        ": name is missing; required keys are name, beam, damping, contact, excitation",
    ),
    "no friction": (
        BEAM,
        "[contact.friction]\n" + PENALTY,
        "",
        ": contact.friction is missing; required keys are normal_load, friction, radius",
    ),
    "no law": (BEAM, 'law = "coulomb-penalty"\n', "", f": contact.friction.law is missing; must be one of {LAW_NAMES}"),
    "no mu": (
        BEAM,
        "mu = 0.52\n",
        "",
        ": contact.friction.mu is missing; required keys are law, mu, critical_slip",
    ),
    "no radius": (
        BEAM,
        "radius = 0.005\n",
        "",
        ": contact.radius is missing; required keys are normal_load, friction, radius",
    ),
    "no excitation position": (
        BEAM,
        "position = 0.555\namplitude",
        "amplitude",
        ": excitation.position is missing; required keys are amplitude, position",
    ),
    "no channel position": (
        BEAM,
        "position = 0.10\n",
        "",
        ": channels[2].position is missing; required keys are name, quantity, position",
    ),
    "no body": (
        MODAL,
        MODAL[MODAL.index("[modal]") : MODAL.index("[damping]")],
        "",
        ": beam is missing; must have [beam] or [modal]",
    ),
    "two bodies": (
        BEAM,
        "[damping]",
        "[modal]\nfrequencies_hz = [50.0]\n[damping]",
        ": modal and beam are both present; must have one of them",
    ),
    "no damping": (
        BEAM,
        "mass_proportional = 0.06",
        "",
        ": damping.mass_proportional is missing; must have it or modal_ratios",
    ),
    "damping twice": (
        BEAM,
        "= 0.06\n",
        "= 0.06\nmodal_ratios = [0.01]\n",
        ": damping.modal_ratios and damping.mass_proportional are both present; must have one of them",
    ),
    # the law and its parameters
    "law of nobody": (
        BEAM,
        "coulomb-penalty",
        "xyz",
        f': contact.friction.law = "xyz"; must be one of {LAW_NAMES}',
    ),
    "misspelt law": (
        BEAM,
        "coulomb-penalty",
        "coulomb_penalty",
        f': contact.friction.law = "coulomb_penalty"; must be one of {LAW_NAMES}; did you mean coulomb-penalty?',
    ),
    "parameter of another law": (
        BEAM,
        "coulomb-penalty",
        "coulomb-lagrange",
        ": contact.friction.critical_slip = 4.15e-06 is a parameter of coulomb-penalty and stribeck; "
        "accepted keys are law, mu",
    ),
    "misspelt parameter": (
        BEAM,
        "critical_slip",
        "crit_slip",
        ": contact.friction.crit_slip is unknown; accepted keys are law, mu, critical_slip; "
        "did you mean critical_slip?",
    ),
    "damping of bristles": (
        BEAM,
        PENALTY,
        'law = "coulomb-lagrange"\nmu = 0.5\nbristle_damping = 1.0\n',
        ": contact.friction.bristle_damping = 1.0 is a parameter of lugre; accepted keys are law, mu",
    ),
    "setting of another law": (
        BEAM,
        PENALTY,
        PENALTY + "elements = 5\n",
        ": contact.friction.elements = 5 is a parameter of iwan; accepted keys are law, mu, critical_slip",
    ),
    "spread below zero": (BEAM, PENALTY, IWAN + "spread = -0.1\n", f"{SPREAD} = -0.1; must be >= 0 and <= 1"),
    "spread above one": (BEAM, PENALTY, IWAN + "spread = 1.5\n", f"{SPREAD} = 1.5; must be >= 0 and <= 1"),
    "no elements": (BEAM, PENALTY, IWAN + "elements = 0\n", f"{ELEMENTS} = 0; must be >= 1 and <= 200"),
    "too many elements": (BEAM, PENALTY, IWAN + "elements = 201\n", f"{ELEMENTS} = 201; must be >= 1 and <= 200"),
    "half an element": (BEAM, PENALTY, IWAN + "elements = 2.5\n", f"{ELEMENTS} = 2.5; must be a whole number"),
    "unknown distribution": (
        BEAM,
        PENALTY,
        IWAN + 'distribution = "normal"\n',
        ': contact.friction.distribution = "normal"; must be one of uniform',
    ),
    "no limits": (BEAM, PENALTY, IWAN + "limits = []\n", f"{LIMITS} is an empty array; must have at least one entry"),
    "number for the limits": (BEAM, PENALTY, IWAN + "limits = 3.0\n", f"{LIMITS} = 3.0; must be an array"),
    "zero limit": (BEAM, PENALTY, IWAN + "limits = [1.0, 0.0]\n", f"{LIMITS}[2] = 0.0; must be > 0"),
    "too many limits": (
        BEAM,
        PENALTY,
        IWAN + f"limits = {[1.0] * 201}\n",
        f"{LIMITS} is an array; must have at most 200 entries",
    ),
    "limits and elements": (
        BEAM,
        PENALTY,
        IWAN + "limits = [1.0, 2.0]\nelements = 2\n",
        f"{LIMITS} and contact.friction.elements are both present; must have one of them",
    ),
    "limits and spread": (
        BEAM,
        PENALTY,
        IWAN + "spread = 0.5\nlimits = [1.0, 2.0]\n",
        f"{LIMITS} and contact.friction.spread are both present; must have one of them",
    ),
    "friction that rises": (
        BEAM,
        PENALTY,
        STRIBECK.replace("0.477", "0.1"),
        ": contact.friction.mu_static = 0.1; must be >= mu = 0.161",
    ),
    "zero exponent": (
        BEAM,
        PENALTY,
        STRIBECK + "exponent = 0.0\n",
        ": contact.friction.exponent = 0.0; must be > 0",
    ),
    # positions and channels
    "excitation off the beam": (
        BEAM,
        "position = 0.555\namplitude",
        "position = 0.7\namplitude",
        ": excitation.position = 0.7; must be > 0 and <= beam.length = 0.606",
    ),
    "sensor off the beam": (
        BEAM,
        "position = 0.10",
        "position = 0.61",
        ": channels[2].position = 0.61; must be > 0 and <= beam.length = 0.606",
    ),
    "sensor at the clamp": (BEAM, "position = 0.10", "position = 0.0", ": channels[2].position = 0.0; must be > 0"),
    "unknown quantity": (
        BEAM,
        '"acceleration"',
        '"jerk"',
        ': channels[2].quantity = "jerk"; must be one of force, acceleration, velocity, displacement',
    ),
    "same name twice": (
        BEAM,
        'name = "a1"',
        'name = "force"',
        ': channels[2].name = "force"; must be unique, channels[1] has it too',
    ),
    "name with a comma": (
        BEAM,
        'name = "a1"',
        'name = "a,1"',
        ': channels[2].name = "a,1"; must be a name without , ; quotes, control characters or surrounding blanks',
    ),
    "name with a line break": (
        BEAM,
        'name = "a1"',
        'name = "a\\n1"',
        ': channels[2].name = "a\\n1"; must be a name without , ; quotes, control characters or surrounding blanks',
    ),
    "name of a computed channel": (
        BEAM,
        'name = "a1"',
        'name = "slip"',
        ': channels[2].name = "slip"; must not be one of the computed drive, slip, slip_velocity, friction, normal',
    ),
    "two forces": (
        BEAM,
        '"acceleration"',
        '"force"',
        ': channels[2].quantity = "force"; must not be a second force, channels[1] is the first',
    ),
    # modal rigs
    "position in a modal rig": (
        MODAL,
        "amplitude = 1.0",
        "amplitude = 1.0\nposition = 0.5",
        ": excitation.position does not go with [modal]; accepted keys are amplitude",
    ),
    "repeatability beyond the response": (
        MODAL,
        'quantity = "acceleration"',
        'quantity = "acceleration"\nrepeatability = 1.5',
        ": channels[2].repeatability = 1.5; must be >= 0 and <= 1",
    ),
    "channel position in a modal rig": (
        MODAL,
        'quantity = "acceleration"',
        'quantity = "acceleration"\nposition = 0.5',
        ": channels[2].position does not go with [modal]; accepted keys are name, quantity, repeatability",
    ),
    "radius in a modal rig": (
        MODAL,
        "normal_load",
        "radius = 0.005\nnormal_load",
        ": contact.radius does not go with [modal]; accepted keys are normal_load, friction",
    ),
    "strange key in modal": (
        MODAL,
        "contact_shape",
        "colour = 1\ncontact_shape",
        ": modal.colour is unknown; accepted keys are frequencies_hz, shapes, contact_shape, excitation_shape",
    ),
    "zero frequency": (MODAL, "[50.0, 120.0]", "[0.0, 120.0]", ": modal.frequencies_hz[1] = 0.0; must be > 0"),
    "no frequencies": (
        MODAL,
        "[50.0, 120.0]",
        "[]",
        ": modal.frequencies_hz is an empty array; must have at least one entry",
    ),
    "falling frequencies": (
        MODAL,
        "[50.0, 120.0]",
        "[50.0, 20.0]",
        ": modal.frequencies_hz[2] = 20.0; must be >= the one before, 50.0",
    ),
    "too few shapes": (
        MODAL,
        "[[1.0, 1.0], [0.5, -0.5]]",
        "[[1.0, 1.0]]",
        ": modal.shapes has 1 entry; must have 2, one row per [[channels]] entry in order",
    ),
    "short shape": (
        MODAL,
        "[0.5, -0.5]",
        "[0.5]",
        ": modal.shapes[2] has 1 entry; must have 2, one per mode",
    ),
    "text in a shape": (MODAL, "-0.5]", '"x"]', ': modal.shapes[2][2] = "x"; must be a number'),
    "long contact shape": (
        MODAL,
        "[2.0, 3.0]",
        "[2.0, 3.0, 4.0]",
        ": modal.contact_shape has 3 entries; must have 2, one per mode",
    ),
    "short excitation shape": (
        MODAL,
        "excitation_shape = [1.0, 1.0]",
        "excitation_shape = []",
        ": modal.excitation_shape has 0 entries; must have 2, one per mode",
    ),
    "wrong number of ratios": (
        MODAL,
        "[0.01, 0.02]",
        "[0.01, 0.02, 0.03]",
        ": damping.modal_ratios has 3 entries; must have 1, or 2, one per mode",
    ),
    "negative ratio": (MODAL, "[0.01, 0.02]", "[0.01, -0.02]", ": damping.modal_ratios[2] = -0.02; must be >= 0"),
    # not TOML
    "no equals sign": (
        BEAM,
        "length = 0.606",
        "length 0.606",
        " line 3: expected '=' after a key in a key/value pair; must be TOML",
    ),
    "key twice": (BEAM, "width =", "length =", " line 4: cannot overwrite a value; must be TOML"),
    "open quote at the end": (
        MODAL,
        '"acceleration"\n',
        '"""acceleration\n',
        " line 20: unterminated string; must be TOML",
    ),
    "number of 5000 digits": (
        BEAM,
        "0.606",
        "1" * 5000,
        ": a number too long or arrays too deep to read; must be a rig file (TOML)",
    ),
    "arrays 5000 deep": (
        BEAM,
        "0.606",
        "[" * 5000,
        ": a number too long or arrays too deep to read; must be a rig file (TOML)",
    ),
    # several things wrong: the first in the file is told
    "two mistakes": (
        BEAM.replace("amplitude = 6.5", "amplitude = -6.5"),
        "mu = 0.52",
        "mu = -0.2",
        ": contact.friction.mu = -0.2; must be > 0",
    ),
    "misspelt beats missing": (
        BEAM.replace("density = 7800.0\n", ""),
        "width =",
        "widht =",
        f": beam.widht is unknown; accepted keys are {BEAM_KEYS}; did you mean width?",
    ),
}


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as refused:
        load_rig(path)
    return str(refused.value)


@pytest.mark.parametrize("case", REFUSED)
def test_refused_in_one_line_that_names_file_key_and_remedy(case: str, tmp_path: Path) -> None:
    base, old, new, message = REFUSED[case]
    assert old in base
    path = tmp_path / "rig.toml"
    path.write_text(base.replace(old, new, 1), encoding="utf-8")
    assert refusal(path) == f"{path}{message}"
    assert "\n" not in message


@pytest.mark.parametrize("content", [b"", b"\n\n", b"# nothing but a comment\n"])
def test_empty_file_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(content)
    assert refusal(path) == f"{path}: is empty; must have name, beam or modal, damping, contact, excitation"


def test_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(b'name = "x"\n# \xff\n')
    assert refusal(path) == f"{path} line 2: byte 0xff; must be UTF-8 text"


def test_missing_file_and_directory_are_refused(tmp_path: Path) -> None:
    missing = tmp_path / "none.toml"
    assert refusal(missing) == f"{missing}: no such file; must be a rig file (TOML)"
    assert refusal(tmp_path) == f"{tmp_path}: is a directory; must be a rig file (TOML)"
    below_a_file = tmp_path / "file" / "rig.toml"
    below_a_file.parent.write_text("")
    assert refusal(below_a_file) == f"{below_a_file}: cannot be read (Not a directory); must be a rig file (TOML)"


def test_beam_file_with_only_required_keys_takes_the_documented_defaults() -> None:
    rig = rig_from_dict(tomllib.loads(BEAM), "rig.toml")
    assert isinstance(rig.body, Beam)
    assert rig.body.modes == 5
    assert (rig.damping.stiffness_proportional, rig.damping.high_mode_ratio, rig.damping.high_mode_from) == (0, 0.02, 6)
    assert rig.damping.modal_ratios is None
    assert rig.contact.load_variation == 1.0
    assert rig.contact.residual_compliance
    assert rig.contact.foreshortening
    assert [c.name for c in rig.channels] == ["force", "a1"]
    assert [c.name for c in rig.response_channels] == ["a1"]


def test_modal_file_becomes_a_modal_rig() -> None:
    rig = rig_from_dict(tomllib.loads(MODAL), "rig.toml")
    assert rig.body == ModalBody((50.0, 120.0), ((1.0, 1.0), (0.5, -0.5)), (2.0, 3.0), (1.0, 1.0))
    assert rig.damping.modal_ratios == (0.01, 0.02)
    assert rig.structure.channel_rows["a1"].tolist() == [0.5, -0.5]
    assert not rig.structure.reaction.varies


def test_one_ratio_serves_all_modes_and_channels_are_optional() -> None:
    text = MODAL[: MODAL.index("[[channels]]")].replace("[0.01, 0.02]", "[0.01]")
    rig = rig_from_dict(tomllib.loads(text.replace("[[1.0, 1.0], [0.5, -0.5]]", "[]")), "rig.toml")
    assert rig.channels == ()
    assert (rig.structure.damping / rig.structure.omega_n).tolist() == pytest.approx([0.02, 0.02], rel=1e-14)


def test_whole_numbers_are_numbers_and_a_byte_order_mark_is_skipped(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(BEAM.replace("7800.0", "7800").replace("mu = 0.52", "mu = 1"), encoding="utf-8-sig")
    rig = load_rig(path)
    assert isinstance(rig.body, Beam)
    assert type(rig.body.density) is float
    assert type(parameters(rig.contact.law)["mu"]) is float


def test_stribeck_exponent_defaults_to_two() -> None:
    rig = rig_from_dict(tomllib.loads(BEAM.replace(PENALTY, STRIBECK)), "rig.toml")
    assert parameters(rig.contact.law)["exponent"] == 2.0


@pytest.mark.parametrize("law", LAWS)
def test_every_law_is_read_and_each_of_its_parameters_checked(law: str) -> None:
    known: dict[str, Parameter] = describe(LAWS[law])
    assert [*known, *settings(LAWS[law])] == [f.name for f in fields(LAWS[law])]
    table = tomllib.loads(BEAM)
    table["contact"]["friction"] = {"law": law} | dict.fromkeys(known, 0.5)
    rig = rig_from_dict(table, "rig.toml")
    assert type(rig.contact.law) is LAWS[law]
    assert parameters(rig.contact.law) == dict.fromkeys(known, 0.5)
    for name, p in known.items():
        table["contact"]["friction"] = {"law": law} | dict.fromkeys(known, 0.5) | {name: p.lower - 1.0}
        with pytest.raises(InputError) as refused:
            rig_from_dict(table, "rig.toml")
        assert str(refused.value) == f"rig.toml: contact.friction.{name} = {p.lower - 1.0}; must be {p.bound}"


def test_settings_are_read_and_arrays_become_tuples() -> None:
    elements = rig_from_dict(tomllib.loads(BEAM.replace(PENALTY, IWAN + "elements = 4\n")), "rig.toml").contact.law
    assert chosen(elements) == {"elements": 4, "distribution": "uniform", "limits": ()}
    limits = rig_from_dict(tomllib.loads(BEAM.replace(PENALTY, IWAN + "limits = [1, 2.5]\n")), "rig.toml").contact.law
    assert chosen(limits) == {"elements": 10, "distribution": "uniform", "limits": (1.0, 2.5)}
    assert limits.states == 2


@dataclass(frozen=True, eq=False)
class Glue:
    """A law of somebody else."""

    name: ClassVar[str] = "glue"
    strength: float = field(metadata=parameter("N", "all there is", "nowhere", lower=2.0, strict=False))


def test_law_added_to_the_table_of_laws_is_read_without_further_ado(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LAWS, "glue", Glue)
    table = tomllib.loads(BEAM)
    table["contact"]["friction"] = {"law": "glue", "strength": 2.0}
    assert isinstance(rig_from_dict(table, "rig.toml").contact.law, Glue)
    table["contact"]["friction"]["strength"] = 1.5
    with pytest.raises(InputError, match=r"^rig\.toml: contact\.friction\.strength = 1\.5; must be >= 2$"):
        rig_from_dict(table, "rig.toml")


def same(a: Rig, b: Rig) -> bool:
    """Whether two rigs agree in everything but their names."""
    plain = [(r.body, r.damping, r.excitation, r.channels) for r in (a, b)]
    laws = [(r.contact.law.name, parameters(r.contact.law)) for r in (a, b)]
    contacts = [[getattr(r.contact, f.name) for f in fields(r.contact) if f.name != "law"] for r in (a, b)]
    return plain[0] == plain[1] and laws[0] == laws[1] and contacts[0] == contacts[1]


@pytest.mark.parametrize(
    ("example", "law"),
    [
        ("paper_beam", PAPER_PENALTY),
        ("paper_beam_lagrange", PAPER_COULOMB),
        ("paper_beam_stribeck", PAPER_STRIBECK),
        ("paper_beam_decay", PAPER_DECAY),
        ("paper_beam_dahl", PAPER_DAHL),
        ("paper_beam_iwan", ASSUMED_IWAN),
    ],
)
def test_examples_are_the_published_parameter_sets(example: str, law) -> None:
    assert same(load_rig(EXAMPLES / f"{example}.toml"), paper_rig(law))


def test_every_example_is_accepted() -> None:
    for path in sorted(EXAMPLES.glob("*.toml")):
        assert load_rig(path, allow_code=True).structure.n >= 1


def test_smallest_example_is_one_damped_mode_at_50_hz() -> None:
    structure = load_rig(EXAMPLES / "one_mode.toml").structure
    assert structure.omega_n / 6.283185307179586 == pytest.approx([50.0], rel=1e-14)
    assert structure.damping == pytest.approx(2 * 0.01 * structure.omega_n, rel=1e-14)


def test_computed_channels_are_those_of_the_curve_files() -> None:
    assert Rig.computed == ("drive", "slip", "slip_velocity", "friction", "normal")  # docs/reference/data_files.md
