"""The harmonic balance of a rig: equations, elimination of the modes, the problem that is solved, its solutions."""
