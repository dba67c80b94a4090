"""The files that `make install-service` lays out."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import msgspec
import pytest

from chatter_monitor.config import Settings, load

ROOT = Path(__file__).resolve().parents[1]
CONFIG = "etc/chatter-monitor/machine.toml"


def lay_out(folder):
    """What a package maker does; needs no root."""
    subprocess.run(["make", "--silent", "install-service", f"DESTDIR={folder}"], cwd=ROOT, check=True)


def test_files_go_where_the_unit_expects_them(tmp_path):
    """Every file that the unit names lies in its place, or is what installing on the machine itself makes."""
    lay_out(tmp_path)
    unit = (tmp_path / "etc/systemd/system/chatter-monitor.service").read_text()
    config = re.search(r"^ExecStart=\S+ run --config (\S+)$", unit, re.MULTILINE)
    document = re.search(r"^Documentation=file:(\S+)$", unit, re.MULTILINE)
    assert config is not None
    assert document is not None
    assert (tmp_path / config[1][1:]).read_text() == (ROOT / "config/machine.toml").read_text()
    assert (tmp_path / document[1][1:]).read_text() == (ROOT / "docs/service.md").read_text()


def test_an_edited_configuration_stays(tmp_path):
    """Laying out again leaves an edited configuration alone and renews the example beside it."""
    lay_out(tmp_path)
    (tmp_path / CONFIG).write_text("[machine]\nname = 'mine'\n")
    (tmp_path / (CONFIG + ".example")).write_text("old")
    lay_out(tmp_path)
    assert (tmp_path / CONFIG).read_text() == "[machine]\nname = 'mine'\n"
    assert (tmp_path / (CONFIG + ".example")).read_text() == (ROOT / "config/machine.toml").read_text()


@pytest.fixture
def written_out(tmp_path):
    """The installed configuration with its commented lines switched on, but for those about other computers."""
    text = (ROOT / "config/machine.toml").read_text()
    alone = re.sub(r"# For other computers.*?\n\n", "\n", text, flags=re.DOTALL)
    path = tmp_path / "machine.toml"
    path.write_text(re.sub(r"^#(\w+ = )", r"\1", alone, flags=re.MULTILINE))
    return path


def test_the_installed_configuration_tells_the_defaults(written_out):
    """As it stands it holds the defaults; its commented lines are known keys, with the defaults where there are any."""
    assert load([ROOT / "config/machine.toml"]) == Settings()
    settings, default = load([written_out]), Settings()
    for table in ("machine", "publish", "recorder"):
        assert getattr(settings, table) == getattr(default, table)
    about_device = {"channels": None, "sample_rate_hz": None}
    assert msgspec.structs.replace(settings.input, **about_device) == default.input
    assert settings.metrics.bind == "127.0.0.1:9464"
    assert settings.control.bind == "ipc:///run/chatter-monitor/control"
