"""Forces of no name beside a name: how much they explain, and what the answer is then."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.name import within
from chatter_monitor.discrepancy.unnamed import gain_nats, out_of_range, smooth_nats
from chatter_monitor.physics.parts import AppliedTerm
from chatter_monitor.physics.terms import CATALOGUE
from tests.discrepancy.machine import Machine
from tests.discrepancy.test_diagnosis import SHORT, diagnosed

SAMPLES = 400


def evidence_of(errors, columns):
    """Ordinary regression with the first column among what is always fitted."""
    return Evidence(errors, columns, np.ones(errors.size), [0], 100)


def test_chance_rarely_gives_a_smooth_force_that_is_not_there_evidence():
    """Bayes factors of bumps over noise keep to Markov's inequality: less than exp(-3) of them exceed 3 nats."""
    rng = np.random.default_rng(130)
    columns = rng.standard_normal((20, SAMPLES)) * np.geomspace(1.0, 0.01, 20)[:, None]
    found = [smooth_nats(evidence_of(rng.standard_normal(SAMPLES), columns), range(1, 20)) for _ in range(300)]
    assert np.mean(np.array(found) > 3.0) < np.exp(-3.0)
    assert min(found) == 0.0


def test_the_bayes_factor_is_that_of_the_marginal_likelihood():
    """It is the ratio of two normal densities of the errors, that with the force at its best variance."""
    rng = np.random.default_rng(131)
    columns = rng.standard_normal((6, SAMPLES))
    errors = rng.standard_normal(SAMPLES) + 0.15 * columns[1:].sum(axis=0)
    free = columns[1:] - np.outer(columns[1:] @ columns[0], columns[0]) / (columns[0] @ columns[0])
    errors = errors - columns[0] * (errors @ columns[0]) / (columns[0] @ columns[0])

    def log_density(variance):
        covariance = np.eye(SAMPLES) + variance * free.T @ free
        return -0.5 * np.linalg.slogdet(covariance)[1] - 0.5 * errors @ np.linalg.solve(covariance, errors)

    best = max(log_density(variance) for variance in np.geomspace(1e-3, 1.0, 25)) - log_density(0.0)
    assert smooth_nats(evidence_of(errors, columns), range(1, 6)) == pytest.approx(best, abs=0.3)


def test_what_simulations_have_as_well_is_no_force():
    """Products of errors and columns that are known to be the filter's own leave nothing, others stay."""
    rng = np.random.default_rng(134)
    columns = rng.standard_normal((6, SAMPLES))
    evidence = evidence_of(rng.standard_normal(SAMPLES) + 0.15 * columns[1:].sum(axis=0), columns)
    right, _, size = within(evidence, range(1, 6))
    assert smooth_nats(evidence, range(1, 6)) > 10.0
    assert smooth_nats(evidence, range(1, 6), right * size) == 0.0
    assert gain_nats(evidence, 1) == pytest.approx(evidence.regress([1]).gain)
    [alone], _, [unit] = within(evidence, [1])
    assert gain_nats(evidence, 1, 0.5 * alone * unit) == pytest.approx(0.25 * gain_nats(evidence, 1))


def test_a_sign_that_takes_most_of_the_velocity_to_change_is_no_dry_friction():
    """A shape beyond the widest candidate by more than its uncertainty is out of range; a narrower one is not."""
    v = np.random.default_rng(132).standard_normal((2, SAMPLES))
    inn = SimpleNamespace(motion=SimpleNamespace(x=v, v=v))
    friction = AppliedTerm(CATALOGUE["coulomb_friction"], {"coefficient": 1.0, "width": 0.6})
    assert out_of_range(inn, friction, {"coefficient": (1.0, 0.1), "width": (0.6, 0.1)}) == "width"
    assert out_of_range(inn, friction, {"coefficient": (1.0, 0.1), "width": (0.6, 0.3)}) is None
    assert out_of_range(inn, friction, {"coefficient": (9.0, 0.1), "width": (0.1, 0.1)}) is None


@pytest.mark.parametrize(
    ("effect", "strength", "seed", "like", "difference"),
    [
        ("one side", 0.03, 120, "dry friction", "differs between the two sides of the displacement"),
        ("one direction", 0.06, 133, "a cutting force", "grows with the velocity by another power"),
    ],
)
def test_a_law_that_is_nearly_one_of_the_catalogue_is_not_named(effect, strength, seed, like, difference):
    """What the nearest name explains for the most part is `unknown` all the same, and how it differs is said."""
    report = diagnosed(Machine(effect, strength, **SHORT), seed).report
    assert report.verdict == "unknown", report.summary
    assert report.terms == []
    assert like in report.summary
    assert difference in report.summary


def test_a_one_sided_spring_is_no_drifting_offset():
    """A spring stiffer on one side moves the mean with the loudness of the motion: the spring alone is named."""
    found = diagnosed(Machine("quadratic", 0.08, damping_ratio=0.005, snr_db=40.0, **SHORT), 141)
    assert [term.name for term in found.report.terms] == ["quadratic_stiffness"], found.report.summary
    assert "offset" not in found.report.summary
