"""Spectrum of one mode with a regenerative delay, and its derivatives by the parameters.

    x'' + 2 zeta w x' + w^2 x + kappa a(t) w^2 [x - x(t - tau)] = a(t) W

The teeth modulate the process, and the noise that comes of it, by a(t) = 1 + m cos(2 pi t / tau). With r = omega / w
the dynamic stiffness of the mode is d(r) = 1 - r^2 + 2 i zeta r, what the delay adds G = kappa [1 - exp(-i omega tau)],
all over w^2. Because a tooth period is the delay, G is the same a tooth frequency above and below, and

    d(r) X(r) + G [X(r) + m / 2 (X(r - r_t) + X(r + r_t))] = F(r)

couples three of them if what comes from beyond is left out (one harmonic of Hill's infinite determinant; Budak and
Altintas 1998). The outer two are eliminated: with u = -m / 2 G / [d(r - r_t) + G], and v the same of r + r_t,

    X(r) = [F(r) + u F(r - r_t) + v F(r + r_t)] / D,    D = d(r) + G + m / 2 G (u + v).

Noise that a(t) modulates is correlated at frequencies a tooth frequency or two apart, by c_1 = m / (1 + m^2 / 2) and
c_2 = m^2 / 4 / (1 + m^2 / 2), so that the signal has the spectrum

    [1 + |u|^2 + |v|^2 + 2 c_1 Re(u + v) + 2 c_2 Re(u conj(v))] / |D|^2.

It is that correlation that matters: where a mode forgets within a tooth period, it is heard while it is cut with most,
and kappa would be read too large, by a third where teeth enter and leave.

What a sensor delivers is S = gain (omega / omega_0)^slope times that, plus a floor: the slope is 0, 2 or 4 for
displacement, velocity and acceleration and takes up the colour of the force, the floor is the sensor's noise.

A spindle wanders while the periodogram is averaged, and tau with it: then S is the mean of three, with delays of tau
and of sqrt(3) spreads to either side (Gauss-Hermite: exact up to the fifth power). It is a mean of spectra and no loss
of coherence, because a mode forgets sooner than a spindle changes its speed.
"""

import cmath
import math

from numba import njit

from chatter_monitor.kernels.options import SUMS

# Indices into the parameters
LOG_GAIN, SLOPE, LOG_OMEGA, LOG_ZETA, KAPPA, LOG_TAU, LOG_SPREAD, MODULATION, LOG_FLOOR = range(9)
PARAMETERS = 9

# Delays that the spectrum is averaged over: how many spreads from the mean, and their weights.
DELAYS = 3
_OFFSETS, _WEIGHTS = (0.0, math.sqrt(3.0), -math.sqrt(3.0)), (2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0)

# Places of a row of the work space, for the bins of a tile and what lies around them: whole vectors.
ROOM = 72
# Rows: how far the wave of each delay turns from place to place.
TURN_REAL, TURN_IMAG, TURNS = 0, ROOM, 2 * ROOM
# Rows from where a spectrum is wanted: the logarithm of the frequency, then the signal and its derivatives.
SIGNAL = ROOM


@njit(inline="always", **SUMS)
def _exponential(x):
    """exp(x) by the series for x / 64: relative 1e-12 up to 5, which the compiler can do for several x at once."""
    y = x / 64.0
    series = 1 / 6 + y * (1 / 24 + y * (1 / 120 + y * (1 / 720 + y * (1 / 5040 + y * (1 / 40320)))))
    power = 1.0 + y * (1.0 + y * (0.5 + y * series))
    for _ in range(6):
        power *= power
    return power


@njit(inline="always", **SUMS)
def turn(theta, bin_width, delays, work):
    """Fill the rows that tell how far the wave of each delay turns."""
    for delay in range(delays):
        step = cmath.exp(complex(0.0, -bin_width * _delay(theta, delays, delay)[0]))
        wave = complex(1.0, 0.0)
        for t in range(delay * TURNS, delay * TURNS + ROOM):
            work[TURN_REAL + t], work[TURN_IMAG + t] = wave.real, wave.imag
            wave *= step


@njit(inline="always", **SUMS)
def respond(theta, omega, bin_width, delays, work, rows):
    """Fill rows with the signal and its derivatives at places a bin apart, the first at the angular frequency omega."""
    for delay in range(delays):
        if theta[MODULATION] == 0.0:  # the same, but three times as fast
            _respond_steadily(theta, omega, bin_width, delays, delay, work, rows)
        else:
            _respond_to_teeth(theta, omega, bin_width, delays, delay, work, rows)


