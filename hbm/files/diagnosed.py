"""A diagnosis with what it was made of: its records beside the models, and the answers that are said first."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hbm.diagnosis.curves import TracedResponse
from hbm.diagnosis.discrepancy import Discrepancy
from hbm.diagnosis.verdict import Diagnosis
from hbm.figures.compared import Compared, View, clearest, compared, noise_error
from hbm.files.diagnosissummary import first_screen
from hbm.files.outputs import Columns
from hbm.measurement.decay import Decay
from hbm.measurement.spectra import MeasuredSpectra
from models.jointed import AnyRig
from models.parts import UNITS


@dataclass(frozen=True, eq=False)
class Diagnosed:
    """A diagnosis with what it was made of.

    Attributes
    ----------
    diagnosis : Diagnosis
    rig : Rig or JointedRig
        Nominal.
    spectra : MeasuredSpectra or Decay
        What was measured.
    force : Discrepancy or None
        Force that the model lacks; None where it was not worked out.
    traced : tuple of TracedResponse
        Response curves of the models, where they were traced.
    warnings : tuple of str
        Warnings, such as a part of the result that is missing.
    """

    diagnosis: Diagnosis
    rig: AnyRig
    spectra: MeasuredSpectra | Decay
    force: Discrepancy | None = None
    traced: tuple[TracedResponse, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def evidence(self) -> tuple[str, ...]:
        """Sentences: to beware of, of the diagnosis, of the missing force."""
        force = self.force.sentences(self.diagnosis.extended_fit) if self.force else ()
        return (*self.warnings, *self.diagnosis.evidence, *force)

    @cached_property
    def compared(self) -> Mapping[str, Compared]:
        """The models beside all records, by their names; empty where these are not known."""
        level = dict(zip(self.spectra.records.tolist(), self.spectra.level.tolist(), strict=True))
        return {} if self.diagnosis.campaign is None else compared(self.diagnosis, level)

    @cached_property
    def view(self) -> View | None:
        """Signal that shows the misfit best; if the rig is consistent, the one that moves most."""
        models = self.compared
        if not models or self.diagnosis.floored:
            return None
        missed = self.diagnosis.verdict != "consistent"
        return clearest([c for name, c in models.items() if name != "extended"], missed=missed)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of those that were measured."""
        campaign = self.diagnosis.campaign
        return () if campaign is None else tuple(campaign.data.channels)

    @property
    def units(self) -> list[str]:
        """Units of the channels that were measured, as figures write them."""
        unit = {c.name: UNITS[c.quantity].replace("s2", "s²") for c in self.rig.channels}
        return [unit[name] for name in self.channels]

    def labelled(self, columns: Columns) -> Columns:
        """Columns with the records as the spectra file calls them."""
        return {**columns, "record": self.spectra.labels_of(columns["record"])}

    def noise(self, *, held: bool) -> float:
        """Relative error that noise alone makes, on the records fitted or held out; 0 where it is not known."""
        return noise_error(next(iter(self.compared.values())), held=held) if self.compared else 0.0

    def answers(self) -> dict[str, str]:
        """The six answers that are said first, by their question."""
        view, where = self.view, ""
        if view is not None:
            where = f"harmonic {view.harmonic} of {self.channels[view.channel]} at {view.level:.3g} N"
        noise = self.noise(held=bool(self.diagnosis.held_out_records))
        return first_screen(self.diagnosis, self.force, where, noise, self.doubted)

    @property
    def doubted(self) -> tuple[str, ...]:
        """Names of the records that something speaks against."""
        numbers = np.array([record for record, _ in self.spectra.notes], dtype=int)
        return tuple(dict.fromkeys(map(str, self.spectra.labels_of(numbers))))
