"""What differs from record to record: harmonics of the force, and drift; against the independent simulator too."""

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from types import SimpleNamespace

import numpy as np
import pytest

import hbm.diagnosis.quickfits as quickfits
import hbm.diagnosis.signatures as signatures
import hbm.outputerror.campaign as records
import hbm.outputerror.records as records_of_spectra
import hbm.outputerror.together as together
from continuation import ConvergenceError
from hbm import load_rig, load_spectra
from hbm.diagnosis.candidates import fit_candidates
from hbm.diagnosis.decide import DECISIVE, evidence
from hbm.diagnosis.nocause import NoCause
from hbm.diagnosis.order import ROOM, drifts_beyond_rooms, drifts_within_levels, rooms_do
from hbm.diagnosis.restart import led_to
from hbm.diagnosis.screen import coarse, screen, small
from hbm.diagnosis.signatures import scores
from hbm.fourier import FourierBasis
from hbm.outputerror.evaluation import evaluate
from hbm.outputerror.fit import Descent, begun_at, best_start, descended, fit_model, found_again
from hbm.outputerror.measured import campaign_of
from hbm.outputerror.model import Model
from hbm.outputerror.numerics import Grid, Numerics
from hbm.outputerror.records import force_columns
from hbm.outputerror.simulated import in_record
from hbm.parallel import each
from models.causes.clamp import ClampFriction
from models.causes.parameter import WrongParameter
from models.causes.records import ForceDistortion, NotSteady, ParameterDrift
from models.causes.structure import AttachedResonator
from models.parts import Drift
from models.published import paper_rig
from models.scalars import FORCE
from tests.truth import Coulomb, Settings, Tone, measure, scattered, simulate_records, table_1, write_rig, write_spectra
from tests.truth.hidden import changed

MU, E, LOAD = "contact.friction.mu", "beam.youngs_modulus", "contact.normal_load"
RATE, H = -1e-2, 5
PLAIN = replace(table_1(Coulomb(mu=0.52, critical_slip=4.15e-6)), elements=24, modes=10)
TONES = (Tone(2, 0.02, 0.7), Tone(3, -0.03, 2.0))
POINTS = [(6.5, 47.0), (6.5, 49.0), (3.0, 50.0), (6.5, 51.5), (6.5, 55.0), (6.5, 58.0)]
DISTORTION, DRIFT = ForceDistortion(), ParameterDrift(MU)
STICKING = 1e3


def campaign(folder, spectra, **options):
    """The nominal rig and its records on a discretisation that resolves them."""
    write_rig(folder / "rig.toml", PLAIN, amplitude=6.5)
    write_spectra(folder / "spectra.csv", spectra, **options)
    rig = load_rig(folder / "rig.toml")
    grid = Grid(FourierBasis(15, 512), 10)
    numerics = Numerics(grid, grid, grid, 0.0)
    return rig, campaign_of(rig, load_spectra(folder / "spectra.csv", rig), numerics)[0]


@pytest.fixture(scope="module")
def truth():
    """Friction that falls from record to record, under a force with a second and a third harmonic of any phase."""
    distorted = replace(PLAIN, distortion=TONES)
    records = scattered(POINTS, np.random.default_rng(5))
    quick = Settings(ramp=15, hold=5, coarse=128, tolerance=1e-7, chord=True)
    found = simulate_records([changed(distorted, MU, 1 + RATE * i) for i in range(len(POINTS))], records, 512, quick)
    assert found.usable.all()
    return found


@pytest.fixture(scope="module")
def measured(truth, tmp_path_factory):
    """Noise of 0.3 % on the accelerometers and 0.1 % on the force."""
    return campaign(
        tmp_path_factory.mktemp("measured"), measure(truth, 50.0, np.random.default_rng(1), 60.0, harmonics=H)
    )


@pytest.fixture
def exactly(monkeypatch):
    """Solutions converged to rounding."""
    monkeypatch.setattr(records_of_spectra, "TOLERANCE", 2e-13)


# ---- the truth is explained by what is hidden in it, and by nothing less


