"""What a model's filter leaves of the model itself, where by construction nothing is left to name.

The filter keeps the gain that is right for the machine on average. Beside strong damping that is too much in one moment
and too little in the next, and an anti-alias filter lets it see a little of the noise to come. Both leave errors that
go with the motion, as a law that is not quite the right one does. How much, simulations of the fitted model tell
(a parametric bootstrap), which pass the same band, filter and tests as the recording did.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from chatter_monitor.discrepancy import basis
from chatter_monitor.discrepancy.augment import Augmented, as_it_stands
from chatter_monitor.discrepancy.band import at_rate
from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.diagnosis import recorded_from
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.free_run import free_run
from chatter_monitor.discrepancy.innovations import Diverged, Innovations
from chatter_monitor.discrepancy.side_by_side import each
from chatter_monitor.discrepancy.unnamed import Rest
from chatter_monitor.physics.parts import AppliedTerm

_SEEDS = (1, 2)  # of one simulation each
_LONGEST_S = 20.0
_OF_A_MODE = {"frequency_hz", "damping_ratio"}


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
        named = self._augmented.system.terms[-len(self._augmented.parameters) :]
        return [Rest(case, fit.innovations, fit.columns, named) for case, fit in self._fits]

    @property
    def damping_bias(self) -> float:
        """By how much a fit finds the first mode's damping ratio too large; 0 if that is not fitted, or not known."""
        return self._bias([fit.machine_step.get("damping_ratio", 0.0) for _, fit in self._fits])

    def unbiased(self) -> Augmented:
        """The model with what fits find too much of its own parameters taken off, and intervals for both.

        A parameter that would leave its range, or change its sign, stays; so do all where the force is not steady, as
        that of the simulations is.
        """
        augmented, fits = self._augmented, [fit for _, fit in self._fits_if_steady()]
        if not fits:
            return augmented
        wider = math.sqrt(1.0 + 1.0 / len(fits))
        terms, parameters = list(augmented.system.terms), []
        for i, found in enumerate(augmented.parameters):
            at = len(terms) - len(augmented.parameters) + i
            known = {p.name: p for p in terms[at].term.parameters}
            better = {}
            for name, (value, sd) in found.items():
                less = value - self._bias([fit.steps[i][name] for fit in fits])
                better[name] = (less if less * value > 0.0 and known[name].allows(less) else value, wider * sd)
            parameters.append(better)
            values = {name: value for name, (value, _) in better.items()}
            terms[at] = AppliedTerm(terms[at].term, {**terms[at].parameters, **values})
        first, *others = augmented.system.modes
        off = {
            name: self._bias([fit.machine_step[name] for fit in fits])
            for name in fits[0].machine_step.keys() & _OF_A_MODE
        }
        mode = replace(
            first, **{name: max(getattr(first, name) - by, 0.5 * getattr(first, name)) for name, by in off.items()}
        )
        system = replace(augmented.system, modes=(mode, *others), terms=tuple(terms))
        return replace(augmented, system=system, parameters=parameters)

    def _fits_if_steady(self) -> list[tuple[Case, Augmented]]:
        unrest = self._case.unrest
        return self._fits if unrest is None or unrest.kind is None else []

    @staticmethod
    def _bias(steps: Sequence[float]) -> float:
        return float(np.mean(steps)) if steps else 0.0

    @cached_property
    def _fits(self) -> list[tuple[Case, Augmented]]:
        """Simulations, and the model on each as it stands."""
        return [fit for fit in each(self._fit, _SEEDS) if fit is not None]

    def _fit(self, seed: int) -> tuple[Case, Augmented] | None:
        case, augmented = self._case, self._augmented
        samples = free_run(case, augmented.system, seed, _LONGEST_S)
        if samples is None:
            return None
        whole = recorded_from(samples, case.whole.rate_hz)
        recorded = at_rate(whole, case.recorded.rate_hz)
        inn = Innovations(recorded, case.innovations.linear, case.innovations.terms)
        beside = Case(case.system, whole, recorded, case.base, inn)
        beside.matrix = basis.retuning(inn)
        beside.columns = {"retuning": list(range(len(beside.matrix)))}
        beside.evidence = Evidence(
            inn.white, beside.matrix, beside.weight, beside.columns["retuning"], case.evidence.block
        )
        try:
            return beside, as_it_stands(beside, augmented)
        except Diverged:
            return None
