"""A subscriber as a user would run it, in a process of its own.

``subscriber_process.py ENDPOINT REPORT`` receives until a frame says that a million samples were lost (no real one
does), and writes what came as JSON: ``received`` ([topic, seq, digest] each), ``lost``, ``restarts``, ``malformed``.
"""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path

import msgspec

from chatter_monitor.client import Subscriber
from chatter_monitor.outlets.wire import PAYLOAD_DTYPES
from chatter_monitor.records import Event, Health, OdpFrame, Verdict

LAST = 1_000_000


def digest(body: OdpFrame | Verdict | Event | Health) -> str:
    """Fingerprint of every bit of a body."""
    if not isinstance(body, OdpFrame):
        return hashlib.sha256(msgspec.json.encode(body)).hexdigest()
    about = (body.channel, body.first_sample, body.sample_rate_hz, body.rms, body.lost, body.flags.value)
    arrays = b"".join(getattr(body, name).tobytes() for name in PAYLOAD_DTYPES) + body.share.tobytes()
    return hashlib.sha256(repr(about).encode() + arrays).hexdigest()


def main() -> None:
    """Receive and report."""
    endpoint, report = sys.argv[1:]
    received = []
    with Subscriber(endpoint) as subscriber:
        for message in subscriber:
            received.append([message.topic, message.header.seq, digest(message.body)])
            if isinstance(message.body, OdpFrame) and message.body.lost == LAST:
                break
        outcome = {
            "received": received,
            "lost": subscriber.lost,
            "restarts": subscriber.restarts,
            "malformed": subscriber.malformed,
        }
    Path(report).write_text(json.dumps(outcome))


if __name__ == "__main__":
    main()
