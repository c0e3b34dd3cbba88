"""Harmonic balance for beams and structures with dry friction at a support."""
