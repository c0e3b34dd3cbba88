"""The background as a Gaussian process: covariance, likelihood and size, beside closed forms and draws of its own."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.diagnosis.deviations import _disagreement, _mean_square
from hbm.outputerror.background import LARGEST, SIZES, Linear, basis_of, expected_sizes, likeliest_sizes
from hbm.outputerror.records import Record

HZ, LEVELS, CHANNELS, H = np.linspace(48.0, 56.0, 9), (2.0, 5.0), 3, 2
STD = 1e-3


def records(rng):
    """Records of a resonance at two levels; the second harmonic a tenth of the first."""
    out = []
    for i, (level, hz) in enumerate([(level, hz) for level in LEVELS for hz in HZ]):
        y = level / (52.0**2 - hz**2 + 4.0j * hz) * 500.0
        amplitudes = np.outer(np.array([1.0, 0.6, -0.8]), [y, 0.1 * y]) + STD * rng.standard_normal((CHANNELS, H))
        measured = np.array([amplitudes.real, amplitudes.imag])
        std = np.full((CHANNELS, H), STD)
        out.append(
            Record(i + 1, str(i + 1), hz, level, 0.0, measured, std, None, np.zeros((2, 1)), np.full(1, np.nan), level)
        )
    return out


@pytest.fixture(scope="module")
def basis():
    there = records(np.random.default_rng(2))
    return basis_of(there, [r.std for r in there])


def covariance(basis, sizes):
    """Of noise and background, by whitening the identity: W W' is its inverse."""
    W = basis.whiten(sizes, np.eye(basis.points))
    return np.linalg.inv(W.T @ W)


def drawn(basis, sizes, rng):
    """Noise and background."""
    return np.linalg.cholesky(covariance(basis, sizes)) @ rng.standard_normal(basis.points)


def test_a_background_of_no_size_is_noise_alone(basis):
    assert covariance(basis, {}) == pytest.approx(np.eye(basis.points), abs=1e-9)
    assert basis.spread({}) == 0.0


def test_covariance_is_a_share_of_the_response_alike_nearby(basis):
    """On its diagonal noise and a share of what was measured, squared; neighbours go together, harmonics do not."""
    C = covariance(basis, {1: 0.01})
    there = records(np.random.default_rng(2))
    listed = np.concatenate([np.broadcast_to(r.std, r.listed.shape)[r.listed] for r in there])
    assert len(listed) == basis.points
    of_first = basis.harmonics[1].where
    size = np.array([np.abs(r.measured[0] + 1j * r.measured[1])[0, 0] for r in there])
    peak = int(size.argmax())
    own = C[of_first[0][CHANNELS * peak], of_first[0][CHANNELS * peak]]
    assert own == pytest.approx(1.0 + (0.01 * size[peak] / STD) ** 2, rel=0.05)
    second = basis.harmonics[2].where
    assert C[np.ix_(second[0], second[0])] == pytest.approx(np.eye(second.shape[1]), abs=1e-9)
    assert np.abs(C[np.ix_(of_first[0], second[0])]).max() < 1e-9
    sign, determinant = np.linalg.slogdet(C)
    assert sign == 1.0 and basis.spread({1: 0.01}) == pytest.approx(determinant, rel=1e-6)


def test_likelihood_is_that_of_its_covariance_numbers_integrated_out(basis):
    """Beside the dense formula, with one number that is free and one that is known before."""
    rng = np.random.default_rng(4)
    r, J = drawn(basis, {1: 0.005}, rng), rng.standard_normal((basis.points, 2))
    precision, pull = np.array([1e-12, 4.0]), np.array([0.0, 0.3])
    model = Linear(basis, r, J, precision, pull)

    def dense(sizes):
        C = covariance(basis, sizes)
        A = J.T @ np.linalg.solve(C, J) + np.diag(precision)
        b = J.T @ np.linalg.solve(C, r) - precision * pull
        chi2 = r @ np.linalg.solve(C, r) + precision @ pull**2 - b @ np.linalg.solve(A, b)
        return chi2 + np.linalg.slogdet(C)[1] + np.linalg.slogdet(A)[1]

    for sizes in ({}, {1: 0.003}, {1: 0.01, 2: 0.02}):
        assert model.deviance(sizes) == pytest.approx(dense(sizes), rel=1e-8)


def test_its_size_is_found_and_never_more_than_it_may_be(basis):
    """Over draws of one size the likeliest is within a factor of two; of five times the largest it is the largest."""
    nothing = np.zeros((basis.points, 0)), np.zeros(0), np.zeros(0)
    for size, low, high in ((0.0, 0.0, 5e-4), (0.005, 0.002, 0.01), (5 * LARGEST, LARGEST, LARGEST)):
        found = []
        for seed in range(8):
            r = drawn(basis, {1: size}, np.random.default_rng([seed, 7]))
            found.append(likeliest_sizes(Linear(basis, r, *nothing))[1])
        assert low <= np.median(found) <= high


