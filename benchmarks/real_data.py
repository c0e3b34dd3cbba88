"""What the project finds in measurements: sets of ../shared/data, a table, a figure and a conclusion each.

Circuit, aircraft, bolted beam, beam in vacuum; docs/validation/measurements.md has what commands do alone. Time
histories go through the estimator of `hbm spectra`, forces come from `reconstruct` where the set allows. Nothing is
copied into the repository; without the data the benchmark says so and ends.

Run: python benchmarks/real_data.py [--out FOLDER] [--set NAME ...]
"""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter

from real import brb_beam, eth_beam, f16_interface, silverbox
from real.common import DATA, Finding
from rich.console import Console

SETS: dict[str, Callable[[], Finding]] = {
    "silverbox_circuit": silverbox.run,
    "f16_ground_vibration": f16_interface.run,
    "brb_jointed_beam": brb_beam.run,
    "eth_vacuum_beam": eth_beam.run,
}
DPI = 200


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables as they are ready, and save the figures if a folder is given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="save the figures here")
    parser.add_argument("--set", nargs="+", choices=SETS, default=list(SETS), metavar="NAME", help="only these sets")
    options = parser.parse_args(arguments)
    console = Console(width=160)
    for name in options.set:
        if not (DATA / name).is_dir():
            console.print(f"{name}: skipped, no folder {DATA / name}")
            continue
        start = perf_counter()
        finding = run(name, console)
        if options.out:
            options.out.mkdir(parents=True, exist_ok=True)
            finding.figure.savefig(options.out / f"{name}.png", dpi=DPI)
            console.print(f"figure: {options.out / f'{name}.png'}")
        console.print(f"{perf_counter() - start:.0f} s\n", style="dim", highlight=False)


def run(name: str, console: Console) -> Finding:
    """Run one set and print what it shows."""
    finding = SETS[name]()
    console.print(finding.table)
    for sentence in finding.conclusion:
        console.print(sentence, highlight=False)
    return finding


if __name__ == "__main__":
    main()
