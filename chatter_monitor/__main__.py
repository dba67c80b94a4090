"""Entry point of the console script: runs the command line and turns errors into one or two lines."""

from __future__ import annotations

import os
import sys

import click

from chatter_monitor.cli import cli
from chatter_monitor.errors import ChatterMonitorError


def main() -> None:
    """Run the command line; exit codes: 0 done, 2 wrong input, 3 environment fault, 1 a bug."""
    # Matrices here are small. Threads of OpenBLAS, which waits busily for more, would take as much as all the rest.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        cli(prog_name="chatter-monitor", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(2)
    except click.ClickException as error:
        print(f"chatter-monitor: {error.format_message()} Try --help.", file=sys.stderr)  # noqa: T201
        sys.exit(2)
    except click.Abort:
        sys.exit(130)
    except ChatterMonitorError as error:
        if "--debug" in sys.argv:
            raise
        print(f"chatter-monitor: {error}", file=sys.stderr)  # noqa: T201
        sys.exit(error.exit_code)
    except Exception as error:
        if "--debug" in sys.argv:
            raise
        print(  # noqa: T201
            f"chatter-monitor: this is a bug: {type(error).__name__}: {error}\n"
            "Run the same command with --debug and report what it prints.",
            file=sys.stderr,
        )
        sys.exit(1)


if __name__ == "__main__":
    main()
