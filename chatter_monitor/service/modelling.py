"""Simulating a model into a recording, and identifying a recording: files in, files out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from chatter_monitor.acquisition.recording import Recording
from chatter_monitor.energy.band import Quantity
from chatter_monitor.energy.identification import Identification, identify
from chatter_monitor.energy.plots import save_all
from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.physics.model_file import read_model
from chatter_monitor.physics.simulate import Simulation, simulate

# WAV keeps the model's units in floating point; FLAC has integers only, full scale being 1.
SUBTYPES = {".wav": "FLOAT", ".flac": "PCM_16"}

# What a sensor's signal is taken for. The sound pressure close to a vibrating surface follows its velocity.
QUANTITIES: dict[str, Quantity] = {
    "microphone": "velocity",
    "accelerometer": "acceleration",
    "vibrometer": "velocity",
    "displacement": "displacement",
}


def simulate_to_file(model: Path, seconds: float, seed: int, out: Path, sample_rate_hz: int) -> tuple[Simulation, Path]:
    """Simulate a model file and write the recording and, beside it, the truth as JSON.

    Returns
    -------
    Simulation, Path
        What was simulated, and the path of the truth.

    Raises
    ------
    InputError
        If the model is wrong, the format is unknown or cannot hold the signal.
    EnvironmentFault
        If a file cannot be written.
    """
    subtype = SUBTYPES.get(out.suffix.lower())
    if subtype is None:
        raise InputError("unknown format of the recording", got=out.name, allowed="a name that ends in .wav or .flac")
    simulation = simulate(read_model(model), seconds, seed, float(sample_rate_hz))
    peak = float(np.abs(simulation.signal).max())
    if out.suffix.lower() == ".flac" and peak > 1.0:
        raise InputError(
            "the simulated signal does not fit into FLAC",
            got=f"a peak of {peak:.3g}",
            allowed="at most 1",
            remedy="Set a smaller gain in [sensor], or write WAV.",
        )
    truth = out.with_suffix(".json")
    try:
        soundfile.write(out, simulation.signal, sample_rate_hz, subtype=subtype)
        truth.write_text(json.dumps(simulation.truth.to_json(), indent=1) + "\n", encoding="utf-8")
    except (OSError, soundfile.LibsndfileError) as error:
        raise EnvironmentFault(f"the simulation cannot be written: {error}", got=str(out)) from error
    return simulation, truth


def identify_file(
    file: Path,
    out: Path | None,
    *,
    channel: int,
    quantity: Quantity,
    between_s: tuple[float, float] | None,
    band_hz: tuple[float, float] | None,
) -> tuple[Identification, list[Path]]:
    """Identify one channel of a recording; write JSON and plots if a directory is given.

    Returns
    -------
    Identification, list of Path
        The result, and the files written.

    Raises
    ------
    InputError
        If the recording or the stretch cannot be used.
    EnvironmentFault
        If the directory cannot be written.
    """
    samples, rate_hz = _stretch(file, channel, between_s)
    result = identify(samples, rate_hz, quantity, band_hz=band_hz)
    if out is None:
        return result, []
    try:
        out.mkdir(parents=True, exist_ok=True)
        report = out / "identification.json"
        report.write_bytes(result.to_json())
        return result, [report, *save_all(result, out)]
    except OSError as error:
        raise EnvironmentFault(f"the results cannot be written: {error.strerror}", got=str(out)) from error


def _stretch(file: Path, channel: int, between_s: tuple[float, float] | None) -> tuple[NDArray[np.float64], float]:
    with Recording(file, channels=[channel]) as recording:
        rate_hz = recording.sample_rate_hz
        begin_s, end_s = between_s if between_s is not None else (0.0, np.inf)
        if not 0.0 <= begin_s < end_s:
            raise InputError("impossible stretch", got=between_s, allowed="0 <= begin < end, in seconds")
        pieces = []
        for block in recording.blocks():
            first = max(0, round(begin_s * rate_hz) - block.first_sample)
            last = len(block.samples) if end_s == np.inf else round(end_s * rate_hz) - block.first_sample
            if last <= 0:
                break
            pieces.append(block.samples[first:last, 0])
    samples = np.concatenate(pieces) if pieces else np.empty(0)
    if samples.size == 0:
        raise InputError(
            "the stretch lies outside the recording", got=between_s, remedy="Give seconds within the file."
        )
    return samples, rate_hz
