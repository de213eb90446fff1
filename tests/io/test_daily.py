"""Files of a day, SGRS and IS1, ATT and ORB: written, found, read, joined over midnight, refused."""

import h5py
import netCDF4
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gravcal.errors import ProductError
from gravcal.io import daily


def columns(sensors=2, count=20):
    """Any numbers of the right shapes."""
    rng = np.random.default_rng(0)
    shapes = {"linear": (count, sensors, 3), "angular": (count, sensors, 3), "q": (count, 4), "position": (count, 3)}
    shapes |= {"velocity": (count, 3), "sensor_position": (sensors, 3)}
    return {"time": 633787200.0 + np.arange(count)} | {n: rng.standard_normal(shape) for n, shape in shapes.items()}


def written(tmp_path, **changed):
    """A file of a day, found again."""
    daily.write_sgrs(tmp_path / "SGRS_2020-02-01_S_01.nc", columns() | changed)
    return daily.sgrs_file(tmp_path)


@pytest.mark.parametrize("sensors", [1, 2])
def test_an_sgrs_file_reads_back_exactly_and_twice_the_same_bytes(tmp_path, sensors):
    """Contract: round trip of every variable with its unit; a file of truth holds the drag too."""
    given = columns(sensors) | {"drag": np.ones((20, 3))}
    first, second = (daily.write_sgrs(tmp_path / name, given).read_bytes() for name in ("a.nc", "b.nc"))
    assert first == second
    read = daily.read_sgrs(daily.other_file(tmp_path / "a.nc", "TRUTH", "2020-02-01"), truth=True)
    for name, values in given.items():
        assert_array_equal(read[name].values, values)
    assert read["angular"].attrs["units"] == "rad s-2"


def test_other_writers_are_read(tmp_path):
    """Contract: netCDF-4 by plain xarray, single precision."""
    one = written(tmp_path)
    read = daily.read_sgrs(one).astype("f4").assign_coords(time=daily.read_sgrs(one)["time"] + 86400.0)
    read.to_netcdf(tmp_path / "SGRS_2020-02-02_S_01.nc", engine="netcdf4")
    assert daily.read_sgrs(daily.sgrs_file(tmp_path, "2020-02-02"))["linear"].dtype == float
    assert_array_equal(daily.sensor_positions(one), columns()["sensor_position"])
    with pytest.raises(ProductError, match="Give --date"):
        daily.sgrs_file(tmp_path)


def test_records_are_sorted_and_contradictions_and_places_of_no_orbit_left_out(tmp_path):
    """Contract: a repeated record is read once, one that contradicts it is not used; 1e300 m is no place."""
    given = columns()
    time = given["time"].copy()
    time[[4, 5]] = time[[5, 4]]
    time[11] = time[10]
    read = daily.read_sgrs(written(tmp_path, time=time))
    assert np.all(np.diff(read["time"].values) > 0)
    assert read["time"].size == time.size - 1
    assert np.all(read["linear"].values[4] == given["linear"][5])
    assert np.isnan(read["linear"].values[10]).all()
    spoiled = columns()
    spoiled["position"][4, 0], spoiled["velocity"][7, 2] = 1e300, -1e6
    read = daily.read_sgrs(written(tmp_path, position=spoiled["position"], velocity=spoiled["velocity"]))
    for name, row in (("position", 4), ("velocity", 7)):
        assert_array_equal(np.flatnonzero(np.isnan(read[name].values).all(axis=1)), [row])


def records(tmp_path, start=706111200.0, count=50):
    """Short records of the three products of Taiji-1, and their files."""
    rng = np.random.default_rng(1)
    q, time = rng.standard_normal((count, 4)), np.arange(count)
    made = {
        "IS1": {"time": start + 0.1 * time, "volts": rng.standard_normal((count, 6))},
        "ATT": {"time": start + 0.25 * time, "quaternion": q / np.linalg.norm(q, axis=1, keepdims=True)},
        "ORB": {"time": start + time, "position": rng.normal(size=(count, 3)), "velocity": rng.normal(size=(count, 3))},
    }
    return made, {name: daily.write(tmp_path, name, record)[0] for name, record in made.items()}


