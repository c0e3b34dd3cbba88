"""Every cause of the catalogue: nothing at its neutral value, exact derivatives, balanced work; and the truth."""

import pickle
import sys
from collections.abc import Mapping
from dataclasses import replace
from math import isfinite, isinf
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "hbm"))
from rigs import beam

from continuation import NewtonSettings, solve_at
from hbm import sensitivities
from hbm.balance.padding import pad
from hbm.balance.problem import HarmonicBalance
from hbm.balance.solution import PeriodicSolution, describe
from hbm.integration import integrate
from hbm.integration.handover import state_at_phase_zero
from hbm.response.loop import friction_loop
from hbm.response.trace import steady_state
from models import Dahl, FrictionLaw, Frictionless, Iwan, Jenkins, LuGre, ModalBody, Rig, Stribeck, Viscous
from models.causes import CAUSES, Cause, all_candidates
from models.causes.joints import JOINT_CAUSES
from models.causes.pressing import NormalContact
from models.causes.sensors import SensorDelay, SensorGain, SwappedChannels
from models.friction import chosen, parameters
from models.friction.extended import (
    BESIDE_DASHPOT,
    DampedDahl,
    DistributedJenkins,
    WeakeningJenkins,
    asymmetric,
    beside_dashpot,
)
from tests.truth import (
    AddedMass,
    ClampRotation,
    Coulomb,
    Parallel,
    Record,
    Settings,
    TrueRig,
    simulate_records,
    table_1,
)
from tests.truth import Iwan as TrueIwan
from tests.truth import Stribeck as TrueStribeck
from tests.truth import SupportFlexibility as TrueSupportFlexibility
from tests.truth import Viscous as TrueViscous
from tests.truth.measure import read

PENALTY, DAHL = Jenkins(mu=0.52, critical_slip=4.15e-6), Dahl(mu=0.5, stiffness=1.003e7)
HZ, H, SAMPLES = 49.0, 9, 128
NOMINAL = {
    "penalty": beam(PENALTY),
    "constant load": beam(PENALTY, load_variation=0.0),
    "dahl": beam(DAHL),
}

# what each cause may well be, by its label: (rig, values)
SIZES: dict[str, tuple[str, dict[str, float]]] = {
    "stribeck-weakening": ("penalty", {"mu_static": 0.55, "mu": 0.48, "stribeck_velocity": 2e-3}),
    "distributed-microslip": ("penalty", {"spread": 0.4}),
    "viscous-contact": ("penalty", {"coefficient": 60.0}),
    "asymmetric-friction": ("penalty", {"ratio": 1.1}),
    "bristle-memory": ("dahl", {"sigma1": 200.0}),
    "variable-normal-load": ("constant load", {"scale": 0.6}),
    "clamp-rotation": ("penalty", {"stiffness": 5e3}),
    "clamp-friction": ("penalty", {"stiffness": 5e3, "limit": 0.8}),
    "support-rotation-spring": ("penalty", {"stiffness": 5.0}),
    "support-flexibility": ("penalty", {"stiffness": 1e6}),
    "stiffness-damping": ("penalty", {"beta": 2e-6}),
    "added-mass": ("penalty", {"mass": 0.01, "position": 0.4}),
    "added-spring": ("penalty", {"stiffness": 100.0, "position": 0.4}),
    "attached-resonator": ("penalty", {"mass": 0.01, "frequency_hz": 70.0, "position": 0.4}),
    "midplane-stretching": ("penalty", {"axial_stiffness": 1e8}),
    "quadratic-drag": ("penalty", {"coefficient": 5.0}),
    "impact-stop": ("penalty", {"stiffness": 50.0, "gap": 3e-4, "position": 0.4}),
    "sensor-gain a3": ("penalty", {"gain": 0.97}),
    "sensor-delay a3": ("penalty", {"delay_s": 1e-4}),
    "sensor-position a3": ("penalty", {"position": 0.31}),
    "parameter:beam.youngs_modulus": ("penalty", {"value": 209e9}),
    "parameter:beam.density": ("penalty", {"value": 7810.0}),
    "parameter:beam.length": ("penalty", {"value": 0.6055}),
    "parameter:beam.thickness": ("penalty", {"value": 0.00479}),
    "parameter:contact.radius": ("penalty", {"value": 0.0051}),
    "parameter:contact.normal_load": ("penalty", {"value": 84.0}),
    "parameter:damping.mass_proportional": ("penalty", {"value": 0.7}),
    "parameter:excitation.position": ("penalty", {"value": 0.553}),
    "parameter:contact.friction.mu": ("penalty", {"value": 0.53}),
    "parameter:contact.friction.critical_slip": ("penalty", {"value": 4.3e-6}),
}
LABELS = list(SIZES)


