"""Numbers of the curves of a diagnosis, as columns of CSV files."""

from collections.abc import Mapping, Sequence

import numpy as np

from hbm.diagnosis.curves import TracedResponse
from hbm.diagnosis.discrepancy import Discrepancy
from hbm.diagnosis.missingforce import MissingForce
from hbm.diagnosis.verdict import Diagnosis, Ranked
from hbm.figures.compared import Compared, View, record_errors
from hbm.figures.decay import decay_compared
from hbm.files.diagnosissummary import text
from hbm.files.outputs import Columns, columns_of
from hbm.measurement.decay import Decay

PLAIN = {"nominal": "rig file as it is", "calibrated": "rig file calibrated"}
"""Names of the models without a cause among the causes."""


def error_columns(diagnosis: Diagnosis) -> Columns:
    """Columns of ``errors.csv``: a row per model and part."""
    rows = [(m, part, e.nrmse, e.chi2_reduced) for m, own in diagnosis.errors.items() for part, e in own.items()]
    return columns_of(("model", "records", "nrmse", "chi2_reduced"), rows)


def ranking_columns(diagnosis: Diagnosis) -> Columns:
    """Columns of ``ranking.csv``: a row per candidate that was fitted, and for the rig file as it is and calibrated."""
    return columns_of(("cause", "bic", "chi2", "held_out_nrmse", "parameters"), ranked_rows(diagnosis))


def ranked_rows(diagnosis: Diagnosis) -> list[tuple[str, float, float, float, str]]:
    """Candidates in the order of their BIC, with the rig file as it is and calibrated among them."""
    rows = [_ranked_row(diagnosis, r) for r in diagnosis.ranking]
    for (model, name), e in zip(PLAIN.items(), (diagnosis.nominal, diagnosis.calibrated), strict=True):
        if e is not None:
            held = diagnosis.errors.get(model, {}).get("held_out")
            rows.append((name, e.bic, e.chi2, np.nan if held is None else held.nrmse, ""))
    return sorted(rows, key=lambda row: row[1])


def _ranked_row(d: Diagnosis, r: Ranked) -> tuple[str, float, float, float, str]:
    """A candidate; the one that was named has the standard deviations of the verdict."""
    held = np.nan if r.held_out_nrmse is None else r.held_out_nrmse
    named = d.extended_fit is not None and d.extended_fit.model.label == r.label
    parameters = d.parameters if named else r.parameters
    return r.label, r.bic, r.chi2, held, "; ".join(f"{name} {text(p)}" for name, p in parameters.items())


def overview_columns(models: Mapping[str, Compared], view: View) -> Columns:
    """Relative error of each record and of noise in it, by model; and the amplitudes that the view shows."""
    parts = []
    for name, c in models.items():
        first, error, noise = record_errors(c)
        amplitudes = np.full((2, len(first)), np.nan)
        shown = view.of(c)
        place = np.searchsorted(c.record[first], c.record[shown])
        amplitudes[:, place] = np.abs([c.measured[shown], c.simulated[shown]])
        parts.append(
            {
                "model": np.full(len(first), name),
                "record": c.record[first],
                "level": c.level[first],
                "frequency_hz": c.hz[first],
                "held_out": c.held_out[first],
                "relative_error": error,
                "relative_noise": noise,
                "measured": amplitudes[0],
                "simulated": amplitudes[1],
            }
        )
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def compared_columns(models: Mapping[str, Compared], channels: Sequence[str]) -> Columns:
    """Every coefficient, a row per model, record, channel and harmonic; real and imaginary part, the force a cosine."""
    parts = []
    for name, c in models.items():
        parts.append(
            {
                "model": np.full(len(c.record), name),
                "record": c.record,
                "level": c.level,
                "frequency_hz": c.hz,
                "channel": np.array(channels)[c.channel],
                "harmonic": c.harmonic,
                "held_out": c.held_out,
                "measured_real": c.measured.real,
                "measured_imag": c.measured.imag,
                "simulated_real": c.simulated.real,
                "simulated_imag": c.simulated.imag,
                "std": c.std,
                "deviation": c.deviation,
            }
        )
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def decay_columns(models: Mapping[str, Compared], decay: Decay) -> Columns:
    """Columns of a backbone: a row per model and amplitude."""
    parts = []
    for name, model in models.items():
        c = decay_compared(decay, model)
        at = c.row - 1
        parts.append(
            {
                "model": np.full(len(at), name),
                "record": c.row,
                "amplitude": c.amplitude,
                "held_out": c.held_out,
                "frequency_hz": decay.hz[at],
                "frequency_hz_std": decay.hz_std[at],
                "simulated_hz": c.hz,
                "damping_ratio": decay.damping_ratio[at],
                "damping_ratio_std": decay.damping_ratio_std[at],
                "simulated_damping_ratio": c.damping_ratio,
            }
        )
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def traced_columns(traced: Sequence[TracedResponse]) -> Columns:
    """Columns of ``response_curves.csv``: a row per curve, point and channel, with the amplitude of each harmonic."""
    parts = []
    for t in traced:
        H = next(iter(t.amplitudes.values())).shape[1] - 1
        for name, amplitude in t.amplitudes.items():
            parts.append(
                {
                    "model": np.full(len(t.hz), t.model),
                    "level": np.full(len(t.hz), t.level),
                    "force": np.full(len(t.hz), t.force),
                    "point": np.arange(1, len(t.hz) + 1),
                    "frequency_hz": t.hz,
                    "channel": np.full(len(t.hz), name),
                }
                | {f"h{k}": amplitude[:, k] for k in range(1, H + 1)}
            )
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def deviation_columns(models: Mapping[str, Compared], channels: Sequence[str]) -> Columns:
    """Deviation of fundamentals and what noise makes of it, relative to what was measured."""
    every = compared_columns(models, channels)
    columns = {name: every[name][every["harmonic"] == 1] for name in every}
    size = np.hypot(columns["measured_real"], columns["measured_imag"])
    off = [columns[f"measured_{part}"] - columns[f"simulated_{part}"] for part in ("real", "imag")]
    kept = ("model", "record", "level", "frequency_hz", "channel", "held_out")
    return {name: columns[name] for name in kept} | {
        "relative_deviation": np.hypot(*off) / size,
        "relative_noise": np.sqrt(2.0) * columns["std"] / size,
    }


def place_columns(d: Discrepancy) -> Columns:
    """Share of the misfit that each place explains, alone and beside the contact."""
    names = ("place", "beside_contact", "share", "chi2", "noise_variances", "dissipative_share", "stiffness")
    placed = [(p, False) for p in d.places] + [(p, True) for p in d.beside]
    rows = [(p.place.name, beside, p.share, p.chi2, p.left, p.dissipative_share, p.stiffness) for p, beside in placed]
    return columns_of(names, rows)


def force_columns(d: Discrepancy) -> Columns:
    """Columns of ``missing_force.csv``: the force at the best place, a row per record and harmonic."""
    f: MissingForce = d.best
    i, k = (part.ravel() for part in np.indices(f.force.shape))
    return {
        "record": d.records[i],
        "level": d.level[i],
        "frequency_hz": d.hz[i],
        "place": np.full(len(i), f.place.name),
        "unit": np.full(len(i), f.place.unit),
        "harmonic": k + 1,
        "real": f.force.real.ravel(),
        "imag": f.force.imag.ravel(),
        "std": f.std.ravel(),
        "in_phase": f.turned.real.ravel(),
        "quadrature": f.turned.imag.ravel(),
        "against_real": f.seen.real.ravel(),
        "against_imag": f.seen.imag.ravel(),
    }
