"""How prediction errors answer to forces that the observer does not know: signatures, side by side.

If a machine has one more force phi per unit mass than an `Observer` knows, the error d of the predicted state obeys

    s(k)   = H d(k) + D phi(k)
    d(k+1) = Phi [d(k) - K s(k)] + Gamma_0 phi(k) + Gamma_1 phi(k+1)

and s, the *signature* of the force, is what it adds to the prediction errors. In s, phi(k+1) is taken at the state
predicted from the samples up to k: a state that has seen sample k+1 would leak what is to be predicted. Once it is
seen, a sensor that feels the force (D is not 0) has told the filter what phi really was, and d goes on with phi at the
state that has seen it.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.lanes import as_lanes, fma
from chatter_monitor.kernels.observer import Observer
from chatter_monitor.kernels.options import OPTIONS

GROUP = 8  # forces in a vector of the processor
LANES = 2 * GROUP  # that go side by side: two vectors do not wait for each other
_FEW = 64  # samples that go through a stage together
_NOTHING = 1e-100  # what has died away so far is taken for 0: numbers near the smallest cost a hundred times as much


class Response(NamedTuple):
    """How the error d of the predicted state, n numbers, answers to a force; eliminated from `Observer`.

    With phi(k) the force at sample k once that is known, and p(k) as it was predicted (over the step before, for a
    sensor that does not feel it),

        s(k)   = H d(k) + D p(k)
        d(k+1) = M d(k) + a phi(k) + b p(k+1) + c p(k)
    """

    closed: np.ndarray  # (n, n) M
    known: np.ndarray  # (n,) a
    ahead: np.ndarray  # (n,) b
    before: np.ndarray  # (n,) c
    output: np.ndarray  # (n,) H
    feed: np.ndarray  # (1,) D
    taps: np.ndarray  # (t,) of the filter that whitens s; a multiple of four follow the first


def response_of(observer: Observer, taps: np.ndarray) -> Response:
    """How whitened prediction errors of an observer answer to forces."""
    o = observer
    closed = o.transition @ (np.eye(o.gain.size) - np.outer(o.gain, o.output))
    # A sensor that feels the force tells, once it is known, by how much it was predicted wrongly.
    news = closed @ o.end - o.transition @ o.gain * o.feed if o.feed else np.zeros(o.gain.size)
    before = -news - o.transition @ o.gain * o.feed
    padded = np.pad(taps, (0, -(taps.size - 1) % 4))
    return Response(closed, o.begin + news, o.end, before, o.output, np.array([o.feed]), padded)


def unseen_of(observer: Observer, taps: np.ndarray) -> Response:
    """The same where a sample is missing: its error is 0, and tells nothing of state and force."""
    blind = observer._replace(gain=np.zeros(observer.gain.size))
    return response_of(blind, taps)._replace(output=np.zeros(observer.gain.size), feed=np.zeros(1))


@njit(cache=True, nogil=True)
def signatures(seen, unseen, left, right, first, missing, white):
    """Whitened signatures of forces, each the product of two factors.

    Parameters
    ----------
    seen, unseen : Response
        At samples that are there, and at missing ones.
    left, right : ndarray of float64, shape (a, 2, n) and (b, 2, n)
        Row 0 of a force: over the step from sample k, its beginning; row 1: its end, as predicted. For a sensor that
        feels the force, at sample k once that is known, and as predicted for k + 1.
    first : int
        Of the a b products, with those of one left factor side by side.
    missing : ndarray of bool, shape (n,)
    white : ndarray of float64, shape (m, n)
        Filled; m is at most `LANES`.
    """
    m, n = white.shape
    before = seen.taps.size - 1
    begins, ends, answer = np.zeros(_FEW * LANES), np.zeros((1 + _FEW) * LANES), np.zeros(_FEW * LANES)
    states, raw = np.zeros((seen.output.size, (1 + _FEW) * LANES)), np.zeros((before + _FEW) * LANES)
    for at in range(0, n, _FEW):
        few = min(_FEW, n - at)
        for c in range(m):
            one, other = left[(first + c) // right.shape[0]], right[(first + c) % right.shape[0]]
            multiply(one[0, at : at + few], other[0, at : at + few], begins[c:])
            multiply(one[1, at : at + few], other[1, at : at + few], ends[LANES + c :])
        if at == 0:  # nothing was predicted for the first sample
            ends[:LANES] = begins[:LANES]
        gone = at == 0
        for k in range(few):
            gone |= missing[at + k]
        if gone:
            for k in range(few):
                now, so_far = slice(k * LANES, (k + 1) * LANES), slice(k * LANES, (k + 2) * LANES)
                how = unseen if missing[at + k] or at + k == 0 else seen
                respond(how, LANES, begins[now], ends[so_far], states[:, so_far], raw[before * LANES :][now])
        else:
            respond(seen, LANES, begins, ends, states, raw[before * LANES :])
        for i in range(seen.output.size):
            for c in range(LANES):
                last = states[i, few * LANES + c]
                states[i, c] = 0.0 if abs(last) < _NOTHING else last
        whiten(seen.taps, LANES, raw, answer)
        for c in range(m):
            for k in range(few):
                white[c, at + k] = answer[k * LANES + c]
        ends[:LANES] = ends[few * LANES : (few + 1) * LANES]
        carry(raw, _FEW * LANES)


@njit(**OPTIONS)
def multiply(one, other, column):
    """Product of two rows, into every `LANES`th place."""
    for k in range(one.size):
        column[k * LANES] = one[k] * other[k]


@njit(**OPTIONS)
def respond(response, lanes, begins, ends, states, signature):
    """The error recursion some samples on; each has a row of `lanes` forces (a multiple of `GROUP`), rows on end.

    `ends` and `states` begin one sample before.
    """
    r, order, aside = response, response.output.size, lanes // GROUP
    begins, ends, signature = as_lanes(begins, GROUP), as_lanes(ends, GROUP), as_lanes(signature, GROUP)
    if order == 2:
        ones, others = as_lanes(states[0], GROUP), as_lanes(states[1], GROUP)
        for group in range(aside):
            respond_two(r, group, aside, begins, ends, ones, others, signature)
        return
    for k in range(begins.size):
        begin, end, predicted = begins[k], ends[k], ends[k + aside]
        answer = r.feed[0] * end
        for i in range(order):
            state = fma(r.known[i], begin, fma(r.ahead[i], predicted, r.before[i] * end))
            for j in range(order):
                state = fma(r.closed[i, j], as_lanes(states[j], GROUP)[k], state)
            as_lanes(states[i], GROUP)[k + aside] = state
            answer = fma(r.output[i], as_lanes(states[i], GROUP)[k], answer)
        signature[k] = answer


@njit(**OPTIONS)
def respond_two(response, group, aside, begins, ends, ones, others, signature):
    """The same for two numbers and one group of lanes: what each sample waits for need not go through memory."""
    r = response
    one, other = ones[group], others[group]
    for k in range(group, begins.size, aside):
        begin, end, predicted = begins[k], ends[k], ends[k + aside]
        first = fma(r.known[0], begin, fma(r.ahead[0], predicted, r.before[0] * end))
        second = fma(r.known[1], begin, fma(r.ahead[1], predicted, r.before[1] * end))
        first = fma(r.closed[0, 1], other, fma(r.closed[0, 0], one, first))
        second = fma(r.closed[1, 1], other, fma(r.closed[1, 0], one, second))
        signature[k] = fma(r.output[1], other, fma(r.output[0], one, r.feed[0] * end))
        one, other = first, second
        ones[k + aside], others[k + aside] = one, other


@njit(**OPTIONS)
def carry(rows, few):
    """Begin with the last of `rows` but the first `few` values, which are what is new each time."""
    for i in range(rows.size - few):
        rows[i] = rows[few + i]


@njit(**OPTIONS)
def whiten(taps, lanes, raw, white):
    """Filter of finite length along rows, four taps at a time: sums are fetched and put back a quarter as often."""
    size, last = white.size, (taps.size - 1) * lanes
    now = raw[last:]
    for i in range(size):
        white[i] = taps[0] * now[i]
    for lag in range(1, taps.size, 4):
        t0, t1, t2, t3 = taps[lag], taps[lag + 1], taps[lag + 2], taps[lag + 3]
        at = last - lag * lanes
        r0, r1, r2, r3 = raw[at:], raw[at - lanes :], raw[at - 2 * lanes :], raw[at - 3 * lanes :]
        for i in range(size):
            white[i] += t0 * r0[i] + t1 * r1[i] + t2 * r2[i] + t3 * r3[i]
