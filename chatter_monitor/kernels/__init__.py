"""Numba kernels: free functions on preallocated state. They know numpy, math and numba, and nothing of the rest."""