def cause_of(label: str) -> tuple[Rig, Cause, dict[str, float]]:
    kind, values = SIZES[label]
    return NOMINAL[kind], next(c for c in all_candidates(NOMINAL[kind]) if c.label == label), values


def resolved(rig: Rig, near: PeriodicSolution) -> PeriodicSolution:
    """Solution to rounding, from a near one."""
    problem = HarmonicBalance(rig, near.basis, level=near.level)
    lam = problem.lam_at(near.hz)
    result = solve_at(problem, pad(problem, near.state), lam, NewtonSettings(tolerance=1e-13, max_iterations=12))
    assert result.residual_norm < 5e-12
    return describe(problem, result.x, lam)


@pytest.fixture(scope="module")
def solutions() -> dict[str, PeriodicSolution]:
    found = {name: steady_state(rig, HZ, harmonics=H, samples=SAMPLES) for name, rig in NOMINAL.items()}
    return {name: resolved(NOMINAL[name], s) for name, s in found.items()}


def away(a: PeriodicSolution, b: PeriodicSolution) -> float:
    """Largest difference of two solutions, each channel relative to its peak."""
    return max(float(np.abs(a[n].samples - c.samples).max()) / c.peak for n, c in b.channels.items())


# ---- what is offered


def test_every_cause_is_tried_here():
    tried = {type(cause_of(label)[1]).name for label in LABELS}
    # a rig alone does not show them: tests/diagnosis/test_records.py, test_transients.py, test_contact_loss.py
    of_records = {"force-distortion", "drift", "not-steady", "contact-loss"}
    # tests/diagnosis/test_joint_causes.py, test_normal_contact.py
    of_joints = {cause.name for cause in (*JOINT_CAUSES, NormalContact)}
    assert tried == set(CAUSES) - {"swapped-channels"} - of_records - of_joints
    parameters_tried = {label for label in LABELS if label.startswith("parameter:")}
    assert parameters_tried == {c.label for c in CAUSES["parameter"].candidates(NOMINAL["penalty"])}


@pytest.mark.parametrize("rig", NOMINAL.values(), ids=NOMINAL)
def test_candidates_say_what_they_are_and_have_starts_within_their_bounds(rig):
    labels = [c.label for c in all_candidates(rig)]
    assert len(labels) == len(set(labels))
    for cause in all_candidates(rig):
        assert cause.meaning and cause.looks_like and cause.confused_with
        for u in cause.unknowns(rig):
            assert u.shapes or u.lower <= u.neutral <= u.upper
            assert u.starts and all(isfinite(s) and u.lower <= s <= u.upper for s in u.starts), cause.label
        for i in range(max((len(u.starts) for u in cause.unknowns(rig)), default=1)):
            values = {u.name: u.starts[min(i, len(u.starts) - 1)] for u in cause.unknowns(rig)}
            extended = cause.extend(rig, values)
            assert {u.name: extended.number(u.key) / u.times for u in cause.unknowns(rig)} == values


