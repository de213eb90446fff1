"""Events of the catalogue: names, dates, manoeuvres as designed and found, files needed."""

import datetime
import pickle

import pytest

from gravcal import catalog
from gravcal.errors import CatalogError

EVENT = """calibration = "com_offset"
satellites = ["grace-c"]
date = 2030-01-01
date_status = "printed"
source = "invented"
design = "com_offset_session"
release = "04"
found = []
"""


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """A user's own catalogue with room for events."""
    (tmp_path / "events").mkdir()
    monkeypatch.setenv("GRAVCAL_CATALOG", str(tmp_path))
    return tmp_path


def test_all_centre_of_mass_events_of_the_paper_are_there():
    """Published: 20 dates of GRACE-C in Table 9, one of GRACE-D in Table 8 of 10.3390/rs14164030."""
    of_c = catalog.events(satellite="C", calibration="com_offset")
    assert len(of_c) == 20
    assert of_c[0].date == datetime.date(2018, 6, 6)
    assert of_c[-1].date == datetime.date(2022, 2, 20)
    assert [e.name for e in catalog.events(satellite="grace-d", calibration="com_offset")] == ["grace-d-2018-06-06"]


def test_a_session_has_seven_manoeuvres_in_the_printed_areas():
    """Published: 10.3390/rs14164030, Tables 2 and 3: 3 pitch, 2 roll, 2 yaw of 180 s at 12 s."""
    designed = catalog.event("grace-c-2020-02-01").designed
    counts = {}
    for entry in designed:
        counts[entry.kind] = counts.get(entry.kind, 0) + entry.count
        assert (entry.duration_s, entry.period_s) == (180.0, 12.0)
    assert counts == {"pitch": 3, "roll": 2, "yaw": 2}
    assert designed[0].facts["latitude_deg"] == [10.0, 20.0]
    assert designed[0].facts["longitude_deg"] == [-55.0, -35.0]


def test_a_printed_time_stays_beside_its_unknown_scale():
    """Published: 10.3390/rs14164030, Sec. 4.2: the first manoeuvre lasts from 04:52:49 to 04:55:49."""
    first = catalog.event("grace-c-2020-02-01").printed[0]
    assert first["stop"] - first["start"] == datetime.timedelta(seconds=180)
    assert first["time_scale"] == "not stated"


def test_impossible_dates_are_corrected_or_unknown_and_marked():
    """Published: erratum K-5; the printed date stays beside the catalogue's."""
    late = catalog.event("grace-d-2020-08-26")
    assert (late.date_status, late.date_as_printed) == ("corrected", datetime.date(2022, 8, 26))
    early = catalog.event("grace-ab-2002-unknown")
    assert (early.date, early.date_status, early.date_as_printed) == (None, "unknown", datetime.date(2002, 3, 16))
    assert early.raw_files == ()
    assert catalog.events(satellite="A")[-1] == early


def test_no_event_lies_before_the_launch_of_its_satellite():
    """Analytic: a date before launch is impossible."""
    for entry in catalog.events():
        for name in entry.satellites:
            assert entry.date is None or entry.date > catalog.satellite(name).launched


def test_the_files_of_an_event_follow_from_its_design():
    """Contract: six products of one satellite for the offset; both satellites and the ranging for the antenna."""
    names = [raw.name for raw in catalog.event("grace-d-2018-06-06").raw_files]
    assert names[0] == "ACC1A_2018-06-06_D_04.txt"
    assert len(names) == 6
    ranging = catalog.event("grace-b-2003-02-10").raw_files
    assert {raw.letter for raw in ranging} == set("ABX")
    assert len(ranging) == 5 * 11
    assert ranging[-1].name == "KBR1B_2003-02-20_X_02.dat"
    assert all(raw.sha256 is None for raw in ranging)


