"""Simulation against a running signal: the signature engine, recursively."""
