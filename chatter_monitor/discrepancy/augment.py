"""The augmented model: every parameter of the named terms fitted through the nonlinear filter, with intervals.

The regression on signatures is linear in the coefficients and takes the motion from the base model. Here the filter
itself knows the terms; damped Gauss-Newton steps on its whitened errors move coefficients, shapes and modes until they
stay, which takes the bias out that strong effects have in the regression. Slopes are differences of the filter's
errors: a signature would leave out that a force which the filter knows moves with what the filter believes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.basis import scales
from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.innovations import Diverged, Innovations
from chatter_monitor.discrepancy.name import PRICE_NATS
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.side_by_side import each
from chatter_monitor.discrepancy.whitening import ORDER
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Excitation
from chatter_monitor.physics.terms import ABOVE

Vector = NDArray[np.float64]

STEPS = 16
_SETTLED_NATS = 0.2
_DAMPINGS = (0.0, 0.1, 1.0, 10.0, 100.0)  # of a step (Levenberg and Marquardt), until it leads down
_HOPE = 3.0  # times what the next step promises: as much a model may still gain
_LARGEST_STEP = 0.5  # relative, of a shape
_DERIVATIVE_STEP = 0.02
DAMPING_KNOWN = 0.3  # of the logarithm: what the model file says of the damping, with the tails of Cauchy's law
_NOISE_STEP, _LARGEST_NOISE_STEP = 0.1, 3.0  # of the logarithm of the noise
_AS_GIVEN = ("cutting_speed_m_s",)  # parameters that are not fitted
# Of a velocity over which friction fades, over that of the tool: that of the narrowest candidate. What the observer
# does not know of the velocity is as much, and a narrower law would be seen by chance only.
_NARROWEST = 0.1
_ALWAYS = (-math.inf, math.inf)
_LEAST_NOISE = 1e-6  # over the motion: less changes nothing


@dataclass(frozen=True, slots=True, eq=False)
class Augmented:
    """The augmented model.

    Attributes
    ----------
    system : MachiningSystem
        What `simulate` runs.
    innovations : Innovations
        Of the augmented model on the recording.
    parameters : list of dict of str to (float, float)
        For each added term, its parameters with their standard deviations.
    columns : list of ndarray of float64, shape (n,)
        What a change of each parameter that was fitted adds to the errors: of modes, terms, nuisance, whitener.
    machine_columns : list of ndarray of float64, shape (n,)
        The same without the terms; frequency and damping ratio of the first mode come first, if they were fitted.
    gain_nats : float
        Gain of the whitened likelihood over the base model, on all samples, errors of the nonlinear filter itself.
    damping_sd : float
        Standard deviation of the first mode's damping ratio; 0 if that was not fitted.
    cost : float
        What is left to explain, nats, the parameters paid for; of two models of one case the cheaper one is likelier.
    """

    system: MachiningSystem
    innovations: Innovations
    parameters: list[dict[str, tuple[float, float]]]
    columns: list[Vector]
    machine_columns: list[Vector]
    gain_nats: float
    damping_sd: float = 0.0
    cost: float = math.inf


@dataclass(frozen=True, slots=True)
class Start:
    """Where a fit begins.

    Attributes
    ----------
    found : tuple of AppliedTerm
        Terms with the coefficients to begin with.
    linear : Linear
    before : tuple of AppliedTerm
        Terms that the model has besides, which stay as they are.
    price_nats : float
        Of what else this model has before others.
    between_s : (float, float)
        When the terms that were found act.
    """

    found: tuple[AppliedTerm, ...]
    linear: Linear
    before: tuple[AppliedTerm, ...]
    price_nats: float = 0.0
    between_s: tuple[float, float] = _ALWAYS


def augment(case: Case, found: Sequence[AppliedTerm], linear: Linear | None = None) -> Augmented:
    """Fit the terms that were found together with the modes.

    Parameters
    ----------
    case : Case
    found : sequence of AppliedTerm
        Terms with the coefficients to begin with, beside those that the base has.
    linear : Linear, optional
        Linear part to begin with; that of the base if not given.

    Raises
    ------
    Diverged
        If the model runs away from the recording however little there is of the terms.
    """
    start = Start(tuple(found), linear or case.innovations.linear, case.innovations.terms)
    return fullest(case, [start])[1]


def fullest(case: Case, rivals: Sequence[Start]) -> tuple[int, Augmented]:
    """Fit rivals side by side; which of them explains most, its parameters paid for, and its model.

    A rival that cannot catch up any more, by what its next step promises, is not fitted to the end.

    Parameters
    ----------
    case : Case
    rivals : sequence of Start

    Raises
    ------
    Diverged
        If all of them run away from the recording.
    """
    climbs = [_Climb(case, start) for start in rivals]
    racing = climbs
    while racing:
        each(_Climb.step, racing)
        ahead = min(climb.cost for climb in climbs)
        racing = [climb for climb in racing if climb.steps_left and climb.hope <= ahead]
    number = min(range(len(climbs)), key=lambda i: climbs[i].cost)
    return number, climbs[number].augmented()


def as_it_stands(case: Case, augmented: Augmented) -> Augmented:
    """A model that was fitted to one recording, on another one, with every parameter as it is.

    Parameters
    ----------
    case : Case
        Of the other recording.
    augmented : Augmented
        Model whose terms act all along.

    Raises
    ------
    Diverged
        If the model runs away from that recording.
    """
    terms, found = augmented.system.terms, len(augmented.parameters)
    climb = _Climb(case, Start(terms[-found:], augmented.innovations.linear, terms[:-found]))
    climb.here = _fitted(case, climb.model)
    return climb.augmented()


class _Climb:
    """Gauss-Newton steps of one model, until it stays."""

    def __init__(self, case: Case, start: Start) -> None:
        self.case, self.found, self.price_nats = case, len(start.found), start.price_nats
        before = start.before
        if any(applied.term.chip_thickness for applied in start.found):  # it stands for the delay whose chip never ends
            before = tuple(applied for applied in before if not applied.term.delayed)
        linear = replace(start.linear, noise=max(start.linear.noise, _LEAST_NOISE))
        _, sd_v = scales(case.innovations.motion)
        self.model = _Model(linear, (*before, *start.found), len(before), _NARROWEST * sd_v, start.between_s)
        self.here: _Fitted | None = None
        self.steps_left = STEPS

    @property
    def cost(self) -> float:
        """What is left to explain, the price of the parameters, and how far the damping is from what is known of it."""
        if self.here is None:
            return math.inf
        ratio = self.model.linear.modes[0].damping_ratio / self.case.system.modes[0].damping_ratio
        surprise = math.log1p((math.log(ratio) / DAMPING_KNOWN) ** 2)
        return self.here.loss + self.price_nats + self._price(self.here.sd) + surprise

    def _price(self, sd: Vector) -> float:
        """Of the parameters; a coefficient that explains less than its price beside another is as good as left out."""
        model = self.model
        spare = 0.0
        for number in range(model.first, len(model.terms)):
            linear = {p.name for p in model.terms[number].term.parameters if p.linear}
            sds = [(k, own) for k, own in zip(model.knobs, sd, strict=False) if k.term == number]
            explain = [0.5 * (model.value(knob) / own) ** 2 for knob, own in sds if knob.name in linear]
            if len(explain) > 1:
                spare += max(PRICE_NATS - min(explain), 0.0)
        return PRICE_NATS * sum(knob.term is not None for knob in model.knobs) - spare

    @property
    def hope(self) -> float:
        """Cost that it may come down to."""
        return self.cost - _HOPE * self.here.promised if self.here else -math.inf

    def step(self) -> None:
        """Go where the last regression leads, if that is down."""
        self.steps_left -= 1
        if self.here is None:
            if self.steps_left < STEPS - 1:  # too much of it even to begin with
                self.model = self.model.softened()
            self.here = _fitted(self.case, self.model)
            return
        there = None
        if self.here.promised >= _SETTLED_NATS:
            for damping in _DAMPINGS:
                moved = self.model.moved(self.here.change(damping))
                there = _fitted(self.case, moved, self.here)
                if there is not None:
                    break
        if there is None or self.here.loss - there.loss < _SETTLED_NATS:
            self.steps_left = 0
        if there is not None:
            self.model, self.here = moved, there

    def augmented(self) -> Augmented:
        """The model as it is now."""
        model, here = self.model, self.here
        if here is None:
            raise Diverged("the model with the terms that were found runs away")
        parameters: list[dict[str, tuple[float, float]]] = [{} for _ in range(self.found)]
        for knob, sd in zip(model.knobs, here.sd, strict=False):
            if knob.term is not None:
                parameters[knob.term - model.first][knob.name] = (model.value(knob), float(sd))
        gain = _loss(self.case.innovations, self.case.weight) - here.loss
        system = calibrated(self.case, model.linear, model.terms)
        damping_sd = next((float(sd) for k, sd in zip(model.knobs, here.sd, strict=False) if k == _DAMPING), 0.0)
        of_terms = [knob.term is not None for knob in model.knobs]
        columns, besides = [], []
        for number, column in enumerate(here.columns):
            if column.any():
                columns.append(column)
                besides += [] if number < len(of_terms) and of_terms[number] else [column]
        return Augmented(system, here.innovations, parameters, columns, besides, gain, damping_sd, self.cost)


@dataclass(frozen=True, slots=True)
class _Knob:
    """A parameter that is fitted: of a term, of the mode, or the logarithm of the sensor's noise."""

    name: str
    term: int | None = None


