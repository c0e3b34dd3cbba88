"""Periodic responses: steady states, curves over frequency, their accuracy, bifurcations and branches."""
