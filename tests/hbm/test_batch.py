"""Records solved together: the same steady states and derivatives as one by one."""

from dataclasses import replace

import numpy as np
import pytest
from rigs import ON_THE_BEAM, beam

from hbm import sensitivities, steady_state
from hbm.balance.batch import Batch, Motions, is_batched
from hbm.balance.batchednewton import Matrices, Solved, solve
from hbm.balance.problem import TOLERANCE, HarmonicBalance, State
from hbm.balance.solution import PeriodicSolution, described
from hbm.outputerror.simulated import held_beside
from hbm.sensitivity.batch import changes_together
from hbm.sensitivity.derivatives import disturbed
from models import Attachments, FrictionLaw, ImpactStop, MidplaneStretching, PointMass, Rig
from models.parts import Drift
from models.published import ASSUMED_VLFM, PAPER_DAHL, PAPER_PENALTY
from models.scalars import solution_numbers

AT = ((47.0, 6.5), (50.2, 6.5), (52.0, 4.5), (54.0, 0.3), (57.0, 6.5))
"""Frequencies [Hz] and levels [N]: one where the contact sticks, none between, where friction just comes to its limit
once a period (2.0 to 3.5 N at 52 Hz with `sdfm`): rounding tells there on which side of it the derivatives are."""


def together(rig: Rig, starts: list[PeriodicSolution], hz: list[float], levels: list[float]) -> tuple[Batch, Solved]:
    first = HarmonicBalance(rig, starts[0].basis)
    batch = Batch([first.at_level(level) for level in levels], np.array(hz))
    begin = Motions(*(np.stack([getattr(s.state, name) for s in starts]) for name in "QT"))
    return batch, solve(Matrices(batch), begin, 15)


@pytest.mark.parametrize("law", ON_THE_BEAM, ids=lambda law: law.name)
def test_steady_states_and_derivatives_are_those_of_each_alone(law: FrictionLaw) -> None:
    rig = beam(law, modes=6, foreshortening=True)
    as_alone(replace(rig, attachments=Attachments(masses=(PointMass(0.25, 0.02),), clamp_stiffness=2e5)))


@pytest.mark.parametrize("law", (PAPER_PENALTY, PAPER_DAHL, ASSUMED_VLFM), ids=lambda law: law.name)
@pytest.mark.parametrize("limit", (None, 0.05, 0.3))
def test_places_that_give_way_are_solved_together(law: FrictionLaw, limit: float | None) -> None:
    rig = beam(law, modes=5, foreshortening=True, load_variation=1.0)
    held = Attachments(masses=(PointMass(0.25, 0.02),), clamp_stiffness=2e5, clamp_limit=limit)
    stops = (ImpactStop(4e-5, 3e3, 0.31), ImpactStop(1e-2, 1e4, 0.12))  # one is struck, the other is not
    found = as_alone(replace(rig, attachments=held, elements=stops))
    yields = found.matrices.yielding.any(axis=(0, 1, 3))
    assert yields.any(axis=1).tolist() == [True, False, *([] if limit is None else [True])]


def as_alone(rig: Rig) -> Solved:
    """Records solved together, compared with each alone."""
    hz, levels = zip(*AT, strict=True)
    alone = [steady_state(rig, f, level=F, harmonics=9, samples=128) for f, F in AT]
    near = [steady_state(rig, 1.0005 * s.hz, level=s.level, harmonics=9, samples=128, start=s) for s in alone]
    batch, found = together(rig, near, list(hz), list(levels))
    assert found.converged.all()
    keys = [k for k in solution_numbers(rig, hz[0], levels[0])]
    names = [c.name for c in rig.response_channels]
    by = changes_together(found, keys, names)
    assert by.solved.all()
    for i, solution in enumerate(alone):
        assert np.abs(found.motions.Q[i] - solution.state.Q).max() < 1e-8 * np.abs(solution.state.Q).max()
        state = State(found.motions.Q[i], found.motions.T[i], float(batch.Omega[i, 0]), levels[i])
        here = described(batch.problems[i], state, hz[i], batch.kinematics(i, found.seen))
        one = sensitivities(rig, here, keys)
        for at, name in enumerate(names):
            # friction is unknown in the one, and marched in the other: they differ by what Newton's method leaves
            atol = TOLERANCE * here[name].peak
            np.testing.assert_allclose(by.reads[i, at], here[name].coefficients, rtol=0, atol=atol)
            there = one[name].coefficients
            assert np.all(np.abs(by.channels[i, at] - there).max(axis=0) <= 1e-8 * np.abs(there).max(axis=0)), name
        assert np.abs(by.own_Q[i] - one.own_Q).max() < 1e-9 * np.abs(one.own_Q).max()
        assert np.abs(by.T[i] - one.T).max() <= 1e-9 * np.abs(one.T).max()
        pushed = disturbed(rig, here, held_beside(here))
        for name, series in by.by_mean.items():
            # both are refined to a share of the friction itself, next to which it moves the sensors little
            assert np.abs(series[i] - pushed[name][:, 0]).max() <= 1e-5 * np.abs(pushed[name]).max(), name
    return found


