"""Addresses of the network: a host and a port, and whether they mean this machine only."""

from __future__ import annotations

import ipaddress
import re

_ADDRESS = re.compile(r"(?:\[(?P<ipv6>[^\[\]]+)\]|(?P<host>[^\s:/\[\]]+))(?::(?P<port>\d{1,5}))?")


def host_and_port(address: str) -> tuple[str, int | None] | None:
    """Host, of IPv6 without its brackets, and port, None where there is none; None if this is no address."""
    parts = _ADDRESS.fullmatch(address)
    if parts is None:
        return None
    port = None if parts["port"] is None else int(parts["port"])
    return (parts["ipv6"] or parts["host"], port) if port is None or port < 65536 else None


def is_loopback(host: str) -> bool:
    """Whether a host name or address means this machine only; names but localhost may mean anything."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
