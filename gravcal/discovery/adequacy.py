"""Is the model adequate: whitened residuals against unit noise, per channel, block and band."""

from __future__ import annotations

import numpy as np
from scipy.stats import gamma

from gravcal.discovery.blocks import Block

BANDS = 4
DRAWS = 60


def table(blocks: list[Block], cleaned, rng) -> list[dict]:
    """Power of the residual in each band against its own distribution for pure noise.

    Mean and variance under noise come from draws through the same projection; a gamma law with these two moments.

    Parameters
    ----------
    blocks : list of Block
    cleaned : of `scan.residuals`
    rng : source of randomness

    Returns
    -------
    rows : {"block", "channel", "band", "ratio", "p"}
    """
    rows = []
    for block, (rest, basis) in zip(blocks, cleaned, strict=True):
        noise = rng.standard_normal((block.observed.size, DRAWS))
        noise -= basis @ (basis.T @ noise)
        for channel in dict.fromkeys(block.channel):
            power, expected = (_bands(block, channel, v) for v in (rest[:, None], noise))
            mean, spread = expected.mean(axis=1), _spread(block, channel)
            for band in range(power.shape[0]):
                shape = mean[band] ** 2 / max(spread[band], 1e-300)
                p = float(gamma.sf(power[band, 0], shape, scale=mean[band] / shape)) if mean[band] > 0 else 1.0
                one = {"block": block.label, "channel": channel, "band": band, "p": p}
                rows.append(one | {"ratio": float(power[band, 0] / mean[band]) if mean[band] > 0 else 0.0})
    return rows


def _spread(block, channel):
    """Variance of the power in each band for unit white noise."""
    spread = np.zeros(BANDS)
    for axis in range(3):
        count = int(np.sum((block.channel == channel) & (block.axis == axis)))
        if count >= 8 * BANDS:
            spread += [2 * 2 * 2 * b.size / 2 for b in np.array_split(np.arange(count // 2 + 1), BANDS)]
    return spread


def _bands(block, channel, values):
    """Sum over axes of the squared spectrum in each band, (bands, m); unit white noise gives two a frequency."""
    total = np.zeros((BANDS, values.shape[1]))
    for axis in range(3):
        rows = (block.channel == channel) & (block.axis == axis)
        if rows.sum() >= 8 * BANDS:
            spectrum = 2 * np.abs(np.fft.rfft(values[rows], axis=0)) ** 2 / rows.sum()
            total += [b.sum(axis=0) for b in np.array_split(spectrum, BANDS)]
    return total


def smallest(rows: list[dict]) -> float:
    """Smallest probability corrected for the number of tests (Sidak), 1 without tests."""
    p = [r["p"] for r in rows if r["ratio"] > 0]
    return float(-np.expm1(len(p) * np.log1p(-min(p)))) if p and min(p) < 1 else 1.0
