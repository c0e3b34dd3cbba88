"""Channels that come late, or move against the force: modes of a model that is known, turned by exp(-i omega tau)."""

from dataclasses import replace

import numpy as np
import pytest

from hbm.errors import InputError
from hbm.identification.modalfit import fit_modes
from hbm.identification.modes import Modes
from hbm.measurement.responses import FrequencyResponses

HZ, RATIO = np.array([20.0, 31.0, 55.0, 300.0]), np.array([0.01, 0.004, 0.008, 0.01])
SHAPES = np.array([[0.9, 0.5, 1.1, 0.8], [0.4, -0.9, -0.3, 1.0], [-0.2, 0.8, 0.9, -0.7]])
AT = np.arange(15.0, 70.0, 0.15)
CHANNELS = {"a1": "acceleration", "v2": "velocity", "x3": "displacement"}
NOISE = np.array([0.02, 1e-4, 6e-7])
"""Of each part, about 0.2 % of the peaks; the fourth mode lies far above the band."""


def responses(
    seed: int,
    late: tuple[float, ...] = (0.0, 0.0, 0.0),
    phases: np.ndarray | float = 0.0,
    signs: tuple[int, ...] = (1,),
) -> FrequencyResponses:
    """Per force at the place of a1: delays [s] and signs of the channels, phases of the shapes [rad]."""
    rng = np.random.default_rng(seed)
    w, wr = 2 * np.pi * AT[:, None], 2 * np.pi * HZ
    q = SHAPES[0] / (wr**2 - w**2 + 2j * RATIO * wr * w)
    H = (1j * w) ** np.array([2, 1, 0]) * (q @ (SHAPES * np.exp(1j * phases)).T)
    read, read_too = rng.standard_normal((2, len(AT), 3))
    seen = np.array(signs) * H * np.exp(-1j * w * np.array(late)) + NOISE * (read + 1j * read_too)
    return FrequencyResponses(AT, CHANNELS, seen, np.broadcast_to(NOISE, H.shape))


def pulls(m: Modes) -> np.ndarray:
    return np.concatenate([(m.hz - HZ[:3]) / m.hz_std, (m.ratio - RATIO[:3]) / m.ratio_std])


def test_channels_on_one_clock_are_not_called_late() -> None:
    for seed in range(12):
        m = fit_modes(responses(seed), drive="a1" if seed % 2 else None)
        assert (len(m), m.warnings) == (3, ())
        assert not m.delays.any()


@pytest.mark.parametrize("size", [0.01, 0.1])
def test_shapes_that_are_not_real_and_voltages_are_not_called_late(size: float) -> None:
    """Their phases do not go with the frequency: those of each mode and channel, and one of all."""
    phases = size * np.random.default_rng(5).standard_normal(SHAPES.shape)
    for turned in (phases, np.full(SHAPES.shape, size)):
        for seed in range(3):
            assert fit_modes(responses(seed, phases=turned)).warnings == ()


@pytest.mark.parametrize(
    "late",
    [
        (0.0, 0.0, 2e-5),
        (0.0, 1.5e-3, 0.0),
        (-3e-3, 0.0, 0.0),
        (0.0, -2e-4, 7e-3),
        (2.5e-3, 2.5e-3, 2.5e-3),
        (6e-2, 6e-2, 6e-2),
    ],
    ids=lambda late: " ".join(f"{1e3 * t:g}" for t in late),
)
def test_delays_are_found_and_taken_off(late: tuple[float, ...]) -> None:
    """From 0.007 rad at the highest frequency to four periods of it: modes and delays as uncertain as stated."""
    of_modes, of_delays = [], []
    for seed in range(6):
        m = fit_modes(responses(seed, late), drive="a1")
        assert len(m) == 3
        assert np.array_equal(m.delays != 0.0, np.array(late) != 0.0)
        of_modes.append(pulls(m))
        of_delays += [(d - t) / s for d, t, s in zip(m.delays, late, m.delays_std, strict=True) if s]
        assert m.chi2_reduced == pytest.approx(1.0, abs=0.12)
    assert 0.7 < np.sqrt(np.mean(np.square(of_modes))) < 1.35
    assert np.sqrt(np.mean(np.square(of_delays))) < 1.8


def test_what_is_late_is_named_with_how_much_and_what_to_do() -> None:
    (one,) = fit_modes(responses(0, (0.0, 1.5e-3, 0.0)), drive="a1").warnings
    assert one.startswith("v2 comes 1.5")
    assert " ms after the force, against the phases of all modes. It is taken off here: align the channels" in one
    (whole,) = fit_modes(responses(0, (-2e-3,) * 3), drive="a1").warnings
    assert whole.startswith("all channels come ")
    assert " ms before the force" in whole


def test_of_one_mode_a_delay_may_be_a_shape_that_is_not_real() -> None:
    (line,) = fit_modes(responses(0, (0.0, 1.5e-3, 0.0)).between(16.0, 24.0), 1).warnings
    assert line.startswith("v2 comes 1.")
    assert "of one mode alone, a shape that is not real looks the same" in line


def test_noise_of_unknown_size_tells_delays_too() -> None:
    alike = responses(0, (0.0, 1.5e-3, 0.0))
    m = fit_modes(replace(alike, own_std=1e3 * alike.own_std, sized=False), drive="a1")
    assert m.delays == pytest.approx([0.0, 1.5e-3, 0.0], abs=6.0 * m.delays_std.max())
    for seed in range(4):
        assert fit_modes(replace(responses(seed), sized=False)).warnings == ()


def test_a_force_that_errs_hides_no_delay() -> None:
    late = responses(1, (0.0, 0.0, 4e-4))
    m = fit_modes(replace(late, force_error=np.full(len(AT), 1e-3)), drive="a1")
    assert m.delays[2] == pytest.approx(4e-4, abs=5.0 * m.delays_std[2])


@pytest.mark.parametrize("late", [(0.0, 0.0, 0.0), (0.0, 1.5e-3, 0.0)], ids=["on one clock", "with a late channel"])
def test_a_drive_of_the_wrong_sign_is_told(late: tuple[float, ...]) -> None:
    with pytest.raises(InputError) as error:
        fit_modes(responses(0, late, signs=(-1, 1, 1)), drive="a1")
    assert str(error.value) == (
        "modal: a1 moves against the force in all 3 modes: its sign, or that of the force, is reversed; must be at the "
        "place of the force, along it: turn the sign of one of the two in the file"
    )


def test_the_sign_of_another_channel_is_that_of_its_shape() -> None:
    m = fit_modes(responses(0, signs=(1, -1, 1)), drive="a1")
    assert m.warnings == ()
    assert np.array_equal(np.sign(m.A[1]), -np.sign(SHAPES[1, :3]))


def test_noise_alone_has_no_mode() -> None:
    quiet = responses(0)
    noise = NOISE * np.random.default_rng(3).standard_normal((2, *quiet.H.shape))
    with pytest.raises(InputError, match="no mode stands out of the noise"):
        fit_modes(replace(quiet, H=noise[0] + 1j * noise[1]), drive="a1")