_DAMPING = _Knob("damping_ratio")


@dataclass(frozen=True, slots=True)
class _Model:
    """A linear machine with terms, of which those from `first` on are fitted together with its mode.

    They act between two times. No velocity over which a term of theirs fades falls below `narrowest`.
    """

    linear: Linear
    terms: tuple[AppliedTerm, ...]
    first: int
    narrowest: float
    between_s: tuple[float, float]

    @property
    def partial(self) -> bool:
        """Whether what is fitted acts in a part of the recording, or above an amplitude, only."""
        fitted = self.terms[self.first :]
        return self.between_s != _ALWAYS or any(ABOVE.name in applied.parameters for applied in fitted)

    @property
    def knobs(self) -> list[_Knob]:
        """What is fitted; several modes stay as they are."""
        free = [_Knob("frequency_hz"), _DAMPING, _Knob("noise")] if len(self.linear.modes) == 1 else []
        for number, applied in enumerate(self.terms[self.first :], self.first):
            for parameter in applied.term.parameters:
                value = applied.parameters.get(parameter.name, parameter.default or 0.0)
                if parameter.linear or (value != 0.0 and parameter.name not in _AS_GIVEN):
                    free.append(_Knob(parameter.name, number))
        return free

    def value(self, knob: _Knob) -> float:
        """Of a parameter."""
        if knob.name == "noise":
            return math.log(self.linear.noise)
        if knob.term is None:
            return float(getattr(self.linear.modes[0], knob.name))
        return self.terms[knob.term].parameters[knob.name]

    def _nudge(self, knob: _Knob, inn: Innovations) -> float:
        """Change of a parameter over which its slope is taken."""
        if knob.name == "noise":
            return _NOISE_STEP
        value = abs(self.value(knob))
        if knob.term is None:
            width = self.linear.modes[0].damping_ratio if knob.name == "frequency_hz" else 1.0
            return _DERIVATIVE_STEP * width * value
        if value == 0.0:  # as much as makes a small part of the restoring force
            applied = self.terms[knob.term]
            restoring = inn.observer.omega**2 * float(np.std(inn.motion.x[0]))
            value = restoring / float(np.std(inn.force(applied.term, applied.units[knob.name])[0]))
            return _DERIVATIVE_STEP**2 * value
        return _DERIVATIVE_STEP * value

    def turned(self, knob: _Knob, change: float) -> _Model:
        """The model with one parameter changed, as far as its bounds allow."""
        before = self.value(knob)
        if knob.name == "noise":
            step = min(max(change, -_LARGEST_NOISE_STEP), _LARGEST_NOISE_STEP)
            return replace(self, linear=replace(self.linear, noise=max(math.exp(before + step), _LEAST_NOISE)))
        if knob.term is None:
            low, high = (1e-5, 0.9) if knob.name == "damping_ratio" else (0.5 * before, 2.0 * before)
            mode = replace(self.linear.modes[0], **{knob.name: min(max(before + change, low), high)})
            return replace(self, linear=self.linear.retuned(mode))
        applied = self.terms[knob.term]
        parameter = next(p for p in applied.term.parameters if p.name == knob.name)
        if not parameter.linear:
            change = min(max(change, -_LARGEST_STEP * abs(before)), _LARGEST_STEP * abs(before))
        fades = parameter.unit == "u/s" and parameter.lower_excluded
        after = min(max(before + change, self.narrowest if fades else parameter.lower), parameter.upper)
        values = {**applied.parameters, knob.name: after if parameter.allows(after) else before}
        terms = list(self.terms)
        terms[knob.term] = AppliedTerm(applied.term, values)
        return replace(self, terms=tuple(terms))

    def holds(self, knob: _Knob, change: float) -> bool:
        """Whether a bound forbids a parameter to change at all in that direction."""
        return self.turned(knob, change).value(knob) == self.value(knob)

    def moved(self, change: Vector) -> _Model:
        """The model after a Gauss-Newton step."""
        model = self
        for knob, step in zip(self.knobs, change, strict=False):
            model = model.turned(knob, float(step))
        return model

    def softened(self) -> _Model:
        """Half as much of each term."""
        return replace(self, terms=(*self.terms[: self.first], *map(_softened, self.terms[self.first :])))

    def innovations(self, recorded: Recorded, error_sd: float, taps: Vector | None = None) -> Innovations:
        """On a recording."""
        between_s = [_ALWAYS] * self.first + [self.between_s] * (len(self.terms) - self.first)
        return Innovations(recorded, self.linear, self.terms, taps, error_sd, between_s)

    def slope(self, knob: _Knob, inn: Innovations, error_sd: float) -> Vector:
        """What one unit less of a parameter adds to the whitened errors, the filter's idea of their size unchanged."""
        nudge = self._nudge(knob, inn)
        other = self.turned(knob, nudge)
        if self.holds(knob, nudge):
            other = self.turned(knob, -nudge)
        changed = other.innovations(inn.recorded, error_sd, inn.taps)
        return np.asarray((inn.white - changed.white) / (other.value(knob) - self.value(knob)))


