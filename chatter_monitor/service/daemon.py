"""The daemon: a sound device through the monitor to the outlets, for as long as the machine stands.

Threads, and what each owns
---------------------------
main            the worker: sockets' ends, trackers, judges, outlets, notifier; signals only leave a note for it
sound-card      the device (acquisition.sound_card); PortAudio's own thread fills the ring
control         the control socket; hands commands over in a bounded queue
flight-recorder the directory of recorded events; takes stretches from a bounded queue
metrics, curve  answer from messages that never change, and from the list of certificates

If the worker or the card's thread dies of an error, the process ends with exit code 1 and the service manager starts it
anew.

Start: configuration, sockets (a port in use is better known before), kernels, and then the device. Where there is no
device it is waited for.

Stop, on SIGTERM or SIGINT: the source ends after the block at hand; trackers give out their last frames and events that
are under way end; then, the last opened first, the device is closed, recordings are written out, the control socket
answers no more, metrics end, and the publisher gives its subscribers `LINGER_MS` for the last messages.

SIGHUP: the configuration is read again. What is wrong with it is told, and the old one stays. Thresholds and the
spindle change at once; for everything else the daemon says that it needs a restart.
"""

from __future__ import annotations

import gc
import logging
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType

from rich.console import Console

from chatter_monitor.acquisition.index_clock import IndexClock
from chatter_monitor.acquisition.portaudio import Opener, PortAudio
from chatter_monitor.acquisition.sound_card import SoundCard
from chatter_monitor.config import load
from chatter_monitor.errors import ChatterMonitorError
from chatter_monitor.outlets.control import Control
from chatter_monitor.outlets.event_store import EventWriter
from chatter_monitor.outlets.metrics import Metrics
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.outlets.publisher import Publisher
from chatter_monitor.service.compiling import what_takes_long
from chatter_monitor.service.heap import keep_flat
from chatter_monitor.service.journal import Story
from chatter_monitor.service.monitor import Monitor, warm_up
from chatter_monitor.service.recorder import open_recorder
from chatter_monitor.service.status import Status, StatusLine
from chatter_monitor.service.systemd import Notifier

LINGER_MS = 500  # of the publisher: the whole stop takes less than 2 s
STATUS_S = 1.0
LIVE = ("verdict", "spindle")  # tables that change without a restart

_log = logging.getLogger(__name__)


