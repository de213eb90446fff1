"""Loops of resampling over samples and weights, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def applied(start, weights, valid, columns):
    """Weighted sums (m, q) of rows, four rows at once; what lies beyond the weights may be missing."""
    out = np.full((start.size, columns.shape[1]), np.nan)
    for j in range(start.size):
        if not valid[j]:
            continue
        row = out[j]
        row[:] = 0.0
        first, last = 0, weights.shape[1]
        while weights[j, first] == 0.0:
            first += 1
        while weights[j, last - 1] == 0.0:
            last -= 1
        for k in range(first, last - 3, 4):
            w, x, y, z = weights[j, k], weights[j, k + 1], weights[j, k + 2], weights[j, k + 3]
            at = start[j] + k
            one, two, three, four = columns[at], columns[at + 1], columns[at + 2], columns[at + 3]
            for c in range(row.size):
                row[c] += w * one[c] + x * two[c] + y * three[c] + z * four[c]
        for k in range(last - (last - first) % 4, last):
            w, one = weights[j, k], columns[start[j] + k]
            for c in range(row.size):
                row[c] += w * one[c]
    return out


@njit(cache=True)
def weights(time_in, time_out, start, width, half_width, cubics):
    """Weights (m, width) of unit sum from the cubics of the kernel."""
    found = np.zeros((time_out.size, width))
    scale = cubics.shape[0] / half_width
    for j in range(time_out.size):
        total = 0.0
        for k in range(width):
            lag = abs(time_in[start[j] + k] - time_out[j])
            if lag > half_width:
                continue
            at = lag * scale
            i = min(int(at), cubics.shape[0] - 1)
            at -= i
            found[j, k] = cubics[i, 0] + at * (cubics[i, 1] + at * (cubics[i, 2] + at * cubics[i, 3]))
            total += found[j, k]
        if total > 0:
            found[j] /= total
    return found


@njit(cache=True)
def band(time_in, good, time_out, half_width, longest_step, width):
    """First input of each output, how many it has (m,), and whether none is missing or bad."""
    start = np.zeros(time_out.size, dtype=np.int64)
    count = np.zeros(time_out.size, dtype=np.int64)
    valid = np.zeros(time_out.size, dtype=np.bool_)
    first = 0
    for j in range(time_out.size):
        while first < time_in.size and time_in[first] < time_out[j] - half_width:
            first += 1
        last = first
        ok = True
        while last < time_in.size and time_in[last] <= time_out[j] + half_width and last - first < width:
            ok = ok and good[last]
            if last > first and time_in[last] - time_in[last - 1] > longest_step:
                ok = False
            last += 1
        start[j] = min(first, max(time_in.size - width, 0))
        count[j] = last - first
        reaches = (
            first < time_in.size
            and last > first
            and time_in[first] - (time_out[j] - half_width) < longest_step
            and (time_out[j] + half_width) - time_in[last - 1] < longest_step
        )
        valid[j] = ok and reaches
    return start, count, valid
