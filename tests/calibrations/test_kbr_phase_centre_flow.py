"""The whole way: Level-1 files in, documents, vector files and page out; what the files must satisfy."""

import json
from functools import lru_cache, partial

import commands
import numpy as np
import pytest
from kbr_campaign import NOMINAL, ingested, process, simulated
from numpy.testing import assert_allclose

from flows import engine, kbr_phase_centre
from gravcal import catalog
from gravcal.calibrations.align import QUATERNION
from gravcal.calibrations.checks import of_product
from gravcal.calibrations.kbr_phase_centre import checks, page
from gravcal.errors import GravcalError, NoDataError, ProductError
from gravcal.io import readers, vcm, writers
from tasks import kbr_phase_centre as stages

QUICK = {"phase_step_s": 1.0}
run = partial(commands.run, "kbr_phase_centre")


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Folder with the files of a simulated campaign, and its truth."""
    folder = tmp_path_factory.mktemp("campaign")
    about = {"truth": folder / "truth.json", "effects": {}, "settings": QUICK}
    return folder, kbr_phase_centre.CALIBRATION.simulate(folder, seed=1, **about)


@pytest.fixture(autouse=True)
def _shared_store(campaign, monkeypatch):
    """Let all tests have one store, so that the campaign is processed once."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(campaign[0] / "products"))


def test_files_in_vectors_out(campaign, tmp_path):
    """Recovery: errors within 4.5 sigma, wiggles told; vector files and lines of measured data hold what is adopted.

    Of simulated data the lines are comments that a reader refuses, without a vector file.
    """
    folder, truth = campaign
    document, ref = run(folder)
    assert document["status"] == "delivered"
    assert document["event"] == "grace-cd-2020-09-10"
    assert [one["dof"] for one in document["consistency"]["manoeuvres"].values()] == [2, 2, 2]  # of 8, less x, y and z
    source, chosen = kbr_phase_centre.CALIBRATION.source(data=folder), catalog.parameters("kbr_phase_centre")
    detected = engine.run(kbr_phase_centre.detect, source, chosen, engine="inline")
    told = [kbr_phase_centre.CALIBRATION.detected(detected)["manoeuvres"], truth["manoeuvres"]]
    assert [(m["satellite"], m["kind"]) for m in told[0]] == [(m["satellite"], m["kind"]) for m in told[1]]
    files = page.vector_files(document | {"origin": "measured"}, "2020-09-10")
    for letter in "CD":
        for observable in ("range", "range_rate", "range_acceleration"):
            for estimator in ("ls", "robust"):
                found = document["satellites"][letter][observable][estimator]
                error = np.array(found["phase_centre_mm"]) - truth["phase_centre_mm"][letter]
                assert np.all(np.abs(error) < 4.5 * np.array(found["sigma_mm"]))
        adopted = 1e-3 * np.array(document["adopted"]["satellites"][letter]["phase_centre_mm"])
        path = tmp_path / f"VKB1B_2020-09-10_{letter}_04.txt"
        path.write_text(files[path.name])
        (written,) = readers.read(path).to_dataframe().to_dict("records")
        assert_allclose([written["mag"] * written[f"cos{axis}"] for axis in "xyz"], adopted, rtol=1e-12)
        assert written["time_tag"] == np.ceil(max(one["stop"] for one in document["manoeuvres"]))
    lines = [vcm.read_line(line) for line in files["result.soe"].splitlines()]
    assert [(one.satellite, one.name) for one in lines] == [("C", "VKB"), ("D", "VKB")]
    doubtful = page.vector_files(document | {"origin": "measured", "status": "questionable"}, "2020-09-10")
    assert all("QUESTIONABLE" in text for text in doubtful.values())
    assert not list(ref.folder.glob("VKB1B*"))
    written = (ref.folder / "result.soe").read_text().splitlines()
    assert len(written) == 2
    for line, kept in zip(written, files["result.soe"].splitlines(), strict=True):
        assert line.startswith("# SIMULATED")
        assert line.endswith(kept)
        with pytest.raises(ProductError):
            vcm.read_line(line)
    assert json.loads((folder / "truth.json").read_text())["phase_centre_mm"] == truth["phase_centre_mm"]


