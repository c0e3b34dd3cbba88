"""Exact derivatives of periodic solutions to every number of a rig."""
