"""What the first screen tells of where a force is missing, of whether records tell places apart, and of modes."""

from types import SimpleNamespace

import numpy as np
import pytest

from hbm.diagnosis.discrepancy import Discrepancy, Known, best_placed
from hbm.diagnosis.missingforce import MissingForce
from hbm.diagnosis.remainder import Remainder
from hbm.diagnosis.verdict import Diagnosis, Errors
from hbm.files.diagnosissummary import _more_modes, first_screen
from models.published import PAPER_BEAM

POINTS, UNKNOWNS = 500, 100
KINDS = {"the clamp": "motion", "sensor a1": "reading", "sensor a2": "reading"}


def found(
    misfit: float, alone: dict[str, float], beside: dict[str, float] | None = None, joints: float | None = None
) -> Discrepancy:
    """Noise variances of a model, and those left by a force at places alone and beside those of what rubs."""

    def at(name: str, left: float, unknowns: int) -> MissingForce:
        place = SimpleNamespace(name=name, kind=KINDS.get(name, "force"), unit="N", against="m")
        rows, share = np.ones((4, 2)), 1.0 - max(left - 1.0, 0.0) / (misfit - 1.0)
        return MissingForce(
            place,
            share,
            left * (POINTS - unknowns),
            left,
            unknowns,
            rows + 0j,
            0.01 * rows,
            rows + 0j,
            rows[:, 0],
            rows[:, 0],
        )

    places = tuple(at(name, left, UNKNOWNS) for name, left in alone.items())
    both = tuple(at(name, left, 2 * UNKNOWNS) for name, left in (beside or {}).items())
    four = np.arange(4), np.full(4, 3.0), np.full(4, 50.0)
    contact = next(
        (
            Known("the contact", False, p.share, p.chi2, p.left, UNKNOWNS)
            for p in places
            if p.place.name == "the contact"
        ),
        None,
    )
    of_joints = None
    if joints is not None:
        share, chi2 = 1.0 - (joints - 1.0) / (misfit - 1.0), joints * (POINTS - UNKNOWNS)
        of_joints = Known("the joints pad and stop", True, share, chi2, joints, UNKNOWNS)
    return Discrepancy(*four, misfit * POINTS, POINTS, places, both, of_joints or contact)


def told(force: Discrepancy) -> tuple[str, str]:
    """Why, and what to measure next."""
    errors = {name: {"train": Errors(0.5, 1e4)} for name in ("nominal", "calibrated")}
    remainder = Remainder({}, 0.5, 1e4, structured=True, places=())
    d = Diagnosis("unexplained", None, {}, 0.82, (), "", remainder, errors, (), (), ())
    said = first_screen(d, force, "", 0.0)
    why, look = said["Why"], said["What to measure next"]
    return why.removeprefix("No cause that was tried takes most of the misfit. "), look.partition("remains. ")[2]


def test_a_contact_that_explains_next_to_all_is_named_alone() -> None:
    """0.03 % are left by the contact alone, of which a sensor beside it would take a half."""
    force = found(1.49e5, {"the contact": 49.4, "the clamp": 4e3}, {"sensor a1": 24.9, "the clamp": 34.1})
    assert told(force) == (
        "An unknown force at the contact would explain over 99.9 % of it.",
        "Look at the contact: the missing force is there, if it is at one place.",
    )


def test_second_places_that_leave_the_same_are_named_together_with_their_share_of_the_rest() -> None:
    """1 - 69.3/119 = 42 % of the rest; 75 is within a tenth of 70.3, 86 is not."""
    beside = {"the clamp": 70.3, "the beam at 56 mm": 70.5, "the beam at 111 mm": 75.0, "the beam at 167 mm": 86.1}
    force = found(2.13e4, {"the contact": 120.0, "the clamp": 4e3}, beside)
    assert told(force) == (
        "An unknown force at the contact would explain 99.4 % of it. Beside it an unknown motion at the clamp or force "
        "at the beam at 56 mm or the beam at 111 mm would explain 41.8 % of the rest. "
        "These records do not tell these places apart.",
        "Look at the contact and at the clamp or the beam at 56 mm or the beam at 111 mm, "
        "which these records do not tell apart.",
    )
    first, second, third, *_ = force.sentences()
    assert first == (
        "The missing motion is that of the clamp beside an unknown force at the contact: explains 42 % of what that "
        "alone leaves, 120 noise variances, and leaves 70.3 noise variances; "
        "next: the beam at 56 mm 42 %, 70.5, the beam at 111 mm 38 %, 75, the beam at 167 mm 28 %, 86.1."
    )
    assert second == "No place alone will do: the contact, the best, leaves 120 noise variances."
    assert third == (
        "Hardly more is left by the beam at 56 mm, the beam at 111 mm: these records do not tell them apart."
    )


def test_a_second_place_that_is_told_apart_is_named() -> None:
    force = found(2e4, {"the contact": 400.0}, {"the clamp": 20.0, "sensor a2": 90.0})
    why, look = told(force)
    assert why.endswith(" of it. Beside it an unknown motion at the clamp would explain 95.2 % of the rest.")
    assert look == "Look at the contact and at the clamp: what is missing is there, if it is at two places."


