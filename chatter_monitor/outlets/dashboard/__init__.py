"""The live view in rerun. It runs in a process of its own; nothing else in the project imports rerun."""

from chatter_monitor.errors import EnvironmentFault

try:
    import rerun as rerun
except ImportError as error:
    raise EnvironmentFault(
        "the dashboard needs rerun, which is not installed",
        remedy="pip install 'chatter-monitor[dashboard]' (about 500 MB).",
    ) from error
