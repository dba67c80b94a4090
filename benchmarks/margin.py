"""How well the margin to chatter is heard, against cuts whose roots are known.

Cuts are simulated by a Runge-Kutta integration of the delay equation written for this benchmark, apart from
`chatter_monitor.physics.simulate`; the limit and the rightmost root come from `chatter_monitor.physics`, which shares
no code with the tracker. Modes of 180 to 2200 Hz with 1 to 5 %, 600 to 9000 rpm, 1 to 6 teeth, all drawn log-uniformly;
the speed given to the tracker is off by 0.1 % (standard deviation). Each cut lasts 12 s: the tracker's memory is 5 s.

Development was done on seeds from 0 on; the report is made on seeds from 1,000,000 on.

Run: python -m benchmarks.margin [--cases N] [--harder N] [--development]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.signal import butter, firwin, lfilter, sosfilt, upfirdn

from chatter_monitor.physics.lobes import stability_limit
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Spindle
from chatter_monitor.physics.stability import rightmost_root
from chatter_monitor.physics.terms import CATALOGUE
from chatter_monitor.tracking.margin import Margin
from chatter_monitor.tracking.margin_tracker import MarginSettings, MarginTracker
from chatter_monitor.tracking.tracker import Tracker, TrackerSettings

RATE_HZ = 12800.0
DURATION_S = 12.0
STEPS_PER_PERIOD = 40
SETTLE_S = 3.0
FRACTIONS = (0.2, 0.35, 0.5, 0.7, 0.9)
SENSORS = {"displacement": 0, "velocity": 1, "acceleration": 2, "pressure": 2}  # which of x, v, a
SNR_DB = (10.0, 20.0, 35.0)
SPEED_ERROR = 0.001
REPORT_SEED = 1_000_000

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cut:
    """A cut and how it is heard.

    `second_mode` is its frequency over the first's, damping and participation; `tooth_modulation` the relative
    amplitude of kappa, and of the noise of cutting, at the tooth passing frequency; `unsteadiness` the relative rms of
    kappa's random change within 20 ms; `speed_wander` the relative amplitude of a slow change of speed over 7 s;
    `lines_db` the level of all spindle lines left in the signal, relative to the vibration.
    """

    mode: Mode
    spindle: Spindle
    kappa: float
    sensor: str
    snr_db: float
    seed: int
    second_mode: tuple[float, float, float] | None = None
    tooth_modulation: float = 0.0
    unsteadiness: float = 0.0
    speed_wander: float = 0.0
    lines_db: float | None = None

    @property
    def modes(self) -> tuple[Mode, ...]:
        """All of them."""
        if self.second_mode is None:
            return (self.mode,)
        ratio, damping, participation = self.second_mode
        return (self.mode, Mode(ratio * self.mode.frequency_hz, damping, participation))

    @property
    def system(self) -> MachiningSystem:
        """What the physics package makes of it."""
        term = AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": self.kappa})
        return MachiningSystem(self.modes, (term,), spindle=self.spindle)


@dataclass(frozen=True)
class Result:
    """A cut, the truth about it and what was heard at the end; errors are medians over the last 5 s."""

    cut: Cut
    ratio: float
    damping: float
    heard: Margin
    ratio_error: float
    damping_error: float


def draw(seed: int, **circumstances: object) -> Cut:
    """Cut at one of the fractions of its limit, limit checked by the roots on both sides of it."""
    rng = np.random.default_rng(seed)
    while True:
        mode = Mode(*np.exp(rng.uniform(np.log((180.0, 0.01)), np.log((2200.0, 0.05)))).tolist())
        spindle = Spindle(float(np.exp(rng.uniform(np.log(600.0), np.log(9000.0)))), int(rng.integers(1, 7)))
        sensor, snr_db = str(rng.choice(list(SENSORS))), float(rng.choice(SNR_DB))
        cut = replace(Cut(mode, spindle, 0.01, sensor, snr_db, seed), **circumstances)
        limit = float(stability_limit(cut.system, np.array([spindle.speed_rpm]))[0])
        fraction = float(rng.choice(FRACTIONS))
        below, above = (rightmost_root(replace(cut, kappa=limit * side).system).stable for side in (0.995, 1.005))
        if below and not above:
            return replace(cut, kappa=fraction * limit)


@njit(cache=True)
def integrate(w, zeta, g, kappa, delay_steps, force, step_s, motion):
    """Classical Runge-Kutta method; `kappa` and `delay_steps` are given at the steps, `motion` becomes x, v, a."""
    modes = w.shape[0]
    q = np.zeros(modes)
    v = np.zeros(modes)
    k = np.zeros((4, 2, modes))
    lagged = np.zeros(3)
    x = motion[0]
    for n in range(force.shape[0] - 1):
        for half in range(3):
            position = n + 0.5 * half - delay_steps[n]
            i = int(np.floor(position))
            u = position - i
            lagged[half] = 0.0
            if i >= 1:  # Lagrange's cubic through four steps of the past
                lagged[half] = (
                    -u * (u - 1) * (u - 2) / 6 * x[i - 1]
                    + (u + 1) * (u - 1) * (u - 2) / 2 * x[i]
                    - (u + 1) * u * (u - 2) / 2 * x[i + 1]
                    + (u + 1) * u * (u - 1) / 6 * x[i + 2]
                )
        for stage in range(4):
            half = (stage + 1) // 2
            ahead = 0.0 if stage == 0 else 0.5 * half * step_s
            tool = 0.0
            for m in range(modes):
                tool += g[m] * (q[m] + ahead * k[stage - 1, 0, m])
            stiffness = kappa[n] + 0.5 * half * (kappa[n + 1] - kappa[n])
            push = force[n] + 0.5 * half * (force[n + 1] - force[n]) - stiffness * w[0] ** 2 * (tool - lagged[half])
            for m in range(modes):
                rate = v[m] + ahead * k[stage - 1, 1, m]
                k[stage, 0, m] = rate
                k[stage, 1, m] = (
                    g[m] * push - 2 * zeta[m] * w[m] * rate - w[m] ** 2 * (q[m] + ahead * k[stage - 1, 0, m])
                )
        for m in range(modes):
            motion[0, n] += g[m] * q[m]
            motion[1, n] += g[m] * v[m]
            motion[2, n] += g[m] * k[0, 1, m]
            q[m] += step_s / 6 * (k[0, 0, m] + 2 * k[1, 0, m] + 2 * k[2, 0, m] + k[3, 0, m])
            v[m] += step_s / 6 * (k[0, 1, m] + 2 * k[1, 1, m] + 2 * k[2, 1, m] + k[3, 1, m])


def simulate(cut: Cut, duration_s: float = DURATION_S) -> Array:
    """Signal of the sensor at 12.8 kHz, in units of the vibration's rms."""
    rng = np.random.default_rng([cut.seed, 1])
    oversampling = max(4, int(np.ceil(STEPS_PER_PERIOD * cut.mode.frequency_hz / RATE_HZ)))
    rate = RATE_HZ * oversampling
    n = round((duration_s + SETTLE_S) * rate) + 64 * oversampling
    tooth_hz = cut.spindle.teeth * cut.spindle.speed_rpm / 60.0
    speed = 1.0 + cut.speed_wander * np.sin(2 * np.pi * np.arange(n) / rate / 7.0)
    slow = lfilter([1.0], [1.0, -np.exp(-1.0 / (0.02 * rate))], rng.standard_normal(n))
    teeth_passed = np.cumsum(speed) / rate * tooth_hz
    engaged = 1.0 + cut.tooth_modulation * np.cos(2 * np.pi * teeth_passed)
    kappa = cut.kappa * engaged
    kappa *= 1.0 + cut.unsteadiness * slow / slow.std()
    parts = np.array([(mode.omega, mode.damping_ratio, mode.participation) for mode in cut.modes]).T.copy()
    motion = np.zeros((3, n))
    integrate(*parts, kappa, rate / (tooth_hz * speed), engaged * rng.standard_normal(n), 1 / rate, motion)
    taps = firwin(64 * oversampling + 1, 1.0 / oversampling, window=("kaiser", 7.86))
    y = upfirdn(taps, motion[SENSORS[cut.sensor]], down=oversampling)[32:]
    if cut.sensor == "pressure":
        y = sosfilt(butter(1, 50.0, "highpass", fs=RATE_HZ, output="sos"), y)
    begin = round(SETTLE_S * RATE_HZ)
    y = y[begin : begin + round(duration_s * RATE_HZ)]
    y /= y.std()
    if cut.lines_db is not None:
        y += 10 ** (cut.lines_db / 20) * spindle_lines(cut, len(y), rng)
    return y + 10 ** (-cut.snr_db / 20) * rng.standard_normal(len(y))


