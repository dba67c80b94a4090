"""The command line: which commands there are. What one needs is imported when it runs, so that ``--help`` is quick."""

from __future__ import annotations

import click

from chatter_monitor.commands.bridging import bridge
from chatter_monitor.commands.diagnosing import diagnose, prove
from chatter_monitor.commands.events import events
from chatter_monitor.commands.keys import keys
from chatter_monitor.commands.modelling import identify, simulate
from chatter_monitor.commands.monitoring import devices, doctor, replay, run
from chatter_monitor.commands.showing import dashboard


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="chatter-monitor")
def cli() -> None:
    """Listen to a machine tool: operational damping and frequency, and whether it chatters."""


for command in (replay, run, devices, doctor, simulate, identify, diagnose, prove, dashboard, bridge, events, keys):
    cli.add_command(command)
