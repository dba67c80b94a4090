"""Nonparametric identification of stiffness, damping and excitation from the response alone (section 3 of the paper)."""