def reduced(rig, data, causes, rate=RATE):
    model = Model(rig, {}, causes)
    x = np.array([f.of(rate) for f in model.free])
    return evaluate(model, data, x, {}).white


def test_noise_is_left_where_the_force_is_distorted_and_friction_drifts(measured):
    rig, data = measured
    both = reduced(rig, data, (DISTORTION, DRIFT))
    assert both.chi2 / len(both) == pytest.approx(1.0, abs=4 * np.sqrt(2 / len(both)))
    for fewer in ((), (DISTORTION,), (DRIFT,)):
        white = reduced(rig, data, fewer)
        assert white.chi2 / len(white) > 3.0, fewer
    assert data.data.distorted > 20.0


def test_rate_of_the_drift_is_found(measured):
    rig, data = measured
    model = Model(rig, {}, (DISTORTION, DRIFT))
    found = fit_model(model, data, model.start, {})
    assert model.values(found.x, 1)["rate"] == pytest.approx(RATE, abs=3 * found.std[0])
    assert found.std[0] < 0.1 * abs(RATE)


def test_a_drift_goes_on_within_levels(measured, tmp_path):
    """Friction that falls from record to record, and one that is another at each of two levels measured in turn."""
    rig, data = measured
    found = fit_model(model := Model(rig, {}, (DISTORTION, DRIFT)), data, model.start, {})
    assert drifts_within_levels(found, data)
    records = scattered([(3.0, 49.0), (3.0, 50.0), (3.0, 51.5), *POINTS[3:], (6.5, 49.0)], np.random.default_rng(5))
    by_level = [changed(PLAIN, MU, 1.0 if r.level < 4.0 else 0.95) for r in records]
    truth = simulate_records(by_level, records, 512, Settings(ramp=15, hold=5, coarse=128, tolerance=1e-7, chord=True))
    rig, data = campaign(tmp_path, measure(truth, 50.0, np.random.default_rng(1), 60.0, harmonics=H))
    found = fit_model(model := Model(rig, {}, (DRIFT,)), data, model.start, {})
    assert found.chi2 < 0.2 * evaluate(Model(rig, {}), data, np.zeros(0), {}).chi2  # it looks like a drift
    assert not drifts_within_levels(found, data)


@pytest.mark.parametrize(("times", "beyond"), [(-0.9, False), (1.1, True)])
def test_a_drift_of_what_a_room_does_is_no_cause(measured, times, beyond):
    rig, data = measured
    rate = times * ROOM / (max(data.numbers) - min(data.numbers))
    model = Model(rig, {}, (ParameterDrift(E),))
    found = evaluate(model, data, np.array([f.of(rate) for f in model.free]), {})
    assert drifts_beyond_rooms(found) is beyond
    assert drifts_beyond_rooms(evaluate(Model(rig, {}), data, np.zeros(0), {}))


def test_a_drift_that_one_of_a_room_does_for_is_no_cause(measured):
    """Of friction, where one of the stiffness that is no more than a room's explains as much, but not far less."""
    rig, data = measured
    room = ROOM / (max(data.numbers) - min(data.numbers))
    large, small = (
        evaluate(model := Model(rig, {}, (ParameterDrift(key),)), data, np.array([model.free[0].of(rate)]), {})
        for key, rate in ((MU, 3.0 * room), (E, 0.5 * room))
    )
    as_well = replace(small, white=large.white)
    far_less = replace(small, white=replace(large.white, residual=1.1 * large.white.residual))
    assert rooms_do(large, [large, as_well], DECISIVE)
    assert not rooms_do(large, [large, far_less], DECISIVE)
    assert not rooms_do(large, [large, replace(large, x=2.0 * large.x)], DECISIVE)
    assert not rooms_do(evaluate(Model(rig, {}), data, np.zeros(0), {}), [as_well], DECISIVE)


