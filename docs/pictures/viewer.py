"""rerun's viewer without a screen: opens a file, goes to a time, takes pictures."""

from __future__ import annotations

import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from rerun.experimental import ViewerClient

from chatter_monitor.outlets.dashboard.place import LOOPBACK, VIEWER
from chatter_monitor.outlets.dashboard.stream import TIMELINE

WIDTH, HEIGHT = 1600, 960
TOP_BAR = 36  # of the viewer, which says nothing
PATIENCE_S = 60.0
# After these the viewer has loaded a file, or painted a new time, and its notes on starting have gone.
OPENED_S, PAINTED_S = 6.0, 1.0
# Mesa draws where there is no graphics card.
LAVAPIPE = Path("/usr/share/vulkan/icd.d/lvp_icd.x86_64.json")


class Viewer:
    """A running viewer with a file open."""

    def __init__(self, client: ViewerClient) -> None:
        self._client = client

    def views(self) -> dict[str, str]:
        """Identifier of each view, by the entity that it is of."""
        return {view.origin: view.view_id for view in self._client.get_state().views}

    def complaints(self) -> list[str]:
        """What views report to be wrong with what they show."""
        return [f"{view.name}: {report}" for view in self._client.get_state().views for report in view.reports]

    def go(self, time_s: float) -> None:
        """Show what was at a time of the recording."""
        self._client.set_time(TIMELINE, duration=time_s, play_state="paused")
        time.sleep(PAINTED_S)

    def save(self, path: Path, origin: str | None = None) -> None:
        """Save a picture of one view, or of everything but the viewer's own bar."""
        with tempfile.TemporaryDirectory() as folder:
            raw = Path(folder) / "raw.png"
            self._client.save_screenshot(str(raw), None if origin is None else self.views()[origin])
            with Image.open(raw) as picture:
                if origin is None:
                    picture = picture.crop((0, TOP_BAR, picture.width, picture.height))
                # a palette of 256 colours is enough for lines on a dark ground, and takes a quarter of the room
                picture.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


@contextmanager
def viewer(file: Path, opened_s: float = OPENED_S) -> Iterator[Viewer]:
    """Open a file in a viewer that no screen is needed for, and wait so long for it."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        port = probe.getsockname()[1]
    with tempfile.TemporaryDirectory() as runtime:
        environment = {"XDG_RUNTIME_DIR": runtime, **os.environ}
        if LAVAPIPE.exists():
            environment.setdefault("VK_ICD_FILENAMES", str(LAVAPIPE))
        options = ["--headless", "--bind", LOOPBACK, "--port", str(port), "--window-size", f"{WIDTH}x{HEIGHT}"]
        command = [VIEWER, *options, "--hide-welcome-screen"]
        with (
            open(Path(runtime) / "viewer.log", "w+") as log,
            subprocess.Popen(command, env=environment, stdout=log, stderr=log) as process,  # noqa: S603  rerun's viewer
        ):
            try:
                _wait_for(port, process, Path(log.name))
                client = ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
                client.open(str(file))
                time.sleep(opened_s)
                yield Viewer(client)
            finally:
                process.kill()


def _wait_for(port: int, process: subprocess.Popen[bytes], log: Path) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            socket.create_connection((LOOPBACK, port), 1.0).close()
        except OSError:
            if process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"the viewer does not start: {log.read_text()[-500:]}") from None
            time.sleep(0.2)
        else:
            return