def test_of_a_rig_with_joints_a_place_is_told_beside_free_forces_at_these() -> None:
    """The joints leave 801 of 1001 noise variances, 237.x beside them 1.2: next to all of it is there."""
    alone = {"78.y": 300.0, "237.x": 500.0}
    why, look = told(found(1001.0, alone, {"237.x": 1.2, "78.y": 290.0}, joints=801.0))
    assert why == (
        "Unknown forces at the joints pad and stop would explain 20 % of it. Beside them an unknown force at 237.x "
        "would explain over 99.9 % of the rest."
    )
    assert look == ("Look at 237.x, then at the joints pad and stop: what is missing is there, if it is at two places.")


def test_joints_whose_forces_explain_all_are_blamed_and_no_place_beside_them() -> None:
    force = found(1001.0, {"78.y": 300.0, "237.x": 500.0}, {"237.x": 1.1, "78.y": 1.05}, joints=1.07)
    assert not force.two and force.own
    assert told(force) == (
        "Unknown forces at the joints pad and stop would explain over 99.9 % of it, more than one at any other place.",
        "Look at the joints pad and stop: the missing forces are there.",
    )
    assert force.sentences()[1] == (
        "With unknown forces at the joints pad and stop, all together, 1.07 noise variances are left: "
        "what is wrong may be there."
    )


def test_of_the_calibrated_rig_file_and_that_as_it_is_the_one_is_told_that_leaves_less(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where the joints alone do, what they leave counts: calibration may leave less of places beside them."""
    own = found(1001.0, {"78.y": 300.0}, {"237.x": 1.1}, joints=1.07)
    beside = found(1001.0, {"78.y": 300.0}, {"237.x": 3.1}, joints=801.0)
    assert (own.left, beside.left) == (1.07, 3.1)
    told = {"calibrated": beside, "nominal": own}
    monkeypatch.setattr("hbm.diagnosis.discrepancy.discrepancy", lambda e, campaign, executor: told[e])
    assert best_placed("calibrated", "nominal", None) is own  # type: ignore[arg-type]
    assert best_placed("nominal", "calibrated", None) is own  # type: ignore[arg-type]


def test_a_contact_that_leaves_a_little_more_than_noise_is_not_blamed_for_what_acts_beside_it() -> None:
    """Noise is known to 8 % of 300 degrees of freedom, three times which is 1.24."""
    for misfit, contact in ((100.0, 1.33), (1e4, 1.4)):
        force = found(misfit, {"the contact": contact, "the clamp": 1.5}, {"the beam at 56 mm": 1.02, "the clamp": 1.3})
        assert told(force)[1].startswith("Look at the contact and at the beam at 56 mm: what is missing is there")
    noisy = found(100.0, {"the contact": 1.2, "the clamp": 1.5}, {"the beam at 56 mm": 1.02, "the clamp": 1.3})
    assert told(noisy)[1].startswith("Look at the contact: the missing force is there")


def test_where_noise_is_left_places_that_leave_more_are_told_apart() -> None:
    """400 degrees of freedom: noise is known to 7 %, three times which is 1.21."""
    force = found(300.0, {"the clamp": 1.0, "sensor a1": 1.2, "sensor a2": 1.3})
    why, look = told(force)
    assert why.startswith("An unknown motion at the clamp or reading at sensor a1 would explain over 99.9 % of it.")
    assert look == "Look at the clamp or sensor a1, which these records do not tell apart."


def test_more_places_than_can_be_listed_are_counted() -> None:
    names = [f"the beam at {10 * i} mm" for i in range(1, 7)]
    _, look = told(found(300.0, {name: 50.0 + 0.5 * i for i, name in enumerate(names)}))
    assert look.endswith("the beam at 40 mm or at 2 other places, which these records do not tell apart.")


@pytest.mark.parametrize(("taken", "said"), [(PAPER_BEAM.modes, False), (PAPER_BEAM.modes + 10, True)])
def test_modes_that_records_took_are_said_where_the_rig_file_keeps_fewer(taken: int, said: bool) -> None:
    campaign = SimpleNamespace(numerics=SimpleNamespace(working=SimpleNamespace(modes=taken)))
    told = _more_modes(SimpleNamespace(extended=SimpleNamespace(beam=PAPER_BEAM), campaign=campaign))
    assert told == (
        f" The records took {taken} modes: set modes = {taken} in its [beam] for the same accuracy." if said else ""
    )


def test_records_held_out_that_the_calibrated_rig_fits_say_nothing_of_a_cause() -> None:
    """Of two errors below noise the ratio is chance."""
    for calibrated, said in ((0.6, "leave noise without it too"), (40.0, "error on records held out 0.5 times")):
        errors = {
            "calibrated": {"held_out": Errors(0.02, calibrated)},
            "extended": {"held_out": Errors(0.01, 0.7)},
        }
        remainder = Remainder({}, 0.01, 1.0, structured=False, places=())
        d = Diagnosis("cause-found", "added-mass", {}, 0.95, (), "", remainder, errors, ("7",), (), ())
        assert said in str(d)
