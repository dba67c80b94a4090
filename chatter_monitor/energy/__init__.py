"""Nonparametric identification of stiffness, damping and excitation from the response alone (paper, section 3)."""