@pytest.mark.parametrize(("times", "verdict"), [(-0.5, "consistent"), (3.0, "unexplained")])
def test_what_a_room_does_is_no_cause_and_told(measured, times, verdict):
    """Where it leaves noise, and the rig file as it is does not; what drifts by more is no room."""
    rig, data = measured
    nominal = evaluate(Model(rig, {}), data, np.zeros(0), {})
    model = Model(rig, {}, (ParameterDrift(E),))
    rate = times * ROOM / (max(data.numbers) - min(data.numbers))
    drift = evaluate(model, data, np.array([model.free[0].of(rate)]), {})
    noise = np.random.default_rng(0).standard_normal(len(drift.white))
    explains = replace(drift, white=replace(drift.white, residual=noise))
    judged = NoCause(Model(rig, {}), nominal, nominal, [explains], data, lambda e: None)
    assert judged.verdict == verdict
    assert judged.told[:36] == ("beam.youngs_modulus drifts by -0.10%" if times < 0.0 else "")
    assert NoCause(Model(rig, {}), nominal, nominal, [drift], data, lambda e: None).verdict == "unexplained"


def test_phases_of_the_harmonics_are_those_of_the_file(measured):
    """Mirrored or turned the other way they explain less than no harmonics at all."""
    rig, data = measured
    without = reduced(rig, data, (DRIFT,)).chi2
    for sign in ((1, -1), (-1, -1)):
        wrong = tuple(replace(r, distortion=r.distortion * np.array(sign)[:, None]) for r in data.data.records)
        spoilt = replace(data, data=replace(data.data, records=wrong))
        assert reduced(rig, spoilt, (DISTORTION, DRIFT)).chi2 > without


def test_noise_of_the_harmonics_of_the_force_is_in_the_comparison(truth, tmp_path):
    """Of 1 %; where they are taken for known it shows in the response."""
    rig, data = campaign(tmp_path, measure(truth, 50.0, np.random.default_rng(1), 40.0, harmonics=H))
    white = reduced(rig, data, (DISTORTION, DRIFT))
    assert white.chi2 / len(white) == pytest.approx(1.0, abs=4 * np.sqrt(2 / len(white)))
    known = tuple(replace(r, distortion_std=1e-6 * r.distortion_std) for r in data.data.records)
    surer = replace(data, data=replace(data.data, records=known))
    white = reduced(rig, surer, (DISTORTION, DRIFT))
    assert white.chi2 / len(white) > 1.0 + 8 * np.sqrt(2 / len(white))


# ---- derivatives


def simulated(data, rig, keys, near):
    return data.simulate(rig, keys, {n: s.solution.state for n, s in near.items()})


def test_rates_and_what_drifts_have_exact_derivatives(measured, exactly):
    """Central differences of converged solutions; two numbers drift, one of them a property of the structure."""
    rig, data = measured
    few = data.of([1, 4, 6])
    rig = replace(DISTORTION.extend(rig, {}), drift=(Drift(MU, RATE), Drift(E, 2e-4)))
    keys = ("drift[0].rate", "drift[1].rate", MU, E, LOAD)
    first = few.simulate(rig, keys, {})
    here = simulated(few, rig, keys, first)
    for i, key in enumerate(keys):
        now = rig.number(key)
        step = 1e-6 * (1.0 if key.endswith("rate") else now)
        up, down = (simulated(few, rig.with_number(key, now + moved), keys, here) for moved in (step, -step))
        for n in few.numbers:
            differences = (up[n].amplitudes - down[n].amplitudes) / (2 * step)
            # rounding of the solutions, over the step
            rounding = 1e-6 * max(np.abs(differences).max(), 1e-2 * np.abs(here[n].amplitudes).max() / abs(now))
            assert here[n].by_keys[..., i] == pytest.approx(differences, abs=rounding), (key, n)
    assert not here[1].by_keys[..., 0].any() and here[6].by_keys[..., 0].any()


