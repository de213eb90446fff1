"""The catalogue: satellites, events and parameters, how they are asked, what is said when asked wrongly."""

import dataclasses
import datetime
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gravcal import catalog
from gravcal.effects import effect
from gravcal.errors import CatalogError


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """A user's own catalogue, empty."""
    for kind in ("satellites", "events", "parameters"):
        (tmp_path / kind).mkdir()
    monkeypatch.setenv("GRAVCAL_CATALOG", str(tmp_path))
    return tmp_path


HEADING = 'letter = "Z"\nmission = "none"\nplatform = "ZED 1"\nlaunched = 2030-01-01\n'
MASS = '[mass]\nvalue = 100.0\nunit = "kg"\nframe = "none"\nsigma = 1.0\nsource = "invented"\n'
EVENT = """calibration = "com_offset"
satellites = ["grace-c"]
date = 2030-01-01
date_status = "printed"
source = "invented"
design = "com_offset_session"
release = "04"
found = []
"""
DEMO = """
[lowpass_hz]
value = 1
unit = "Hz"
minimum = 0.1
maximum = 2
stage = "solve"
reason = "invented for this test"
[drift_degree]
value = 2
stage = ["solve", "combine"]
reason = "invented for this test"
[estimate_scale]
value = true
stage = "solve"
reason = "invented for this test"
[dynamics]
value = "full"
allowed = ["full", "published"]
stage = "attitude"
reason = "invented for this test"
[variants]
value = ["mtq", "acc", "sca"]
allowed = ["mtq", "acc", "sca"]
stage = "combine"
reason = "invented for this test"
"""


@pytest.mark.parametrize("name", ["C", "c", "grace-c", "GRACE-C", "GRACE C", "grace_c"])
def test_a_satellite_answers_to_its_letter_and_its_names(name):
    """Contract: all spellings lead to one satellite, of which nobody changes a constant in passing."""
    found = catalog.satellite(name)
    assert found.name == "grace-c"
    with pytest.raises(ValueError, match="read-only"):
        found.com_to_antenna.value[0] = 0.0


def test_every_quantity_of_every_satellite_has_unit_frame_sigma_and_source():
    """Contract: value, unit, frame, sigma, source, always in this order."""
    for name in catalog.names("satellites"):
        _, content = catalog.read("satellites", name)
        tables = {key: table for key, table in content.items() if isinstance(table, dict)}
        assert tables
        for key, table in tables.items():
            assert tuple(table) == ("value", "unit", "frame", "sigma", "source"), f"{name}.{key}"
        assert set(catalog.satellite(name).quantities) == set(tables)


def test_settings_are_plain_numbers_and_what_is_assumed_says_so():
    """Contract: floats and lists, which can stand in a key; assumed inertia has a prior; QSA1B to its digits."""
    settings = catalog.satellite("C").settings("inertia", "mass_at_launch")
    assert settings["mass_at_launch"] == 600.2
    assert settings["inertia"][1][1] == 580.67
    assert sorted(settings) == ["inertia", "inertia_sigma", "mass_at_launch", "mass_at_launch_sigma"]
    assert isinstance(settings["inertia"][0], list)
    for letter in "CD":
        one = catalog.satellite(letter)
        assert one.inertia.source.startswith("assumed, no source reached")
        assert np.all(one.inertia.sigma > 0)
        assert_allclose(one.inertia.value, one.inertia.value.T, atol=0)
        assert_allclose(np.linalg.norm(one.star_camera_mounting.value, axis=1), 1, atol=1e-9)


def test_nearest_names_are_offered_for_an_unknown_satellite_and_quantity():
    """Contract: an error says what may have been meant."""
    with pytest.raises(CatalogError, match=r"'grace-x'.*Nearest:.*grace-"):
        catalog.satellite("grace-x")
    with pytest.raises(CatalogError, match="com_to_antena.*Nearest: com_to_antenna"):
        _ = catalog.satellite("C").com_to_antena


def test_a_users_own_satellite_is_found_first(own_folder, monkeypatch):
    """Contract: GRAVCAL_CATALOG adds and overrides; a wrong one is not passed over."""
    (own_folder / "satellites" / "zed.toml").write_text(HEADING + MASS)
    (own_folder / "satellites" / "grace-c.toml").write_text(HEADING.replace("Z", "C", 1) + MASS)
    assert catalog.satellite("Z").mass.value == 100.0
    assert catalog.satellite("C").mission == "none"
    assert catalog.satellite("D").mission == "GRACE-FO"
    monkeypatch.setenv("GRAVCAL_CATALOG", str(own_folder / "nowhere"))
    with pytest.raises(CatalogError, match=r"GRAVCAL_CATALOG.*expected a folder.*unset"):
        catalog.satellite("C")


