"""Measurements: recordings over time, the harmonics estimated from them, and the files that hold either.

In reading order: :class:`~hbm.measurement.recording.Recording` is what a logger wrote
(:mod:`~hbm.measurement.historyfile` reads it), :func:`~hbm.measurement.harmonics.harmonic_spectra` finds its harmonics
and says what speaks against the record, :class:`~hbm.measurement.spectra.MeasuredSpectra` holds those of a whole
campaign, and :mod:`~hbm.measurement.spectrafile` reads and writes them.
"""