@dataclass(frozen=True, slots=True, eq=False)
class _Fitted:
    """A model on the recording, and where the next Gauss-Newton step would take it.

    `normal` and `right` are the equations of the free knobs, all else fitted beside them.
    """

    innovations: Innovations
    loss: float
    columns: list[Vector]
    sd: Vector
    free: list[int]
    normal: NDArray[np.float64]
    right: Vector

    @property
    def promised(self) -> float:
        """Gain of the undamped step if everything were linear, nats."""
        return 0.5 * float(self.right @ np.linalg.solve(self.normal, self.right))

    def change(self, damping: float) -> Vector:
        """Step of all knobs."""
        step = np.zeros(self.sd.size)
        damped = self.normal + damping * np.diag(np.diag(self.normal))
        step[self.free] = np.linalg.solve(damped, self.right)
        return step


def _fitted(case: Case, model: _Model, beat: _Fitted | None = None) -> _Fitted | None:
    """Look at a model; None if it runs away from the recording, or does not beat another."""
    error_sd = (beat.innovations if beat else case.innovations).error_sd
    weight = case.weight
    try:
        inn = model.innovations(case.recorded, error_sd)
        loss = _loss(inn, weight)
        if beat and loss >= beat.loss:
            return None
        columns = each(lambda knob: model.slope(knob, inn, error_sd), model.knobs)
    except Diverged:
        return None
    columns += [case.matrix[i] for i in _nuisance(case, model)]
    # The whitener is fitted anew to every model, so its taps are parameters as well; their slopes are errors before.
    earlier = np.concatenate([np.zeros(ORDER), inn.errors])
    columns += [earlier[ORDER - lag : -lag] for lag in range(1, ORDER + 1)]
    evidence = Evidence(inn.white, columns, weight, [], case.evidence.block)
    total = evidence.over(evidence.everything)
    knobs = len(model.knobs)
    free, others = list(range(knobs)), list(range(knobs, len(columns)))
    normal, right = _beside(total, free, others)
    inverse = np.linalg.inv(normal)
    # What stands at a bound and pushes against it stays there, and the others go where they would without it.
    held = [i for i, by in enumerate(inverse @ right) if model.holds(model.knobs[i], float(by))]
    if held:
        free = [i for i in free if i not in held]
        normal, right = _beside(total, free, others + held)
    return _Fitted(inn, loss, columns, np.sqrt(np.diag(inverse)), free, normal, right)


