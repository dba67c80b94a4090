"""Orders at which something was taken out with what turns in the last minute: they are heard there before it is found.

A comb takes a second to be found when a cut begins, and may be lost when its level jumps or its speed wanders. Until
then its lines are in the signal, as loud as they were in the cut before, and louder than all that was left of that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels.orders import MOST_ORDERS
from chatter_monitor.tracking.orders import Orders

# Share of the power that is forgotten in an interval: a time constant of a minute.
FORGETTING = 1.0 / 1200.0
# What has less of the power matters to no line.
MATTERS = 0.02

NOTHING_TAKEN = np.empty((0, 3))


class KnownOrders:
    """Power that each order of one spindle had lately."""

    def __init__(self) -> None:
        self._power = np.zeros(MOST_ORDERS + 1)

    def hear(self, orders: Orders, power: float, *, calm: bool = True) -> NDArray[np.float64]:
        """Take note of an interval.

        Parameters
        ----------
        orders : Orders
            What turned in it.
        power : float
            Of all that is left.
        calm : bool
            Whether there is no alarm, and was none just now: chatter catches on the teeth, and is taken out with them.

        Returns
        -------
        ndarray of float64, shape (m, 3)
            Lines that have been taken out, as `kernels.testimony.witness` takes them.
        """
        taken = [(line.frequency_hz, line.rms, 0.0) for line in (*orders.lines, *orders.other_lines)]
        if orders.source != "refined" or orders.rotation_hz is None:
            self._power[:] = 0.0
        else:
            now = np.zeros_like(self._power)
            for line in orders.lines:
                now[line.order] = line.rms**2
            self._power -= FORGETTING * self._power
            if orders.spindle_heard and calm:
                np.maximum(self._power, now, out=self._power)
            missed = self._power - now
            taken += [
                (order * orders.rotation_hz, 0.0, missed[order]) for order in np.flatnonzero(missed > MATTERS * power)
            ]
        return np.array(taken) if taken else NOTHING_TAKEN
