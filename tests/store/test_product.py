"""Products: schemas, deterministic files that other libraries open, and content digests."""

import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as some
from hypothesis.extra import numpy as arrays

from gravcal.errors import ProductError
from gravcal.estimation.quantities import plain, record_of, result_of, tabled
from gravcal.estimation.records import Entry, Lead, Parameter
from gravcal.store import product

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


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"extra": 1.0}, "not in the schema: extra"),
        ({"flag": ("time", [0, 1])}, "flag: found i8 .* expected u1"),
        ({"flag": ("xyz", np.zeros(3, np.uint8))}, "over .'xyz',.*over .'time',"),
        ({"flag": ("time", [True, False])}, "truth values uint8"),
        ({"field_b": (("time", "xyz"), np.ones((2, 3)), {"units": "nT"})}, "units is 'nT', the schema says 'T'"),
        ({"time": [10.0, 10.0]}, "at index 1.*increase"),
        ({"time": [np.nan, 10.0]}, "at index 0.*finite"),
    ],
)
def test_what_contradicts_the_schema_is_refused(kind, changes, message):
    """Contract: found against expected, with a remedy."""
    with pytest.raises(ProductError, match=message):
        product.check(example(**changes), kind)


def test_the_schema_puts_its_labels_on_and_what_is_missing_or_said_twice_is_refused(kind):
    """Contract: units, frame and meaning of the schema, GPS seconds by CF; a schema for every product, one a name."""
    with pytest.raises(ProductError, match="missing: flag;"):
        product.check(example().drop_vars("flag"), kind)
    with pytest.raises(ProductError, match="no schema is registered"):
        product.check(example(), "test.unheard")
    with pytest.raises(ProductError, match="registered twice"):
        product.register(kind, {})
    labelled = product.check(example(), kind)
    assert labelled["field_b"].attrs == {"units": "T", "frame": "b", "long_name": "magnetic flux density"}
    assert labelled["time"].attrs["units"] == "seconds since 2000-01-01 12:00:00"
    assert labelled["time"].attrs["units_metadata"] == "leap_seconds: none"
    assert labelled["time"].attrs["time_scale"] == "GPS"


def test_a_file_opens_with_netcdf4_and_plain_xarray_and_keeps_everything(kind, tmp_path):
    """Contract: other libraries see names, dimensions, units, times and text; the round trip keeps the digest."""
    path = tmp_path / "product.nc"
    product.write(product.check(example(bare=("other", [1.0])).drop_vars("bare"), kind), path)
    with netCDF4.Dataset(path) as file:
        assert set(file.variables) == {"field_b", "flag", "time", "xyz_label"}
        assert file["field_b"].units == "T"
        assert list(file["xyz_label"][:]) == ["x", "y", "z"]
        assert file["field_b"].coordinates == "xyz_label"
        assert "_FillValue" not in file["time"].ncattrs()
    for engine in (None, "netcdf4"):
        with xr.open_dataset(path, engine=engine) as opened:
            assert str(opened["time"].values[1]) == "2000-01-01T12:00:10.500000000"
            assert opened["field_b"].dims == ("time", "xyz")
            assert opened["flag"].dtype == np.uint8
    dataset = product.check(example(note=((), "µ")), kind)
    again = back(dataset, path)
    xr.testing.assert_identical(again, dataset)
    assert product.digest(again) == product.digest(dataset)


def back(dataset, path):
    """Dataset as it comes back from a file."""
    product.write(dataset, path)
    return product.from_bytes(path.read_bytes())