def test_nothing_is_offered_where_it_makes_no_sense():
    body = ModalBody((50.0, 80.0), ((1.0, 2.0), (1.0, -2.0), (0.0, 1.0)), (0.1, 0.2), (1.0, 1.0))
    channels = tuple(replace(c, position=0.0) for c in NOMINAL["penalty"].channels[:3])
    modal = replace(NOMINAL["penalty"], body=body, channels=channels)
    assert {type(c).name for c in all_candidates(modal)} == {
        *("stribeck-weakening", "distributed-microslip", "viscous-contact", "asymmetric-friction"),
        *("stiffness-damping", "sensor-gain", "sensor-delay", "swapped-channels", "parameter"),
        *("force-distortion", "not-steady", "drift"),
    }
    swapped = SwappedChannels("a1", "a2").extend(modal, {})
    assert swapped.structure.channel_rows["a1"].tolist() == modal.structure.channel_rows["a2"].tolist()
    sliding = {type(c).name for c in all_candidates(beam(Frictionless()))}
    assert "viscous-contact" in sliding
    assert not sliding & {"stribeck-weakening", "asymmetric-friction", "variable-normal-load", "bristle-memory"}
    once = ("clamp-rotation", "viscous-contact", "asymmetric-friction", "support-flexibility")
    for label in (*once, "midplane-stretching", "quadratic-drag"):
        rig, cause, values = cause_of(label)
        assert cause not in list(all_candidates(cause.extend(rig, values)))
    rig, cause, values = cause_of("added-mass")
    twice = cause.extend(cause.extend(rig, values), {"mass": 0.02, "position": 0.2})
    assert [m.mass for m in twice.attachments.masses] == [0.01, 0.02]


def test_numbers_of_a_rig_are_found_and_changed_by_their_keys():
    rig, cause, values = cause_of("attached-resonator")
    rig = cause.extend(rig, values)
    for _, more, of in (cause_of("midplane-stretching"), cause_of("impact-stop")):
        rig = more.extend(rig, of)
    lists = ("attachments.resonators[0].mass", "elements[0].axial_stiffness", "elements[1].gap")
    for key in ("beam.length", "channels.a3.gain", "contact.friction.mu", *lists):
        assert rig.with_number(key, 0.625).number(key) == 0.625
    none = ("attachments.resonators[1].mass", "elements[0].gap", "elements[2].gap", "elements.gap")
    for key in ("beam.colour", "channels.a9.gain", *none, "contact.law", "beam", "x.y"):
        with pytest.raises(KeyError, match="is not a number of the rig"):
            rig.number(key)


# ---- at the neutral value


@pytest.mark.parametrize("label", LABELS)
def test_a_neutral_cause_changes_nothing(label, solutions):
    """Where it is infinite: what is left of it falls in proportion, and is gone at the first start but for 1e-4."""
    rig, cause, _ = cause_of(label)
    nominal, unknowns = solutions[SIZES[label][0]], cause.unknowns(rig)
    if not any(isinf(u.neutral) for u in unknowns):
        same = resolved(cause.extend(rig, {u.name: u.starts[0] if u.shapes else u.neutral for u in unknowns}), nominal)
        assert away(same, nominal) < 1e-9
        return
    starts = [{u.name: k * u.starts[0] for u in unknowns} for k in (1e-3, 1e-2, 1.0)]
    left = [away(resolved(cause.extend(rig, values), nominal), nominal) for values in starts]
    assert left[1] == pytest.approx(left[0] / 10, rel=0.05)
    assert left[2] < 1e-4


def test_the_first_starts_change_hardly_anything(solutions):
    """Much less than noise, 60 dB is 1e-3; but for the spread, of whose square alone something is seen."""
    for label in LABELS:
        rig, cause, _ = cause_of(label)
        nominal = solutions[SIZES[label][0]]
        started = resolved(cause.extend(rig, {u.name: u.starts[0] for u in cause.unknowns(rig)}), nominal)
        assert away(started, nominal) < (1e-2 if label == "distributed-microslip" else 5e-4), label


# ---- derivatives and work


def followed(rig: Rig, cause: Cause, start: Mapping[str, float], end: Mapping[str, float], near: PeriodicSolution):
    """Solution at the end of a straight way from one set of values to another."""
    for share in (0.25, 0.5, 0.75, 1.0):
        values = {name: start[name] + share * (end[name] - start[name]) for name in end}
        near = resolved(cause.extend(rig, values), near)
    return near


