"""Products: schemas, deterministic files that other libraries open, and content digests."""

import subprocess
import sys

import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as some
from hypothesis.extra import numpy as arrays

from gravcal.data import layout, netcdf, netcdf_reading, product
from gravcal.errors import ProductError

SCHEMA = {
    "time": {"dims": "time"},
    "xyz": {"dims": "xyz", "dtype": "str"},
    "field_b": {"dims": "time xyz", "units": "T", "frame": "b", "long_name": "magnetic flux density"},
    "flag": {"dims": "time", "units": "1", "dtype": "u1", "long_name": "bits"},
    "note": {"dims": "", "dtype": "str", "optional": True},
}


@pytest.fixture
def kind():
    """Return a registered kind."""
    product.register("test.field", SCHEMA)
    return "test.field"


def example(**changes):
    """Dataset of the schema."""
    dataset = xr.Dataset(
        {"field_b": (("time", "xyz"), np.arange(6.0).reshape(2, 3)), "flag": ("time", np.array([0, 1], np.uint8))},
        {"time": [10.0, 10.5], "xyz": ["x", "y", "z"]},
        {"gap_limit_s": 3, "names": ["a", "b"]},
    )
    return dataset.assign(**changes)


def test_the_schema_puts_its_labels_on(kind):
    """Contract: units, frame and meaning come from the schema, time is GPS seconds by the CF convention."""
    labelled = product.check(example(), kind)
    assert labelled["field_b"].attrs == {"units": "T", "frame": "b", "long_name": "magnetic flux density"}
    assert labelled["time"].attrs["units"] == "seconds since 2000-01-01 12:00:00"
    assert labelled["time"].attrs["units_metadata"] == "leap_seconds: none"
    assert labelled["time"].attrs["time_scale"] == "GPS"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"extra": 1.0}, "not in the schema: extra"),
        ({"flag": ("time", [0, 1])}, "flag: found i8 .* expected u1"),
        ({"flag": ("xyz", np.zeros(3, np.uint8))}, "over .'xyz',.*over .'time',"),
        ({"flag": ("time", [True, False])}, "truth values uint8"),
        ({"field_b": (("time", "xyz"), np.ones((2, 3)), {"units": "nT"})}, "units is 'nT', the schema says 'T'"),
        ({"time": [10.0, 10.0]}, "index 1 is .*increase"),
        ({"time": [np.nan, 10.0]}, "index 0 is .*finite"),
    ],
)
def test_what_contradicts_the_schema_is_refused(kind, changes, message):
    """Contract: found against expected, with a remedy."""
    with pytest.raises(ProductError, match=message):
        product.check(example(**changes), kind)


def test_a_missing_variable_is_named(kind):
    """Contract: the message lists what is missing; optional variables may be absent."""
    with pytest.raises(ProductError, match="missing: flag;"):
        product.check(example().drop_vars("flag"), kind)


def test_an_unknown_kind_is_refused():
    """Contract: every product has a schema."""
    with pytest.raises(ProductError, match="no schema is registered"):
        product.check(example(), "test.unheard")


def test_a_kind_has_one_schema(kind):
    """Contract: two modules cannot give one name two meanings."""
    with pytest.raises(ProductError, match="registered twice"):
        product.register(kind, {})


def test_a_file_opens_with_netcdf4_and_plain_xarray(kind, tmp_path):
    """Contract: other libraries see names, dimensions, units, times and text."""
    path = tmp_path / "product.nc"
    path.write_bytes(netcdf.to_bytes(product.check(example(bare=("other", [1.0])).drop_vars("bare"), kind)))
    with netCDF4.Dataset(path) as file:
        assert set(file.variables) == {"field_b", "flag", "time", "xyz_label"}
        assert file["field_b"].units == "T"
        assert list(file["xyz_label"][:]) == ["x", "y", "z"]
        assert file["field_b"].coordinates == "xyz_label"
        assert "_FillValue" not in file["time"].ncattrs()
    for engine in (None, "h5netcdf", "netcdf4"):
        with xr.open_dataset(path, engine=engine) as opened:
            assert str(opened["time"].values[1]) == "2000-01-01T12:00:10.500000000"
            assert opened["field_b"].dims == ("time", "xyz")
            assert opened["flag"].dtype == np.uint8