def test_the_digest_sees_content_alone():
    """Contract: coordinates, attributes and dimensions count in one order; global attributes count, provenance not.

    Sign and payload of NaN, which differ between operations, do not count.
    """
    one = xr.Dataset({"a": ("u", [1.0]), "b": ("v", [2.0])}, {"u": [0.0], "v": [0.0]}, {"p": 1, "q": 2})
    other = xr.Dataset({"a": ("u", [1.0]), "b": ("v", [2.0])}, {"v": [0.0], "u": [0.0]}, {"q": 2, "p": 1})
    assert product.digest(product.settled(one)) == product.digest(product.settled(other))
    plain = product.settled(example())
    recipe = {"kind": "k", "variant": "", "event": "e", "version": 1, "inputs": []}
    labelled = plain.assign_attrs(product.provenance(recipe, "0" * 64, "1" * 64, "1.0"))
    assert product.digest(labelled) == product.digest(plain)
    assert product.digest(plain.assign_attrs(gap_limit_s=4)) != product.digest(plain)
    odd = np.array([np.nan, 1.0])
    odd.view(np.uint64)[0] = 0xFFF8000000000123
    first, second = (xr.Dataset({"a": ("row", values)}) for values in (np.array([np.nan, 1.0]), odd))
    assert product.digest(product.settled(first)) == product.digest(product.settled(second))


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


@settings(max_examples=40, deadline=None)
@given(
    arrays.arrays(
        some.sampled_from([np.float64, np.float32, np.int64, np.uint8, np.dtype(">f8"), np.int32]),
        arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
    ),
    some.dictionaries(
        some.sampled_from(["units", "meaning", "other"]),
        some.text(max_size=5).filter(lambda text: "\0" not in text) | some.integers(-9, 9) | some.floats(-1, 1),
    ),
)
def test_any_numbers_and_attributes_survive_a_round_trip(values, attributes):
    """Analytic: round trip of arbitrary arrays."""
    dims = tuple(f"d{axis}" for axis in range(values.ndim))
    dataset = product.settled(xr.Dataset({"a": (dims, values, attributes)}))
    with tempfile.TemporaryDirectory() as folder:
        again = back(dataset, Path(folder) / "product.nc")
    xr.testing.assert_identical(again, dataset)
    assert product.digest(again) == product.digest(dataset)


def test_threads_read_and_write_at_once(tmp_path):
    """Contract: netCDF4 is not thread-safe; one lock keeps six threads from each other."""
    made = product.settled(xr.Dataset({"a": ("row", np.arange(20_000.0))}))

    def there_and_back(number):
        path = tmp_path / f"{number}.nc"
        product.write(made, path)
        with product.opened(path) as file:
            assert file["a"][-1] == 19_999.0
        return product.digest(product.from_bytes(path.read_bytes()))

    with ThreadPoolExecutor(6) as pool:
        assert set(pool.map(there_and_back, range(60))) == {product.digest(made)}


def test_a_result_is_kept_as_quantities(tmp_path):
    """Contract: numbers, texts, truths, lists and tables come back as they were; NaN and infinity as nothing."""
    result = {"a/b~": [1, 2.5, np.float64(3.0), None, True, ""], "c": {}, "d": [[], {"e": np.int64(4)}], "f": np.nan}
    kept = product.settled(tabled(xr.Dataset({"x": ("x", [1.0])}), {"old": 1}))
    kept = product.settled(tabled(kept, result | {"g": np.inf}))
    read = back(kept, tmp_path / "product.nc")
    found = result_of(read)
    assert found == result | {"f": None, "g": None}
    assert [type(one) for one in found["a/b~"][:5]] == [int, float, float, type(None), bool]
    assert float(read["quantity_value"].sel(quantity="/a~1b~0/1")) == 2.5
    assert result_of(xr.Dataset()) == {} == result_of(tabled(xr.Dataset(), {}))
    entry = Entry("torque.dipole_gain", "", {"rod_x": Parameter(0.1, np.nan, "1")}, leads=(Lead(6e8, 0.5),))
    tables = result_of(tabled(read, entry))
    assert tables == plain(entry) | {"parameters": {"rod_x": {"value": 0.1, "sigma": None, "unit": "1"}}}
    assert "waves" not in tables  # as they have their default
    assert record_of(Entry, tables) == replace(entry, parameters={"rod_x": Parameter(0.1, None, "1")})
