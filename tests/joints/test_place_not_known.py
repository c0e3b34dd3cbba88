"""A port whose shapes are hardly known: they move with the joint that is missing there, and with it alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hbm.balance.lines import LineBalance
from hbm.diagnosis.calibrate import trusted
from hbm.errors import InputError
from hbm.fourier import MANY, Array, FourierBasis
from hbm.measurement.spectra import MeasuredSpectra, spectra_of
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.fit import fit_model
from hbm.outputerror.lines import line_campaign
from hbm.outputerror.nominal import tolerances
from hbm.rigfiles.extensions import rig_of_tables
from models.bodies.modal import ModalModel
from models.causes.joints import CubicStiffness
from models.jointed import JointedRig
from models.joints import CubicSpring, Joint
from models.parts import Channel, Damping, Excitation

HZ, LINES, NOISE, CUBIC = 0.4, np.arange(60, 221), 2e-3, 5e8
TRUE, STATED = (0.6, -0.9), (0.6, -0.4)
OWN = "modal.ports.gap[2]"


def structure(row: tuple[float, float], *joints: Joint) -> JointedRig:
    """Two modes, driven and measured away from the gap."""
    body = ModalModel((31.0, 74.0), {"a": (0.9, 1.1), "b": (0.8, -1.2), "gap": row})
    channels = (Channel("force", "force", at="a"), *(Channel(f"x{p}", "displacement", at=p) for p in "ab"))
    return JointedRig("two modes", body, Damping(modal_ratios=(0.02,)), joints, Excitation(1.0, at="a"), channels)


def measured() -> MeasuredSpectra:
    """Three multisines of the structure with a spring in its gap."""
    basis, rng = FourierBasis(MANY + 30, 2048), np.random.default_rng(5)
    rig = structure(TRUE, Joint("spring", CubicSpring(CUBIC), ("gap",)))
    forces, found = np.zeros((3, basis.size)), dict[str, list[Array]](xa=[], xb=[])
    for force, size in zip(forces, (2.0, 4.0, 6.0), strict=True):
        phase = rng.uniform(0, 2 * np.pi, len(LINES))
        force[LINES], force[basis.H + LINES] = size * np.cos(phase), size * np.sin(phase)
        Q = LineBalance(rig, basis, HZ, force).solved().state.Q
        for name in found:
            x = Q @ np.array(rig.body.ports[name[1:]])
            found[name].append(x + NOISE * np.sqrt(np.mean(x[LINES] ** 2)) * rng.standard_normal(basis.size))
    std = np.full((3, basis.H + 1), np.nan)
    std[:, LINES] = 1.0
    blank = np.isnan(np.concatenate([std, std[:, 1:]], axis=1))
    x = {name: np.where(blank, np.nan, rows) for name, rows in found.items()}
    of_x = {name: std * NOISE * np.sqrt(np.nanmean(rows**2)) for name, rows in x.items()}
    force = np.where(blank, np.nan, forces)
    return spectra_of(
        structure(TRUE),
        np.full(3, HZ),
        np.array([2.0, 4.0, 6.0]),
        {"force": force, **x},
        {"force": std * 1e-9, **of_x},
    )


def fitted(rig: JointedRig, spectra: MeasuredSpectra) -> Evaluation:
    model = trusted(rig, ("xa", "xb")).extended_by(CubicStiffness("gap"))
    start = np.array([f.of(0.5 * CUBIC if f.name == "cubic" else f.start) for f in model.free])
    return fit_model(model, line_campaign(rig, spectra), start, {}, steps=25)


def test_shapes_that_are_hardly_known_are_found_with_the_joint() -> None:
    spectra, known = measured(), structure(STATED)
    held = fitted(known, spectra)
    free = fitted(replace(known, tolerances={OWN: 1.0}), spectra)
    assert held.chi2 > 10.0 * free.chi2
    assert free.white.chi2 == pytest.approx(len(free.white), rel=0.2)
    at = [f.name for f in free.model.free].index(OWN)
    value = free.model.free[at].value(free.x[at])
    assert abs(value - TRUE[1]) < 4.0 * free.std[at] < 0.05


def test_of_a_port_that_nothing_touches_only_what_is_stated_moves() -> None:
    known = structure(STATED)
    assert not any(key.startswith("modal.ports.gap") for key in tolerances(known))
    assert tolerances(replace(known, tolerances={OWN: 1.0}))[OWN] == 1.0


def test_a_shape_that_went_through_zero_is_read_back() -> None:
    """As an extended rig has it: numbers first, before the cause touches the place."""
    tables = [{"cause": f"parameter:{OWN}", "value": -0.9}, {"cause": "cubic-stiffness", "at": "gap", "cubic": CUBIC}]
    for stated in (STATED, (0.6, 0.0), (0.6, 0.2)):
        assert rig_of_tables(structure(stated), tables, Path()).number(OWN) == -0.9
    with pytest.raises(InputError, match="does not apply"):
        rig_of_tables(structure(STATED), [{"cause": "parameter:modal.ports.gap[3]", "value": 1.0}], Path())
    with pytest.raises(InputError, match="must be >= 0"):
        rig_of_tables(structure(STATED), [{"cause": "parameter:modal.frequencies_hz[1]", "value": -1.0}], Path())
