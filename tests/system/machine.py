"""A machine that boots: Debian under a real systemd in a container, and commands run inside it."""

from __future__ import annotations

import signal
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Self

BOOT_S = 60.0
HALT_S = 30.0


class Machine:
    """A Debian tree, booted by systemd-nspawn without any network but its own loopback.

    Parameters
    ----------
    tree : Path
        Root directory, which the machine changes.
    console : Path
        File for what it prints while it boots.
    """

    def __init__(self, tree: Path, console: Path) -> None:
        self.tree = tree
        self._console = console.open("wb")
        nspawn = ["systemd-nspawn", "-q", "-D", tree, "--boot", "--register=no", "--keep-unit", "--private-network"]
        self._nspawn = subprocess.Popen(
            nspawn, stdin=subprocess.DEVNULL, stdout=self._console, stderr=subprocess.STDOUT
        )
        self._init = self._wait_for_init()
        self.run("systemctl", "is-system-running", "--wait", check=False, timeout_s=BOOT_S)

    def run(self, *command: str, check: bool = True, timeout_s: float = 60.0) -> str:
        """Run a command as root of the machine; returns what it prints, errors included."""
        process = self.start(*command)
        try:
            printed, _ = process.communicate(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        if check and process.returncode:
            raise AssertionError(f"{' '.join(command)} ended with {process.returncode}:\n{printed[-4000:]}")
        return printed

    def start(self, *command: str) -> subprocess.Popen[str]:
        """Begin a command as root of the machine."""
        return subprocess.Popen(
            ["nsenter", "--all", "--target", str(self._init), "--", *command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def show(self, unit: str, *properties: str) -> dict[str, str]:
        """Properties of a unit as systemd has them."""
        shown = self.run("systemctl", "show", unit, *(f"--property={name}" for name in properties))
        return dict(line.split("=", 1) for line in shown.splitlines())

    def journal(self, unit: str) -> str:
        """What the journal has of a unit, the manager's own messages about it included."""
        return self.run("journalctl", "--no-pager", "--output=short-iso-precise", f"--unit={unit}")

    def put(self, path: str, text: str) -> None:
        """Write a file."""
        target = self.tree / path.removeprefix("/")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text)

    def halt(self) -> None:
        """Shut the machine down; pull the plug if it does not."""
        self._nspawn.send_signal(signal.SIGTERM)
        try:
            self._nspawn.wait(HALT_S)
        except subprocess.TimeoutExpired:
            self._nspawn.kill()
            self._nspawn.wait()
        self._console.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.halt()

    def _wait_for_init(self) -> int:
        """Process number, on this side, of what is number 1 inside; once it has got as far as the message bus."""
        deadline = time.monotonic() + BOOT_S
        while time.monotonic() < deadline:
            if self._nspawn.poll() is not None:
                break
            init = next(filter(_is_init, _descendants(self._nspawn.pid)), None)
            if init is not None and Path(f"/proc/{init}/root/run/dbus/system_bus_socket").exists():
                return init
            time.sleep(0.1)
        self.halt()
        console = Path(self._console.name).read_text(errors="replace")
        raise AssertionError(f"the machine does not boot:\n{console[-4000:]}")


def _descendants(pid: int) -> list[int]:
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return []
    return [process for child in map(int, children) for process in (child, *_descendants(child))]


def _is_init(pid: int) -> bool:
    """Whether the process is number 1 of a namespace of its own."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False
    numbers = next(line for line in status.splitlines() if line.startswith("NSpid:")).split()[1:]
    return len(numbers) > 1 and numbers[-1] == "1"