@pytest.mark.parametrize("label", LABELS)
def test_derivatives_are_those_of_neighbouring_solutions_and_work_is_balanced(label, solutions):
    """Of each parameter alone: the remainder of the first-order Taylor series falls with the square of the step."""
    rig, cause, values = cause_of(label)
    unknowns = cause.unknowns(rig)
    nominal = solutions[SIZES[label][0]]
    begin = {u.name: 20 * values[u.name] if isinf(u.neutral) else u.starts[0] for u in unknowns}
    here = followed(rig, cause, begin, values, nominal)
    assert abs(here.energy_error) < 1e-6
    extended = cause.extend(rig, values)
    s = sensitivities(extended, here, [u.key for u in unknowns])
    assert s.units == tuple(u.unit for u in unknowns)
    for i, u in enumerate(unknowns):
        assert extended.number(u.key) == values[u.name]
        size = values[u.name]
        left = []
        for step in (2e-5, 1e-5):
            moved = resolved(cause.extend(rig, {**values, u.name: size * (1 + step)}), here)
            left.append(
                {
                    n: np.abs(moved[n].coefficients - c.coefficients - step * size * s[n].coefficients[:, i]).max()
                    / c.peak
                    for n, c in here.channels.items()
                }
            )
            changes = [np.abs(moved[n].coefficients - c.coefficients).max() / c.peak for n, c in here.channels.items()]
            assert max(changes) > 1e-10  # it acts
        for n in here.channels:
            assert left[1][n] < max(left[0][n] / 3.5, 2e-12), (u.name, n)


@pytest.mark.parametrize("label", [label for label in LABELS if not set(SIZES[label][1]) & {"stiffness"}])
def test_the_first_start_serves_the_score_test(label, solutions):
    """The derivative along the way from the first start is that of solutions on it, even where it starts at a bound."""
    rig, cause, values = cause_of(label)
    unknowns = cause.unknowns(rig)
    begin = {u.name: u.starts[0] for u in unknowns}
    here = resolved(cause.extend(rig, begin), solutions[SIZES[label][0]])
    s = sensitivities(cause.extend(rig, begin), here, [u.key for u in unknowns])
    way = np.array([values[u.name] - begin[u.name] for u in unknowns])
    left = []
    for step in (2e-5, 1e-5):
        moved = resolved(cause.extend(rig, {n: v + step * (values[n] - v) for n, v in begin.items()}), here)
        away_from = {n: moved[n].coefficients - c.coefficients for n, c in here.channels.items()}
        assert max(np.abs(d).max() / here[n].peak for n, d in away_from.items()) > 1e-10  # it acts
        left.append({n: np.abs(d - step * s[n].coefficients @ way).max() / here[n].peak for n, d in away_from.items()})
    for n in here.channels:
        assert left[1][n] < max(left[0][n] / 3.5, 2e-12), n


def test_swapped_channels_read_each_other(solutions):
    rig, nominal = NOMINAL["penalty"], solutions["penalty"]
    swapped = resolved(SwappedChannels("a2", "a5").extend(rig, {}), nominal)
    for name, other in (("a2", "a5"), ("a5", "a2"), ("a1", "a1"), ("slip", "slip")):
        assert swapped[name].samples == pytest.approx(nominal[other].samples, abs=1e-12 * nominal[other].peak)


def test_a_late_weak_sensor_reads_less_later(solutions):
    """A delay of whole samples is a shift of them."""
    rig, nominal = NOMINAL["penalty"], solutions["penalty"]
    late = SensorDelay("a3").extend(rig, {"delay_s": 3 / SAMPLES / HZ})
    both = resolved(SensorGain("a3").extend(late, {"gain": -0.5}), nominal)
    assert both["a3"].samples == pytest.approx(-0.5 * np.roll(nominal["a3"].samples, 3), abs=1e-11 * nominal["a3"].peak)
    assert both["a2"].samples == pytest.approx(nominal["a2"].samples, abs=1e-12 * nominal["a2"].peak)
    s = sensitivities(late, resolved(late, nominal), ["frequency_hz"])
    up, down = (
        steady_state(late, HZ + moved, harmonics=H, samples=SAMPLES, start=nominal)["a3"].coefficients
        for moved in (1e-4, -1e-4)
    )
    assert s["a3"].coefficients[:, 0] == pytest.approx((up - down) / 2e-4, abs=1e-4 * np.abs(up - down).max() / 2e-4)


