"""Loops of the nonparametric identification: half cycles of a motion, and covariances conditional on the energy."""

from numba import njit


@njit(cache=True, nogil=True)
def _cubic(samples, i, fraction):
    """Value between samples i and i + 1 of the cubic through samples i - 1 .. i + 2."""
    a = samples[i - 1]
    b = samples[i]
    c = samples[i + 1]
    d = samples[i + 2]
    s = fraction
    return (
        -s * (s - 1.0) * (s - 2.0) / 6.0 * a
        + (s + 1.0) * (s - 1.0) * (s - 2.0) / 2.0 * b
        - (s + 1.0) * s * (s - 2.0) / 2.0 * c
        + (s + 1.0) * s * (s - 1.0) / 6.0 * d
    )


@njit(cache=True, nogil=True)
def _root(samples, i):
    """Where between samples i and i + 1, of opposite signs, the cubic through their neighbours vanishes."""
    rise = samples[i + 1] - samples[i]
    fraction = -samples[i] / rise
    for _ in range(2):  # steps with the slope of the chord
        fraction = min(max(fraction - _cubic(samples, i, fraction) / rise, 0.0), 1.0)
    return fraction


@njit(cache=True, nogil=True)
def _extreme(x, v, top):
    """Displacement where the velocity vanishes next to the farthest sample."""
    i = top if (v[top] > 0.0) == (x[top] > 0.0) else top - 1  # still on its way out, or already on its way back
    if (v[i] < 0.0) == (v[i + 1] < 0.0):
        return x[top]
    return _cubic(x, i, _root(v, i))


@njit(cache=True, nogil=True)
def half_cycles(x, v, crossing, crossing_velocity, extreme):
    """Cut a motion at the zero crossings of x.

    Parameters
    ----------
    x, v : float64[n]
        Displacement and velocity, at least about 8 samples a period.
    crossing, crossing_velocity, extreme : float64[n]
        Filled from the start: instant of each zero crossing in samples, velocity there, and the displacement farthest
        from zero between this crossing and the next.

    Returns
    -------
    int
        Number of half cycles h. ``crossing`` and ``crossing_velocity`` hold h + 1 values, ``extreme`` holds h.
    """
    crossings = 0
    top = 0
    for i in range(1, x.shape[0] - 2):
        if crossings and abs(x[i]) > abs(x[top]):
            top = i
        if (x[i] < 0.0) == (x[i + 1] < 0.0):
            continue
        if crossings:
            extreme[crossings - 1] = _extreme(x, v, top)
        at = _root(x, i)
        crossing[crossings] = i + at
        crossing_velocity[crossings] = _cubic(v, i, at)
        crossings += 1
        top = i + 1
    return max(crossings - 1, 0)


@njit(cache=True, nogil=True)
def conditional_covariance(w, v, zone, edges, stride, lags, sums, counts):
    """Add up lagged products of z = v + i w over all starts, by block of time and zone of energy at the start.

    Parameters
    ----------
    w, v : float64[n]
        Coordinates in which the motion is a circle of radius sqrt(2 E).
    zone : int[n]
        Zone of the energy at each sample, negative where there is none.
    edges : int[blocks + 1]
        First start of each block, and one past the last start; starts + lags must stay within n.
    stride : int
        Every how many samples a segment starts.
    lags : int[lags]
        Lags in samples.
    sums : float64[blocks, zones, 3, lags]
        Receives the sums of v v', w w' and v w' - w v' (prime: a lag later).
    counts : int64[blocks, zones]
        Receives the numbers of segments.
    """
    for b in range(edges.shape[0] - 1):
        for i in range(edges[b], edges[b + 1], stride):
            z = zone[i]
            if z < 0:
                continue
            counts[b, z] += 1
            vi = v[i]
            wi = w[i]
            out = sums[b, z]
            for k in range(lags.shape[0]):
                vk = v[i + lags[k]]
                wk = w[i + lags[k]]
                out[0, k] += vi * vk
                out[1, k] += wi * wk
                out[2, k] += vi * wk - wi * vk
