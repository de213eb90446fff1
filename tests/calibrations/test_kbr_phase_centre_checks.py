"""What the files of a pair must satisfy against each other: none of it fails on a good day, one of it on a bad one."""

import json
from functools import lru_cache

import numpy as np
import pytest
from commands import gravcal
from kbr_campaign import NOMINAL, process, simulated

from flows import kbr_phase_centre
from gravcal import catalog
from gravcal.calibrations.checks import of_product
from gravcal.calibrations.kbr_phase_centre import checks
from gravcal.errors import GravcalError
from gravcal.io import archive, vcm, writers
from gravcal.simulation import kbr_phase_centre as simulation
from tasks import kbr_phase_centre as stages

SHORT = (("manoeuvres", "+pitch_a,-pitch_a,+yaw_b,-yaw_b"), ("quiet_s", 900.0))
MIDDLE = slice(30000, 30072)  # s of the day, in routine pointing


@lru_cache(maxsize=1)
def good():
    """Columns of a short campaign, which nobody changes."""
    return simulated(5, SHORT)[0]


def changed(change):
    """Copies of the columns, one of them spoiled."""
    columns = {name: {k: np.array(v) for k, v in values.items()} for name, values in good().items()}
    change(columns)
    return columns


def failed(columns):
    """Names of the checks of the inputs that fail."""
    chosen, given = catalog.parameters("kbr_phase_centre"), {"nominal_m": NOMINAL}
    observed = simulation.ingested(columns)
    names = [("KBR1B", "Y"), ("GNI1B", "C"), ("GNI1B", "D"), ("SCA1B", "C"), ("SCA1B", "D")]
    aligned = stages.align(*(observed[name] for name in names), **chosen.for_stage("align"))
    pointed = stages.pointing(aligned, **chosen.for_stage("pointing"), **given, given=())
    settings = chosen.for_stage("observable") | given
    equations = [stages.observable(aligned, pointed, variant=v, **settings) for v in ("range", "range_rate")]
    orbits = [observed[name] for name in observed if name[0] in ("GNI1B", "GNV1B")]
    found = of_product(stages.checks(aligned, pointed, *equations, *orbits, **chosen.for_stage("checks"), **given))
    return {one.name for one in found if not one.passed}


def test_a_good_day_fails_nothing():
    """Contract: no false alarm."""
    assert failed(good()) == set()


def exchanged(names):
    """Exchange two columns of the orbit of C."""

    def change(columns):
        own, (a, b) = columns["GNI1B", "C"], names
        own[a], own[b] = own[b], own[a]

    return change


def orbit_of_both(columns):
    """Exchange x and y of position and velocity of both: mirrored orbits, which obey the same laws."""
    for letter in "CD":
        own = columns["GNI1B", letter]
        for kind in ("pos", "vel"):
            own[f"x{kind}"], own[f"y{kind}"] = own[f"y{kind}"], own[f"x{kind}"]


def put(product, letter, name, value, where=MIDDLE):
    """Set a stretch of a column: a number, or None for its first value."""

    def change(columns):
        column = columns[product, letter][name]
        column[where] = column[where][0] if value is None else value

    return change


def cameras_exchanged(columns):
    """Attitude of C in the file of D and the other way round."""
    columns["SCA1B", "C"], columns["SCA1B", "D"] = columns["SCA1B", "D"], columns["SCA1B", "C"]


def shifted(product, letter, seconds):
    """Move the time of one file."""

    def change(columns):
        columns[product, letter]["gps_time"] = columns[product, letter]["gps_time"] + seconds

    return change


def scaled(columns):
    """Range, rate and acceleration too long by 1e-4."""
    for name in ("biased_range", "range_rate", "range_accl"):
        columns["KBR1B", "Y"][name] = columns["KBR1B", "Y"][name] * (1 + 1e-4)


def attitude_frozen(columns):
    """The same quaternion for 24 min."""
    for values in columns["SCA1B", "D"].values():
        if values.dtype.kind == "f":
            values[40000:41440] = values[40000]


