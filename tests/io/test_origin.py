"""What says that records are simulated, how a product learns it, and what no simulation is written beside."""

import contextlib
import gzip
import itertools
import tarfile

import numpy as np
import pytest
import xarray as xr

from flows import engine
from gravcal import catalog
from gravcal.errors import CatalogError, ProductError
from gravcal.io import archive, daily, readers, writers
from tasks.stage import read

SECONDS = {name: 634219200 + np.arange(3) for name in ("gps_time", "time_intg", "rcvtime_intg")}
RECORDS = SECONDS | {name: np.zeros(3, dtype=int) for name in ("time_frac", "rcvtime_frac")}
TAKEN_BACK = ((b"simulated data", b"as flown"), (archive.BY.encode(), b"9a1b2"))


def written(folder, letter="C", release="04"):
    """Level-1 file of three records, as gravcal simulates it."""
    folder.mkdir(exist_ok=True)
    columns = {f"{name}field_{axis}": np.zeros(3) for axis in "xyz" for name in ("Mf", "torque")}
    columns |= {f"torque{n}{coil}": np.zeros(3) for n in (1, 2, 3) for coil in "AB"}
    columns |= {f"{name}{axis}_RAW": np.zeros(3) for axis in "XYZ" for name in ("Mf", "Mfv")}
    columns |= {name: np.zeros(3) for name in ("torque_cal", "MT1", "MT2", "MT3")}
    return writers.write(RECORDS | columns, folder / f"MAG1B_2020-02-05_{letter}_{release}.txt")


def flown(path):
    """The same file with a header that says nothing of a simulation."""
    content = path.read_bytes()
    for old, new in TAKEN_BACK:
        content = content.replace(old, new.ljust(len(old)))
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("header:\n  global_attributes:\n    acknowledgement: simulated data\n", "simulated"),
        ("    acknowledgement: |\n      GRACE-FO like\n      simulated data\n    title: x\n", "simulated"),
        ('    software_version: "sim"\n', "simulated"),
        ("    software_version: gravcal simulation\n", "simulated"),
        ("SOFTWARE VERSION              : gravcal simulation        \n", "simulated"),
        ("    software_version: simple-1.0\n", "measured"),
        ("    software_version: 9a1b2\n    summary: no simulated data in here\n", "measured"),
        ("SOFTWARE VERSION              : gravcal                   \n", "measured"),
        ("", "measured"),
    ],
)
def test_headers_that_say_simulated(header, expected):
    """Contract: our own header, thanks for simulated data, version sim; what says nothing counts as measured."""
    assert archive.origin_of_header(header) == expected


@pytest.mark.parametrize(("letter", "release"), [("C", "04"), ("A", "02")])
def test_text_files_of_both_missions_say_it(tmp_path, letter, release):
    """Contract: YAML and 80-column headers, loose, packed and in an archive."""
    path = written(tmp_path, letter, release)
    assert readers.read(path).attrs["origin"] == "simulated"
    with tarfile.open(tmp_path / "day.tgz", "w:gz") as made:
        made.add(path, path.name)
    member = archive.find(tmp_path / "day.tgz", "MAG1B", letter, "2020-02-05")
    assert archive.origin_of(member) == readers.read(member).attrs["origin"] == "simulated"
    assert readers.read(flown(path)).attrs["origin"] == "measured"
    (packed := path.with_name(path.name + ".gz")).write_bytes(gzip.compress(path.read_bytes()))
    assert archive.origin_of(archive.from_name(packed)) == "measured"


def test_binary_and_netcdf_files_say_it(tmp_path):
    """Contract: the 80-column header of a binary file counts as that of a text file; global attributes of those names.

    What holds no records has no origin: a gravity field makes a simulated day no mixture.
    """
    text = written(tmp_path, "A", "02").read_bytes()
    end = text.index(b"END OF HEADER")
    path = tmp_path / "MAG1B_2020-02-05_A_02.dat"
    path.write_bytes(text[: text.index(b"\n", end) + 1].replace(b"1=ASCII: 1", b"1=ASCII: 0"))
    observed = readers.read(path)
    assert (observed.sizes["record"], observed.attrs["origin"]) == (0, "simulated")
    assert readers.read(flown(path)).attrs["origin"] == "measured"
    known = {"acknowledgement": "Thanks. Simulated data.", "software_version": "sim"}
    for number, (name, value) in enumerate([*known.items(), ("software_version", archive.BY), ("title", "simulated")]):
        path = tmp_path / f"SGRS_2020-02-0{number + 1}_S_01.nc"
        xr.Dataset(attrs={name: value}).to_netcdf(path)
        found = archive.origin_of(archive.LevelOneFile(path, None, "SGRS", "S", "2020-02-01", "01"))
        assert found == ("measured" if name == "title" else "simulated")
    (tmp_path / "field.gfc").write_text("product_type gravity_field\n")
    assert archive.origin_of(daily.other_file(tmp_path / "field.gfc", "GFC", "2020-02-01")) == ""


