"""Where recording and simulation differ: in time, frequency, amplitude, state, lag and spindle angle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from chatter_monitor.discrepancy.basis import scales, surface_at
from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.in_part.stretch import swing
from chatter_monitor.discrepancy.locate import lag_map
from chatter_monitor.discrepancy.name import HELD_OUT_P
from chatter_monitor.discrepancy.report import Finding, Located

MAPPED_P = HELD_OUT_P  # of a map that nothing explains: as surely as a name


def whereabouts(case: Case, findings: Sequence[Finding], strange: Sequence[str]) -> Located:
    """Put the maps' answers into the coordinates of the machine."""
    maps = case.maps
    significant = [each for each in maps if each.p_value < 1e-3]
    if not findings and not strange:
        return Located(maps=maps, statistic=min(maps, key=lambda each: each.p_value))
    time = [(0.0, round(case.whole.seconds, 3))]
    if case.local is not None and case.local.between_s is not None:
        time = [case.local.between_s]
    bands = [(tone.frequency_hz, tone.frequency_hz) for tone in case.tones]
    for omission in case.base.omissions:
        if "frequency_hz" in omission.parameters:
            f = omission.parameters["frequency_hz"][0]
            width = omission.parameters["damping_ratio"][0] * f
            bands.append((f - width, f + width))
    by_lag = next(each for each in maps if each.name == "lag")
    delayed = any(o.name == "regenerative_delay" for o in case.base.omissions)
    lag_s = None
    if delayed and case.base.linear.delay_s is not None:
        lag_s = case.base.linear.delay_s
    elif case.echo is not None:
        lag_s = case.echo.lag_s
    elif by_lag.p_value < 1e-3:
        _, lags, correlation = lag_map(case.explained(), case.innovations.used, case.recorded.rate_hz)
        lag_s = float(lags[45 + int(np.argmax(np.abs(correlation[45:])))])
    amplitude, state = _where(case)
    threshold, interval = case.local.threshold if case.local is not None else case.threshold, None
    if threshold is not None:
        highest = float(np.max(swing(case.innovations)[0]))
        amplitude, interval = (threshold.above, max(highest, threshold.above)), threshold.ci95
    order = None
    angle = next(each for each in maps if each.name == "angle")
    if angle.p_value < 1e-3 and case.system.spindle is not None and case.swing is not None:
        order = case.swing.frequency_hz / (case.system.spindle.speed_rpm / 60.0)
    if not bands and case.swing is not None and angle.p_value < MAPPED_P:
        bands = [(case.swing.frequency_hz, case.swing.frequency_hz)]
    clearest = min(significant or maps, key=lambda each: each.p_value)
    return Located(time, bands, amplitude, state, lag_s, order, clearest, maps, interval)


def _where(case: Case) -> tuple[tuple[float, float] | None, str | None]:
    """Amplitudes and part of the phase plane in which an unnamed or named static force acts."""
    plane = next(each for each in case.maps if each.name == "phase_plane")
    if plane.p_value > 1e-3:
        return None, None
    sd_x, _ = scales(case.innovations.motion)
    axis = np.linspace(-2.5, 2.5, 41)
    x, v = np.meshgrid(axis, axis, indexing="ij")
    force = surface_at(case.ceiling.coefficients, x, v)
    density = np.exp(-0.5 * (x**2 + v**2))
    design = np.stack([np.ones_like(x), x, v])
    weighted = (design * density).reshape(3, -1)
    beta = np.linalg.solve(weighted @ design.reshape(3, -1).T, weighted @ force.ravel())
    force = force - np.einsum("i,i...->...", beta, design)
    total = float(np.sum(density * force**2))
    odd_x = 0.5 * (force - force[::-1])
    odd_v = 0.5 * (force - force[:, ::-1])
    share_x = float(np.sum(density * np.mean(odd_x, axis=1, keepdims=True) ** 2)) / total
    share_v = float(np.sum(density * np.mean(odd_v, axis=0, keepdims=True) ** 2)) / total
    if share_x > 0.6:
        state = "odd in the displacement: a spring"
    elif share_v > 0.6:
        state = "odd in the velocity: friction or damping"
    elif float(np.sum(density * odd_x**2)) / total < 0.3 and share_v < 0.3:
        state = "even in the displacement: one side differs from the other"
    else:
        state = "in displacement and velocity together"
    amplitude = np.hypot(x, v)
    acting = density * force**2
    energy = [float(np.sum(acting[(amplitude >= a) & (amplitude < a + 0.25)])) for a in np.arange(0.0, 3.0, 0.25)]
    share = np.cumsum(energy) / sum(energy)
    low, high = 0.25 * np.searchsorted(share, 0.1), 0.25 * (np.searchsorted(share, 0.9) + 1)
    return (float(low * sd_x), float(high * sd_x)), state
