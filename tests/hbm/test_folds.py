"""Folds of rigs in the plane of frequency and force, and the closed curves they betray."""

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import pytest
from rigs import beam, oscillator
from scipy.optimize import root

from continuation import ChordCurve, FoldCurve, Kind
from hbm.fourier import FourierBasis
from hbm.response.start import first_solution
from hbm.response.trace import trace_frequency
from hbm.tracking.folds import PlaneBalance, fold_path, isolas
from hbm.tracking.parameter import ParameterBalance, parameter_key
from models import ContactSample, Rig
from models.attachments import Attachments, Resonator
from models.friction import parameter
from tests.slopes import check_plane

C1, C3, C5, GAMMA = 0.1, -0.25, 0.15, 0.2


@dataclass(frozen=True, eq=False)
class FallsAndRises:
    """A cubic spring, and damping that falls before it rises: T = -(gamma u^3 + c3 v^3 + c5 v^5)."""

    name: ClassVar[str] = "falls-and-rises"
    states: ClassVar[int] = 0
    set_valued: ClassVar[bool] = False

    gamma: Any = field(metadata=parameter("N/m3", "cubic stiffness", "Habib 2018"))
    c3: Any = field(metadata=parameter("N s3/m3", "cubic damping", "Habib 2018", lower=-np.inf))
    c5: Any = field(metadata=parameter("N s5/m5", "quintic damping", "Habib 2018"))

    def advance(self, z: Any, before: ContactSample, now: ContactSample) -> tuple[Any, Any]:
        """Return no state and the force."""
        return z, -(self.gamma * now.u**3 + self.c3 * now.v**3 + self.c5 * now.v**5)


def habib(amplitude: float) -> Rig:
    """Return the oscillator of Habib, Cirillo & Kerschen, Nonlinear Dynamics 93 (2018), with a hardening spring."""
    return oscillator(FallsAndRises(GAMMA, C3, C5), damping=C1, amplitude=amplitude)


def squared_force(A: Any, W: Any) -> Any:
    """Of one-term balance at amplitude A and frequency W [rad/s]."""
    v = W * A
    damping = C1 + 0.75 * C3 * v**2 + 0.625 * C5 * v**4
    return A**2 * ((1.0 - W**2 + 0.75 * GAMMA * A**2) ** 2 + (damping * W) ** 2)


def stationary(A: float) -> tuple[float, float, float]:
    """Frequency [Hz], force and amplitude near A where the force is stationary: a closed curve is born, or meets."""

    def gradient(y: Any) -> list[float]:
        return [squared_force(y[0] + 1e-30j, y[1]).imag * 1e30, squared_force(y[0], y[1] + 1e-30j).imag * 1e30]

    A, W = root(gradient, [A, (1.0 + 0.75 * GAMMA * A**2) ** 0.5], tol=1e-14).x
    return W / (2 * np.pi), squared_force(A, W) ** 0.5, A


def test_isola_of_the_literature_is_found_by_its_folds_and_traced() -> None:
    hz = 0.6 / (2 * np.pi), 1.6 / (2 * np.pi)
    curve = trace_frequency(habib(0.04), hz, harmonics=1, samples=32)
    path = fold_path(curve, (0.006, 0.0402), fold=-1)
    assert all(isinstance(part, FoldCurve) for part in path.parts)  # smooth: followed exactly
    found = {point.kind: point for point in path.special}
    for kind, A in ((Kind.CROSSING, 0.45), (Kind.ISOLA_CENTRE, 0.9)):
        frequency, force, _ = stationary(A)
        assert path.place(found[kind]) == pytest.approx((frequency, force), rel=1e-6)
    force = 0.5 * (stationary(0.45)[1] + stationary(0.9)[1])
    main = trace_frequency(habib(force), hz, harmonics=1, samples=32)
    (isola,) = isolas(path, force, [main], hz)
    assert isola.branch.closed and isola.complete and len(isola.folds) == 2
    assert isola["drive"].peak.min() > main["drive"].peak.max()
    for point in isola.points[::10]:
        A, W = float(point["drive"].amplitude[1]), 2 * np.pi * point.hz
        assert squared_force(A, W) ** 0.5 == pytest.approx(force, rel=1e-6)


@pytest.mark.parametrize(
    ("key", "within", "at"), [("excitation.amplitude", (6.3, 6.6), 6.4), ("contact.friction.mu", (0.515, 0.53), 0.525)]
)
def test_folds_of_friction_are_where_the_response_turns(key: str, within: tuple[float, float], at: float) -> None:
    """Paper's damping, where its beam jumps: at another value the path meets the folds that a sweep there turns at."""
    rig = beam(alpha=0.06)
    curve = trace_frequency(rig, (48.4, 49.0), harmonics=3, samples=128)
    path = fold_path(curve, within, key=key, max_points=20)
    assert all(isinstance(part, ChordCurve) for part in path.parts)  # stick and slip: followed by chords
    again = trace_frequency(rig.with_number(key, at), (48.4, 49.0), harmonics=3, samples=128)
    found = [fold.hz for fold in path.at(at)]
    assert found
    for hz in found:
        assert min(abs(hz - there) for there in again.folds) < 2e-3


def test_the_whole_jacobian_is_the_derivative() -> None:
    """With a clamp that slips, a resonator and foreshortening in every mode."""
    ends = Attachments(clamp_stiffness=5e3, clamp_limit=0.3, resonators=(Resonator(0.02, 60.0, 0.4),))
    rig, key = replace(beam(), attachments=ends), "attachments.resonators[0].mass"
    known = parameter_key(rig, key, 50.0, 6.5)
    along = ParameterBalance(rig, known, (0.02, 0.03), FourierBasis(3, 64), hz=50.0, level=6.5)
    x, lam = first_solution(along.first, along.first.lam_at(50.0)), along.first.lam_at(50.0)
    check_plane(PlaneBalance(along), x, lam, 0.2, 1e-5)


def test_what_is_no_fold_is_refused() -> None:
    curve = trace_frequency(habib(0.04), (0.1, 0.12), harmonics=1, samples=32)
    with pytest.raises(ValueError, match="fold_path: fold 0; the curve has 0"):
        fold_path(curve, (0.01, 0.05))
    with pytest.raises(ValueError, match=r"within 0.05 to 0.06; must hold excitation.amplitude = 0.04"):
        fold_path(curve, (0.05, 0.06))
