"""Harmonic balance for beams and structures with dry friction at a support.

In reading order: :func:`load_rig` makes a :class:`models.Rig` of a rig file; :func:`frequency_response` returns a
:class:`ResponseCurve` with its numerical error; the points of a curve are
:class:`PeriodicSolution` objects, as :func:`steady_state` returns one; their channels are the rig's and the computed
``drive``, ``slip``, ``slip_velocity``, ``friction``, ``normal``. :func:`stability_of` says which are stable,
:func:`with_stability` adds that to a curve, with its bifurcations. :func:`sensitivities` differentiates one of them
to the parameters of its rig; :func:`parameter_response` follows it along any of them, a :class:`ParameterCurve`;
:func:`fold_path` follows a fold of a curve in frequency and force, :func:`isolas` finds the detached curves that it
betrays. :func:`nonlinear_mode` and :func:`phase_resonance` say how frequency and damping change with the amplitude,
:func:`follow_peak` where a peak is at other values of a number. :func:`simulate` marches the same rig in time and
returns a :class:`TimeHistory`; :func:`friction_loop` shows a friction law alone, under a prescribed slip.

From measurements: :func:`load_history` and :func:`harmonic_spectra` make :class:`MeasuredSpectra` of recordings,
:func:`load_spectra` reads them; :func:`reconstruct` finds friction, reaction and slip at the contact with their
uncertainty, a :class:`Reconstruction`, and :func:`contact_errors` what the rig file's own uncertainty does to them;
:func:`identify` fits friction laws, :func:`rig_errors` says the same of their parameters; :func:`fit_spectra` fits the
whole rig to the spectra; :func:`place_sensors` says where sensors belong. What a user can get wrong is an
:class:`InputError`; what cannot be computed, a :class:`ConvergenceError`. Figures are in :mod:`hbm.figures`, files in
:mod:`hbm.files.curves`.

Six lines from a rig to a figure::

    from hbm import frequency_response, load_rig
    from hbm.figures import plot_curves

    rig = load_rig("examples/paper_beam.toml")
    curve = frequency_response(rig, (45.0, 60.0))
    print(curve, curve.assessment.error)
    plot_curves(curve)[0].figure.savefig("beam.png")

Names are listed in ``__init__.pyi`` and imported when they are first used, so that ``import hbm`` costs nothing.
"""

from typing import Any

from lazy_loader import attach_stub

from hbm.siblings import install

install()
_first_used, _, __all__ = attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from hbm.files.version import installed_version

        return installed_version()
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _first_used(name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
