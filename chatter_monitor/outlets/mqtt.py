"""A machine on an MQTT broker: its messages as JSON, whether it is there, and what is kept while the broker is away."""

from __future__ import annotations

import re
import ssl
import stat
import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import msgspec

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.address import host_and_port, is_loopback
from chatter_monitor.outlets.wire import Header, encode, topic_of
from chatter_monitor.records import Announcement

if TYPE_CHECKING:
    from paho.mqtt.client import Client, ConnectFlags, DisconnectFlags, MQTTMessageInfo
    from paho.mqtt.properties import Properties
    from paho.mqtt.reasoncodes import ReasonCode

PORT, TLS_PORT = 1883, 8883
KEEPALIVE_S = 15
AT_LEAST_ONCE = 1
CLOSING_S = 5.0
OFFLINE: dict[str, object] = {"online": False}
# What trying again does not mend.
REFUSALS = (
    "Not authorized",
    "Bad user name or password",
    "Client identifier not valid",
    "Unsupported protocol version",
)


@dataclass(frozen=True)
class Broker:
    """Which broker, and who we are to it.

    Attributes
    ----------
    address : str
        Host, or host and port.
    prefix : str
        First levels of all topics.
    buffer : int
        Messages kept while the broker is away.
    username : str or None
        Name to log in with.
    password_file : Path or None
        File whose first line is the password; nobody but its owner may read it.
    tls : bool
        Whether to encrypt, and to ask the broker for a certificate.
    ca, certificate, key : Path or None
        Who signed the broker's certificate, if not one of those that the system trusts; our own, with its key.

    Raises
    ------
    InputError
        If the address is none, files do not fit together, or a password would cross the network readable.
    """

    address: str
    prefix: str
    buffer: int
    username: str | None = None
    password_file: Path | None = None
    tls: bool = False
    ca: Path | None = None
    certificate: Path | None = None
    key: Path | None = None

    def __post_init__(self) -> None:
        host, _ = self.place()
        if set(self.prefix) & set("+#\0") or self.prefix.strip("/") != self.prefix or not self.prefix:
            raise InputError(
                "this is no prefix of MQTT topics", got=self.prefix, allowed="such as plant/chatter, without + and #"
            )
        if (self.ca or self.certificate) and not self.tls:
            raise InputError("certificates are of no use without TLS", remedy="Say --tls as well.")
        if (self.certificate is None) != (self.key is None):
            raise InputError("a certificate and its key go together, and one of them is missing")
        if self.password_file is not None and self.username is None:
            raise InputError("a password is of no use without a user's name", remedy="Say --username as well.")
        if self.password_file is not None and not self.tls and not is_loopback(host):
            raise InputError(
                "a password would cross the network readable",
                got=self.address,
                remedy="Say --tls, or use a broker on this machine.",
            )

    def place(self) -> tuple[str, int]:
        """Host and port."""
        host, port = host_and_port(self.address) or ("", 0)
        if port == 0:
            raise InputError("this is no address of a broker", got=self.address, allowed=f"such as 10.0.0.5:{PORT}")
        return host, port or (TLS_PORT if self.tls else PORT)

    def password(self) -> str | None:
        """Password out of its file.

        Raises
        ------
        InputError
            If the file cannot be read, or others than its owner can.
        """
        file = self.password_file
        if file is None:
            return None
        try:
            mode = file.stat().st_mode
            password = file.read_text(encoding="utf-8").partition("\n")[0]
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"the password cannot be read: {error}", got=str(file)) from error
        if mode & 0o077:
            raise InputError(
                "others can read the password",
                got=f"{file} with mode {stat.S_IMODE(mode):04o}",
                allowed="0600 or less",
                remedy=f"chmod 600 {file}",
            )
        return password


