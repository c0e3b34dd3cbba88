"""What instruments make of the truth, and the files of docs/reference/data_files.md."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from tests.truth.rig import TrueRig
from tests.truth.simulate import Record, Truth

Array = np.ndarray


@dataclass(frozen=True)
class Spectra:
    """Coefficients cos and sin (records, channels, harmonics 0..H) with noise, without it, and the noise's std."""

    records: tuple[Record, ...]
    channels: tuple[str, ...]
    cos: Array
    sin: Array
    std: Array
    true_cos: Array
    true_sin: Array


def coefficients(signal: Array, harmonics: int) -> Array:
    """a_k + i b_k of periodic samples along the last axis, k = 0..harmonics: s = sum a_k cos + b_k sin."""
    spectrum = np.conj(np.fft.rfft(signal, axis=-1)[..., : harmonics + 1]) * 2 / signal.shape[-1]
    spectrum[..., 0] /= 2
    return spectrum


def read(truth: Truth, harmonics: int) -> tuple[tuple[str, ...], Array]:
    """Names of the channels, force first, and their coefficients as the sensors read them, without noise."""
    sensors = truth.rig.sensors
    k = np.arange(harmonics + 1)
    omega = 2 * np.pi * np.array([r.hz for r in truth.records])
    gain = np.array([s.gain for s in sensors])[None, :, None]
    lag = np.array([s.delay for s in sensors])[None, :, None] * omega[:, None, None] * k
    felt = coefficients(truth.acceleration, harmonics) * gain * np.exp(1j * lag)
    felt[..., 0] = 0.0  # accelerometers see no mean
    order = sorted(range(len(sensors)), key=lambda i: sensors[i].name)
    names = ("force", *(sensors[i].name for i in order))
    return names, np.concatenate([coefficients(truth.force, harmonics)[:, None], felt[:, order]], axis=1)


def measure(
    truth: Truth,
    snr_db: float,
    rng: np.random.Generator,
    force_snr_db: float | None = None,
    harmonics: int = 9,
    usable_only: bool = True,
) -> Spectra:
    """Coefficients with independent Gaussian noise.

    Its std is, per channel, the largest fundamental over all records x 10^(-SNR/20); 20 dB less on the force unless
    `force_snr_db` is given. Records that are unstable, not converged or lift off are left out. The scatter of the
    force is made before the simulation: `scattered`.
    """
    if usable_only:
        truth = truth.where(truth.usable)
    names, true = read(truth, harmonics)
    decibels = np.full(len(names), float(snr_db))
    decibels[0] = snr_db + 20 if force_snr_db is None else force_snr_db
    std = np.abs(true[:, :, 1]).max(axis=0) * 10 ** (-decibels / 20)
    return with_noise(truth.records, names, true, np.broadcast_to(std[None, :, None], true.shape), rng)


def with_noise(
    records: tuple[Record, ...], channels: tuple[str, ...], true: Array, std: Array, rng: np.random.Generator
) -> Spectra:
    """Complex coefficients (records, channels, harmonics 0..H) with independent Gaussian noise of these std."""
    noisy = true + std * (rng.standard_normal(true.shape) + 1j * rng.standard_normal(true.shape))
    noisy[..., 0] = noisy[..., 0].real
    return Spectra(records, channels, noisy.real, noisy.imag, np.array(std), true.real, true.imag)


def write_spectra(path: str | Path, spectra: Spectra, mean: bool = True, numbers: Sequence[int] | None = None) -> None:
    """CSV of docs/reference/data_files.md; records numbered from 1 unless told; without harmonic 0 unless `mean`."""
    numbers = range(1, len(spectra.records) + 1) if numbers is None else numbers
    lines = ["record,level,frequency_hz,channel,harmonic,cos,sin,std"]
    for i, record in enumerate(spectra.records):
        for j, channel in enumerate(spectra.channels):
            for k in range(0 if mean else 1, spectra.cos.shape[-1]):
                a, b, s = spectra.cos[i, j, k], spectra.sin[i, j, k], spectra.std[i, j, k]
                lines.append(f"{numbers[i]},{record.level:.10g},{record.hz:.10g},{channel},{k},{a:.9e},{b:.9e},{s:.6e}")
    Path(path).write_text("\n".join(lines) + "\n")


def write_contact(path: str | Path, truth: Truth, samples: int = 128) -> None:
    """The truth at the contact, as in the examples' truth_contact files."""
    lines = ["record,level,frequency_hz,phase,slip,slip_velocity,friction,normal"]
    every = truth.steps // samples
    for i, r in enumerate(truth.records):
        for n in range(0, truth.steps, every):
            signals = ",".join(f"{s[i, n]:.9e}" for s in (truth.u, truth.v, truth.T, truth.R))
            lines.append(f"{i + 1},{r.level:.10g},{r.hz:.10g},{n / truth.steps:.6f},{signals}")
    Path(path).write_text("\n".join(lines) + "\n")


def toml_table(name: str, values: Mapping[str, object]) -> str:
    def text(value: object) -> str:
        if isinstance(value, bool):
            return str(value).lower()
        return f'"{value}"' if isinstance(value, str) else repr(value)

    return f"{name}\n" + "".join(f"{key} = {text(value)}\n" for key, value in values.items())


def write_rig(
    path: str | Path, nominal: TrueRig, name: str = "nominal", amplitude: float = 1.0, modes: int = 5
) -> None:
    """Rig file of docs/reference/rig_files.md of a rig without hidden effects: `replace(true, effects=(), law=...)`."""
    if nominal.effects or nominal.distortion or any(s.gain != 1.0 or s.delay != 0.0 for s in nominal.sensors):
        raise ValueError("a rig file holds no hidden effects; replace(rig, effects=(), distortion=(), sensors=...)")
    if nominal.variable_normal_load not in (0.0, 1.0):
        raise ValueError(f"variable_normal_load = {nominal.variable_normal_load}; a rig file holds 0 or 1")
    law = {f.name: getattr(nominal.law, f.name) for f in fields(nominal.law)}
    if law.pop("ratio", 1.0) != 1.0:
        raise ValueError("a rig file holds no asymmetric friction")
    if nominal.law.name == "iwan":
        law["distribution"] = "uniform"
    damping: dict[str, object] = {"mass_proportional": nominal.alpha}
    if nominal.beta:
        damping["stiffness_proportional"] = nominal.beta
    damping |= {"high_mode_ratio": nominal.high_mode_ratio, "high_mode_from": nominal.high_mode_from}
    contact = {"radius": nominal.radius, "normal_load": nominal.normal_load}
    contact |= {"variable_normal_load": bool(nominal.variable_normal_load)}
    contact |= {"residual_compliance": True, "foreshortening": True}
    beam = {key: getattr(nominal, key) for key in ("length", "width", "thickness", "youngs_modulus", "density")}
    tables = [
        toml_table("", {"name": name}).lstrip(),
        toml_table("[beam]", beam | {"modes": modes}),
        toml_table("[damping]", damping),
        toml_table("[contact]", contact),
        toml_table("[contact.friction]", {"law": nominal.law.name} | law),
        toml_table("[excitation]", {"position": nominal.drive, "amplitude": amplitude}),
        toml_table("[[channels]]", {"name": "force", "quantity": "force", "position": nominal.drive}),
    ]
    for s in sorted(nominal.sensors, key=lambda s: s.name):
        tables.append(toml_table("[[channels]]", {"name": s.name, "quantity": "acceleration", "position": s.position}))
    Path(path).write_text("\n".join(tables))
