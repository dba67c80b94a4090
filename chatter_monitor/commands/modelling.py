"""Models: simulating one, and identifying one mode without any."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from chatter_monitor.commands.options import BETWEEN, CHANNEL, CONFIG, DEBUG, JSON, print_json, print_report


@click.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.option("--seconds", type=click.FloatRange(min=0, min_open=True), required=True, help="Length of the recording.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Same seed, same recording.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Recording to write, .wav or .flac.")
@click.option("--rate", "rate_hz", type=click.IntRange(min=100), help="Hz; the tracker's rate by default.")
@CONFIG
@JSON
@DEBUG
def simulate(
    model: Path, seconds: float, seed: int, out: Path, rate_hz: int | None, configs: tuple[Path, ...], as_json: bool
) -> None:
    """Simulate a machining system; writes the recording and, beside it, the truth as JSON."""
    from chatter_monitor.config import load
    from chatter_monitor.service.modelling import simulate_to_file

    rate_hz = rate_hz or round(load(configs).tracker.sample_rate_hz)
    simulation, truth = simulate_to_file(model, seconds, seed, out, rate_hz)
    rms = float((simulation.signal**2).mean() ** 0.5)
    unstable = simulation.truth.unstable_s
    if as_json:
        print_json({"recording": str(out), "truth": str(truth), "rms": rms, "unstable_s": unstable})
        return
    spoken = ", ".join(f"{begin:.2f}-{end:.2f} s" for begin, end in unstable) or "nowhere"
    click.echo(f"{out}: {seconds:g} s at {rate_hz} Hz, rms {rms:.3g}; linearly unstable: {spoken}.")
    click.echo(f"{truth}: the truth.")


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Directory for JSON and plots.")
@click.option(
    "--quantity",
    type=click.Choice(["displacement", "velocity", "acceleration"]),
    help="What the recording measures; by default what [input] sensor of --config says (a microphone counts as "
    "velocity, which its pressure follows close to the tool), else displacement, as in the paper.",
)
@CHANNEL
@BETWEEN
@click.option("--band", "band_hz", type=(float, float), metavar="LOW HIGH", help="Band to look at, in Hz.")
@CONFIG
@JSON
@DEBUG
def identify(
    file: Path,
    out: Path | None,
    quantity: Literal["displacement", "velocity", "acceleration"] | None,
    channel: int,
    between_s: tuple[float, float] | None,
    band_hz: tuple[float, float] | None,
    configs: tuple[Path, ...],
    as_json: bool,
) -> None:
    """Find stiffness, damping and excitation of the strongest mode from its response alone."""
    from chatter_monitor.config import load
    from chatter_monitor.energy.report import lines
    from chatter_monitor.service.modelling import QUANTITIES, identify_file

    result, written = identify_file(
        file,
        out,
        channel=channel,
        quantity=quantity or (QUANTITIES[load(configs).input.sensor] if configs else "displacement"),
        between_s=between_s,
        band_hz=band_hz,
    )
    print_report(as_json, result.to_json, lines(result), written)
