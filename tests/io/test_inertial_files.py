"""IS1, ATT and ORB files: round trips, days, damaged input."""

import h5py
import netCDF4
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gravcal.errors import ProductError
from gravcal.io import daily as files


def records(start, count=50):
    """Short records of the three products."""
    rng = np.random.default_rng(1)
    q = rng.standard_normal((count, 4))
    time = start + np.arange(count)
    return {
        "IS1": {"time": start + 0.1 * np.arange(count), "volts": rng.standard_normal((count, 6))},
        "ATT": {"time": start + 0.25 * np.arange(count), "quaternion": q / np.linalg.norm(q, axis=1, keepdims=True)},
        "ORB": {"time": time, "position": rng.standard_normal((count, 3)), "velocity": rng.standard_normal((count, 3))},
    }


def write(folder, start=706111200.0):
    """Files of one short record."""
    made = records(start)
    return made, {name: files.write(folder, name, record)[0] for name, record in made.items()}


def test_what_is_written_is_read_back(tmp_path):
    """Analytic: round trip of every product, bit for bit."""
    made, _ = write(tmp_path)
    day = files.days(tmp_path)["2022-05-18"]
    for name, record in made.items():
        found = files.read(day[name])
        for key, values in record.items():
            assert_array_equal(found[key], values)


def test_the_files_open_with_netcdf(tmp_path):
    """Contract: units, product, satellite and time scale as defined; one file name a day."""
    _, paths = write(tmp_path)
    assert paths["IS1"].name == "IS1_2022-05-18_T_01.nc"
    with netCDF4.Dataset(paths["IS1"]) as file:
        assert (file.satellite, file.product, file.time_scale) == ("Taiji-1", "IS1", "GPS")
        assert file["V_x1"].units == "V"
        assert file["V_x1"].dimensions == ("time",)


def test_a_record_across_midnight_becomes_two_files_and_one_record(tmp_path):
    """Analytic: split by day, joined again by `between`."""
    start = 706190400.0 - 4.0
    made = records(start, 100)
    for name, record in made.items():
        files.write(tmp_path, name, record)
    assert list(files.days(tmp_path)) == ["2022-05-18", "2022-05-19"]
    every = [one for day in files.days(tmp_path).values() for one in day.values()]
    orbit = files.between(every)[2](start + 1, start + 50)
    assert_array_equal(orbit["time"], start + np.arange(1, 50))


def test_a_folder_without_files_is_refused(tmp_path):
    """Contract: nothing there is an error that says what is expected."""
    with pytest.raises(ProductError, match="IS1, ATT and ORB"):
        files.days(tmp_path)
    with pytest.raises(ProductError, match="no folder"):
        files.days(tmp_path / "none")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f.__delitem__("V_y"), "no variable V_y"),
        (lambda f: f.__delitem__("time"), "no readable netCDF file|no variable time"),
        (lambda f: f["V_y"].attrs.__setitem__("units", "mV"), "V_y in mV"),
        (lambda f: f["time"].__setitem__(slice(None), f["time"][:] + 86400.0), "expected one on the day 2022-05-18"),
        (lambda f: f["time"].__setitem__(slice(None), np.nan), "0 epochs"),
    ],
)
def test_a_wrong_file_is_refused_with_what_was_found(tmp_path, change, words):
    """Contract: variables, units and times are checked; the message holds what was found."""
    _, paths = write(tmp_path)
    with h5py.File(paths["IS1"], "r+") as file:
        change(file)
    with pytest.raises(ProductError, match=words):
        files.read(files.days(tmp_path)["2022-05-18"]["IS1"])