# ---- the laws


def remade(maker, law: FrictionLaw, **more: float) -> FrictionLaw:
    return maker(type(law))(**parameters(law), **chosen(law), **more)


EXTENDED = {
    law.name: law
    for law in (
        remade(beside_dashpot, PENALTY, coefficient=200.0),
        remade(asymmetric, PENALTY, ratio=1.3),
        remade(asymmetric, Iwan(mu=0.5, stiffness=1e7, spread=0.6, elements=4), ratio=0.8),
        remade(beside_dashpot, LuGre(0.5, 0.48, 1e-3, 1e7, 100.0, 0.0), coefficient=100.0),
        DistributedJenkins(mu=0.52, critical_slip=4.15e-6, spread=0.6, elements=4),
        WeakeningJenkins(mu_static=0.52, mu=0.48, stribeck_velocity=2e-3, stiffness=1e7),
        DampedDahl(mu=0.5, stiffness=1e7, bristle_damping=200.0),
        remade(beside_dashpot, remade(asymmetric, PENALTY, ratio=1.3), coefficient=100.0),
    )
}


@pytest.mark.parametrize("law", EXTENDED.values(), ids=EXTENDED)
def test_time_integration_finds_the_same_steady_state(law):
    """At 52 Hz; the first nine harmonics to 2e-3 of the largest, what 21 harmonics and 512 steps leave."""
    rig = beam(law)
    balanced = steady_state(rig, 52.0, harmonics=21, samples=256)
    marched = integrate.steady_state(rig, 52.0, steps_per_period=512, start=state_at_phase_zero(balanced))
    assert marched.converged
    for channel in ("drive", "slip", "friction", "normal", "a1"):
        theirs = balanced[channel].coefficients[[*range(10), *range(22, 31)]]
        ours = marched.history.coefficients(channel, 9)
        first = int(channel == "a1")  # an acceleration has no mean
        assert ours[first:] == pytest.approx(theirs[first:], abs=2e-3 * np.abs(ours[1:]).max()), channel


@pytest.mark.parametrize("law", EXTENDED.values(), ids=EXTENDED)
def test_extended_laws_can_be_sent_to_another_process(law):
    sent = pickle.loads(pickle.dumps(law))
    assert type(sent) is type(law) and parameters(sent) == parameters(law) and chosen(sent) == chosen(law)


def test_an_asymmetric_loop_has_the_limits_and_the_area_of_its_closed_form():
    """Between -mu_f P and mu_b P; spring in series: (mu_f + mu_b) P (2 U - (mu_f + mu_b) P / k)."""
    U, P, ratio = 2e-5, 80.0, 1.5
    loop = friction_loop(remade(asymmetric, Jenkins(mu=0.5, critical_slip=4e-6), ratio=ratio), U, 50.0, load=P)
    assert loop.T.max() == pytest.approx(0.4 * P, rel=1e-12)
    assert loop.T.min() == pytest.approx(-0.6 * P, rel=1e-12)
    assert loop.v[loop.T < -0.59999 * P].max() >= 0.0  # forward is v > 0
    k = 0.5 * P / 4e-6
    assert loop.dissipated == pytest.approx(P * (2 * U - P / k), rel=1e-4)


def test_a_dashpot_adds_its_force_and_its_loss():
    """Without compliance T = T_law - c v; with it in series with a stuck contact, a Kelvin element behind a spring."""
    law, c, U, hz = PENALTY, 500.0, 2e-5, 50.0
    alone = friction_loop(law, U, hz, load=83.0)
    both = friction_loop(remade(beside_dashpot, law, coefficient=c), U, hz, load=83.0)
    assert both.T == pytest.approx(alone.T - c * alone.v, abs=1e-10)
    assert both.dissipated - alone.dissipated == pytest.approx(np.pi * c * 2 * np.pi * hz * U**2, rel=1e-4)
    C, small = 1e-7, 1e-7
    stuck = friction_loop(remade(beside_dashpot, law, coefficient=c), small, hz, load=83.0, compliance=C, samples=4096)
    k = 0.52 * 83.0 / 4.15e-6 + 2j * np.pi * hz * c
    first = 2 * np.fft.fft(stuck.T)[1] / 4096
    assert first == pytest.approx(-small * k / (1 + k * C), rel=2e-4)  # dT/dt is a backward difference


