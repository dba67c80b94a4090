"""The nouns of report.json."""

import json

import msgspec

from chatter_monitor.discrepancy.report import (
    Alternative,
    Calibration,
    Estimate,
    Finding,
    Fit,
    Located,
    Report,
    Statistic,
)

REPORT = Report(
    verdict="missing_physics",
    summary="The spring gets stiffer.",
    located=Located(time_s=[(0.0, 20.0)], statistic=Statistic("phase_plane", 31.0, 1e-9)),
    terms=[
        Finding("cubic_stiffness", "hardening", {"coefficient": Estimate(0.05, (0.04, 0.06), "1/u^2")}, 42.0, 1e-9, "")
    ],
    alternatives=[Alternative("clearance", 40.0)],
    information=[],
    fit=Fit([(1.0, 2.0)], -1.0, -1.1, 42.0, 60.6, 1e-3, 0.5),
    calibration=Calibration(
        {"mode.1.frequency_hz": 400.0}, {"mode.1.frequency_hz": Estimate(401.0, (400.0, 402.0), "Hz")}
    ),
)


def test_a_report_reads_back_equal():
    """What is written as JSON is read back as the same report."""
    assert msgspec.json.decode(REPORT.to_json(), type=Report) == REPORT


def test_the_contract_of_the_report():
    """The schema stands first, and the fields are those of the contract."""
    written = json.loads(REPORT.to_json())
    assert next(iter(written.items())) == ("schema", "chatter-monitor/diagnosis/1")
    assert {"verdict", "summary", "located", "terms", "alternatives", "fit", "calibration", "elapsed_s"} <= set(written)
    assert {"time_s", "band_hz", "amplitude", "state", "lag_s", "order", "statistic"} <= set(written["located"])
    assert {"name", "sense", "parameters", "evidence_nats", "p_value", "why"} == set(written["terms"][0])
    assert written["terms"][0]["parameters"]["coefficient"] == {"value": 0.05, "ci95": [0.04, 0.06], "unit": "1/u^2"}
    assert {
        "held_out_s",
        "nll_per_sample_before",
        "nll_per_sample_after",
        "gain_nats",
        "psd_distance_db_before",
        "psd_distance_db_after",
        "free_run",
        "residual_white_p_before",
        "residual_white_p_after",
    } <= set(written["fit"])
