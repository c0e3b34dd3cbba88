"""Laws with a number at a bound: models of them stay within what their laws accept, whatever is calibrated."""

from collections.abc import Iterator
from dataclasses import MISSING, fields, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from hbm.diagnosis.calibrate import profiled, trusted
from hbm.diagnosis.evidence import at_ends
from hbm.files.extendedrig import corrections
from hbm.outputerror.evaluation import Evaluation
from hbm.outputerror.model import Model
from hbm.response.trace import steady_state
from hbm.sensitivity.derivatives import sensitivities
from models.bodies.modal import ModalModel
from models.causes import all_candidates
from models.causes.addedjoint import AddedJoint
from models.causes.clamp import ClampFriction
from models.causes.friction import StribeckWeakening
from models.causes.parameter import WrongParameter
from models.friction import LAWS, Iwan, Jenkins, Stribeck, describe, parameters
from models.jointed import AnyRig, JointedRig
from models.joints import JOINT_LAWS, Friction, Joint, PlaneFriction
from models.joints.law import numbers
from models.parts import Channel, Damping, Excitation
from models.published import PAPER_PENALTY, paper_rig
from models.scalars import law_keys

PLACES = ("a", "b", "c")
BODY = ModalModel((31.0, 74.5), {"a": (0.8, 1.1), "b": (0.9, -1.2), "c": (0.5, 0.3)})


def at_bounds(law: type) -> Iterator[tuple[str, Any]]:
    """A law with ones for its numbers, and the same with each of them at each bound of its own."""
    known = describe(law)
    ones = {f.name: 1.0 for f in fields(law) if f.name in known and f.default is MISSING}
    yield "ones", law(**ones)
    for name, p in known.items():
        for value in (p.lower, p.upper):
            if np.isfinite(value) and not (p.strict and value == p.lower):
                yield f"{name} {value:g}", law(**{**ones, name: value})


def jointed(law: Any) -> JointedRig:
    law = law if hasattr(law, "ports") else Friction(law, 1.0)
    joint = Joint("j", law, PLACES[: law.ports])
    channels = (Channel("x", "acceleration", at="b"),)
    return JointedRig("r", BODY, Damping(modal_ratios=(0.01,)), (joint,), Excitation(1.0, at="c"), channels)


RIGS = {
    **{f"contact {n} {v}": paper_rig(law) for n, kind in LAWS.items() for v, law in at_bounds(kind)},
    **{f"joint {n} {v}": jointed(law) for n, kind in {**LAWS, **JOINT_LAWS}.items() for v, law in at_bounds(kind)},
}


def ends(model: Model) -> Iterator[np.ndarray]:
    """The start, and each number of laws at each of its bounds, alone and together."""
    of_laws = np.array([f.cause >= 0 or f.name.startswith(("contact.", "joints.")) for f in model.free], dtype=bool)
    yield model.start
    for bound in model.bounds():
        yield np.where(of_laws, bound, model.start)
        for i in np.flatnonzero(of_laws):
            yield np.where(np.arange(len(bound)) == i, bound, model.start)


@pytest.mark.parametrize("name", RIGS)
def test_models_stay_within_the_bounds_of_a_law(name: str) -> None:
    rig: AnyRig = RIGS[name]
    trust = trusted(rig, ["x"])
    for model in (trust, profiled(trust)):
        for x in ends(model):
            model.rig(x)
        keys, by_x = model.by_x(model.start, model.rig(model.start))
        assert all(by_x[keys.index(f.name), i] != 0.0 for i, f in enumerate(model.free))
    for cause in WrongParameter.candidates(rig):
        (unknown,) = cause.unknowns(rig)
        for value in (unknown.lower, *unknown.starts, unknown.upper):
            cause.extend(rig, {"value": value})


def test_a_load_goes_free_where_it_varies_else_only_its_product_with_the_coefficient() -> None:
    law, key = Friction(Jenkins(0.4, 1e-6), 5.0), "joints.j.normal_load"
    rigs = jointed(law), jointed(replace(law, normal_stiffness=1e4))
    held, free = (profiled(trusted(rig, ["x"])).calibrated for rig in rigs)
    assert np.isinf([free[key], free["joints.j.mu"], held["joints.j.mu"]]).all()
    assert held[key] == trusted(jointed(law), ["x"]).calibrated[key] < 0.1


def test_a_spread_is_no_number_beside_limits() -> None:
    law = Iwan(0.4, 1e4, limits=(1.0, 2.0))
    assert list(parameters(law)) == list(numbers(law)) == ["mu", "stiffness"]
    assert "joints.j.spread" not in jointed(law).numbers
    assert "contact.friction.spread" not in paper_rig(law).numbers
    assert "joints.j.spread" in jointed(Iwan(0.4, 1e4)).numbers
    rig = jointed(law).with_number("joints.j.mu", 0.5)
    assert rig.joints[0].law.law.limits == (1.0, 2.0)
    here = steady_state(paper_rig(law), 83.0, harmonics=3, samples=64)
    assert sensitivities(paper_rig(law), here, law_keys(paper_rig(law))).values.tolist() == [0.4, 1e4]


