"""Debian trees to boot and to build images from, made once and kept in the user's cache."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RELEASE = "bookworm"


def run(*command: str | Path, timeout_s: float = 600, **options: object) -> str:
    """Run a program to its end; its output stands in the error if it fails."""
    done = subprocess.run(
        list(map(str, command)),
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=timeout_s,
        **options,
    )
    if done.returncode:
        raise AssertionError(f"{' '.join(map(str, command))} ended with {done.returncode}:\n{done.stdout[-4000:]}")
    return done.stdout


def base() -> Path:
    """A minimal Debian tree, to be copied."""

    def make(tree: Path) -> None:
        sources = run("apt-get", "indextargets", "--format", "$(REPO_URI)").split()
        mirror = [uri for uri in sources if "security" not in uri][:1]  # where this machine has its packages from
        run("debootstrap", "--variant=minbase", RELEASE, tree, *mirror, timeout_s=1200)
        for package in (tree / "var/cache/apt/archives").glob("*.deb"):
            package.unlink()

    return _kept(f"debian-{RELEASE}", make)


def with_packages(*packages: str) -> Path:
    """A Debian tree with these packages, to be copied."""

    def make(tree: Path) -> None:
        copy(base(), tree)
        install = f"apt-get update -q && apt-get install -y -q --no-install-recommends {' '.join(packages)}"
        inside(tree, "sh", "-c", install, environment={"DEBIAN_FRONTEND": "noninteractive"})

    return _kept("-".join(["debian", RELEASE, _digest(*packages)]), make)


def wheels() -> Path:
    """Everything that the program depends on, in the versions of constraints.txt, as for a machine without internet."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    about = [*project["dependencies"], (ROOT / "constraints.txt").read_text()]

    def make(directory: Path) -> None:
        pip = (sys.executable, "-m", "pip", "wheel", "-q", "--disable-pip-version-check")
        run(*pip, "-c", ROOT / "constraints.txt", "-w", directory, ROOT, "setuptools>=77", timeout_s=1200)
        for wheel in directory.glob("chatter_monitor-*"):
            wheel.unlink()  # installed from the source, which changes

    return _kept(f"wheels-{_digest(*about)}", make)


def put_source(tree: Path) -> Path:
    """Copy the project's files into a tree; returns their place in it."""
    place = Path("/usr/src/chatter-monitor")
    made = shutil.ignore_patterns(".*", "__pycache__", "build", "out", "*.egg-info")
    shutil.copytree(ROOT, tree / place.relative_to("/"), ignore=made, dirs_exist_ok=True)
    return place


def copy(tree: Path, target: Path) -> None:
    """Copy a tree with owners, modes and links, sharing blocks where the file system can."""
    run("cp", "--archive", "--reflink=auto", "--no-target-directory", tree, target)


def inside(
    tree: Path, *command: str, environment: dict[str, str] | None = None, read_only: tuple[Path, ...] = ()
) -> str:
    """Run a command in a tree that is not booted, with the network of this machine."""
    options = [f"--setenv={key}={value}" for key, value in (environment or {}).items()]
    options += [f"--bind-ro={path}" for path in read_only]
    nspawn = ("systemd-nspawn", "-q", "-D", tree, "--register=no", "--keep-unit", "--resolv-conf=copy-host", "--pipe")
    return run(*nspawn, *options, "--", *command, timeout_s=1200)


def _digest(*texts: str) -> str:
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:12]


def _kept(name: str, make: Callable[[Path], None]) -> Path:
    """Directory of that name in the cache; made if it is not there, by one process at a time, and never half."""
    directory = cache() / name
    with _lock(directory):
        if not directory.exists():
            part = directory.with_name(directory.name + ".part")
            shutil.rmtree(part, ignore_errors=True)
            part.mkdir()
            make(part)
            part.rename(directory)
    return directory


def cache() -> Path:
    """Where trees and wheels are kept between runs."""
    directory = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "chatter-monitor-tests"
    directory.mkdir(parents=True, exist_ok=True)
    return directory


@contextmanager
def _lock(directory: Path) -> Iterator[None]:
    with directory.with_name(directory.name + ".lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
