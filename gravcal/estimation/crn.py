"""The CRN filter of inter-satellite ranging: low-pass and its first two derivatives, one operator for data and model.

An N-fold self-convolution of a rectangular window in time, built in the frequency domain, sampled where needed.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gravcal.estimation.resampling import Resampler


@dataclass(frozen=True)
class Crn:
    """Constants of the filter; the defaults are those of KBR1B."""

    window_s: float = 70.7  #: s, length of the filter
    bandwidth_hz: float = 0.1  #: Hz, target pass band
    convolutions: int = 7  #: 1, number of convolutions of the rectangular window with itself
    exact_hz: float = 0.37e-3  #: Hz, where the gain of the low-pass is exactly one
    raw_hz: float = 10.0  #: Hz, rate of the samples that the original works on


@lru_cache(maxsize=32)
def weights(crn: Crn, step_s: float, derivative: int) -> np.ndarray:
    """Weights (2 K + 1,) s**-derivative for samples at the lags -K..K times the step in s, later samples last.

    The response is nil above 0.2 Hz, so that samples up to 1 s apart give the same filter as those of 0.1 s. As
    they are cached, they are summed without BLAS, whose sums depend on its number of threads. F_n = 1/F0 sum_k
    H_k cos(2 pi k n / N_f), H_k = sum_m [sin(pi (k-m)/N_c) / sin(pi (k-m)/N_f)]^N_c, m = -N_B..N_B; derivatives by n,
    F0 such that the gain at `exact_hz` is one; J. B. Thomas, JPL Publ. 98-15 (1999), sec. 5.
    """
    # harmonics k (h,) and H_k (h,) of the filter
    count = round(crn.window_s * crn.raw_hz)
    count += 1 - count % 2
    index = np.arange(-(count // 2), count // 2 + 1)
    band = round(crn.bandwidth_hz * crn.window_s)
    shift = index[:, None] - np.arange(-band, band + 1)
    denominator = np.sin(np.pi * shift / count)
    numerator = np.sin(np.pi * shift / crn.convolutions)
    ratio = np.where(shift == 0, count / crn.convolutions, numerator / np.where(shift == 0, 1.0, denominator))
    harmonics = (ratio**crn.convolutions).sum(axis=1)
    half = int(np.floor(crn.window_s / 2 / step_s + 1e-9))
    lag = step_s * np.arange(-half, half + 1)
    phase = 2 * np.pi * np.outer(lag, index) / crn.window_s
    rate = 2 * np.pi * index / crn.window_s
    wave = (np.cos(phase), rate * np.sin(phase), -(rate**2) * np.cos(phase))[derivative]
    lowpass = (np.cos(phase) * harmonics).sum(axis=1)
    lowpass = lowpass / (lowpass @ np.cos(2 * np.pi * crn.exact_hz * lag))
    if derivative == 0:
        return lowpass
    taps = (wave * harmonics).sum(axis=1) * (lowpass[half] / harmonics.sum())
    return taps - lowpass * taps.sum()  # a constant has no derivative, whatever the step


def gain(crn: Crn, step_s: float, derivative: int, frequency_hz: np.ndarray) -> np.ndarray:
    """Frequency response (m,) s**-derivative at sample spacing step_s, without the i of the first derivative."""
    taps = weights(crn, step_s, derivative)
    half = taps.size // 2
    phase = 2 * np.pi * np.outer(frequency_hz, step_s * np.arange(-half, half + 1))
    return ((np.sin(phase) if derivative == 1 else np.cos(phase)) * taps).sum(axis=1)


def operator(crn: Crn, derivative: int, good: np.ndarray, grid: tuple[float, float], at: np.ndarray) -> Resampler:
    """Resampler of a derivative 0, 1, 2 from an even grid (first epoch, step, s) to epochs at (m,) s that lie on it.

    Not valid where its window leaves the grid or holds a sample that is not good (n,).
    """
    first, step = grid
    taps = weights(crn, step, derivative)
    place = np.rint((at - first) / step).astype(np.int64) - taps.size // 2
    inside = (place >= 0) & (place + taps.size <= good.size) & (np.abs((at - first) / step % 1 - 0.5) > 0.499)
    start = np.where(inside, place, 0)
    missing = np.concatenate([[0], np.cumsum(~good)])
    valid = inside & (missing[np.minimum(start + taps.size, good.size)] == missing[start])
    return Resampler(at, start, np.broadcast_to(taps, (at.size, taps.size)), valid)
