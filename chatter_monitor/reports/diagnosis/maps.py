"""Where recording and base model differ: all maps in one picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import signal as dsp

from chatter_monitor.discrepancy.basis import REACH, scales, surface_at
from chatter_monitor.discrepancy.case import Case, Local
from chatter_monitor.discrepancy.locate import frequency_map, lag_map
from chatter_monitor.reports.diagnosis.drawing import AUGMENTED, RECORDED, figure_of, titled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PIXELS = 400  # of the width of an axis, about


def maps(case: Case) -> str:
    """Picture of the maps over time, frequency, phase plane, amplitude, lag and angle, as HTML."""
    inn = case.innovations
    figure, axes = figure_of(2)
    p = {each.name: each.p_value for each in case.maps}
    white, used = inn.white * case.weight, inn.used
    rate = case.recorded.rate_hz
    block = max(1, round(0.25 * rate))
    count = white.size // block
    local = np.mean(white[: count * block].reshape(count, block) ** 2, axis=1)
    axes[0].plot((np.arange(count) + 0.5) * block / rate, local, color=RECORDED, lw=1)
    axes[0].set(
        xlabel="time, s", ylabel="mean square of the errors", title=f"time, p = {p['time']:.2g}", ylim=(0, None)
    )
    if case.local is not None and case.local.between_s is not None:
        axes[0].axvspan(*case.local.between_s, color=AUGMENTED, alpha=0.12, lw=0)
        _draw_explained(axes[0], case, case.local, block)
    _, f, ratio = frequency_map(case.base.spectrum, case.base.fitted)
    axes[1].plot(f, 10.0 * np.log10(ratio), color=RECORDED)
    axes[1].set(xlabel="Hz", ylabel="recording over base, dB", title=f"frequency, p = {p['frequency']:.2g}")
    _draw_plane(axes[2], case, p["phase_plane"])
    _draw_amplitude(axes[3], case, p["amplitude"])
    _, lags, correlation = lag_map(inn.white, used, rate)
    axes[4].plot(1e3 * lags, correlation, color=RECORDED, lw=0.6)
    if inn.linear.spindle is not None:
        axes[4].axvline(1e3 * inn.linear.spindle.delay_s, color=AUGMENTED, ls="--", lw=0.8)
    axes[4].set(xlabel="lag, ms", ylabel="correlation, standard deviations", title=f"lag, p = {p['lag']:.2g}")
    _draw_angle(axes[5], case, p["angle"])
    return titled(figure, "Where they differ")


def _draw_explained(axes: Axes, case: Case, local: Local, block: int) -> None:
    """What a force that acts in a stretch explains up to each time if it is taken to act all along.

    It rises where the force acts and falls where it does not.
    """
    retuning = case.columns["retuning"][:2]
    everywhere = [retuning[i] for i in local.changed]
    if local.candidate is not None:
        of_it = next(columns for candidate, columns in case.contest.entries if candidate == local.candidate)
        everywhere = [of_it[local.candidate.linear.index(i)] for i in local.units]
    columns = [*retuning, *case.columns["local"][: len(everywhere)]]
    errors, weighted = case.innovations.white * case.weight, case.matrix[columns] * case.weight
    coefficients = np.linalg.lstsq(weighted.T, errors, rcond=None)[0]
    errors = errors - coefficients[: len(retuning)] @ weighted[: len(retuning)]
    force = coefficients[len(retuning) :] @ (case.matrix[everywhere] * case.weight)
    gain = np.cumsum(force * (errors - 0.5 * force))[::block]
    beside = axes.twinx()
    at = np.arange(gain.size) * block / case.recorded.rate_hz
    beside.plot(at, gain, color=AUGMENTED, lw=1, label="nats that the force explains up to then")
    beside.tick_params(axis="y", direction="in", pad=-6, labelcolor=AUGMENTED)
    for label in beside.get_yticklabels():
        label.set_horizontalalignment("right")
    beside.legend(fontsize="small", loc="lower left")


def _draw_plane(axes: Axes, case: Case, p: float) -> None:
    axis = np.linspace(-REACH, REACH, 61)
    x, v = np.meshgrid(axis, axis, indexing="ij")
    force = surface_at(case.ceiling.coefficients, x, v)
    weight = np.exp(-0.5 * (x**2 + v**2))
    design = np.stack([np.ones_like(x), x, v]).reshape(3, -1)
    beta = np.linalg.solve((design * weight.ravel()) @ design.T, (design * weight.ravel()) @ force.ravel())
    force = np.where(np.hypot(x, v) < REACH, force - (beta @ design).reshape(x.shape), np.nan)
    sd_x, _ = scales(case.innovations.motion)
    relative = 100.0 * force / (case.innovations.linear.modes[0].omega ** 2 * sd_x)
    top = float(np.nanmax(np.abs(relative)))
    drawn = axes.pcolormesh(axis, axis, relative.T, cmap="RdBu_r", vmin=-top, vmax=top, shading="auto")
    bar = axes.figure.colorbar(drawn, ax=axes, pad=0.1, label="force, % of rms restoring force")
    bar.ax.yaxis.set_label_position("left")  # however long the numbers on its right are
    axes.set(xlabel="x / rms", ylabel="x' / rms", title=f"phase plane: force nothing linear makes, p = {p:.2g}")


def _draw_amplitude(axes: Axes, case: Case, p: float) -> None:
    motion = case.innovations.motion
    sd_x, sd_v = scales(motion)
    # As predicted from the samples before: an amplitude that has seen the error would choose it.
    used = case.weight > 0.0
    amplitude = np.roll(np.hypot(motion.x[1] / sd_x, motion.v[1] / sd_v), 1)[used]
    edges = np.quantile(amplitude, np.linspace(0.0, 1.0, 13))
    inside = np.digitize(amplitude, edges[1:-1])
    weighted = (case.innovations.white * case.weight)[used]
    for column, label, color in ((0, "stiffness", RECORDED), (1, "damping", AUGMENTED)):
        s = (case.matrix[column] * case.weight)[used]
        information = np.bincount(inside, s * s, 12)
        value = np.bincount(inside, s * weighted, 12) / information
        centre = np.bincount(inside, amplitude, 12) / np.bincount(inside, minlength=12)
        w = case.innovations.linear.modes[0].omega
        unit = w * w if column == 0 else 2.0 * case.innovations.linear.modes[0].damping_ratio * w
        axes.errorbar(centre, 100 * value / unit, 196 / np.sqrt(information) / unit, fmt=".-", color=color, label=label)
    axes.axhline(0.0, color="0.6", lw=0.8)
    if case.local is not None and case.local.threshold is not None:
        axes.axvspan(case.local.threshold.above / sd_x, edges[-1], color=AUGMENTED, alpha=0.15, lw=0)
    axes.set(xlabel="amplitude / rms", ylabel="change, %", title=f"amplitude, p = {p:.2g}")
    axes.legend(fontsize="small")


def _draw_angle(axes: Axes, case: Case, p: float) -> None:
    s = case.matrix[0] * case.weight
    product = (case.innovations.white * case.weight) * s
    f, density = dsp.periodogram(product - product.mean(), case.recorded.rate_hz)
    top = f < 2.5 * case.innovations.linear.modes[0].frequency_hz
    # a line of so many pixels shows the largest of each few
    groups = np.array_split(np.arange(np.sum(top)), _PIXELS)
    highest = [g[np.argmax(density[g])] for g in groups if g.size]
    axes.plot(f[highest], density[highest] / np.median(density[top]), color=RECORDED, lw=0.7)
    if case.innovations.linear.spindle is not None:
        turn = case.innovations.linear.spindle.speed_rpm / 60.0
        for order in range(1, min(9, int(f[top][-1] / turn) + 1)):
            axes.axvline(order * turn, color=AUGMENTED, ls=":", lw=0.6)
    axes.set(xlabel="Hz", ylabel="swing of the stiffness / median", title=f"angle, p = {p:.2g}", yscale="log")
    axes.set_ylim(bottom=1.0)
