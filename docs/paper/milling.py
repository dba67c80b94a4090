"""Figures 19 and 20: a milling pass over pockets and solid stretches, tracked recursively."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy import signal

from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Drift, Excitation, Mode, Sensor, Spindle
from chatter_monitor.physics.simulate import Simulation, simulate
from chatter_monitor.physics.stability import characteristic_roots
from chatter_monitor.physics.terms import CATALOGUE
from chatter_monitor.records import ModeStatus
from chatter_monitor.tracking.tracker import Tracker, TrackerSettings
from docs.paper.drawing import CLOUD, FITTED, SHADE, TARGET, legend, new_figure
from docs.paper.plate import Plate, Plates

TOOL = Mode(966.0, 0.03)  # tool and spindle; near 990 Hz while it cuts
TABLE = Mode(93.5, 0.05, participation=0.1)  # workpiece and table; near 95 Hz while it cuts
LIMIT = 2.0 * TOOL.damping_ratio * (1.0 + TOOL.damping_ratio)
TEETH, SPEED_RPM = 4, 2170.0
EDGES_S = (0.0, 3.0, 6.0, 9.0, 12.0, 15.0)  # of the sections
RAMP_S = 0.15  # from one to the next, on each side
NAMES = ("pockets", "solid", "pockets", "solid, deeper", "pockets")
CUT = (0.35, 0.7, 0.35, 1.6, 0.35)  # process stiffness over `LIMIT`
ROUGH = (4.0, 1.0, 4.0, 1.0, 4.0)  # random force: its intensity with the entries into slots and pockets
PASSING = (3.0, 0.6, 3.0, 0.6, 3.0)  # forces at the tooth passing frequency and its harmonics
CHATTER = 3  # section
HARMONICS_MM_S2 = (3e4, 1e4, 5e3)
NOISE_MM = 0.003
LOW_DECIMATION = 32  # of the signal for the second tracker, which follows the low mode
HIGH = TrackerSettings(bands=1)  # RARMA(4,3) at 12.8 kHz
LOW = TrackerSettings(memory_ms=400.0, sample_rate_hz=HIGH.sample_rate_hz / LOW_DECIMATION, bands=1)
ROW_S = 0.75  # of signal for one spectrum of the waterfall
WAIT_S = 0.5  # after each edge, before numbers are taken


@dataclass(frozen=True)
class Tracked:
    """One mode along the pass: frequency, damping ratio and its standard deviation; NaN where the model lacks it."""

    time_s: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]
    damping_ratio: NDArray[np.float64]
    damping_sd: NDArray[np.float64]

    def median_damping(self, section: int) -> float:
        """Median damping ratio in a section, from `WAIT_S` after its beginning."""
        inside = (self.time_s > EDGES_S[section] + WAIT_S) & (self.time_s < EDGES_S[section + 1] - RAMP_S)
        return float(np.nanmedian(self.damping_ratio[inside]))


def pass_over_pockets() -> MachiningSystem:
    """The pass as a machining system whose cut changes from section to section; displacement in mm."""
    intensity = 2.0 * TOOL.damping_ratio * TOOL.omega**3 * NOISE_MM**2 / np.pi
    terms = [AppliedTerm(CATALOGUE["loss_of_contact"], {"coefficient": CUT[0] * LIMIT, "chip_thickness": 0.1})]
    drifts = [_along("term.1.coefficient", CUT, LIMIT), _along("excitation.intensity", ROUGH, intensity)]
    for k, strength in enumerate(HARMONICS_MM_S2, 1):
        force = {"coefficient": strength, "order": float(TEETH * k), "phase_rad": float(k)}
        terms.append(AppliedTerm(CATALOGUE["periodic_forcing"], force))
        drifts.append(_along(f"term.{k + 1}.coefficient", PASSING, strength))
    return MachiningSystem(
        (TOOL, TABLE),
        tuple(terms),
        Excitation(intensity=intensity),
        Spindle(SPEED_RPM, TEETH),
        Sensor("pressure", gain=5e-7, noise_rms=0.0015),
        tuple(drifts),
    )


def plates() -> Plates:
    """Waterfall of the spectrum, and the operational parameters along the pass."""
    simulation = simulate(pass_over_pockets(), EDGES_S[-1], seed=19, settle_s=0.5)
    yield _waterfall(simulation)
    yield _recursive(simulation)


def _along(parameter: str, values: tuple[float, ...], unit: float) -> Drift:
    times = [time for begin, end in pairwise(EDGES_S) for time in (begin + RAMP_S, end - RAMP_S)]
    return Drift(parameter, tuple(times), tuple(unit * value for value in values for _ in range(2)))


def _follow(samples: NDArray[np.float64], settings: TrackerSettings, mode_hz: float) -> Tracked:
    """Track a signal; of the two modes take the one nearer to a frequency, within a third of an octave."""
    tracker = Tracker(settings)
    frames = [*tracker.process(0, samples), *tracker.finish()]
    frequency, damping, damping_sd, status = (
        np.concatenate([getattr(frame, column) for frame in frames])
        for column in ("frequency_hz", "damping_ratio", "damping_sd", "status")
    )
    oscillatory = status == ModeStatus.OSCILLATORY
    octaves = np.where(oscillatory, np.abs(np.log2(np.where(oscillatory, frequency, mode_hz) / mode_hz)), np.inf)
    row, slot = np.arange(samples.size), np.argmin(octaves, axis=1)
    there = octaves[row, slot] < 1.0 / 3.0
    columns = [np.where(there, column[row, slot], np.nan) for column in (frequency, damping, damping_sd)]
    return Tracked(row / settings.sample_rate_hz, *columns)


def _roots(system: MachiningSystem, time_s: NDArray[np.float64], near_hz: float) -> NDArray[np.float64]:
    """Damping ratio of the least stable root near a frequency, with the parameters of each time."""
    damping = []
    for when in time_s.tolist():
        roots = characteristic_roots(system.at(when))
        near = roots[np.abs(np.log2(np.abs(roots) / (2.0 * np.pi * near_hz))) < 0.2]
        damping.append(float(np.min(-near.real / np.abs(near))))
    return np.array(damping)


def _sections(axes: Axes, height: float | None = None) -> None:
    """Shade the solid stretches; name the sections at a height in axes coordinates."""
    for k, (begin, end, name) in enumerate(zip(EDGES_S, EDGES_S[1:], NAMES, strict=False)):
        if name != "pockets":
            axes.axvspan(begin, end, color=SHADE, alpha=0.35 if k == CHATTER else 0.15, lw=0.0)
        if height is not None:
            axes.text(0.5 * (begin + end), height, name, transform=axes.get_xaxis_transform(), ha="center", va="bottom")


def _waterfall(simulation: Simulation) -> Plate:
    rate = simulation.sample_rate_hz
    rows = simulation.signal[: round(EDGES_S[-1] * rate)].reshape(-1, round(ROW_S * rate))
    time = (np.arange(rows.shape[0]) + 0.5) * ROW_S
    figure, (overview, low) = new_figure(1, 2, width=10.0, height=6.8, width_ratios=(3, 2))
    for axes, points, top_hz, lift in ((overview, 1 << 11, 3300.0, 16.0), (low, 1 << 12, 250.0, 10.0)):
        frequency, density = signal.welch(rows, rate, nperseg=points)
        shown = (frequency > 10.0) & (frequency < top_hz)
        level = 10.0 * np.log10(density[:, shown])
        level -= level.min()
        for k in reversed(range(time.size)):  # the nearer ones hide the farther ones
            section = int(np.searchsorted(EDGES_S, time[k])) - 1
            colour = TARGET if section == CHATTER else (SHADE if NAMES[section] != "pockets" else FITTED)
            curve = lift * k + level[k]
            axes.fill_between(frequency[shown], lift * k - 3.0 * lift, curve, color="white", lw=0.0)
            axes.plot(frequency[shown], curve, color=colour, lw=1.1)
        axes.set_yticks([lift * (edge / ROW_S - 0.5) for edge in EDGES_S], [f"{edge:.0f}" for edge in EDGES_S])
        axes.set(xlim=(0.0, top_hz), ylim=(-0.5 * lift, None), xlabel="frequency, Hz")
        axes.grid(visible=False)
        axes.plot([0.97 * top_hz] * 2, [0.0, 20.0], color="black", lw=2.5)
        axes.text(0.96 * top_hz, 10.0, "20 dB", ha="right", va="center", fontsize="small")
    overview.set(ylabel="time in the pass, s", title="Waterfall PSD of the sound over the pass")
    low.set_title("Low end: table near 95 Hz, teeth at 145 Hz")
    for name, colour in (("pockets", FITTED), ("solid", SHADE), ("solid, deeper: chatter", TARGET)):
        overview.plot([], [], color=colour, label=name)
    legend(overview, loc="upper right")
    frequency, time, density = signal.spectrogram(simulation.signal, rate, nperseg=1 << 13)
    chatter = (time > EDGES_S[CHATTER] + WAIT_S) & (time < EDGES_S[CHATTER + 1] - RAMP_S)
    peak = float(frequency[np.argmax(density[:, chatter].mean(axis=1))])
    band = (frequency > 900.0) & (frequency < 1100.0)
    stable = (time > EDGES_S[2] + WAIT_S) & (time < EDGES_S[3] - RAMP_S)
    rise = 10.0 * np.log10(density[band][:, chatter].mean() / density[band][:, stable].mean())
    teeth = TEETH * SPEED_RPM / 60.0
    return Plate(
        "19",
        "Waterfall of the spectrum over a milling pass",
        figure,
        "The PSD of microphone and accelerometer over the workpiece: forced vibration that changes with slots and "
        "pockets, and concentrations at the modes, 2 and 3 kHz among them.",
        f"Over the pockets the modes near 95 Hz and 990 Hz and the tooth passing at {teeth:.0f} Hz stand out; in the "
        f"deeper solid stretch one line at {peak:.0f} Hz rises by {rise:.0f} dB. Microphone only. The model has no "
        "structural modes at 2 and 3 kHz: what is seen there are harmonics of the chatter. The number of entries per "
        "revolution stays the same here; only their strength changes.",
        {"chatter_hz": peak, "rise_db": float(rise)},
    )


def _recursive(simulation: Simulation) -> Plate:
    second = _follow(simulation.signal, HIGH, 990.0)
    at_full_rate = _follow(simulation.signal, HIGH, 95.0)
    first = _follow(signal.resample_poly(simulation.signal, 1, LOW_DECIMATION), LOW, 95.0)
    figure, (sound, frequencies, low, high) = new_figure(
        4, 1, width=9.0, height=9.0, sharex=True, height_ratios=(2, 2, 2, 3)
    )
    sound.plot(second.time_s[::4], simulation.signal[::4], color=FITTED, lw=0.3)
    sound.set(ylabel="sound pressure, Pa")
    _sections(sound, height=1.0)
    for mode, colour, name in (
        (second, TARGET, "(f_op)₂, tool and spindle"),
        (first, FITTED, "(f_op)₁, workpiece and table"),
    ):
        every = max(1, mode.time_s.size // 4000)
        frequencies.plot(mode.time_s[::every], mode.frequency_hz[::every], color=colour, lw=1.2, label=name)
    frequencies.set(yscale="log", ylim=(50.0, 2000.0), ylabel="frequency, Hz")
    frequencies.set_yticks([95, 200, 500, 990], ["95", "200", "500", "990"], minor=False)
    frequencies.minorticks_off()
    legend(frequencies, loc="center right")
    figure.suptitle("Recursive identification of a milling pass, RARMA(4,3)")
    when = np.linspace(0.25, EDGES_S[-1] - 0.25, 30)
    for axes, mode, near_hz, label, top in (
        (low, first, 95.0, "(ξ_op)₁", 0.12),
        (high, second, 990.0, "(ξ_op)₂", 0.06),
    ):
        every = max(1, mode.time_s.size // 4000)
        t, d, sd = mode.time_s[::every], mode.damping_ratio[::every], mode.damping_sd[::every]
        axes.fill_between(t, d - 1.96 * sd, d + 1.96 * sd, color=CLOUD, alpha=0.4, lw=0.0, label="95 % interval")
        axes.plot(t, d, color=FITTED, lw=1.0, label=f"{label}, recursive")
        axes.plot(when, _roots(simulation.system, when, near_hz), "--", color=TARGET, lw=1.4, label="least stable root")
        axes.axhline(0.0, color="0.4", lw=0.9)
        axes.set(ylim=(-0.012, top), ylabel=label)
        _sections(axes)
        legend(axes, loc="upper right", ncols=3)
    high.set(xlim=(0.0, EDGES_S[-1]), xlabel="time, s")
    medians = [second.median_damping(section) for section in range(len(NAMES))]
    start, *low_medians = (first.median_damping(section) for section in range(len(NAMES)))
    truth = _roots(simulation.system, np.array([0.5 * (EDGES_S[2] + EDGES_S[3])]), 95.0)[0]
    fell = second.time_s[(second.time_s > EDGES_S[CHATTER] - RAMP_S) & (second.damping_ratio < 0.002)][0]
    found = float(np.mean(np.isfinite(at_full_rate.frequency_hz)))
    return Plate(
        "20",
        "Operational dynamic parameters along a milling pass",
        figure,
        "RARMA(4,3) follows two operational modes, about 95 Hz (workpiece and table) and 990 Hz (tool and spindle); "
        "where the damping of the second falls to zero, the cut chatters.",
        f"Median damping ratio of the second mode: {100 * medians[0]:.2f}, {100 * medians[1]:.2f}, "
        f"{100 * medians[2]:.2f} % before, **{100 * medians[CHATTER]:.3f} % in the chatter stretch**, "
        f"{100 * medians[4]:.2f} % after it; it is below 0.2 % from {fell:.2f} s on, {fell - EDGES_S[CHATTER]:+.2f} s "
        f"from the edge of the section at {EDGES_S[CHATTER]:.0f} s. Far from the limit it reads above the least stable "
        "root, because a cut with a delay has many roots and the model two modes. The low mode is **not** taken from "
        f"the signal at 12.8 kHz, where RARMA(4,3) has it in {100 * found:.0f} % of the samples (its second pole "
        "pair is spent elsewhere), but from a second RARMA(4,3) on the signal decimated to "
        f"{LOW.sample_rate_hz:.0f} Hz, memory {1e-3 * LOW.memory_ms:g} s: {100 * start:.1f} % in the first section, "
        f"where it is still settling, then {100 * min(low_medians):.1f} to {100 * max(low_medians):.1f} %, with a root "
        f"of {100 * truth:.1f} % over the pockets.",
        {
            "chatter_damping": medians[CHATTER],
            "stable_damping": medians[2],
            "low_frequency_hz": float(np.nanmedian(first.frequency_hz)),
            "high_frequency_hz": float(np.nanmedian(second.frequency_hz)),
            "fell_s": float(fell),
        },
    )
