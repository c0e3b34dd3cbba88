"""Imperfections of the true rig: of the size they say, none where none is asked, and a hidden cause on top of them."""

from dataclasses import replace

import numpy as np
import pytest

from tests.truth import ClampFriction, ClampRotation, Coulomb, Settings, SupportFlexibility, Truth, table_1
from tests.truth.background import (
    DRIFT,
    PARTS,
    Background,
    Flaws,
    draw_flaws,
    drifting,
    imperfect,
    other_numerics,
    relative_change,
    slow_path,
)
from tests.truth.blind import Bench, Scene, draw, drawn_size, on_background, run
from tests.truth.effects import Stinger
from tests.truth.hidden import MAKERS, Unfit
from tests.truth.march import newmark, transition
from tests.truth.simulate import Record, simulate_records, taken_early

QUICK = Settings(ramp=6, hold=2, coarse=64, tolerance=1e-6, slow_modes=6, chord=True, retries=0)
RECORDS = tuple(Record(level, hz) for level, hz in ((2.0, 50.0), (6.5, 46.0), (6.5, 60.0), (4.0, 150.0)))
SIZES = (0.004, 0.008)


@pytest.fixture(scope="module")
def plain() -> Truth:
    return simulate_records(table_1(Coulomb(0.52, 4.15e-6), alpha=3.0), RECORDS, 128, QUICK)


@pytest.fixture(scope="module")
def bench(plain: Truth) -> Bench:
    """On a background, of a seed that draws one."""
    return on_background(Bench(plain.rig, plain.rig, RECORDS, 128, 50, 9, QUICK, plain, quick=True), SIZES, 1)


@pytest.fixture(scope="module")
def flaws(plain: Truth) -> Flaws:
    return draw_flaws(plain.rig, len(RECORDS), np.random.default_rng(2))


def test_no_background_changes_no_case() -> None:
    """A case as it was drawn before there were backgrounds."""
    case = draw(50, "E", "added-mass", 3, quick=True)
    # to what releases of NumPy and SciPy make of a march
    assert np.abs(case.spectra.cos).sum() == pytest.approx(696.941084424503, rel=1e-5)
    assert case.rho == pytest.approx(61.20792625958913, rel=1e-5)
    assert (case.answer["background"], case.answer["background_parts"]) == (0.0, {})
    assert case.answer["effect"] > 0


def test_one_rig_in_six_has_none() -> None:
    sizes = np.array([drawn_size(np.random.default_rng(n), 0.0, 0.01) for n in range(600)])
    assert 70 < (sizes == 0).sum() < 130
    assert 0.009 < sizes.max() <= 0.01


def test_the_size_is_about_what_was_asked(bench: Bench) -> None:
    asked, size = float(bench.background["background_asked"]), float(bench.background["background"])
    assert SIZES[0] <= asked <= SIZES[1]
    assert asked / 1.5 < size < 1.5 * asked
    assert bench.nominal.effects == ()
    assert set(bench.background["background_parts"]) == {*PARTS, "numerics"}


def test_a_record_on_another_branch_is_no_background(plain: Truth, bench: Bench, monkeypatch) -> None:
    large = Background(bench.built, (), plain, {}, 2 * SIZES[1])
    monkeypatch.setattr("tests.truth.blind.background_of", lambda *given: large)
    with pytest.raises(Unfit, match="another branch"):
        on_background(replace(bench, truth=plain), SIZES, 1)


def test_every_part_changes_the_response(plain: Truth, flaws: Flaws, bench: Bench) -> None:
    parts = bench.background["background_parts"]
    assert min(parts.values()) > 1e-6
    for part in PARTS[:-1]:
        assert imperfect(plain.rig, flaws, {part: 0.2}) != plain.rig
    assert imperfect(plain.rig, flaws, {}) is plain.rig


def test_flaws_are_as_large_as_they_say(flaws: Flaws, plain: Truth) -> None:
    path = np.array(slow_path(40, np.random.default_rng(3)))
    assert np.ptp(path) == pytest.approx(DRIFT)
    assert abs(path.mean()) < 1e-12
    assert [r.youngs_modulus for r in drifting(plain.rig, (0.0, 1e-3))] == pytest.approx([210e9, 210.21e9])
    bent = imperfect(plain.rig, flaws, {"thickness": 1.0})
    assert bent.bare().M[::2, ::2].sum() == pytest.approx(plain.rig.bare().M[::2, ::2].sum(), rel=1e-3)
    assert np.abs(bent.natural_frequencies(3) / plain.rig.natural_frequencies(3) - 1).max() < 0.02
    damped = imperfect(plain.rig, flaws, {"damping": 1.0})
    at = plain.rig.reduced().omega2[:12]
    np.testing.assert_allclose(damped.damping(at) / plain.rig.damping(at), np.exp(flaws.damping[:12]), rtol=1e-9)
    other = other_numerics(plain.rig, flaws)
    np.testing.assert_allclose(other.natural_frequencies(3), plain.rig.natural_frequencies(3), rtol=1e-4)


