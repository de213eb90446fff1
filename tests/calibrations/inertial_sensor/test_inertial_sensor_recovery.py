"""Invented truth in, estimate out, over several seeds; the large study is benchmarks/inertial_sensor.py."""

import numpy as np

from benchmarks import inertial_sensor as study
from benchmarks.tables import interval, rms


def test_swings_come_back_with_honest_errors():
    """Recovery: ten swings, error/sigma of six values within chi-square intervals (family-wise 1 %)."""
    rows = zip(*(study.one_swing(seed, bounds=0) for seed in range(10)), strict=True)
    error, sigma, _, size, _ = (np.array(part) for part in rows)
    low, high = interval(10, 12)
    ratio = rms(error / sigma)
    assert np.all((low < ratio) & (ratio < high)), ratio
    share = dict(zip(study.SWING, sigma.mean(axis=0) / size[0], strict=True))
    assert share["beta_x"] < 0.01  # 1 %, exact geometry
    assert share["beta_y"] < 0.01
    assert share["offset_y"] < 0.03  # 3 %
    assert share["offset_z"] < 0.03


def test_rolls_come_back_with_honest_errors():
    """Recovery: six rolls of ten segments, error/sigma in their intervals; 0.1 % where determined."""
    error, sigma, size = np.array([study.one_roll(seed, segments=10)[0] for seed in range(6)]).transpose(2, 0, 1, 3)
    low, high = interval(6, 12)
    ratio = rms(error / sigma)
    assert np.all((low < ratio) & (ratio < high)), ratio
    assert np.all(np.mean(sigma / size, axis=0) < 1e-3)