def test_a_dashpot_goes_beside_laws_that_need_nothing_of_the_force_before():
    assert Viscous not in BESIDE_DASHPOT
    for law in (PENALTY, Stribeck(0.55, 0.5, 2e-3, critical_slip=4e-6), DAHL):
        plain, beside = (
            steady_state(beam(of), HZ, harmonics=5) for of in (law, remade(beside_dashpot, law, coefficient=0.0))
        )
        assert away(beside, plain) < 1e-9


# ---- against the independent simulator

TRUE = table_1(Coulomb(mu=0.52, critical_slip=4.15e-6))
LATE = tuple(replace(s, delay=2e-4) if s.name == "a3" else s for s in TRUE.sensors)
HIDDEN: dict[str, tuple[TrueRig, Cause, dict[str, float]]] = {
    "added-mass": (
        replace(TRUE, effects=(AddedMass(0.01, 0.3),)),
        CAUSES["added-mass"](),
        {"mass": 0.01, "position": 0.3},
    ),
    "clamp-rotation": (
        replace(TRUE, effects=(ClampRotation(1e4),)),
        CAUSES["clamp-rotation"](),
        {"stiffness": 1e4},
    ),
    "viscous-contact": (
        replace(TRUE, law=Parallel((TRUE.law, TrueViscous(100.0)))),
        CAUSES["viscous-contact"](),
        {"coefficient": 100.0},
    ),
    "asymmetric-friction": (
        replace(TRUE, law=Coulomb(0.52, 4.15e-6, ratio=1.3)),
        CAUSES["asymmetric-friction"](),
        {"ratio": 1.3},
    ),
    "stribeck-weakening": (
        replace(TRUE, law=TrueStribeck(0.55, 0.48, 2e-2, critical_slip=0.55 / 0.52 * 4.15e-6)),
        CAUSES["stribeck-weakening"](),
        {"mu_static": 0.55, "mu": 0.48, "stribeck_velocity": 2e-2},
    ),
    "distributed-microslip": (
        replace(TRUE, law=TrueIwan(0.52, 0.52 * 83.0 / 4.15e-6, spread=1.0)),
        CAUSES["distributed-microslip"](),
        {"spread": 1.0},
    ),
    "support-flexibility": (
        replace(TRUE, effects=(TrueSupportFlexibility(1e6),)),
        CAUSES["support-flexibility"](),
        {"stiffness": 1e6},
    ),
    "sensor-delay": (replace(TRUE, sensors=LATE), SensorDelay("a3"), {"delay_s": 2e-4}),
}


@pytest.mark.parametrize("name", HIDDEN)
def test_extended_rigs_respond_as_the_true_ones(name):
    """Harmonics 1 to 9 of all accelerometers, to 0.3 % of the largest, where the nominal rig misses 2 % or more."""
    true, cause, values = HIDDEN[name]
    hz = (47.0, 56.0) if name == "clamp-rotation" else (49.0, 57.5)  # about as far from the top of the resonance
    records = [Record(6.5, hz[0]), Record(4.0, hz[1])]
    quick = Settings(ramp=15, hold=5, coarse=128, tolerance=1e-7)
    truth = simulate_records(true, records, 256, quick)
    assert truth.usable.all()
    names, measured = read(truth, 9)
    nominal, missed = beam(PENALTY, modes=10), []
    many = 31 if name == "stribeck-weakening" else 21  # harmonics: friction that falls is abrupt
    for i, record in enumerate(records):
        expected = measured[i, 1:, 1:]
        for rig in (cause.extend(nominal, values), nominal):
            s = steady_state(rig, record.hz, level=record.level, harmonics=many, samples=512)
            found = np.array([s[n].coefficients[1:10] + 1j * s[n].coefficients[many + 1 :][:9] for n in names[1:]])
            missed.append(np.abs(found - expected).max() / np.abs(expected).max())
    assert max(missed[::2]) < 3e-3
    assert max(missed[1::2]) > 2e-2
