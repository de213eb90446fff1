"""Invented truth in, estimate out, over several seeds; the large study is benchmarks/inertial_sensor.py."""

from benchmarks import inertial_sensor as study


def test_swings_come_back_with_honest_errors():
    """Recovery: ten swings, error/sigma of six values within chi-square intervals (family-wise 1 %)."""
    found = study.study_swings(10, bounds=2)
    for rms, (low, high), _, _ in found.values():
        assert low < rms < high
    assert found["beta_x"][3] < 0.01  # 1 %, exact geometry
    assert found["beta_y"][3] < 0.01
    assert found["offset_y"][3] < 0.03  # 3 %
    assert found["offset_z"][3] < 0.03


def test_rolls_come_back_with_honest_errors():
    """Recovery: six rolls of ten segments, error/sigma in their intervals; 0.1 % where determined."""
    found = study.study_rolls(6, segments_each=10)
    for rms, (low, high), share in found.values():
        assert low < rms < high
        assert share < 1e-3
