"""Makes the cases of `tests/diagnosis/test_misses.py`: python -m benchmarks.misses (two minutes).

FOLDER/NNNN/{rig.toml, spectra.npz} are what the diagnosis gets, FOLDER/answers.json what is hidden in them. They are
kept, for the simulator takes longer than the diagnosis.
"""

import json
import tempfile
from pathlib import Path

from hbm import load_rig, load_spectra
from hbm.measurement.spectrafile import write_spectra
from tests.truth.blind import draw, write_case

FOLDER = Path(__file__).parents[1] / "tests" / "diagnosis" / "misses"
RIG, SIZES = 9000, (0.004, 0.01)
STRONG, WEAK = (300.0, 1500.0), (30.0, 60.0)
CASES = {
    9001: (None, STRONG),
    9010: ("added-mass", STRONG),
    9011: ("clamp-rotation", STRONG),
    9014: ("clamp-friction", STRONG),
    9031: ("added-spring", WEAK),
}
"""By their seed: what is hidden, and by how much."""


def main() -> None:
    """Make them all."""
    answers = {}
    for seed, (cause, rho) in CASES.items():
        case = draw(seed, "F", cause, RIG, rho, background=SIZES)
        with tempfile.TemporaryDirectory() as folder:
            data = Path(folder) / "data"
            write_case(data, Path(folder) / "answer.json", case)
            rig = load_rig(data / "rig.toml")
            kept = FOLDER / str(seed)
            kept.mkdir(parents=True, exist_ok=True)
            (kept / "rig.toml").write_text((data / "rig.toml").read_text())
            write_spectra(kept / "spectra.npz", load_spectra(data / "spectra.csv", rig))
        answers[seed] = {key: case.answer.get(key) for key in ("drawn", "parameters", "effect", "background")}
    (FOLDER / "answers.json").write_text(json.dumps(answers, indent=1) + "\n")


if __name__ == "__main__":
    main()
