"""The live observer and signatures against those of a whole recording."""

import numpy as np
import pytest

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.innovations import Innovations, known_forces, tried_forces
from chatter_monitor.discrepancy.live.stream import at_rest, no_answers, scratch
from chatter_monitor.discrepancy.live.windows import no_summary
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.kernels import live_signatures as live
from chatter_monitor.kernels.observer import observe
from chatter_monitor.kernels.signatures import LANES, response_of
from chatter_monitor.physics.parts import AppliedTerm, Mode, Spindle
from chatter_monitor.physics.terms import CATALOGUE

SPINDLE = Spindle(9000.0, 1)
TRIED = [
    AppliedTerm(CATALOGUE["cubic_stiffness"], {"coefficient": 1.0}),
    AppliedTerm(CATALOGUE["coulomb_friction"], {"coefficient": 1e6}),
    AppliedTerm(CATALOGUE["hysteresis"], {"coefficient": 1.0, "yield_displacement": 0.7}),
    AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": 1.0}),
]


def base_of(quantity, terms=()):
    """A calibrated observer on four thousand samples of a resonance."""
    rng = np.random.default_rng(2)
    linear = Linear((Mode(400.0, 0.02),), quantity, 1e-3, spindle=SPINDLE)
    y = np.zeros(4096)
    push = rng.standard_normal(y.size)
    for k in range(2, y.size):
        y[k] = 1.76 * y[k - 1] - 0.965 * y[k - 2] + push[k]
    y /= np.std(y)
    return Innovations(Recorded(y, np.zeros(y.size, dtype=bool), 5600.0), linear, terms)


def watched(base, known, taps, tried=TRIED, nearly=False):
    """Errors and signatures, a few samples in each call."""
    y, tried = base.recorded.samples, tried_forces([(applied.term, applied.values) for applied in tried])
    response = response_of(base.observer, taps)
    path, along = at_rest(base.observer, known, tried), scratch()
    answers = no_answers(response, LANES)
    white = []
    for first in range(0, y.size, live.FEW):
        summary = no_summary(LANES, live.FEW)
        few = y[first : first + live.FEW]
        live.watch(
            base.observer, known, tried, nearly, 4, response, few, first, path, along, answers, summary
        )  # fmt: skip
        white.append(summary.white.reshape(live.FEW, LANES))
        np.testing.assert_array_equal(summary.errors, white[-1][:, 0])
    return np.concatenate(white).T[: 5 + tried.rows.size]


@pytest.mark.parametrize("quantity", ["displacement", "pressure"])
@pytest.mark.parametrize("known", [False, True])
def test_errors_and_signatures_are_those_of_the_recording(quantity, known):
    """The live kernel finds the errors that `observe` does, and nearly its signatures, which know the state better."""
    terms = (AppliedTerm(CATALOGUE["cubic_stiffness"], {"coefficient": 0.02}),) if known else ()
    base = base_of(quantity, terms)
    taps = np.array([1.0, -0.5, 0.25])
    found = watched(base, known_forces(terms), taps)
    settled = np.arange(base.errors.size) > 600
    errors = np.empty_like(base.errors)
    sharp = base.observer._replace(spread=np.zeros_like(base.observer.spread))
    missing = base.recorded.missing
    observe(sharp, known_forces(terms), base.recorded.samples, missing, missing == 0, errors, base.motion)
    expected = np.convolve(errors, taps)[: errors.size]
    # Beside a running signal no force is looked at again once the sample at the end of its step is seen.
    alike = not known or quantity == "pressure"
    assert np.std((found[0] - expected)[settled]) < (1e-6 if alike else 0.02) * np.std(expected)
    base.settled[:] = True
    base.observer, base.taps = sharp, taps
    motion = base.motion
    back = np.gradient(motion.lagged, base.observer.step_s, axis=1)
    columns = [*base.respond([motion.x, motion.v, motion.lagged, back])]
    columns += [*base.of_terms([(applied.term, applied.values) for applied in TRIED])]
    # A smooth force that is felt is a mean about the sample here, and its value at the sample there.
    cubic = 1e-3 if quantity == "displacement" else 0.02
    allowed = [1e-3, 1e-3, 1e-3, 0.1, cubic, 1e-3, 0.1, 1e-3]
    for got, wanted, close in zip(found[1:], columns, allowed, strict=True):
        assert np.std((got - wanted)[settled]) < (close if alike else 0.1) * np.std(wanted[settled])


def test_forces_at_samples_alone_are_nearly_those_along_the_way():
    """A spring whose force has no jump and friction, taken at samples alone, explain most of what they do in full."""
    base, smooth = base_of("displacement"), TRIED[:2]
    taps = np.array([1.0, -0.5])
    exact, nearly = (watched(base, known_forces(()), taps, smooth, nearly=each) for each in (False, True))
    np.testing.assert_array_equal(nearly[:5], exact[:5])
    for one, other in zip(exact[5:, 600:], nearly[5:, 600:], strict=True):
        assert np.corrcoef(one, other)[0, 1] > 0.95


def test_calls_do_not_matter():
    """The same samples in one call or in sixteen give the same errors, and the same products but for rounding."""
    base, known = base_of("displacement"), known_forces(())
    y, tried = base.recorded.samples, tried_forces([(applied.term, applied.values) for applied in TRIED])
    response = response_of(base.observer, np.array([1.0, -0.5]))
    found = []
    for calls in (1, 16):
        path, along, answers = at_rest(base.observer, known, tried), scratch(), no_answers(response, LANES)
        parts = []
        for first in range(0, y.size, y.size // calls):
            part, summary = y[first : first + y.size // calls], no_summary(LANES, y.size // calls)
            live.watch(base.observer, known, tried, False, 4, response, part, first, path, along, answers, summary)
            parts.append(summary)
        found.append([np.concatenate([each.errors for each in parts])])
        found[-1] += [sum(each.products for each in parts), sum(each.sums for each in parts)]
    np.testing.assert_array_equal(found[0][0], found[1][0])
    for one, other in zip(found[0][1:], found[1][1:], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * abs(one).max())


def test_a_summary_has_the_products_of_its_columns():
    """Products and sums are those of the columns, by linear algebra."""
    rng = np.random.default_rng(4)
    rows = rng.standard_normal((live.FEW, LANES))
    summary = no_summary(LANES, live.FEW)
    live.sum_up(rows.reshape(-1), LANES, summary.products, summary.sums)
    np.testing.assert_allclose(summary.products.reshape(LANES, LANES), rows.T @ rows, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(summary.sums, rows.sum(axis=0), rtol=1e-12, atol=1e-12)
