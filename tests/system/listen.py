"""A subscriber inside the machine: ``listen.py SECONDS STATE [SERVER_KEY CLIENT_KEY]`` prints what came as JSON.

It says "listening" with the first verdict, and stops early when one of that state has come. ``states`` are those of the
verdicts in their order, ``first_s`` says how long the first took, ``frequency_hz`` belongs to the last.
"""

from __future__ import annotations

import json
import sys
import time

from chatter_monitor.client import Subscriber


def main() -> None:
    """Receive and report."""
    seconds, state, *files = sys.argv[1:]
    keys = dict(zip(("server_public_key", "client_secret_key"), files, strict=False))
    began = time.monotonic()
    states, first_s, frequency_hz = [], None, None
    with Subscriber(topics=["verdict"], **keys) as subscriber:
        while (left_s := began + float(seconds) - time.monotonic()) > 0:
            received = subscriber.receive(left_s)
            if received is None:
                break
            if first_s is None:
                first_s = time.monotonic() - began
                sys.stdout.write("listening\n")
                sys.stdout.flush()
            states.append(received.body.state)
            frequency_hz = received.body.frequency_hz
            if received.body.state == state:
                break
        about = {"states": states, "first_s": first_s, "frequency_hz": frequency_hz, "lost": subscriber.lost}
        sys.stdout.write(json.dumps(about) + "\n")


if __name__ == "__main__":
    main()