def spindle_lines(cut: Cut, n: int, rng: np.random.Generator) -> Array:
    """Sum of unit rms of up to 200 multiples of the spindle frequency, the teeth's three times as strong."""
    rotation_hz = cut.spindle.speed_rpm / 60.0
    angle = 2 * np.pi * rotation_hz / RATE_HZ * np.arange(n)
    lines = np.zeros(n)
    for order in range(1, min(200, int(0.4 * RATE_HZ / rotation_hz)) + 1):
        amplitude = rng.standard_normal() / np.sqrt(order) * (1.0 if order % cut.spindle.teeth == 0 else 0.3)
        lines += amplitude * np.cos(order * angle + rng.uniform(0, 2 * np.pi))
    return lines / lines.std()


def hear(cut: Cut, settings: MarginSettings, speed_error: float) -> list[Margin]:
    """Margins of all frames of a cut."""
    tracker = MarginTracker(settings, RATE_HZ, cut.spindle.teeth)
    off = 1.0 + speed_error * np.random.default_rng([cut.seed, 2]).standard_normal()
    return tracker.process(simulate(cut), cut.spindle.speed_rpm / 60.0 * off)


def measure(cut: Cut, settings: MarginSettings | None = None, speed_error: float = SPEED_ERROR) -> Result:
    """Simulate, listen and compare with the truth."""
    limit = float(stability_limit(cut.system, np.array([cut.spindle.speed_rpm]))[0])
    ratio, damping = cut.kappa / limit, rightmost_root(cut.system).damping_ratio
    margins = hear(cut, settings or MarginSettings(), speed_error)
    late = [margin for margin in margins[-100:] if margin.ratio is not None]
    if not late:
        return Result(cut, ratio, damping, margins[-1], np.inf, np.inf)
    return Result(
        cut,
        ratio,
        damping,
        margins[-1],
        float(np.median([abs(margin.ratio / ratio - 1.0) for margin in late])),
        float(np.median([abs(margin.damping_rightmost - damping) for margin in late])),
    )


