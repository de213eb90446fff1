"""Files in folders and archives: which one is found, and what is refused."""

import tarfile

import pytest
from commands import tarred
from numpy.testing import assert_array_equal

from gravcal.errors import ProductError
from gravcal.io.archive import content as content_of
from gravcal.io.archive import find, inventory
from gravcal.io.readers import read
from gravcal.io.writers import file_name, write


@pytest.fixture
def member(tmp_path, attitude_file):
    """An archive with one SCA1B file, its AppleDouble twin and a report; no loose file beside it."""
    data = attitude_file.read_bytes()
    attitude_file.unlink()
    name = attitude_file.name
    members = {f"./._{name}": b"Mac OS X", f"./{name}": data, name.replace("txt", "rpt"): b"1 2 3\n"}
    return tarred(tmp_path / "gracefo_1B_2023-06-01_RL04.ascii.noLRI.tgz", members)


def test_members_are_found_and_read_after_loose_files_and_newer_releases(member, attitude):
    """Contract: without extraction, AppleDouble twins and reports left out; release first, then loose files."""
    files = inventory(member.parent)
    assert [f.name for f in files] == ["SCA1B_2023-06-01_C_04.txt"]
    assert_array_equal(read(files[0]).quatangle, attitude["quatangle"])
    assert sorted(p.name for p in member.parent.iterdir()) == [member.name]
    loose = write(attitude, member.parent / file_name("SCA1B", "2023-06-01", "C"))
    assert find(member.parent, "SCA1B", "C", "2023-06-01").path == loose
    newer = write(attitude, member.parent / file_name("SCA1B", "2023-06-01", "C", "05"))
    assert find(member.parent, "SCA1B", "C", "2023-06-01").path == newer


def test_of_several_days_and_letters_that_which_is_meant_is_found(tmp_path, attitude):
    """Contract: exactly the product, letter and day, those of a pair by its own letter; no folder is an error."""
    for day in ("2023-06-01", "2023-06-02"):
        write(attitude, tmp_path / file_name("SCA1B", day, "C"))
    columns = ("biased_range", "range_rate", "range_accl", "lighttime_corr", "lighttime_rate", "lighttime_accl")
    antenna = ("ant_centr_corr", "ant_centr_rate", "ant_centr_accl")
    values = {"gps_time": [738849600, 738849605], **{c: [1.0, 2.0] for c in (*columns, *antenna)}}
    path = write(values, tmp_path / file_name("KBR1B", "2023-06-01", "Y"))
    assert find(tmp_path, "SCA1B", "C", "2023-06-02").date == "2023-06-02"
    assert find(tmp_path, "KBR1B", "Y", "2023-06-01").path == path
    for other in (("SCA1B", "D", "2023-06-01"), ("MAG1B", "C", "2023-06-01"), ("KBR1B", "C", "2023-06-01")):
        assert find(tmp_path, *other) is None
    with pytest.raises(ProductError, match="nothing there"):
        inventory(tmp_path / "nowhere")
    assert read(path).sizes["record"] == 2


def test_of_members_of_one_name_the_last_counts(tmp_path):
    """Contract: as for tar, which appends what is corrected."""
    with tarfile.open(tmp_path / "x.tar", "w") as tar:
        for content in ("old", "new"):
            (tmp_path / content).write_text(content)
            tar.add(tmp_path / content, "SCA1B_2023-06-01_C_04.txt")
    assert content_of(find(tmp_path, "SCA1B", "C", "2023-06-01")) == b"new"


@pytest.mark.parametrize(
    ("up", "kind", "words"),
    [
        *((up, tarfile.REGTYPE, "leaves the folder") for up in ("../", "/", "a/../../", "..\\")),
        ("", tarfile.SYMTYPE, "link"),
    ],
)
def test_members_that_leave_the_folder_and_links_are_refused(tmp_path, up, kind, words):
    """Contract: whatever else is in the archive; a link with the name of a product is no file."""
    tarred(tmp_path / "x.tgz", {f"{up}SCA1B_2023-06-01_C_04.txt": b"data" if kind == tarfile.REGTYPE else b""}, kind)
    with pytest.raises(ProductError, match=words):
        inventory(tmp_path)


@pytest.mark.parametrize(("size", "end"), [(10, b""), (200, b""), (-8, 8 * b"x")])
def test_damaged_archives_are_refused(member, attitude, size, end):
    """Contract: a cut archive, one that is none, one with another checksum, a cut .gz."""
    member.write_bytes(member.read_bytes()[:size] + end)
    with pytest.raises(ProductError, match="damaged"):
        inventory(member.parent)
    path = write(attitude, member.parent / "SCA1B_2023-06-01_C_04.txt.gz")
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(ProductError, match="damaged"):
        read(path)
