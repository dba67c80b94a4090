"""Encryption and the allow-list: who receives what is published, and who does not."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest
import zmq
from zmq.utils.monitor import recv_monitor_message

from chatter_monitor.client import Subscriber
from chatter_monitor.errors import InputError
from chatter_monitor.outlets.certificates import allow, client_files, new_pair, read_public, read_secret
from chatter_monitor.outlets.publisher import Publisher, PublishSettings

WAIT_S = 200.0

# What a client sees of its own handshake being refused: an answer, or a connection that is closed on it.
REFUSAL = (
    zmq.EVENT_HANDSHAKE_FAILED_AUTH
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    | zmq.EVENT_DISCONNECTED
)


class Pair(NamedTuple):
    """Files of a certificate."""

    public: Path
    secret: Path


@pytest.fixture
def make_pair(tmp_path):
    """Make a certificate in a directory of its own."""

    def make(name: str) -> Pair:
        return Pair(*new_pair(tmp_path / "keys", name))

    return make


@pytest.fixture
def server(make_pair) -> Pair:
    """The certificate of the monitor."""
    return make_pair("server")


@pytest.fixture
def alice(make_pair, allow_list) -> Pair:
    """The certificate of a client that is allowed."""
    pair = make_pair("alice")
    allow(pair.public, allow_list)
    return pair


@pytest.fixture
def mallory(make_pair) -> Pair:
    """The certificate of somebody who is not."""
    return make_pair("mallory")


@pytest.fixture
def allow_list(tmp_path) -> Path:
    """The directory of allowed clients."""
    path = tmp_path / "allowed"
    path.mkdir(mode=0o700)
    return path


@pytest.fixture
def publish(server, allow_list, clock):
    """Open a publisher that encrypts."""

    def open_publisher(bind: str = "tcp://127.0.0.1:0") -> Publisher:
        settings = PublishSettings(bind=bind, server_key=str(server.secret), allowed_clients=str(allow_list))
        return Publisher(settings, clock=clock, machine="lathe-3")

    return open_publisher


@contextmanager
def intruder(endpoint: str, server_public: bytes | None = None, own: Pair | None = None) -> Iterator[zmq.Socket[bytes]]:
    """Subscribe to everything and wait until the publisher has refused the connection."""
    with zmq.Context() as context, context.socket(zmq.SUB) as socket:
        socket.linger = 0
        socket.subscribe("")
        if server_public is not None and own is not None:
            keys = read_secret(own.secret)
            socket.curve_serverkey = server_public
            socket.curve_publickey, socket.curve_secretkey = keys.public, keys.secret
        events = socket.get_monitor_socket()
        socket.connect(endpoint)
        seen = 0
        deadline = time.monotonic() + WAIT_S
        while not seen & REFUSAL and events.poll(max(0, int((deadline - time.monotonic()) * 1000))):
            seen |= recv_monitor_message(events)["event"]
        assert seen & REFUSAL
        assert not seen & zmq.EVENT_HANDSHAKE_SUCCEEDED
        yield socket
        socket.disable_monitor()
        events.close()


def receives_nothing(publisher: Publisher, refused: zmq.Socket[bytes], allowed: Subscriber, messages) -> bool:
    """Publish until an allowed subscriber has everything; tell whether the other one has nothing of it."""
    assert publisher.wait_for_subscriber(WAIT_S)
    for message in messages:
        publisher.message(message)
        assert allowed.receive(WAIT_S).body == message
    return not refused.poll(50)


def test_an_allowed_client_receives(publish, server, alice, messages, make_interval):
    """With both certificates a subscriber receives everything, bit by bit."""
    frame, odp = make_interval()
    with (
        publish() as publisher,
        Subscriber(publisher.endpoint, server_public_key=server.public, client_secret_key=str(alice.secret)) as client,
    ):
        assert publisher.wait_for_subscriber(WAIT_S)
        publisher.frame(frame, odp)
        publisher.digest()
        assert client.receive(WAIT_S).body.damping_ratio.tobytes() == frame.damping_ratio.tobytes()
        for message in messages:
            publisher.message(message)
            assert client.receive(WAIT_S).body == message


@pytest.mark.parametrize("who", ["unknown key", "wrong server key", "plain"])
def test_nobody_else_receives(publish, server, alice, mallory, messages, who):
    """An unknown key, an allowed key with the wrong server's, and a client without keys are refused and get nothing."""
    credentials = {
        "unknown key": (read_public(server.public), mallory),
        "wrong server key": (read_public(mallory.public), alice),
        "plain": (),
    }[who]
    with publish() as publisher, intruder(publisher.endpoint, *credentials) as refused:
        assert not publisher.wait_for_subscriber(0.0)
        with Subscriber(publisher.endpoint, server_public_key=server.public, client_secret_key=alice.secret) as allowed:
            assert receives_nothing(publisher, refused, allowed, messages)


