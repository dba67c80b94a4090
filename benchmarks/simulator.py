"""Speed of the simulator: a nonlinear two-mode cut against SciPy's solve_ivp on the same equations, in one run.

Both integrate the same noise from eq. (6), interpolated linearly. SciPy gets a shorter stretch, because it is slow, and
the ratio is per second of signal; the difference of the two solutions shows that they solve the same thing.

Run: python -m benchmarks.simulator
"""

from __future__ import annotations

import time

import numpy as np
from scipy.integrate import solve_ivp

from chatter_monitor.kernels.oscillator import OK, integrate
from chatter_monitor.physics.excitation import random_force
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode
from chatter_monitor.physics.simulate import simulate
from chatter_monitor.physics.terms import CATALOGUE

LONG_S, SHORT_S = 60.0, 0.5
STEP_S = 1.0 / 51200.0
FRICTION, WIDTH, CUBIC = 2e5, 200.0, 0.05


def two_modes() -> MachiningSystem:
    """Modes at 412 and 990 Hz with a hardening joint and friction."""
    return MachiningSystem(
        (Mode(412.0, 0.02), Mode(990.0, 0.03)),
        (
            AppliedTerm(CATALOGUE["cubic_stiffness"], {"coefficient": CUBIC}),
            AppliedTerm(CATALOGUE["coulomb_friction"], {"coefficient": FRICTION, "width": WIDTH}),
        ),
    )


def kernel_alone(system: MachiningSystem, drive: np.ndarray) -> tuple[np.ndarray, float]:
    """Displacement and seconds taken by the compiled integrator."""
    x, v, a = np.zeros((3, drive.size - 1))
    start = time.perf_counter()
    status = integrate(system.oscillator(), drive, STEP_S, 0, np.zeros((2, 0)), x, v, a)
    seconds = time.perf_counter() - start
    if status != OK:
        raise RuntimeError("the benchmark's system has become unstable")
    return x, seconds


def scipy_alone(system: MachiningSystem, drive: np.ndarray) -> tuple[np.ndarray, float]:
    """Same, by solve_ivp on the equations written out in Python."""
    w = np.array([mode.omega for mode in system.modes])
    zeta = np.array([mode.damping_ratio for mode in system.modes])
    grid = STEP_S * np.arange(drive.size)

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        x, v = y[:2].sum(), y[2:].sum()
        n = min(int(t / STEP_S), drive.size - 2)
        pulse = drive[n] + (t / STEP_S - n) * (drive[n + 1] - drive[n])
        push = pulse - CUBIC * w[0] ** 2 * x**3 - FRICTION * np.tanh(v / WIDTH)
        return np.concatenate((y[2:], push - 2.0 * zeta * w * y[2:] - w**2 * y[:2]))

    start = time.perf_counter()
    solution = solve_ivp(rates, (0.0, grid[-1]), np.zeros(4), t_eval=grid[:-1], rtol=1e-5)
    return solution.y[:2].sum(axis=0), time.perf_counter() - start


def main() -> None:
    """Measure and print."""
    system = two_modes()
    start = time.perf_counter()
    simulate(system, 0.01, seed=1)
    print(f"first call, compiling or loading what was compiled      {time.perf_counter() - start:8.2f} s")
    start = time.perf_counter()
    simulate(system, LONG_S, seed=1)
    whole = time.perf_counter() - start
    print(f"simulate, {LONG_S:.0f} s of signal with noise and anti-aliasing   {whole:8.2f} s")

    grid = STEP_S * np.arange(int(LONG_S / STEP_S) + 1)
    drive = random_force(system, grid, STEP_S, np.random.default_rng(1))
    ours, ours_s = kernel_alone(system, drive)
    short = int(SHORT_S / STEP_S)
    theirs, theirs_s = scipy_alone(system, drive[: short + 1])
    difference = np.std(ours[:short] - theirs) / np.std(theirs)
    ratio = (theirs_s / SHORT_S) / (ours_s / LONG_S)
    for name, seconds in (("integrator alone", ours_s / LONG_S), ("solve_ivp (RK45, rtol 1e-5)", theirs_s / SHORT_S)):
        print(f"{name:56}{seconds * 1e3:8.1f} ms per second of signal")
    print(f"ratio {ratio:.0f}; relative rms difference of the solutions {difference:.1e}")


if __name__ == "__main__":
    main()
