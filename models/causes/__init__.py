"""The catalogue of causes: what may be missing in a rig that does not agree with its measurements.

:class:`~models.causes.cause.Cause` says what a cause is; each is one small class that extends a rig, and its parameters
are numbers of the extended rig, so that simulation and exact derivatives need to know nothing of it.
"""
