"""How near the tracker comes to the Cramer-Rao bound, and how often its 95 % intervals hold.

Simulated ARMA(4, 3) with known poles, stationary; independent windows are taken ten memories apart. The bound is that
of the same ARMA for the tracker's effective window, (1 + lambda) / (1 - lambda) samples: cov(theta) = R^-1 (1 - lambda)
/ (1 + lambda) with R = E[psi psi'] / sigma^2 from the true parameters, carried to frequency and damping by the delta
method. Nothing was tuned on these seeds.

With ``--bands`` the whole tracker, with one octave and more, follows three modes at once (each driven by white noise of
its own, all of the same power), which no single RARMA(4, 3) can hold. A mode counts as seen where the nearest slot is
within 10 % of its frequency.

Run: python -m benchmarks.tracker_accuracy [--windows N] [--bands]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from chatter_monitor.kernels import track
from chatter_monitor.tracking.tracker import Tracker, TrackerSettings

RATE_HZ = 12800.0
MEMORY_S = 0.08
GAP_MEMORIES = 10
SEED = 20130901

# (frequency Hz, damping ratio) of both modes; zeros of C
CASES: dict[str, tuple[list[tuple[float, float]], list[complex]]] = {
    "400 Hz 3 %, 2000 Hz 2 %": ([(400, 0.03), (2000, 0.02)], [0.5, 0.3 + 0.4j, 0.3 - 0.4j]),
    "900 Hz 2 %, 3000 Hz 2 %": ([(900, 0.02), (3000, 0.02)], [-0.27, 0.44 + 0.55j, 0.44 - 0.55j]),
    "990 Hz 0.5 %, 1500 Hz 2 %": ([(990, 0.005), (1500, 0.02)], [-0.9, 0.78 + 0.54j, 0.78 - 0.54j]),
    "95 Hz 3 %, 990 Hz 3 %": ([(95, 0.03), (990, 0.03)], [0.5, 0.3 + 0.4j, 0.3 - 0.4j]),
}

# (frequency Hz, damping ratio): the paper's milling case, a table and a tool, and a third mode above them; and with two
# modes in the lowest octaves
TOGETHER = (
    [(95.0, 0.03), (990.0, 0.03), (3000.0, 0.02)],
    [(95.0, 0.03), (500.0, 0.03), (990.0, 0.03), (3000.0, 0.02)],
)
SEEN_WITHIN = 0.1


@dataclass(frozen=True)
class Accuracy:
    """Errors of one mode over all windows, relative to the bound."""

    frequency_rmse_to_bound: float
    damping_rmse_to_bound: float
    damping_bound: float
    frequency_coverage: float
    damping_coverage: float
    without_frequency: int


def autoregression(modes: list[tuple[float, float]], rate_hz: float = RATE_HZ) -> NDArray[np.float64]:
    """Coefficients 1, a1..ap whose poles have these (frequency Hz, damping ratio)."""
    a = np.array([1.0])
    for frequency_hz, damping in modes:
        omega = 2 * np.pi * frequency_hz / rate_hz
        mu = np.exp(omega * (-damping + 1j * np.sqrt(1 - damping**2)))
        a = np.convolve(a, [1.0, -2 * mu.real, abs(mu) ** 2])
    return a


def bound(
    a: NDArray[np.float64], c: NDArray[np.float64], modes: list[tuple[float, float]], window: float, seed: int
) -> NDArray[np.float64]:
    """Cramer-Rao standard deviations of frequency (Hz) and damping ratio, shape (modes, 2)."""
    p, q = len(a) - 1, len(c) - 1
    e = np.random.default_rng(seed).standard_normal(1_000_000)
    # psi: the regressors filtered by 1/C
    y_filtered = lfilter([1.0], c, lfilter(c, a, e))
    e_filtered = lfilter([1.0], c, e)
    lags = max(p, q)
    psi = [-y_filtered[lags - i : len(e) - i] for i in range(1, p + 1)]
    psi += [e_filtered[lags - i : len(e) - i] for i in range(1, q + 1)]
    regressors = np.array(psi)[:, 10_000:]
    covariance = np.linalg.inv(regressors @ regressors.T / regressors.shape[1])[:p, :p] / window
    slope = np.polyder(a)
    result = []
    for frequency_hz, damping in modes:
        log_mu = 2 * np.pi * frequency_hz / RATE_HZ * (-damping + 1j * np.sqrt(1 - damping**2))
        mu = np.exp(log_mu)
        gradient = -(mu ** (p - 2.0 - np.arange(p))) / np.polyval(slope, mu)
        omega = abs(log_mu)
        omega_gradient = (np.conj(log_mu) * gradient).real / omega
        damping_gradient = -gradient.real / omega + log_mu.real / omega**2 * omega_gradient
        result.append(
            [
                np.sqrt(omega_gradient @ covariance @ omega_gradient) * RATE_HZ / (2 * np.pi),
                np.sqrt(damping_gradient @ covariance @ damping_gradient),
            ]
        )
    return np.array(result)


def measure(modes: list[tuple[float, float]], zeros: list[complex], windows: int, seed: int = SEED) -> list[Accuracy]:
    """Run the tracker over `windows` independent windows of one case."""
    a = autoregression(modes)
    c = np.poly(zeros).real
    p, q = len(a) - 1, len(c) - 1
    forgetting = 1 - 1 / (MEMORY_S * RATE_HZ)
    gap = round(GAP_MEMORIES * MEMORY_S * RATE_HZ)
    rng = np.random.default_rng(seed)
    state = track.new_state(p, q, np.array([forgetting]), np.array([RATE_HZ]), 0)
    out = (*(np.zeros((1, p // 2, gap), np.float32) for _ in range(4)), np.zeros((1, p // 2, gap), np.uint8))
    memory = np.zeros(p)
    rows = []
    for _ in range(windows + 1):
        y, memory = lfilter(c, a, rng.standard_normal(gap), zi=memory)
        track.track(p, q, y[None], state, out)
        rows.append([column[0, :, -1].astype(float) for column in out[:4]])
    estimates = np.array(rows[1:])  # window, quantity, mode
    by_frequency = np.argsort(estimates[:, :1, :], axis=2)  # a slot may have met its mode crossing the other's
    estimates = np.take_along_axis(estimates, by_frequency, axis=2)
    limits = bound(a, c, modes, (1 + forgetting) / (1 - forgetting), seed + 1)
    result = []
    for m, (frequency_hz, damping) in enumerate(modes):
        good = np.isfinite(estimates[:, 0, m])
        frequency, ratio, frequency_sd, ratio_sd = estimates[good, :, m].T
        result.append(
            Accuracy(
                float(np.sqrt(np.mean((frequency - frequency_hz) ** 2)) / limits[m, 0]),
                float(np.sqrt(np.mean((ratio - damping) ** 2)) / limits[m, 1]),
                float(limits[m, 1]),
                float(np.mean(abs(frequency - frequency_hz) < 1.96 * frequency_sd)),
                float(np.mean(abs(ratio - damping) < 1.96 * ratio_sd)),
                int((~good).sum()),
            )
        )
    return result


@dataclass(frozen=True)
class Sight:
    """How the whole tracker sees one mode over all windows; errors where it is seen at all."""

    seen: float
    frequency_rmse: float  # relative
    damping_bias: float
    damping_rmse: float
    frequency_coverage: float
    damping_coverage: float


def sight(modes: list[tuple[float, float]], bands: int, windows: int, seed: int = SEED) -> list[Sight]:
    """Follow all modes at once; read the last sample of every window."""
    gap = round(GAP_MEMORIES * MEMORY_S * RATE_HZ)
    streams = np.random.default_rng(seed).spawn(len(modes))
    parts = []
    for mode, rng in zip(modes, streams, strict=True):
        part = lfilter([1.0], autoregression([mode]), rng.standard_normal((windows + 1) * gap))
        parts.append(part / np.std(part))
    tracker = Tracker(TrackerSettings(bands=bands))
    every = gap // round(0.05 * RATE_HZ)
    frames = list(tracker.process(0, np.sum(parts, axis=0)))[2 * every - 1 :: every]
    columns = ("frequency_hz", "damping_ratio", "frequency_sd_hz", "damping_sd")
    estimates = np.array([[getattr(frame, name)[-1] for name in columns] for frame in frames], float)
    result = []
    for frequency_hz, damping in modes:
        away = np.abs(np.nan_to_num(estimates[:, 0], nan=np.inf) / frequency_hz - 1.0)
        slot = np.argmin(away, axis=1)
        seen = away[np.arange(len(slot)), slot] < SEEN_WITHIN
        frequency, ratio, frequency_sd, ratio_sd = estimates[np.arange(len(slot)), :, slot][seen].T
        if not seen.any():
            result.append(Sight(0.0, *(np.nan for _ in range(5))))
            continue
        result.append(
            Sight(
                float(seen.mean()),
                float(np.sqrt(np.mean((frequency / frequency_hz - 1.0) ** 2))),
                float(np.mean(ratio) - damping),
                float(np.sqrt(np.mean((ratio - damping) ** 2))),
                float(np.mean(abs(frequency - frequency_hz) < 1.96 * frequency_sd)),
                float(np.mean(abs(ratio - damping) < 1.96 * ratio_sd)),
            )
        )
    return result


def print_bands(windows: int) -> None:
    """Print what each number of octaves makes of three modes at once."""
    print(f"{windows} windows, {TrackerSettings().memory_ms:.0f} ms memory, all modes at once, seed {SEED}")
    print("bands  mode            seen   frequency    damping    damping   95 % interval holds")
    print("                             rms error %      bias  rms error   frequency  damping")
    for modes, bands in product(TOGETHER, range(1, 6)):
        for (frequency_hz, damping), row in zip(modes, sight(modes, bands, windows), strict=True):
            print(
                f"{bands:5d} {frequency_hz:5.0f} Hz {damping:5.3f} {row.seen:9.3f} {100 * row.frequency_rmse:11.2f} "
                f"{row.damping_bias:10.4f} {row.damping_rmse:10.4f} {row.frequency_coverage:11.3f} "
                f"{row.damping_coverage:8.3f}"
            )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--windows", type=int, default=2000)
    parser.add_argument("--bands", action="store_true", help="whole tracker, three modes at once, 1 to 5 octaves")
    arguments = parser.parse_args()
    if arguments.bands:
        print_bands(arguments.windows)
        return
    print(f"{arguments.windows} windows of {MEMORY_S * 1000:.0f} ms memory at {RATE_HZ:.0f} Hz, seed {SEED}")
    print("                                     rms error / bound      95 % interval holds    damping  windows with")
    print("case                       mode      frequency  damping     frequency  damping     bound    a real pair")
    for name, (modes, zeros) in CASES.items():
        for (frequency_hz, damping), row in zip(modes, measure(modes, zeros, arguments.windows), strict=True):
            print(
                f"{name:26} {frequency_hz:5.0f} {damping:5.3f} {row.frequency_rmse_to_bound:8.2f} "
                f"{row.damping_rmse_to_bound:8.2f} {row.frequency_coverage:13.3f} {row.damping_coverage:8.3f} "
                f"{row.damping_bound:10.4f} {row.without_frequency:8d}"
            )


if __name__ == "__main__":
    main()
