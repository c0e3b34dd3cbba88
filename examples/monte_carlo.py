"""The resonance of a thousand beams whose friction, load, stiffness and force are not quite known.

One curve for each draw, by any executor of concurrent.futures: the processes of this machine, or the workers of a Dask
cluster, whose address is given (pip install 'casadi-hbm[cluster]').

Run: python examples/monte_carlo.py 1000 [tcp://scheduler:8786]
"""

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from hbm import load_rig, trace_frequency

RIG = load_rig(Path(__file__).with_name("paper_beam.toml"))
MEAN, SPREAD = (0.52, 83.0, 210e9, 6.0), (0.03, 3.0, 3e9, 0.2)  # mu [-], load [N], Young's modulus [Pa], force [N]


def peak(mu, load, modulus, force):
    """Frequency [Hz] and height [m] of the peak of one beam, and the CPU seconds it took."""
    begin = time.process_time()
    contact = replace(RIG.contact, normal_load=load, law=replace(RIG.contact.law, mu=mu))
    rig = replace(RIG, body=replace(RIG.body, youngs_modulus=modulus), contact=contact, channels=())
    top = trace_frequency(rig, (46.0, 60.0), level=force, harmonics=5, samples=128).peak
    return top.hz, top["drive"].peak, time.process_time() - begin


@contextmanager
def workers(address):
    """Processes of this machine, or the workers of a cluster."""
    if address is None:
        with ProcessPoolExecutor() as executor:
            yield executor
    else:
        from distributed import Client

        with Client(address) as client:
            yield client.get_executor()


if __name__ == "__main__":
    count, address = int(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else None
    draws = np.random.default_rng(1).normal(MEAN, SPREAD, (count, 4))
    begin = time.perf_counter()
    with workers(address) as executor:
        hz, height, cpu = np.array(list(executor.map(peak, *draws.T.tolist(), chunksize=10))).T
    for name, values, unit in (("frequency", hz, "Hz"), ("height", 1e3 * height, "mm")):
        low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
        print(f"{name} of the peak: {middle:.4g} {unit}, 90 % between {low:.4g} and {high:.4g}")
    print(f"{count} curves in {time.perf_counter() - begin:.1f} s; {count / cpu.sum():.2f} for each second of a core")
