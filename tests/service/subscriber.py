"""A subscriber in a process of its own: ``subscriber.py ENDPOINT REPORT`` receives until the monitor has finished.

The report, a numpy archive, holds the ODP arrays of channel 0 as they came, and ``about``: JSON with the sequence
numbers by topic, the JSON bodies of the other topics, and what the client counted as lost.
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict

import msgspec
import numpy as np

from chatter_monitor.client import Subscriber
from chatter_monitor.records import Health, OdpFrame

ARRAYS = ("frequency_hz", "damping_ratio", "frequency_sd_hz", "damping_sd", "status")


def main() -> None:
    """Receive and report."""
    endpoint, report = sys.argv[1:]
    seqs, bodies, arrays = defaultdict(list), [], defaultdict(list)
    with Subscriber(endpoint) as subscriber:
        for message in subscriber:
            body = message.body
            seqs[message.topic].append(message.header.seq)
            if not isinstance(body, OdpFrame):
                bodies.append(msgspec.to_builtins(body))
            elif body.channel == 0:
                arrays["sample"].append(body.first_sample + np.arange(len(body)))
                for name in ARRAYS:
                    arrays[name].append(getattr(body, name))
            if isinstance(body, Health) and body.state == "finished":
                break
        about = {"seqs": seqs, "bodies": bodies, "lost": sum(subscriber.lost.values()), "bad": subscriber.malformed}
    columns = {name: np.concatenate(parts) for name, parts in arrays.items()}
    np.savez(report, about=json.dumps(about), **columns)


if __name__ == "__main__":
    main()
