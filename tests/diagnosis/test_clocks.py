"""Numbers of which it is said that a clock does nearly the same: all natural frequencies go with a power of them."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hbm import load_rig
from hbm.diagnosis.evidence import TIMED, clock
from hbm.outputerror.model import Model
from models.causes.parameter import WrongParameter

RIG = load_rig(Path(__file__).parents[2] / "examples" / "paper_beam.toml")
LARGER = 1.002


@pytest.mark.parametrize("key", TIMED)
def test_all_natural_frequencies_are_those_of_a_clock_that_is_off_as_told(key):
    model = Model(RIG, {}, (WrongParameter(key),))
    x = model.at({(0, "value"): LARGER * RIG.number(key)})
    (told,) = clock(SimpleNamespace(model=model, x=x))
    ratio = model.rig(x).structure.omega_n / RIG.structure.omega_n
    way = "high" if ratio[0] > 1.0 else "low"
    assert ratio == pytest.approx(np.full(len(ratio), ratio[0]), abs=1e-6)
    assert f"frequencies stated {abs(ratio[0] - 1.0):.2%} too {way}" in told
