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
from chatter_monitor.discrepancy.innovations import Diverged, Innovations
from chatter_monitor.discrepancy.linear import calibrate
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.physics.model import MachiningSystem


def gain_of(recording: Recorded, base: MachiningSystem, true: MachiningSystem) -> float | None:
    """Log-likelihood ratio of the true model over the re-calibrated base, nats, on held-out blocks.

    Band, blocks and whitening are those of a diagnosis. Both models may re-tune spring and damper on the training
    blocks; the true one has its terms with their true parameters, and its true modes to begin with.

    Parameters
    ----------
    recording : Recorded
    base, true : MachiningSystem
        One mode each, and the same sensor.

    Returns
    -------
    float or None
        None if a filter that knows the truth runs away from the recording.
    """
    _, recorded = in_band(recording, base)
    sensor = base.sensor
    fitted = calibrate(recorded, Linear(base.modes, sensor.quantity, 1e-3, sensor.low_cut_hz, base.spindle)).linear
    try:
        models = [
            Innovations(recorded, fitted, base.terms),
            Innovations(recorded, replace(fitted, modes=true.modes, spindle=true.spindle), true.terms),
        ]
    except Diverged:
        return None
    used = models[0].used & models[1].used
    before, after = (_held_out_nll(model, used) for model in models)
    return before - after


def _held_out_nll(model: Innovations, used: NDArray[np.bool_]) -> float:
    """Negative log-likelihood of held-out blocks; spring, damper and variance are those of the training blocks."""
    columns = basis.retuning(model)
    block = max(1, round(BLOCK_S * model.recorded.rate_hz))
    evidence = Evidence(model.white, columns, used.astype(np.float64), range(len(columns)), block)
    training = np.arange(evidence.blocks) % 2 == 0
    fit = evidence.regress([], training)
    variance = 2.0 * evidence.rest(fit, [], training) / float(evidence.samples[training].sum())
    held = float(evidence.samples[~training].sum())
    return 0.5 * held * math.log(variance) + evidence.rest(fit, [], ~training) / variance
