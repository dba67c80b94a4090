"""The page of the diagnoses of an archive."""

from __future__ import annotations

from chatter_monitor.reports.diagnoses import Diagnosed, archive_page, row, sentence, worst_first


def diagnosed(verdict, effects=(), evidence_nats=0.0, runner_up=None):
    return Diagnosed(
        key="k",
        verdict=verdict,
        effects=list(effects),
        senses=["hardening" if effect == "cubic_stiffness" else None for effect in effects],
        evidence_nats=evidence_nats,
        gain_nats=evidence_nats,
        runner_up=runner_up,
        runner_up_nats=None if runner_up is None else evidence_nats - 7.0,
        sentence=f"It is {verdict}.",
        warnings=[],
        page="pages/source=a%2Fb.wav/k/report.html",
    )


DONE = {
    "a/fine.wav": diagnosed("none"),
    "a/other.wav": diagnosed("parameters"),
    "a/strange.wav": diagnosed("unknown", ["force_surface"], 20.0),
    "a/weak.wav": diagnosed("missing_physics", ["coulomb_friction"], 12.0),
    "a/strong.wav": diagnosed("missing_physics", ["cubic_stiffness", "clearance"], 90.0, "quadratic_stiffness"),
}


def test_what_should_be_looked_at_comes_first():
    """Missing physics before what is unknown, the clearest first; nothing is named where the answer is unknown."""
    rows = [row(name, summary) for name, summary in worst_first(DONE)]
    assert [each[0] for each in rows] == ["a/strong.wav", "a/weak.wav", "a/strange.wav", "a/other.wav", "a/fine.wav"]
    assert rows[0][1:] == ("cubic_stiffness (hardening) + clearance", "90.0 nats", "quadratic_stiffness", "83.0 nats")
    assert rows[1][1:] == ("coulomb_friction", "12.0 nats", "-", "-")
    assert [each[1:] for each in rows[2:]] == [
        (word, "-", "-", "-") for word in ("unknown", "other parameters", "as simulated")
    ]


def test_what_the_page_says():
    """How often physics is missing and which, each recording in words with its report, and what is broken."""
    page = archive_page("Archive", DONE, {"a/<b>.wav": "no sound"})
    assert sentence(DONE, {}) == "Physics missing in 2 of 5 recordings."
    assert "Physics missing in 2 of 5 recordings; 1 could not be diagnosed." in page
    assert "It is unknown." in page
    assert 'href="pages/source%3Da%252Fb.wav/k/report.html"' in page
    assert "a/&lt;b&gt;.wav" in page
    assert "Nothing named:" in archive_page("Archive", {"a/fine.wav": DONE["a/fine.wav"]}, {})