def test_a_record_that_full_steps_do_not_bring_nearer_is_given_up_and_the_others_found() -> None:
    rig = beam(modes=4)
    near = [steady_state(rig, f, harmonics=7, samples=64) for f in (46.0, 48.0)]
    far = replace(near[0], state=replace(near[0].state, Q=1e3 * near[0].state.Q, T=-near[0].state.T))
    _, found = together(rig, [near[0], far, near[1]], [46.1, 46.1, 48.1], [6.5, 6.5, 6.5])
    assert found.converged.tolist() == [True, False, True]


def test_what_can_be_solved_together_is_nonlinear_at_places_alone_and_the_same_in_all_records() -> None:
    rig = beam()
    assert is_batched(rig)
    assert is_batched(replace(rig, elements=(ImpactStop(1e-4, 1e4, 0.3),)))
    assert is_batched(replace(rig, attachments=Attachments(clamp_stiffness=2e5, clamp_limit=0.3)))
    assert not is_batched(replace(rig, elements=5 * (ImpactStop(1e-4, 1e4, 0.3),)))
    assert not is_batched(replace(rig, elements=(MidplaneStretching(1.0),)))
    assert not is_batched(replace(rig, contact=replace(rig.contact, lift_off=True)))
    assert is_batched(replace(rig, drift=(Drift("contact.normal_load", 1e-3), Drift("contact.friction.mu", 1e-3))))
    assert not is_batched(replace(rig, drift=(Drift("beam.density", 1e-3),)))
    assert not is_batched(replace(rig, excitation=replace(rig.excitation, measured_harmonics=True)))


@pytest.mark.parametrize("modes", (6, 10))
def test_the_matrices_are_those_of_each_alone(modes: int) -> None:
    """Steps are the same to rounding: with other ones Newton's method gets there too, in several times as many."""
    rig = beam(modes=modes, foreshortening=True, load_variation=1.0)
    starts = [steady_state(rig, f, harmonics=9, samples=128) for f in (47.0, 52.0)]
    first = HarmonicBalance(rig, starts[0].basis)
    matrices, every = Matrices(Batch([first.at_level(6.5)] * 2, np.array([47.1, 52.1]))), np.arange(2)
    motions = Motions(*(np.stack([getattr(s.state, name) for s in starts]) for name in "QT"))
    seen = matrices.batch.seen(motions, every)
    matrices.work_out(every, seen, motions)
    dQ, dT = matrices.solve(every, seen.modal[..., None], seen.contact[..., None])
    for i, hz in enumerate((47.1, 52.1)):
        x = first.pack(State(motions.Q[i], motions.T[i], 0.0, 6.5))[0]
        here = first.linearize(x, first.lam_at(hz))
        step = here.newton.solve_columns(np.zeros(first.size), 1.0, here.residual[:, None], 0.0)[0]
        there = first.unpack(step[:, 0], 1.0)
        assert np.abs(dQ[i, ..., 0] - there.Q).max() < 1e-9 * np.abs(there.Q).max()
        assert np.abs(dT[i, ..., 0] - there.T).max() < 1e-9 * np.abs(there.T).max()
