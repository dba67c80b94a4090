"""A sound card without hardware: a private PulseAudio with a virtual card that programs hear through ALSA."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Self

START_S = 20.0
ASOUNDRC = "pcm.!default { type pulse }\nctl.!default { type pulse }\n"


class SoundServer:
    """What is played into its card is heard from it, bit by bit, if it has the card's rate.

    Parameters
    ----------
    directory : Path
        Of its own; a short path, because sockets lie in it.
    rate_hz : int
        Of the card, which has two channels; whoever opens one hears their mean.

    Attributes
    ----------
    environment : dict
        In which a program's default device is the card.
    """

    def __init__(self, directory: Path, rate_hz: int) -> None:
        self._rate_hz = rate_hz
        self._server: subprocess.Popen[bytes] | None = None
        self._players: list[subprocess.Popen[bytes]] = []
        self._socket = directory / "native"
        directory.chmod(0o700)
        (directory / ".asoundrc").write_text(ASOUNDRC)
        cache = os.environ.get("XDG_CACHE_HOME", os.path.expanduser("~/.cache"))  # compiled kernels are there already
        self.environment = os.environ | {
            "HOME": str(directory),
            "XDG_RUNTIME_DIR": str(directory),
            "XDG_CACHE_HOME": cache,
            "PULSE_SERVER": f"unix:{self._socket}",
        }

    def start(self) -> None:
        """Start it, and wait until the card can be heard."""
        card = f"module-null-sink sink_name=card rate={self._rate_hz} channels=2 format=float32le norewinds=1"
        modules = (f"module-native-protocol-unix socket={self._socket} auth-anonymous=1", card, "module-always-sink")
        options = ["-n", "--daemonize=no", "--exit-idle-time=-1", "--use-pid-file=no"]
        self._server = subprocess.Popen(
            ["pulseaudio", *options, *(word for module in modules for word in ("-L", module))],
            env=self.environment,
            stderr=subprocess.DEVNULL,
        )
        deadline_s = time.monotonic() + START_S
        while subprocess.run(
            ["pactl", "set-default-source", "card.monitor"],
            env=self.environment,
            stderr=subprocess.DEVNULL,
            check=False,
        ).returncode:
            assert time.monotonic() < deadline_s, "PulseAudio does not start"
            time.sleep(0.02)

    def play(self, file: Path) -> subprocess.Popen[bytes]:
        """Play a sound file into the card, once."""
        player = subprocess.Popen(["paplay", "--device=card", file], env=self.environment, stderr=subprocess.DEVNULL)
        self._players.append(player)
        return player

    def freeze(self) -> None:
        """Let it neither deliver nor answer, without any error, until it is thawed."""
        assert self._server is not None
        self._server.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Let it go on."""
        assert self._server is not None
        self._server.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        """End it without notice."""
        assert self._server is not None
        self._server.kill()
        self._server.wait()
        self._server = None

    def close(self) -> None:
        """End it and those who play."""
        if self._server is not None:
            self.kill()
        for player in self._players:
            player.kill()
            player.wait()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()
