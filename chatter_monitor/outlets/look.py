"""Colours and words for people: the palette of Okabe and Ito, which colour-blind eyes tell apart."""

from __future__ import annotations

from typing import NamedTuple

from chatter_monitor.records import Event, State

Colour = tuple[int, int, int]

GREY: Colour = (125, 125, 125)
WHITE: Colour = (240, 240, 240)
ORANGE: Colour = (230, 159, 0)
SKY_BLUE: Colour = (86, 180, 233)
BLUISH_GREEN: Colour = (0, 158, 115)
YELLOW: Colour = (240, 228, 66)
VERMILLION: Colour = (213, 94, 0)
REDDISH_PURPLE: Colour = (204, 121, 167)


class Look(NamedTuple):
    """How a state looks.

    Attributes
    ----------
    word : str
        For the operator: colour alone must not carry the alarm.
    colour : Colour
        On the dashboard and in reports.
    style : str
        On a terminal, which has a palette of its own.
    letter : str
        In a strip of them: colours may be missing there.
    """

    word: str
    colour: Colour
    style: str
    letter: str


STATES: dict[State, Look] = {
    "idle": Look("idle", GREY, "grey50", "."),
    "stable": Look("stable", BLUISH_GREEN, "green", "-"),
    "forced": Look("forced", SKY_BLUE, "cyan", "f"),
    "approaching": Look("APPROACHING", YELLOW, "yellow", "!"),
    "self_excited": Look("CHATTER", VERMILLION, "bold red", "#"),
    "unknown": Look("unknown", REDDISH_PURPLE, "magenta", "?"),
}
# From the best news to the worst.
SEVERITY: tuple[State, ...] = ("idle", "stable", "forced", "unknown", "approaching", "self_excited")

# Modes by their slot; white is kept for the vibration that the verdict is about.
MODES: tuple[Colour, ...] = (SKY_BLUE, ORANGE, BLUISH_GREEN, REDDISH_PURPLE)


def mode_colour(mode: int) -> Colour:
    """Colour of a mode slot."""
    return MODES[mode % len(MODES)]


def percent(probability: float) -> str:
    """Tell a probability in whole percent, of which 0 and 100 would claim too much."""
    if 0.0 < probability <= 0.005:
        return "< 1 %"
    return "> 99 %" if 0.995 <= probability < 1.0 else f"{100.0 * probability:.0f} %"


def hertz(frequency_hz: float | None) -> str:
    """Tell a frequency, or that there is none."""
    return "-" if frequency_hz is None else f"{frequency_hz:.0f} Hz"


def damping(damping_ratio: float | None, otherwise: str = "-") -> str:
    """Tell a damping ratio, or what is said where there is none."""
    return otherwise if damping_ratio is None else f"{100.0 * damping_ratio:.2f} %"


def vibration(event: Event) -> str:
    """Tell which vibration an event was about."""
    if event.peak_frequency_hz is None:
        return "in no line"
    return f"at {hertz(event.peak_frequency_hz)}, least damping {damping(event.min_damping_ratio, 'unknown')}"
