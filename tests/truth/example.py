"""Makes what was measured in `examples/`: python -m tests.truth.example [FOLDER ...] (about a minute each).

The beam of the source paper with a mass-proportional damping of 0.6 1/s, which a rig can wait for, accelerometers with
noise of 60 dB, and

- `measured_beam`: what nobody could measure beside it;
- `diagnosed_beam`: friction that the rig file does not know of;
- `undecided_beam`: a wrong number of the rig file, measured too poorly to say which; in `further.csv` the three
  records that settle it are appended.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.truth import (
    Coulomb,
    Spectra,
    TrueRig,
    measure,
    scattered,
    simulate_records,
    table_1,
    write_contact,
    write_rig,
    write_spectra,
)

EXAMPLES = Path(__file__).parents[2] / "examples"
LAW = Coulomb(mu=0.52, critical_slip=4.15e-6)
LEVELS = (2.5, 4.5, 6.5)
HZ = (46.0, 48.0, 50.0, 51.0, 52.0, 53.0, 54.0, 55.0, 56.0, 58.0)

RATIO = 1.3
FIRST_MODE = tuple((level, hz) for level in LEVELS for hz in (46.0, 49.0, 51.5, 54.0, 58.0))
SECOND_MODE = ((4.5, 151.0), (4.5, 160.0), (6.5, 148.0), (6.5, 155.0), (6.5, 166.0))

MU = 0.48
UNDECIDED = tuple((4.5, hz) for hz in (46.0, 50.0, 52.0, 53.5, 55.0, 58.0))
FURTHER = tuple((4.8, hz) for hz in (150.4, 159.7, 167.4))


def measured_beam(folder: Path) -> None:
    rig, rng = table_1(LAW), np.random.default_rng(20261121)
    records = scattered([(level, hz) for level in LEVELS for hz in HZ], rng)
    truth = simulate_records(rig, records, steps=2048)
    write_rig(folder / "rig.toml", rig, name="clamped-supported beam, measured", amplitude=6.5)
    write_spectra(folder / "spectra.csv", measure(truth, snr_db=60, rng=rng))
    write_contact(folder / "contact.csv", truth.where(truth.usable), samples=64)


def diagnosed_beam(folder: Path) -> None:
    rig = table_1(LAW)
    spectra = measured(replace(rig, law=replace(LAW, ratio=RATIO)), (*FIRST_MODE, *SECOND_MODE), seed=20261122)
    write_rig(folder / "rig.toml", rig, name="clamped-supported beam, diagnosed", amplitude=6.5)
    write_spectra(folder / "spectra.csv", spectra, mean=False)


def undecided_beam(folder: Path) -> None:
    rig, n = table_1(LAW, sensors=(0.3, 0.5)), len(UNDECIDED)
    every = measured(replace(rig, law=replace(LAW, mu=MU)), (*UNDECIDED, *FURTHER), seed=20261123)
    write_rig(folder / "rig.toml", rig, name="clamped-supported beam, undecided", amplitude=4.5)
    first, further = folder / "spectra.csv", folder / "further.csv"
    write_spectra(first, part(every, slice(n), harmonics=1), mean=False)
    write_spectra(further, part(every, slice(n, None)), mean=False, numbers=range(n + 1, n + 1 + len(FURTHER)))
    further.write_text(first.read_text() + further.read_text().partition("\n")[2])


def measured(rig: TrueRig, points: Sequence[tuple[float, float]], seed: int) -> Spectra:
    rng = np.random.default_rng(seed)
    return measure(simulate_records(rig, scattered(points, rng), steps=2048), snr_db=60, rng=rng)


def part(s: Spectra, records: slice, harmonics: int = 9) -> Spectra:
    """Some records to some harmonic."""
    arrays = {name: getattr(s, name)[records, :, : harmonics + 1] for name in ("cos", "sin", "std")}
    return replace(s, records=s.records[records], **arrays)


def main() -> None:
    makers = {maker.__name__: maker for maker in (measured_beam, diagnosed_beam, undecided_beam)}
    for name in sys.argv[1:] or makers:
        (EXAMPLES / name).mkdir(exist_ok=True)
        makers[name](EXAMPLES / name)


if __name__ == "__main__":
    main()
