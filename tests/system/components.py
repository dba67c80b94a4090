"""The real components that system tests meet. Where one is missing a test is skipped, but in `.ci/run` it fails."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

REQUIRED = "CHATTER_MONITOR_REQUIRE_SYSTEM"  # set by .ci/run, which installs everything


def need(**packages: str) -> None:
    """Skip, or fail where components are required, if a program is missing.

    Parameters
    ----------
    **packages : str
        Debian package of each program; an underscore in a program's name stands for a hyphen.
    """
    for name, package in packages.items():
        program = name.replace("_", "-")
        if shutil.which(program, path=os.environ["PATH"] + ":/usr/sbin") is None:
            _lacking(f"{program} is missing: apt-get install {package}")


def need_header(name: str, *, package: str) -> None:
    """Skip, or fail where components are required, if a C header is missing."""
    if not (Path("/usr/include") / name).exists():
        _lacking(f"{name} is missing: apt-get install {package}")


def need_root() -> None:
    """Skip, or fail where components are required, if this is not root."""
    if os.geteuid() != 0:
        _lacking("only root can do this")


def _lacking(reason: str) -> None:
    if os.environ.get(REQUIRED):
        pytest.fail(reason)
    pytest.skip(reason)
