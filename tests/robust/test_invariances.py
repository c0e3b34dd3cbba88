"""What must not change where physics does not: units, time origin, sign of the force, size of force and load."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from continuation import ConvergenceError
from hbm.inverse.reconstruct import reconstruct
from hbm.measurement.harmonics import harmonic_spectra
from hbm.measurement.recording import recording
from hbm.measurement.spectra import MeasuredSpectra
from hbm.measurement.spectrafile import load_spectra
from hbm.modes.linear import linear_modes
from hbm.response.trace import steady_state
from hbm.rigfiles.load import load_contact_rig
from models import Beam, Channel, Contact, Damping, Excitation, Jenkins, Rig, Stribeck

EXAMPLE = Path(__file__).parents[2] / "examples" / "measured_beam"
MEASURED = load_contact_rig(EXAMPLE / "rig.toml", "this test")
SPECTRA = load_spectra(EXAMPLE / "spectra.csv", MEASURED).select(records=[1, 2])
FEW = settings(settings.default, max_examples=settings.default.max_examples // 4 or 1)


def falling(law: Jenkins, more: float, velocity: float) -> Stribeck:
    return Stribeck(law.mu * more, law.mu, velocity, critical_slip=law.critical_slip)


factors = st.floats(0.25, 4.0)
beams = st.builds(
    Beam,
    length=st.floats(0.3, 1.0),
    width=st.floats(0.02, 0.05),
    thickness=st.floats(0.003, 0.008),
    youngs_modulus=st.floats(70e9, 210e9),
    density=st.floats(2700.0, 8000.0),
    modes=st.integers(2, 5),
)
jenkins = st.builds(Jenkins, mu=st.floats(0.1, 0.8), critical_slip=st.floats(1e-6, 1e-5))
laws = st.one_of(jenkins, st.builds(falling, jenkins, st.floats(1.0, 1.5), st.floats(1e-3, 1e-1)))
loads, forces = st.floats(20.0, 200.0), st.floats(0.5, 8.0)
ratios = st.floats(0.85, 1.15)  # of the excitation to the first sliding frequency


def rig_of(beam: Beam, law: Jenkins | Stribeck, load: float, force: float, **contact: bool) -> Rig:
    return Rig(
        name="drawn",
        body=beam,
        damping=Damping(mass_proportional=5.0),
        contact=Contact(load, law, radius=0.005, **contact),
        excitation=Excitation(force, 0.9 * beam.length),
        channels=(Channel("a", "acceleration", 0.4 * beam.length),),
    )


def response(rig: Rig, ratio: float, H: int = 5) -> dict[str, np.ndarray]:
    """Coefficients of the signals of a steady state, where there is one that is found."""
    try:
        point = steady_state(rig, ratio * linear_modes(rig).sliding_hz[0], harmonics=H)
    except ConvergenceError:
        assume(False)
    assert abs(point.energy_error) < 1e-6
    return {name: point[name].coefficients for name in ("drive", "slip", "friction", "normal", "a")}


def close(found: np.ndarray, expected: np.ndarray, tolerance: float = 1e-6) -> None:
    assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max()


@FEW
@given(beams, laws, loads, forces, ratios)
def test_an_accepted_rig_closes_its_energy_balance(beam, law, load, force, ratio) -> None:
    response(rig_of(beam, law, load, force), ratio)


@FEW
@given(beams, jenkins, loads, forces, ratios, factors)
def test_force_load_and_elastic_slip_times_a_are_the_motion_times_a(beam, law, load, force, ratio, a) -> None:
    """Without what is of second order in the motion, the foreshortening."""
    one = response(rig_of(beam, law, load, force, foreshortening=False), ratio)
    slack = replace(law, critical_slip=a * law.critical_slip)
    many = response(rig_of(beam, slack, a * load, a * force, foreshortening=False), ratio)
    for name, coefficients in one.items():
        close(many[name], a * coefficients)


@FEW
@given(beams, laws, loads, forces, ratios, factors, factors, factors)
def test_the_response_is_the_same_in_other_units(beam, law, load, force, ratio, kilogram, metre, second) -> None:
    """Every number in other units of mass, length and time, foreshortening included."""
    newton = kilogram * metre / second**2
    one = rig_of(beam, law, load, force)
    units = {"length": metre, "width": metre, "thickness": metre}
    units |= {"youngs_modulus": newton / metre**2, "density": kilogram / metre**3}
    other_beam = replace(beam, **{name: getattr(beam, name) * unit for name, unit in units.items()})
    slack = {"critical_slip": metre * law.critical_slip}
    if isinstance(law, Stribeck):
        slack["stribeck_velocity"] = metre / second * law.stribeck_velocity
    other = replace(
        rig_of(other_beam, replace(law, **slack), newton * load, newton * force),
        damping=Damping(mass_proportional=5.0 / second),
    )
    other = replace(other, contact=replace(other.contact, radius=metre * one.contact.radius))
    said, expected = response(other, ratio), response(one, ratio)
    of = {"drive": metre, "slip": metre, "friction": newton, "normal": newton, "a": metre / second**2}
    for name, coefficients in expected.items():
        close(said[name], of[name] * coefficients)


@FEW
@given(beams, laws, loads, forces, ratios)
def test_the_other_sign_of_the_force_is_half_a_period_later(beam, law, load, force, ratio) -> None:
    """Under a constant load, without foreshortening, what moves is the same upside down: there is no even harmonic."""
    found = response(rig_of(beam, law, load, force, load_variation=0.0, foreshortening=False), ratio)
    for name in ("drive", "slip", "friction", "a"):
        H = (len(found[name]) - 1) // 2
        even = np.r_[0, 2 : H + 1 : 2, H + 2 : 2 * H + 1 : 2]
        assert np.abs(found[name][even]).max() <= 1e-8 * np.abs(found[name]).max()


def turned(spectra: MeasuredSpectra, phase: float) -> MeasuredSpectra:
    """The same motion from another time origin."""
    H = spectra.H
    k = np.arange(1, H + 1)
    cos, sin = spectra.coefficients[..., 1 : H + 1], spectra.coefficients[..., H + 1 :]
    c, s = np.cos(k * phase), np.sin(k * phase)
    parts = [spectra.coefficients[..., :1], cos * c + sin * s, sin * c - cos * s]
    return replace(spectra, coefficients=np.concatenate(parts, axis=-1))


@settings(FEW, max_examples=FEW.max_examples // 3)
@given(st.floats(0.0, 2 * np.pi))
def test_the_contact_that_is_reconstructed_does_not_depend_on_the_time_origin(phase: float) -> None:
    here, there = reconstruct(MEASURED, SPECTRA), reconstruct(MEASURED, turned(SPECTRA, phase))
    for name in ("friction", "slip"):
        close(there[name].amplitude, here[name].amplitude, 1e-4)
    close(there.energy_per_cycle.value, here.energy_per_cycle.value, 1e-4)


@given(st.floats(0.0, 1.0), st.floats(0.1, 10.0), st.floats(-3.0, 3.0))
def test_the_harmonics_of_a_history_turn_with_its_time_origin(later: float, size: float, phase: float) -> None:
    t = np.arange(400) / 1000.0
    signal = size * np.cos(2 * np.pi * 20.0 * t + phase) + 0.3 * size * np.sin(6 * np.pi * 20.0 * t)
    here = harmonic_spectra(recording("here", t, {"a": signal}), 20.0, 4)
    there = harmonic_spectra(recording("later", t + later, {"a": signal}), 20.0, 4)
    H, turn = 4, np.exp(-2j * np.pi * 20.0 * later * np.arange(1, 5))
    for found, expected in ((there, here),):
        a, b = (c.coefficients[0][1 : H + 1] - 1j * c.coefficients[0][H + 1 :] for c in (found, expected))
        assert np.abs(a - b * turn).max() <= 1e-9 * size


@given(st.floats(0.1, 10.0))
def test_the_sign_and_size_of_all_channels_are_those_of_the_harmonics(size: float) -> None:
    t = np.arange(400) / 1000.0
    signal = np.cos(40 * np.pi * t + 0.4) + 0.01 * np.sin(t * 777.0)
    one, other = (harmonic_spectra(recording("a", t, {"a": f * signal}), 20.0, 4) for f in (1.0, -size))
    assert np.allclose(other.coefficients, -size * one.coefficients, rtol=1e-9, atol=1e-12 * size)
    assert np.allclose(other.std, size * one.std, rtol=1e-6)