def test_the_scatter_between_wiggles_and_printed_tables_stand_beside_the_errors(campaign):
    """Analytic: of two wiggles a component half their difference, x has none; five figures, the printed tables."""
    document, ref = run(campaign[0])
    told = document["consistency"]["scatter_between_manoeuvres_mm"]["range_rate"]["C"]
    own = [one["estimates_mm"]["range_rate"]["value"] for one in document["manoeuvres"] if one["satellite"] == "C"]
    assert told[0] is None
    assert_allclose(told[1:], [abs(own[2] - own[3]) / 2, abs(own[0] - own[1]) / 2], rtol=1e-9)  # yaw tells y
    page = (ref.folder / "report.html").read_text(encoding="utf-8")
    assert page.count("<figure ") == 5
    assert "1457.1 ± 3.2" in page


def test_two_hours_of_ranging_without_wiggles_say_so(tmp_path):
    """Contract: status no_manoeuvre, no vectors; the page says what routine pointing can tell."""
    commands.simulated("kbr_phase_centre", tmp_path, 2, **QUICK, manoeuvres=",")
    (ranging,) = tmp_path.glob("KBR1B*")
    header, mark, body = ranging.read_text().partition("# End of YAML header\n")
    ranging.write_text(header + mark + "".join(body.splitlines(keepends=True)[:1440]))
    document, ref = run(tmp_path)
    assert document["status"] == "no_manoeuvre"
    assert not list(ref.folder.glob("VKB1B*"))
    assert document["noise"]["manoeuvres_um_rthz"] == {"4_mhz": None, "8_mhz": None}
    assert "x is not determined" in (ref.folder / "report.html").read_text(encoding="utf-8")


def test_an_event_of_the_catalogue_stands_for_its_pair(tmp_path, monkeypatch):
    """Contract: the event of one satellite needs the files of both, of its own day."""
    monkeypatch.setenv("GRAVCAL_DATA", str(tmp_path))
    with pytest.raises(NoDataError, match="no file of satellite D on 2020-09-28"):
        kbr_phase_centre.CALIBRATION.source(event="grace-d-2020-09-28")
    (tmp_path / "SCA1B_2020-09-28_D_04.txt").touch()
    source = kbr_phase_centre.CALIBRATION.source(event="grace-d-2020-09-28")
    assert (source.event, source.satellite, source.date) == ("grace-d-2020-09-28", "CD", "2020-09-28")
    with pytest.raises(ProductError, match="found no KBR1B or LRI1B of satellite Y on 2020-09-28"):
        engine.run(kbr_phase_centre.calibrate, source, catalog.parameters("kbr_phase_centre"), engine="inline")


def test_a_campaign_over_days_is_one_solution(tmp_path):
    """Recovery: wiggles of A on one day and of B two days later, a day between missing; all within 4.5 sigma."""
    shared = QUICK | {"quiet_s": 600.0, "first_start_s": 2000.0}
    for date, letter in (("2020-09-17", "a"), ("2020-09-19", "b")):
        wiggles = ",".join(f"{sign}{axis}_{letter}" for axis in ("pitch", "yaw") for sign in "+-")
        truth = commands.simulated("kbr_phase_centre", tmp_path, 4, **shared, date=date, manoeuvres=wiggles)
    document, ref = run(tmp_path)
    assert document["event"] == "grace-cd-2020-09-17"
    assert [one["kind"] for one in document["manoeuvres"]] == 2 * ["+pitch", "-pitch", "+yaw", "-yaw"]
    for letter in "CD":
        found = document["adopted"]["satellites"][letter]
        error = np.array(found["phase_centre_mm"]) - truth["phase_centre_mm"][letter]
        assert np.all(np.abs(error) < 4.5 * np.array(found["sigma_mm"]))
    one_day = kbr_phase_centre.CALIBRATION.source(data=tmp_path, date="2020-09-19")
    assert [file.date for file in kbr_phase_centre.level_one_files(one_day)] == 5 * ["2020-09-19"]
    assert ref.event == document["event"]


SHORT = (("manoeuvres", "+pitch_a,-pitch_a,+yaw_b,-yaw_b"), ("quiet_s", 900.0))
ZERO = (30000, 30072, 0.0)  # s of the day, in routine pointing, and the value


@lru_cache(maxsize=1)
def good():
    """Columns of a short campaign, which nobody changes."""
    return simulated(5, SHORT)[0]


def changed(files, change):
    """Columns of which those of some files are others."""
    return {name: dict(values) | (change(values) if name in files else {}) for name, values in good().items()}