def test_an_encrypting_client_takes_nothing_from_a_plain_publisher(publisher, server, alice, messages):
    """Who asks for encryption is not served by somebody without the server's certificate."""
    with Subscriber(publisher.endpoint, server_public_key=server.public, client_secret_key=alice.secret) as client:
        assert not publisher.wait_for_subscriber(0.3)
        publisher.message(messages[0])
        assert client.receive(0.05) is None


def test_the_list_holds_for_the_next_connection(publish, server, mallory, allow_list):
    """Who is put on the list gets in without a restart of the monitor, and who is taken off it no longer does."""
    certificates = {"server_public_key": server.public, "client_secret_key": mallory.secret}
    with publish() as publisher:
        with intruder(publisher.endpoint, read_public(server.public), mallory):
            listed = allow(mallory.public, allow_list)
        with Subscriber(publisher.endpoint, **certificates):
            assert publisher.wait_for_subscriber(WAIT_S)
        listed.unlink()
        with intruder(publisher.endpoint, read_public(server.public), mallory):
            pass


def test_a_broken_certificate_keeps_no_other_client_out(publish, server, alice, allow_list):
    """While the monitor runs, a file that is no certificate allows nobody and disturbs nobody."""
    with publish() as publisher:
        (allow_list / "aaron.key").write_text("not a certificate")
        with Subscriber(publisher.endpoint, server_public_key=server.public, client_secret_key=alice.secret):
            assert publisher.wait_for_subscriber(WAIT_S)


def test_a_list_that_others_can_change_allows_nobody(publish, server, alice, allow_list):
    """While the list is writable by others, even who is on it is refused."""
    with publish() as publisher:
        allow_list.chmod(0o777)
        with intruder(publisher.endpoint, read_public(server.public), alice):
            pass


def test_without_the_authenticator_nobody_gets_in(publish, server, mallory):
    """Should the authenticator end, the socket is shut, not open to everybody who has the server's public key."""
    with publish() as publisher:
        publisher._guard.close()  # there is no way to make it end from outside
        with intruder(publisher.endpoint, read_public(server.public), mallory):
            pass


def test_all_interfaces_with_certificates(publish, server, alice, messages):
    """With certificates the monitor binds beyond loopback."""
    with publish("tcp://0.0.0.0:0") as publisher:
        endpoint = f"tcp://127.0.0.1:{publisher.endpoint.rpartition(':')[2]}"
        with Subscriber(endpoint, server_public_key=server.public, client_secret_key=alice.secret) as client:
            assert publisher.wait_for_subscriber(WAIT_S)
            publisher.message(messages[0])
            assert client.receive(WAIT_S).body == messages[0]


@pytest.mark.parametrize("given", ["server_key", "allowed_clients"])
@pytest.mark.parametrize("bind", ["tcp://0.0.0.0:5557", "tcp://127.0.0.1:5557"])
def test_one_certificate_without_the_other_is_refused(given, bind):
    """Encryption without an allow-list, or the other way round, is a mistake wherever it binds."""
    with pytest.raises(InputError, match=r"go together.*keys new server.*keys allow"):
        PublishSettings(bind=bind, **{given: "somewhere"})


