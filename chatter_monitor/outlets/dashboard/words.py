"""What the views say in words: the evidence for a verdict, an event with its advice, the monitor's health."""

from __future__ import annotations

from chatter_monitor.outlets.look import STATES, percent, vibration
from chatter_monitor.records import Event, Health, Verdict

LARGE_PERCENT = 100
# Words of a cut without an alarm, which is itself as sure as it is likely chatter.
CUTTING = ("stable", "forced", "approaching")
MEANINGS = {
    "idle": "Nothing is being cut.",
    "stable": "Cutting; vibrations decay.",
    "forced": "What vibrates is driven from outside: change its source, not the cut.",
    "approaching": "Little damping is left, or it gets louder: chatter may be on its way.",
    "self_excited": "The cut feeds the vibration.",
    "unknown": "Samples are missing or bad; nothing can be said.",
}


def evidence(verdict: Verdict) -> str:
    """Markdown: the verdict, its numbers with their uncertainty, and why."""
    lines = [f"# {STATES[verdict.state].word}", MEANINGS[verdict.state], ""]
    if verdict.frequency_hz is not None:
        lines.append(f"- vibration at **{verdict.frequency_hz:.0f} Hz**")
    if verdict.damping_ratio is not None:
        interval = verdict.damping_ratio_ci95
        between = "" if interval is None else f" (95 %: {100 * interval[0]:.2f} to {100 * interval[1]:.2f} %)"
        lines.append(f"- damping **{100 * verdict.damping_ratio:.2f} %**{between}")
    # Depth is not what matters where it is forced; a warning says itself if it is, or is about what grows just now,
    # which a margin over some seconds does not know.
    if verdict.margin_percent is not None and verdict.state == "stable":
        lines.append(f"- **{_margin(verdict.margin_percent)}** more depth of cut before it chatters{_between(verdict)}")
    if verdict.order is not None:
        lines.append(f"- **{verdict.order:.2f}** times the spindle")
    lines.append(f"- sure: **{percent(verdict.confidence)}**")
    if verdict.chatter_probability is not None and verdict.state in CUTTING:
        lines.append(f"- that it chatters: **{percent(verdict.chatter_probability)}**")
    if verdict.reasons:
        lines += ["", "**Why**", "", *(f"- {reason}" for reason in verdict.reasons)]
    if verdict.flags:
        lines += ["", f"**Flags:** {', '.join(verdict.flags)}"]
    return "\n".join(lines)


def _between(verdict: Verdict) -> str:
    """Interval of the margin, as far as it matters."""
    if verdict.margin_percent_ci95 is None:
        return ""
    low, high = (max(percent, 0.0) for percent in verdict.margin_percent_ci95)
    if high < LARGE_PERCENT:
        return f" (95 %: {low:.0f} to {high:.0f} %)"
    return f" (95 %: at least {low:.0f} %)" if low < LARGE_PERCENT else ""


def _margin(percent: float) -> str:
    """Margin, as far as it matters for the next pass."""
    return f"{max(percent, 0.0):.0f} %" if percent < LARGE_PERCENT else f"over {LARGE_PERCENT} %"


def event(message: Event) -> tuple[str, str]:
    """What happened, and what to change: a line each."""
    what = "an alarm that is withdrawn," if message.withdrawn else "chatter"
    happened = f"Channel {message.channel}: {what} for {message.end_s - message.onset_s:.2f} s {vibration(message)}."
    return happened, f"Change: {message.remedy or 'nothing is known that would help'}."


def health(message: Health) -> str:
    """Markdown: whether the monitor hears, and what it has lost."""

    def number(value: float | None, unit: str) -> str:
        return "-" if value is None else f"{value:.2f} {unit}"

    rows = {
        "state": message.state.replace("_", " "),
        "latency, median": number(message.latency_ms_p50, "ms"),
        "latency, 99 %": number(message.latency_ms_p99, "ms"),
        "samples lost": f"{message.lost}",
        "overflows": f"{message.overflows}",
        "clipped": f"{message.clipped}",
        "not numbers": f"{message.non_finite}",
        "publications dropped": f"{message.publications_dropped}",
        "ring filled": f"{100 * message.ring_fill:.0f} %",
        "sound card's clock": number(message.clock_ppm, "ppm"),
    }
    table = ["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows.items())]
    return "\n".join([*table, "", *(f"- {reason}" for reason in message.reasons)])
