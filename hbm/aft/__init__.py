"""Friction laws over a period (alternating frequency/time): samples in, coefficients and exact derivatives out."""
