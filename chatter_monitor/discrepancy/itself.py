"""What a model's filter leaves of the model itself, where by construction nothing is left to name.

The filter keeps the gain that is right for the machine on average. Beside strong damping that is too much in one moment
and too little in the next, and an anti-alias filter lets it see a little of the noise to come. Both leave errors that
go with the motion, as a law that is not quite the right one does. How much, simulations of the fitted model tell
(a parametric bootstrap), which pass the same band, filter and tests as the recording did.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from chatter_monitor.discrepancy.augment import Augmented, as_it_stands
from chatter_monitor.discrepancy.band import at_rate
from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.columns import gather_machine
from chatter_monitor.discrepancy.diagnosis import recorded_from
from chatter_monitor.discrepancy.free_run import free_run
from chatter_monitor.discrepancy.innovations import Diverged, Innovations
from chatter_monitor.discrepancy.side_by_side import each
from chatter_monitor.discrepancy.unnamed import Rest

_SEEDS = (1, 2)  # of one simulation each
_LONGEST_S = 20.0
_DAMPING = 1  # column of the damping ratio among those of a fit, where it is fitted


class Itself:
    """A fitted model beside simulations of itself, which are made when they are asked for.

    Parameters
    ----------
    case : Case
        Of the recording.
    augmented : Augmented
        Model whose terms act all along.
    """

    def __init__(self, case: Case, augmented: Augmented) -> None:
        self._case, self._augmented = case, augmented

    @cached_property
    def rests(self) -> list[Rest]:
        """What the model leaves of each simulation; less of them, or none, if it runs away."""
        return [rest for rest in each(self._rest, _SEEDS) if rest is not None]

    @property
    def damping_bias(self) -> float:
        """By how much a fit finds the first mode's damping ratio too large; 0 if that is not fitted, or not known."""
        if not self.rests or self._augmented.damping_sd == 0.0:
            return 0.0
        return float(np.mean([rest.evidence.regress([]).all_coefficients[_DAMPING] for rest in self.rests]))

    def _rest(self, seed: int) -> Rest | None:
        case, augmented = self._case, self._augmented
        samples = free_run(case, augmented.system, seed, _LONGEST_S)
        if samples is None:
            return None
        whole = recorded_from(samples, case.whole.rate_hz)
        recorded = at_rate(whole, case.recorded.rate_hz)
        inn = Innovations(recorded, case.innovations.linear, case.innovations.terms)
        beside = Case(case.system, whole, recorded, case.base, inn)
        gather_machine(beside)
        try:
            fit = as_it_stands(beside, augmented)
        except Diverged:
            return None
        return Rest(beside, fit.innovations, fit.columns, augmented.system.terms[-len(augmented.parameters) :])
