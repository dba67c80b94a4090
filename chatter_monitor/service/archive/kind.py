"""What may be done with every recording of an archive, as the rest of this package sees it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol

from chatter_monitor.service.archive.dataset import DataSet, Place, R

Tables = dict[str, dict[str, Any]]


class Telling(Protocol[R]):
    """How results are told, in a table on a terminal and on a page: a module of `reports`."""

    HEADINGS: Sequence[str]

    def worst_first(self, done: Mapping[str, R]) -> list[tuple[str, R]]:
        """Recordings in the order in which a person should look at them."""

    def row(self, name: str, summary: R) -> tuple[str, ...]:
        """What is said about a recording, under the headings."""

    def strikes(self, summary: R) -> bool:
        """Whether a person should look at the recording."""

    def sentence(self, done: Mapping[str, R], broken: Mapping[str, str]) -> str:
        """Sum of it in words."""

    def archive_page(self, title: str, done: Mapping[str, R], broken: Mapping[str, str]) -> str:
        """HTML page; it lies in the directory of the results."""


class Kind(ABC, Generic[R]):
    """Something that is done with recordings; it travels to other processes.

    Attributes
    ----------
    doing, done : str
        The verb.
    tables : tuple of str
        Tables of the results beside the summary.
    summary : type
        What a recording comes to.
    telling : Telling
        How that is told.
    """

    doing: ClassVar[str]
    done: ClassVar[str]
    tables: ClassVar[tuple[str, ...]]
    summary: type[R]
    telling: Telling[R]

    @abstractmethod
    def decisive(self, file: Path | None = None) -> Tables:
        """What a recording's result depends on beside its samples and the program; without one, that of them all."""

    @abstractmethod
    def do(self, file: Path, place: Place[R]) -> R:
        """Do it, write tables and pages, and return what it comes to."""

    def results(self, path: Path) -> DataSet[R]:
        """The data set in a directory."""
        return DataSet(path, self.tables, self.summary)