def test_a_limit_at_rest_is_calibrated_with_the_one_in_motion() -> None:
    """Neither falls below nor passes the other, and a fit of both can be written."""
    model = trusted(jointed(Stribeck(0.3, 0.3, 0.1, 1e-6)), ["x"])
    names = [f.name for f in model.free]
    at = model.start + 0.01 * np.array([name == "joints.j.mu" for name in names])
    law = model.rig(at).joints[0].law.law
    assert law.mu_static == law.mu == pytest.approx(0.3 * np.exp(0.01))
    keys, by_x = model.by_x(at, model.rig(at))
    both = [by_x[keys.index(f"joints.j.{name}"), names.index("joints.j.mu")] for name in ("mu", "mu_static")]
    assert both == pytest.approx([law.mu, law.mu], rel=1e-5)
    values = model.calibrated_at(at)
    written = corrections(model.nominal, {key: values[key] for key in ("joints.j.mu", "joints.j.mu_static")})
    assert [e.cause.key for e in written] == ["joints.j.mu_static", "joints.j.mu"]


def test_modes_that_are_close_are_corrected_without_changing_places() -> None:
    body = ModalModel((31.0, 31.05), BODY.ports)
    rig = replace(jointed(Jenkins(0.4, 1e-6)), body=body)
    first, second = (f"modal.frequencies_hz[{i}]" for i in (1, 2))
    assert [e.cause.key for e in corrections(rig, {first: 31.2, second: 31.25})] == [second, first]
    assert [e.cause.key for e in corrections(rig, {first: 30.8, second: 30.9})] == [first, second]


def test_a_joint_that_is_looked_for_may_come_down_to_next_to_nothing() -> None:
    """To first order, where no steady state is solved, fits end at the bound itself."""
    rig = jointed(Jenkins(0.5, 1e-6))
    kinds = {type(c): c for c in all_candidates(rig) if isinstance(c, AddedJoint)}
    assert len(kinds) > 10
    for cause in kinds.values():
        model = Model(rig, {}).extended_by(cause)
        low, _ = model.bounds()
        for i, f in enumerate(model.free):
            x = model.start
            x[i] = low[i]
            if f.lower >= 0.0:
                found = model.rig(x)
                assert len(found.joints) + len(found.masses) > len(rig.joints)


def test_a_number_that_ends_where_it_is_looked_for_is_told() -> None:
    """A stiffness that is none ends at a tenth of that of the rig file; with the scatter there it seems to be known."""
    model = Model(jointed(PlaneFriction(0.4, 1e5, 10.0, 8000.0)), {}).extended_by(
        WrongParameter("joints.j.normal_stiffness")
    )
    low, high = (np.array(end) for end in model.bounds())

    def told(x: np.ndarray) -> list[str]:
        return list(at_ends(cast(Evaluation, SimpleNamespace(model=model, x=x))))

    said = "parameter:joints.j.normal_stiffness: no value {0} than {1} is looked for; it may be {0}."
    assert told(low) == [said.format("less", 800)]
    assert told(high) == [said.format("more", "8e+04")]
    assert told(0.99 * low + 0.01 * high) == told(model.start) == []


def test_every_number_of_a_cause_has_a_slope_at_its_bounds() -> None:
    """A step of least squares may end there: an infinite stiffness would have none."""
    rig = paper_rig()
    checked = set()
    for cause in all_candidates(rig):
        for f in Model(rig, {}).extended_by(cause).free:
            slopes = [f.slope(x) for x in (*f.bounds, f.of(f.start)) if np.isfinite(x)]
            assert np.isfinite(slopes).all(), (cause.label, f.name)
            checked.add(f.form)
    assert checked == {"linear", "logarithmic", "inverse"}


def test_what_is_all_but_rigid_has_the_slope_of_its_number() -> None:
    """However stiff: fits that begin at a rigid clamp step as far as is right."""
    model = Model(paper_rig(), {}, (ClampFriction(),))
    stiffness, limit = model.free
    for x in (stiffness.bounds[0], stiffness.of(stiffness.start), 1e-3, 10.0):
        at = np.array([x, limit.of(1.0)])
        keys, by_x = model.by_x(at, model.rig(at))
        assert by_x[keys.index("attachments.clamp_stiffness")] == pytest.approx([stiffness.slope(x), 0.0], rel=1e-5)


def test_friction_at_rest_does_not_fall_below_that_of_sliding() -> None:
    """Of a fit that takes it there the rig, its file and what is told are of a law without a fall."""
    model = Model(paper_rig(PAPER_PENALTY), {}, (StribeckWeakening(),))
    x = model.at({(0, "mu_static"): 0.3, (0, "mu"): 0.4, (0, "stribeck_velocity"): 1e-3})
    rig = model.rig(x)
    assert model.values(x, 0)["mu_static"] == model.values(x, 0)["mu"] == pytest.approx(0.4, rel=1e-12)
    assert (rig.contact.law.mu_static, rig.contact.law.mu) == pytest.approx((0.4, 0.4), rel=1e-12)
    keys, by_x = model.by_x(x, rig)
    moved = {key: by_x[keys.index(key)] for key in ("contact.friction.mu_static", "contact.friction.mu")}
    assert np.array_equal(*moved.values()) and np.count_nonzero(moved["contact.friction.mu"]) == 1