def jumps(columns):
    """A jump of the range every ten minutes, which the record does not mark."""
    columns["KBR1B", "Y"]["biased_range"] += 0.02 * (np.arange(columns["KBR1B", "Y"]["gps_time"].size) // 120)


SPOILED = {
    "x and y exchanged": (exchanged(("xpos", "ypos")), "orbit C, position against velocity"),
    "both orbits mirrored": (orbit_of_both, "routine pointing C"),
    "coordinate frozen": (
        put("GNI1B", "D", "zpos", None, slice(30000, 31440)),
        "orbit D, position against velocity",
    ),
    "coordinate zero": (put("GNI1B", "C", "ypos", 0.0), "orbit C, position against velocity"),
    "velocity zero": (put("GNI1B", "C", "yvel", 0.0), "orbit C, position against velocity"),
    "cameras exchanged": (cameras_exchanged, "largest angle C"),
    "attitude frozen": (attitude_frozen, "routine pointing D"),
    "orbit late": (shifted("GNI1B", "C", 1), "range rate against orbits, rms"),
    "ranging late": (shifted("KBR1B", "Y", 1), "range rate against orbits, rms"),
    "attitude late": (shifted("SCA1B", "C", 60), "routine pointing C"),
    "ranging scaled": (scaled, "range against orbits, rms"),
    "ranging in pieces": (jumps, "ranging in long stretches"),
}


@pytest.mark.parametrize("name", sorted(SPOILED))
def test_what_contradicts_another_record_fails_the_check_of_it(name):
    """Contract: each mutation fails at least the check that was made for it."""
    change, check = SPOILED[name]
    assert check in failed(changed(change))


def test_the_other_orbit_product_is_looked_at():
    """Contract: a GNV1B beside GNI1B that is 3 m off, or shares no epoch with it."""
    columns = changed(lambda _: None)
    settings = (*SHORT, ("orbit_product", "GNV1B"))
    columns["GNV1B", "C"] = dict(simulated(5, settings)[0]["GNV1B", "C"])
    assert failed(columns) == set()
    columns["GNV1B", "C"]["zpos"] = columns["GNV1B", "C"]["zpos"] + 3.0
    assert failed(columns) == {"orbit C, GNI1B against GNV1B"}
    assert (
        checks.orbit_difference([(np.arange(3.0), np.zeros((3, 3)))], [(np.array([9.5]), np.zeros((1, 3)))]) == np.inf
    )


def test_the_file_s_own_antenna_correction_is_looked_at():
    """Contract: a correction with a sign or a size that the catalogue's phase centres do not give."""
    columns = changed(lambda _: None)
    columns["KBR1B", "Y"]["ant_centr_corr"] += 2.95
    assert failed(columns) == {"antenna correction of the file"}


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
    assert failing(nominal=off) == {"y and z of C against the catalogue", "x of D against the catalogue"}
    assert failing(lambda c: c["sigma0"].values.__imul__(3)) == {"noise over noise assumed, range_rate"}
    assert failing(lambda c: c["centre"].values[0].__iadd__(1.0)) == {"observables apart"}
    assert failing(lambda c: c["centre"].values[1, 0, 1].__iadd__(1.0)) == {"robust apart from ls"}
    assert failing(tests=agree | {"range": 1e-6}) == {"probability that wiggles agree, range"}


def test_an_attitude_that_is_late_by_a_second_fails_the_fit():
    """Recovery: z then is 1.6 mm off with a sigma below 0.01 mm; only the noise in the wiggles contradicts it."""
    limits = {n: e.value for n, e in catalog.parameters("kbr_phase_centre").entries.items()}
    combined = process(changed(shifted("SCA1B", "C", 1))).combined
    found = checks.of_result(combined, {}, NOMINAL, limits)
    assert "noise over noise assumed, range_rate" in {one.name for one in found if not one.passed}


def test_a_questionable_result_says_so_everywhere(tmp_path, monkeypatch):
    """Contract: exit code 4; status and failed check in document, verdict, page, vector files and lines."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(tmp_path / "store"))
    for (product, letter), values in changed(put("GNI1B", "C", "ypos", 0.0)).items():
        path = writers.write(values, tmp_path / writers.file_name(product, "2020-09-10", letter))
        path.write_text(
            path.read_text().replace("simulated data", "none").replace(archive.BY, "1")
        )  # counts as measured
    options = ("--data", tmp_path, "--engine", "inline", "--json", tmp_path / "result.json")
    assert gravcal("run", "kbr_phase_centre", *options) == 4
    document = json.loads((tmp_path / "result.json").read_text())
    name = "orbit C, position against velocity"
    assert document["status"] == "questionable"
    assert {one["name"]: one["passed"] for one in document["checks"]}[name] is False
    assert f"QUESTIONABLE: {name}" in document["verdict"]["text"]
    folder = next((tmp_path / "store" / "latest").glob("*")) / "kbr_phase_centre.report"
    assert name in (folder / "report.html").read_text(encoding="utf-8")
    lines = [vcm.read_line(line) for line in (folder / "result.soe").read_text().splitlines()]
    assert lines
    assert all("QUESTIONABLE" in one.comment for one in lines)
    assert all("QUESTIONABLE" in path.read_text() for path in folder.glob("VKB1B*"))


def test_a_file_that_cannot_be_checked_is_an_error(tmp_path, monkeypatch):
    """Contract: range scaled but not its rate: breaks everywhere, so nothing to hold against the orbits."""
    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(tmp_path / "store"))

    def change(columns):
        columns["KBR1B", "Y"]["biased_range"] *= 1 + 1e-3

    for (product, letter), values in changed(change).items():
        writers.write(values, tmp_path / writers.file_name(product, "2020-09-10", letter))
    from flows import engine

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