def _nuisance(case: Case, model: _Model) -> list[int]:
    """Nuisance columns but those that parameters stand for, or whose part of the base is not in the model.

    A step goes where the errors fall with all of these columns beside it: one that the model does not have takes the
    way from a parameter that does the same.
    """
    stood_for = set(case.columns["retuning"][:2])
    if case.local is not None and model.partial:
        stood_for.update(case.columns["local"][: len(case.local.units)])
    if len(model.linear.modes) == 1:
        stood_for.update(case.columns.get("modes", []))
    if not any(applied.term.delayed for applied in model.terms[: model.first]):
        stood_for.update(case.columns.get("lagged", []))
    return [i for i in case.evidence.nuisance if i not in stood_for]


def _beside(total: NDArray[np.float64], columns: list[int], others: list[int]) -> tuple[NDArray[np.float64], Vector]:
    """Normal equations of some columns once others are fitted beside them."""
    i, o = np.array(columns, dtype=np.int64) + 1, np.array(others, dtype=np.int64) + 1
    zero_and = np.concatenate([[0], i])  # the errors and the columns
    # A shape that changes nothing has no slope: it stays, and its interval is as good as without end.
    size = np.sqrt(np.where(np.diag(total) > 0.0, np.diag(total), 1.0))
    scaled = total / np.outer(size, size) + 1e-9 * np.eye(size.size)
    projection = np.linalg.solve(scaled[np.ix_(o, o)], scaled[np.ix_(o, zero_and)])
    rest = scaled[np.ix_(i, zero_and)] - scaled[np.ix_(i, o)] @ projection
    return rest[:, 1:] * np.outer(size[i], size[i]), rest[:, 0] * size[i] * size[0]


