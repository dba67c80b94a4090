"""The control socket: programs on this machine set the spindle, mark a moment, ask for the status.

``docs/control.md`` describes requests and replies; a test holds the two together.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from queue import Empty, Full, Queue
from typing import Annotated, Literal

import msgspec
import zmq

from chatter_monitor.errors import ChatterMonitorError, InputError
from chatter_monitor.outlets.endpoint import ALLOWED_LOOPBACK, bind, is_local
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.outlets.token_bucket import TokenBucket
from chatter_monitor.outlets.wire import encode
from chatter_monitor.records import Announcement, Health, Odp, OdpFrame, Verdict
from chatter_monitor.tracking.spindle import SpindleSettings

DELIMITER = b""  # between a peer's envelope and its request, which REQ puts there
LONGEST_REQUEST = 4096  # bytes
LONGEST_FRAME = 65536  # bytes; ZeroMQ closes the connection on more, before it takes up memory

# A controller that follows the spindle ten times a second has room to spare.
REQUESTS_HZ = 20.0
BURST = 40
# How long a refused peer is kept waiting, so that a flood of requests does not take the interpreter from the worker.
REST_S = 0.05

WAITING_REQUESTS = 16  # in ZeroMQ, for each peer
WAITING_COMMANDS = 16  # that the worker has not taken yet
LINGER_MS = 100  # for the last reply


class ControlSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The control socket, see docs/control.md: the table ``[control]`` of a machine configuration.

    Attributes
    ----------
    bind : str or None
        ZeroMQ endpoint that only this machine can reach; None for no control socket.
    """

    bind: str | None = None

    def __post_init__(self) -> None:
        if self.bind is not None and not is_local(self.bind):
            raise InputError(
                "the control socket is refused on the network, because everybody there could use it",
                got=self.bind,
                allowed=ALLOWED_LOOPBACK,
            )


class SetSpindle(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="command", tag="set_spindle"):
    """The spindle turns at another speed (None: nobody knows), or has another tool."""

    rpm: Annotated[float, msgspec.Meta(gt=0, le=1e6)] | None
    teeth: Annotated[int, msgspec.Meta(ge=1, le=1000)]


class Mark(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="command", tag="mark"):
    """Something worth remembering happens now."""

    text: Annotated[str, msgspec.Meta(min_length=1, max_length=200)]

    def __post_init__(self) -> None:
        if not self.text.isprintable():  # it goes to logs and terminals
            raise ValueError("Expected printable characters only")


class AskStatus(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="command", tag="status"):
    """Asks how it is going."""


Command = SetSpindle | Mark


class Done(msgspec.Struct, frozen=True):
    """Reply to a command that will take effect with the next block."""

    ok: Literal[True] = True


class Refused(msgspec.Struct, frozen=True, kw_only=True):
    """Reply to a request that changes nothing."""

    ok: Literal[False] = False
    error: str


class Spindle(msgspec.Struct, frozen=True):
    """What the judges take the spindle for."""

    rpm: float | None
    teeth: int


class Status(msgspec.Struct, frozen=True):
    """The monitor at this moment: the spindle, the last verdict of each channel, the last health message."""

    machine: str
    spindle: Spindle
    verdicts: tuple[Verdict, ...] = ()
    health: Health | None = None


class StatusReply(msgspec.Struct, frozen=True, kw_only=True):
    """Reply to `AskStatus`."""

    ok: Literal[True] = True
    status: Status


Reply = Done | Refused | StatusReply

TOO_MANY = Refused(error=f"too many requests, allowed: {REQUESTS_HZ:g} a second")

_DECODER = msgspec.json.Decoder(SetSpindle | Mark | AskStatus)


