import numpy as np
import pytest

from hbm.diagnosis.coherent import alike
from hbm.diagnosis.misfit import SIGNIFICANCE, Misfit, _misfit
from hbm.outputerror.whitened import Whitened

HZ = {n: (50.0 if n <= 24 else 160.0) + 0.3 * n for n in range(1, 37)}
CHANNELS, HARMONICS = 6, 9


def whitened(residual: np.ndarray) -> Whitened:
    """Of residuals (records, 2, channels, harmonics)."""
    record, part, channel, harmonic = (i.ravel() for i in np.indices(residual.shape))
    flat = residual.ravel()
    kept = ~np.isnan(flat)
    columns = (flat, np.zeros((flat.size, 0)), flat, flat, record + 1, channel, harmonic + 1, part)
    return Whitened(*(column[kept] for column in columns), {})


def noise(rng: np.random.Generator) -> np.ndarray:
    return rng.standard_normal((len(HZ), 2, CHANNELS, HARMONICS))


def misfit_of(residual: np.ndarray) -> Misfit:
    return _misfit(whitened(residual), residual.ravel(), 0.0, _Campaign())


def test_probabilities_of_noise_are_honest():
    """Each of 18 (two bands, nine harmonics) is uniform, from the smallest that matter up to the median."""
    rng = np.random.default_rng(1)
    found = np.array([a.probability for _ in range(250) for a in alike(whitened(noise(rng)), HZ)])
    assert len(found) == 250 * 2 * HARMONICS
    for p in (0.001, 0.01, 0.05, 0.5):
        count = len(found) * p
        assert abs(np.sum(found < p) - count) < 4 * np.sqrt(count) + 0.15 * count  # the law is the limit of large ones


def test_what_moves_all_channels_is_seen_where_sums_of_squares_often_do_not_see_it():
    """100 noise variances in one harmonic of one band: 1.1 standard deviations of chi2, of 3888 coefficients."""
    rng = np.random.default_rng(2)
    together = others = apart = 0
    for _ in range(40):
        shape, course = rng.standard_normal(CHANNELS), rng.standard_normal((24, 2))
        missed = np.zeros((len(HZ), 2, CHANNELS, HARMONICS))
        missed[:24, :, :, 2] = course[:, :, None] * shape
        missed *= np.sqrt(100.0 / np.sum(missed**2))
        found = misfit_of(noise(rng) + missed)
        together += found.cells[-1].what.startswith("harmonic 3 of all channels together about 5") and not found.fits
        others += len(found.cells) * min(cell.probability for cell in found.cells[:-1]) < SIGNIFICANCE
        apart += not misfit_of(noise(rng) + rng.permuted(missed, axis=0)).fits  # each channel in its own time
    assert together > 34 and others < 20 and apart < 20


def test_standard_deviations_that_are_a_little_small_are_no_pattern():
    rng = np.random.default_rng(3)
    assert misfit_of(1.03 * noise(rng)).cells[-1].probability > 0.01


def test_channels_that_miss_harmonics_and_one_channel_alone_are_no_error():
    rng = np.random.default_rng(4)
    residual = noise(rng)
    residual[5, :, 2, 4:] = np.nan
    residual[:, :, 3, 8] = np.nan
    found = {(a.harmonic, round(a.hz, -1)): a.points for a in alike(whitened(residual), HZ)}
    assert found[5, 50.0] == 2 * 23 * CHANNELS and found[9, 50.0] == 2 * 23 * (CHANNELS - 1)
    assert not list(alike(whitened(residual[:, :, :1]), HZ))


@pytest.mark.parametrize("few", [1, 4])
def test_few_records_are_left_to_the_other_parts(few):
    rng = np.random.default_rng(5)
    residual = noise(rng)[:few]
    assert not list(alike(whitened(residual), HZ))


class _Campaign:
    """Names, frequencies and the number of harmonics alone."""

    def __init__(self) -> None:
        self.data = self
        self.channels, self.H = tuple(f"a{i}" for i in range(CHANNELS)), HARMONICS
        self.records = [_Record(number, hz) for number, hz in HZ.items()]


class _Record:
    def __init__(self, number: int, hz: float) -> None:
        self.number, self.name, self.hz = number, str(number), hz
