"""What the true model of a recording gains on held-out stretches: the yardstick for what a diagnosis may find there."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy import basis
from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.case import BLOCK_S
from chatter_monitor.discrepancy.diagnosis import in_band
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.in_part.stretch import acting
from chatter_monitor.discrepancy.innovations import Diverged, Innovations
from chatter_monitor.discrepancy.linear import calibrate
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.physics.model import MachiningSystem


def gain_of(
    recording: Recorded,
    base: MachiningSystem,
    true: MachiningSystem,
    between_s: tuple[float, float] | None = None,
    above: float | None = None,
) -> float:
    """Log-likelihood ratio of the true model over the re-calibrated base, nats, on held-out blocks.

    Band, blocks and whitening are those of a diagnosis. The truth is told in two ways, of which the better counts:
    to the filter, which then knows true modes and terms with their parameters; and to the regression, as signatures of
    the true terms with their true shapes, coefficients from the training blocks (a force that jumps between the samples
    leaves a filter worse off that pretends to know when). All may re-tune spring and damper on the training blocks.
    A filter knows its terms all along, so that it is not asked about one that acts in part only.

    Parameters
    ----------
    recording : Recorded
    base, true : MachiningSystem
        One mode each, and the same sensor; the true one begins with the terms of the base.
    between_s : (float, float), optional
        Stretch in which the other terms act; all along if not given.
    above : float, optional
        Amplitude above which they act.
    """
    _, recorded = in_band(recording, base)
    fitted = calibrate(recorded, replace(Linear.of(base), spindle=true.spindle)).linear
    before = Innovations(recorded, fitted, base.terms)
    acts = acting(before, between_s, above)
    forces = [
        before.force(applied.term, unit) * acts
        for applied in true.terms[len(base.terms) :]
        for unit in applied.units.values()
    ]
    nll = _held_out_nll(before, before.used)
    gain = nll - _held_out_nll(before, before.used, before.respond(forces))
    if not acts.all():
        return gain
    try:
        after = Innovations(recorded, replace(fitted, modes=true.modes), true.terms)
    except Diverged:
        return gain
    used = before.used & after.used
    return max(gain, _held_out_nll(before, used) - _held_out_nll(after, used))


def _held_out_nll(model: Innovations, used: NDArray[np.bool_], signatures: NDArray[np.float64] | None = None) -> float:
    """Negative log-likelihood of held-out blocks; coefficients and variance are those of the training blocks."""
    columns = basis.retuning(model)
    if signatures is not None:
        columns = np.concatenate([columns, signatures])
    block = max(1, round(BLOCK_S * model.recorded.rate_hz))
    evidence = Evidence(model.white, columns, used.astype(np.float64), range(len(columns)), block)
    training = np.arange(evidence.blocks) % 2 == 0
    fit = evidence.regress([], training)
    variance = 2.0 * evidence.rest(fit, [], training) / float(evidence.samples[training].sum())
    held = float(evidence.samples[~training].sum())
    return 0.5 * held * math.log(variance) + evidence.rest(fit, [], ~training) / variance
