"""Pictures of pages, made by Debian's chromium without a screen."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

OPTIONS = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--virtual-time-budget=4000"]


def photograph(page: Path, picture: Path, *, width: int, height: int) -> None:
    """Save what a page shows in a window of this size, in pixels.

    Raises
    ------
    FileNotFoundError
        If there is no chromium: apt-get install chromium.
    subprocess.CalledProcessError
        If it fails.
    """
    with tempfile.TemporaryDirectory() as profile:
        subprocess.run(  # noqa: S603
            [  # noqa: S607
                "chromium",
                *OPTIONS,
                f"--user-data-dir={profile}",
                f"--window-size={width},{height}",
                f"--screenshot={picture}",
                page.as_uri(),
            ],
            check=True,
            capture_output=True,
        )