@njit(inline="always", **SUMS)
def _respond_steadily(theta, omega, bin_width, delays, delay, work, rows):
    """Do what `respond` does for one of the delays, and teeth that do not modulate."""
    gain, slope = math.exp(theta[LOG_GAIN]), theta[SLOPE]
    inverse_w = math.exp(-theta[LOG_OMEGA])  # of 1 / w the compiler makes a division in each place again
    zeta, kappa = math.exp(theta[LOG_ZETA]), theta[KAPPA]
    tau, off, share = _delay(theta, delays, delay)
    real, imag = math.cos(omega * tau), -math.sin(omega * tau)
    for t in range(ROOM):
        turned = omega + t * bin_width
        cosine, sine = _wave(real, imag, work, delay, t)
        r = turned * inverse_w
        damper = 2.0 * zeta * r
        in_phase = 1.0 - r * r + kappa * (1.0 - cosine)
        quadrature = damper - kappa * sine
        compliance = 1.0 / (in_phase * in_phase + quadrature * quadrature)
        log_frequency = work[rows + t]
        signal = share * gain * _exponential(slope * log_frequency) * compliance
        # d signal = -2 signal Re(dD / D)
        x = -2.0 * signal * compliance * in_phase
        y = -2.0 * signal * compliance * quadrature
        by_tau = kappa * turned * (y * cosine - x * sine)
        by_kappa = x * (1.0 - cosine) - y * sine
        by_omega, by_zeta = x * 2.0 * r * r - y * damper, y * damper
        _put(
            work, rows + SIGNAL + t, delay == 0,
            signal, signal * log_frequency, by_omega, by_zeta, by_kappa, by_tau * tau, by_tau * off, 0.0,
        )  # fmt: skip


@njit(inline="always", **SUMS)
def _respond_to_teeth(theta, omega, bin_width, delays, delay, work, rows):
    """Do what `respond` does for one of the delays, and teeth that modulate."""
    gain, slope = math.exp(theta[LOG_GAIN]), theta[SLOPE]
    inverse_w = math.exp(-theta[LOG_OMEGA])
    zeta, kappa = math.exp(theta[LOG_ZETA]), theta[KAPPA]
    half = 0.5 * theta[MODULATION]
    # how much noise a tooth period and two of them apart have in common: the spectrum of the modulation's square
    power = 1.0 / (1.0 + 2.0 * half * half)
    one, two = 2.0 * half * power, half * half * power
    one_by_half, two_by_half = 2.0 * (1.0 - 2.0 * half * half) * power * power, 2.0 * half * power * power
    tooth = 2.0 * math.pi * math.exp(-theta[LOG_TAU]) * inverse_w
    tau, off, share = _delay(theta, delays, delay)
    real, imag = math.cos(omega * tau), -math.sin(omega * tau)
    for t in range(ROOM):
        turned = omega + t * bin_width
        cosine, sine = _wave(real, imag, work, delay, t)
        r = turned * inverse_w
        below, above = r - tooth, r + tooth
        delayed_x, delayed_y = kappa * (1.0 - cosine), -kappa * sine
        # dynamic stiffness a tooth frequency below, here, above; what couples them
        here_x, here_y = 1.0 - r * r + delayed_x, 2.0 * zeta * r + delayed_y
        low_x, low_y = _reciprocal(1.0 - below * below + delayed_x, 2.0 * zeta * below + delayed_y)
        high_x, high_y = _reciprocal(1.0 - above * above + delayed_x, 2.0 * zeta * above + delayed_y)
        q_x, q_y = half * delayed_x, half * delayed_y
        u_x, u_y = _negative_product(q_x, q_y, low_x, low_y)
        v_x, v_y = _negative_product(q_x, q_y, high_x, high_y)
        # D = here - q^2 (1 / low + 1 / high) = here + q (u + v)
        into_x, into_y = _product(q_x, q_y, u_x + v_x, u_y + v_y)
        inverse_x, inverse_y = _reciprocal(here_x + into_x, here_y + into_y)
        shared = u_x * v_x + u_y * v_y
        noise = 1.0 + u_x * u_x + u_y * u_y + v_x * v_x + v_y * v_y + 2.0 * (one * (u_x + v_x) + two * shared)
        log_frequency = work[rows + t]
        signal = (
            share * gain * _exponential(slope * log_frequency) * noise
            * (inverse_x * inverse_x + inverse_y * inverse_y)
        )  # fmt: skip
        # d signal / signal = Re(by_here d here + by_u du + by_v dv + ...), D changing with u and v by q
        by_here_x, by_here_y = -2.0 * inverse_x, -2.0 * inverse_y
        both_x, both_y = _product(by_here_x, by_here_y, q_x, q_y)
        twice = 2.0 / noise
        by_u_x, by_u_y = both_x + twice * (u_x + one + two * v_x), both_y - twice * (u_y + two * v_y)
        by_v_x, by_v_y = both_x + twice * (v_x + one + two * u_x), both_y - twice * (v_y + two * u_y)
        # u = -q low: du = -low dq - u low d(1 / low)
        less_x, less_y = _product(low_x, low_y, by_u_x, by_u_y)
        more_x, more_y = _product(high_x, high_y, by_v_x, by_v_y)
        by_low_x, by_low_y = _negative_product(u_x, u_y, less_x, less_y)
        by_high_x, by_high_y = _negative_product(v_x, v_y, more_x, more_y)
        own_x, own_y = _product(by_here_x, by_here_y, u_x + v_x, u_y + v_y)
        by_q_x, by_q_y = own_x - less_x - more_x, own_y - less_y - more_y
        delayed_by_x = by_low_x + by_here_x + by_high_x + half * by_q_x
        delayed_by_y = by_low_y + by_here_y + by_high_y + half * by_q_y
        damped = -2.0 * zeta * (by_low_y * below + by_here_y * r + by_high_y * above)
        inert = 2.0 * (by_low_x * below * below + by_here_x * r * r + by_high_x * above * above)
        by_kappa = delayed_by_x * (1.0 - cosine) + delayed_by_y * sine
        by_tau = -kappa * turned * (delayed_by_x * sine + delayed_by_y * cosine)
        nearer = 2.0 * tooth * (by_high_x * above - by_low_x * below + zeta * (by_high_y - by_low_y))
        by_half = delayed_x * by_q_x - delayed_y * by_q_y
        by_half += twice * (one_by_half * (u_x + v_x) + two_by_half * shared)
        _put(
            work, rows + SIGNAL + t, delay == 0,
            signal, signal * log_frequency, signal * (inert - damped), signal * damped, signal * by_kappa,
            signal * (by_tau * tau + nearer), signal * by_tau * off, signal * 0.5 * by_half,
        )  # fmt: skip