def test_what_a_background_makes_is_white_beside_it(basis):
    """Mean square of one in every harmonic, where noise alone would have many."""
    sizes = {1: 0.01, 2: 0.03}
    rows = np.column_stack([drawn(basis, sizes, np.random.default_rng([seed, 9])) for seed in range(200)])
    white = basis.whiten(sizes, rows)
    assert np.mean(rows**2) > 5.0
    for h in basis.harmonics.values():
        assert np.mean(white[h.where] ** 2) == pytest.approx(1.0, abs=0.05)


def test_records_that_are_missing_are_left_out():
    there = records(np.random.default_rng(2))
    whole = replace(there[0], measured=np.where(np.arange(CHANNELS)[:, None] == 1, np.nan, there[0].measured))
    some = basis_of([whole, *there[1:]], [r.std for r in there])
    assert some.points == basis_of(there, [r.std for r in there]).points - 2 * H
    assert sorted(np.concatenate([h.where.ravel() for h in some.harmonics.values()])) == list(range(some.points))


def test_a_background_that_is_not_seen_may_be_there(basis):
    """Its mean square over all sizes, by hand; more than none, less than what would be seen."""
    nothing = np.zeros((basis.points, 0)), np.zeros(0), np.zeros(0)
    model = Linear(basis, drawn(basis, {}, np.random.default_rng(11)), *nothing)
    likeliest, found = likeliest_sizes(model), expected_sizes(model)
    allowed = [s for s in SIZES if s <= LARGEST]
    likelihood = np.array([np.exp(-0.5 * model.deviance({**likeliest, 1: s})) for s in allowed])
    assert found[1] ** 2 == pytest.approx(likelihood @ np.square(allowed) / likelihood.sum())
    assert likeliest[1] == 0.0 < found[1] < 1e-3
    seen = Linear(basis, drawn(basis, {1: 0.005}, np.random.default_rng(12)), *nothing)
    assert expected_sizes(seen)[1] == pytest.approx(likeliest_sizes(seen)[1], rel=0.5)


@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
def test_numbers_are_as_uncertain_as_the_rig_file_is_wrong(share):
    """One number fitted with all others at their nominal values, which are off by a share of their tolerances.

    Over draws its standard deviation is the size of its error, whatever the share; that of the noise alone is not.
    """
    rng = np.random.default_rng(3)
    tolerance, nothing = 2.0, (np.full(1, 1e-12), np.zeros(1))
    pulls, by_noise = [], []
    for _ in range(300):
        J = rng.standard_normal((60, 13)) + 0.7  # alike: the number may do some of what the others do
        off = np.array([0.3, *share * 2.0 * rng.standard_normal(12)])
        measured = J @ off + rng.standard_normal(60)
        alone = float(J[:, 0] @ measured / (J[:, 0] @ J[:, 0]))
        left = measured - J[:, 0] * alone
        std = np.sqrt(_mean_square(J[:, :1], (tolerance * J[:, 1:],), left, *nothing)[0])
        pulls.append((alone - 0.3) / std)
        by_noise.append((alone - 0.3) * np.linalg.norm(J[:, 0]))
    assert 0.75 < np.sqrt(np.mean(np.square(pulls))) < 1.25
    assert share == 0.0 or np.sqrt(np.mean(np.square(by_noise))) > 2.0


@pytest.mark.parametrize("worse", [1.0, 20.0])
def test_numbers_are_as_uncertain_as_records_disagree(worse):
    """Two numbers, one of them known before, from 30 records of which two may be far off, in all that they say alike.

    Over draws the standard deviation is the size of the error, which that of the noise is only without such records.
    """
    rng = np.random.default_rng(4)
    record, expected = np.repeat(np.arange(30), 20), np.diag([0.0, 1.0 / 0.02])
    J = rng.standard_normal((600, 2)) + 0.7
    covariance = np.linalg.inv(J.T @ J + expected**2)
    off, stds = [], []
    for _ in range(400):
        truth = np.array([0.3, 0.02 * rng.standard_normal()])
        size = np.where(np.isin(record, rng.choice(30, 2, replace=False)), worse, 1.0)
        measured = J @ truth + size * rng.standard_normal(600)
        found = covariance @ (J.T @ measured)
        off.append(found - truth)
        stds.append(np.sqrt(_disagreement(J, measured - J @ found, record, covariance, expected)))
    error = np.sqrt(np.mean(np.square(off), axis=0))
    assert np.sqrt(np.mean(np.square(stds), axis=0)) == pytest.approx(error, rel=0.12)
    assert worse == 1.0 or error[0] > 3.0 * np.sqrt(covariance[0, 0])