def test_force_columns_are_what_the_noise_of_the_force_does(measured, exactly):
    """Against solutions under other forces, in the time of the file: central differences to each part that is measured.

    A record is turned by the phase of its force; its response is turned back.
    """
    rig, data = measured
    data = data.of([4])
    record, rig = data.data.records[0], DISTORTION.extend(rig, {})
    k = np.arange(1, H + 1)
    force = np.append(record.force, record.distortion[0] - 1j * record.distortion[1])
    here = data.simulate(rig, (), {})

    def response(parts):
        """Amplitudes (2, c, H) under a force with these real and imaginary parts of its harmonics."""
        F = parts[:H] + 1j * parts[H:]
        turn = np.exp(-1j * np.angle(F[0]) * k)
        turned = (F * turn)[1:]
        other = replace(record, force=abs(F[0]), distortion=np.array([turned.real, -turned.imag]))
        moved = replace(data, data=replace(data.data, records=(other,)))
        real, imaginary = simulated(moved, rig, (), here)[4].amplitudes
        back = (real + 1j * imaginary) / turn
        return np.array([back.real, back.imag])

    s = here[4]
    columns = force_columns(record, s.amplitudes, s.by_force, s.by_tones)
    parts = np.concatenate([force.real, force.imag])
    # amplitude and phase; then cos, the real part, and sin, less the imaginary part, of harmonics 2 to H
    places = [0, H, *np.column_stack([1 + np.arange(H - 1), H + 1 + np.arange(H - 1)]).ravel()]
    signs = [1, 1, *([1, -1] * (H - 1))]
    stds = [record.force_std] * 2 + np.repeat(record.distortion_std, 2).tolist()
    assert columns.shape == (2 * H, 2, 6, H)
    for column, place, sign, std in zip(columns, places, signs, stds, strict=True):
        step = 1e-5 * np.eye(2 * H)[place]
        differences = sign * std * (response(parts + step) - response(parts - step)) / 2e-5
        assert column == pytest.approx(differences, abs=1e-5 * np.abs(differences).max())


# ---- what is not there


def test_a_record_is_simulated_under_the_harmonics_that_were_measured(truth, tmp_path):
    """Without rows of the force's harmonics nothing is known of them, and nothing changes."""
    spectra = measure(truth, 50.0, np.random.default_rng(1), harmonics=H)
    rig, data = campaign(tmp_path, spectra)
    record = data.data.records[2]
    assert [k for k, _, _ in record.tones] == [2, 3, 4, 5]
    assert record.rig(rig).excitation.harmonics == ()
    assert record.rig(DISTORTION.extend(rig, {})).excitation.harmonics == record.tones
    file = tmp_path / "spectra.csv"
    rows = file.read_text().splitlines(keepends=True)
    fundamental = [row for row in rows if ",force," not in row or ",force,1," in row]
    third = [row for row in rows if ",force,3," in row and row.startswith("3,")]
    for kept, harmonics in ((fundamental, []), ([*fundamental, *third], [3])):
        file.write_text("".join(kept))
        few = campaign_of(rig, load_spectra(file, rig), data.numerics)[0]
        assert [k for k, _, _ in few.data.records[2].tones] == harmonics
        assert few.data.records[1].tones == ()
        assert (few.data.distorted is None) == (not harmonics)
        bare, marked = (reduced(rig, few.of([2]), causes) for causes in ((), (DISTORTION,)))
        np.testing.assert_allclose(bare.residual, marked.residual, rtol=1e-8, atol=1e-8)  # noise's deviations
    whole = reduced(rig, few.of([3]), (DISTORTION,))
    assert not np.array_equal(whole.residual, reduced(rig, few.of([3]), ()).residual)


def test_records_where_a_property_would_vanish_are_left_out(measured):
    rig, data = measured
    few = data.of([1, 2, 6])
    assert few.data.records[2].number == 6
    assert list(few.solve(replace(rig, drift=(Drift(MU, -0.2),)), {})) == [1, 2]
    with pytest.raises(ConvergenceError, match="record 6 has lost its steady state"):
        few.simulate(replace(rig, drift=(Drift(MU, -0.2),)), (), {}, needed=(6,))
    assert list(few.simulate(replace(rig, drift=(Drift("contact.friction.stiffness", 1e-3),)), (), {})) == []
    with pytest.raises(ValueError, match=r"^drift of contact.friction.mu: 0 times its value in record 6; must be > 0$"):
        replace(rig, drift=(Drift(MU, -0.2),)).at_record(6)


