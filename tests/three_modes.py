"""A structure of three modes, driven at one place and seen at three others: its rig, its file, records of it."""

from collections.abc import Callable, Mapping

import numpy as np

from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from models.bodies import ModalModel
from models.jointed import JointedRig
from models.joints import Joint
from models.parts import Channel, Damping, Excitation, Quantity
from tests.truth.modal import Hidden, Modes, accelerations, steady

ROWS = {
    "drive": np.array([0.8, 0.5, -0.6]),
    "a": np.array([0.5, 0.9, 0.8]),
    "b": np.array([0.9, -0.4, 0.7]),
    "c": np.array([1.2, -1.1, 1.0]),
}
NOMINAL = Modes(np.array([20.0, 47.0, 90.0]), np.array([0.015, 0.012, 0.015]), ROWS)
SENSORS = ("a", "b", "c")
HZ = (18.5, 19.4, 19.8, 20.2, 20.6, 21.2, 22.5, 45.5, 46.6, 47.4, 49.0)
"""About the first and the second mode."""

OFF = {"hz": 3e-4, "ratio": 0.03, "shape": 3e-3}
"""What the structure differs by from the rig file, relative standard deviations."""

NOISE = 2e-3
"""Of the rms of a channel, standard deviation of each coefficient."""

LEVELS, SECOND = (0.2, 0.6, 1.0), 4.0
"""Forces about the first mode [N]; about the second they are so many times that."""

H = 5


def rig_of(modes: Modes = NOMINAL, joints: tuple[Joint, ...] = (), quantity: Quantity = "acceleration") -> JointedRig:
    """The rig, whose sensors measure one quantity."""
    body = ModalModel(tuple(modes.hz.tolist()), {name: tuple(row.tolist()) for name, row in modes.rows.items()})
    sensors = (Channel(name, quantity, at=name) for name in SENSORS)
    damping = Damping(modal_ratios=tuple(modes.ratio.tolist()))
    return JointedRig(
        "three modes", body, damping, joints, Excitation(1.0, at="drive"), (Channel("force", "force"), *sensors)
    )


def rig_file() -> str:
    """The rig without joints as a file."""
    rows = "".join(f"{name} = {row.tolist()}\n" for name, row in ROWS.items())
    sensors = "".join(f'[[channels]]\nname = "{name}"\nquantity = "acceleration"\nat = "{name}"\n' for name in SENSORS)
    return (
        f'name = "three modes"\n[modal]\nfrequencies_hz = {NOMINAL.hz.tolist()}\n[modal.ports]\n{rows}'
        f"[damping]\nmodal_ratios = {NOMINAL.ratio.tolist()}\n[excitation]\namplitude = 1.0\nat = 'drive'\n"
        f'[[channels]]\nname = "force"\nquantity = "force"\n{sensors}'
    )


def spectra_with_noise(
    rig: JointedRig,
    seen: Mapping[str, np.ndarray],
    hz: np.ndarray,
    force: np.ndarray,
    rng: np.random.Generator,
    noise: float = NOISE,
) -> MeasuredSpectra:
    """Records of what sensors see, (r, 2H+1) each, under a cosine: with noise, and without a mean."""
    size = next(iter(seen.values())).shape
    clean = {"force": np.zeros(size), **seen}
    clean["force"][:, 1] = force
    H = size[1] // 2
    std = {name: noise * np.sqrt(np.mean(y[:, [1, H + 1]] ** 2)) for name, y in clean.items()} | {"force": 1e-4}
    noisy = {name: y + std[name] * rng.standard_normal(size) for name, y in clean.items()}
    stds = {name: np.full((len(hz), H + 1), s) for name, s in std.items()}
    for name in noisy:
        noisy[name][:, 0] = stds[name][:, 0] = np.nan
    return spectra_of(rig, hz, force, noisy, stds)


def measured(
    hidden: Hidden,
    place: str,
    wrong: Callable[[Modes], Modes] = lambda m: m,
    seed: int = 1,
    to: str = "",
    off: Mapping[str, float] = OFF,
    noise: float = NOISE,
) -> MeasuredSpectra:
    """Records of a structure with a hidden force between a place and another, or the ground."""
    rng = np.random.default_rng(seed)
    modes = wrong(NOMINAL.disturbed(rng, **off))
    hz = np.tile(HZ, len(LEVELS))
    force = np.repeat(LEVELS, len(HZ)) * np.where(hz > 40.0, SECOND, 1.0)
    row = modes.rows[place] - (modes.rows[to] if to else 0.0)
    q = steady(modes, hidden, row, "drive", hz, force, periods=200, steps=512, H=H)
    seen = {name: accelerations(modes, q, name, hz) for name in SENSORS}
    return spectra_with_noise(rig_of(), seen, hz, force, rng, noise)
