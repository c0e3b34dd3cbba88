"""What cannot be is refused where it is made, in one line with the number and what is accepted."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import hbm
from hbm import linear_modes, sensitivities, steady_state
from hbm.errors import InputError
from models import LAWS, Beam, Channel, Damping, Excitation, Jenkins, ModalBody, describe
from models.friction import parameters
from models.published import paper_rig

RIG = paper_rig()
LAW = RIG.contact.law
FOUR = (1.0, 1.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Jenkins(mu=-1.0, critical_slip=4e-6), "Jenkins: mu = -1; must be > 0"),
        (lambda: Jenkins(mu=0.5, critical_slip=np.nan), "Jenkins: critical_slip = nan; must be > 0"),
        (lambda: replace(RIG.contact, normal_load=-5.0), "Contact: normal_load = -5; must be >= 0"),
        (lambda: replace(RIG.contact, radius=np.inf), "Contact: radius = inf; must be >= 0"),
        (lambda: replace(RIG.body, length=-1.0), "Beam: length = -1; must be > 0"),
        (lambda: replace(RIG.body, modes=0), "Beam: modes = 0; must be >= 1"),
        (lambda: Damping(mass_proportional=-0.1), "Damping: mass_proportional = -0.1; must be >= 0"),
        (
            lambda: Damping(mass_proportional=3.0, modal_ratios=(0.01,)),
            "Damping: modal_ratios and mass_proportional are both given; must have one of them",
        ),
        (lambda: Excitation(-6.5), "Excitation: amplitude = -6.5; must be >= 0"),
        (lambda: Channel("a", "jerk"), 'Channel: quantity = "jerk"; must be one of force, acceleration'),
        (lambda: Channel("a", "velocity", gain=np.inf), "Channel a: gain = inf; must be finite"),
        (
            lambda: replace(RIG, channels=(Channel("a9", "acceleration", 99.0),)),
            "Channel a9: position = 99; must be >= 0 and <= 0.606",
        ),
        (
            lambda: replace(RIG, excitation=replace(RIG.excitation, position=5.0)),
            "Excitation: position = 5; must be > 0 and <= 0.606",
        ),
        (lambda: replace(RIG, channels=RIG.channels[:1] * 2), 'Rig: channel "force" is there twice; names must differ'),
        (
            lambda: replace(RIG, channels=(Channel("slip", "displacement", 0.1),)),
            r'Rig: channels\[1\].name = "slip"; must not be one of the computed drive, slip, slip_velocity, friction',
        ),
        (lambda: ModalBody((-5.0, 10.0), (FOUR,), FOUR, FOUR), r"ModalBody: frequencies_hz\[0\] = -5; must be > 0"),
        (lambda: ModalBody((5.0, 10.0), ((1.0,),), FOUR, FOUR), r"ModalBody: shapes\[0\] has 1 entries; must have 2"),
        (
            lambda: ModalBody((5.0, 10.0), (FOUR[:2],), FOUR[:2], (0.0, 0.0)),
            "ModalBody: excitation_shape is 0 in every mode; must not be, nothing moves there",
        ),
        (
            lambda: replace(RIG, excitation=replace(RIG.excitation, position=RIG.body.length)),
            "Excitation: position = 0.606; must be < 0.606, the tip is held there",
        ),
        (lambda: steady_state(RIG, 0.0), "steady_state: hz = 0; must be > 0 and finite"),
        (lambda: hbm.simulate(RIG, np.nan), "simulate: hz = nan; must be > 0 and finite"),
        (lambda: hbm.frequency_response(RIG, (50.0, 50.0)), "frequency_response: .* two different numbers"),
        (lambda: hbm.trace_frequency(RIG, (-5.0, 50.0)), "trace_frequency: hz = -5; must be > 0 and finite"),
    ],
)
def test_what_cannot_be_is_refused_at_birth(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("name", sorted(set(LAWS) - {"frictionless"}))
def test_every_number_of_every_law_has_bounds_that_hold(name):
    """Just below its lower bound each is refused; as a CasADi symbol it passes."""
    law = LAWS[name]
    good = {n: max(p.lower, 0.0) + 0.4 * min(p.upper - p.lower, 1.0) for n, p in describe(law).items()}
    assert parameters(law(**good)) == good
    for n, p in describe(law).items():
        if np.isfinite(p.lower):
            with pytest.raises(ValueError, match=f"{law.__name__}: {n} = .*; must be "):
                law(**{**good, n: p.lower - 1e-9})
        symbol = ca.SX.sym(n)
        assert getattr(law(**{**good, n: symbol}), n) is symbol


@pytest.mark.parametrize(
    ("call", "options"),
    [
        ("steady_state", (50.0,)), ("trace_frequency", ((45.0, 60.0),)), ("frequency_response", ((45.0, 60.0),)),
        ("force_response", (50.0, (1.0, 2.0))), ("simulate", (50.0,)), ("linear_modes", ()), ("nonlinear_mode", ()),
        ("phase_resonance", (6.5,)), ("reconstruct", (None,)), ("diagnose", (None,)),
    ],
)  # fmt: skip
def test_a_path_is_no_rig(call, options):
    with pytest.raises(InputError, match=f"{call}: rig = 'rig.toml'; must be a Rig, as load_rig"):
        getattr(hbm, call)("rig.toml", *options)


def test_rigs_and_results_are_printed_in_words():
    solution = steady_state(RIG, 50.0, harmonics=5)
    assert str(RIG).splitlines()[0].endswith("E 210 GPa, density 7800 kg/m3, 5 modes from 47.8419 Hz")
    assert "coulomb-penalty (mu 0.52, critical_slip 4.15e-06) under 83 N" in str(RIG)
    assert "  1     47.8419     56.0046      0.010%" in repr(linear_modes(RIG))
    said = repr(sensitivities(RIG, solution)).splitlines()
    assert said[0].startswith("sensitivities at 50 Hz, 6.5 N") and said[1].split()[0] == "contact.friction.mu"
    curve = hbm.trace_frequency(RIG, (50.0, 51.0), harmonics=5)
    assert repr(curve.branch).startswith(f"branch of {len(curve.branch.points)} points")
    loop = hbm.friction_loop(LAW, slip=2e-5, hz=50.0, load=83.0)
    assert repr(loop).startswith("friction loop of coulomb-penalty at 50 Hz under 83 N: slip up to 2e-05 m")
    assert "5 modes" in str(Beam(0.6, 0.04, 0.005, 2.1e11, 7800.0))
