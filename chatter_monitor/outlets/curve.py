"""Encryption of a server's socket, and an allow-list of who may connect to it (CURVE and ZAP)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import zmq
from zmq.auth.thread import ThreadAuthenticator

from chatter_monitor.errors import InputError
from chatter_monitor.outlets.certificates import client_files, read_public, read_secret

# Named on the socket and in the authenticator: the authenticator's "*" would not stand for it.
ZAP_DOMAIN = "chatter-monitor"


class Guard:
    """Encrypts the sockets of a context, and lets only clients of an allow-list in.

    The allow-list is read whenever a client connects: a client that is added needs no restart of the monitor, and one
    that is taken away is refused when it connects again. A thread of the guard's own answers these questions, so that
    whoever owns the sockets is not held up.

    Parameters
    ----------
    context : zmq.Context
        Of the sockets to protect; there is one guard for a context.
    server_key : Path
        The server's secret certificate.
    allowed_clients : Path
        Directory of the clients' public certificates.

    Raises
    ------
    InputError
        If a certificate cannot be used, or others could read the secret or change the list.
    """

    def __init__(self, context: zmq.Context[Any], *, server_key: Path, allowed_clients: Path) -> None:
        self._keys = read_secret(server_key)
        for path in client_files(allowed_clients):
            read_public(path)  # what is wrong with the list is an error now, not silence later
        self._authenticator = ThreadAuthenticator(context)
        self._authenticator.configure_curve_callback(ZAP_DOMAIN, _AllowList(allowed_clients))
        self._authenticator.start()

    def protect(self, socket: zmq.Socket[Any]) -> None:
        """Make a socket a CURVE server; to be called before it is bound."""
        socket.curve_server = True
        socket.curve_secretkey = self._keys.secret
        socket.setsockopt_string(zmq.ZAP_DOMAIN, ZAP_DOMAIN)
        # Without this ZeroMQ lets everybody in who has the server's public key when nobody answers for the domain.
        socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)

    def close(self) -> None:
        """Stop answering: from now on nobody gets in. A second call does nothing."""
        self._authenticator.stop()


class _AllowList:
    """What the authenticator asks."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory

    def callback(self, domain: str, key: bytes) -> bool:  # noqa: ARG002 - the authenticator's interface
        """Whether the client with this public key may connect."""
        try:
            return any(self._holds(path, key) for path in client_files(self._directory))
        except InputError:
            return False

    def _holds(self, path: Path, key: bytes) -> bool:
        """Whether this is the client's certificate; a broken one is nobody's, and keeps no other client out."""
        try:
            return read_public(path) == key
        except InputError:
            return False
