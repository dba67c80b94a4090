"""What is wrong with this installation, and what to do about it."""

from __future__ import annotations

import os
import platform
import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from chatter_monitor.acquisition import portaudio
from chatter_monitor.acquisition.portaudio import Opener, PortAudio
from chatter_monitor.acquisition.sound_card import CEILING, WRONG_RATE_PPM
from chatter_monitor.config import Settings, load
from chatter_monitor.errors import ChatterMonitorError, EnvironmentFault, InputError
from chatter_monitor.kernels import CACHE_DIRECTORY, is_compiled
from chatter_monitor.outlets.inquiry import WAIT_S, newest_health

PACKAGES = ("numpy", "scipy", "numba", "sounddevice", "soundfile", "soxr", "pyzmq", "msgspec", "pyarrow")
LISTEN_S = 1.0
PATIENCE_S = 5.0  # for a device that does not answer
QUIET_DBFS = -90.0  # below the noise of any sensor that is switched on


class Finding(msgspec.Struct, frozen=True):
    """One check: what was found, and what to do if that is wrong.

    Attributes
    ----------
    check : str
        What was looked at.
    state : str
        "ok"; "note" for what may be meant; "wrong" for what keeps the monitor from its work.
    found : str
        In words.
    remedy : str or None
        What to do.
    """

    check: str
    state: Literal["ok", "note", "wrong"]
    found: str
    remedy: str | None = None


def running(settings: Settings, wait_s: float = WAIT_S) -> Finding:
    """Whether the monitor that runs with this configuration hears: the health check of service and container."""
    try:
        health = newest_health(settings.publish, settings.control, wait_s)
    except EnvironmentFault as fault:
        return _wrong("running monitor", fault)
    reasons = "; ".join(health.reasons)
    if health.state != "hearing":
        return Finding("running monitor", "wrong", f"it runs, but does not hear: {reasons}", "See the other checks.")
    return Finding(
        "running monitor", "ok", f"it hears: {health.samples_in} samples" + (f"; {reasons}" if reasons else "")
    )


def examine(
    configs: Sequence[Path], opener: Callable[[Settings], Opener] | None = None, wait_s: float = WAIT_S
) -> Iterator[Finding]:
    """Look at everything that the monitor needs, one thing after the other.

    Parameters
    ----------
    configs : sequence of Path
        Machine configuration.
    opener : callable, optional
        Devices for some settings; PortAudio's by default.
    wait_s : float
        For how long to wait for a running monitor.
    """
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    yield Finding("packages", "ok", f"Python {platform.python_version()}, {packages}")
    try:
        settings = load(configs)
    except InputError as error:
        yield _wrong("configuration", error)
        settings = Settings()
    else:
        yield Finding("configuration", "ok", ", ".join(map(str, configs)) or "none given; the defaults hold")
    yield _kernels()
    yield _recorder(settings)
    runs = running(settings, wait_s)
    if runs.state == "ok" or "does not hear" in runs.found:
        yield runs
        yield Finding("ports", "ok", "in use by the running monitor")
    else:
        yield Finding("running monitor", "note", "none runs with this configuration")
        yield _ports(settings)
    try:
        yield Finding("PortAudio", "ok", portaudio.version())
    except EnvironmentFault as fault:
        yield _wrong("PortAudio", fault)
        return
    yield _rights()
    device = PortAudio(settings.input, settings.tracker.sample_rate_hz) if opener is None else opener(settings)
    heard = _device(settings, device)
    if heard.state == "wrong" and runs.state == "ok":  # many devices serve one program at a time
        heard = Finding("device", "note", f"{heard.found} The running monitor has it.")
    yield heard


def line(finding: Finding) -> str:
    """One check for a person."""
    mark = {"ok": "OK   ", "note": "note ", "wrong": "WRONG"}[finding.state]
    remedy = f" {finding.remedy}" if finding.remedy else ""
    return f"{mark}  {finding.check}: {finding.found}{remedy}"


def _wrong(check: str, error: ChatterMonitorError) -> Finding:
    return Finding(check, "wrong", str(error))


def _kernels() -> Finding:
    if not os.access(CACHE_DIRECTORY, os.W_OK):
        return Finding(
            "kernels",
            "wrong",
            f"{CACHE_DIRECTORY} cannot be written, so they are compiled anew at every start.",
            "Set NUMBA_CACHE_DIR to a directory that can be.",
        )
    if not is_compiled():
        return Finding("kernels", "note", "not compiled yet: the first start takes about a minute longer")
    return Finding("kernels", "ok", f"compiled, in {CACHE_DIRECTORY}")


