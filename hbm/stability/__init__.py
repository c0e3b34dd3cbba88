"""Stability of periodic solutions: Floquet multipliers, Hill's method, and what transients leave."""
