"""The example dashboard for Grafana asks for nothing that the monitor does not tell."""

from __future__ import annotations

import json
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from prometheus_client.parser import text_string_to_metric_families

from chatter_monitor.outlets.metrics import Metrics
from chatter_monitor.records import Block
from tests.bridging import verdict
from tests.messages import event, health
from tests.outlets.test_metrics import fetch

FILE = Path(__file__).resolve().parents[2] / "config/grafana-dashboard.json"
DASHBOARD = json.loads(FILE.read_text(encoding="utf-8"))
SELECTOR = re.compile(r"\b((?:chatter_monitor|process)_\w+)(?:\{([^}]*)\})?")
LABEL = re.compile(r'(\w+)(=~?)"([^"]*)"')


def queries():
    """Every query of the dashboard, with what it is for."""
    for panel in DASHBOARD["panels"]:
        for target in panel["targets"]:
            yield panel["title"], target["expr"]
    for variable in DASHBOARD["templating"]["list"]:
        if variable["type"] == "query":
            yield variable["name"], variable["query"]


@pytest.fixture(scope="module")
def exported():
    """Label values of every metric that the endpoint tells, by label."""
    with Metrics("127.0.0.1:0", machine="lathe-3", clock=lambda: 0.0) as metrics:
        for message in (
            msgspec.structs.replace(verdict(0), margin_percent=5.0, chatter_probability=0.01),
            health(),
            event(),
        ):
            metrics.message(message)
        metrics.message(health(latency_ms_p50=1.0, latency_ms_p99=2.0))
        metrics.block(Block(0, np.zeros((1, 1)), 12_800.0))
        text = fetch(metrics.url)
    found = {}
    for family in text_string_to_metric_families(text):
        for sample in family.samples:
            labels = found.setdefault(sample.name, {})
            for label, value in sample.labels.items():
                labels.setdefault(label, set()).add(value)
    return found


@pytest.mark.parametrize(("title", "query"), list(queries()))
def test_every_metric_is_exported(title, query, exported):
    """Each metric of a query is told by the endpoint, with the labels and the values that the query selects."""
    selectors = SELECTOR.findall(query)
    assert selectors, title
    for name, labels in selectors:
        assert name in exported
        for label, operator, value in LABEL.findall(labels):
            assert label in exported[name]
            if operator == "=":
                assert value in exported[name][label]


def test_all_that_is_told_of_the_machine_is_shown(exported):
    """No metric of the monitor's own is forgotten."""
    asked = {name for _, query in queries() for name, _ in SELECTOR.findall(query)}
    told = {name for name in exported if name.startswith("chatter_monitor_")}
    assert told - asked == {"chatter_monitor_samples_total"}  # which only says how long it has run


def test_labels_of_legends_are_there(exported):
    """What a legend names is a label of one of the query's metrics."""
    for panel in DASHBOARD["panels"]:
        for target in panel["targets"]:
            labels = {label for name, _ in SELECTOR.findall(target["expr"]) for label in exported[name]}
            assert set(re.findall(r"\{\{(\w+)\}\}", target["legendFormat"])) <= labels


def test_panels_do_not_overlap():
    """Each place of the grid is taken once, and identifiers are unique."""
    taken = [
        (x, y)
        for panel in DASHBOARD["panels"]
        for x in range(panel["gridPos"]["x"], panel["gridPos"]["x"] + panel["gridPos"]["w"])
        for y in range(panel["gridPos"]["y"], panel["gridPos"]["y"] + panel["gridPos"]["h"])
    ]
    assert len(taken) == len(set(taken))
    assert max(x for x, _ in taken) < 24
    assert len({panel["id"] for panel in DASHBOARD["panels"]}) == len(DASHBOARD["panels"])