HEADER = (
    "                        cuts     not   error of the ratio, %   within   95 % interval holds       damping error\n"
    "                             visible  median  80th percentile    15 %   ratio  kappa damping     median  in 0.005"
)


def row(name: str, results: list[Result]) -> str:
    """One line of a table."""
    errors = np.array([100 * result.ratio_error for result in results])
    eightieth = np.quantile(errors, 0.8, method="higher")  # what was not heard is off by infinity
    damping = np.array([result.damping_error for result in results])
    heard = [result for result in results if result.heard.ratio is not None]
    if not heard:
        return f"{name:22} {len(results):5d}  nothing was heard in any"
    held = [
        (
            h.heard.ratio_ci95[0] <= h.ratio <= h.heard.ratio_ci95[1],
            abs(h.heard.kappa - h.cut.kappa) <= 1.96 * h.heard.kappa_sd,
            h.heard.damping_ci95[0] <= h.damping <= h.heard.damping_ci95[1],
        )
        for h in heard
    ]
    ratio, kappa, rightmost = np.mean(held, axis=0)
    invisible = np.mean([result.heard.margin_percent is None for result in results])
    return (
        f"{name:22} {len(results):5d} {invisible:8.2f} {np.median(errors):7.1f} {eightieth:14.1f}"
        f" {np.mean(errors <= 15):10.2f} {ratio:8.3f} {kappa:6.3f} {rightmost:7.3f} {np.median(damping):11.4f}"
        f" {np.mean(damping <= 0.005):10.3f}"
    )