def _recorder(settings: Settings) -> Finding:
    directory = Path(settings.recorder.directory)
    remedy = "Create it for the user that the monitor runs as, or choose another one: [recorder] directory."
    existing = next(path for path in (directory, *directory.parents) if path.exists())
    if not os.access(existing, os.W_OK | os.X_OK) or not existing.is_dir():
        return Finding("recordings", "wrong", f"events cannot be recorded in {directory}: no right to write.", remedy)
    free_gb = shutil.disk_usage(existing).free / 1e9
    quota_gb = settings.recorder.quota_gb
    if free_gb < quota_gb:
        what = f"{directory} has {free_gb:.1f} GB free, less than the quota of {quota_gb:g} GB"
        return Finding("recordings", "note", what, "The oldest recordings do not go before the quota is reached.")
    return Finding("recordings", "ok", f"{directory}, {free_gb:.0f} GB free, quota {quota_gb:g} GB")


def _ports(settings: Settings) -> Finding:
    binds = {"publish": settings.publish.bind, "control": settings.control.bind, "metrics": settings.metrics.bind}
    taken = []
    for table, bind in binds.items():
        host, _, port = (bind or "").removeprefix("tcp://").rpartition(":")
        if bind is None or bind.startswith("ipc://") or not port.isdecimal():
            continue
        host = host.strip("[]").replace("*", "0.0.0.0")  # noqa: S104  only to see whether the port is free
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        with socket.socket(family, socket.SOCK_STREAM) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                trial.bind((host, int(port)))
            except OSError as error:
                taken.append(f"[{table}] bind {bind}: {error.strerror}")
    if taken:
        return Finding("ports", "wrong", "; ".join(taken) + ".", "Choose others, or stop who uses them: `ss -ltnp`.")
    return Finding("ports", "ok", "free: " + ", ".join(bind for bind in binds.values() if bind))


def _rights() -> Finding:
    sound = Path("/dev/snd")
    if not sound.exists():
        return Finding(
            "sound hardware",
            "note",
            "this computer (or container) has no /dev/snd; only a sound server can be heard.",
            "In a container: --device /dev/snd.",
        )
    closed = [path.name for path in sound.glob("pcm*c") if not os.access(path, os.R_OK | os.W_OK)]
    if closed:
        return Finding(
            "sound hardware",
            "wrong",
            f"no right to open {', '.join(closed)}.",
            "Join the group audio, and log in again.",
        )
    return Finding("sound hardware", "ok", "/dev/snd can be opened")


def _device(settings: Settings, opener: Opener) -> Finding:
    """Listen for a moment, in a thread that may hang with the device."""
    findings: list[Finding] = []

    def listen() -> None:
        try:
            findings.append(_listen(settings, opener))
        except EnvironmentFault as fault:
            findings.append(_wrong("device", fault))

    thread = threading.Thread(target=listen, daemon=True)
    thread.start()
    thread.join(LISTEN_S + PATIENCE_S)
    if not findings:
        return Finding(
            "device",
            "wrong",
            "it does not answer.",
            "The sound server or the driver hangs: restart the one, replug the other.",
        )
    return findings[0]


def _listen(settings: Settings, opener: Opener) -> Finding:
    pieces: list[NDArray[np.float32]] = []
    times_s: list[float] = []
    overflows: list[bool] = []

    def deliver(samples: NDArray[np.float32], overflow: bool) -> None:
        pieces.append(samples.copy())
        times_s.append(time.monotonic())
        overflows.append(overflow)

    choice = opener.choose()
    stream = opener.open(choice, deliver, lambda: None)
    time.sleep(LISTEN_S)
    stream.close()
    name = f"{choice.device.name!r} at {choice.sample_rate_hz / 1000:g} kHz"
    if len(pieces) < 2:
        return Finding("device", "wrong", f"{name} opens, but delivers nothing.", "Does another program hold it?")
    samples = np.concatenate(pieces)[:, list(settings.input.channels or (0,))]
    levels = 20 * np.log10(np.maximum(np.sqrt(np.mean((samples - samples.mean(axis=0)) ** 2, axis=0)), 1e-10))
    found = f"{name} hears {' and '.join(f'{level:.0f} dBFS' for level in levels)}"
    rate_hz = (len(samples) - len(pieces[0])) / (times_s[-1] - times_s[0])
    dead = np.ptp(samples, axis=0) == 0
    if dead.any():
        channels = ", ".join(str((settings.input.channels or (0,))[c]) for c in np.flatnonzero(dead))
        return Finding(
            "device",
            "wrong",
            f"{name}: nothing changes on channel {channels}.",
            "Is the sensor connected, switched on, and not muted (`alsamixer`)?",
        )
    if np.count_nonzero(np.abs(samples) >= CEILING) > 2:
        return Finding("device", "wrong", f"{found}, clipped.", "Turn its gain down (`alsamixer`).")
    if abs(rate_hz / choice.sample_rate_hz - 1) > 10 * WRONG_RATE_PPM * 1e-6:  # a second is short
        return Finding(
            "device", "wrong", f"{found}, but {rate_hz:.0f} samples a second.", "Try another [input] sample_rate_hz."
        )
    if levels.max() < QUIET_DBFS:
        return Finding("device", "note", f"{found}: very quiet", "Is the sensor the one that you mean?")
    return Finding("device", "ok", f"{found}, {sum(overflows)} overflows")
