"""Write, then read: the identity, for any numbers; and the same bytes each time."""

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from gravcal.errors import ProductError
from gravcal.io import readers
from gravcal.io.readers import read
from gravcal.io.writers import write

START = 738849600
numbers = arrays.arrays(float, (6, 12), elements=st.floats(width=64))
once = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@once
@given(values=numbers, step=st.integers(1, 2_000_000), first=st.integers(0, 999_999))
def test_any_acceleration_comes_back_bit_for_bit(tmp_path, values, step, first):
    """Analytic: every double, NaN and infinities included, at any tag of whole microseconds."""
    ticks = first + step * np.arange(12)
    names = [f"{kind}_accl_{axis}" for kind in ("lin", "ang") for axis in "xyz"]
    columns = {"rcvtime_intg": START + ticks // 10**6, "rcvtime_frac": ticks % 10**6, "icu_blk_nr": np.zeros(12)}
    observed = read(write(columns | dict(zip(names, values, strict=True)), tmp_path / "ACC1A_2023-06-01_C_04.txt"))
    for name, expected in zip(names, values, strict=True):
        assert_array_equal(observed[name].values, expected)
    assert_array_equal(observed.rcvtime_frac, ticks % 10**6)
    assert_array_equal(observed.time_second, START + ticks // 10**6)
    assert_allclose(observed.time_fraction, (ticks % 10**6) / 1e6, atol=1e-15)  # s, rounding
    assert_array_equal(observed.flag.values == 0, np.isfinite(values).all(axis=0))


@once
@given(bits=arrays.arrays(np.uint8, 9), eps=arrays.arrays(float, 9, elements=st.floats(-1, 1)))
def test_any_quality_flag_comes_back(tmp_path, bits, eps):
    """Analytic: eight characters, bit 0 rightmost."""
    columns = {"rcv_time": START + 10 * np.arange(9), "eps_time": eps, "qualflg": bits}
    path = write(columns, tmp_path / "CLK1B_2023-06-01_C_04.txt")
    observed = read(path)
    assert_array_equal(observed.qualflg, bits)
    assert_array_equal(observed.eps_time, eps)
    assert path.read_text().splitlines()[-1].endswith(f"{bits[-1]:08b}")


def test_bytes_depend_on_the_content_alone_and_headers_are_yaml(tmp_path, acceleration):
    """Contract: twice the same arguments, the same bytes, compressed too; other readers find what they look for."""
    for name in ("ACC1A_2023-06-01_C_04.txt.gz", "ACC1A_2023-06-01_C_04.txt"):
        one = write(acceleration, tmp_path / name).read_bytes()
        assert write(acceleration, tmp_path / name).read_bytes() == one
    header = yaml.safe_load(one.decode().partition("# End of YAML header")[0])["header"]
    assert header["dimensions"]["num_records"] == 30
    attributes = header["global_attributes"]
    assert attributes["platform"] == "GRACE C"
    assert attributes["time_coverage_start"].isoformat().startswith("2023-06-01T00:00:00")
    names = [next(iter(v)) for v in header["variables"]]
    table = readers.table_of("ACC1A")
    assert names == [c.name for c in (*table.columns, *table.optional)] + ["statusflag"]
    assert "simulation" in attributes["source"]


@pytest.mark.parametrize("name", [n for n in readers.names() if not readers.table_of(n).repeated])
def test_every_table_writes_and_reads(tmp_path, name):
    """Analytic: two records of every product, samples of it seen or not, all optional columns present."""
    table = readers.table_of(name)
    satellite = "C" if table.id_name else "Y"
    columns = {}
    for column in (*table.columns, *table.optional):
        low = column.range[0] if column.kind != "c" and len(column.range) == 2 else 1
        text = {"c": np.array([b"C", b"C"]), "text": np.array(["one word", "two"])}
        columns[column.name] = text.get(column.kind, np.array([low, low]))
    if table.optional:
        columns["prod_flag"] = np.full(2, sum(1 << c.bit for c in table.optional))
    columns.pop("time_ref", None)
    columns |= {one: np.array([0.5, 0.5]) for one in table.quaternion}
    columns[table.time[0]] = np.array([START, START + 1])
    observed = read(write(columns, tmp_path / f"{name}_2023-06-01_{satellite}_04.txt"))
    assert_array_equal(observed.time_second, [START, START + 1])
    for column in (*table.columns, *table.optional):
        assert column.name in observed


def test_currents_of_coils_add_and_a_column_without_values_is_refused(tmp_path, attitude):
    """Analytic: positive currents in coil A, negative ones in coil B with their sign; a missing column is named."""
    columns = {"time_intg": START + np.array([0, 0]), "time_frac": np.array([83329, 583329])}
    columns |= {f"Mfv{axis}_RAW": np.zeros(2) for axis in "XYZ"}
    columns |= {f"torque{n}{coil}": np.zeros(2) for n in (1, 3) for coil in "AB"}
    columns |= {"torque2A": np.array([0.0, 3.0]), "torque2B": np.array([-2.0, 0.0])}
    observed = read(write(columns, tmp_path / "MAG1B_2023-06-01_C_04.txt"))
    assert_array_equal(observed.current_b, [[0.0, -2.0, 0.0], [0.0, 3.0, 0.0]])
    del attitude["quatjcoeff"]
    with pytest.raises(ProductError, match="quatjcoeff"):
        write(attitude, tmp_path / "SCA1B_2023-06-01_C_04.txt")


@pytest.mark.parametrize(("satellite", "seconds"), [("A", 0.25), ("C", 0.00025)])
def test_receiver_time_is_in_seconds_whatever_the_mission_writes(tmp_path, satellite, seconds):
    """Published: TIM1B fractions are microseconds in GRACE, nanoseconds in GRACE-FO (formats.md, 2.3 and 3.2)."""
    columns = {"obctime": [START, START + 8], "rcvtime_intg": [START, START + 8], "rcvtime_frac": [0, 250_000]}
    observed = read(write(columns, tmp_path / f"TIM1B_2023-06-01_{satellite}_04.txt"))
    assert_array_equal(observed.receiver_fraction, [0.0, seconds])
    assert_array_equal(observed.receiver_second, [START, START + 8])
