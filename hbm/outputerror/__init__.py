"""Output error: a rig simulated at measured records, in standard deviations, and its numbers fitted to them."""
