"""Whether the damping potential at small amplitude tells more of a line than how its envelope varies.

The paper's damping potential (eq. 13) is the logarithm of the distribution of the energy, over the intensity of the
noise. Where damping is positive it is least at rest, and the energy is exponential; where the rest is unstable it falls
from there to the limit cycle. Of a gamma distribution E^(k - 1) exp(-E / theta) it is E / theta - (k - 1) ln E: k is 1
for a mode that noise drives, and more the more damping is negative at small amplitude. The likeliest k tells all that
such a fit can tell; the monitor asks for the coefficient of variation of the amplitude.

Modes of 180 to 2200 Hz as slow complex amplitudes, heard through the transforms of the monitor (25 ms, every 12.5 ms):
half are stable, damped by 0.4 to 5 % and driven by noise; half are limit cycles (van der Pol, -0.2 to -2 % at rest)
whose amplitude noise varies by 5 to 40 %, as that of real chatter.

Run: python -m benchmarks.verdict.envelope [--cases N]
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels.narrowband import FRAME_HOPS
from chatter_monitor.tracking.spectrum import WINDOW_S
from chatter_monitor.tracking.tracker import INTERVAL_S

Floats = NDArray[np.float64]

RATE_HZ = 800.0  # of the amplitudes
HOP, WINDOW = round(INTERVAL_S / FRAME_HOPS * RATE_HZ), round(WINDOW_S * RATE_HZ)
SECONDS = (0.5, 1.0, 2.0)
SETTLING_S = 1.0
SEED = 20131
FALSE = 0.01


def energies(rng: np.random.Generator, cases: int, seconds: float, *, chatters: bool) -> Floats:
    """Energy of each transform of a line, shape (transforms, cases)."""
    omega = 2.0 * np.pi * np.exp(rng.uniform(np.log(180.0), np.log(2200.0), cases))
    low, high = (0.002, 0.02) if chatters else (0.004, 0.05)
    rate = omega * np.exp(rng.uniform(np.log(low), np.log(high), cases))  # at which it grows or dies out
    # of a limit cycle; a half makes the power of a mode that noise drives 1, too
    variation = rng.uniform(0.05, 0.4, cases) if chatters else np.full(cases, 0.5)
    kick = variation * np.sqrt(4.0 * rate / RATE_HZ)
    amplitude = np.ones(cases, np.complex128) if chatters else _noise(rng, cases)
    heard = np.empty((round((SETTLING_S + seconds) * RATE_HZ), cases), np.complex128)
    for moment in heard:
        towards = 1.0 - abs(amplitude) ** 2 if chatters else np.full(cases, -1.0)
        amplitude *= np.exp(np.clip(rate * towards, -RATE_HZ, RATE_HZ) / RATE_HZ)
        amplitude += kick * _noise(rng, cases) * 2.0**0.5
        moment[:] = amplitude
    taper = np.hanning(WINDOW + 2)[1:-1]
    first = round(SETTLING_S * RATE_HZ)
    transforms = [taper @ heard[begin : begin + WINDOW] for begin in range(first, len(heard) - WINDOW, HOP)]
    return np.asarray(abs(np.array(transforms)) ** 2)


def _noise(rng: np.random.Generator, cases: int) -> NDArray[np.complex128]:
    """Complex noise of unit power."""
    return np.asarray((rng.standard_normal(cases) + 1j * rng.standard_normal(cases)) / 2.0**0.5)


def measures(energy: Floats) -> dict[str, Floats]:
    """What is told of each case; more of it speaks for a limit cycle."""
    amplitude, mean = np.sqrt(energy), energy.mean(axis=0)
    return {
        "variation of the amplitude": -amplitude.std(axis=0) / amplitude.mean(axis=0),
        "potential: shape k": np.log(energy).mean(axis=0) - np.log(mean),  # the likeliest k rises with it
        "potential: time near rest": -(energy < 0.25 * mean).mean(axis=0),
    }


def recall(stable: Floats, chatter: Floats) -> float:
    """Share of the limit cycles that are told with so many of the others."""
    return float(np.mean(chatter > np.quantile(stable, 1.0 - FALSE)))


def together(stable: Floats, chatter: Floats) -> float:
    """Recall by the linear discriminant of all measures, shapes (cases, measures), learned from every other case."""
    learned = [each[::2] for each in (stable, chatter)]
    spread = sum(np.cov(each.T) for each in learned)
    direction = np.linalg.solve(spread, learned[1].mean(axis=0) - learned[0].mean(axis=0))
    return recall(stable[1::2] @ direction, chatter[1::2] @ direction)


def main() -> None:
    """Simulate, measure, print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.envelope", description=__doc__)
    parser.add_argument("--cases", type=int, default=4000, help="of each kind (default %(default)s)")
    cases = parser.parse_args().cases
    print(f"limit cycles told with {100.0 * FALSE:g} % of the stable modes, % of {cases}, heard for so long")
    for seconds in SECONDS:
        rng = np.random.default_rng(SEED)
        stable, chatter = (measures(energies(rng, cases, seconds, chatters=kind)) for kind in (False, True))
        told = {name: recall(stable[name], chatter[name]) for name in stable}
        told["all together"] = together(*(np.column_stack(list(each.values())) for each in (stable, chatter)))
        print(f"{seconds:g} s: " + ", ".join(f"{name} {100.0 * share:.0f}" for name, share in told.items()))


if __name__ == "__main__":
    main()
