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


@pytest.mark.parametrize("number", [18, 147])
def test_what_explains_the_rest_of_a_name_may_explain_all_of_it(number, tmp_path):
    """To the regression a joint that sticks is a cubic spring; beside that spring it shows, as a second law."""
    report, truth = report_of("hysteresis", 182818, number, tmp_path)
    assert [term.name for term in report.terms] == truth["names"], report.summary


def test_damping_that_a_fit_hardly_knows_refuses_no_name(tmp_path):
    """Three times the damping of the model file, but by a fit that knows it to 1.8 standard deviations from that."""
    report, truth = report_of("v|v|", 182818, 23, tmp_path)
    assert [term.name for term in report.terms] == truth["names"], report.summary


@pytest.mark.parametrize(("kind", "number"), [("stribeck", 46), ("stribeck", 274), ("coulomb", 93), ("coulomb", 238)])
def test_of_two_frictions_the_likelier_is_named(kind, number, tmp_path):
    """The best stiction explains 0.4 to 2.3 nats more in each of them: by itself that tells nothing."""
    report, truth = report_of(kind, 182818, number, tmp_path)
    assert [term.name for term in report.terms] == truth["names"], report.summary
