"""The page that shows the figures beside what the paper shows."""

from __future__ import annotations

from collections.abc import Sequence

from docs.paper.plate import Plate

_HEAD = """\
# The paper's figures, made again

M. Nicolescu and A. Archenti, *Dynamic parameter identification in nonlinear machining systems* (2013).
`python -m docs.paper` writes this page and its pictures; every number below comes from that run, with fixed seeds.

Figures 1 and 2 of the paper are drawings of machines. Figures 3 to 9 are simulations in the paper as well, though it
gives neither frequencies nor coefficients: ours are a 400 Hz mode that moves by about 1 µm. **Figures 10 to 20 are
recordings in the paper, which are not public; here they are simulations of the same situations.** What they share with
the paper is what is seen in them, not the numbers on their axes.

All quantities are per unit mass: energy in (mm/s)², damping h in 1/s, h = 2ζω for a linear system.
"""


def page(plates: Sequence[Plate]) -> str:
    """Write the page in Markdown, with pictures taken from ``figures/``."""
    parts = (
        f"## Figure {plate.label}: {plate.title}\n\n"
        f"![{plate.title}](figures/{plate.file})\n\n"
        f"**The paper:** {plate.paper}\n\n"
        f"**Here:** {plate.here}\n"
        for plate in plates
    )
    return "\n".join((_HEAD, *parts))
