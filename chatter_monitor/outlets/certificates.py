"""CURVE certificates in files: who the monitor is, and who may listen to it.

A certificate is a pair of files in the format of czmq and pyzmq: ``NAME.key`` with the public key, to be given away,
and ``NAME.key_secret`` with both, to be read by its owner only. An allow-list is a directory of public certificates.
"""

from __future__ import annotations

import os
import re
import stat
import struct
from dataclasses import dataclass, field
from pathlib import Path

import zmq
from zmq.utils import z85

from chatter_monitor.errors import InputError

PUBLIC_SUFFIX, SECRET_SUFFIX = ".key", ".key_secret"
FORMAT = "a CURVE certificate as `chatter-monitor keys new` writes it"

_LONGEST_FILE = 65536


@dataclass(frozen=True, slots=True)
class KeyPair:
    """Public and secret key in Z85, the encoding of the files."""

    public: bytes
    secret: bytes = field(repr=False)


def new_pair(directory: Path, name: str) -> tuple[Path, Path]:
    """Make a certificate; returns its public file and its secret file.

    The directory is made if need be, for its owner only; the secret file is never readable by others.

    Raises
    ------
    InputError
        If the name is no file name, a certificate of this name exists, or the directory cannot be written.
    """
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}", name):
        raise InputError(
            "this is no name for a certificate", got=name, allowed="letters, digits, '-', '_' and '.', a letter first"
        )
    public_file, secret_file = directory / (name + PUBLIC_SUFFIX), directory / (name + SECRET_SUFFIX)
    for path in (public_file, secret_file):
        if path.exists():
            raise InputError(
                "a certificate of this name exists and is not replaced",
                got=str(path),
                remedy="Take another name, or remove both of its files if nobody uses it any more.",
            )
    public, secret = zmq.curve_keypair()
    _make_directory(directory)
    _write(secret_file, _text("secret", public, secret), mode=0o600)
    _write(public_file, _text("public", public), mode=0o644)
    return public_file, secret_file


def allow(certificate: Path, allowed_clients: Path) -> Path:
    """Put the public certificate of a client on the allow-list; returns its file there.

    Raises
    ------
    InputError
        If the file is no public certificate, another client of the same name is on the list, or it cannot be written.
    """
    public = read_public(certificate)
    path = allowed_clients / (certificate.stem + PUBLIC_SUFFIX)
    if path.exists():
        if read_public(path) == public:
            return path
        raise InputError(
            "another client of this name is on the allow-list", got=str(path), remedy="Rename the new certificate."
        )
    _make_directory(allowed_clients.parent)
    _make_directory(allowed_clients)
    _write(path, _text("public", public), mode=0o644)
    return path


def read_public(path: Path) -> bytes:
    """Public key of a public certificate, in Z85.

    Raises
    ------
    InputError
        If the file cannot be read, or is no public certificate.
    """
    _, text = _read(path)
    if b"secret-key" in text:
        raise InputError(
            "this certificate is secret, and does not belong here",
            got=str(path),
            allowed=f"the public certificate beside it, NAME{PUBLIC_SUFFIX}",
        )
    return _key(path, text, "public-key")


def read_secret(path: Path) -> KeyPair:
    """Both keys of a secret certificate.

    Raises
    ------
    InputError
        If the file cannot be read, is no secret certificate, or may be read by others than its owner.
    """
    mode, text = _read(path)
    if mode & 0o077:
        raise InputError(
            "others can read this secret certificate",
            got=f"{path} with mode {stat.S_IMODE(mode):04o}",
            allowed="0600 or less",
            remedy=f"If nobody else had access so far, `chmod 600 {path}`; else make a new one: "
            "`chatter-monitor keys new NAME`.",
        )
    secret = _key(path, text, "secret-key")
    return KeyPair(zmq.curve_public(secret), secret)


def client_files(allowed_clients: Path) -> list[Path]:
    """Public certificates on an allow-list, in order of their names.

    Raises
    ------
    InputError
        If the directory cannot be read, or could be written by others.
    """
    try:
        mode = allowed_clients.stat().st_mode
        files = sorted(path for path in allowed_clients.iterdir() if path.suffix == PUBLIC_SUFFIX)
    except OSError as error:
        raise InputError(
            f"the allow-list cannot be read: {error.strerror}",
            got=str(allowed_clients),
            allowed="a directory of public certificates",
            remedy="`chatter-monitor keys allow FILE` makes it.",
        ) from error
    if mode & 0o022:
        raise InputError(
            "others can write to the allow-list",
            got=f"{allowed_clients} with mode {stat.S_IMODE(mode):04o}",
            allowed="0755 or less",
            remedy=f"Look through its files, then `chmod 700 {allowed_clients}`.",
        )
    return files


def public_keys(directory: Path) -> dict[str, str]:
    """Public keys of a directory by the names of their certificates; empty if there is no such directory.

    Raises
    ------
    InputError
        If a public certificate in it cannot be read.
    """
    files = sorted(directory.glob("*" + PUBLIC_SUFFIX))
    return {path.stem: read_public(path).decode() for path in files}


def _make_directory(directory: Path) -> None:
    """Make a directory for its owner only; one that exists is left as it is."""
    try:
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the directory cannot be made: {error.strerror}", got=str(directory)) from error


def _write(path: Path, text: str, *, mode: int) -> None:
    """Write a new file which from its first moment on is readable as `mode` says."""
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(descriptor, "w", encoding="ascii") as file:
            file.write(text)
    except OSError as error:
        raise InputError(f"the certificate cannot be written: {error.strerror}", got=str(path)) from error


def _text(kind: str, public: bytes, secret: bytes | None = None) -> str:
    lines = [
        f"#   ZeroMQ CURVE {kind} certificate, made by chatter-monitor",
        "metadata",
        "curve",
        f'    public-key = "{public.decode()}"',
    ]
    if secret is not None:
        lines[1:1] = ["#   Nobody but its owner may read this file."]
        lines.append(f'    secret-key = "{secret.decode()}"')
    return "\n".join(lines) + "\n"


def _read(path: Path) -> tuple[int, bytes]:
    """Mode and content of a certificate file."""
    try:
        with path.open("rb") as file:
            return os.fstat(file.fileno()).st_mode, file.read(_LONGEST_FILE)
    except OSError as error:
        raise InputError(f"the certificate cannot be read: {error.strerror}", got=str(path), allowed=FORMAT) from error


def _key(path: Path, text: bytes, name: str) -> bytes:
    """One key in the text of a certificate; the text itself never gets into an error."""
    found = re.search(rb'^\s*%b\s*=\s*"([!-~]{40})"\s*$' % name.encode(), text, re.MULTILINE)
    try:
        if found is not None:
            z85.decode(found[1])
            return found[1]
    except (KeyError, struct.error):
        pass
    raise InputError(f"there is no {name} in this file", got=str(path), allowed=FORMAT)