def test_a_record_of_its_force_alone_counts_for_nothing(measured):
    rig, data = measured
    first = data.data.records[0]
    silent = replace(first, measured=np.full_like(first.measured, np.nan))
    whole = replace(data, data=replace(data.data, records=(silent, *data.data.records[1:])))
    white, others = (reduced(rig, some, (DISTORTION, DRIFT)) for some in (whole, data.of(data.numbers[1:])))
    assert white.spreads[1] == 0.0 and white.spread == others.spread
    assert np.array_equal(white.residual, others.residual)


# ---- numbers of a rig that drifts


def test_a_record_has_its_own_numbers():
    rig = replace(paper_rig(), drift=(Drift(MU, 0.01), Drift(E, -0.02)))
    assert rig.at_record(1).drift == () and rig.at_record(1).number(MU) == rig.number(MU)
    fourth = rig.at_record(4)
    assert fourth.number(MU) == pytest.approx(1.03 * rig.number(MU), rel=1e-15)
    assert fourth.number(E) == pytest.approx(0.94 * rig.number(E), rel=1e-15)
    record = SimpleNamespace(number=4, level=6.5, force=6.4)
    own, by_keys = in_record(rig, ("drift[1].rate", MU, E, LOAD), record)
    assert own == (E, MU, LOAD, FORCE)
    assert by_keys == pytest.approx(np.array([[3 * 210e9, 0, 0.94, 0], [0, 1.03, 0, 0], [0, 0, 0, 1.0], [0] * 4]))
    assert rig.with_number("drift[1].rate", 0.25).number("drift[1].rate") == 0.25
    with pytest.raises(KeyError, match="is not a number of the rig"):
        rig.number("drift[2].rate")


def test_what_drifts_already_is_not_offered_again():
    rig = paper_rig()
    keys = [c.parameter for c in ParameterDrift.candidates(rig)]
    assert keys == [E, "damping.mass_proportional", LOAD, MU, "contact.friction.critical_slip"]
    drifting = DRIFT.extend(rig, {"rate": 1e-3})
    assert DRIFT not in list(ParameterDrift.candidates(drifting))
    assert ParameterDrift(E).unknowns(drifting)[0].key == "drift[1].rate"
    assert list(ForceDistortion.candidates(rig)) == [DISTORTION]
    assert list(ForceDistortion.candidates(DISTORTION.extend(rig, {}))) == []
    assert list(ForceDistortion.candidates(replace(rig, channels=rig.channels[1:]))) == []


# ---- side by side


def test_processes_give_what_one_core_gives(measured):
    rig, data = measured
    model = Model(rig, {MU: 0.02}, (DRIFT,))
    alone = evaluate(model, data, model.start, {})
    corrected = data.corrected(rig, alone.solutions).corrections
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        shared = replace(data, executor=pool)
        together = evaluate(model, shared, model.start, {})
        likewise = shared.corrected(rig, alone.solutions).corrections
    np.testing.assert_array_equal(together.white.residual, alone.white.residual)
    np.testing.assert_array_equal(together.white.jacobian, alone.white.jacobian)
    assert list(likewise) == list(corrected)
    for record, correction in corrected.items():
        np.testing.assert_array_equal(likewise[record].added, correction.added)


def test_candidates_are_fitted_alike_side_by_side(measured):
    rig, every = measured
    data, bare = every.of(every.numbers[::2]), Model(rig, {})
    base = evaluate(bare, data, bare.start, {})
    candidates = [WrongParameter(MU), WrongParameter(E), WrongParameter(LOAD), ParameterDrift(MU), ParameterDrift(LOAD)]
    screening = screen(base, data, candidates)
    alone = fit_candidates(quickfits.QuickFits(base, data), screening, lambda doing: None, lambda e: False)
    with ThreadPoolExecutor(2) as pool:
        shared = quickfits.QuickFits(base, replace(data, executor=pool))
        together = fit_candidates(shared, screening, lambda doing: None, lambda e: False)
    assert not small(base)
    assert [e.model.label for e in together] == [e.model.label for e in alone]
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_allclose(one.x, other.x, rtol=1e-12)


def noted(done: list[int], item: int) -> int:
    """How many items a task has done."""
    done.append(item)
    return len(done)


