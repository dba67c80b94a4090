"""Debian's browser without a screen: what a page says, whom it asks, how wide it is, what it looks like."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from PIL import Image

OPTIONS = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--allow-file-access-from-files"]
OPTIONS += ["--disable-background-networking", "--disable-component-update", "--no-first-run"]
WIDTHS = (390, 1280)
OWN = "not an origin"  # initiator of what the browser asks for itself

# A browser's window cannot be as narrow as a phone, but a frame in it can. What is wider than its frame sticks out.
FRAME = """<!doctype html><body style="margin:0"><iframe id=f src="{page}" width={width} height=2600 style="border:0"
onload="const d=this.contentDocument.documentElement;document.title=d.scrollWidth+' '+d.scrollHeight+' '+
[...this.contentDocument.images].every(i=>i.complete&&i.naturalWidth>0)"></iframe>"""


class Browser:
    """Opens pages, each time anew."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def _run(self, page: Path, *options: object) -> subprocess.CompletedProcess[str]:
        command = [
            "chromium",
            *OPTIONS,
            f"--user-data-dir={self._folder / 'profile'}",
            *map(str, options),
            page.as_uri(),
        ]
        return subprocess.run(command, capture_output=True, text=True, timeout=240, check=True)

    def complaints(self, page: Path) -> list[str]:
        """What the page says on the console."""
        done = self._run(page, "--enable-logging=stderr", "--virtual-time-budget=2000", "--dump-dom")
        return [line for line in done.stderr.splitlines() if "CONSOLE" in line]

    def hosts(self, page: Path) -> set[str]:
        """Hosts that the page, not the browser for its own ends, asks for anything."""
        log = self._folder / "net.json"
        self._run(page, f"--log-net-log={log}", "--virtual-time-budget=2000", "--dump-dom")
        requests = [event.get("params", {}) for event in json.loads(log.read_text())["events"]]
        urls = {r["url"] for r in requests if "url" in r and r.get("initiator", OWN) != OWN}
        return {urlsplit(url).hostname for url in urls if not url.startswith(("file:", "data:"))}

    def measured(self, page: Path, width: int) -> tuple[int, int, bool]:
        """Width and height that the page takes in a frame of a width, and whether all its pictures are there."""
        frame = self._framed(page, width)
        title = self._run(frame, "--virtual-time-budget=4000", "--dump-dom").stdout.split("<title>")[1].split("<")[0]
        wide, high, complete = title.split()
        return int(wide), int(high), complete == "true"

    def picture(self, page: Path, width: int, path: Path) -> np.ndarray:
        """Picture of the page in a frame of a width."""
        size = f"--window-size={max(width, 500)},2600"
        self._run(self._framed(page, width), size, f"--screenshot={path}")
        with Image.open(path) as picture:
            return np.asarray(picture.convert("RGB")).astype(int)[:, :width]

    def _framed(self, page: Path, width: int) -> Path:
        frame = self._folder / f"frame_{width}.html"
        frame.write_text(FRAME.format(page=page.as_uri(), width=width))
        return frame