EARLIER, SECOND = '[[found]]\nkind = "yaw"\nstart = 2\nstop = 1', "[a_s]\nvalue = 1\nstage = 'x'\nreason = 'r'\n"
#: What a file of each kind says wrongly, and what the error names.
BROKEN = {
    "satellites": [
        (HEADING + MASS.replace('source = "invented"\n', ""), r'zed\.toml: mass: found "source" is a required'),
        (HEADING + MASS.replace("100.0", "nan"), r"mass\.value: found nan; expected finite numbers"),
        (HEADING + MASS.replace("100.0", "[[1, 2], [3]]"), r"mass\.value.*expected a full list"),
        (HEADING + MASS.replace("sigma = 1.0", "sigma = [1.0, 2.0]"), r"mass\.sigma.*shape of the value"),
        (HEADING + MASS.replace("sigma = 1.0", "sigma = -1.0"), r"mass\.sigma.*no negative"),
        ("letter = \n", r"zed\.toml: .*not valid TOML.*line 1"),
    ],
    "events": [
        (EVENT.replace('["grace-c"]', '["grace-z"]'), "no satellite named 'grace-z'"),
        (EVENT.replace('"printed"', '"unknown"'), "date_status: found 'unknown'; expected a status that fits"),
        (EVENT.replace('"com_offset_session"', '"sesion"'), "no design named 'sesion'"),
        (EVENT.replace("found = []", EARLIER), r"found\.stop: found 1; expected later"),
    ],
    "parameters": [
        (SECOND + "unit = 's'\nmaximum = 0.5\n", r"a_s: found 1\.0; expected between"),
        (SECOND + "default = 3\n", "'default' was unexpected"),
    ],
}


@pytest.mark.parametrize(("kind", "text", "message"), [(kind, *row) for kind, rows in BROKEN.items() for row in rows])
def test_a_broken_file_says_file_key_found_and_expected(own_folder, kind, text, message):
    """Contract: every departure from the form is named when the file is read."""
    (own_folder / kind / "zed.toml").write_text(text)
    ask = {"satellites": catalog.satellite, "events": catalog.event, "parameters": catalog.parameters}[kind]
    with pytest.raises(CatalogError, match=message):
        ask("zed")


def test_all_centre_of_mass_events_of_the_paper_and_their_manoeuvres_are_there():
    """Published: 10.3390/rs14164030, Tables 2, 3, 8, 9 and Sec. 4.2: 180 s at 12 s; the first 04:52:49 to 04:55:49."""
    of_c = catalog.events(satellite="C", calibration="com_offset")
    assert len(of_c) == 20
    assert of_c[0].date == datetime.date(2018, 6, 6)
    assert of_c[-1].date == datetime.date(2022, 2, 20)
    assert [e.name for e in catalog.events(satellite="grace-d", calibration="com_offset")] == ["grace-d-2018-06-06"]
    event, counts = catalog.event("grace-c-2020-02-01"), {}
    for entry in event.designed:
        counts[entry.kind] = counts.get(entry.kind, 0) + entry.count
        assert (entry.duration_s, entry.period_s) == (180.0, 12.0)
    assert counts == {"pitch": 3, "roll": 2, "yaw": 2}
    assert event.designed[0].facts["latitude_deg"] == [10.0, 20.0]
    assert event.designed[0].facts["longitude_deg"] == [-55.0, -35.0]
    first = event.printed[0]
    assert first["stop"] - first["start"] == datetime.timedelta(seconds=180)
    assert first["time_scale"] == "not stated"


def test_dates_are_corrected_or_unknown_and_files_follow_from_the_design():
    """Published: erratum K-5, the printed date stays; no event before a launch; six products, or both of a pair."""
    late = catalog.event("grace-d-2020-08-26")
    assert (late.date_status, late.date_as_printed) == ("corrected", datetime.date(2022, 8, 26))
    early = catalog.event("grace-ab-2002-unknown")
    assert (early.date, early.date_status, early.date_as_printed) == (None, "unknown", datetime.date(2002, 3, 16))
    assert early.raw_files == ()
    assert catalog.events(satellite="A")[-1] == early
    for entry in catalog.events():
        for name in entry.satellites:
            assert entry.date is None or entry.date > catalog.satellite(name).launched
    names = [raw.name for raw in catalog.event("grace-d-2018-06-06").raw_files]
    assert names[0] == "ACC1A_2018-06-06_D_04.txt"
    assert len(names) == 6
    ranging = catalog.event("grace-b-2003-02-10").raw_files
    assert {raw.letter for raw in ranging} == set("ABX")
    assert len(ranging) == 5 * 11
    assert ranging[-1].name == "KBR1B_2003-02-20_X_02.dat"
    assert all(raw.sha256 is None for raw in ranging)


