"""The monitor's state for Prometheus, at ``http://<bind>/metrics``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.metadata import version
from typing import get_args, get_type_hints

import msgspec
from prometheus_client import CollectorRegistry, ProcessCollector, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.registry import Collector

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.address import host_and_port, is_loopback
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Announcement, Block, Event, Health, Odp, OdpFrame, State, Verdict

ALLOWED = "127.0.0.0/8, localhost or [::1] with a port (0: any free one), such as 127.0.0.1:9464"

# Counters of the health message: name without _total, field, help.
COUNTERS = (
    ("samples", "samples_in", "Samples that went through the tracker, of each channel."),
    ("lost_samples", "lost", "Samples that the input delivered and nobody heard, or never delivered."),
    ("overflows", "overflows", "Times that the input said it had lost samples."),
    ("clipped_samples", "clipped", "Samples at full scale, over all channels."),
    ("non_finite_samples", "non_finite", "Samples that were not a number, over all channels."),
    ("dropped_publications", "publications_dropped", "Times that a subscriber's queue was full."),
)

# Gauges of each channel's verdict: name with unit, field, factor to that unit, help. Absent while there is no value.
GAUGES = (
    ("frequency_hertz", "frequency_hz", 1.0, "Frequency that the verdict is about."),
    ("damping_ratio", "damping_ratio", 1.0, "Damping ratio at that frequency; chatter is at zero or below."),
    (
        "margin_ratio",
        "margin_percent",
        0.01,
        "Change of the depth of cut to the limit of stability; below zero: beyond.",
    ),
    ("confidence_ratio", "confidence", 1.0, "How sure the verdict is, 0 to 1."),
    ("chatter_probability_ratio", "chatter_probability", 1.0, "How likely it chatters, whatever the verdict, 0 to 1."),
)

HEALTH_STATES = get_args(get_type_hints(Health)["state"])


class MetricsSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Numbers for Prometheus, see docs/service.md: the table ``[metrics]`` of a machine configuration.

    Attributes
    ----------
    bind : str or None
        Host and port to answer Prometheus on, this machine only; None for no metrics.

    Raises
    ------
    InputError
        If it is malformed, or reachable from the network.
    """

    bind: str | None = None

    def __post_init__(self) -> None:
        if self.bind is None:
            return
        host, _ = _address(self.bind)
        if not is_loopback(host):
            raise InputError(
                "[metrics] bind is refused on the network, because everybody there could read what the machine does",
                got=self.bind,
                allowed=ALLOWED,
                remedy="Let Prometheus or its agent on this machine collect it, or a proxy that asks who is there.",
            )


class Metrics(Outlet):
    """Answers Prometheus with the newest messages.

    The worker only replaces references; the text is made by the thread that was asked, out of messages that never
    change. So nobody who asks can hold up the worker.

    Parameters
    ----------
    bind : str
        Host and port, see `MetricsSettings`.
    machine : str
        Name of the machine.
    clock : callable
        Seconds on a steady clock, for the age of the newest samples.

    Attributes
    ----------
    url : str
        Where the metrics are, with the port that was found if 0 was asked for.

    Raises
    ------
    EnvironmentFault
        If the port cannot be bound.
    """

    def __init__(self, bind: str, *, machine: str, clock: Callable[[], float]) -> None:
        self._snapshot = _Snapshot(machine, clock)
        registry = CollectorRegistry(auto_describe=False)
        registry.register(self._snapshot)
        ProcessCollector(registry=registry)  # memory and processor time of the process, under their usual names
        host, port = _address(bind)
        try:
            self._server, self._thread = start_http_server(port, host, registry)
        except OSError as error:
            raise EnvironmentFault(
                f"cannot answer Prometheus: {error.strerror}",
                got=bind,
                remedy="Another program may hold the port; choose another one with [metrics] bind.",
            ) from error
        self.url = f"http://{bind.rpartition(':')[0]}:{self._server.server_port}/metrics"

    def block(self, block: Block) -> None:
        """Take note that samples have come; a block that tells of a loss may have none."""
        if len(block.samples):
            self._snapshot.heard()

    def frame(self, frame: OdpFrame, odp: Odp) -> None:
        """Nothing: 20 values a second are for ZeroMQ."""

    def message(self, message: Announcement) -> None:
        """Take the newest message of its kind."""
        self._snapshot.take(message)

    def close(self) -> None:
        """Answer no more; a second call does nothing."""
        if self._thread.is_alive():
            self._server.shutdown()
            self._thread.join()
        self._server.server_close()