def test_a_hidden_cause_is_the_whole_of_its_kind(bench: Bench) -> None:
    """It is softer than the imperfection that it replaces; the others stay, and the stinger stays on the drive."""
    scene = Scene(bench.built, RECORDS, bench.truth, np.random.default_rng(4))

    def kinds(name: str, strength: float) -> list[type]:
        return [type(e) for e in MAKERS[name](scene).rigs(strength).effects]

    assert kinds("clamp-rotation", 1e-6) == [SupportFlexibility, Stinger, ClampRotation]
    assert kinds("clamp-friction", 1e-6) == [SupportFlexibility, Stinger, ClampFriction]
    assert kinds("support-flexibility", 1e-9) == [ClampRotation, Stinger, SupportFlexibility]
    clamp = next(e for e in bench.built.effects if isinstance(e, ClampRotation))
    softer = MAKERS["clamp-rotation"](scene).parameters(1e-6)["stiffness"]
    assert softer == pytest.approx(1 / (1 / clamp.stiffness + 1e-6))
    moved = MAKERS["parameter:excitation.position"](scene).rigs(0.05)
    stinger = next(e for e in moved.effects if isinstance(e, Stinger))
    assert stinger.position == moved.drive != bench.built.drive


def test_the_background_drifts_under_every_cause(bench: Bench) -> None:
    """Also under one that differs from record to record, and where records are taken early."""
    everyone = np.arange(len(RECORDS))
    scene = Scene(bench.built, RECORDS, bench.truth, np.random.default_rng(4))
    drift = MAKERS["drift"](scene)
    rigs = bench.each(drift.rigs(1e-4), everyone)
    plain = bench.each(replace(bench, path=()).each(drift.rigs(0.0), everyone), everyone)
    expected = bench.built.youngs_modulus * (1 + np.array(bench.path))
    np.testing.assert_allclose([r.youngs_modulus for r in plain], expected)
    assert len({r.youngs_modulus for r in rigs}) == len(RECORDS)
    assert [r.youngs_modulus for r in bench.truth.rigs] == pytest.approx(expected)
    early = taken_early(bench.truth, 0.0, 1, 1)
    assert relative_change(early.acceleration, bench.truth.acceleration) < 1e-3
    gain = MAKERS["sensor-gain"](scene)
    assert relative_change(run(bench, gain, 0.0, everyone, 128).acceleration, bench.truth.acceleration) == 0


def test_newmark_agrees_with_the_closed_form() -> None:
    """One step of an oscillator: local errors of the free motion fall by 2^5 with half the step; statics are exact."""
    omega2, d = np.array([[4.0]]), np.array([[0.3]])

    def steps(dt: float, beta: float = 1 / 12) -> tuple[np.ndarray, np.ndarray]:
        rule, exact = (np.array(f).ravel() for f in (newmark(omega2, d, dt, beta), transition(omega2, d, dt)))
        q, v = 0.7, -0.4
        p = omega2[0, 0] * q
        held = rule[:4] @ [q, 0.0, p, p], rule[4:] @ [q, 0.0, p, p]
        assert held == pytest.approx((q, 0.0), abs=1e-12)
        return rule[[0, 1, 4, 5]] @ np.kron(np.eye(2), [[q], [v]]), exact[[0, 1, 4, 5]] @ np.kron(np.eye(2), [[q], [v]])

    for beta, order in ((0.25, 3), (1 / 12, 3)):
        errors = [np.abs(np.subtract(*steps(dt, beta))).max() for dt in (0.1, 0.05)]
        assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.3)
    undamped = [
        np.angle(np.linalg.eigvals(np.array(newmark(omega2, 0 * d, dt)).ravel()[[0, 1, 4, 5]].reshape(2, 2)))
        for dt in (0.2, 0.1)
    ]
    late = [np.abs(a).max() / dt / 2.0 - 1 for a, dt in zip(undamped, (0.2, 0.1), strict=True)]
    assert np.log2(late[0] / late[1]) == pytest.approx(4.0, abs=0.1)
