"""Diagnosis: what a simulation gets wrong, which missing effect explains it, and what the extended model gains.

:func:`~hbm.diagnosis.diagnose.diagnose` is the entry and returns a :class:`~hbm.diagnosis.verdict.Diagnosis`. On its
way, a :class:`~hbm.outputerror.campaign.Campaign` simulates every record of a rig, a
:class:`~hbm.outputerror.model.Model` is a rig with free numbers and the causes it is extended by, and
:func:`~hbm.outputerror.fit.fit_model` finds those numbers.
"""
