"""Colours and words of dashboard and reports: the palette of Okabe and Ito, which colour-blind eyes tell apart."""

from __future__ import annotations

from chatter_monitor.records import State

Colour = tuple[int, int, int]

GREY: Colour = (125, 125, 125)
WHITE: Colour = (240, 240, 240)
ORANGE: Colour = (230, 159, 0)
SKY_BLUE: Colour = (86, 180, 233)
BLUISH_GREEN: Colour = (0, 158, 115)
YELLOW: Colour = (240, 228, 66)
VERMILLION: Colour = (213, 94, 0)
REDDISH_PURPLE: Colour = (204, 121, 167)

# Word and colour of each state. The word is there too, because colour alone must not carry the alarm.
STATES: dict[State, tuple[str, Colour]] = {
    "idle": ("idle", GREY),
    "stable": ("stable", BLUISH_GREEN),
    "forced": ("forced", SKY_BLUE),
    "approaching": ("APPROACHING", YELLOW),
    "self_excited": ("CHATTER", VERMILLION),
    "unknown": ("unknown", REDDISH_PURPLE),
}
# Modes by their slot; white is kept for the vibration that the verdict is about.
MODES: tuple[Colour, ...] = (SKY_BLUE, ORANGE, BLUISH_GREEN, REDDISH_PURPLE)


def mode_colour(mode: int) -> Colour:
    """Colour of a mode slot."""
    return MODES[mode % len(MODES)]
