"""Responses followed along any number of a rig: curves, folds and resonance peaks."""