def test_dimensions_without_coordinate_are_no_variables(tmp_path):
    """Contract: a bare dimension is written as netCDF-4 wants it."""
    path = tmp_path / "product.nc"
    path.write_bytes(netcdf.to_bytes(product.settled(xr.Dataset({"a": (("row", "column"), np.ones((2, 3)))}))))
    with netCDF4.Dataset(path) as file:
        assert set(file.variables) == {"a"}
        assert {name: one.size for name, one in file.dimensions.items()} == {"row": 2, "column": 3}


def test_large_variables_are_compressed_with_shuffle(tmp_path):
    """Contract: zlib 1 and shuffle, which every netCDF library reads."""
    path = tmp_path / "product.nc"
    path.write_bytes(netcdf.to_bytes(product.settled(xr.Dataset({"a": ("row", np.zeros(10_000))}))))
    with netCDF4.Dataset(path) as file:
        assert file["a"].filters() | {"zlib": True, "shuffle": True, "complevel": 1} == file["a"].filters()
    assert path.stat().st_size < 20_000


def test_writing_and_reading_keep_everything(kind):
    """Analytic: round trip, and the bytes of what was read are the bytes written."""
    dataset = product.check(example(note=((), "µ")), kind)
    image = netcdf.to_bytes(dataset)
    again = netcdf_reading.from_bytes(image)
    xr.testing.assert_identical(again, dataset)
    assert netcdf.to_bytes(again) == image
    assert product.digest(again) == product.digest(dataset)


def test_bytes_and_digest_do_not_depend_on_the_order_of_assembly():
    """Contract: coordinates, attributes and dimensions are written in one order."""
    one = xr.Dataset({"a": ("u", [1.0]), "b": ("v", [2.0])}, {"u": [0.0], "v": [0.0]}, {"p": 1, "q": 2})
    other = xr.Dataset({"a": ("u", [1.0]), "b": ("v", [2.0])}, {"v": [0.0], "u": [0.0]}, {"q": 2, "p": 1})
    assert netcdf.to_bytes(product.settled(one)) == netcdf.to_bytes(product.settled(other))
    assert product.digest(product.settled(one)) == product.digest(product.settled(other))


@pytest.mark.parametrize(
    "change",
    [
        {"field_b": (("time", "xyz"), np.arange(6.0).reshape(2, 3) + 1e-15)},
        {"flag": ("time", np.array([0, 1], np.uint16))},
        {"flag": ("time", np.array([0, 1], np.uint8), {"valid": 1})},
        {"xyz": ["x", "y", "w"]},
        {"more": 1.0},
    ],
)
def test_the_digest_sees_every_change_of_content(change):
    """Contract: values, types, attributes, names."""
    assert product.digest(product.settled(example(**change))) != product.digest(product.settled(example()))


def test_the_digest_sees_global_attributes_but_not_provenance():
    """Contract: what a body can read counts; how the product was made does not."""
    plain = product.settled(example())
    recipe = {"kind": "k", "variant": "", "event": "e", "version": 1, "inputs": []}
    labelled = plain.assign_attrs(product.provenance(recipe, "0" * 64, "1" * 64, "1.0"))
    assert product.digest(labelled) == product.digest(plain)
    assert product.digest(plain.assign_attrs(gap_limit_s=4)) != product.digest(plain)


def test_all_nan_are_one_nan():
    """Contract: sign and payload of NaN, which differ between operations, do not count."""
    odd = np.array([np.nan, 1.0])
    odd.view(np.uint64)[0] = 0xFFF8000000000123
    first, second = (xr.Dataset({"a": ("row", values)}) for values in (np.array([np.nan, 1.0]), odd))
    assert product.digest(product.settled(first)) == product.digest(product.settled(second))


