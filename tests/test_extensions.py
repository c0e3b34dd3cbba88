"""``[[extensions]]`` tables of rig files: read, refused in one line, written after the nominal text, read back."""

import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hbm import reconstruct
from hbm.channels import turned
from hbm.errors import InputError
from hbm.files.extendedrig import write_extended_rig
from hbm.fourier import FourierBasis
from hbm.inverse.sensing import sensing
from hbm.measurement.spectra import spectra_of
from hbm.rigfiles.extensions import Extension, extended
from hbm.rigfiles.load import load_rig
from hbm.rigfiles.write import extended_rig_text
from models import Rig
from models.attachments import PointMass
from models.causes import CAUSES, all_candidates
from models.causes.friction import DistributedMicroslip, StribeckWeakening
from models.causes.joints import LocalDahl, LocalFriction
from models.causes.parameter import WrongParameter
from models.causes.sensors import SensorDelay, SensorGain, SwappedChannels
from models.elements import ImpactStop, MidplaneStretching, QuadraticDrag
from models.friction import chosen, parameters
from models.parts import Channel, Drift
from tests.inverse.measurement import Truth, measured, respond

NOMINAL = Path(__file__).parents[1] / "examples" / "paper_beam.toml"
TEXT = NOMINAL.read_text(encoding="utf-8")

OWN = """\
from dataclasses import dataclass, replace
from typing import ClassVar

from models.causes import Unknown


@dataclass(frozen=True)
class HeavySupport:
    "A heavier half cylinder presses more."

    name: ClassVar[str] = "heavy-support"
    meaning: ClassVar[str] = "the half cylinder weighs something"
    looks_like: ClassVar[str] = "more friction"
    confused_with: ClassVar[str] = "parameter:contact.normal_load"

    gravity: float = 9.81

    @classmethod
    def candidates(cls, rig):
        yield cls()

    @property
    def label(self):
        return self.name

    def unknowns(self, rig):
        return (Unknown("load", "N", "contact.normal_load", 0.0, 1e3, 83.0, (83.0,)),)

    def extend(self, rig, values):
        return replace(rig, contact=replace(rig.contact, normal_load=values["load"]))
"""


def loaded(folder: Path, tables: str, text: str = TEXT) -> Rig:
    path = folder / "rig.toml"
    path.write_text(f"{text}\n{tables}", encoding="utf-8")
    return load_rig(path, allow_code=True)


def numbers_of(rig: Rig) -> dict[str, Any]:
    """Everything that a rig file or its extensions decide."""
    law = rig.contact.law
    contact = {k: v for k, v in vars(rig.contact).items() if k != "law"}
    return {
        "law": (type(law), parameters(law), chosen(law)),
        "contact": contact,
        "elements": [(type(e), parameters(e)) for e in rig.elements],
        **{name: getattr(rig, name) for name in ("body", "damping", "excitation", "channels", "attachments", "drift")},
    }


# ------------------------------------------------------------------------------------------------------------ reading


def test_extensions_are_applied_in_their_order(tmp_path):
    rig = loaded(
        tmp_path,
        """
        [[extensions]]
        cause = "added-mass"
        mass = 0.005
        position = 0.3
        [[extensions]]
        cause = "parameter:beam.youngs_modulus"
        value = 209e9
        [[extensions]]
        cause = "asymmetric-friction"
        ratio = 1.1
        [[extensions]]
        cause = "viscous-contact"
        coefficient = 20
        [[extensions]]
        cause = "impact-stop"
        gap = -1e-5
        stiffness = 2e4
        position = 0.4
        [[extensions]]
        cause = "quadratic-drag"
        coefficient = 30
        [[extensions]]
        cause = "midplane-stretching"
        axial_stiffness = 1e7
        [[extensions]]
        cause = "sensor-delay"
        channel = "a3"
        delay_s = 2e-5
        [[extensions]]
        cause = "swapped-channels"
        channel = "a5"
        other = "a2"
        [[extensions]]
        cause = "force-distortion"
        [[extensions]]
        cause = "drift"
        parameter = "beam.youngs_modulus"
        rate = -1e-4
        """,
    )
    assert rig.attachments.masses == (PointMass(0.005, 0.3),)
    assert [(type(e), parameters(e)) for e in rig.elements] == [
        (ImpactStop, {"gap": -1e-5, "stiffness": 2e4, "position": 0.4}),
        (QuadraticDrag, {"coefficient": 30.0}),
        (MidplaneStretching, {"axial_stiffness": 1e7}),
    ]
    assert rig.body.youngs_modulus == 209e9
    assert rig.excitation.measured_harmonics and rig.drift == (Drift("beam.youngs_modulus", -1e-4),)
    assert parameters(rig.contact.law) == {"mu": 0.52, "critical_slip": 4.15e-6, "ratio": 1.1, "coefficient": 20.0}
    assert [(c.name, c.position, c.delay) for c in rig.channels[2:6]] == [
        *(("a2", 0.5, 0.0), ("a3", 0.3, 2e-5), ("a4", 0.4, 0.0), ("a5", 0.2, 0.0)),
    ]