def test_records_of_taiji_are_read_back_and_open_with_netcdf(tmp_path):
    """Analytic: round trip of every product, bit for bit; units, product, satellite and time scale as defined."""
    made, paths = records(tmp_path)
    day = daily.days(tmp_path)["2022-05-18"]
    for name, record in made.items():
        found = daily.read(day[name])
        for key, values in record.items():
            assert_array_equal(found[key], values)
    assert paths["IS1"].name == "IS1_2022-05-18_T_01.nc"
    with netCDF4.Dataset(paths["IS1"]) as file:
        assert (file.satellite, file.product, file.time_scale) == ("Taiji-1", "IS1", "GPS")
        assert (file["V_x1"].units, file["V_x1"].dimensions) == ("V", ("time",))


def test_a_record_across_midnight_becomes_two_files_and_one_record(tmp_path):
    """Analytic: split by day, joined again by `between`."""
    start = 706190400.0 - 4.0
    records(tmp_path, start, 100)
    assert list(daily.days(tmp_path)) == ["2022-05-18", "2022-05-19"]
    every = [one for day in daily.days(tmp_path).values() for one in day.values()]
    assert_array_equal(daily.between(every)[2](start + 1, start + 50)["time"], start + np.arange(1, 50))


def changed(name, change):
    """Damage of a variable of an open file."""
    return lambda file: change(file[name])


#: Whose file, what is done to it, what the message names.
WRONG = [
    ("SGRS", changed("time", lambda v: v.__setitem__(slice(None), 6e8 + np.arange(20))), "on the day 2020-02-01"),
    ("SGRS", changed("linear", lambda v: v.attrs.__setitem__("units", "mm s-2")), "linear in mm s-2"),
    ("IS1", lambda f: f.__delitem__("V_y"), "no variable V_y"),
    ("IS1", lambda f: f.__delitem__("time"), "no readable netCDF file|no variable time"),
    ("IS1", changed("V_y", lambda v: v.attrs.__setitem__("units", "mV")), "V_y in mV"),
    ("IS1", changed("time", lambda v: v.__setitem__(slice(None), v[:] + 86400.0)), "on the day 2022-05-18"),
    ("IS1", changed("time", lambda v: v.__setitem__(slice(None), np.nan)), "0 epochs"),
]


@pytest.mark.parametrize(("product", "change", "words"), WRONG)
def test_a_wrong_file_is_refused_with_what_was_found(tmp_path, product, change, words):
    """Contract: variables, units and times are checked; the message holds what was found and expected."""
    if product == "SGRS":
        one, read = written(tmp_path), daily.read_sgrs
    else:
        records(tmp_path)
        one, read = daily.days(tmp_path)["2022-05-18"][product], daily.read
    with h5py.File(one.path, "r+") as file:
        change(file)
    with pytest.raises(ProductError, match=words):
        read(one)


def test_what_is_no_file_and_no_folder_is_refused(tmp_path):
    """Contract: the remedy is named; sensors and components are counted."""
    with pytest.raises(ProductError, match="IS1, ATT and ORB"):
        daily.days(tmp_path)
    one = written(tmp_path)
    with pytest.raises(ProductError, match="no variable drag"):
        daily.read_sgrs(one, truth=True)
    one.path.write_text("not a file")
    with pytest.raises(ProductError, match="no readable netCDF"):
        daily.read_sgrs(one)
    for look in (daily.sgrs_file, daily.days):
        with pytest.raises(ProductError, match="no folder"):
            look(tmp_path / "none")
    for wrong, words in ((columns(3), "3 sensors"), ({"q": np.zeros((20, 3))}, "q of shape")):
        with pytest.raises(ProductError, match=words):
            daily.read_sgrs(written(tmp_path, **wrong))
