"""What is on the disk after the power has failed."""

from __future__ import annotations

import os
from pathlib import Path


def synchronise(path: Path) -> None:
    """Have the disk keep a file, or the names in a folder; returns when it does."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
