"""Makes `examples/measured_beam/`: python -m tests.truth.example (about a minute).

The beam of the source paper with a mass-proportional damping of 0.6 1/s, which a rig can wait for; six accelerometers
with noise of 60 dB; and what nobody could measure beside it.
"""

from pathlib import Path

import numpy as np

from tests.truth import Coulomb, measure, scattered, simulate_records, table_1, write_contact, write_rig, write_spectra

FOLDER = Path(__file__).parents[2] / "examples" / "measured_beam"
LEVELS = (2.5, 4.5, 6.5)
HZ = (46.0, 48.0, 50.0, 51.0, 52.0, 53.0, 54.0, 55.0, 56.0, 58.0)


def main() -> None:
    rig, rng = table_1(Coulomb(mu=0.52, critical_slip=4.15e-6)), np.random.default_rng(20261121)
    records = scattered([(level, hz) for level in LEVELS for hz in HZ], rng)
    truth = simulate_records(rig, records, steps=2048)
    FOLDER.mkdir(exist_ok=True)
    write_rig(FOLDER / "rig.toml", rig, name="clamped-supported beam, measured", amplitude=6.5)
    write_spectra(FOLDER / "spectra.csv", measure(truth, snr_db=60, rng=rng))
    write_contact(FOLDER / "contact.csv", truth.where(truth.usable), samples=64)


if __name__ == "__main__":
    main()
