"""Benchmarks: speed as ratios taken in one run, accuracy against truth known from elsewhere."""

import os

# Threads of OpenBLAS wait busily, which would be taken for our own processor time; the programs run without them, too.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
