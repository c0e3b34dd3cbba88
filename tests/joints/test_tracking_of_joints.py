"""Folds and peaks of rigs with joints, followed, are where repeated frequency responses have them."""

from typing import Any

import numpy as np
import pytest

from continuation import ChordCurve, Correction, FoldCurve, correct
from hbm.fourier import FourierBasis
from hbm.response.curve import ResponseCurve
from hbm.response.start import first_solution
from hbm.response.trace import trace_frequency
from hbm.tracking.folds import PlaneBalance, fold_path
from hbm.tracking.parameter import ParameterBalance, parameter_key
from hbm.tracking.peaks import follow_peak
from models import Jenkins
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import CubicSpring, Friction, Joint
from models.parts import Damping, Excitation
from tests.joints.rigs import made_up
from tests.slopes import check_plane

HZ = 10.0, 11.3
BODY = ModalModel((10.0, 37.0), {"drive": (0.8, 0.5), "spring": (1.0, -0.4), "rub": (0.5, 0.9)}, ((1e-5,) * 3,) * 3)
HARDENING = Joint("spring", CubicSpring(1e6), ("spring",))
STICKING = Joint("rub", Friction(Jenkins(1.0, 1e-5), 1.0), ("rub",))
RUBBING = Joint("rub", Friction(Jenkins(0.3, 1e-3), 1.0), ("rub",), ("drive",))


def hardening(*joints: Joint, amplitude: float = 3.0) -> JointedRig:
    return JointedRig("hardening", BODY, Damping(modal_ratios=(0.01,)), joints, Excitation(amplitude, at="drive"))


def response(rig: JointedRig) -> ResponseCurve:
    return trace_frequency(rig, HZ, harmonics=3, samples=128, step_hz=0.14)


@pytest.mark.parametrize(
    ("rig", "fold", "key", "within"),
    [
        (hardening(HARDENING), 0, "excitation.amplitude", (2.0, 4.0)),
        (hardening(HARDENING), 1, "joints.spring.cubic", (5e5, 2e6)),
        (hardening(HARDENING, RUBBING), 0, "joints.rub.mu", (0.25, 0.35)),
        (hardening(HARDENING, STICKING), 1, "excitation.amplitude", (2.91, 3.09)),
        (hardening(HARDENING, STICKING), 1, "joints.rub.mu", (0.97, 1.03)),
    ],
)
def test_a_fold_is_followed(rig: JointedRig, fold: int, key: str, within: tuple[float, float]) -> None:
    path = fold_path(response(rig), within, key=key, fold=fold)
    sticks = rig.joints[-1] is STICKING
    kind, accuracy = (ChordCurve, 1e-5) if sticks else (FoldCurve, 1e-7)  # by chords over the kinks, or exactly
    assert all(isinstance(part, kind) for part in path.parts)
    assert path.values.min() == pytest.approx(within[0]) and path.values.max() == pytest.approx(within[1])
    for share in (0.1, 0.8):
        value = within[0] + share * (within[1] - within[0])
        folds = response(rig.with_number(key, value)).folds
        (found,) = (fold.hz for fold in path.at(value))
        assert min(abs(found / hz - 1) for hz in folds) < accuracy


@pytest.mark.parametrize("key", ["excitation.amplitude", "joints.rub.mu", "joints.spring.cubic"])
def test_the_whole_jacobian_is_the_derivative(key: str) -> None:
    rig = made_up(damped=True, rigid=False)
    known = parameter_key(rig, key, 1.1, 1.0)
    along = ParameterBalance(rig, known, (known.value, 1.2 * known.value), FourierBasis(3, 64), hz=1.1, level=1.0)
    x, lam = first_solution(along.first, along.first.lam_at(1.1)), along.first.lam_at(1.1)
    check_plane(PlaneBalance(along), x, lam, 0.2, 1e-6)


