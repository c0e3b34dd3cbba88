"""Records of a campaign simulated together: as one by one, whatever of them sticks, wanders or is not found so."""

from dataclasses import fields, replace

import numpy as np
import pytest

from hbm.balance.problem import State
from hbm.fourier import FourierBasis
from hbm.outputerror.records import Measurement, Record
from hbm.outputerror.simulated import Simulated, simulated, steady
from hbm.outputerror.together import _solved, simulated_together, steady_together
from hbm.response.trace import steady_state
from models import Attachments, ImpactStop, Rig
from models.parts import Drift
from models.published import PAPER_PENALTY, paper_rig

RIG, H, BASIS = paper_rig(PAPER_PENALTY).with_modes(5), 3, FourierBasis(9, 128)
KEYS = ("contact.friction.mu", "beam.youngs_modulus", "channels.a1.gain", "channels.a6.position")
AT = ((48.0, 6.5), (51.5, 6.5), (54.0, 0.3), (56.0, 2.0))
"""Frequency [Hz] and level [N] of the records; in the third the contact sticks."""


def record(number: int, hz: float, force: float) -> Record:
    found = steady_state(RIG, hz, level=force, harmonics=BASIS.H, samples=BASIS.N_t)
    near = replace(found.state, Q=1.01 * found.state.Q, Omega=2 * np.pi * hz)
    nothing = np.full((2, 2, H), np.nan)
    return Record(
        number,
        str(number),
        hz,
        force,
        0.01,
        nothing,
        np.ones((2, H)),
        near,
        nothing[:, 0, 1:],
        nothing[0, 0, 1:],
        force,
    )


DATA = Measurement(tuple(record(i, hz, F) for i, (hz, F) in enumerate(AT, 1)), ("a1", "a6"), H, np.ones(len(AT)))


def same(a: Simulated, b: Simulated) -> None:
    for field in fields(Simulated):
        mine, other = getattr(a, field.name), getattr(b, field.name)
        if isinstance(other, np.ndarray):
            assert np.abs(mine - other).max() <= 1e-7 * np.abs(other).max(), field.name
        elif field.name != "solution":
            assert mine is None and other is None, field.name
    for name, signal in b.solution.channels.items():
        assert np.abs(a.solution[name].samples - signal.samples).max() <= 1e-7 * np.abs(signal.samples).max(), name


GIVING_WAY = replace(
    RIG,
    attachments=Attachments(clamp_stiffness=2e5, clamp_limit=0.05),
    elements=(ImpactStop(4e-5, 3e3, 0.31),),
    drift=(Drift("contact.friction.mu", 0.02), Drift("contact.normal_load", -0.03)),
)
"""A clamp that slips, a stop that is struck, and a contact that is not the same in all records."""


@pytest.mark.parametrize("settled", [True, False])
def test_records_are_what_each_is_alone(settled: bool) -> None:
    rig = replace(RIG, excitation=replace(RIG.excitation, settled=settled))
    starts = [None] * len(AT)
    found = list(simulated_together(rig, BASIS, DATA, KEYS, DATA.records, starts))
    histories = [s.by_history is not None for s in found]
    assert histories == [False, False, True, False]
    for r, s in zip(DATA.records, found, strict=True):
        same(s, simulated(rig, BASIS, DATA, KEYS, r, None))


def test_places_that_give_way_and_a_contact_that_drifts_are_what_each_record_is_alone() -> None:
    starts = [None] * len(AT)
    keys = (*KEYS, "drift[0].rate", "contact.normal_load", "elements[0].gap", "attachments.clamp_limit")
    near = [steady(GIVING_WAY, BASIS, r, None).state for r in DATA.records]
    records = [replace(r, start=start) for r, start in zip(DATA.records, near, strict=True)]
    found = _solved(GIVING_WAY, BASIS, records, starts)
    assert found is not None and len(found.which) == len(AT)
    for r, s in zip(records, simulated_together(GIVING_WAY, BASIS, DATA, keys, records, starts), strict=True):
        same(s, simulated(GIVING_WAY, BASIS, DATA, keys, r, None))


@pytest.mark.parametrize("rig", (RIG, GIVING_WAY))
def test_what_a_record_is_does_not_depend_on_the_others_to_the_last_bit(rig: Rig) -> None:
    """Records are shared among as many processes as there are cores: files are the same whatever their number."""
    starts = [None] * len(AT)
    whole = list(simulated_together(rig, BASIS, DATA, KEYS, DATA.records, starts))
    for first in (0, 1):
        part = simulated_together(rig, BASIS, DATA, KEYS, DATA.records[first::2], starts[first::2])
        for mine, other in zip(part, whole[first::2], strict=True):
            assert np.array_equal(mine.amplitudes, other.amplitudes) and np.array_equal(mine.by_keys, other.by_keys)
            assert np.array_equal(mine.solution.state.Q, other.solution.state.Q)


def test_a_record_that_is_not_found_together_is_found_alone() -> None:
    """Its start is nowhere near: full steps do not get there, those that are shortened, or the reconstruction, do."""
    last = DATA.records[0].start
    wild = replace(last, Q=1e3 * last.Q, T=-last.T)
    starts = [None, wild, None, None]
    found = list(steady_together(RIG, BASIS, DATA.records, starts))
    for r, start, s in zip(DATA.records, starts, found, strict=True):
        alone = steady(RIG, BASIS, r, start)
        assert np.abs(s.state.Q - alone.state.Q).max() < 1e-7 * np.abs(alone.state.Q).max()


def test_a_record_with_no_steady_state_is_none_and_the_others_are_found() -> None:
    nowhere = State(np.full((BASIS.size, 5), np.nan), np.full(BASIS.size, np.nan), 1.0, 1.0)
    records = [*DATA.records[:2], replace(DATA.records[2], start=nowhere)]
    found = list(steady_together(RIG, BASIS, records, [None, None, nowhere]))
    assert [s is None for s in found] == [False, False, True]