def _softened(applied: AppliedTerm) -> AppliedTerm:
    """Half as much of a term."""
    half = {p.name: 0.5 * applied.parameters[p.name] for p in applied.term.parameters if p.linear}
    return AppliedTerm(applied.term, {**applied.parameters, **half})


def _loss(inn: Innovations, weight: Vector) -> float:
    rest = inn.white * weight
    count = np.count_nonzero(weight)
    return 0.5 * count * math.log(float(rest @ rest) / count)


def calibrated(case: Case, linear: Linear, terms: Sequence[AppliedTerm]) -> MachiningSystem:
    """A system with calibrated modes, intensity and noise, for `simulate`."""
    fitted = case.base.fitted
    intensity = math.exp(fitted.level) / (4.0 * math.pi)  # one-sided density in Hz of W is 4 pi S0
    noise = abs(case.system.sensor.gain) * math.sqrt(fitted.noise_density * 0.5 * case.whole.rate_hz)
    kind = case.system.excitation.kind
    excitation = replace(case.system.excitation, intensity=intensity) if kind != "measured" else Excitation("measured")
    sensor = replace(case.system.sensor, quantity=linear.quantity, noise_rms=noise)
    return MachiningSystem(linear.modes, tuple(terms), excitation, linear.spindle, sensor)
