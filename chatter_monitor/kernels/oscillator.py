"""Runge-Kutta integration of a modal machining system with any terms, delay and parameters that change with time.

With mass-normalised modal coordinates q_i and participations g_i, the tool moves by x = sum g_i q_i and

    q_i'' + 2 zeta_i w_i q_i' + w_i^2 q_i = g_i [W(t) - sum_k f_k(x, x', s(t - tau), angle, w_1, z_k)]
    z_k' = r_k(x, x', ..., z_k)

W is given at the steps and interpolated linearly between them (paper, text at eq. (6)). What a tooth meets is not the
displacement of the tooth before, but the surface that it left: s(t) = min(x(t), s(t - tau) + chip thickness), which is
the displacement as long as the tool stays in the cut (Tlusty and Ismail 1981, the paper's [11]). Its past is
interpolated by cubic Hermite polynomials, which keeps the order of the method.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.forces import call_force

OK = -1  # status of a run that stayed finite
PER_MODE = 3  # w, zeta, participation
PER_SPINDLE = 2  # rad/s, chip thickness


class Oscillator(NamedTuple):
    """The equations and where the motion stands; a run changes the arrays below the line in place."""

    knots_s: np.ndarray  # (k,) times at which the parameters are given
    table: np.ndarray  # (k, p) parameters there: of each mode, of the spindle, of each term
    modes: int
    teeth: int
    forces: np.ndarray  # (t,) addresses of the compiled terms
    columns: np.ndarray  # (t,) column of the first parameter of each term
    rates: np.ndarray  # (t,) addresses of their memory rates, 0 for none
    # ----
    current: np.ndarray  # (p,) parameters of the present step
    y: np.ndarray  # (2 modes + t,) q, q', z
    slopes: np.ndarray  # (4, 2 modes + t) of the Runge-Kutta stages
    trial: np.ndarray  # (2 modes + t,)
    clock: np.ndarray  # (1,) steps done
    angle: np.ndarray  # (1,) spindle angle in rad


def oscillator(knots_s, table, modes, teeth, forces, columns, rates) -> Oscillator:
    """Put the oscillator at rest at time zero."""
    size = 2 * modes + forces.size
    return Oscillator(
        knots_s,
        table,
        modes,
        teeth,
        forces,
        columns,
        rates,
        table[0].copy(),
        np.zeros(size),
        np.zeros((4, size)),
        np.zeros(size),
        np.zeros(1, np.int64),
        np.zeros(1),
    )


@njit(cache=True, nogil=True)
def interpolate_parameters(system, time_s):
    """Set the current parameters: linear between the knots, constant outside."""
    knots, table, current = system.knots_s, system.table, system.current
    after = 0
    while after < knots.size and knots[after] < time_s:
        after += 1
    before = max(after - 1, 0)
    after = min(after, knots.size - 1)
    share = (time_s - knots[before]) / (knots[after] - knots[before]) if after > before else 0.0
    for i in range(current.size):
        current[i] = (1.0 - share) * table[before, i] + share * table[after, i]


@njit(cache=True, nogil=True)
def _surface_then(surface, now, delay_steps, step_s):
    """Surface and its slope some steps ago from those at the steps around; zero before the record."""
    back = int(np.ceil(delay_steps))
    i = now - back
    if i < 0:
        return 0.0, 0.0
    s = back - delay_steps
    r = 1.0 - s
    x0, x1, v0, v1 = surface[0, i], surface[0, i + 1], surface[1, i], surface[1, i + 1]
    position = r * r * (1.0 + 2.0 * s) * x0 + s * s * (1.0 + 2.0 * r) * x1 + step_s * s * r * (r * v0 - s * v1)
    return position, 6.0 * s * r * (x1 - x0) / step_s + r * (1.0 - 3.0 * s) * v0 + s * (3.0 * s - 2.0) * v1


@njit(cache=True, nogil=True, forceinline=True)  # a call would pass all arrays: four times slower
def _derivative(system, y, drive, lagged, angle, slope):
    """Right-hand side at one state; returns x, x', x'' of the tool."""
    modes, p = system.modes, system.current
    x = 0.0
    v = 0.0
    for i in range(modes):
        g = p[PER_MODE * i + 2]
        x += g * y[i]
        v += g * y[modes + i]
    push = drive
    for k in range(system.forces.size):
        z = y[2 * modes + k]
        parameters = p.ctypes.data + 8 * system.columns[k]
        push -= call_force(system.forces[k], x, v, lagged, angle, p[0], z, parameters)
        slope[2 * modes + k] = 0.0
        if system.rates[k] != 0:
            slope[2 * modes + k] = call_force(system.rates[k], x, v, lagged, angle, p[0], z, parameters)
    acceleration = 0.0
    for i in range(modes):
        w = p[PER_MODE * i]
        zeta = p[PER_MODE * i + 1]
        g = p[PER_MODE * i + 2]
        slope[i] = y[modes + i]
        slope[modes + i] = g * push - 2.0 * zeta * w * y[modes + i] - w * w * y[i]
        acceleration += g * slope[modes + i]
    return x, v, acceleration