def test_an_exponent_is_two_unless_given(tmp_path):
    table = '[[extensions]]\ncause = "stribeck-weakening"\nmu_static = 0.52\nmu = 0.4\nstribeck_velocity = 1e-3\n'
    law = loaded(tmp_path, table).contact.law
    assert parameters(law) == {
        **{"mu_static": 0.52, "mu": 0.4, "stribeck_velocity": 1e-3, "exponent": 2.0},
        "stiffness": pytest.approx(0.52 * 83.0 / 4.15e-6),
    }
    assert parameters(loaded(tmp_path, table + "exponent = 1").contact.law)["exponent"] == 1.0


MASS = 'cause = "added-mass"\nmass = 0.01\nposition = 0.3\n'
EVERY = ", ".join([*(name for name in CAUSES if name != "parameter"), "parameter:<key>, or file.py:Class"])
ACCELEROMETERS = ", ".join(f"sensor-gain a{i}" for i in range(1, 7))
REFUSED = {
    "no cause": ("mass = 0.01", f".cause is missing; must be one of {EVERY}"),
    "a number": ("cause = 3", f".cause = 3; must be one of {EVERY}"),
    "unknown": ('cause = "aded-mass"', f'.cause = "aded-mass"; must be one of {EVERY}; did you mean added-mass?'),
    "too short": ('cause = "parameter"', f'.cause = "parameter"; must be one of {EVERY}'),
    "no such file": ('cause = "x.py:Y"', '.cause = "x.py:Y"; there is no file {folder}/x.py'),
    "no class": ('cause = "x.py"', '.cause = "x.py"; must name a class too, x.py:Class'),
    "missing": ('cause = "added-mass"\nmass = 0.01', ".position is missing; must be >= 6.06e-07 and <= 0.606"),
    "foreign": (MASS + "gain = 2.0", ".gain is unknown; accepted keys are cause, mass, position"),
    "negative": (MASS.replace("0.01", "-0.01"), ".mass = -0.01; must be >= 0 and <= 8.78459"),
    "off the beam": (MASS.replace("0.3", "0.7"), ".position = 0.7; must be >= 6.06e-07 and <= 0.606"),
    "two drags": (
        'cause = "quadratic-drag"\ncoefficient = 3.0\n[[extensions]]\ncause = "quadratic-drag"\ncoefficient = 3.0',
        '[2].cause = "quadratic-drag" (quadratic-drag) does not apply; there is nothing in this rig that it can act on',
    ),
    "a stop that pulls": (
        'cause = "impact-stop"\nstiffness = -1.0\ngap = 1e-4\nposition = 0.4',
        ".stiffness = -1.0; must be >= 0 and <= 1.00173e+09",
    ),
    "text": (MASS.replace("0.3", '"tip"'), '.position = "tip"; must be a number'),
    "truth": (MASS.replace("0.3", "true"), ".position = true; must be a number"),
    "not finite": ('cause = "clamp-rotation"\nstiffness = inf', ".stiffness = inf; must be finite"),
    "no channel": ('cause = "sensor-gain"\ngain = 1.0', ".channel is missing; sensor-gain needs it"),
    "channel of what": ('cause = "sensor-gain"\nchannel = 3', ".channel = 3; must be a text in quotes"),
    "no such channel": (
        'cause = "sensor-gain"\nchannel = "a9"\ngain = 1.0',
        f'.cause = "sensor-gain" (sensor-gain a9) does not apply; must be one of {ACCELEROMETERS}, sensor-gain force',
    ),
    "other law": (
        'cause = "bristle-memory"\nsigma1 = 3.0',
        '.cause = "bristle-memory" (bristle-memory) does not apply; there is nothing in this rig that it can act on',
    ),
    "twice": (
        'cause = "clamp-rotation"\nstiffness = 1e4\n[[extensions]]\ncause = "clamp-rotation"\nstiffness = 1e5',
        '[2].cause = "clamp-rotation" (clamp-rotation) does not apply; there is nothing in this rig that it can act on',
    ),
    "weaker at rest": (
        'cause = "stribeck-weakening"\nmu_static = 0.4\nmu = 0.5\nstribeck_velocity = 1e-3',
        ".mu_static = 0.4; must be >= mu = 0.5",
    ),
    "no such drift": (
        'cause = "drift"\nparameter = "beam.length"\nrate = 1e-4',
        '.cause = "drift" (drift beam.length) does not apply; must be one of drift beam.youngs_modulus, '
        "drift damping.mass_proportional, drift contact.normal_load, drift contact.friction.mu, "
        "drift contact.friction.critical_slip",
    ),
    "distorted twice": (
        'cause = "force-distortion"\n[[extensions]]\ncause = "force-distortion"',
        '[2].cause = "force-distortion" (force-distortion) does not apply; '
        "there is nothing in this rig that it can act on",
    ),
    "no elements": (
        'cause = "distributed-microslip"\nspread = 0.3\nelements = 0',
        ".elements = 0; must be > 0 and <= 200",
    ),
}


