"""Benchmarks: speed as ratios taken in one run, accuracy against truth known from elsewhere."""