@njit(cache=True, nogil=True)
def integrate(system, drive, step_s, history, surface, x, v, a):
    """Advance by ``drive.size - 1`` steps of the classical fourth-order method.

    Parameters
    ----------
    system : Oscillator
        Changed in place; calling again with the next stretch of `drive` continues bit-identically.
    drive : ndarray of float64, shape (n + 1,)
        W at the steps of this stretch and at the first of the next.
    step_s : float
        Step; the delay has to be longer than two of them.
    history : int
        How many steps of the past stand at the head of `surface` (at least the delay and two more); 0 without delay.
    surface : ndarray of float64, shape (2, history + n)
        Surface left by the tool and its slope; filled at the beginning of each step. Anything without delay.
    x, v, a : ndarray of float64, shape (n,)
        Filled with displacement, velocity and acceleration at the beginning of each step.

    Returns
    -------
    int
        `OK`, or the step of this stretch at which the motion ceased to be finite.
    """
    y, k, trial = system.y, system.slopes, system.trial
    spindle = PER_MODE * system.modes
    if system.clock[0] == 0:
        interpolate_parameters(system, 0.0)
    for n in range(drive.size - 1):
        if system.knots_s.size > 1:
            interpolate_parameters(system, (system.clock[0] + 0.5) * step_s)
        now = history + n
        speed = system.current[spindle]
        delay = 2.0 * np.pi / (speed * system.teeth) / step_s if speed > 0.0 else 0.0
        angle = system.angle[0]
        halfway = 0.5 * (drive[n] + drive[n + 1])
        early = 0.0
        middle = 0.0
        late = 0.0
        early_slope = 0.0
        if history > 0:
            early, early_slope = _surface_then(surface, now, delay, step_s)
            middle, _ = _surface_then(surface, now, delay - 0.5, step_s)
            late, _ = _surface_then(surface, now, delay - 1.0, step_s)
        x[n], v[n], a[n] = _derivative(system, y, drive[n], early, angle, k[0])
        if history > 0:
            missed = x[n] - early > system.current[spindle + 1]
            surface[0, now] = early + system.current[spindle + 1] if missed else x[n]
            surface[1, now] = early_slope if missed else v[n]
        if not np.isfinite(a[n]):
            return n
        half_turn = angle + 0.5 * step_s * speed
        for i in range(y.size):
            trial[i] = y[i] + 0.5 * step_s * k[0, i]
        _derivative(system, trial, halfway, middle, half_turn, k[1])
        for i in range(y.size):
            trial[i] = y[i] + 0.5 * step_s * k[1, i]
        _derivative(system, trial, halfway, middle, half_turn, k[2])
        for i in range(y.size):
            trial[i] = y[i] + step_s * k[2, i]
        _derivative(system, trial, drive[n + 1], late, angle + step_s * speed, k[3])
        for i in range(y.size):
            y[i] += step_s / 6.0 * (k[0, i] + 2.0 * k[1, i] + 2.0 * k[2, i] + k[3, i])
        system.angle[0] = angle + step_s * speed
        system.clock[0] += 1
    return OK
