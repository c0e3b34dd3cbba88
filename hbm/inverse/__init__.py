"""Inverse harmonic balance: from accelerations along a structure to the forces at its contact.

In reading order: :class:`~hbm.inverse.sensing.Sensing` puts measured spectra beside the linear structure; a formulation
finds the friction force in them, a :class:`~hbm.inverse.contactforce.ForceEstimate`; the rest of the contact follows
from it (:mod:`hbm.inverse.contact`); :func:`~hbm.inverse.reconstruct.reconstruct` does all of it and returns a
:class:`~hbm.inverse.reconstruction.Reconstruction`, where every number has its standard deviation.
"""
