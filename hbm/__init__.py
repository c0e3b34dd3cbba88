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

Names are imported when they are first used, so that ``import hbm`` costs nothing.
"""

from typing import TYPE_CHECKING, Any

from hbm.lazy import first_used
from hbm.siblings import install

if TYPE_CHECKING:
    from continuation import ConvergenceError
    from hbm.balance.solution import PeriodicSolution
    from hbm.diagnosis.backbones import diagnose_backbone
    from hbm.diagnosis.diagnose import diagnose
    from hbm.diagnosis.verdict import Diagnosis
    from hbm.errors import InputError
    from hbm.files.curves import SavedCurve, read_curves, write_curves, write_history
    from hbm.files.extendedrig import write_extended
    from hbm.identification.contacterrors import ContactErrors, contact_errors
    from hbm.identification.identify import Identification, identify
    from hbm.identification.known import Known
    from hbm.identification.lawfit import LawFit
    from hbm.identification.rigerrors import RigErrors, rig_errors
    from hbm.identification.spectra import SpectraFit, fit_spectra
    from hbm.integration.history import TimeHistory
    from hbm.integration.integrate import simulate
    from hbm.integration.jointed import JointHistory, joint_steady_state
    from hbm.inverse.jointed import reconstruct_joints
    from hbm.inverse.jointreconstruction import JointReconstruction
    from hbm.inverse.placement import Placement, place_sensors
    from hbm.inverse.reconstruct import reconstruct
    from hbm.inverse.reconstruction import Reconstruction
    from hbm.measurement.decayfile import load_decay
    from hbm.measurement.harmonicestimate import HarmonicEstimate
    from hbm.measurement.harmonics import harmonic_spectra
    from hbm.measurement.historyfile import load_history
    from hbm.measurement.recording import Recording
    from hbm.measurement.spectra import MeasuredSpectra
    from hbm.measurement.spectrafile import load_spectra, write_spectra
    from hbm.modes.backbone import NonlinearMode, PhaseResonance, nonlinear_mode, phase_resonance
    from hbm.modes.linear import LinearModes, linear_modes
    from hbm.response.accuracy import frequency_response
    from hbm.response.bifurcation import Bifurcation
    from hbm.response.bifurcations import stability_of, with_stability
    from hbm.response.curve import Assessment, NumericalError, ResponseCurve
    from hbm.response.loop import FrictionLoop, friction_loop
    from hbm.response.synthesis import Synthesis, synthesize
    from hbm.response.trace import force_response, steady_state, trace_frequency
    from hbm.rigfiles.lawchoice import choose_law
    from hbm.rigfiles.load import load_rig
    from hbm.sensitivity.derivatives import Sensitivities, sensitivities
    from hbm.sensitivity.jointed import JointSensitivities, joint_sensitivities
    from hbm.stability.multipliers import Stability
    from hbm.tracking.folds import FoldPath, fold_path, isolas
    from hbm.tracking.parameterresponse import ParameterCurve, parameter_response
    from hbm.tracking.peaks import PeakLost, Peaks, follow_peak

    __version__: str

__all__ = [
    "Assessment",
    "Bifurcation",
    "ContactErrors",
    "ConvergenceError",
    "Diagnosis",
    "FoldPath",
    "FrictionLoop",
    "HarmonicEstimate",
    "Identification",
    "InputError",
    "JointHistory",
    "JointReconstruction",
    "JointSensitivities",
    "Known",
    "LawFit",
    "LinearModes",
    "MeasuredSpectra",
    "NonlinearMode",
    "NumericalError",
    "ParameterCurve",
    "PeakLost",
    "Peaks",
    "PeriodicSolution",
    "PhaseResonance",
    "Placement",
    "Reconstruction",
    "Recording",
    "ResponseCurve",
    "RigErrors",
    "SavedCurve",
    "Sensitivities",
    "SpectraFit",
    "Stability",
    "Synthesis",
    "TimeHistory",
    "choose_law",
    "contact_errors",
    "diagnose",
    "diagnose_backbone",
    "fit_spectra",
    "fold_path",
    "follow_peak",
    "force_response",
    "frequency_response",
    "friction_loop",
    "harmonic_spectra",
    "identify",
    "isolas",
    "joint_sensitivities",
    "joint_steady_state",
    "linear_modes",
    "load_decay",
    "load_history",
    "load_rig",
    "load_spectra",
    "nonlinear_mode",
    "parameter_response",
    "phase_resonance",
    "place_sensors",
    "read_curves",
    "reconstruct",
    "reconstruct_joints",
    "rig_errors",
    "sensitivities",
    "simulate",
    "stability_of",
    "steady_state",
    "synthesize",
    "trace_frequency",
    "with_stability",
    "write_curves",
    "write_extended",
    "write_history",
    "write_spectra",
]

_HOMES = {
    "hbm.continuation": ("ConvergenceError",),
    "hbm.response.accuracy": ("frequency_response",),
    "hbm.modes.backbone": ("NonlinearMode", "PhaseResonance", "nonlinear_mode", "phase_resonance"),
    "hbm.response.bifurcations": ("stability_of", "with_stability"),
    "hbm.response.bifurcation": ("Bifurcation",),
    "hbm.response.curve": ("Assessment", "NumericalError", "ResponseCurve"),
    "hbm.errors": ("InputError",),
    "hbm.tracking.folds": ("FoldPath", "fold_path", "isolas"),
    "hbm.integration.history": ("TimeHistory",),
    "hbm.identification.identify": ("Identification", "identify"),
    "hbm.identification.contacterrors": ("ContactErrors", "contact_errors"),
    "hbm.identification.known": ("Known",),
    "hbm.identification.lawfit": ("LawFit",),
    "hbm.identification.rigerrors": ("RigErrors", "rig_errors"),
    "hbm.identification.spectra": ("SpectraFit", "fit_spectra"),
    "hbm.integration.integrate": ("simulate",),
    "hbm.integration.jointed": ("JointHistory", "joint_steady_state"),
    "hbm.inverse.jointed": ("reconstruct_joints",),
    "hbm.inverse.jointreconstruction": ("JointReconstruction",),
    "hbm.sensitivity.jointed": ("JointSensitivities", "joint_sensitivities"),
    "hbm.inverse.placement": ("Placement", "place_sensors"),
    "hbm.diagnosis.backbones": ("diagnose_backbone",),
    "hbm.diagnosis.diagnose": ("diagnose",),
    "hbm.diagnosis.verdict": ("Diagnosis",),
    "hbm.inverse.reconstruct": ("reconstruct",),
    "hbm.inverse.reconstruction": ("Reconstruction",),
    "hbm.rigfiles.lawchoice": ("choose_law",),
    "hbm.response.loop": ("FrictionLoop", "friction_loop"),
    "hbm.measurement.decayfile": ("load_decay",),
    "hbm.measurement.harmonicestimate": ("HarmonicEstimate",),
    "hbm.measurement.harmonics": ("harmonic_spectra",),
    "hbm.measurement.historyfile": ("load_history",),
    "hbm.measurement.recording": ("Recording",),
    "hbm.measurement.spectra": ("MeasuredSpectra",),
    "hbm.measurement.spectrafile": ("load_spectra", "write_spectra"),
    "hbm.modes.linear": ("LinearModes", "linear_modes"),
    "hbm.tracking.parameterresponse": ("ParameterCurve", "parameter_response"),
    "hbm.tracking.peaks": ("PeakLost", "Peaks", "follow_peak"),
    "hbm.response.synthesis": ("Synthesis", "synthesize"),
    "hbm.response.trace": ("force_response", "steady_state", "trace_frequency"),
    "hbm.files.curves": ("SavedCurve", "read_curves", "write_curves", "write_history"),
    "hbm.files.extendedrig": ("write_extended",),
    "hbm.rigfiles.load": ("load_rig",),
    "hbm.sensitivity.derivatives": ("Sensitivities", "sensitivities"),
    "hbm.balance.solution": ("PeriodicSolution",),
    "hbm.stability.multipliers": ("Stability",),
}
install()

_first_used = first_used("hbm", _HOMES)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from hbm.files.version import installed_version

        return installed_version()
    return _first_used(name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
