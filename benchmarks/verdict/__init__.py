"""Benchmark of the verdict: simulated cuts with known truth, scored beside detectors from the literature."""
