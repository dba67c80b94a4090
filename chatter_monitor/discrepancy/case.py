"""A recording beside a model, and everything that is found about the two on the way."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.candidates import Candidate
from chatter_monitor.discrepancy.ceiling import Surface
from chatter_monitor.discrepancy.delayed import Echo
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.faults import Clipping, Restlessness
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.linear import Base
from chatter_monitor.discrepancy.locate import Modulation
from chatter_monitor.discrepancy.name import Contest, Scored
from chatter_monitor.discrepancy.report import Alternative, Statistic
from chatter_monitor.discrepancy.tones import Tone
from chatter_monitor.physics.model import MachiningSystem

Vector = NDArray[np.float64]

BLOCK_S = 0.5
LEAST_BLOCKS = 8  # of a short recording, whose blocks are shorter
SURE = 1e-5  # chance that is not believed in


@dataclass(frozen=True, slots=True)
class Threshold:
    """Amplitude sqrt(x^2 + (v / w)^2) above which a force acts.

    Attributes
    ----------
    above : float
        The most likely.
    ci95 : (float, float)
        95 % interval, by the likelihood ratio; it begins at 0 where the force may as well act all along.
    gain_nats : float
        Over the same force acting all along, the amplitude paid for.
    """

    above: float
    ci95: tuple[float, float]
    gain_nats: float

    def __str__(self) -> str:
        low, high = self.ci95
        return f"above an amplitude of {self.above:.3g} u ({low:.3g} to {high:.3g})"


@dataclass(frozen=True, slots=True, eq=False)
class Local:
    """An effect in a part of the recording, or of the amplitudes, only.

    Attributes
    ----------
    candidate : Candidate, optional
        That explains it best; none where a spring and a damper that change do.
    units : tuple of int
        Which of its parameters are the coefficients.
    changed : tuple of int
        Which of spring (0) and damper (1) change there, beside it or without it.
    signatures : list of ndarray of float64, shape (n,)
        Of the units, then of that spring and damper: whitened, and confined to where it acts.
    as_likely : list of Alternative
        Names that explain it about equally, the best first; a name alone is told from the others.
    held_out_nats : float
        Gain on the held-out blocks with the coefficients of the training blocks.
    p_value : float
        Of the held-out blocks.
    between_s : (float, float), optional
        Stretch of the recording in which it acts.
    threshold : Threshold, optional
        Above which it acts.
    """

    candidate: Candidate | None
    units: tuple[int, ...]
    changed: tuple[int, ...]
    signatures: list[Vector]
    as_likely: list[Alternative]
    held_out_nats: float
    p_value: float
    between_s: tuple[float, float] | None = None
    threshold: Threshold | None = None

    @property
    def where(self) -> str:
        """In words."""
        if self.between_s is not None:
            return f"from {self.between_s[0]:.1f} to {self.between_s[1]:.1f} s"
        return str(self.threshold)


@dataclass(eq=False)
class Case:
    """A recording beside a model, and everything that was found on the way.

    Attributes
    ----------
    system : MachiningSystem
        The base model as given, but for coefficients of its forces that do not hold.
    whole, recorded : Recorded
        The recording in units of motion (the gain of the sensor and the mean taken out), and its part within the band.
    but_s : (float, float), optional
        Stretch in which something acts, so that it tells nothing of the machine, the sensor and what excites them.
    uncorrected : MachiningSystem, optional
        The base model as given, if coefficients of its forces do not hold.
    """

    system: MachiningSystem
    whole: Recorded
    recorded: Recorded
    base: Base
    innovations: Innovations
    clipped: Clipping | None = None
    tones: list[Tone] = field(default_factory=list)
    unrest: Restlessness | None = None
    offset_p: float = 1.0
    but_s: tuple[float, float] | None = None
    uncorrected: MachiningSystem | None = None
    evidence: Evidence = field(init=False)
    contest: Contest = field(init=False)
    matrix: NDArray[np.float64] = field(init=False)
    columns: dict[str, list[int]] = field(default_factory=dict)
    named: list[Scored] = field(default_factory=list)
    ranking: list[Scored] = field(default_factory=list)
    ceiling: Surface = field(init=False)
    maps: list[Statistic] = field(default_factory=list)
    rest_maps: list[Statistic] = field(default_factory=list)
    swing: Modulation | None = None
    local: Local | None = None
    threshold: Threshold | None = None
    drift: Statistic | None = None
    echo: Echo | None = None

    def explained(self) -> Vector:
        """Whitened errors less what is named and the nuisance columns."""
        nuisance = self.evidence.nuisance
        columns = [c for scored in self.named for c in scored.columns if c not in nuisance]
        fit = self.evidence.regress(columns)
        return np.asarray(self.innovations.white - fit.all_coefficients @ self.matrix[[*nuisance, *columns]])

    @property
    def telling(self) -> NDArray[np.bool_]:
        """Samples whose errors tell of the machine and of what excites it."""
        at = np.arange(self.recorded.samples.size) / self.recorded.rate_hz
        begin, end = self.but_s or (0.0, 0.0)
        return np.asarray(self.innovations.used & ~((at >= begin) & (at < end)))

    @property
    def block_s(self) -> float:
        """Length of the blocks, every second of which is held out."""
        return min(BLOCK_S, self.recorded.seconds / LEAST_BLOCKS)

    @property
    def block(self) -> int:
        """Samples in a block."""
        return max(1, round(self.block_s * self.recorded.rate_hz))

    @property
    def weight(self) -> Vector:
        """Reciprocal of the standard deviation of every whitened error; 0 for those not to be used."""
        scale = self.unrest.scale if self.unrest else np.std(self.innovations.white)
        return np.asarray(np.where(self.innovations.used, 1.0 / scale, 0.0))

    @property
    def training(self) -> NDArray[np.bool_]:
        """Blocks for training."""
        return np.asarray(np.arange(self.evidence.blocks) % 2 == 0)
