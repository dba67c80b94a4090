"""What is said about a running signal beside a simulation, and which missing force the evidence names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import chdtrc, chdtri

from chatter_monitor.discrepancy.all_along import REST_NATS, REST_SHARE
from chatter_monitor.discrepancy.candidates import Candidate
from chatter_monitor.discrepancy.findings import SENSES
from chatter_monitor.discrepancy.live.refit import Refit
from chatter_monitor.discrepancy.live.windows import Rest
from chatter_monitor.discrepancy.name import PRICE_NATS
from chatter_monitor.discrepancy.report import Verdict
from chatter_monitor.physics.parts import Mode

# A test of one column every half a second for each of the windows (`watch`) makes 2 million in eight hours.
SURE = 3e-8
_LEAST_NATS = 0.5 * float(chdtri(1, SURE))  # of one column


@dataclass(frozen=True, slots=True)
class Found:
    """How simulation and signal stand to each other.

    Attributes
    ----------
    outcome : str
        As of a diagnosis.
    since : int
        Sample from which the evidence comes.
    effect, sense : str or None
        What the signal shows that the simulation lacks.
    parameters : dict of str to float
        Its parameters, named as in model files.
    evidence_nats : float
        For it, over the calibrated base; for "parameters", of the fitted ones over those of the model file.
    runner_up : str or None
        What explains the signal next best.
    distance_nats : float or None
        By how much less.
    band_hz : (float, float) or None
        Where in frequency it shows.
    amplitude : float or None
        rms displacement of the tool meanwhile, in the model's unit.
    """

    outcome: Verdict
    since: int
    effect: str | None = None
    sense: str | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    evidence_nats: float = 0.0
    runner_up: str | None = None
    distance_nats: float | None = None
    band_hz: tuple[float, float] | None = None
    amplitude: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """A missing force.

    Attributes
    ----------
    candidate : Candidate
    columns : list of int
        Of its coefficients, as far as they are not at their bounds.
    coefficients : list of float
        All of them.
    evidence_nats : float
        Gain less the price of the parameters.
    runner_up : (str, float) or None
    strange : bool
        What it leaves unexplained is too much.
    """

    candidate: Candidate
    columns: list[int]
    coefficients: list[float]
    evidence_nats: float
    runner_up: tuple[str, float] | None
    strange: bool

    @property
    def sense(self) -> str | None:
        """Which of two."""
        positive, negative = SENSES.get(self.candidate.name, (None, None))
        return positive if self.coefficients[0] >= 0.0 else negative


def nonlinear(
    rest: Rest,
    entries: Sequence[tuple[Candidate, list[int]]],
    favourite: str | None,
    margin_nats: float,
) -> Named | None:
    """Name the force that explains most of some errors, if any does beyond chance.

    Parameters
    ----------
    rest : Rest
        Of errors and signatures.
    entries : sequence of (Candidate, list of int)
        With the columns of their coefficients.
    favourite : str, optional
        What was named last: another one has to beat it by `margin_nats`.
    """
    gains = rest.gains
    # Two coefficients together may do what neither does alone.
    if 4.0 * gains.max() < _LEAST_NATS:
        return None
    best: dict[str, tuple[float, Candidate, list[int], list[int]]] = {}
    for candidate, columns in entries:
        gain, left = rest.bounded(columns, candidate.lower, PRICE_NATS)
        score = gain - PRICE_NATS * candidate.shapes
        if left and (candidate.name not in best or score > best[candidate.name][0]):
            best[candidate.name] = score, candidate, columns, left
    ranking = sorted(best.values(), key=lambda each: -each[0])
    if not ranking:
        return None
    leader = next(
        (each for each in ranking if each[1].name == favourite and ranking[0][0] - each[0] < margin_nats), ranking[0]
    )
    score, candidate, columns, left = leader
    gain, fitted = rest.regress(left)
    if chdtrc(len(left), 2.0 * gain) > SURE:
        return None
    values = dict(zip(left, fitted, strict=True))
    others = [each for each in ranking if each[1].name != candidate.name and each[3] != left]
    runner_up = (others[0][1].name, others[0][0]) if others else None
    # What shares a column with it is the same force, a little different: friction that is less sharp, another gap.
    kin = {column for c, several in entries if c.name == candidate.name or {*several} & {*left} for column in several}
    more = np.delete(rest.beside(left).gains, list(kin)).max()
    strange = bool(more > max(REST_NATS, REST_SHARE * gain) and more > _LEAST_NATS)
    coefficients = [float(values.get(column, 0.0)) for column in columns]
    return Named(candidate, left, coefficients, score, runner_up, strange)


def of_force(named: Named, since: int, amplitude: float) -> Found:
    """A missing force as a finding; one that leaves too much unexplained is not named."""
    name, nats = named.runner_up or (None, None)
    distance = None if nats is None else named.evidence_nats - nats
    if named.strange:
        evidence = named.evidence_nats
        return Found("unknown", since, None, None, {}, evidence, named.candidate.name, None, None, amplitude)
    parameters = named.candidate.with_coefficients(named.coefficients)
    effect = named.candidate.name
    return Found(
        "missing_physics", since, effect, named.sense, parameters, named.evidence_nats, name, distance, None, amplitude
    )


def of_omission(refit: Refit, since: int) -> Found:
    """What linear the model lacks as a finding; regeneration at another speed is one of the parameters."""
    linear, rival = refit.linear, refit.runner_up
    outcome: Verdict = "missing_physics"
    effect, band = refit.omission, None
    parameters: dict[str, float] = {}
    if refit.omission == "second_mode":
        added = linear.modes[-1]
        parameters = {
            "frequency_hz": added.frequency_hz,
            "damping_ratio": added.damping_ratio,
            "participation": abs(added.participation),
        }
        band = _band(added)
    elif linear.delay_s is not None and linear.spindle is not None:
        speed_rpm = 60.0 / (linear.spindle.teeth * linear.delay_s)
        parameters = {"coefficient": linear.regeneration, "spindle.speed_rpm": speed_rpm}
        outcome = "parameters" if refit.omission == "spindle_speed" else outcome
        effect, band = "regenerative_delay", _band(linear.modes[0])
    name, distance = (rival[0], refit.gain_nats - rival[1]) if rival else (None, None)
    return Found(outcome, since, effect, None, parameters, refit.gain_nats, name, distance, band, refit.rms)


def of_parameters(refit: Refit, since: int) -> Found:
    """Modes that differ from those of the model file as a finding."""
    modes = refit.linear.modes
    parameters: dict[str, float] = {}
    for i, mode in enumerate(modes, 1):
        parameters |= {f"mode.{i}.frequency_hz": mode.frequency_hz, f"mode.{i}.damping_ratio": mode.damping_ratio}
    return Found(
        "parameters", since, None, None, parameters, refit.retuned_nats, None, None, _band(modes[0]), refit.rms
    )


def _band(mode: Mode) -> tuple[float, float]:
    """Half-power band of a mode."""
    return mode.frequency_hz * (1.0 - mode.damping_ratio), mode.frequency_hz * (1.0 + mode.damping_ratio)
