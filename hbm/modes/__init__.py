"""Linear and nonlinear modes, and backbones."""