def test_found_manoeuvres_and_digests_are_kept_in_the_users_catalogue(own_folder, monkeypatch):
    """Contract: what was written is read, to the last digit; of a pair, whose it was; what ships is never changed."""
    found = [{"kind": "pitch", "start": 700000000.1234567, "stop": 700000180.1}, catalog.Manoeuvre("yaw", 1.0, 2.0)]
    digests = {"ACC1A_2024-02-01_C_04.txt": "0" * 64}
    text = catalog.event_text("com_offset", "com_offset_session", ["C"], datetime.date(2024, 2, 1), found, digests)
    saved = catalog.save_event("grace-c-2024-02-01", text)
    assert saved.found == (catalog.Manoeuvre("pitch", 700000000.1234567, 700000180.1), found[1])
    assert saved.raw_files[0].sha256 == "0" * 64
    assert catalog.event("grace-c-2024-02-01") == saved
    assert [path.name for path in (own_folder / "events").iterdir()] == ["grace-c-2024-02-01.toml"]
    found = [{"kind": "+pitch", "start": 6.5e8, "stop": 6.5e8 + 3780.0, "satellite": "D"}]
    of_pair = "kbr_phase_centre", "kbr_wiggle", ("C", "D"), datetime.date(2020, 8, 7), found, {}
    assert "found in the simulated Level-1 files" in catalog.event_text(*of_pair, "simulated")
    saved = catalog.save_event("grace-cd-2020-08-07", catalog.event_text(*of_pair))
    assert [(one.satellite, one.kind) for one in saved.found] == [("D", "+pitch")]
    monkeypatch.delenv("GRAVCAL_CATALOG")
    with pytest.raises(CatalogError, match="no own catalogue.*Set GRAVCAL_CATALOG"):
        catalog.save_event("grace-c-2024-02-01", EVENT)


@pytest.fixture
def demo(own_folder):
    """Parameters of an invented calibration."""
    (own_folder / "parameters" / "demo.toml").write_text(DEMO)
    return catalog.parameters("demo")


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("lowpass_hz", "0.7", 0.7),
        ("drift_degree", "3", 3),
        ("estimate_scale", "false", False),
        ("dynamics", "published", "published"),
        ("variants", "mtq,sca", ("mtq", "sca")),
        ("drift_degree", 1, 1),
    ],
)
def test_a_text_takes_the_type_of_the_parameter(demo, name, text, value):
    """Contract: `--set name=text` gives the type of the catalogue's value."""
    found = getattr(demo.with_settings({name: text}), name)
    assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("lowpas_hz", "1", "no parameter named 'lowpas_hz'.*Nearest: lowpass_hz"),
        ("lowpass_hz", "7", r"lowpass_hz: found 7\.0; expected between 0\.1 and 2 Hz"),
        ("lowpass_hz", "nan", r"lowpass_hz: found nan; expected a number"),
        ("drift_degree", "2.5", "found '2.5'; expected a whole number"),
        ("estimate_scale", "perhaps", "found 'perhaps'; expected true or false"),
        ("dynamics", "rough", "found 'rough'; expected one of full, published"),
        ("variants", "mtq,gps", "found 'gps'; expected one of"),
    ],
)
def test_a_wrong_setting_is_refused_with_what_was_expected(demo, name, text, message):
    """Contract: unknown name, wrong type, value out of range."""
    with pytest.raises(CatalogError, match=message):
        demo.with_settings({name: text})


def test_every_parameter_has_a_name_with_its_unit():
    """Contract: composed units, as of noise densities, are left to `unit`."""
    for calibration in catalog.names("parameters"):
        entries = catalog.parameters(calibration).entries
        assert entries
        for name, entry in entries.items():
            if re.fullmatch("[A-Za-z]+", entry.unit or ""):
                assert entry.unit.lower() in name.lower().split("_"), name


def test_a_stage_gets_its_own_settings_only_and_a_change_is_a_new_record(demo):
    """Contract: the label of a stage holds what it takes; parameters are frozen."""
    assert demo.for_stage("combine") == {"drift_degree": 2, "variants": ("mtq", "acc", "sca")}
    with pytest.raises(CatalogError, match="no stage named 'atitude'.*Nearest: attitude"):
        demo.for_stage("atitude")
    assert (demo.drift_degree, demo.with_settings({"drift_degree": "1"}).drift_degree) == (2, 1)
    with pytest.raises(dataclasses.FrozenInstanceError):
        demo.calibration = "other"


def test_priors_of_scales_are_those_of_what_they_stand_for():
    """Contract: that of the torque covers dipole and inertia, rounded to 0.01; the angular scale's is its effect's."""
    chosen = catalog.parameters("com_offset")
    for letter in "CD":
        satellite = catalog.satellite(letter)
        dipole = satellite.dipole_per_current.sigma / satellite.dipole_per_current.value
        inertia = np.diag(satellite.inertia.sigma) / np.diag(satellite.inertia.value)
        assert_allclose(chosen.torque_scale_sigma, np.hypot(dipole, inertia), atol=0.01)
    assert {one.prior_sigma for one in effect("accelerometer.angular_scale").parameters} == {chosen.angular_scale_sigma}