def test_all_parts_in_a_process_share_a_task_and_what_it_has_worked_out():
    task: partial[int] = partial(noted, [])
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        assert each(pool, task, range(20)) == list(range(1, 21))
        assert each(pool, partial(noted, [0]), range(3)) == [2, 3, 4]
    assert task.args == ([],)


# ---- fits that are of no use end early


def test_a_fit_that_cannot_reach_what_is_of_use_ends(measured):
    rig, data = measured
    model = Model(rig, {}, (DISTORTION, DRIFT))
    whole = fit_model(model, data, model.start, {})
    kept = fit_model(model, data, model.start, {}, reach=whole.chi2 + 1.0)
    ended = fit_model(model, data, model.start, {}, reach=-1e12)
    np.testing.assert_array_equal(kept.x, whole.x)
    assert whole.chi2 < ended.chi2 < evaluate(model, data, model.start, {}).chi2


def test_steps_that_are_gone_on_with_are_those_taken_at_once(measured):
    """Also where the first of them end because they would not get to what is of use."""
    rig, data = measured
    model = Model(rig, {}, (DISTORTION, DRIFT))
    begun = Descent(begun_at(model, data, model.start, {}))
    whole = descended(begun, data, {}, 8)
    early = descended(begun, data, {}, 8, reach=-1e12)
    assert 0 < early.taken < whole.taken
    for first in (early, descended(begun, data, {}, 2)):
        further = descended(first, data, {}, 8)
        assert (further.taken, further.ended) == (whole.taken, whole.ended)
        np.testing.assert_array_equal(further.here.x, whole.here.x)


def test_of_a_start_beyond_use_not_all_records_are_solved(measured, monkeypatch):
    """The others are told to the last digit, and one that is of no use is behind them."""
    rig, data = measured
    last = evaluate(Model(rig, {}), data, Model(rig, {}).start, {}).solutions
    model = Model(rig, {}, (ParameterDrift("beam.youngs_modulus"),))  # of the structure: records are solved one by one
    _, high = model.bounds()
    starts, asked = [model.start, model.start + 0.05 * (high - model.start)], list[int]()
    solve = together.steady

    def counted(rig, basis, record, start):
        asked.append(record.number)
        return solve(rig, basis, record, start)

    monkeypatch.setattr(together, "steady", counted)
    whole = best_start(model, data, starts, last)
    assert len(asked) == 2 * len(data.numbers) and whole[1][0] > 3.0 * whole[0][0]
    asked.clear()
    limit = 1.1 * whole[0][0]
    limited = best_start(model, data, starts, last, limit=limit)
    assert limited[0][0] == whole[0][0] and limit < limited[1][0] <= whole[1][0]
    assert [x is y for (_, x), (_, y) in zip(limited, whole, strict=True)] == [True, True]
    assert len(data.numbers) < len(asked) < 2 * len(data.numbers)


def test_resonators_without_mass_are_scored_as_each_alone(measured, monkeypatch):
    """Whatever others are in the same rig."""
    rig, data = measured
    base = evaluate(Model(rig, {}), data, Model(rig, {}).start, {})
    few, resonator = coarse(data, data.numbers), AttachedResonator()
    beside = scores(base, few, [resonator])
    monkeypatch.setattr(signatures, "MOST_RESONATORS", 1)
    alone = scores(base, few, [resonator])
    assert len(beside) == len(alone) > 2 * 6
    strong = max(s.drop for s in alone)
    for one, other in zip(alone, beside, strict=True):
        assert other.drop == pytest.approx(one.drop, rel=1e-2, abs=1e-3 * strong)
        assert float(one.signature @ other.signature) == pytest.approx(1.0, abs=1e-4)


