"""Friction laws from measurements: which law, with which parameters, and how sure that is.

In reading order: :func:`~hbm.identification.identify.identify` fits laws to reconstructed contact signals and returns
an :class:`~hbm.identification.identify.Identification` of :class:`~hbm.identification.lawfit.LawFit` objects and their
:class:`~hbm.identification.comparison.Comparison`; :func:`~hbm.identification.spectra.fit_spectra` starts from one
of them and fits the whole rig's response to the measured spectra.
"""
