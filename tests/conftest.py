"""Fixtures that tests of several parts share."""

from __future__ import annotations

import sys

import pytest

from chatter_monitor.__main__ import main


@pytest.fixture
def run(monkeypatch, capfd):
    """Run the command line in this process; returns exit code, standard output and standard error."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["chatter-monitor", *map(str, arguments)])
        try:
            main()
            code = 0
        except SystemExit as leaving:
            code = leaving.code
        return code, *capfd.readouterr()

    return run