def test_no_quick_fit_is_made_again(measured, monkeypatch):
    """More steps go on from where the last ones ended; starts are compared anew where others are given."""
    rig, every = measured
    data, bare = every.of(every.numbers[::2]), Model(rig, {})
    base = evaluate(bare, data, bare.start, {})
    scores = screen(base, data, [DRIFT, WrongParameter(E)]).scores
    quick, asked = quickfits.QuickFits(base, data), list[str]()

    def counted(name):
        made = getattr(quickfits, name)

        def noted(*arguments):
            asked.append(name)
            return made(*arguments)

        monkeypatch.setattr(quickfits, name, noted)

    for name in ("begun_at", "_stepped", "_compared"):
        counted(name)
    first = quick.run(scores, steps=2)
    begun = asked.count("begun_at")
    assert begun == asked.count("_stepped") > 0 and asked.count("_compared") == 2
    again = quick.run(scores, steps=2)
    assert asked.count("_stepped") == begun
    assert [r.chi2 for r in again] == [r.chi2 for r in first]
    further = quick.run(scores, steps=5)
    assert asked.count("_stepped") > begun == asked.count("begun_at")
    at_once = quickfits.QuickFits(base, data).run(scores, steps=5)
    assert [r.chi2 for r in further] == [r.chi2 for r in at_once]
    before = asked.count("_compared")
    quick.run([replace(scores[0], starts=(scores[0].start,))], steps=2)
    assert asked.count("_compared") == before + 1


@pytest.mark.parametrize("share", [0.9, 0.5, 0.1])
def test_a_limit_that_does_good_between_two_values_only_is_found(monkeypatch, share):
    """The clamp slips in one record: of two values tried one after the other, one is not reached, one slips too far."""
    model = Model(paper_rig(), {}, (ClampFriction(),))
    stiffness, limit = model.unknowns[-1]
    high, low = limit.starts[8:10]
    true = low * (high / low) ** share

    def misfit(value):
        off = np.log(value / true) ** 2
        return min(STICKING, 10.0 + 1e7 * off) if value > true else 10.0 + 4e5 * off

    def compared(model, campaign, starts, last):
        return [(misfit(model.values(starts[0], 0)["limit"]), starts[0])]

    monkeypatch.setattr(quickfits, "best_start", compared)
    monkeypatch.setattr(quickfits, "fit_model", lambda model, campaign, x, *others: model.values(x, 0)["limit"])
    x = np.array([f.of(u.starts[1 - i]) for i, (f, u) in enumerate(zip(model.free, (stiffness, limit), strict=True))])
    sticking = SimpleNamespace(chi2=lambda solutions: {1: STICKING})
    (found,) = quickfits.with_limits(SimpleNamespace(model=model, x=x, solutions={}), sticking, 7)
    assert misfit(found) < 0.3 * STICKING


def test_a_record_that_is_needed_must_be_found(measured, monkeypatch):
    rig, data = measured
    bare, lost = Model(rig, {}), data.numbers[2]
    solve = records.simulated_together

    def without_one(rig, basis, measurement, keys, those, last):
        found = solve(rig, basis, measurement, keys, those, last)
        return [None if r.number == lost else s for r, s in zip(those, found, strict=True)]

    monkeypatch.setattr(records, "simulated_together", without_one)
    assert evaluate(bare, data, bare.start, {}).missing == (lost,)
    with pytest.raises(ConvergenceError, match=f"record {lost} has lost its steady state"):
        fit_model(bare, data, bare.start, {}, needed={lost})


def test_a_record_that_was_lost_is_looked_for_from_nothing(measured, monkeypatch):
    rig, data = measured
    bare, lost = Model(rig, {}), data.numbers[2]
    solve = records.simulated_together

    def nowhere_near(rig, basis, measurement, keys, those, last):
        astray = [r.number == lost and start is None for r, start in zip(those, last, strict=True)]
        found = solve(rig, basis, measurement, keys, those, last)
        return [None if gone else s for gone, s in zip(astray, found, strict=True)]

    monkeypatch.setattr(records, "simulated_together", nowhere_near)
    without = evaluate(bare, data, bare.start, {})
    again = found_again(without, data)
    assert without.missing == (lost,) and again.missing == ()
    assert again.white.deviance(data.numbers[0]) == pytest.approx(without.white.deviance(data.numbers[0]))
    assert not fit_model(bare, data, bare.start, {}, needed={lost}).missing


