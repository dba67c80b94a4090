"""Orders that were taken out lately, against what was told of them."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.tracking.orders import OrderLine, Orders
from chatter_monitor.verdict.known_orders import FORGETTING, KnownOrders

HEARD = Orders(0, 23.0, 0.01, "refined", 0.9, (OrderLine(9, 207.0, 0.5),))
NOT_HEARD = Orders(0, 23.1, 0.05, "refined", 0.0)


def test_what_is_taken_out_now_is_not_missed():
    assert KnownOrders().hear(HEARD, 1.0).tolist() == [[207.0, 0.5, 0.0]]


def test_what_was_taken_out_is_missed_at_its_order_of_the_speed_by_now():
    known = KnownOrders()
    known.hear(HEARD, 1.0)
    assert known.hear(NOT_HEARD, 1.0) == pytest.approx(np.array([[9 * 23.1, 0.0, 0.25 * (1.0 - FORGETTING)]]))


def test_what_is_next_to_nothing_of_the_power_does_not_matter():
    known = KnownOrders()
    known.hear(HEARD, 1.0)
    assert known.hear(NOT_HEARD, 100.0).size == 0


@pytest.mark.parametrize("source", ["given", "found", None])
def test_another_speed_has_other_orders(source):
    """A speed that was told just now, a comb of nobody's, and no speed: nothing is known after them."""
    known = KnownOrders()
    known.hear(HEARD, 1.0)
    known.hear(NOT_HEARD._replace(source=source), 1.0)
    assert known.hear(NOT_HEARD, 1.0).size == 0


def test_it_is_forgotten_in_minutes():
    known = KnownOrders()
    known.hear(HEARD, 1.0)
    for _ in range(4 * 1200):
        missed = known.hear(NOT_HEARD, 1.0)
    assert missed.size == 0


def test_what_is_taken_out_in_an_alarm_is_not_missed_after_it():
    """Chatter catches on the teeth, and is taken out with them: what comes next there is not the teeth."""
    known = KnownOrders()
    known.hear(HEARD, 1.0, calm=False)
    assert known.hear(NOT_HEARD, 1.0).size == 0
