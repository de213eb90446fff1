"""SGRS files: written, found, read, refused."""

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gravcal.errors import ProductError
from gravcal.io import daily


def columns(sensors=2, count=20):
    """Any numbers of the right shapes."""
    rng = np.random.default_rng(0)
    return {
        "time": 633787200.0 + np.arange(count),
        "linear": rng.standard_normal((count, sensors, 3)),
        "angular": rng.standard_normal((count, sensors, 3)),
        "q": rng.standard_normal((count, 4)),
        "position": rng.standard_normal((count, 3)),
        "velocity": rng.standard_normal((count, 3)),
        "sensor_position": rng.standard_normal((sensors, 3)),
    }


def written(tmp_path, **changed):
    """A file of a day, found again."""
    daily.write_sgrs(tmp_path / "SGRS_2020-02-01_S_01.nc", columns() | changed)
    return daily.sgrs_file(tmp_path)


@pytest.mark.parametrize("sensors", [1, 2])
def test_a_file_reads_back_exactly_and_twice_the_same_bytes(tmp_path, sensors):
    """Contract: round trip of every variable with its unit; a file of truth holds the drag too."""
    given = columns(sensors) | {"drag": np.ones((20, 3))}
    first, second = (daily.write_sgrs(tmp_path / name, given).read_bytes() for name in ("a.nc", "b.nc"))
    assert first == second
    read = daily.read_sgrs(daily.other_file(tmp_path / "a.nc", "TRUTH", "2020-02-01"), truth=True)
    for name, values in given.items():
        assert_array_equal(read[name].values, values)
    assert read["angular"].attrs["units"] == "rad s-2"


def test_positions_and_velocities_of_no_orbit_are_missing(tmp_path):
    """Contract: 1e300 m is not a place; other rows stay."""
    spoiled = columns()
    spoiled["position"][4, 0], spoiled["velocity"][7, 2] = 1e300, -1e6
    read = daily.read_sgrs(written(tmp_path, position=spoiled["position"], velocity=spoiled["velocity"]))
    for name, row in (("position", 4), ("velocity", 7)):
        missing = np.isnan(read[name].values).all(axis=1)
        assert_array_equal(np.flatnonzero(missing), [row])


def test_other_writers_are_read(tmp_path):
    """Contract: netCDF-4 by plain xarray, single precision."""
    one = written(tmp_path)
    read = daily.read_sgrs(one).astype("f4").assign_coords(time=daily.read_sgrs(one)["time"] + 86400.0)
    read.to_netcdf(tmp_path / "SGRS_2020-02-02_S_01.nc", engine="netcdf4")
    assert daily.read_sgrs(daily.sgrs_file(tmp_path, "2020-02-02"))["linear"].dtype == float
    assert_array_equal(daily.sensor_positions(one), columns()["sensor_position"])
    with pytest.raises(ProductError, match="Give --date"):
        daily.sgrs_file(tmp_path)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"time": 6e8 + np.arange(20)}, "expected one on the day 2020-02-01"),
        ({"time": np.full(20, np.nan)}, "0 epochs"),
        (columns(3), "3 sensors"),
        ({"q": np.zeros((20, 3))}, "q of shape"),
    ],
)
def test_wrong_content_is_refused(tmp_path, changed, message):
    """Contract: what was found and what was expected."""
    with pytest.raises(ProductError, match=message):
        daily.read_sgrs(written(tmp_path, **changed))


def test_wrong_units_missing_variables_and_other_files_are_refused(tmp_path):
    """Contract: the remedy is named."""
    one = written(tmp_path)
    with h5py.File(one.path, "a") as file:
        file["linear"].attrs["units"] = "mm s-2"
    with pytest.raises(ProductError, match="linear in mm s-2"):
        daily.read_sgrs(one)
    with h5py.File(one.path, "a") as file:
        del file["linear"]
    with pytest.raises(ProductError, match="no variable linear"):
        daily.read_sgrs(one)
    with pytest.raises(ProductError, match="no variable drag|no variable linear"):
        daily.read_sgrs(one, truth=True)
    one.path.write_text("not a file")
    with pytest.raises(ProductError, match="no readable netCDF"):
        daily.read_sgrs(one)
    with pytest.raises(ProductError, match="no sensor_position"):
        daily.sensor_positions(one)
    with pytest.raises(ProductError, match="no folder"):
        daily.sgrs_file(tmp_path / "none")
    with pytest.raises(ProductError, match="no SGRS file of 2021-01-01"):
        daily.sgrs_file(tmp_path, "2021-01-01")


def test_records_out_of_order_are_sorted_and_contradictions_left_out(tmp_path):
    """Contract: as for Level-1 files; a repeated record is read once, one that contradicts it is not used."""
    given = columns()
    time = given["time"].copy()
    time[[4, 5]] = time[[5, 4]]
    time[11] = time[10]
    read = daily.read_sgrs(written(tmp_path, time=time))
    assert np.all(np.diff(read["time"].values) > 0)
    assert read["time"].size == time.size - 1
    assert np.all(read["linear"].values[4] == given["linear"][5])
    assert np.isnan(read["linear"].values[10]).all()
