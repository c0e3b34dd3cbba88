"""Every friction law: its loop against its equations, and on the beam harmonic balance against time integration."""

import numpy as np
import pytest
from equations import fine, steady_force
from rigs import ON_THE_BEAM, beam

from hbm.aft.force import Environment, LawOverPeriod
from hbm.fourier import FourierBasis
from hbm.integration.handover import state_at_phase_zero
from hbm.integration.integrate import steady_state as shoot
from hbm.response.trace import steady_state
from models import (
    LAWS,
    Coulomb,
    Dahl,
    ForceBalance,
    FrictionLaw,
    Hybrid,
    Iwan,
    Jenkins,
    Karnopp,
    LuGre,
    SpringDamper,
    Stribeck,
    VelocityLimited,
    Viscous,
    parameters,
)

P, OMEGA, COMPLIANCE, H = 83.0, 2 * np.pi * 50.0, 3e-8, 5

# ----------------------------------------------------------------------------------------- loops of a given motion


def motion(phase: float) -> np.ndarray:
    """Coefficients (11, 4) of u, v, rho and eta, shifted in time: slips four times a period under 0.55 to 1.4 P."""
    basis, c = FourierBasis(H, 64), np.zeros((H + 1, 4), dtype=complex)
    c[1:4, 0] = 1.5e-5, 4e-6 * np.exp(0.4j), 5e-6 * np.exp(1.9j)
    c[:3, 2] = P, 20.0 * np.exp(0.7j), -15.0j
    c[:2, 3] = 0.05, 0.03 * np.exp(0.2j)
    s = basis.real(c * np.exp(1j * np.arange(H + 1) * phase)[:, None])
    s[:, 1] = OMEGA * basis.derivative(s[:, 0])
    return s


def sampled(theta: np.ndarray) -> np.ndarray:
    k = np.arange(H + 1)
    return np.hstack([np.cos(np.outer(theta, k)), np.sin(np.outer(theta, k[1:]))]) @ motion(0.0)


def reference(law: FrictionLaw, C: float) -> tuple[np.ndarray, float]:
    """Amplitudes of harmonics 0..5 of the loop, from the law's equations, and its peak."""
    steps = 4096 if isinstance(law, Iwan) else 6144
    T = np.roll(steady_force(law, fine(sampled, OMEGA, steps, C, P)), 1)
    c = np.fft.rfft(T)[: H + 1] * 2.0 / steps
    c[0] /= 2.0
    return c, float(np.abs(T).max())


def loop_errors(law: FrictionLaw, C: float, sizes: tuple[int, ...]) -> np.ndarray:
    """Error of the worst harmonic over the peak; where switches fall between samples is averaged over four phases."""
    exact, peak = reference(law, C)
    environment = Environment(C, P, np.array(list(parameters(law).values()), dtype=float))
    errors = []
    for N_t in sizes:
        contact, squares = LawOverPeriod(law, FourierBasis(H, N_t)), []
        for phase in (0.0, 1.1, 2.3, 3.7):
            T, closure = contact.force(motion(phase), OMEGA, environment)
            assert closure < 1e-11
            a = contact.basis.complex(contact.basis.analysis @ T) * np.exp(-1j * np.arange(H + 1) * phase)
            squares.append(np.abs(a - exact).max() ** 2)
        errors.append(np.sqrt(np.mean(squares)) / peak)
    return np.array(errors)


