"""What Prometheus reads, over real HTTP, with the library's own parser."""

from __future__ import annotations

import socket
import urllib.request

import msgspec
import numpy as np
import pytest
from prometheus_client import REGISTRY
from prometheus_client.parser import text_string_to_metric_families

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.metrics import Metrics, MetricsSettings
from chatter_monitor.records import Block, Verdict


class Now:
    """A clock that is set by hand."""

    def __init__(self):
        self.s = 100.0

    def __call__(self):
        return self.s


@pytest.fixture
def now():
    return Now()


@pytest.fixture
def metrics(now):
    with Metrics("127.0.0.1:0", machine="lathe-3", clock=now) as metrics:
        yield metrics


def fetch(url):
    with urllib.request.urlopen(url, timeout=5) as response:  # noqa: S310  our own, on loopback
        return response.read().decode()


def scraped(metrics):
    """Values by name and labels."""
    families = text_string_to_metric_families(fetch(metrics.url))
    return {
        (sample.name, *sorted(sample.labels.items())): sample.value for family in families for sample in family.samples
    }


def test_every_count_of_the_health_message_arrives(metrics, messages):
    """Counters, latency in seconds and the state are those of the newest health message."""
    health = next(m for m in messages if type(m).__name__ == "Health")
    metrics.message(msgspec.structs.replace(health, non_finite=4, samples_in=1))
    metrics.message(msgspec.structs.replace(health, non_finite=5))
    values = scraped(metrics)
    expected = {
        "samples_total": 25600,
        "lost_samples_total": 12,
        "overflows_total": 1,
        "clipped_samples_total": 3,
        "non_finite_samples_total": 5,
        "dropped_publications_total": 2,
        "ring_fill_ratio": 0.1,
    }
    assert {name: values[("chatter_monitor_" + name,)] for name in expected} == expected
    assert values["chatter_monitor_latency_seconds", ("quantile", "0.5")] == pytest.approx(0.0045)
    assert values["chatter_monitor_latency_seconds", ("quantile", "0.99")] == pytest.approx(0.0125)
    states = {key[1][1]: value for key, value in values.items() if key[0] == "chatter_monitor_health_state"}
    assert states == {"hearing": 1, "not_hearing": 0, "finished": 0}


def test_a_verdict_is_one_of_its_states(metrics, messages):
    """Each channel has a row for every state, 1 for its newest one, and the numbers that its verdict has."""
    alarm, unknown = (m for m in messages if isinstance(m, Verdict))
    for message in (msgspec.structs.replace(alarm, state="stable"), alarm, unknown):
        metrics.message(message)
    values = scraped(metrics)
    for channel, state in (("0", "self_excited"), ("1", "unknown")):
        states = {
            dict(key[1:])["state"]: value
            for key, value in values.items()
            if key[0] == "chatter_monitor_verdict_state" and ("channel", channel) in key
        }
        assert set(states) == {"idle", "stable", "forced", "approaching", "self_excited", "unknown"}
        assert [name for name, value in states.items() if value] == [state]
    assert values["chatter_monitor_frequency_hertz", ("channel", "0")] == 898.6
    assert values["chatter_monitor_damping_ratio", ("channel", "0")] == -0.0011
    assert values["chatter_monitor_margin_ratio", ("channel", "0")] == pytest.approx(-0.03)
    assert values["chatter_monitor_confidence_ratio", ("channel", "1")] == 0
    assert values["chatter_monitor_chatter_probability_ratio", ("channel", "0")] == 0.98
    assert ("chatter_monitor_chatter_probability_ratio", ("channel", "1")) not in values
    assert ("chatter_monitor_frequency_hertz", ("channel", "1")) not in values


def test_events_are_counted(metrics, messages):
    """Every event that ends adds one to its channel and kind."""
    for message in messages:
        metrics.message(message)
    assert scraped(metrics)["chatter_monitor_events_total", ("channel", "0"), ("kind", "chatter")] == 2


def test_the_age_of_the_newest_samples_grows_until_others_come(metrics, now):
    """Silence shows as an age in seconds, which only samples bring back to zero; before the first there is none."""
    age = ("chatter_monitor_last_sample_age_seconds",)
    assert age not in scraped(metrics)
    for waited_s in (0.0, 2.5):
        metrics.block(Block(0, np.zeros((4, 1)), 12_800.0))
        now.s += waited_s
        assert scraped(metrics)[age] == waited_s


def test_the_machine_and_the_memory_are_told(metrics):
    """Name, version and the process's own resident memory stand beside the rest; nothing is registered globally."""
    values = scraped(metrics)
    about = next(dict(key[1:]) for key in values if key[0] == "chatter_monitor_info")
    assert about["machine"] == "lathe-3"
    assert about["version"]
    assert values[("process_resident_memory_bytes",)] > 1e6
    assert not [family for family in REGISTRY.collect() if family.name.startswith("chatter")]


def test_closing_frees_the_port(now):
    """After closing nobody answers, and closing again does nothing."""
    metrics = Metrics("127.0.0.1:0", machine="m", clock=now)
    url = metrics.url
    fetch(url)
    metrics.close()
    metrics.close()
    with pytest.raises(OSError, match="refused"):
        fetch(url)


def test_a_taken_port_is_a_fault_of_the_environment(now):
    """The message names the address and the key that changes it."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        address = f"127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(EnvironmentFault) as caught:
            Metrics(address, machine="m", clock=now)
    assert address in str(caught.value)
    assert "[metrics] bind" in str(caught.value)


@pytest.mark.parametrize("bind", ["0.0.0.0:9464", "192.168.1.4:9464", "[::]:9464", "lathe-3:9464"])
def test_the_network_is_refused(bind):
    """An address that others can reach is refused, with what to do instead."""
    with pytest.raises(InputError, match=r"refused on the network.*Prometheus"):
        MetricsSettings(bind=bind)


@pytest.mark.parametrize("bind", ["9464", "127.0.0.1", "127.0.0.1:99999", "http://127.0.0.1:1", "", "a:b:1"])
def test_what_is_no_address_is_refused(bind):
    """The message says what was got and what is allowed."""
    with pytest.raises(InputError, match=r"no address.*127\.0\.0\.0/8"):
        MetricsSettings(bind=bind)


@pytest.mark.parametrize("bind", ["127.0.0.1:0", "localhost:0", "[::1]:0"])
def test_every_name_of_this_machine_works(bind, now):
    """Loopback addresses of both kinds can be bound and read."""
    assert MetricsSettings(bind=bind).bind == bind
    with Metrics(bind, machine="m", clock=now) as metrics:
        assert "chatter_monitor_info" in fetch(metrics.url)
