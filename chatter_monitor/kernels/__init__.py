"""Numba kernels: free functions on preallocated state. They know numpy, math and numba, and nothing of the rest.

Numba's on-disk cache renews a compiled function when the file of that function changes, not when a function that was
inlined into it does. Kernels are inlined across files, so their cache lives in a directory named after the contents of
all of them: stale machine code can never be picked up, and whether that directory is filled tells if the next run
will have to compile.
"""

import hashlib
import os
from pathlib import Path

import numba
import numba.core.config


def _digest() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_directory() -> Path:
    base = os.environ.get("NUMBA_CACHE_DIR")
    if not base:
        base = os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "chatter-monitor")
    return Path(base) / f"kernels-{_digest()}"


CACHE_DIRECTORY = _cache_directory()
try:
    CACHE_DIRECTORY.mkdir(parents=True, exist_ok=True)
except OSError:
    pass  # nowhere to write: numba falls back on its own choice, or compiles at every start
else:
    numba.core.config.CACHE_DIR = str(CACHE_DIRECTORY)  # type: ignore[attr-defined]  # made up at import


def is_compiled() -> bool:
    """Whether compiled kernels of exactly this version are on disk already."""
    return any(CACHE_DIRECTORY.rglob("*.nbi"))