def test_a_peak_beside_a_fold_is_followed_over_long_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """That of a hardening Duffing oscillator of light damping, beside its closed form with one harmonic.

    Beside the fold the motion at a fixed frequency changes without bound with the force; the peak itself does not.
    """
    k3, c = 1e9, 0.01 * 2 * np.pi * 10.0
    spring = Joint("spring", CubicSpring(k3), ("a",))
    rig = JointedRig(
        "duffing", ModalModel((10.0,), {"a": (1.0,)}), Damping(modal_ratios=(0.01,)), (spring,), Excitation(1.0, at="a")
    )
    solved: list[None] = []

    def counted(*given: Any) -> Correction:
        solved.append(None)
        return correct(*given)

    monkeypatch.setattr("hbm.tracking.peaks.correct", counted)
    force = np.array([0.5, 1.0, 2.0])
    peaks = follow_peak(rig, force.tolist(), harmonics=1)
    # F^2 = a^2 [(K - w^2)^2 + (2 c w)^2] with K = k + 3/4 k3 a^2 is least at w^2 = K - 2 c^2: 4 c^2 a^2 (K - c^2)
    k = (2 * np.pi * 10.0) ** 2 - c**2
    squared = (np.sqrt(k**2 + 0.75 * k3 * (force / c) ** 2) - k) / (1.5 * k3)
    fundamental = [p["drive"].amplitude[1] for p in peaks.points]
    assert fundamental == pytest.approx(np.sqrt(squared), rel=1e-12)
    assert 2 * np.pi * peaks.hz == pytest.approx(np.sqrt(k + 0.75 * k3 * squared - c**2), rel=1e-6)
    assert peaks.slope == pytest.approx(force / (4 * c**2 * np.sqrt(squared) * (k + 1.5 * k3 * squared)), rel=1e-6)
    assert len(solved) < 30 * len(force)  # ways uphill and to the top, none of them from a halved step


@pytest.mark.parametrize("channel", ["drive", "spring.motion"])
@pytest.mark.parametrize(
    ("key", "values"), [("excitation.amplitude", (0.5, 0.6, 0.8)), ("joints.rub.mu", (0.3, 0.25, 0.2))]
)
def test_a_peak_is_followed(key: str, values: tuple[float, ...], channel: str) -> None:
    rig = hardening(HARDENING, RUBBING, amplitude=0.6)
    first = response(rig.with_number(key, values[0])).peak
    peaks = follow_peak(rig, values, key, channel=channel, start=first, harmonics=3, samples=128)
    for value, hz, height in zip(values, peaks.hz, peaks.height, strict=True):
        near = trace_frequency(rig.with_number(key, value), (0.98 * hz, 1.02 * hz), harmonics=3, samples=128)
        top = max(near.points, key=lambda p: p[channel].peak)
        assert height == pytest.approx(top[channel].peak, rel=1e-4)
        assert height > top[channel].peak * (1 - 1e-6)
        assert hz == pytest.approx(top.hz, rel=1e-3)
    slopes = np.gradient(peaks.height, values)  # of three values: their parabola's, to its own error
    assert peaks.slope[1] == pytest.approx(slopes[1], rel=0.05)


def test_a_narrow_peak_is_followed_in_short_steps() -> None:
    """Against the backbone of the one mode: 3/4 of the cubic's stiffness, and the amplitude that damping leaves."""
    hz, ratio, drive, cubic, force = 20.0, 5e-4, 0.7, 1e7, 0.15
    body = ModalModel((hz, 51.0), {"spring": (1.0, 0.3), "drive": (drive, 0.2)})
    joint = Joint("spring", CubicSpring(cubic), ("spring",))
    rig = JointedRig("narrow", body, Damping(modal_ratios=(ratio,)), (joint,), Excitation(force, at="drive"))
    peaks = follow_peak(rig, (0.1, force), harmonics=3, samples=16)
    omega = 2 * np.pi * hz
    moved = force * drive / (2 * ratio * omega * 2 * np.pi * peaks.hz[-1])
    assert peaks.hz[-1] == pytest.approx(np.sqrt(omega**2 + 0.75 * cubic * moved**2) / (2 * np.pi), rel=1e-4)
    assert peaks.height[-1] == pytest.approx(drive * moved, rel=1e-2)


def test_a_number_that_is_none_is_refused() -> None:
    rig = hardening(HARDENING)
    with pytest.raises(KeyError, match=r"joints\.spring\.mu is not a number of the rig hardening"):
        follow_peak(rig, (0.1, 0.2), "joints.spring.mu")
    with pytest.raises(ValueError, match=r"joints\.spring\.mu is not a number of the rig hardening; must be one of"):
        fold_path(response(rig), (0.1, 0.2), key="joints.spring.mu")
