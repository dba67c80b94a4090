"""ZeroMQ endpoints: which ones there are, who can reach them, and binding a socket to one."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import zmq

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.address import is_loopback

ALLOWED_LOOPBACK = "tcp:// on 127.0.0.0/8, localhost or [::1] with a port (0: any free one), or ipc:// with a path"


def is_local(endpoint: str) -> bool:
    """Whether only this machine can reach the endpoint.

    Raises
    ------
    InputError
        If it is no endpoint to bind to.
    """
    if re.fullmatch(r"ipc://[^\s*]+", endpoint):
        return True
    tcp = re.fullmatch(r"tcp://(?:\[(?P<ipv6>[^\[\]]+)\]|(?P<host>[^\s:;\[\]]+)):(?P<port>\*|\d{1,5})", endpoint)
    if tcp is None or (tcp["port"] != "*" and int(tcp["port"]) > 65535):
        raise InputError("this is no endpoint to bind to", got=endpoint, allowed=ALLOWED_LOOPBACK)
    return is_loopback(tcp["ipv6"] or tcp["host"])


def bind(socket: zmq.Socket[Any], endpoint: str, *, setting: str) -> str:
    """Bind a socket; returns the endpoint with the port that was found if 0 was asked for.

    Parameters
    ----------
    socket : zmq.Socket
        The socket; it stays the caller's to close.
    endpoint : str
        Where to bind. The path of ``ipc://`` is taken over from an earlier socket.
    setting : str
        Where the user chose the endpoint, for the error: ``[publish] bind``.

    Raises
    ------
    EnvironmentFault
        If the endpoint cannot be bound, such as a port in use.
    InputError
        If the path of an ``ipc://`` endpoint is a file of another kind, which binding would replace.
    """
    if endpoint.startswith("ipc://"):
        path = Path(endpoint.removeprefix("ipc://"))
        if path.exists() and not path.is_socket():
            raise InputError(f"the path of {setting} is taken by a file that is not a socket", got=str(path))
    socket.ipv6 = "[" in endpoint
    try:
        socket.bind(endpoint)
    except zmq.ZMQError as error:
        raise EnvironmentFault(
            f"cannot bind: {zmq.strerror(error.errno or 0)}",
            got=endpoint,
            remedy=f"Another program may hold the port; choose another one with {setting}.",
        ) from error
    return str(socket.getsockopt_string(zmq.LAST_ENDPOINT))