@pytest.mark.parametrize("table", REFUSED)
def test_what_is_wrong_is_said_in_one_line(table, tmp_path):
    tables, message = REFUSED[table]
    with pytest.raises(InputError) as refused:
        loaded(tmp_path, f"[[extensions]]\n{tables}")
    place = "" if message.startswith("[") else "[1]"
    assert str(refused.value) == f"{tmp_path}/rig.toml: extensions{place}" + message.format(folder=tmp_path)


def test_a_wrong_key_is_answered_with_those_there_are(tmp_path):
    with pytest.raises(InputError, match=r"must be one of parameter:beam.youngs_modulus, .*critical_slip$"):
        loaded(tmp_path, '[[extensions]]\ncause = "parameter:beam.colour"\nvalue = 1.0')


def test_extensions_are_an_array_of_tables(tmp_path):
    with pytest.raises(InputError, match=r"extensions is a table; must be an array of tables, \[\[extensions\]\]$"):
        loaded(tmp_path, '[extensions]\ncause = "added-mass"')


# ------------------------------------------------------------------------------------------------- a cause of one's own


def test_a_cause_of_ones_own_extends_a_rig(tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    assert loaded(tmp_path, '[[extensions]]\ncause = "own.py:HeavySupport"\nload = 90').contact.normal_load == 90.0


@pytest.mark.parametrize(
    ("there", "instead", "message"),
    [
        (
            "def extend",
            "def extended",
            "HeavySupport in {file} is no cause: it needs a method extend(self, rig, values)",
        ),
        ('"heavy-support"', "3", 'HeavySupport in {file} is no cause: it needs name: ClassVar[str] = "..."'),
        (
            '"heavy-support"',
            '"added-mass"',
            'HeavySupport in {file} is no cause: its name "added-mass" is taken by a cause that comes with the package',
        ),
        (
            "@dataclass(frozen=True)",
            "@dataclass",
            "HeavySupport in {file} is no cause: it must be decorated with @dataclass(frozen=True)",
        ),
        (
            "gravity: float = 9.81",
            "gravity: tuple = ()",
            "HeavySupport in {file} is no cause: its field gravity must be a str, an int or a float",
        ),
        ("HeavySupport", "Heavy", "{file} has no class HeavySupport; it has Heavy"),
        ("class H", "klass H", "{file} line 8: SyntaxError: invalid syntax"),
    ],
)
def test_what_is_no_cause_is_refused(there, instead, message, tmp_path):
    file = tmp_path / "own.py"
    file.write_text(OWN.replace(there, instead))
    with pytest.raises(InputError) as refused:
        loaded(tmp_path, '[[extensions]]\ncause = "own.py:HeavySupport"\nload = 90.0')
    found = 'extensions[1].cause = "own.py:HeavySupport"; '
    assert str(refused.value) == f"{tmp_path}/rig.toml: {found}{message.format(file=file)}"


# ------------------------------------------------------------------------------------------------------------ writing


@pytest.mark.parametrize("nominal", ["paper_beam", "paper_beam_dahl", "one_mode"])
def test_every_cause_is_read_back_as_it_was_written(nominal, tmp_path):
    file = NOMINAL.with_name(f"{nominal}.toml")
    rig = load_rig(file)
    for cause in all_candidates(rig):
        extension = Extension.of(cause, {u.name: u.starts[-1] * (1 - 1e-16) for u in cause.unknowns(rig)})
        path = write_extended_rig(tmp_path / "extended.toml", file, [extension])
        assert numbers_of(load_rig(path)) == numbers_of(extended(rig, [extension])), cause.label
        assert path.read_text(encoding="utf-8").startswith(file.read_text(encoding="utf-8"))


def test_extensions_follow_the_nominal_text_and_can_be_extended_again(tmp_path):
    rig = load_rig(NOMINAL)
    first = [
        Extension.of(StribeckWeakening(exponent=1.0), {"mu_static": 0.55, "mu": 0.5, "stribeck_velocity": 1e-3}),
        Extension.of(SensorGain("a3"), {"gain": -1.0}),
    ]
    text = extended_rig_text(TEXT.rstrip("\n"), first)
    assert text == TEXT.rstrip("\n") + (
        '\n\n[[extensions]]\ncause = "stribeck-weakening"\nexponent = 1.0\nmu_static = 0.55\nmu = 0.5\n'
        'stribeck_velocity = 0.001\n\n[[extensions]]\ncause = "sensor-gain"\nchannel = "a3"\ngain = -1.0\n'
    )
    once = write_extended_rig(tmp_path / "once.toml", NOMINAL, first)
    second = [
        Extension.of(WrongParameter("contact.normal_load"), {"value": 84.0}),
        Extension.of(SwappedChannels("a1", "a3"), {}),
    ]
    twice = write_extended_rig(tmp_path / "twice.toml", once, second)
    assert numbers_of(load_rig(twice)) == numbers_of(extended(rig, [*first, *second]))
    assert len(tomllib.loads(twice.read_text(encoding="utf-8"))["extensions"]) == 4


def test_a_second_joint_at_the_place_of_the_first_is_read_back(tmp_path):
    """Both are of friction; and where the first is, places are named in another order."""
    modal = tmp_path / "modal.toml"
    modal.write_text(
        """
name = "three masses"
[modal]
frequencies_hz = [16.0, 40.0]
ports = { m1 = [0.3, -0.6], m2 = [0.5, -0.1], m3 = [0.7, 0.6] }
[damping]
modal_ratios = [0.003, 0.002]
[excitation]
at = "m1"
amplitude = 1.0
[[channels]]
name = "a3"
quantity = "acceleration"
at = "m3"
"""
    )
    dahl = Extension.of(LocalDahl("m2", "m3"), {"stiffness": 2e3, "limit": 1.0})
    for second in (LocalFriction("m2", "m3"), LocalFriction("m1", "m2"), LocalFriction("m3")):
        friction = Extension.of(second, {"limit": 0.4, "critical_slip": 2e-4})
        write_extended_rig(tmp_path / "extended.toml", modal, [dahl, friction])
        read, made = load_rig(tmp_path / "extended.toml"), extended(load_rig(modal), [dahl, friction])
        assert read.numbers == made.numbers
        assert [(j.at, j.to) for j in read.joints] == [(j.at, j.to) for j in made.joints]


def test_matrices_go_along_with_the_rig_that_names_them(tmp_path):
    """From a folder beside the rig file, by the key of an archive; what has the same name is told apart."""
    model, one, other = tmp_path / "model", tmp_path / "model" / "one", tmp_path / "model" / "other"
    for folder in (one, other):
        folder.mkdir(parents=True)
    np.savez(one / "chain.npz", m=np.diag([1.0, 2.0]))
    np.savez(other / "chain.npz", k=np.array([[2e4, -1e4], [-1e4, 1e4]]))
    (model / "rig.toml").write_text(
        """
name = "two masses"
[matrix]
mass = "one/chain.npz:m"
stiffness = 'other/chain.npz:k'
[damping]
modal_ratios = [0.01]
[excitation]
amplitude = 1.0
at = "2"
[[channels]]
name = "force"
quantity = "force"
at = "2"
[[channels]]
name = "a1"
quantity = "acceleration"
at = "1"
"""
    )
    extension = Extension.of(WrongParameter("damping.modal_ratios[1]"), {"value": 0.02})
    (tmp_path / "found").mkdir()
    path = write_extended_rig(tmp_path / "found" / "extended.toml", model / "rig.toml", [extension])
    shutil.rmtree(model)
    rig = load_rig(path)
    assert sorted(file.name for file in path.parent.iterdir()) == [
        "another_chain.npz",
        "chain.npz",
        "extended.toml",
    ]
    assert rig.number("damping.modal_ratios[1]") == 0.02
    assert rig.structure.omega_n**2 == pytest.approx(1e4 * np.array([1.25 - 17**0.5 / 4, 1.25 + 17**0.5 / 4]))


def test_what_could_not_be_read_is_not_written(tmp_path):
    path = tmp_path / "extended.toml"
    with pytest.raises(InputError, match=r"extended.toml: extensions\[1\].spread = 1.5; must be >= 0 and <= 1$"):
        write_extended_rig(path, NOMINAL, [Extension.of(DistributedMicroslip(), {"spread": 1.5})])
    with pytest.raises(ValueError, match=r"^stiffness = inf; must be finite, leave the extension out$"):
        write_extended_rig(path, NOMINAL, [Extension.of(CAUSES["clamp-rotation"](), {"stiffness": np.inf})])
    assert not path.exists()


# ------------------------------------------------------------------------------------------------------- what it is for


def test_what_a_faulty_sensor_reads_is_divided_out_before_the_contact_is_reconstructed():
    """Faulty readings with an extended rig give what right readings give with the nominal one."""
    nominal = load_rig(NOMINAL)
    theta = 2 * np.pi * np.arange(256) / 256
    truth: Truth = respond(nominal, 50.0, 6.5, 30.0 * np.cos(theta + 1.0) + 4.0 * np.cos(3 * theta))
    spectra = measured(nominal, [(50.0, truth)], {c.name: 0.02 for c in nominal.channels}, 9)
    faults = [Extension.of(SensorGain("a2"), {"gain": 0.8}), Extension.of(SensorDelay("a4"), {"delay_s": 1e-4})]
    faulty = extended(nominal, faults)
    coefficients = {c: spectra.coefficients[:, spectra.index(c)].copy() for c in spectra.channels}
    basis = FourierBasis(9, 64)
    for channel in faulty.channels[1:]:
        coefficients[channel.name][0] = turned(channel, basis, coefficients[channel.name][0], 2 * np.pi * 50.0)
    stds = {c: spectra.std[:, spectra.index(c)] for c in spectra.channels}
    stds["a2"] = 0.8 * stds["a2"]
    readings = spectra_of(faulty, spectra.hz, spectra.level, coefficients, stds)
    right, wrong = reconstruct(nominal, spectra), reconstruct(faulty, readings)
    for name in ("friction", "slip", "normal"):
        a, b = right[name].samples, wrong[name].samples
        assert b == pytest.approx(a, abs=1e-6 * np.abs(a).max()), name


def test_sensing_sees_what_a_channel_reads():
    rig = extended(load_rig(NOMINAL), [Extension.of(SensorDelay("a4"), {"delay_s": 1e-4})])
    hz = np.array([50.0])
    none = {c.name: np.zeros((1, 7)) for c in rig.channels}
    stds = {c.name: np.ones((1, 4)) for c in rig.channels}
    seen = sensing(rig, spectra_of(rig, hz, np.array([6.5]), none, stds)).factor[0, :, 3]
    k = np.arange(4)
    expected = -((2 * np.pi * 50.0 * k) ** 2) * np.exp(-2j * np.pi * 50.0 * k * 1e-4)
    assert seen == pytest.approx(expected, rel=1e-12)
    assert rig.channels[4] == Channel("a4", "acceleration", 0.4, 1.0, 1e-4)
