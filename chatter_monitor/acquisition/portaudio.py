"""Sound devices through PortAudio: which there are, which one is meant, what it can, and opening it.

The only module that knows sounddevice. It is imported when it is needed, so that everything else works where PortAudio
is not installed. PortAudio is not safe to be called from several threads: one thread owns a `PortAudio` and what it
opens.
"""

from __future__ import annotations

import atexit
import fnmatch
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.acquisition.settings import InputSettings
from chatter_monitor.errors import EnvironmentFault

# Besides the tracker's own rate; the first one that the device can is taken. 48 kHz is what most hardware runs at, so
# nothing in between converts it; 51.2 kHz is that of measuring front ends.
COMMON_RATES_HZ = (48_000.0, 51_200.0, 44_100.0)
DELIVERY_S = 0.01  # length of the pieces that the device is asked to deliver

Deliver = Callable[[NDArray[np.float32], bool], None]
"""Takes samples, shape (n, channels), and whether the device has lost some just before them."""


@dataclass(frozen=True, slots=True)
class Device:
    """An input as PortAudio lists it.

    Attributes
    ----------
    index : int
        Changes when devices come and go.
    name, host_api : str
        Such as "USB Audio: - (hw:1,0)" and "ALSA".
    channels : int
        As many as it has at most.
    default : bool
        Whether it is the system's choice.
    """

    index: int
    name: str
    host_api: str
    channels: int
    default: bool


@dataclass(frozen=True, slots=True)
class Choice:
    """A device with what it is to be opened with."""

    device: Device
    sample_rate_hz: float
    channels: int


class Stream(Protocol):
    """An open device that delivers samples."""

    def close(self) -> None:
        """Stop and close it; may hang while the device does."""
        ...


class Opener(Protocol):
    """What a sound card needs to hear with: a device of this computer, or a test's."""

    def choose(self) -> Choice:
        """Look which devices there are now, and choose.

        Raises
        ------
        EnvironmentFault
            If the device is not there or cannot do what is asked of it.
        """
        ...

    def open(self, choice: Choice, deliver: Deliver, ended: Callable[[], None]) -> Stream:
        """Open a device, which from then on delivers, and says when it has ended by itself.

        Raises
        ------
        EnvironmentFault
            If the device does not open.
        """
        ...


class PortAudio(Opener):
    """Devices of this computer, for one input.

    Parameters
    ----------
    settings : InputSettings
        Which device is meant.
    tracker_rate_hz : float
        The rate that needs no conversion.
    """

    def __init__(self, settings: InputSettings, tracker_rate_hz: float) -> None:
        self._settings = settings
        self._tracker_rate_hz = tracker_rate_hz

    def devices(self) -> list[Device]:
        """List the inputs that there are now.

        Raises
        ------
        EnvironmentFault
            If PortAudio is not installed or does not work.
        """
        sounddevice = _fresh()
        try:
            default_index = sounddevice.default.device[0]
            apis = [api["name"] for api in sounddevice.query_hostapis()]
            found = sounddevice.query_devices()
        except sounddevice.PortAudioError as error:
            raise _fault("the sound devices cannot be listed", error) from error
        if default_index < 0:  # nobody has set one: the first interface's own
            defaults = (api["default_input_device"] for api in sounddevice.query_hostapis())
            default_index = next((index for index in defaults if index >= 0), -1)
        return [
            Device(d["index"], d["name"], apis[d["hostapi"]], d["max_input_channels"], d["index"] == default_index)
            for d in found
            if d["max_input_channels"] > 0
        ]

    def choose(self) -> Choice:
        """Look which devices there are now, and choose the one that is meant, with the best rate that it can."""
        device = find(self.devices(), self._settings.device)
        channels = max(self._settings.channels or (0,)) + 1
        if channels > device.channels:
            raise EnvironmentFault(
                f"the device {device.name!r} lacks a channel that [input] channels asks for",
                got=channels - 1,
                allowed=f"0 to {device.channels - 1}",
                remedy="Channels are counted from 0.",
            )
        wanted = self._settings.sample_rate_hz
        candidates = (self._tracker_rate_hz, *COMMON_RATES_HZ) if wanted is None else (wanted,)
        possible = self.rates_hz(device, channels, candidates)
        if not possible:
            raise EnvironmentFault(
                f"the device {device.name!r} opens at none of the wanted rates",
                got=", ".join(f"{rate:g} Hz" for rate in candidates),
                remedy="Another program may hold the device; or name a rate that it can: [input] sample_rate_hz.",
            )
        return Choice(device, possible[0], channels)

    def rates_hz(self, device: Device, channels: int, candidates: Iterable[float]) -> list[float]:
        """Those of the rates at which a device that was listed last would open."""
        sounddevice = _sounddevice()
        possible = []
        for rate in candidates:
            try:
                sounddevice.check_input_settings(device.index, channels, "float32", samplerate=rate)
            except (sounddevice.PortAudioError, ValueError):
                continue
            possible.append(rate)
        return possible

    def open(self, choice: Choice, deliver: Deliver, ended: Callable[[], None]) -> Stream:
        """Open a device; `deliver` and `ended` are called by a thread of PortAudio's."""
        sounddevice = _sounddevice()

        def callback(samples: NDArray[np.float32], _frames: int, _time: object, status: Any) -> None:
            deliver(samples, bool(status.input_overflow))

        try:
            stream = sounddevice.InputStream(
                device=choice.device.index,
                channels=choice.channels,
                samplerate=choice.sample_rate_hz,
                dtype="float32",
                blocksize=round(DELIVERY_S * choice.sample_rate_hz),
                latency="low",  # otherwise a sound server delivers in bursts
                callback=callback,
                finished_callback=ended,
            )
            stream.start()
        except (sounddevice.PortAudioError, ValueError) as error:
            raise _fault(f"the device {choice.device.name!r} does not open", error) from error
        return _Stream(stream, sounddevice.PortAudioError)