def test_a_record_without_a_steady_state_is_looked_for_once(measured, monkeypatch):
    """From nothing, which may take as long as all else."""
    rig, data = measured
    bare, (lost, hopeless) = Model(rig, {}), data.numbers[2:4]
    simulate, solve, asked = records.simulated_together, records.steady_together, []

    def nowhere_near(rig, basis, measurement, keys, those, starts):
        asked.append([r.number for r in those])
        found = simulate(rig, basis, measurement, keys, those, starts)
        gone = [r.number in (lost, hopeless) and start is None for r, start in zip(those, starts, strict=True)]
        return [None if away else s for away, s in zip(gone, found, strict=True)]

    def but_one(rig, basis, those, starts):
        return [
            None if r.number == hopeless else s for r, s in zip(those, solve(rig, basis, those, starts), strict=True)
        ]

    monkeypatch.setattr(records, "simulated_together", nowhere_near)
    monkeypatch.setattr(records, "steady_together", but_one)
    again = found_again(evaluate(bare, data, bare.start, {}), data)
    assert again.missing == (hopeless,)
    assert [hopeless in numbers for numbers in asked] == [True, False]


# ---- quick fits


def test_no_record_leads_the_quick_fits(measured):
    """Missed a thousand times as much as the others it weighs as the middle one of them does."""
    rig, data = measured
    model = Model(rig, {})
    base = evaluate(model, data, model.start, {})
    loud = data.numbers[2]
    times = np.where(base.white.record == loud, 1e3, 1.0)
    quick = quickfits.QuickFits(replace(base, white=replace(base.white, residual=base.white.residual * times)), data)
    missed = {n: float(np.mean((base.white.residual * times)[base.white.record == n] ** 2)) for n in quick.few.numbers}
    usual = np.median([m for m in missed.values() if m > quickfits.MISSED])
    plain = {r.number: data.std(r) for r in data.data.records}
    for r in quick.few.data.records:
        wider = np.sqrt(max(missed[r.number] / usual, 1.0))
        assert quick.few.std(r) == pytest.approx(wider * plain[r.number], rel=0.02)  # beside the coarse grid's error
    points = {n: int(np.sum(base.white.record == n)) for n in missed}
    assert quick.before == pytest.approx(sum(points[n] * min(m, usual) for n, m in missed.items()))
    assert missed[loud] > 100 * usual


def test_what_is_free_in_each_record_crowds_no_cause_out(measured, monkeypatch):
    """Transients take nearly all of few records, and the quick fit of the true cause has not come as far yet."""
    rig, data = measured
    base = evaluate(Model(rig, {}), data, Model(rig, {}).start, {})
    left = {DRIFT.label: 40.0, NotSteady.name: 1.0}

    def run(quick, scores, *_args, **_options):
        models = [base.model.extended_by(s.cause) for s in scores]
        return [quickfits.Candidate(m.causes[0], left[m.causes[0].label] * quick.few.points, m.start) for m in models]

    monkeypatch.setattr(quickfits.QuickFits, "run", run)
    monkeypatch.setattr(quickfits.QuickFits, "ordered", lambda quick, scores: list(scores))
    screening = screen(base, data, [DRIFT, NotSteady()])
    done = fit_candidates(quickfits.QuickFits(base, data), screening, lambda doing: None, lambda e: True)
    assert {e.model.causes[0].label for e in done} == set(left)


def test_the_first_of_a_pair_that_led_to_the_second_is_left_out(measured):
    """A load that is right, beside the drift that was hidden: without it the drift is as large, and likelier."""
    rig, data = measured
    base = evaluate(Model(rig, {}), data, Model(rig, {}).start, {})
    known = Model(replace(rig, excitation=replace(rig.excitation, measured_harmonics=True)), {})
    over = evaluate(known, data, known.start, {})
    pair = known.extended_by(WrongParameter(LOAD)).extended_by(DRIFT)
    both = fit_model(pair, data, pair.start, over.solutions)
    (alone,) = led_to(over, both, data)
    assert alone.model.causes == (DRIFT,)
    assert alone.model.values(alone.x, 0)["rate"] == pytest.approx(RATE, rel=0.1)
    assert evidence(alone) < evidence(both)
    assert led_to(base, alone, data) == []