class _Notes:
    """What signals leave for the worker."""

    def __init__(self) -> None:
        self.reload = False
        self.stop: Callable[[], None] | None = None  # once there is something to stop

    def on_stop(self, number: int, _frame: FrameType | None) -> None:
        """Let the source end; before it has begun, end at once."""
        _log.info("stopping on %s", signal.Signals(number).name)
        if self.stop is None:
            os._exit(0)  # nothing is at stake yet, and an exception would get lost in the compiler's callbacks
        self.stop()

    def on_reload(self, _number: int, _frame: FrameType | None) -> None:
        """Have the configuration read again between two blocks."""
        self.reload = True

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Take the signals."""
        handlers = {signal.SIGTERM: self.on_stop, signal.SIGINT: self.on_stop, signal.SIGHUP: self.on_reload}
        before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


class Daemon:
    """Listens to a sound device until it is told to stop.

    Parameters
    ----------
    configs : sequence of Path
        Machine configuration, read now and again on SIGHUP.
    notifier : Notifier
        The service manager.
    console : Console
        Where the status line goes if it is a terminal.
    opener : Opener, optional
        Devices; PortAudio's by default.
    witnesses : sequence of Outlet
        Further outlets, which the caller opens and closes.

    Raises
    ------
    InputError
        If the configuration is wrong.
    """

    def __init__(
        self,
        configs: Sequence[Path],
        *,
        notifier: Notifier,
        console: Console,
        opener: Opener | None = None,
        witnesses: Sequence[Outlet] = (),
    ) -> None:
        self._configs = configs
        self._settings = load(configs)
        self._notifier = notifier
        self._console = console
        self._witnesses = witnesses
        self._opener = opener or PortAudio(self._settings.input, self._settings.tracker.sample_rate_hz)
        self._notes = _Notes()

    def run(self) -> None:
        """Listen; returns after SIGTERM or SIGINT.

        Raises
        ------
        EnvironmentFault
            If a socket cannot be bound.
        InputError
            If a certificate cannot be used.
        """
        keep_flat()
        settings = self._settings
        rate_hz = settings.tracker.sample_rate_hz
        clock = IndexClock(rate_hz)
        with self._notes.listening(), ExitStack() as stack:
            publisher = stack.enter_context(
                Publisher(settings.publish, clock=clock, machine=settings.machine.name, linger_ms=LINGER_MS)
            )
            control = self._control(stack)
            card = SoundCard(settings.input, rate_hz, opener=self._opener, index_clock=clock)
            status = Status(lambda: card.device)
            outlets: list[Outlet] = [publisher, status, Story(), *self._witnesses]
            outlets += [control] if control is not None else []
            if settings.metrics.bind is not None:
                machine = settings.machine.name
                outlets.append(
                    stack.enter_context(Metrics(settings.metrics.bind, machine=machine, clock=time.monotonic))
                )
            _log.info("publishing at %s%s", publisher.endpoint, f", control at {control.endpoint}" if control else "")
            store = EventWriter(Path(settings.recorder.directory), settings.recorder.quota_gb * 1e9)
            source_rate_hz = settings.input.sample_rate_hz or rate_hz
            outlets.append(
                stack.enter_context(
                    open_recorder(settings, store, card.channels, source_rate_hz, utc_of=clock.utc_of, patient=False)
                )
            )
            if (first := what_takes_long()) is not None:
                self._say(first)
            warm_up(settings, source_rate_hz)
            monitor = Monitor(
                settings,
                card,
                outlets,
                counts=card,
                source_rate_hz=source_rate_hz,
                session=datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ"),
                clock=time.monotonic,
                dropped=lambda: publisher.dropped,
                commands=lambda: () if control is None else control.commands(),
            )
            gc.freeze()  # the compiled kernels are no garbage, and looking through them would take a second
            stack.enter_context(card)
            self._notes.stop = card.stop
            self._say(f"waiting for {card.device}")
            self._follow(monitor, card, status, stack)
            self._notifier.stopping("Stopping: the last messages and recordings are on their way.")
        _log.info("stopped")

    def _follow(self, monitor: Monitor, card: SoundCard, status: Status, stack: ExitStack) -> None:
        """Work, and between two blocks tell the service manager how it goes."""
        line = stack.enter_context(StatusLine(status, self._console))
        ready = False
        fed_s = told_s = -float("inf")
        fodder_s = (self._notifier.watchdog_s or float("inf")) / 4
        for _ in monitor.run():
            now_s = time.monotonic()
            line.refresh()
            if self._notes.reload:
                self._notes.reload = False
                self._reload(monitor, ready=ready)
            if not ready and card.deaf_s == 0.0:
                ready = True
                self._notifier.ready(status.sentence())
            # Progress is what the watchdog wants to see: samples, or for a while attempts to get some.
            if card.deaf_s > self._settings.input.give_up_s:
                if fed_s > 0.0 and fodder_s < float("inf"):
                    _log.error("giving up: the service manager may start the daemon anew")
                fed_s = -float("inf")
            elif now_s - fed_s >= fodder_s:
                fed_s = now_s
                self._notifier.watchdog()
            if now_s - told_s >= STATUS_S:
                told_s = now_s
                self._notifier.status(status.sentence())

    def _control(self, stack: ExitStack) -> Control | None:
        endpoint = self._settings.control.bind
        if endpoint is None:
            return None
        control = Control(endpoint, machine=self._settings.machine.name, spindle=self._settings.spindle)
        return stack.enter_context(control)

    def _say(self, text: str) -> None:
        _log.info("%s", text)
        self._notifier.status(text[0].upper() + text[1:] + ".")

    def _reload(self, monitor: Monitor, *, ready: bool) -> None:
        """Read the configuration again; the old one stays if there is anything wrong with it."""
        self._notifier.reloading(time.monotonic_ns() // 1000)
        try:
            new = load(self._configs)
        except ChatterMonitorError as error:
            monitor.trouble = f"the configuration was not read again: {error}"
            _log.error("the old configuration stays: %s", error)
        else:
            monitor.trouble = None
            old, self._settings = self._settings, new
            # The control socket may have set another speed since; only a new one in the file replaces it.
            monitor.reconfigure(new.verdict, new.spindle if new.spindle != old.spindle else None)
            changed = [t for t in new.__struct_fields__ if getattr(new, t) != getattr(old, t)]
            waiting = [f"[{table}]" for table in changed if table not in LIVE]
            _log.info("configuration read again; changed: %s", ", ".join(f"[{t}]" for t in changed) or "nothing")
            if waiting:
                monitor.trouble = f"{', '.join(waiting)} of the configuration changed, which needs a restart"
                _log.warning("%s", monitor.trouble)
        if ready:
            self._notifier.ready()


def run_daemon(configs: Sequence[Path], environment: Mapping[str, str]) -> None:
    """Run the daemon with this process's service manager and terminal."""
    with Notifier.from_environment(environment, os.getpid()) as notifier:
        Daemon(configs, notifier=notifier, console=Console()).run()
    gc.freeze()  # the interpreter would look for garbage among the compiled kernels, which takes a second, and then end
