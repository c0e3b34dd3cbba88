"""A joint that is missing at a place which neither a sensor nor the rig file names.

Structures are a chain of masses given by its matrices, and a beam. Its records come from an independent simulator.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.sparse import csr_array, save_npz

from hbm.diagnosis.diagnose import diagnose
from hbm.diagnosis.discrepancy import discrepancy
from hbm.diagnosis.jointscan import scan
from hbm.diagnosis.unnamed import unnamed_place
from hbm.files.extendedrig import write_extended
from hbm.measurement.spectra import MeasuredSpectra
from hbm.outputerror.evaluation import evaluate
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.model import Model
from hbm.rigfiles.load import load_rig
from models.beam import Beam
from models.bodies import FiniteBeam, LumpedMass, MatrixBody
from models.causes import all_candidates
from models.causes.addedjoint import AddedJoint, naming
from models.causes.joints import LocalSpring
from models.friction import Jenkins
from models.jointed import JointedRig
from models.joints import CubicSpring, Friction, Joint, JointLaw, Stop
from models.parts import Channel, Damping, Excitation
from models.structure import Array
from tests.three_modes import spectra_with_noise
from tests.truth.modal import Modes, accelerations, gap, jenkins, nothing, steady

MASSES, SPRING, RATIO = 9, 4.0e4, 0.01
NAMES = tuple(f"{i}.x" for i in range(1, MASSES + 1))
SENSORS = ("2.x", "5.x", "7.x", "9.x")
MASS = np.diag(np.linspace(0.4, 0.8, MASSES))
STIFFNESS = SPRING * (2.0 * np.eye(MASSES) - np.eye(MASSES, k=1) - np.eye(MASSES, k=-1))
STIFFNESS[-1, -1] = SPRING
SQUARES, SHAPES = eigh(STIFFNESS, MASS)
HZ = np.sqrt(SQUARES) / (2.0 * np.pi)
STOP, CLEARANCE = 1.0e4, 1e-4
H, ALL = 5, 60


def rig_of(*joints: Joint, folder: Path | None = None) -> JointedRig:
    """The rig; as a file in a folder too."""
    body = MatrixBody(csr_array(MASS), csr_array(STIFFNESS), NAMES, MASSES)
    channels = (Channel("force", "force", at="3.x"), *(Channel(f"a{at}", "acceleration", at=at) for at in SENSORS))
    damping = Damping(modal_ratios=(RATIO,) * MASSES)
    if folder is not None:
        save_npz(folder / "m.npz", csr_array(MASS))
        save_npz(folder / "k.npz", csr_array(STIFFNESS))
        tables = "".join(f'[[channels]]\nname="a{at}"\nquantity="acceleration"\nat="{at}"\n' for at in SENSORS)
        (folder / "dofs.txt").write_text("\n".join(NAMES))
        (folder / "rig.toml").write_text(
            f'name="chain"\n[matrix]\nmass="m.npz"\nstiffness="k.npz"\ndofs="dofs.txt"\nmodes={MASSES}\n'
            f'[damping]\nmodal_ratios={[RATIO] * MASSES}\n[excitation]\namplitude=1.0\nat="3.x"\n'
            f'[[channels]]\nname="force"\nquantity="force"\nat="3.x"\n{tables}'
        )
    return JointedRig("chain", body, damping, joints, Excitation(1.0, at="3.x"), channels)


MODES = Modes(HZ, np.full(MASSES, RATIO), dict(zip(NAMES, SHAPES, strict=True)))


@cache
def moving(at: str, stiffness: float = STOP) -> tuple[Array, Array, Array]:
    """Modal harmonics about the first two modes at three levels, a stop at a place; frequencies and forces."""
    near = np.concatenate([HZ[0] * np.array([0.9, 0.97, 1.0, 1.03, 1.1]), HZ[1] * np.array([0.97, 1.0, 1.03])])
    hz, force = np.tile(near, 3), np.repeat([0.2, 0.5, 1.0], len(near))
    law = gap(stiffness, CLEARANCE) if stiffness else nothing
    return steady(MODES, law, MODES.rows[at], "3.x", hz, force, 200, 512, ALL), hz, force


@cache
def measured(at: str, stiffness: float = STOP) -> MeasuredSpectra:
    """Records of that motion."""
    q, hz, force = moving(at, stiffness)
    q = q[:, np.r_[: H + 1, ALL + 1 : ALL + H + 1]]
    seen = {f"a{name}": accelerations(MODES, q, name, hz) for name in SENSORS}
    return spectra_with_noise(rig_of(), seen, hz, force, np.random.default_rng(3), 1e-3)


def test_the_place_of_a_missing_joint_is_found_among_all_degrees_of_freedom():
    """The sentence gives what is left there and at the best place that the rig file names."""
    place = unnamed_place(rig_of(), measured("4.x"))
    assert place is not None and place.at == "4.x"
    assert place.left < 2.0 < 100.0 < place.left_there
    assert place.named in {"3.x", "5.x"}
    assert "4.x" in str(place) and f"{place.left:.3g}" in str(place)
    assert {c.at.removeprefix("-1*") for c in place.joints(None) if not c.to} == {"4.x"}
    assert {c.to for c in place.joints((LocalSpring, "one-sided-stop"))} >= {"", "9.x"}


def test_known_joints_may_do_anything_meanwhile():
    """A stop at 9.x that the rig file has, its stiffness wrong by a factor of a hundred: it is not missing there."""
    rig = rig_of(Joint("known", Stop(100.0 * STOP, CLEARANCE), ("9.x",)))
    assert unnamed_place(rig, measured("9.x")) is None


@pytest.mark.parametrize(("at", "stiffness"), [("5.x", STOP), ("4.x", 0.0)], ids=["named", "null"])
def test_nothing_is_said_where_the_rig_file_names_the_place_or_nothing_is_missing(at: str, stiffness: float):
    assert unnamed_place(rig_of(), measured(at, stiffness)) is None


def test_bodies_whose_other_places_are_not_known_are_left_alone():
    rig = rig_of()
    assert unnamed_place(replace(rig, masses=(LumpedMass("5.x", 0.1),)), measured("4.x")) is None
    held = replace(rig, body=replace(rig.body, modes=4, reduction="craig-bampton"), damping=Damping())
    assert unnamed_place(held, measured("4.x")) is None


@pytest.mark.parametrize(
    "known", [CubicSpring(1e10), Friction(Jenkins(0.4, 1e-5), 5.0)], ids=lambda law: type(law).__name__
)
def test_a_law_is_told_by_the_linear_structure_whatever_the_known_joints_do(known: JointLaw):
    """The rig file has a joint at 9.x that is not there: its own motion tells of no law, that with free forces does."""
    spectra = measured("4.x")
    place = unnamed_place(rig_of(Joint("known", known, ("9.x",))), spectra)
    assert place is not None and place.at == "4.x"
    campaign, _ = campaign_of(place.probed, spectra)
    model = Model(place.probed, {})
    base = evaluate(model, campaign, model.start, {})
    causes = [c for c in all_candidates(place.probed) if isinstance(c, AddedJoint) and not c.to]
    by_model, by_structure = (max(scan(base, campaign, causes, large=x), key=lambda s: s.drop) for x in (False, True))
    assert by_model.cause.label != "one-sided-stop 4.x"
    assert by_structure.cause.label == "one-sided-stop 4.x"
    assert by_structure.starts[0] == pytest.approx(
        {"stiffness": STOP, "gap": CLEARANCE}, rel=0.3
    )  # no mean is measured


@pytest.mark.parametrize(
    "known", [CubicSpring(1e10), Friction(Jenkins(0.4, 1e-5), 5.0)], ids=lambda law: type(law).__name__
)
def test_the_missing_force_beside_free_ones_at_the_joints_is_that_of_the_stop(known: JointLaw):
    """However large the misfit: its place, its harmonics and the motion there, beside those of the simulator."""
    rig, spectra = naming(rig_of(Joint("known", known, ("9.x",))), ["4.x"]), measured("4.x")
    campaign, _ = campaign_of(rig, spectra)
    model = Model(rig, {})
    base = evaluate(model, campaign, model.start, {})
    assert base.chi2 > 1e3 * len(base.white)
    found = discrepancy(base, campaign)
    assert found.two and found.known is not None and found.known.at == "the joint known"
    assert [p.place.name for p in found.alike] == ["4.x"]
    q, hz, _ = moving("4.x")
    assert np.array_equal(found.hz, hz)
    k = np.arange(1, ALL + 1)
    u = q @ MODES.rows["4.x"]
    motion = u[:, 1 : ALL + 1] - 1j * u[:, ALL + 1 :]
    phase = 2.0 * np.pi * np.arange(4096) / 4096
    waves = u[:, :1] + np.real(motion @ np.exp(1j * np.outer(k, phase)))
    force = 2.0 * np.fft.rfft(-STOP * np.maximum(waves - CLEARANCE, 0.0))[:, k] / len(phase)
    pulls = np.abs(found.best.force - force[:, :H]) / found.best.std  # of two normal numbers each
    assert 0.7 < np.sqrt(np.mean(pulls**2) / 2.0) < 1.4
    assert np.abs(found.best.seen - motion[:, :H]).max() < 0.01 * np.abs(motion).max()
    assert np.abs(force).max() > 100.0 * found.best.std.max()


def test_what_is_missing_at_a_known_joint_is_told_beside_its_law():
    """Stops on both sides in parallel with friction that the rig file has there: no force elsewhere is missing."""
    pad, limit = Friction(Jenkins(0.4, 1e-4), 1.0), 0.4
    rub, stop = jenkins(limit / 1e-4, limit), gap(STOP, CLEARANCE)

    def both(u: Array, v: Array, z: Array) -> tuple[Array, Array]:
        rubbed, kept = rub(u, v, z)
        return rubbed + stop(u, v, z)[0] - stop(-u, v, z)[0], kept

    _, hz, force = moving("5.x")
    q = steady(MODES, both, MODES.rows["5.x"], "3.x", hz, force, 200, 512, H)
    rig = rig_of(Joint("pad", pad, ("5.x",)))
    seen = {f"a{name}": accelerations(MODES, q, name, hz) for name in SENSORS}
    spectra = spectra_with_noise(rig, seen, hz, force, np.random.default_rng(3), 1e-3)
    campaign, _ = campaign_of(rig, spectra)
    model = Model(rig, {})
    base = evaluate(model, campaign, model.start, {})
    found = discrepancy(base, campaign)
    assert found.best.place.name == "5.x" and not found.two
    causes = [c for c in all_candidates(rig) if isinstance(c, AddedJoint)]
    scores = {s.cause.label: s for s in scan(base, campaign, causes, large=True)}
    best, same = scores["two-sided-stop 5.x"], "backlash 5.x"  # whose friction never slides
    assert best.drop > 0.99 * scores[same].drop > max(s.drop for s in scores.values() if s not in (best, scores[same]))
    assert best.starts[0] == pytest.approx({"stiffness": STOP, "gap": CLEARANCE}, rel=0.05)


def test_a_stop_at_such_a_place_is_named_with_its_numbers(tmp_path: Path):
    """And written: the extended rig file names the place, and is loaded again."""
    rig_of(folder=tmp_path)
    rig = load_rig(tmp_path / "rig.toml")
    found = diagnose(rig, measured("4.x"), held_out=(), causes=("local-spring", "one-sided-stop"))
    assert (found.verdict, found.cause) == ("cause-found", "one-sided-stop"), found
    assert found.parameters["at"].value == "4.x"
    for name, true in (("stiffness", STOP), ("gap", CLEARANCE)):
        assert abs(found.parameters[name].value - true) < 3.0 * found.parameters[name].std + 0.01 * true
    assert any("4.x, which the rig file does not name" in line for line in found.evidence)
    again = load_rig(write_extended(tmp_path / "extended.toml", tmp_path / "rig.toml", found))
    assert "4.x" in again.places and [c.name for c in again.channels] == [c.name for c in rig.channels]


BEAM, AT, BEAM_RATIO = Beam(0.6, 0.03, 0.005, 210e9, 7800.0, 8), 0.2137, 0.03
ALONG = (0.15, 0.28, 0.42, 0.6)


def beam_rig(*joints: Joint) -> JointedRig:
    """A clamped beam, its sensors along it."""
    channels = (Channel("force", "force", position=0.5), *(Channel(f"a{x}", "acceleration", position=x) for x in ALONG))
    damping = Damping(modal_ratios=(BEAM_RATIO,) * BEAM.modes)
    return JointedRig(
        "beam", FiniteBeam(BEAM, "clamped", "free"), damping, joints, Excitation(1.0, position=0.5), channels
    )


@cache
def of_beam(at: float = AT) -> MeasuredSpectra:
    """Records of 20 modes of the beam in closed form, a stop at a place of it."""
    L, count = BEAM.length, 20
    z = np.array(
        [brentq(lambda z: np.cos(z) + 1.0 / np.cosh(z), (i + 0.4) * np.pi, (i + 0.6) * np.pi) for i in range(count)]
    )
    # cosh - cos - sigma (sinh - sin), without the difference of what grows
    rest = (np.sin(z) - np.cos(z) - np.exp(-z)) / (np.sinh(z) + np.sin(z))

    def row(x: float) -> Array:
        b = z * x / L
        shape = 0.5 * (rest * np.exp(b) + (2.0 - rest) * np.exp(-b)) - np.cos(b) + (1.0 - rest) * np.sin(b)
        return np.asarray(shape / np.sqrt(BEAM.mass_per_length * L))

    hz = (z / L) ** 2 * np.sqrt(BEAM.bending_stiffness / BEAM.mass_per_length) / (2.0 * np.pi)
    modes = Modes(hz, np.full(count, BEAM_RATIO), {f"{x}": row(x) for x in (at, 0.5, *ALONG)})
    near = np.concatenate([hz[0] * np.array([0.9, 0.97, 1.0, 1.03, 1.1]), hz[1] * np.array([0.97, 1.0, 1.03])])
    drive, force = np.tile(near, 3), np.repeat([0.2, 0.5, 1.0], len(near))
    q = steady(modes, gap(2e3, 1e-4), modes.rows[f"{at}"], "0.5", drive, force, 300, 512, H)
    seen = {f"a{x}": accelerations(modes, q, f"{x}", drive) for x in ALONG}
    return spectra_with_noise(beam_rig(), seen, drive, force, np.random.default_rng(3), 1e-3)


@pytest.mark.parametrize("joints", [(), (Joint("known", CubicSpring(1e8), ("y(0.6)",)),)], ids=["bare", "known"])
def test_along_a_beam_the_place_is_found_to_its_standard_deviation(joints: tuple[Joint, ...]):
    """Between the places that are tried; a known joint at the tip may do anything meanwhile."""
    place = unnamed_place(beam_rig(*joints), of_beam())
    assert place is not None and place.left < 1.3 < place.left_there
    found = float(place.at.removeprefix("y(").removesuffix(")"))
    assert 0.0 < place.std < 0.004
    assert abs(found - AT) < 3.0 * place.std
    assert f"known to {1e3 * place.std:.2g} mm" in str(place)


def test_along_a_beam_nothing_is_said_of_a_place_that_is_named():
    assert unnamed_place(beam_rig(), of_beam(0.28)) is None


def test_a_joint_may_be_added_anywhere_on_a_body(tmp_path: Path):
    """A place of the body that the rig file does not name; what is no place of it is refused as before."""
    rig_of(folder=tmp_path)
    text = (tmp_path / "rig.toml").read_text()
    table = '[[extensions]]\ncause="local-spring"\nat="{}"\nstiffness=100.0\n'
    (tmp_path / "there.toml").write_text(text + table.format("4.x"))
    assert load_rig(tmp_path / "there.toml").joints[0].at == ("4.x",)
    assert max(LocalSpring("4.x").unknowns(rig_of())[0].starts) > 0.0
    (tmp_path / "nowhere.toml").write_text(text + table.format("12.x"))
    with pytest.raises(ValueError, match=r"local-spring 12\.x\) does not apply; must be one of local-spring"):
        load_rig(tmp_path / "nowhere.toml")