def failed(columns):
    """Names of the checks of the inputs that fail."""
    chosen, given = catalog.parameters("kbr_phase_centre"), {"nominal_m": NOMINAL}
    observed = ingested(columns)
    names = [("KBR1B", "Y"), ("GNI1B", "C"), ("GNI1B", "D"), ("SCA1B", "C"), ("SCA1B", "D")]
    aligned = stages.align(*(observed[name] for name in names), **chosen.for_stage("align"))
    pointed = stages.pointing(aligned, **chosen.for_stage("pointing"), **given, given=())
    settings = chosen.for_stage("observable") | given
    equations = [stages.observable(aligned, pointed, variant=v, **settings) for v in ("range", "range_rate")]
    orbits = [observed[name] for name in observed if name[0] in ("GNI1B", "GNV1B")]
    found = of_product(stages.checks(aligned, pointed, *equations, *orbits, **chosen.for_stage("checks"), **given))
    return {one.name for one in found if not one.passed}


def held(values, start, stop, by=None):
    """Values of which a stretch is a number, or its first value."""
    epoch = np.arange(len(values))
    return np.where((epoch >= start) & (epoch < stop), values[start] if by is None else by, values)


KBR, OF_C, OF_D, CAMERA_C, CAMERA_D = ("KBR1B", "Y"), *((p, x) for p in ("GNI1B", "SCA1B") for x in "CD")
RANGES = ("biased_range", "range_rate", "range_accl")
#: Files, what is other in them, and the check that has to see it.
SPOILED = {
    "both orbits mirrored": (  # they obey the same laws
        [OF_C, OF_D],
        lambda c: {f"{a}{kind}": c[f"{b}{kind}"] for kind in ("pos", "vel") for a, b in ("xy", "yx")},
        "routine pointing C",
    ),
    "coordinate zero": ([OF_C], lambda c: {"ypos": held(c["ypos"], *ZERO)}, "orbit C, position against velocity"),
    "camera of the other": ([CAMERA_C], lambda _: good()[CAMERA_D], "largest angle C"),
    "attitude frozen": (
        [CAMERA_D],
        lambda c: {name: held(c[name], 40000, 41440) for name in QUATERNION},
        "routine pointing D",
    ),
    "ranging late": ([KBR], lambda c: {"gps_time": c["gps_time"] + 1}, "range rate against orbits, rms"),
    "orbit minutes late": ([OF_D], lambda c: {"gps_time": c["gps_time"] + 137}, "tags of orbit D, late"),
    "ranging minutes late": ([KBR], lambda c: {"gps_time": c["gps_time"] + 137}, "tags of ranging, late"),
    "attitude late": ([CAMERA_C], lambda c: {"gps_time": c["gps_time"] + 60}, "tags of star camera C, late"),
    "ranging scaled": ([KBR], lambda c: {n: c[n] * (1 + 1e-4) for n in RANGES}, "range against orbits, rms"),
    "ranging in pieces": (  # a jump every ten minutes, which the record does not mark
        [KBR],
        lambda c: {RANGES[0]: c[RANGES[0]] + 0.02 * (np.arange(c[RANGES[0]].size) // 120)},
        "ranging in long stretches",
    ),
    "antenna correction": (
        [KBR],
        lambda c: {"ant_centr_corr": c["ant_centr_corr"] + 2.95},
        "antenna correction of the file",
    ),
}


@pytest.mark.parametrize("name", sorted(SPOILED))
def test_what_contradicts_another_record_fails_the_check_of_it(name):
    """Contract: each mutation fails at least the check that was made for it."""
    *how, check = SPOILED[name]
    assert check in failed(changed(*how))


def test_the_other_orbit_product_is_looked_at():
    """Contract: a GNV1B beside GNI1B that is 3 m off, or shares no epoch with it; a good day fails nothing."""
    assert failed(good()) == set()
    columns = changed((), None)
    columns["GNV1B", "C"] = dict(simulated(5, (*SHORT, ("orbit_product", "GNV1B")))[0]["GNV1B", "C"])
    assert failed(columns) == set()
    columns["GNV1B", "C"]["zpos"] = columns["GNV1B", "C"]["zpos"] + 3.0
    assert failed(columns) == {"orbit C, GNI1B against GNV1B"}
    apart = [(np.arange(3.0), np.zeros((3, 3)))], [(np.array([9.5]), np.zeros((1, 3)))]
    assert checks.orbit_difference(*apart) == np.inf


def test_roll_is_seen():
    """Analytic: z down is 0; a body turned by +90 deg about the line of sight, x."""
    position, line = np.array([[0.0, 0.0, 7e6]]), np.array([[1.0, 0.0, 0.0]])
    half = np.sqrt(0.5)
    for quaternion, expected in (([0.0, 1.0, 0.0, 0.0], 0.0), ([half, half, 0.0, 0.0], np.pi / 2)):
        assert abs(abs(checks.roll(position, np.array([quaternion]), line)[0]) - expected) < 1e-12


def test_results_are_held_against_the_catalogue_each_other_and_their_noise():
    """Contract: a phase centre 30 mm off in y, an observable apart, more noise than assumed, wiggles that differ."""
    limits = {n: e.value for n, e in catalog.parameters("kbr_phase_centre").entries.items()}
    combined = process(good()).combined
    agree = dict.fromkeys(("range", "range_rate", "range_acceleration"), 0.5)
    assert all(one.passed for one in checks.of_result(combined, agree, NOMINAL, limits))

    def failing(spoil=lambda _: None, nominal=NOMINAL, tests=agree):
        spoiled = combined.copy(deep=True)
        spoil(spoiled)
        return {one.name for one in checks.of_result(spoiled, tests, nominal, limits) if not one.passed}

    off = np.array(NOMINAL) + [[0, 0.03, 0], [0.2, 0, 0]]
    assert failing(nominal=off) == {f"{n} from the catalogue, less 3 sigma" for n in ("y and z of C", "x of D")}
    assert failing(lambda c: c["sigma0"].values.__imul__(3)) == {"noise over noise assumed, range_rate"}
    assert failing(lambda c: c["centre"].values[0].__iadd__(1.0)) == {"observables apart"}
    assert failing(lambda c: c["centre"].values[1, 0, 1].__iadd__(1.0)) == {"robust apart from ls"}
    assert failing(tests=agree | {"range": 1e-6}) == {"probability that wiggles agree, range"}
    known = {"phase_centre_mm": [1400.0, 0.1, 0.1], "sigma_mm": [1.0, 0.01, 0.01]}
    pairs = ({"C": known, "D": one} for one in (known, {name: [None] * 3 for name in known}))
    assert [page._verdict(one, "", {"p": None}, limits)["accuracy_met"] for one in pairs] == [True, False]


def test_an_attitude_that_is_late_by_a_second_fails_the_fit():
    """Recovery: z then is 1.6 mm off with a sigma below 0.01 mm; only the noise in the wiggles contradicts it."""
    limits = {n: e.value for n, e in catalog.parameters("kbr_phase_centre").entries.items()}
    combined = process(changed([CAMERA_C], lambda c: {"gps_time": c["gps_time"] + 1})).combined
    found = checks.of_result(combined, {}, NOMINAL, limits)
    assert "noise over noise assumed, range_rate" in {one.name for one in found if not one.passed}


def test_a_file_that_cannot_be_checked_is_an_error(tmp_path):
    """Contract: range scaled but not its rate: breaks everywhere, so nothing to hold against the orbits."""
    for (product, letter), values in changed([KBR], lambda c: {RANGES[0]: c[RANGES[0]] * (1 + 1e-3)}).items():
        writers.write(values, tmp_path / writers.file_name(product, "2020-09-10", letter))
    source = kbr_phase_centre.CALIBRATION.source(data=tmp_path)
    with pytest.raises(GravcalError, match="the longest of 60 s"):
        engine.run(kbr_phase_centre.calibrate, source, catalog.parameters("kbr_phase_centre"), engine="inline")


def test_a_stretch_of_hours_is_refused():
    """Robustness: with the orbits of both satellites exchanged a wiggle lasted the day, and its covariance had 5 GB."""
    import xarray as xr

    from gravcal.calibrations.kbr_phase_centre.estimate import LONGEST, arcs

    count = LONGEST + 1
    values = {name: ("time_kbr", np.zeros(count)) for name in ("arc", "segment", "lever")}
    equations = xr.Dataset(values | {"start": ("manoeuvre", [0.0])}, coords={"time_kbr": 5.0 * np.arange(count)})
    measured = xr.Dataset(attrs={"step_s": 5.0})
    with pytest.raises(GravcalError, match="4001 observations in one stretch"):
        arcs(equations, measured, 0, 5, 0.012)