class _Snapshot(Collector):
    """The newest messages, and how they read in Prometheus. One thread writes, any thread may collect."""

    def __init__(self, machine: str, clock: Callable[[], float]) -> None:
        self._machine = machine
        self._clock = clock
        self._heard_s: float | None = None
        self._health: Health | None = None
        self._verdicts: dict[int, Verdict] = {}
        self._events: Counter[tuple[int, str]] = Counter()

    def heard(self) -> None:
        self._heard_s = self._clock()

    def take(self, message: Announcement) -> None:
        match message:
            case Verdict():
                self._verdicts[message.channel] = message
            case Event():
                self._events[message.channel, message.kind] += 1
            case Health():
                self._health = message

    def collect(self) -> Iterator[Metric]:
        """Metrics at this moment."""
        about = {"version": version("chatter-monitor"), "machine": self._machine}
        yield InfoMetricFamily("chatter_monitor", "The program and its machine.", value=about)
        yield from self._liveness()
        yield from self._verdict_metrics()

    def _liveness(self) -> Iterator[Metric]:
        """How well it hears. `Health.state` and the age of the samples: the two to set an alert on."""
        if self._heard_s is not None:
            yield GaugeMetricFamily(
                _name("last_sample_age_seconds"),
                "Time since samples last came from the input.",
                value=self._clock() - self._heard_s,
            )
        health = self._health
        if health is None:
            return
        yield _state("health_state", "What the monitor is doing.", HEALTH_STATES, [], {(): health.state})
        for name, field, text in COUNTERS:
            yield CounterMetricFamily(_name(name), text, value=getattr(health, field))
        yield GaugeMetricFamily(
            _name("ring_fill_ratio"), "Share of the input's ring that waits for the tracker, 0 to 1.", health.ring_fill
        )
        latency = GaugeMetricFamily(
            _name("latency_seconds"), "Time to work through a block, over the last second.", labels=["quantile"]
        )
        for quantile, value_ms in (("0.5", health.latency_ms_p50), ("0.99", health.latency_ms_p99)):
            if value_ms is not None:
                latency.add_metric([quantile], value_ms / 1000.0)
        yield latency

    def _verdict_metrics(self) -> Iterator[Metric]:
        verdicts = self._verdicts.copy()  # the worker may add a channel meanwhile
        states: dict[tuple[str, ...], str] = {(str(channel),): verdict.state for channel, verdict in verdicts.items()}
        yield _state("verdict_state", "What the machine does.", get_args(State), ["channel"], states)
        for name, field, factor, text in GAUGES:
            gauge = GaugeMetricFamily(_name(name), text, labels=["channel"])
            for channel, verdict in verdicts.items():
                value = getattr(verdict, field)
                if value is not None:
                    gauge.add_metric([str(channel)], factor * value)
            yield gauge
        events = CounterMetricFamily(_name("events"), "Stretches that have ended.", labels=["channel", "kind"])
        for (channel, kind), count in self._events.copy().items():
            events.add_metric([str(channel), kind], count)
        yield events


def _name(name: str) -> str:
    return f"chatter_monitor_{name}"


def _state(
    name: str, text: str, states: Sequence[str], labels: list[str], now: Mapping[tuple[str, ...], str]
) -> GaugeMetricFamily:
    """Gauge with one row for each state, 1 for the one that is: an alert can name the state that it waits for."""
    gauge = GaugeMetricFamily(_name(name), text + " 1 for the state that it is in.", labels=[*labels, "state"])
    for values, current in now.items():
        for state in states:
            gauge.add_metric([*values, state], float(state == current))
    return gauge


def _address(bind: str) -> tuple[str, int]:
    """Host and port."""
    match host_and_port(bind):
        case host, int(port):
            return host, port
    raise InputError("[metrics] bind is no address", got=bind, allowed=ALLOWED)