@settings(max_examples=40, deadline=None)
@given(
    arrays.arrays(
        some.sampled_from([np.float64, np.float32, np.int64, np.uint8, np.dtype(">f8"), np.int32]),
        arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
    ),
    some.dictionaries(
        some.sampled_from(["units", "meaning", "other"]),
        some.one_of(
            some.text(max_size=5).filter(lambda text: "\0" not in text), some.integers(-9, 9), some.floats(-1, 1)
        ),
    ),
)
def test_any_numbers_and_attributes_survive_a_round_trip(values, attributes):
    """Analytic: round trip of arbitrary arrays."""
    dims = tuple(f"d{axis}" for axis in range(values.ndim))
    dataset = product.settled(xr.Dataset({"a": (dims, values, attributes)}))
    again = netcdf_reading.from_bytes(netcdf.to_bytes(dataset))
    xr.testing.assert_identical(again, dataset)
    assert product.digest(again) == product.digest(dataset)


@settings(max_examples=60, deadline=None)
@given(
    values=some.lists(
        arrays.arrays(
            some.sampled_from([np.float64, np.float32, np.int32, np.uint8]), arrays.array_shapes(min_dims=0, min_side=0)
        ),
        max_size=3,
    ),
    attributes=some.dictionaries(
        some.sampled_from(["units", "meaning"]), some.one_of(some.sampled_from(["", "µ"]), some.floats(-1, 1))
    ),
)
def test_a_layout_gives_what_the_file_gives(values, attributes):
    """Analytic: arrays found by their place are those that HDF5 finds, with dimensions, types and attributes."""
    variables = {
        f"v{i}": (tuple(f"d{i}_{axis}" for axis in range(v.ndim)), v, attributes) for i, v in enumerate(values)
    }
    flags = ("row", (np.arange(2000) // 500).astype(np.uint8), {"flag_masks": np.array([1, 2]), "units": "1"})
    names = ("name", np.array(["µ", ""], dtype=object))
    made = xr.Dataset(variables | {"flags": flags}, {"name": names, "row": np.arange(2000.0)}, attributes)
    image, places = netcdf.written(product.settled(made))
    again, plain = layout.dataset_of(image, layout.of(product.settled(made), places)), netcdf_reading.from_bytes(image)
    xr.testing.assert_identical(again, plain)
    assert netcdf.to_bytes(again) == netcdf.to_bytes(plain) == image
    assert product.digest(again) == product.digest(plain)
    for name, variable in plain.variables.items():
        assert again.variables[name].dtype == variable.dtype
        assert {k: type(v) for k, v in again[name].attrs.items()} == {k: type(v) for k, v in variable.attrs.items()}


def test_what_is_compressed_is_found_by_its_place_too():
    """Analytic: with its place in the record, and with a record of before, which has none for what is compressed."""
    steady = np.arange(150_001 * 2.0).reshape(-1, 2)
    variables = {"steady": (("row", "axis"), steady, {}), "flag": ("row", (steady[:, 0] > 9).astype("u1"), {})}
    made = product.settled(xr.Dataset(variables))
    image, places = netcdf.written(made)
    assert [len(places[name]["pieces"]) for name in ("steady", "flag")] == [3, 1]  # of a megabyte
    assert sum(size for _, size in places["steady"]["pieces"]) < steady.nbytes / 2
    for known in (places, {name: None for name in places}):
        xr.testing.assert_identical(layout.dataset_of(image, layout.of(made, known)), made)


def test_a_product_comes_and_goes_without_dask_array():
    """Contract: building, writing and reading a product does not load what half a second of every start went into."""
    code = (
        "import sys, numpy as np\n"
        "from gravcal.calibrations.building import build\n"
        "from gravcal.data import netcdf, netcdf_reading, product\n"
        "schema = {'time': {'dims': 'time'}, 'rate_b': {'dims': 'time axis', 'units': 'rad s-1'}}\n"
        "made = build(schema, {'time': np.arange(3.0), 'rate_b': np.eye(3)})\n"
        "read = netcdf_reading.from_bytes(netcdf.to_bytes(product.settled(made)))\n"
        "assert read['rate_b'].dims == ('time', 'axis') and 'time' in read.coords\n"
        "assert 'dask.array' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