class Control(Outlet):
    """Answers requests in a thread of its own, and hands commands to the worker thread, which owns what they change.

    The worker opens and closes the object, tells it as an outlet what there is to report, and takes the commands when
    it sees fit; it never waits. The thread owns the socket. Between the two there are a bounded queue of commands and a
    status that is replaced as a whole, never changed.

    Parameters
    ----------
    endpoint : str
        Where to answer.
    machine : str
        Name of the machine.
    spindle : SpindleSettings
        What the judges take the spindle for at the start.
    clock : callable
        Seconds on a steady clock, for the limit on requests.

    Attributes
    ----------
    endpoint : str
        Where it is bound, with the port that was found if 0 was asked for.

    Raises
    ------
    EnvironmentFault
        If the endpoint cannot be bound, such as a port in use.
    InputError
        If the path of an ``ipc://`` endpoint is a file of another kind.
    """

    def __init__(
        self, endpoint: str, *, machine: str, spindle: SpindleSettings, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._commands: Queue[Command] = Queue(WAITING_COMMANDS)
        self._status = Status(machine, Spindle(spindle.speed_rpm, spindle.teeth))
        self._verdicts: dict[int, Verdict] = {}
        self._limit = TokenBucket(REQUESTS_HZ, BURST, clock)
        self._context = zmq.Context()
        # Not REP, which (libzmq 4.3.5) takes the next peer's reply for one that broke the protocol and has gone.
        self._socket = self._context.socket(zmq.ROUTER)
        self._socket.linger = LINGER_MS
        self._socket.maxmsgsize = LONGEST_FRAME
        self._socket.rcvhwm = WAITING_REQUESTS
        try:
            self.endpoint = bind(self._socket, endpoint, setting="[control] bind")
        except ChatterMonitorError:
            self._socket.close()
            self._context.term()
            raise
        self._thread = threading.Thread(target=self._serve, name="control", daemon=True)
        self._thread.start()

    def commands(self) -> Iterator[Command]:
        """Take the commands that have come since the last time, in order. For the worker thread."""
        while True:
            try:
                yield self._commands.get_nowait()
            except Empty:
                return

    def spindle(self, spindle: SpindleSettings) -> None:
        """Keep for the status what the judges take the spindle for from now on."""
        self._status = msgspec.structs.replace(self._status, spindle=Spindle(spindle.speed_rpm, spindle.teeth))

    def frame(self, frame: OdpFrame, odp: Odp) -> None:
        """Nothing of a frame is in the status but its verdict."""

    def message(self, message: Announcement) -> None:
        """Keep the message for the status."""
        match message:
            case Verdict():
                self._verdicts[message.channel] = message
                verdicts = tuple(self._verdicts[channel] for channel in sorted(self._verdicts))
                self._status = msgspec.structs.replace(self._status, verdicts=verdicts)
            case Health():
                self._status = msgspec.structs.replace(self._status, health=message)

    def close(self) -> None:
        """Stop answering and free the port."""
        self._context.term()  # wakes the thread, and waits until it has closed the socket
        self._thread.join()

    def _serve(self) -> None:
        """Body of the thread: one reply to every request, whatever it is, to the peer that it came from."""
        try:
            while True:
                peer, *frames = self._socket.recv_multipart()
                in_time = self._limit.take()
                if not in_time:
                    time.sleep(REST_S)
                if DELIMITER not in frames:  # such a peer waits for no reply
                    continue
                start = frames.index(DELIMITER) + 1
                reply = self._answer(frames[start:]) if in_time else TOO_MANY
                self._socket.send_multipart([peer, *frames[:start], encode(reply)])
        except zmq.ContextTerminated:
            pass
        finally:
            self._socket.close()

    def _answer(self, frames: list[bytes]) -> Reply:
        if len(frames) != 1 or len(frames[0]) > LONGEST_REQUEST:
            return Refused(error=f"a request is one frame of at most {LONGEST_REQUEST} bytes")
        try:
            request = _DECODER.decode(frames[0])
        except RecursionError:
            return Refused(error="nested too deeply")
        except ValueError as error:  # of msgspec and of UTF-8
            return Refused(error=str(error))
        if isinstance(request, AskStatus):
            return StatusReply(status=self._status)
        try:
            self._commands.put_nowait(request)
        except Full:
            return Refused(error="the monitor has not taken the commands before this one yet; try again")
        return Done()