LUGRE = LuGre(0.5, 0.3, 2e-3, 1e7, bristle_damping=100.0, viscous=150.0)
STIFF = {"stiffness": 1.5e7, "stiffness_elastic_plastic": 6e7, "stiffness_plastic_presliding": 6e7}
HYBRID = Hybrid(0.5, 0.3, 2e-3, **STIFF, damping_plastic=347.0, damping_presliding=347.0)
UNDAMPED_HYBRID = Hybrid(0.5, 0.3, 2e-3, **STIFF, damping_plastic=347.0, damping_presliding=0.0)
# law, compliance, error of 384 samples, and the least order from 96 to 384 samples
LOOPS = [
    (Coulomb(0.5), COMPLIANCE, 3e-4, 1.6),
    (Jenkins(0.5, 4e-6), 0.0, 1e-4, 1.6),
    (Jenkins(0.5, 4e-6), COMPLIANCE, 1e-4, 1.6),
    (VelocityLimited(0.5, 6e-4), 0.0, 5e-4, 1.6),
    (VelocityLimited(0.5, 6e-4), COMPLIANCE, 2e-4, 1.6),
    # where the contact grips within a sample: first order, seen above 500 samples
    (Karnopp(0.52, 0.45, 1e-3), COMPLIANCE, 7e-3, 0.1),
    (ForceBalance(0.52, 0.45, 1e-3), COMPLIANCE, 7e-3, 0.1),
    (SpringDamper(0.5, 1e7, 347.0), 0.0, 3e-4, 1.6),
    (SpringDamper(0.5, 1e7, 347.0), COMPLIANCE, 3e-4, 1.6),
    (SpringDamper(0.5, 1e7, 5000.0), 0.0, 6e-4, 1.6),
    (SpringDamper(0.5, 1e7, 5000.0), COMPLIANCE, 2e-4, 1.6),
    (Stribeck(0.5, 0.3, 2e-3, critical_slip=4e-6), 0.0, 3e-4, 1.6),
    (Stribeck(0.5, 0.3, 2e-3, critical_slip=4e-6), COMPLIANCE, 3e-4, 1.6),
    (Dahl(0.5, 1e7), 0.0, 1e-4, 1.8),
    (Dahl(0.5, 1e7), COMPLIANCE, 1e-4, 1.8),
    (LUGRE, 0.0, 2e-4, 1.8),
    (LUGRE, COMPLIANCE, 2e-4, 0.9),
    (HYBRID, 0.0, 6e-4, 1.8),
    (UNDAMPED_HYBRID, COMPLIANCE, 6e-4, 1.8),
    (Iwan(0.5, 1e7, elements=6), 0.0, 1e-4, 1.6),
    (Iwan(0.5, 1e7, elements=6), COMPLIANCE, 1e-4, 1.6),
    (Viscous(300.0), 0.0, 1e-9, 0.9),
    (Viscous(3000.0), COMPLIANCE, 3e-4, 1.6),
]


@pytest.mark.parametrize(
    ("law", "C", "tolerance", "order"),
    LOOPS,
    ids=[f"{law.name}-{'compliant' if C else 'rigid'}" for law, C, _, _ in LOOPS],
)
def test_loop_is_that_of_the_equations(law: FrictionLaw, C: float, tolerance: float, order: float) -> None:
    """Varying reaction that depends on T itself; harmonics 0..5."""
    coarse, fine_enough = loop_errors(law, C, (96, 384))
    assert fine_enough < tolerance
    assert np.log(coarse / fine_enough) / np.log(4.0) > order


def test_every_law_has_its_loop_checked() -> None:
    assert {law.name for law, *_ in LOOPS} | {"none"} == set(LAWS)


# --------------------------------------------------------------------------------------------- two paths on the beam


def test_every_law_is_on_the_beam() -> None:
    assert {law.name for law in ON_THE_BEAM} == set(LAWS)


@pytest.mark.parametrize("law", ON_THE_BEAM, ids=lambda law: law.name)
@pytest.mark.parametrize(("level", "hz"), [(2.0, 57.0), (6.5, 53.5)])
def test_harmonic_balance_and_time_integration_agree(law: FrictionLaw, level: float, hz: float) -> None:
    """Variable normal load; harmonics 1..5 of slip and friction within 1 % of the peak; all of it: benchmarks."""
    rig = beam(law, modes=6)
    solution = steady_state(rig, hz, level=level, harmonics=15, samples=256)
    motion = shoot(rig, hz, level=level, start=state_at_phase_zero(solution), steps_per_period=1024)
    assert motion.converged
    for name, at_rest in {"slip": 1e-15, "friction": 1e-12}.items():
        values = motion.history.channels[name].values
        peak = np.abs(values - values.mean()).max()
        if peak < at_rest:  # held
            continue
        a = solution.channels[name].coefficients
        ours = np.concatenate([a[1:6], a[16:21]])
        assert np.abs(ours - motion.history.coefficients(name, 5)[1:]).max() < 0.01 * peak, name