class _Stream(Stream):
    def __init__(self, stream: Any, error: type[Exception]) -> None:
        self._stream = stream
        self._error = error

    def close(self) -> None:
        """Stop and close it; a device that is gone has nothing to close."""
        for finish in (self._stream.abort, self._stream.close):
            with suppress(self._error):
                finish()


def find(devices: Sequence[Device], wanted: str | int) -> Device:
    """Device that is meant: by its index, its exact name, a pattern, or a part of its name, the first that fits.

    Raises
    ------
    EnvironmentFault
        If there is none.
    """
    if wanted == "default" and any(device.default for device in devices):
        found = [device for device in devices if device.default]
    elif isinstance(wanted, int):
        found = [device for device in devices if device.index == wanted]
    else:
        name = wanted.casefold()
        found = [device for device in devices if device.name.casefold() == name]
        # Brackets are no pattern: names of devices have them.
        pattern = "*" + name.replace("[", "[[]") + "*"
        found += [device for device in devices if fnmatch.fnmatchcase(device.name.casefold(), pattern)]
    if found:
        return found[0]
    raise EnvironmentFault(
        "there is no such sound device" if devices else "there is no sound device to listen to",
        got=wanted,
        allowed=", ".join(f"{device.index}: {device.name}" for device in devices) or None,
        remedy="Is it plugged in, and may this user open it (group audio)? `chatter-monitor devices` lists what there "
        "is; [input] device chooses.",
    )


def version() -> str:
    """Version of the PortAudio library.

    Raises
    ------
    EnvironmentFault
        If it is not installed.
    """
    return str(_sounddevice().get_portaudio_version()[1])


def _sounddevice() -> Any:
    try:
        import sounddevice
    except (ImportError, OSError) as error:
        raise EnvironmentFault(
            f"PortAudio is not installed: {error}", remedy="On Debian: apt install libportaudio2."
        ) from error
    # It would wait at the end of the program for a device that hangs.
    atexit.unregister(sounddevice._exit_handler)
    return sounddevice


def _fresh() -> Any:
    """PortAudio with the devices that there are now: it lists them once, when it is initialised."""
    sounddevice = _sounddevice()
    try:
        if sounddevice._initialized:
            sounddevice._terminate()
        sounddevice._initialize()
    except sounddevice.PortAudioError as error:
        raise _fault("PortAudio does not start", error) from error
    return sounddevice


def _fault(what: str, error: Exception) -> EnvironmentFault:
    return EnvironmentFault(f"{what}: {error.args[0] if error.args else error}")
