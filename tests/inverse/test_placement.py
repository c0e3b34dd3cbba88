from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from hbm.errors import InputError
from hbm.fourier import Array
from hbm.inverse.contactforce import regularised
from hbm.inverse.placement import FREQUENCIES, Placement, _Expected, place_sensors
from hbm.inverse.sensing import sensing
from hbm.measurement.spectra import spectra_of
from models.parts import Channel
from models.published import paper_rig

HZ = (45.0, 60.0)
PRESENT = (0.1, 0.2, 0.3, 0.4, 0.5, 0.58)
CHANNELS = (
    Channel("force", "force", 0.555),
    *(Channel(f"a{i}", "acceleration", x) for i, x in enumerate(PRESENT, start=1)),
)
RIG = replace(paper_rig(), channels=CHANNELS)
STRAIGHT = replace(RIG, contact=replace(RIG.contact, foreshortening=False))


def of(positions: Array, noise: float = 0.05) -> Placement:
    return _Expected(RIG, HZ, 9, noise, "acceleration", 1e-3).placement(positions)


def test_layout_beats_a_thousand_at_random_and_the_present_one() -> None:
    best = place_sensors(RIG, hz=HZ)
    rng = np.random.default_rng(3)
    grid = np.linspace(0.02, 0.586, 114)
    expected = _Expected(RIG, HZ, 9, 0.05, "acceleration", 1e-3)
    information = expected.information(grid)
    tried = 0
    while tried < 1000:
        i = np.sort(rng.choice(len(grid), 6, replace=False))
        if np.diff(grid[i]).min() >= 0.02:
            variance = expected.variance(information[i].sum(axis=0)).sum(axis=1).mean()
            assert np.sqrt(variance) >= best.std * (1 - 1e-9)
            tried += 1
    assert np.diff(best.positions).min() > 0.02 - 1e-9
    assert best.before is not None
    assert best.gain == pytest.approx(of(np.array(PRESENT)).std / best.std)
    assert best.gain > 1.2


@pytest.mark.parametrize("force_noise", [1e-3, None])
def test_two_sensors_are_where_all_pairs_tried_say(force_noise: float | None) -> None:
    found = place_sensors(RIG, count=2, hz=HZ, step=0.02, force_noise=force_noise)
    grid = np.linspace(0.02, 0.586, round(0.566 / 0.02) + 1)
    expected = _Expected(RIG, HZ, 9, 0.05, "acceleration", force_noise)
    information = expected.information(grid)
    pairs = [(i, j) for i, j in combinations(range(len(grid)), 2) if grid[j] - grid[i] >= 0.02 - 1e-9]
    best = min(pairs, key=lambda p: expected.variance(information[p[0]] + information[p[1]]).sum(axis=1).mean())
    np.testing.assert_allclose(found.positions, grid[list(best)])


def test_expected_deviation_is_what_reconstructions_of_noisy_records_scatter_by() -> None:
    noise, H, draws = 0.002, 9, 60
    placed = place_sensors(STRAIGHT, hz=HZ, noise=noise)
    rig = placed.rig(STRAIGHT)
    hz = np.linspace(*HZ, FREQUENCIES)
    rng = np.random.default_rng(4)
    k = np.arange(H + 1)
    size = 20.0 * np.maximum(k, 1) ** -2.0
    T = size * np.exp(2j * np.pi * rng.random((len(hz), H + 1))) * (k > 0)
    F = np.where(k == 1, 6.5, 0.0) * np.ones((len(hz), 1))
    std = {c.name: np.full((len(hz), H + 1), 1e-3 if c.quantity == "force" else noise) for c in rig.channels}

    def spectra(amplitudes: dict[str, np.ndarray]):  # type: ignore[no-untyped-def]
        rows = {n: np.concatenate([a.real, -a.imag[:, 1:]], axis=1) for n, a in amplitudes.items()}
        return spectra_of(rig, hz, np.full(len(hz), 6.5), rows, std)

    empty = sensing(rig, spectra({name: np.zeros_like(T) for name in std}))
    clean = {name: empty.by_friction[..., i] * T + empty.by_force[..., i] * F for i, name in enumerate(empty.channels)}
    clean["force"] = F.astype(complex)
    squares = np.zeros((len(hz), H))
    for _ in range(draws):
        drawn = {n: a + std[n] * (rng.normal(size=a.shape) + 1j * rng.normal(size=a.shape)) for n, a in clean.items()}
        estimate = regularised(sensing(rig, spectra(drawn)), np.zeros(len(hz)))
        squares += np.abs(estimate.friction[:, 1:] - T[:, 1:]) ** 2 / 2
    variance = squares / draws
    np.testing.assert_allclose(np.sqrt(variance.mean(axis=0)), placed.by_harmonic, rtol=0.05)
    assert np.sqrt(variance.sum(axis=1).mean()) == pytest.approx(placed.std, rel=0.05)


def test_more_sensors_and_less_noise_know_friction_better() -> None:
    six, twelve = (place_sensors(RIG, hz=HZ, count=n).std for n in (6, 12))
    assert twelve < six
    assert of(np.array(PRESENT), noise=0.01).std < of(np.array(PRESENT)).std


def test_says_what_was_found() -> None:
    lines = str(place_sensors(RIG, hz=HZ)).splitlines()
    assert lines[0].startswith("sensors at ")
    assert lines[2].startswith("present sensors at 100, 200, 300, 400, 500, 580 mm: ")
    assert lines[-1].endswith("times less uncertain")


def test_refuses_more_sensors_than_fit() -> None:
    with pytest.raises(InputError) as refusal:
        place_sensors(RIG, hz=HZ, count=40)
    assert str(refusal.value) == (
        "place_sensors: count = 40; must be 1 to 29: 606 mm of beam, 20 mm left free at each end, 20 mm apart"
    )
