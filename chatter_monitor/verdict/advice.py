"""What to change when a cut chatters: a spindle speed between the lobes, or less depth."""

from __future__ import annotations

import math
from typing import NamedTuple

from chatter_monitor.kernels.delay_roots import critical_coefficient
from chatter_monitor.physics.lobes import Recommendation, recommended_speeds
from chatter_monitor.records import Advice
from chatter_monitor.tracking.spindle import SpindleSettings

MOST_SPEEDS = 3
# A speed is worth going to when the cut may be so much deeper there than at the worst speed. More depth than the
# scatter of damping and stiffness between two parts has to be in it.
WORTH_IT = 1.5
# Golden section, and how exact the waves between two teeth are told.
GOLDEN, EXACT_WAVES = 0.5 * (math.sqrt(5.0) - 1.0), 1e-6
# Damping taken for granted where the mode is not known.
USUAL_DAMPING = 0.03
# Range of the spindle, relative to its present speed, where the machine's is not configured.
USUAL_RANGE = (0.5, 2.0)
# A speed so near to the present one is the present one.
SAME_SPEED = 0.01


class Structure(NamedTuple):
    """The mode that chatters, without the cut: frequency and damping ratio, as the margin knows them."""

    frequency_hz: float
    damping_ratio: float


def advise(
    chatter_hz: float, spindle: SpindleSettings, structure: Structure | None = None, kappa: float | None = None
) -> Recommendation:
    """Speeds at which a harmonic of the tooth passing meets the vibration, nearest first, and the same in words.

    Between two lobes the wave that a tooth meets is nearly in phase with the one that it leaves, and the cut may be
    deepest. With the structure known, each speed is moved to where the limit is largest; the rule 60 f / (N k) alone
    puts it a little too far up the next lobe.

    Parameters
    ----------
    chatter_hz : float
        Frequency of the chatter.
    spindle : SpindleSettings
        Present speed, teeth and range of the machine, where known.
    structure : Structure, optional
        The mode, if it was heard before the chatter.
    kappa : float, optional
        Process stiffness over modal stiffness, if it was heard; only speeds that are stable with it are given.

    Returns
    -------
    Recommendation
        At most three speeds; none, with the reason, where less depth is the better way.
    """
    reach = _reach(spindle)
    if reach is None:
        return Recommendation((), "no speed can be advised: neither the spindle's speed nor its range is known")
    damping_ratio = structure.damping_ratio if structure else USUAL_DAMPING
    around = f"between {reach[0]:.0f} and {reach[1]:.0f} rpm"
    # the correction below may bring speeds in that were just outside
    margin = 1.0 + damping_ratio
    candidates = recommended_speeds(chatter_hz, spindle.teeth, reach[0] / margin, reach[1] * margin).speeds
    speeds = [_between_lobes(advice, spindle.teeth, structure) for advice in candidates]
    speeds = [advice for advice in speeds if reach[0] <= advice.spindle_rpm <= reach[1]]
    if not speeds:
        return Recommendation(
            (), f"no speed {around} brings the teeth into step with {chatter_hz:.0f} Hz: reduce the depth"
        )
    worth = [advice for advice in speeds if deepest(damping_ratio, advice.lobe) >= WORTH_IT * shallowest(damping_ratio)]
    if not worth:
        waves = min(advice.lobe for advice in speeds)
        return Recommendation(
            (),
            f"reduce the depth of cut: with {waves} waves or more between two teeth the lobes overlap {around}, and no"
            f" speed allows {100 * (WORTH_IT - 1):.0f} % more at {100 * damping_ratio:.1f} % damping",
        )
    here = spindle.speed_rpm
    if here is not None:
        occupied = [advice.lobe for advice in worth if abs(advice.spindle_rpm / here - 1.0) < SAME_SPEED]
        # too deep for this lobe is too deep for those that are lower
        worth = [advice for advice in worth if not occupied or advice.lobe < min(occupied)]
        worth.sort(key=lambda advice: abs(advice.spindle_rpm - here))
    if kappa is not None:
        worth = [advice for advice in worth if deepest(damping_ratio, advice.lobe) > kappa]
    if not worth:
        return Recommendation((), f"reduce the depth of cut: it is too deep for every speed {around}")
    chosen = tuple(worth[:MOST_SPEEDS])
    listed = " or ".join(f"{advice.spindle_rpm:.0f} rpm" for advice in chosen)
    known = "heard" if structure else "taken for granted"
    return Recommendation(
        chosen,
        f"{listed}: the teeth pass in step with the vibration at {chatter_hz:.0f} Hz. Assumes a single mode with"
        f" {100 * damping_ratio:.1f} % damping ({known}), the same at every speed, and evenly spaced teeth",
    )


def shallowest(damping_ratio: float) -> float:
    """Least kappa that chatters at the worst speed: 2 zeta (1 + zeta) (Tlusty)."""
    return 2.0 * damping_ratio * (1.0 + damping_ratio)


def deepest(damping_ratio: float, lobe: int) -> float:
    """Limit of kappa at the best speed with about so many waves between two teeth."""
    return float(critical_coefficient(1.0, damping_ratio, 2.0 * math.pi * _best_waves(damping_ratio, lobe)))


def _best_waves(damping_ratio: float, lobe: int) -> float:
    """Waves of the undamped mode between two teeth where the limit is largest, between the bottoms of two lobes.

    At the bottoms r^2 = 1 + 2 zeta, where the phase of the vibration is a quarter of a turn away from whole waves.
    """
    low, high = (lobe - 0.25) / (1.0 + damping_ratio), (lobe + 0.75) / (1.0 + damping_ratio)
    while high - low > EXACT_WAVES:  # golden section: there is one top between two bottoms
        step = GOLDEN * (high - low)
        left, right = (critical_coefficient(1.0, damping_ratio, 2.0 * math.pi * w) for w in (high - step, low + step))
        low, high = (low, low + step) if left > right else (high - step, high)
    return 0.5 * (low + high)


def _between_lobes(rule: Advice, teeth: int, structure: Structure | None) -> Advice:
    if structure is None:
        return rule
    waves = _best_waves(structure.damping_ratio, rule.lobe)
    return Advice(spindle_rpm=60.0 * structure.frequency_hz / (teeth * waves), lobe=rule.lobe)


def _reach(spindle: SpindleSettings) -> tuple[float, float] | None:
    """Speeds to choose from."""
    here = spindle.speed_rpm
    low = spindle.min_rpm if spindle.min_rpm is not None else here and USUAL_RANGE[0] * here
    high = spindle.max_rpm if spindle.max_rpm is not None else here and USUAL_RANGE[1] * here
    return None if low is None or high is None or low > high else (low, high)
