"""An identification in a few lines of plain words."""

from __future__ import annotations

import math

from chatter_monitor.energy.identification import Identification


def lines(result: Identification) -> list[str]:
    """What was found, how sure, and what stands between it and the truth."""
    stiffness, damping, excitation = result.stiffness, result.damping, result.excitation
    low, high = stiffness.k3_ci95
    if low <= 0.0 <= high:
        nature = "linear as far as this recording can tell"
    else:
        nature = "hardening" if stiffness.k3 > 0.0 else "softening"
    ratios = [100.0 * ratio for ratio in (damping.damping_ratio, *damping.damping_ratio_ci95)]
    left_out = len(stiffness.left_out) + len(damping.left_out)
    text = [
        f"mode        {math.sqrt(max(stiffness.k1, 0.0)) / (2.0 * math.pi):.2f} Hz, band {result.band.low_hz:.0f} to "
        f"{result.band.high_hz:.0f} Hz, {result.seconds:.1f} s used",
        f"stiffness   {nature}; k1 = {_with_interval(stiffness.k1, stiffness.k1_ci95)} 1/s^2, "
        f"k3 = {_with_interval(stiffness.k3, stiffness.k3_ci95)} 1/s^2 per unit^2",
        f"damping     {ratios[0]:.3g} % ({ratios[1]:.3g} to {ratios[2]:.3g} %)",
        f"excitation  {excitation.kind.replace('_', '-')} with {100.0 * excitation.confidence:.0f} % confidence; "
        f"S0 = {_with_interval(damping.s0, damping.s0_ci95)}",
    ]
    if left_out:
        text.append(f"left out    {left_out} zones with too few samples")
    text += [f"note        {warning}" for warning in result.warnings]
    return text


def _with_interval(value: float, interval: tuple[float, float]) -> str:
    return f"{value:.4g} ({interval[0]:.4g} to {interval[1]:.4g})"
