"""Cases of the proof's generator, by seed and number; all of them were looked at in development."""

from __future__ import annotations

import pytest

from chatter_monitor.discrepancy.conclude import conclude
from chatter_monitor.discrepancy.diagnosis import examine, recorded_from
from chatter_monitor.discrepancy.prove.blind.case import make_case
from chatter_monitor.discrepancy.prove.blind.effects import CATALOGUE
from chatter_monitor.physics.model_file import read_model


def report_of(kind, seed, number, folder):
    made = make_case(next(effect for effect in CATALOGUE if effect.kind == kind), seed, number)
    (folder / "model.toml").write_text(made.model, encoding="utf-8")
    return conclude(examine(recorded_from(made.samples, 12800.0), read_model(folder / "model.toml"))).report, made.truth


def test_a_harmonic_is_not_taken_for_a_mode_where_a_delay_explains_the_spectrum(tmp_path):
    """A tool that leaves the cut makes twice the frequency, 57 nats for a second mode, 51 for the delay."""
    report, truth = report_of("loss of contact", 155921, 2, tmp_path)
    assert [term.name for term in report.terms] == ["loss_of_contact"], report.summary
    assert report.terms[0].parameters["chip_thickness"].value == pytest.approx(
        truth["parameters"]["chip_thickness"], rel=0.05
    )


@pytest.mark.parametrize(("kind", "number"), [("loss of contact", 123), ("hysteresis", 257)])
def test_all_of_the_recording_may_confirm_a_name(kind, number, tmp_path):
    """The training blocks alone lead to another name, which the other half does not confirm."""
    report, truth = report_of(kind, 155921, number, tmp_path)
    assert [term.name for term in report.terms] == truth["names"], report.summary