class MqttLink:
    """Connection of one machine to a broker; it is made, and made again, in the background.

    Below ``<prefix>/<machine>``, ``verdict/<channel>``, ``event`` and ``health`` carry the messages of the public
    contract as JSON, with the header's ``utc``, ``machine`` and ``session``, and ``number``, which counts the messages
    of a topic from 0 on. ``state`` is retained: ``{"online": true, ...}`` while the monitor is heard; when the
    connection breaks off, the broker itself says ``{"online": false}``.

    Messages are acknowledged by the broker (quality of service 1). While it is away they wait in memory; what no longer
    fits is dropped, newest first, and counted.

    Parameters
    ----------
    broker : Broker
        Where to connect.
    machine : str
        Name of the machine.
    say : callable
        Told in a line when the broker comes and goes.

    Attributes
    ----------
    dropped : int
        Messages that did not fit into the buffer.
    refused : str or None
        Why the broker does not let us in, once it has said so.

    Raises
    ------
    InputError
        If password or certificates cannot be used.
    EnvironmentFault
        If paho-mqtt is not installed.
    """

    def __init__(self, broker: Broker, machine: str, say: Callable[[str], None]) -> None:
        self.dropped = 0
        self.refused: str | None = None
        self._address = broker.address
        self._root = f"{broker.prefix}/{re.sub('[+#]', '_', machine)}"
        self._say = say
        self._away = False
        self._numbers: Counter[str] = Counter()
        self._waiting: deque[MQTTMessageInfo] = deque()
        self._state: dict[str, object] = dict(OFFLINE)
        self._client = _client(broker)
        self._client.will_set(f"{self._root}/state", msgspec.json.encode(OFFLINE), AT_LEAST_ONCE, retain=True)
        self._client.on_connect = self._connected
        self._client.on_disconnect = self._disconnected
        self._client.on_connect_fail = lambda *_: self._lacks("cannot be reached, or its certificate is not trusted")
        self._client.connect_async(*broker.place(), keepalive=KEEPALIVE_S)
        self._client.loop_start()

    @property
    def waiting(self) -> int:
        """Messages that the broker has not acknowledged yet."""
        self._forget_acknowledged()
        return len(self._waiting)

    def send(self, header: Header, message: Announcement) -> None:
        """Send a message, now or when the broker is back."""
        from paho.mqtt.enums import MQTTErrorCode

        topic = topic_of(message).replace(".", "/")
        body = payload(header, message, self._numbers[topic])
        self._numbers[topic] += 1
        sent = self._client.publish(f"{self._root}/{topic}", body, AT_LEAST_ONCE)
        if sent.rc is MQTTErrorCode.MQTT_ERR_QUEUE_SIZE:
            self.dropped += 1
            return
        sent.rc = MQTTErrorCode.MQTT_ERR_SUCCESS  # paho takes no connection for a failure, though it keeps the message
        self._waiting.append(sent)
        self._forget_acknowledged()

    def _forget_acknowledged(self) -> None:
        while self._waiting and self._waiting[0].is_published():
            self._waiting.popleft()

    def tell(self, *, online: bool, lost: int = 0) -> None:
        """Tell whether the monitor is heard, and how much was lost, if that is news."""
        state: dict[str, object] = {"online": online, "lost": lost, "dropped": self.dropped}
        if state != self._state:
            self._state = state
            if self._client.is_connected():
                self._tell()

    def close(self, patience_s: float = CLOSING_S) -> None:
        """Wait a little for what is on its way, say that we leave, and leave."""
        deadline = time.monotonic() + patience_s
        while self.waiting and self._client.is_connected() and time.monotonic() < deadline:
            time.sleep(0.01)
        if self._client.is_connected():
            farewell = self._client.publish(
                f"{self._root}/state", msgspec.json.encode(OFFLINE), AT_LEAST_ONCE, retain=True
            )
            with suppress(RuntimeError, ValueError):  # the broker goes just now, and says it in our place
                farewell.wait_for_publish(max(0.1, deadline - time.monotonic()))
        self._client.disconnect()
        self._client.loop_stop()
        if self.waiting:
            self._say(f"{self.waiting} messages were never acknowledged by the broker")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _tell(self) -> None:
        # It does not wait in the buffer, or it would arrive when it is no longer true: who connects tells it anew.
        self._client.publish(f"{self._root}/state", msgspec.json.encode(self._state), qos=0, retain=True)

    def _connected(
        self, _client: Client, _data: object, _flags: ConnectFlags, reason: ReasonCode, _properties: Properties | None
    ) -> None:
        if reason.is_failure:
            if reason.getName() in REFUSALS:
                self.refused = reason.getName()
            self._lacks(f"does not let us in: {reason.getName()}")
            return
        self._say(f"connected to the broker at {self._address}, as {self._root}")
        self._away = False
        self._tell()

    def _disconnected(
        self,
        _client: Client,
        _data: object,
        _flags: DisconnectFlags,
        reason: ReasonCode,
        _properties: Properties | None,
    ) -> None:
        if reason.is_failure and self.refused is None:
            self._lacks("is gone")

    def _lacks(self, what: str) -> None:
        if not self._away:
            self._away = True
            self._say(f"the broker at {self._address} {what}; messages wait for it")


def payload(header: Header, message: Announcement, number: int) -> bytes:
    """JSON of a message on a topic of which it has that number."""
    about = {"utc": header.utc, "machine": header.machine, "session": header.session, "number": number}
    return msgspec.json.encode(about | msgspec.json.decode(encode(message)))


def _client(broker: Broker) -> Client:
    """Client of the broker, not connected yet."""
    try:
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion
    except ImportError as error:
        raise EnvironmentFault(
            "paho-mqtt is not installed", remedy="Install it: pip install 'chatter-monitor[plant]'"
        ) from error
    # The name is the broker's to give: two of the same would throw each other out.
    client = Client(CallbackAPIVersion.VERSION2, client_id="", clean_session=True)
    client.max_queued_messages_set(broker.buffer)
    client.reconnect_delay_set(1, 30)
    if broker.username is not None:
        client.username_pw_set(broker.username, broker.password())
    if broker.tls:
        ca, certificate, key = (str(file) if file else None for file in (broker.ca, broker.certificate, broker.key))
        try:
            client.tls_set(ca, certificate, key)
        except (OSError, ssl.SSLError) as error:
            got = ", ".join(filter(None, (ca, certificate, key)))
            raise InputError(f"certificates cannot be used: {error}", got=got) from error
    return client
