"""The live observer and signatures against those of a whole recording."""

import numpy as np
import pytest

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.innovations import Innovations, known_forces, tried_forces
from chatter_monitor.discrepancy.live.stream import at_rest, no_answers, scratch
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


def watched(base, known, taps, calls):
    """Errors and signatures, in as many calls."""
    y, tried = base.recorded.samples, tried_forces([(applied.term, applied.values) for applied in TRIED])
    response = response_of(base.observer, taps)
    path, along = at_rest(base.observer, known, tried), scratch()
    answers = no_answers(response, LANES)
    white = np.zeros((y.size, LANES), answers.raw.dtype)
    missing = np.zeros(y.size, dtype=bool)
    for part in np.split(np.arange(y.size), calls):
        few = slice(part[0], part[-1] + 1)
        live.watch(
            base.observer, known, tried, 4, response, y[few], missing[few], part[0], path, along, answers, white[few]
        )
    return white.T[: 5 + len(TRIED)]


@pytest.mark.parametrize("quantity", ["displacement", "pressure"])
@pytest.mark.parametrize("known", [False, True])
def test_errors_and_signatures_are_those_of_the_recording(quantity, known):
    """The live kernel finds the errors that `observe` does, and nearly its signatures, which know the state better."""
    terms = (AppliedTerm(CATALOGUE["cubic_stiffness"], {"coefficient": 0.02}),) if known else ()
    base = base_of(quantity, terms)
    taps = np.array([1.0, -0.5, 0.25])
    found = watched(base, known_forces(terms), taps, 4)
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


def test_calls_do_not_matter():
    """The same samples in one call or in sixteen give the same bits."""
    base, taps = base_of("displacement"), np.array([1.0, -0.5])
    np.testing.assert_array_equal(watched(base, known_forces(()), taps, 1), watched(base, known_forces(()), taps, 16))