@pytest.mark.parametrize("given", ["server_public_key", "client_secret_key"])
def test_a_client_needs_both_certificates(given, alice):
    """One certificate alone is an error, instead of a connection that never comes."""
    with pytest.raises(InputError, match="go together"):
        Subscriber(**{given: alice.secret})


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o644, 0o601])
def test_a_secret_that_others_can_read_is_refused(publish, server, alice, mode):
    """Neither monitor nor client uses a secret certificate that is not its owner's alone, and says what to do."""
    server.secret.chmod(mode)
    with pytest.raises(InputError, match=rf"others can read.*{mode:04o}.*chmod 600") as caught:
        publish()
    assert str(server.secret) in str(caught.value)
    alice.secret.chmod(mode)
    with pytest.raises(InputError, match="others can read"):
        Subscriber(server_public_key=server.public, client_secret_key=alice.secret)


def test_a_list_that_others_can_change_is_refused_at_the_start(publish, allow_list):
    """A directory that others can write to is no allow-list."""
    allow_list.chmod(0o770)
    with pytest.raises(InputError, match=r"others can write.*0770.*chmod 700"):
        publish()


def test_a_list_that_is_broken_is_refused_at_the_start(publish, allow_list):
    """A file on the list that is no certificate is named when the monitor starts; so is a list that is missing."""
    (allow_list / "alice.key").write_text("not a certificate")
    with pytest.raises(InputError, match=r"no public-key in this file.*alice\.key"):
        publish()
    (allow_list / "alice.key").unlink()
    allow_list.rmdir()
    with pytest.raises(InputError, match=r"allow-list cannot be read: No such file.*keys allow FILE"):
        publish()


def test_the_port_is_free_after_a_certificate_was_refused(publish, server):
    """A publisher that could not be opened leaves nothing behind: the next one opens on the same port."""
    with publish() as publisher:
        endpoint = publisher.endpoint
    server.secret.chmod(0o644)
    with pytest.raises(InputError):
        publish(endpoint)
    server.secret.chmod(0o600)
    with publish(endpoint) as publisher:
        assert publisher.endpoint == endpoint


@pytest.mark.parametrize(
    "text",
    [
        "",
        "secret-key = short",
        '    secret-key = "0123"',
        '    public-key = "' + "0" * 40 + '"',
        '    secret-key = "' + "~" * 40 + '"',  # no letters of Z85
        '    secret-key = "' + "#" * 40 + '"',  # more than 32 bits
    ],
)
def test_what_is_no_secret_certificate(tmp_path, text):
    """A file without a secret key in it is the user's error, and its content is not in the message."""
    path = tmp_path / "server.key_secret"
    path.touch(mode=0o600)
    path.write_text(text)
    with pytest.raises(InputError, match="no secret-key in this file") as caught:
        read_secret(path)
    assert "0000" not in str(caught.value)


def test_a_secret_certificate_is_not_taken_for_a_public_one(server, allow_list):
    """Where a public certificate belongs a secret one is refused, instead of being spread."""
    for wrong in (read_public, lambda path: allow(path, allow_list)):
        with pytest.raises(InputError, match=r"secret, and does not belong here.*NAME\.key"):
            wrong(server.secret)
    assert client_files(allow_list) == []


def test_files_of_pyzmq_are_read(tmp_path):
    """Certificates made by pyzmq's own function work, once the secret one is closed to others."""
    public, secret = zmq.auth.create_certificates(tmp_path, "other")
    os.chmod(secret, 0o600)
    keys = read_secret(Path(secret))
    assert keys.public == read_public(Path(public))
    assert (keys.public, keys.secret) == zmq.auth.load_certificate(secret)


def test_files_are_read_by_pyzmq(server):
    """Certificates made here are read by pyzmq, and so by others that use its format."""
    keys = read_secret(server.secret)
    assert zmq.auth.load_certificate(server.secret) == (keys.public, keys.secret)
    assert zmq.auth.load_certificate(server.public) == (keys.public, None)


def test_no_secret_is_logged_or_shown(publish, server, alice, mallory, caplog):
    """Whatever is logged, even by the libraries and at the finest level, has no secret key in it, nor has a repr."""
    with caplog.at_level(logging.DEBUG), publish() as publisher:
        with intruder(publisher.endpoint, read_public(server.public), mallory):
            pass
        with Subscriber(publisher.endpoint, server_public_key=server.public, client_secret_key=alice.secret):
            assert publisher.wait_for_subscriber(WAIT_S)
    assert caplog.text
    for pair in (server, alice, mallory):
        keys = read_secret(pair.secret)
        assert keys.secret.decode() not in caplog.text + repr(keys)