def test_products_pass_it_on(pipeline):
    """Contract: a product has the origin of all it was made of; of a measured and a simulated input it is mixed."""
    _, measured = pipeline.run()
    pipeline.raw.write_text("software_version: sim\n# End of YAML header\nabc")
    made, simulated = pipeline.run()
    assert made == ["start", "scale.one", "scale.other", "join"]
    assert read(measured).attrs["origin"] == "measured"
    assert read(simulated).attrs["origin"] == "simulated"
    stages = pipeline.module("stages")
    pipeline.raw.write_text("no header")
    other = stages.start(pipeline.file(), event="fake-1", variant="", count=4, offset=1.0)
    scaled = stages.scale(other, variant="one", gain=1.0)
    pipeline.raw.write_text("software_version: sim\n# End of YAML header\nabc")
    started = stages.start(pipeline.file(), event="fake-1", variant="", count=4, offset=0.0)
    again = stages.scale(started, variant="other", gain=1.0)
    assert [read(one).attrs["origin"] for one in (scaled, again)] == ["measured", "simulated"]
    assert read(stages.join(scaled, again)).attrs["origin"] == "mixed"


def test_an_event_of_the_catalogue_may_state_it(pipeline, tmp_path, monkeypatch):
    """Contract: the setting of an event counts where files say nothing, makes its products anew, and is checked."""
    _, measured = pipeline.run(event="grace-c-2020-02-01")
    folder = tmp_path / "catalog" / "events"
    folder.mkdir(parents=True)
    shipped = catalog.find("events", "grace-c-2020-02-01").read_text()
    monkeypatch.setenv("GRAVCAL_CATALOG", str(tmp_path / "catalog"))
    (own := folder / "grace-c-2020-02-01.toml").write_text('origin = "simulated"\n' + shipped)
    steps, _ = engine.plan(pipeline.module("flow").calibrate, pipeline.file(), pipeline.chosen | {"event": own.stem})
    assert steps[0].reasons == ("origin: as files say -> simulated",)
    made, simulated = pipeline.run(event="grace-c-2020-02-01")
    assert made == ["start", "scale.one", "scale.other", "join"]
    assert [read(one).attrs["origin"] for one in (measured, simulated)] == ["measured", "simulated"]
    assert catalog.event("grace-c-2020-02-01").origin == "simulated"
    own.write_text('origin = "invented"\n' + shipped)
    with pytest.raises(CatalogError, match="origin.*invented.*measured.*simulated"):
        catalog.event("grace-c-2020-02-01")


FOREIGN = ("ACC1B_2020-02-05_C_04.txt", "ACC1B_2020-02-05_C_04.txt.gz", "2020/SCA1B_2020-02-05_C_04.txt",
           "gracefo_1A_2020-02-05.tgz", "notes.txt", "IS1_2022-05-18_T_01.nc")  # fmt: skip


@pytest.mark.parametrize("foreign", FOREIGN)
def test_no_simulation_beside_files_of_others(tmp_path, foreign):
    """Contract: refused by name for a measured file, an archive, any data file here or a Level-1 file below."""
    own = written(tmp_path / "day")
    (tmp_path / "day" / "truth.json").write_text("{}")
    archive.check_own(tmp_path / "day")
    archive.check_own(tmp_path / "new")
    path = tmp_path / "day" / foreign
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(gzip.compress(b"abc") if path.suffix == ".gz" else b"header:\n# End of YAML header\n")
    with pytest.raises(ProductError, match=path.name):
        archive.check_own(tmp_path / "day")
    assert own.is_file()


def test_the_files_of_one_day_below_a_folder(tmp_path):
    """Contract: a document of a run that failed has the origin of the files that are there, loose or in archives."""
    folders = {name: tmp_path / name for name in ("simulated", "measured", "mixed")}
    written(folders["simulated"])
    flown(written(folders["measured"]))
    written(folders["mixed"])
    flown(written(folders["mixed"], letter="D"))
    for packed, (name, folder), date in itertools.product((False, True), folders.items(), ("2020-02-05", None)):
        with tarfile.open(folder / "day.tgz", "w:gz") if packed and date else contextlib.nullcontext() as made:
            for path in folder.glob("*.txt") if made else ():
                made.add(path, f"1B/{path.name}")
                path.unlink()
        assert archive.origin_below(folder, date) == name
    assert archive.origin_below(folders["simulated"], "2020-02-06") == "measured"
    with tarfile.open(folders["measured"] / "gracefo_2020-02-05.tgz", "w:gz") as made:
        made.add(written(tmp_path), "MAG1B_2020-02-05_C_04.txt")
        made.add(written(tmp_path), "MAG1B_2020-02-06_C_04.txt")
    days = ("2020-02-05", "2020-02-06")  # an archive of one day is not read for another: a folder may have a thousand
    assert [archive.origin_below(folders["measured"], day) for day in days] == ["mixed", "measured"]
    (folders["simulated"] / "day.tgz").write_bytes(b"damaged")
    assert archive.origin_below(folders["simulated"], None) == "measured"
