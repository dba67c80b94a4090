"""A signal through the observer of a base: its blocks, whether they have changed, and the forces that they name.

Forces are most of the work, and most of them are much alike. Where they may rest, a few stand for all (`SCOUTS`), in
the newest part of each block, and name nothing: a window in which a little shows is gone through once more with all
forces, and in the blocks that follow all are tried as long as anything shows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from chatter_monitor.discrepancy.basis import scales
from chatter_monitor.discrepancy.candidates import SHAPES, Candidate, candidates
from chatter_monitor.discrepancy.live.found import Named, nonlinear
from chatter_monitor.discrepancy.live.history import History
from chatter_monitor.discrepancy.live.refit import Refit
from chatter_monitor.discrepancy.live.shapes import of_another_mode
from chatter_monitor.discrepancy.live.stream import Stream
from chatter_monitor.discrepancy.live.windows import FINE_BANDS, Blocks
from chatter_monitor.physics.terms import CATALOGUE

WINDOWS = tuple(1 << k for k in range(8))  # blocks; what is older than the longest is forgotten
CHANGED_P = 1e-6  # of errors that are as before, in one window: an epoch too many in a few shifts, which says nothing
BEFORE = 8  # blocks, at least, that a window is compared with
LEAST_BLOCKS = 2  # of a window that a force is named by
MARGIN_NATS = 3.0  # by which another name has to lead, to be taken
# Of each kind the first that the model does not have: odd and even springs, friction, what else takes energy. Half of
# what any other force of the catalogue leaves in the errors they show as well, of a hysteresis or a cube a third.
SCOUTS = (
    ("cubic_stiffness", "clearance"),
    ("quadratic_stiffness",),
    ("coulomb_friction", "stribeck_friction", "quadratic_damping"),
    ("energy_damping",),
    ("cutting_force_nonlinearity",),
)
# What shows, in one window: a force by itself, or a change. Chance does as much in one of some thousands.
STIR_NATS = 8.0
STIR_P = 1e-4
# Of a block, that scouts are tried in: with ten samples a period some two hundred periods, in which a machine whose
# modes are fast shows no less than a slow one does in a whole block.
NEWEST = 2048
# Fewer shapes than a recording is searched for: the cost is paid at every sample.
COARSE = {
    **SHAPES,
    ("clearance", "gap"): ("x", (0.4, 1.2)),
    ("coulomb_friction", "width"): ("v", (0.0,)),
    ("stribeck_friction", "stribeck_velocity"): ("v", (0.35,)),
    ("hysteresis", "yield_displacement"): ("x", (0.7,)),
    ("hysteresis", "sharpness"): ("1", (0.5,)),
}


@dataclass(eq=False)
class _Look:
    """Blocks that go through the observer once more, for all forces where there were only scouts."""

    stream: Stream
    position: int


class Run:
    """Signal through the observer of a base.

    Parameters
    ----------
    refit : Refit
        The base.
    first : int
        Sample of the first block.
    samples : int
        Of a block; a multiple of `FEW`.
    rate_hz : float

    Attributes
    ----------
    refit : Refit
    may_rest : bool
        Whether forces may rest while nothing shows; at first they may not.
    samples : int
    position : int
        First sample of the block that comes next.
    blocks : Blocks
    named : dict of int to Named
        Missing forces, by the length of the window that shows them.
    """

    def __init__(self, refit: Refit, first: int, samples: int, rate_hz: float) -> None:
        self.refit, self.samples = refit, samples
        base = refit.base
        size = scales(base.motion)
        present = [applied.term.name for applied in base.terms]
        leaving = [term.name for term in CATALOGUE.values() if term.chip_thickness]  # no surface is kept here
        tried = candidates(*size, base.linear.spindle, [*present, *leaving], shapes=COARSE)
        scouts = _scouts(tried)
        units: dict[tuple[float, ...], tuple[Candidate, int]] = {}
        for candidate, i in [*((c, c.linear[0]) for c in scouts), *((c, i) for c in tried for i in c.linear)]:
            units.setdefault(candidate.acts(i, size), (candidate, i))
        at = {acts: number for number, acts in enumerate(units)}
        self._entries = [(c, [at[c.acts(i, size)] for i in c.linear]) for c in tried]
        self._units, self._scouts = [*units.values()], len(scouts)
        self._stream = self._new_stream()
        self.position = first
        shapes = of_another_mode(base.linear, rate_hz, FINE_BANDS)
        self.blocks = Blocks(WINDOWS[-1], len(units), self._scouts, self._stream.linear, self._newest, shapes)
        self._little = self.blocks.little(STIR_P)
        self.named: dict[int, Named] = {}
        self.may_rest = False
        self._look: _Look | None = None
        self._count = self._stirs_until = 0

    @property
    def _newest(self) -> int:
        """How much of a block scouts are tried in: all of it, where little would be left out."""
        return NEWEST if 4 * self.samples > 5 * NEWEST else self.samples

    @property
    def looks_again(self) -> bool:
        """Whether blocks wait to be gone through once more."""
        return self._look is not None

    def advance(self, history: History) -> bool:
        """One block on; whether it counts."""
        first, self.position = self.position, self.position + self.samples
        rests = self.may_rest and self._count >= self._stirs_until
        taken = self._stream.take(history, first, rests=rests)
        if taken is None or not self.blocks.append(first, *taken):
            return False
        self._count += 1
        return True

    def is_quiet(self) -> bool:
        """Whether nothing at all shows in the windows whose turn it is, and nothing did before."""
        if self.named or not self.may_rest:
            return False
        return self.blocks.quiet(self._for_changes(), self._for_forces(), self._little, STIR_NATS)

    def changed(self) -> int | None:
        """First sample of a change, if there is one: of the window in which it shows most."""
        blocks = self.blocks
        sizes = self._for_changes()
        if not sizes:
            return None
        p = blocks.changed_p(sizes)
        for size in np.array(sizes)[p < CHANGED_P]:
            around = range(max(1, size // 2), min(2 * size, len(blocks) - BEFORE) + 1)
            return blocks.firsts[-around[int(np.argmin(blocks.changed_p(around)))]]
        self._stir([size for size, each in zip(sizes, p, strict=True) if each < STIR_P])
        return None

    def name(self) -> None:
        """Ask the windows whose turn it is, and all blocks together while there are few."""
        blocks = self.blocks
        sizes = self._for_forces()
        if len(blocks) - 1 not in WINDOWS:  # of all blocks together, one ago
            self.named.pop(len(blocks) - 1, None)
        favourite = max(self.named.values(), key=lambda each: each.evidence_nats, default=None)
        name = favourite.candidate.name if favourite else None
        most = dict(zip(sizes, blocks.most_of_scouts(sizes), strict=True))
        whole = [size for size in sizes if blocks.whole(size)]
        for size in most.keys() - {*whole}:
            self.named.pop(size, None)
        for size, rest in zip(whole, blocks.newest(whole), strict=True):
            most[size] = rest.gains.max()
            named = nonlinear(rest, self._entries, name, MARGIN_NATS)
            if named is None:
                self.named.pop(size, None)
            else:
                self.named[size] = named
        self._stir([size for size in sizes if most[size] > STIR_NATS or size in self.named])

    def _stir(self, sizes: Sequence[int]) -> None:
        """Something shows in some windows: have all forces tried in them, and until their next turn."""
        if not sizes:
            return
        size = max(sizes)
        self._stirs_until = max(self._stirs_until, self._count + max(1, size // 4))
        if self._look is None and not self.blocks.whole(size):
            self._look = _Look(self._new_stream(), self.blocks.first_with_scouts(size))

    def look_again(self, history: History, most: int) -> bool:
        """Go on with what is gone through once more, so many blocks at most; whether that is done now."""
        for _ in range(most):
            look = self._look
            if look is None:
                return False
            first, look.position = look.position, look.position + self.samples
            taken = look.stream.take(history, first, rests=False)
            if taken is not None:
                self.blocks.fill(first, *taken)
            if look.position == self.position:  # from here on there is one observer again
                self._stream, self._look = look.stream, None
                return True
        return False

    def _new_stream(self) -> Stream:
        return Stream(self.refit.base, self._units, self._scouts, self.samples, self._newest)

    def _for_changes(self) -> list[int]:
        """Windows that are asked for a change now."""
        return [size for size in self._due() if size + BEFORE <= len(self.blocks)]

    def _for_forces(self) -> list[int]:
        """Windows that are asked for a force now; all blocks together are one while there are few."""
        count = len(self.blocks)
        sizes = [size for size in self._due() if LEAST_BLOCKS <= size <= count]
        return [*sizes, count] if count < WINDOWS[-1] else sizes

    def _due(self) -> Iterator[int]:
        """Windows whose turn it is: each four times while it passes."""
        return (size for size in WINDOWS if self._count % max(1, size // 4) == 0)


def _scouts(tried: Sequence[Candidate]) -> list[Candidate]:
    """Of each kind the first that is tried."""
    by_name = {candidate.name: candidate for candidate in reversed(tried)}
    kinds = ([by_name[name] for name in kind if name in by_name] for kind in SCOUTS)
    return [kind[0] for kind in kinds if kind]