def split(results: list[Result], values: Iterable[object], of: str) -> Iterable[tuple[str, list[Result]]]:
    """Results by a property of the cut; no empty parts."""
    for value in values:
        part = [r for r in results if getattr(r.cut, of, None) == value]
        if part:
            yield f"{of} {value}", part


CIRCUMSTANCES: dict[str, dict[str, object]] = {
    "spindle lines -10 dB": {"lines_db": -10.0},
    "spindle lines 0 dB": {"lines_db": 0.0},
    "second mode at 1.4 f": {"second_mode": (1.4, 0.03, 0.5)},
    "second mode at 1.9 f": {"second_mode": (1.9, 0.02, 0.7)},
    "teeth modulate by 50 %": {"tooth_modulation": 0.5},
    "teeth modulate by 80 %": {"tooth_modulation": 0.8},
    "kappa unsteady 15 %": {"unsteadiness": 0.15},
    "speed wanders 0.1 %": {"speed_wander": 0.001},
    "speed wanders 0.3 %": {"speed_wander": 0.003},
}


def cost() -> str:
    """Time per sample, next to that of the tracker in the same run."""
    cut = draw(REPORT_SEED)
    y = np.tile(simulate(replace(cut, mode=Mode(990.0, 0.03), kappa=0.03)), 5)
    margins, tracker = MarginTracker(MarginSettings(), RATE_HZ, cut.spindle.teeth), Tracker(TrackerSettings())
    first = round(DURATION_S * RATE_HZ)
    rotation_hz = cut.spindle.speed_rpm / 60.0
    margins.process(y[:first], rotation_hz)
    list(tracker.process(0, y[:first]))
    start = time.perf_counter()
    margins.process(y[first:], rotation_hz)
    middle = time.perf_counter()
    list(tracker.process(first, y[first:]))
    end = time.perf_counter()
    each = 1e6 / (len(y) - first)
    return f"{each * (middle - start):.2f} us a sample; the tracker itself takes {each * (end - middle):.2f} us"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--harder", type=int, default=40, help="cases for each of the harder circumstances")
    parser.add_argument("--development", action="store_true", help="seeds that may be looked at while developing")
    arguments = parser.parse_args()
    first = 0 if arguments.development else REPORT_SEED
    seeds = range(first, first + arguments.cases)
    results = [measure(draw(seed)) for seed in seeds]
    print(HEADER)
    print(row("all", results))
    for fraction in FRACTIONS:
        print(row(f"{100 * fraction:.0f} % of the limit", [r for r in results if abs(r.ratio - fraction) < 0.01]))
    for name, part in (*split(results, SENSORS, "sensor"), *split(results, SNR_DB, "snr_db")):
        print(row(name, part))
    nulls = [hear(replace(result.cut, kappa=0.0), MarginSettings(), SPEED_ERROR)[-1] for result in results]
    visible = np.mean([margin.margin_percent is not None for margin in nulls])
    print(f"\nno regeneration at all, {len(nulls)} cuts: visible in {visible:.3f} of them")
    print(f"cost: {cost()}", flush=True)
    few = seeds[: arguments.harder]
    if not few:
        return
    print(f"\nharder circumstances, the first {len(few)} seeds\n{HEADER}")
    print(row("none", results[: len(few)]), flush=True)
    for name, circumstances in CIRCUMSTANCES.items():
        print(row(name, [measure(draw(seed, **circumstances)) for seed in few]), flush=True)
    uncertain = MarginSettings(speed_uncertainty=0.01)
    print(row("speed given off by 1 %", [measure(draw(seed), uncertain, 0.01) for seed in few]))


if __name__ == "__main__":
    main()
