"""The nouns of ``report.json``: what a diagnosis says, in the order in which it is written.

Everything is frozen and of plain numbers and texts, so that it travels as JSON and reads back equal. Evidence and gains
are logarithms of likelihood ratios in nats.
"""

from __future__ import annotations

from typing import Literal

import msgspec

Verdict = Literal["none", "parameters", "missing_physics", "unknown"]
Interval = tuple[float, float]

SCHEMA = "chatter-monitor/diagnosis/1"


class Statistic(msgspec.Struct, frozen=True):
    """A test: its name, its value, and how often chance alone does as much."""

    name: str
    value: float
    p_value: float


class Located(msgspec.Struct, frozen=True):
    """Where recording and simulation differ; what is not located is None or empty.

    Attributes
    ----------
    time_s, band_hz : list of (float, float)
        Stretches of the recording and of the spectrum.
    amplitude : (float, float), optional
        Amplitudes of the displacement between which the difference is, in u.
    state : str, optional
        Where in the plane of displacement and velocity, in words.
    lag_s, order : float, optional
        Lag of the innovations' correlation; multiple of the spindle frequency.
    statistic : Statistic, optional
        The test that speaks most clearly.
    maps : list of Statistic
        One test for each of the maps, of the base model; uniform p-values if the base model explains everything.
    amplitude_ci95 : (float, float), optional
        Where a force acts above an amplitude only: 95 % interval of that amplitude, the first of the two, in u.
    """

    time_s: list[Interval] = []
    band_hz: list[Interval] = []
    amplitude: Interval | None = None
    state: str | None = None
    lag_s: float | None = None
    order: float | None = None
    statistic: Statistic | None = None
    maps: list[Statistic] = []
    amplitude_ci95: Interval | None = None


class Estimate(msgspec.Struct, frozen=True):
    """A parameter with its 95 % interval; u in the unit stands for the unit of displacement."""

    value: float
    ci95: Interval
    unit: str


class Finding(msgspec.Struct, frozen=True):
    """A term that the base model lacks.

    Attributes
    ----------
    name : str
        Of the catalogue of terms, of an excitation or sensor fault, or "force_surface" for a force in no catalogue.
    sense : str, optional
        Which of two senses the term has, such as "hardening".
    parameters : dict of str to Estimate
        Named as in model files.
    evidence_nats : float
        What the recording says for it, over the model without it.
    p_value : float
        Of the held-out test.
    why : str
        A sentence for people.
    """

    name: str
    sense: str | None
    parameters: dict[str, Estimate]
    evidence_nats: float
    p_value: float
    why: str


class Alternative(msgspec.Struct, frozen=True):
    """Another explanation and what the recording says for it."""

    name: str
    evidence_nats: float


class Information(msgspec.Struct, frozen=True):
    """What the recording could tell about a term that was not found.

    Attributes
    ----------
    detectable : float
        Smallest share of the rms restoring force, beyond what a linear spring and damper imitate, that the recording
        would have revealed.
    seconds_for_two_percent : float
        Length of a recording like this one that reveals 2 % of it.
    """

    name: str
    detectable: float
    seconds_for_two_percent: float


class FreeRun(msgspec.Struct, frozen=True):
    """The recording beside simulations that run on their own: (recording, base, augmented)."""

    rms: tuple[float, float, float]
    kurtosis: tuple[float, float, float]
    amplitude_distance_before: float
    amplitude_distance_after: float


class Fit(msgspec.Struct, frozen=True):
    """How well the models predict stretches that no fit has seen; before: the base model, re-calibrated.

    None where the recording allows no statement.
    """

    held_out_s: list[Interval]
    nll_per_sample_before: float | None
    nll_per_sample_after: float | None
    gain_nats: float
    gain_bits: float
    residual_white_p_before: float | None
    residual_white_p_after: float | None
    psd_distance_db_before: float | None = None
    psd_distance_db_after: float | None = None
    free_run: FreeRun | None = None


class ForceBalance(msgspec.Struct, frozen=True):
    """How well the models account for a measured force; before: the linear model, fitted.

    Attributes
    ----------
    band_hz : float
        End of the band, which holds nearly all of the force.
    residual_before, residual_after : float
        Rms of what is left of the force on held-out stretches, over its rms there.
    free_run_error_before, free_run_error_after : float, optional
        Rms difference between the recording and a simulation that the measured force drives, on held-out stretches,
        over the rms of the recording.
    """

    band_hz: float
    residual_before: float
    residual_after: float
    free_run_error_before: float | None = None
    free_run_error_after: float | None = None


class Calibration(msgspec.Struct, frozen=True):
    """Parameters of the model file before and after they were fitted to the recording."""

    before: dict[str, float]
    after: dict[str, Estimate]


class Compared(msgspec.Struct, frozen=True):
    """One of several recordings beside what they share.

    Attributes
    ----------
    recording : str
        Name of the file.
    speed_rpm, cutting_speed_m_s : float, optional
        Of the cut, as the model file has them.
    verdict : str
        Of this recording alone.
    frequency_hz, damping_ratio : Estimate
        Of the first mode, from this recording alone.
    shared_damping_ratio : float
        What the shared parameters make of the damping ratio in this cut.
    report : str
        Its own report, from the directory of the common one.
    """

    recording: str
    speed_rpm: float | None
    cutting_speed_m_s: float | None
    verdict: Verdict
    frequency_hz: Estimate
    damping_ratio: Estimate
    shared_damping_ratio: float
    report: str


class SelfExcitation(msgspec.Struct, frozen=True):
    """A vibration that excites itself: in the recording, and in the augmented simulation.

    Attributes
    ----------
    frequency_hz, amplitude : float, optional
        While it is strong; amplitude of the displacement in u, None if it does not stay.
    simulated_frequency_hz, simulated_amplitude : float, optional
        Of the augmented simulation, where it stays.
    growth_per_s, model_growth_per_s : float, optional
        Of the characteristic root of the augmented model, and of the model as given; negative is stable.
    rises_s : (float, float), optional
        Stretch in which it rises.
    """

    frequency_hz: float
    amplitude: float | None
    simulated_frequency_hz: float | None
    simulated_amplitude: float | None
    growth_per_s: float | None
    model_growth_per_s: float
    rises_s: Interval | None


class Report(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """The whole answer."""

    verdict: Verdict
    summary: str
    located: Located
    terms: list[Finding]
    alternatives: list[Alternative]
    information: list[Information]
    fit: Fit
    calibration: Calibration
    warnings: list[str] = []
    elapsed_s: float = 0.0
    force_balance: ForceBalance | None = None
    recordings: list[Compared] = []
    self_excitation: SelfExcitation | None = None

    def to_json(self) -> bytes:
        """Text of ``report.json``."""
        return msgspec.json.format(msgspec.json.encode(self), indent=1) + b"\n"
