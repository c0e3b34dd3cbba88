"""Figures of curves: what is drawn is what changes, and all of it is in its panel."""

import numpy as np
import pytest

from hbm import force_response, parameter_response, trace_frequency
from hbm.errors import InputError
from hbm.figures import plot_curves
from hbm.figures.parameter import plot_parameter_curve
from models.bodies.modal import ModalModel
from models.jointed import JointedRig
from models.joints import CubicSpring, Joint, PolynomialSpring
from models.parts import Channel, Damping, Excitation


def rig(*more: Joint) -> JointedRig:
    body = ModalModel((10.0, 40.0), {"l": (1.0, 0.5), "r": (1.0, -0.5)})
    joints = (Joint("c", CubicSpring(1e9), ("l",)), *more)
    channels = (Channel("a1", "acceleration", at="l"),)
    return JointedRig("two modes", body, Damping(modal_ratios=(0.01,)), joints, Excitation(1.0, at="l"), channels)


def test_forces_of_a_hardening_spring_stay_in_their_panel() -> None:
    """They fall with the cube of the motion: by eight powers of ten along these curves."""
    curves = [trace_frequency(rig(), (8.0, 30.0), level=level, harmonics=3) for level in (0.3, 1.2)]
    for ax in plot_curves(curves)[2:]:
        low, high = ax.get_ylim()
        drawn = np.concatenate([line.get_ydata() for line in ax.lines])
        assert low < drawn.min() and drawn.max() < high
        assert low > drawn.min() / 10


def test_a_port_that_rests_does_not_stretch_the_panel() -> None:
    weak = Joint("weak", PolynomialSpring(linear=1e-9), ("r",))
    forces = plot_curves(trace_frequency(rig(weak), (8.0, 9.0), harmonics=3))[2]
    highest = max(float(line.get_ydata().max()) for line in forces.lines)
    assert forces.get_ylim()[0] > 1e-5 * highest


@pytest.mark.parametrize("what", ["delay", "gain"])
def test_along_a_number_of_a_channel_its_reading_is_drawn(what: str) -> None:
    """A delay d turns the phase by -360 f d degrees, as often as it likes; a gain scales the peak."""
    hz, end = 20.0, 0.2 if what == "delay" else 3.0
    begin = 0.0 if what == "delay" else 1.0
    curve = parameter_response(rig(), f"channels.a1.{what}", (begin, end), hz=hz, harmonics=3)
    peak, phase = plot_parameter_curve(curve)
    ratio = peak.lines[0].get_ydata()[-1] / peak.lines[0].get_ydata()[0]
    turned = phase.lines[0].get_ydata()[-1] - phase.lines[0].get_ydata()[0]
    scaled, turns = (1.0, -360.0 * hz * end) if what == "delay" else (3.0, 0.0)
    assert ratio == pytest.approx(scaled, rel=1e-6)
    assert turned == pytest.approx(turns, abs=1e-4)
    assert peak.get_ylabel().startswith("a1,")
    assert peak.get_ylim()[1] > 1.05 * peak.lines[0].get_ydata().max()


def test_curves_are_drawn_along_what_they_were_traced_along() -> None:
    frequency = trace_frequency(rig(), (8.0, 9.0), harmonics=3)
    force = force_response(rig(), 8.0, (0.5, 1.0), harmonics=3)
    cubic = parameter_response(rig(), "joints.c.cubic", (1e9, 2e9), hz=8.0, harmonics=3)
    for curve, label, legend in (
        (frequency, "Excitation frequency [Hz]", "1 N"),
        (force, "Force amplitude [N]", "8 Hz"),
        (cubic, "joints.c.cubic [N/m3]", "8 Hz, 1 N"),
    ):
        axes = plot_curves(curve)
        assert axes[-1].get_xlabel() == label
        assert axes[0].get_xlim() == (curve.values.min(), curve.values.max())
        assert axes[0].get_legend().get_texts()[0].get_text() == legend
        for ax in axes:
            drawn = np.concatenate([line.get_xdata() for line in ax.lines if len(line.get_xdata())])
            assert drawn.min() == curve.values.min() and drawn.max() == curve.values.max()
    with pytest.raises(InputError, match=r"curves along excitation\.amplitude, joints\.c\.cubic; must all be"):
        plot_curves([force, cubic])
