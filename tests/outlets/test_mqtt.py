"""Which brokers are refused before anybody connects. The rest meets a real one in tests/system/test_mqtt.py."""

from __future__ import annotations

import pytest

from chatter_monitor.errors import InputError
from chatter_monitor.outlets.mqtt import Broker, MqttLink

USUAL = {"prefix": "chatter-monitor", "buffer": 10}


@pytest.mark.parametrize(
    ("address", "tls", "place"),
    [
        ("mqtt.plant", False, ("mqtt.plant", 1883)),
        ("mqtt.plant", True, ("mqtt.plant", 8883)),
        ("10.0.0.5:1884", True, ("10.0.0.5", 1884)),
        ("[::1]:1883", False, ("::1", 1883)),
    ],
)
def test_addresses(address, tls, place):
    """Host, and port if it is not the usual one."""
    assert Broker(address, tls=tls, **USUAL).place() == place


@pytest.mark.parametrize("address", ["", "host:0", "host:65536", "tcp://host:1883", "host:1883/x", "a b"])
def test_no_addresses(address):
    """What is no address is the user's input."""
    with pytest.raises(InputError, match="no address of a broker"):
        Broker(address, **USUAL)


@pytest.mark.parametrize("prefix", ["", "plant/#", "+/x", "/plant", "plant/"])
def test_no_prefixes(prefix):
    """Wildcards and empty levels are refused."""
    with pytest.raises(InputError, match="no prefix"):
        Broker("localhost", prefix=prefix, buffer=1)


def test_things_that_belong_together(tmp_path):
    """A password needs a name and, over the network, TLS; a certificate needs its key and TLS."""
    file = tmp_path / "file"
    for wrong, reason in (
        ({"password_file": file}, "user's name"),
        ({"ca": file}, "without TLS"),
        ({"certificate": file, "tls": True}, "go together"),
    ):
        with pytest.raises(InputError, match=reason):
            Broker("localhost", **wrong, **USUAL)
    login = {"username": "me", "password_file": file}
    with pytest.raises(InputError, match="cross the network readable"):
        Broker("mqtt.plant", **login, **USUAL)
    Broker("mqtt.plant", tls=True, **login, **USUAL)
    Broker("localhost", **login, **USUAL)


def test_password_files(tmp_path):
    """The password is the file's first line; a file that others can read, or nobody, is refused."""
    file = tmp_path / "password"
    broker = Broker("localhost", username="me", password_file=file, **USUAL)
    with pytest.raises(InputError, match="cannot be read"):
        broker.password()
    file.write_text("sesame\nopen\n")
    file.chmod(0o640)
    with pytest.raises(InputError, match="others can read"):
        broker.password()
    file.chmod(0o600)
    assert broker.password() == "sesame"


def test_certificates_that_are_none(tmp_path):
    """A file that holds no certificate is the user's input."""
    (tmp_path / "ca.pem").write_text("nothing")
    with pytest.raises(InputError, match="certificates cannot be used"):
        MqttLink(Broker("localhost", tls=True, ca=tmp_path / "ca.pem", **USUAL), "lathe-3", print)
