"""Time integration of a rig, step by step, and its periodic steady states."""
