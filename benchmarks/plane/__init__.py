"""The paper's plane model: mesh study, contact at the half cylinder, and the budget of its resonance in Hz."""
