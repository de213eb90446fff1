"""Small files to damage."""

import numpy as np
import pytest

from gravcal.io.writers import write

START = 738849600  # 2023-06-01 00:00:00 GPS


@pytest.fixture
def attitude():
    """Columns of a small SCA1B file."""
    angle = np.linspace(0.1, 0.2, 20)
    return {
        "gps_time": START + np.arange(20),
        "quatangle": np.cos(angle),
        "quaticoeff": np.sin(angle),
        "quatjcoeff": np.zeros(20),
        "quatkcoeff": np.zeros(20),
    }


@pytest.fixture
def acceleration():
    """Columns of a small ACC1A file, in SRF."""
    names = [f"{kind}_accl_{axis}" for kind in ("lin", "ang") for axis in "xyz"]
    values = np.random.default_rng(1).normal(size=(6, 30)) * 1e-6
    return {
        "rcvtime_intg": START + np.arange(30) // 10,
        "rcvtime_frac": np.arange(30) % 10 * 100_000 + 7,
        "icu_blk_nr": np.arange(30) // 10,
        **dict(zip(names, values, strict=True)),
    }


@pytest.fixture
def attitude_file(tmp_path, attitude):
    """A small SCA1B file."""
    return write(attitude, tmp_path / "SCA1B_2023-06-01_C_04.txt")


@pytest.fixture
def acceleration_file(tmp_path, acceleration):
    """A small ACC1A file."""
    return write(acceleration, tmp_path / "ACC1A_2023-06-01_C_04.txt")
