"""Bridges into a plant's network."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from chatter_monitor.commands.options import CONFIG, DEBUG

if TYPE_CHECKING:
    from chatter_monitor.client import Subscriber


CONNECT = click.option("--connect", "endpoint", metavar="ENDPOINT", help="Where a monitor publishes.")
SERVER_KEY = click.option(
    "--server-public-key", type=click.Path(path_type=Path), help="Certificate of a monitor that encrypts."
)
CLIENT_KEY = click.option("--client-secret-key", type=click.Path(path_type=Path), help="Own secret certificate for it.")
EVERY = click.option(
    "--every",
    "every_s",
    type=click.FloatRange(min=0),
    default=1.0,
    show_default=True,
    metavar="SECONDS",
    help="How often to tell a state that stays the same; 0 for every message.",
)


@click.group()
def bridge() -> None:
    """Carry what a monitor publishes into a plant's network, in a process of its own."""


@bridge.command("mqtt")
@click.option("--broker", "address", required=True, metavar="HOST[:PORT]", help="Where to send it.")
@click.option("--prefix", default="chatter-monitor", show_default=True, help="First levels of all topics.")
@click.option("--username", help="Name to log in with.")
@click.option("--password-file", type=click.Path(path_type=Path), help="File with the password, readable by you only.")
@click.option("--tls", is_flag=True, help="Encrypt, and ask the broker for its certificate.")
@click.option("--ca", type=click.Path(path_type=Path), help="Who signed it; those that the system trusts by default.")
@click.option("--cert", "certificate", type=click.Path(path_type=Path), help="Own certificate, if the broker asks.")
@click.option("--key", type=click.Path(path_type=Path), help="Its secret key.")
@click.option(
    "--buffer",
    type=click.IntRange(min=1),
    default=10_000,  # more than an hour of one channel's verdicts and health; about 10 MB
    show_default=True,
    help="Messages kept while the broker is away.",
)
@EVERY
@CONNECT
@SERVER_KEY
@CLIENT_KEY
@CONFIG
@DEBUG
def bridge_to_mqtt(
    address: str,
    prefix: str,
    username: str | None,
    password_file: Path | None,
    tls: bool,
    ca: Path | None,
    certificate: Path | None,
    key: Path | None,
    buffer: int,
    every_s: float,
    endpoint: str | None,
    server_public_key: Path | None,
    client_secret_key: Path | None,
    configs: tuple[Path, ...],
) -> None:
    """Send verdicts, events and health to an MQTT broker, as JSON.

    Needs paho-mqtt: pip install 'chatter-monitor[plant]'.
    """
    from chatter_monitor.outlets.mqtt import Broker
    from chatter_monitor.service.bridging import bridge_mqtt

    broker = Broker(address, prefix, buffer, username, password_file, tls, ca, certificate, key)
    with _subscriber(endpoint, configs, server_public_key, client_secret_key) as monitor:
        bridge_mqtt(monitor, broker, every_s, lambda line: click.echo(line, err=True))


@bridge.command("mtconnect")
@click.option("--bind", default="127.0.0.1:7878", show_default=True, help="Where MTConnect agents connect.")
@EVERY
@CONNECT
@SERVER_KEY
@CLIENT_KEY
@CONFIG
@DEBUG
def bridge_to_mtconnect(
    bind: str,
    every_s: float,
    endpoint: str | None,
    server_public_key: Path | None,
    client_secret_key: Path | None,
    configs: tuple[Path, ...],
) -> None:
    """Answer MTConnect agents: an adapter that speaks SHDR."""
    from chatter_monitor.service.bridging import bridge_mtconnect

    with _subscriber(endpoint, configs, server_public_key, client_secret_key) as monitor:
        bridge_mtconnect(monitor, bind, every_s, lambda line: click.echo(line, err=True))


def _subscriber(
    endpoint: str | None, configs: tuple[Path, ...], server_public_key: Path | None, client_secret_key: Path | None
) -> Subscriber:
    from chatter_monitor.client import Subscriber
    from chatter_monitor.service.bridging import TOPICS

    if endpoint is None:
        from chatter_monitor.config import load

        endpoint = load(configs).publish.bind
    return Subscriber(endpoint, TOPICS, server_public_key=server_public_key, client_secret_key=client_secret_key)
