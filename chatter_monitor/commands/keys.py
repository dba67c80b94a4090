"""Certificates of encrypted connections."""

from __future__ import annotations

from pathlib import Path

import click

from chatter_monitor.commands.options import DEBUG, JSON, print_json

ALLOWED = "allowed"  # subdirectory of the certificates' directory
KEYS_DIRECTORY = click.option(
    "--directory",
    type=click.Path(path_type=Path),
    default=Path("~/.config/chatter-monitor/keys"),
    show_default=True,
    callback=lambda _context, _option, path: path.expanduser().absolute(),
    help="Where the certificates are; the allow-list is its subdirectory `allowed`.",
)


@click.group()
def keys() -> None:
    """CURVE certificates: who the monitor is, and who may listen to it from other machines."""


@keys.command("new")
@click.argument("name")
@KEYS_DIRECTORY
@JSON
@DEBUG
def new_key(name: str, directory: Path, as_json: bool) -> None:
    """Make a certificate: NAME.key to give away, NAME.key_secret to keep."""
    from chatter_monitor.outlets.certificates import new_pair

    public, secret = new_pair(directory, name)
    if as_json:
        print_json({"public": str(public), "secret": str(secret)})
        return
    click.echo(f"{public}: public; give it to the other side.")
    click.echo(f"{secret}: secret; readable by you only.")
    click.echo(
        f"For a monitor: [publish] server_key = {str(secret)!r}, and `chatter-monitor keys allow` for its clients."
    )
    click.echo("For a client: have its public certificate allowed where the monitor runs.")


@keys.command("allow")
@click.argument("file", type=click.Path(path_type=Path))
@KEYS_DIRECTORY
@JSON
@DEBUG
def allow_key(file: Path, directory: Path, as_json: bool) -> None:
    """Let a client listen: put FILE, its public certificate, on the allow-list."""
    from chatter_monitor.outlets.certificates import allow

    path = allow(file, directory / ALLOWED)
    if as_json:
        print_json({"allowed": str(path)})
        return
    click.echo(f"{path}: allowed as soon as it connects; remove the file to refuse it again.")
    click.echo(f"For the monitor: [publish] allowed_clients = {str(path.parent)!r}")


@keys.command("list")
@KEYS_DIRECTORY
@JSON
@DEBUG
def list_keys(directory: Path, as_json: bool) -> None:
    """List the certificates made here and the clients that are allowed, with their public keys."""
    from chatter_monitor.outlets.certificates import public_keys

    found = {"own": public_keys(directory), "allowed": public_keys(directory / ALLOWED)}
    if as_json:
        print_json(found)
        return
    for kind, certificates in found.items():
        for name, key in certificates.items():
            click.echo(f"{kind:<8} {name:<20} {key}")
    if not any(found.values()):
        click.echo(f"No certificates in {directory}; `chatter-monitor keys new NAME` makes one.")
