"""What an interval gives back it gets again: pages do not go to the system and come back."""

from __future__ import annotations

import subprocess
import sys

PAGES = """
import resource
import numpy as np
from chatter_monitor.service.heap import keep_flat
keep_flat()
def intervals():
    kept = [np.ones((4, 4, 640), np.float32) for _ in range(51)]  # as a replay's block makes them
def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        intervals()
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
faults()
print(faults())
"""


def test_an_interval_gets_the_pages_of_the_last_ones():
    """Where they went back to the system, each of 1020 intervals would have ten pages to wait for."""
    done = subprocess.run([sys.executable, "-c", PAGES], capture_output=True, text=True, check=True)
    assert int(done.stdout) < 100
