"""A figure of the paper made again, and what is to be said about it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Plates = Iterator["Plate"]


@dataclass(frozen=True)
class Plate:
    """One figure with its sentences.

    Attributes
    ----------
    name : str
        Number in the paper, as in the name of the file: "03", "07a".
    title : str
        What is seen.
    figure : matplotlib.figure.Figure
        The drawing.
    paper, here : str
        What the paper shows, and how near this comes.
    numbers : mapping of str to float
        The numbers that `here` rests on.
    """

    name: str
    title: str
    figure: Figure
    paper: str
    here: str
    numbers: Mapping[str, float] = field(default_factory=dict)

    @property
    def file(self) -> str:
        """File name of the picture."""
        return f"figure_{self.name}.png"

    @property
    def label(self) -> str:
        """Number as the paper prints it."""
        return self.name.lstrip("0")
