"""Files that unpack to far more than they hold are refused in one line, and nothing of theirs is kept in memory."""

import gzip
import subprocess
import sys
import tarfile

import h5py
import numpy as np
import pytest
from commands import tarred

from gravcal.errors import ProductError
from gravcal.io import archive, daily
from gravcal.io.archive import inventory
from gravcal.io.readers import read

NAME = "SCA1B_2023-06-01_C_04.txt"


@pytest.fixture
def small(monkeypatch):
    """Limit of 1 MB."""
    monkeypatch.setenv("GRAVCAL_UNPACKED_LIMIT", "1")


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("packed", [True, False])
def test_a_file_above_the_limit_is_refused(tmp_path, packed):
    """Contract: plain or packed; with the limit, and how to raise it."""
    path = tmp_path / (NAME + ".gz" * packed)
    path.write_bytes(gzip.compress(bytes(1_000_001)) if packed else bytes(1_000_001))
    with pytest.raises(ProductError, match=r"more than 1 MB of content.*GRAVCAL_UNPACKED_LIMIT"):
        read(path)


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize(
    ("members", "said"),
    [
        ({NAME: 1_000_001}, "more than 1 MB of content"),
        ({f"{n}.txt": 1_000_000 for n in range(17)}, "more than 16 MB in an archive"),
        ({f"{n}.txt": 0 for n in range(10_001)}, "more than 10000 members"),
    ],
)
def test_an_archive_above_the_limits_is_refused(tmp_path, members, said):
    """Contract: by one member, by all together, by their number; when listed and when digests are made."""
    path = tarred(tmp_path / "x.tgz", members)
    with pytest.raises(ProductError, match=said):
        inventory(tmp_path)
    with pytest.raises(ProductError, match=said):
        archive.file_digest(path, NAME)


@pytest.mark.usefixtures("small")
def test_a_long_name_of_a_member_is_not_read_whole(tmp_path):
    """Contract: names and comments of members lie in the archive like files."""
    with tarfile.open(tmp_path / "x.tgz", "w:gz", format=tarfile.GNU_FORMAT) as packed:
        packed.addfile(tarfile.TarInfo("a" * 2_000_000))
    with pytest.raises(ProductError, match="one member"):
        inventory(tmp_path)


@pytest.mark.parametrize("given", ["none", "0", "-1", "inf"])
def test_a_limit_that_is_none_is_refused(monkeypatch, given):
    """Contract: the setting is a positive number."""
    monkeypatch.setenv("GRAVCAL_UNPACKED_LIMIT", given)
    with pytest.raises(ProductError, match="positive number of MB"):
        archive.limit()


SGRS = "SGRS_2022-05-18_S_01.nc"
READERS = ("IS1_2022-05-18_T_01.nc", daily.read), (SGRS, daily.read_sgrs), (SGRS, daily.sensor_positions)


@pytest.mark.parametrize(("name", "read"), READERS)
def test_variables_that_declare_too_much_or_lie_elsewhere_are_refused(tmp_path, name, read):
    """Contract: 8 TB declared in a file of some kilobytes; a link to another file, and raw data in one."""
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["time"] = np.arange(3.0)
    outside = {"external": [(str(tmp_path / "other.h5"), 0, 24)]}
    for make, words in (
        (lambda f: f.create_dataset("time", (10**12,), "f8", chunks=True, compression="gzip"), "declared variables"),
        (lambda f: f.__setitem__("time", h5py.ExternalLink("other.h5", "time")), "no variable of this file"),
        (lambda f: f.create_dataset("time", (3,), "f8", **outside), "no variable of this file"),
    ):
        with h5py.File(tmp_path / name, "w") as file:
            make(file)
        with pytest.raises(ProductError, match=words):
            read(daily.inventory(tmp_path)[0])


READ = """
import resource, sys
from pathlib import Path
from gravcal.io import archive
from gravcal.io.readers import read
from gravcal.errors import ProductError
import polars, xarray
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]),) * 2)
resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
try:
    path = Path(sys.argv[1])
    archive.inventory(path) if path.name.endswith("tgz") else read(path)
except ProductError as error:
    print(len(str(error).splitlines()), error)
"""


@pytest.mark.parametrize("form", ["gz", "tgz"])
def test_a_bomb_is_refused_within_memory_and_time(tmp_path, form):
    """Contract: 2 GB of zeros in 2 MB; one line, within 1 GB of memory beyond what the interpreter has."""
    if form == "gz":
        path = tmp_path / f"{NAME}.gz"
        with gzip.open(path, "wb", 1) as packed:
            packed.writelines([bytes(2**24)] * 128)
    else:
        path = tarred(tmp_path / "x.tgz", {NAME: 2**28, "SCA1B_2023-06-01_D_04.txt": 2**28})
    allowed = 3 * 2**30  # address space: the interpreter with its libraries takes 2
    done = subprocess.run([sys.executable, "-c", READ, path, str(allowed)], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert done.stdout.startswith("1 ")
    assert "more than 256 MB" in done.stdout


@pytest.mark.parametrize(
    "header",
    [
        "header:\n  a: &a [x, x, x, x, x, x, x, x, x]\n"
        + "".join(f"  {n}: &{n} [{', '.join(9 * ['*' + p])}]\n" for p, n in zip("abcdefgh", "bcdefghi", strict=True))
        + "  global_attributes:\n    title: *i\n",
        "header:\n  global_attributes: " + 100_000 * "[" + "\n",
        "header:\n  dimensions:\n    num_records: " + 9000 * "9" + "\n",
    ],
    ids=["aliases of aliases", "deep", "long number"],
)
def test_headers_that_grow_are_refused(tmp_path, header):
    """Contract: aliases that multiply, nesting and digits without end."""
    (path := tmp_path / NAME).write_text(header + "# End of YAML header\n")
    with pytest.raises(ProductError, match=NAME):
        read(path)


@pytest.mark.parametrize("product", ["IS1", "ATT", "ORB"])
def test_a_netcdf_file_with_damaged_structure_is_refused(tmp_path, product):
    """Contract: bytes put in anywhere, values of text: refused or read, never a trace as of a wrong checksum."""
    time = 706060800.0 - 43200 + np.arange(2000.0)
    widths = {"IS1": {"volts": 6}, "ATT": {"quaternion": 4}, "ORB": {"position": 3, "velocity": 3}}[product]
    (path,) = daily.write(tmp_path, product, {"time": time} | {n: np.ones((2000, w)) for n, w in widths.items()})
    (file,) = daily.inventory(tmp_path)
    whole, refused = path.read_bytes(), 0
    for place in range(0, 9000, 90):
        path.write_bytes(whole[:place] + b"\x00\xffgravcal\x17" + whole[place:])
        try:
            daily.read(file)
        except ProductError:
            refused += 1
    assert refused > 10
    path.write_bytes(whole)
    with h5py.File(path, "r+") as content:
        del content["time"]
        content["time"] = np.array([b"noon"] * 2000)
    with pytest.raises(ProductError, match="no readable netCDF file"):
        daily.read(file)