def test_records_survive_the_way_to_a_worker():
    """Contract: events, satellites and parameters can be pickled."""
    for record in (catalog.event("grace-c-2020-02-01"), catalog.parameters("com_offset"), catalog.satellite("C")):
        again = pickle.loads(pickle.dumps(record))
        assert vars(again).keys() == vars(record).keys()
    assert again.mass_at_launch.value == 600.2


def test_found_manoeuvres_and_digests_are_kept_in_the_users_catalogue(own_folder):
    """Contract: what was written is what is read, to the last digit of the times."""
    found = [{"kind": "pitch", "start": 700000000.1234567, "stop": 700000180.1}, catalog.Manoeuvre("yaw", 1.0, 2.0)]
    digest = "0" * 64
    digests = {"ACC1A_2024-02-01_C_04.txt": digest}
    text = catalog.event_text("com_offset", "com_offset_session", ["C"], datetime.date(2024, 2, 1), found, digests)
    saved = catalog.save_event("grace-c-2024-02-01", text)
    assert saved.found == (catalog.Manoeuvre("pitch", 700000000.1234567, 700000180.1), found[1])
    assert saved.raw_files[0].sha256 == digest
    assert catalog.event("grace-c-2024-02-01") == saved
    assert [path.name for path in (own_folder / "events").iterdir()] == ["grace-c-2024-02-01.toml"]


def test_without_an_own_catalogue_nothing_is_written(monkeypatch):
    """Contract: the shipped catalogue is never changed by a run."""
    monkeypatch.delenv("GRAVCAL_CATALOG", raising=False)
    with pytest.raises(CatalogError, match="no own catalogue.*Set GRAVCAL_CATALOG"):
        catalog.save_event("grace-c-2024-02-01", EVENT)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('"com_offset"\ns', "1\ns"), "calibration: found 1 is not of type"),
        (('["grace-c"]', '"grace-c"'), 'satellites: found "grace-c" is not of type "array"'),
        (('["grace-c"]', '["grace-z"]'), "no satellite named 'grace-z'"),
        (("2030-01-01", '"soon"'), 'date: found "soon" does not match'),
        (('"printed"', '"perhaps"'), 'date_status: found "perhaps"'),
        (('"printed"', '"unknown"'), "date_status: found 'unknown'; expected a status that fits"),
        (('"com_offset_session"', '"sesion"'), "no design named 'sesion'"),
        (("found = []", '[[found]]\nkind = "yaw"\nstart = 2\nstop = 1'), r"found\.stop: found 1; expected later"),
        (("found = []", 'found = []\n[sha256]\n"a.txt" = "12"'), r'sha256\.a\.txt: found "12" does not match'),
        (('release = "04"\n', ""), '"release" is a required'),
    ],
)
def test_a_broken_event_file_says_file_key_found_and_expected(own_folder, change, message):
    """Contract: every departure from the form is named."""
    (own_folder / "events" / "zed.toml").write_text(EVENT.replace(*change))
    with pytest.raises(CatalogError, match=message):
        catalog.event("zed")


def test_a_saved_event_of_a_pair_keeps_whose_manoeuvre_it_was(tmp_path, monkeypatch):
    """Contract: satellite letters go into the file and come back."""
    (tmp_path / "events").mkdir()
    monkeypatch.setenv("GRAVCAL_CATALOG", str(tmp_path))
    found = [{"kind": "+pitch", "start": 6.5e8, "stop": 6.5e8 + 3780.0, "satellite": "D"}]
    text = catalog.event_text("kbr_phase_centre", "kbr_wiggle", ("C", "D"), datetime.date(2020, 8, 7), found, {})
    assert 'source = "found in the Level-1 files below"' in text
    args = ("kbr_phase_centre", "kbr_wiggle", ("C", "D"), datetime.date(2020, 8, 7), found, {}, "simulated")
    assert 'source = "found in the simulated Level-1 files below"' in catalog.event_text(*args)
    saved = catalog.save_event("grace-cd-2020-08-07", text)
    assert [(one.satellite, one.kind) for one in saved.found] == [("D", "+pitch")]