@njit(inline="always", **SUMS)
def _wave(real, imag, work, delay, t):
    """exp(-i omega tau) of a delay at a place, by what it is at the first."""
    turned_real, turned_imag = work[delay * TURNS + TURN_REAL + t], work[delay * TURNS + TURN_IMAG + t]
    return _product(real, imag, turned_real, turned_imag)


@njit(inline="always", **SUMS)
def _product(a_x, a_y, b_x, b_y):
    """Of two complex numbers, by their parts."""
    return a_x * b_x - a_y * b_y, a_x * b_y + a_y * b_x


@njit(inline="always", **SUMS)
def _negative_product(a_x, a_y, b_x, b_y):
    """Of two complex numbers, times -1."""
    return a_y * b_y - a_x * b_x, -a_x * b_y - a_y * b_x


@njit(inline="always", **SUMS)
def _reciprocal(x, y):
    """Of a complex number."""
    scale = 1.0 / (x * x + y * y)
    return x * scale, -y * scale


@njit(inline="always", **SUMS)
def _delay(theta, delays, delay):
    """One of so many delays, how far it is off the mean, and its weight."""
    tau = math.exp(theta[LOG_TAU])
    if delays == 1:
        return tau, 0.0, 1.0
    off = _OFFSETS[delay] * math.exp(theta[LOG_SPREAD]) * tau
    return tau + off, off, _WEIGHTS[delay]


@njit(inline="always", **SUMS)
def _put(work, place, first, signal, by_slope, by_omega, by_zeta, by_kappa, by_tau, by_spread, by_modulation):
    """Put what the first delay gives in its rows, or add what another one does."""
    _put_one(work, place + LOG_GAIN * ROOM, first, signal)  # its own derivative by the logarithm of the gain
    _put_one(work, place + SLOPE * ROOM, first, by_slope)
    _put_one(work, place + LOG_OMEGA * ROOM, first, by_omega)
    _put_one(work, place + LOG_ZETA * ROOM, first, by_zeta)
    _put_one(work, place + KAPPA * ROOM, first, by_kappa)
    _put_one(work, place + LOG_TAU * ROOM, first, by_tau)
    _put_one(work, place + LOG_SPREAD * ROOM, first, by_spread)
    _put_one(work, place + MODULATION * ROOM, first, by_modulation)


@njit(inline="always", **SUMS)
def _put_one(work, place, first, value):
    """Put the first value in a place, or add another."""
    work[place] = value if first else work[place] + value
