"""Routine pointing of a pair: recovery, what the measured day says, and what discovery names there."""

import commands
import numpy as np
import pytest
import seeds
from scipy import stats

from benchmarks import ranging
from flows.calibration import load
from gravcal import catalog

MEASURED = commands.MEASURED / "grace-2014-01-15"
COUNT = 2
CALIBRATION = load("ranging")


def run(folder, discovery=False):
    """Document of a folder."""
    return commands.run("ranging", folder, discovery)[0]


def simulated(folder, seed, effects=None):
    """True phase centres, mm, off the mean pointing by 3 mm, of an invented day with star cameras as measured."""
    settings = {"phase_step_s": 1.0, "phase_centre_scatter_mm": 3.0}
    truth = CALIBRATION.simulate(folder, seed=seed, effects=effects or {}, settings=settings)
    return np.concatenate([truth["phase_centre_mm"][letter] for letter in "CD"])


@pytest.mark.long
def test_errors_are_those_of_the_reported_sigma(tmp_path):
    """Recovery: y and z of two days, 8 errors; sum of squares in its interval, 0.02 %, and x is null.

    With x held, noise of the star cameras alone gives other vectors, off by 3 mm with errors of 0.4.
    """
    seed, errors, trapped = seeds.seed("ranging", 2e-4), [], []
    for k in range(COUNT):
        truth = simulated(tmp_path / f"{k}", seed + k)
        document = run(tmp_path / f"{k}")
        found = list(document["parameters"].values())
        assert [one is None for one in found] == [True, False, False] * 2
        errors += [(one["value"] - true) / one["sigma"] for one, true in zip(found, truth, strict=True) if one]
        assert document["status"] == "delivered", seed
        source, _, _, equations, rows = ranging.records(tmp_path / f"{k}")
        held, sigma, _ = ranging.trap(rows, equations, ranging.held_mm(source.satellite))
        trapped += list((held - truth[[1, 2, 4, 5]]) / sigma)
    assert np.sum(np.square(trapped)) > 10 * len(trapped), seed
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], len(errors))
    assert low < np.sum(np.square(errors)) < high, seed


@pytest.mark.long
def test_a_hidden_wave_is_named_and_taken_out(tmp_path):
    """Recovery: 8 mm with the argument of latitude, named alone with its size, beside noise of the star cameras."""
    simulated(tmp_path, seeds.seed("ranging_wave", 1e-4), {"ranging.once_per_revolution.sine": 8e-3})
    commands.shortened(tmp_path, 18)
    found = run(tmp_path, discovery=True)["findings"]
    assert any("attitude.star_camera_noise" in (one["cause"], *one["tied_with"]) for one in found)
    (wave,) = [one for one in found if one["cause"] == "ranging.once_per_revolution" and not one["tied_with"]]
    sine = wave["parameters"]["sine"]
    assert abs(sine["value"] - 8e-3) < 4 * sine["sigma"] < 1e-3


@pytest.mark.parametrize(("late", "named"), [("KBR1B Y", ["ranging.delay"]), ("GNI1B D", ["timing.orbit_delay"])])
def test_records_shifted_against_each_other_name_no_cause_but_timing(tmp_path, late, named):
    """Recovery: tags 137 s late in eight hours: the record is named, and the delay within its error."""
    CALIBRATION.simulate(tmp_path, seed=seeds.seed("ranging_late", 1e-4), settings={"phase_step_s": 1.0})
    commands.shortened(tmp_path, 8, late, 137)
    assert run(tmp_path)["status"] == "questionable"
    found = run(tmp_path, discovery=True)["findings"]
    assert [one["cause"] for one in found if one["cause"] != "unknown:excess"] == named  # what no shift of tags leaves
    delay = found[0]["parameters"]["delay"]
    assert abs(delay["value"] - 137) < 2 * delay["sigma"] < 6


@pytest.mark.measured
def test_the_measured_day_holds_the_phase_centres_of_the_catalogue_and_of_the_correction_what_is_motion():
    """Contract: y and z within 2 sigma of the sequence-of-events vectors, sigma of millimetres; x is null.

    Of the correction all shows in the range at 5 to 10 mHz, little at 10 to 20, none above, as the spectra expect.
    """
    document = run(MEASURED)
    assert document["status"] == "delivered"
    assert (document["event"], document["origin"]) == ("grace-ab-2014-01-15", "measured")
    known = np.concatenate([catalog.satellite(letter).com_to_antenna.value for letter in "AB"]) * 1e3
    for (name, one), expected in zip(document["parameters"].items(), known, strict=True):
        assert (one is None) == name.startswith("x")
        assert one is None or (abs(one["value"] - expected) < 2 * one["sigma"] and one["sigma"] < 3)
    _, slow, middle, *fast = document["share"]
    assert slow["value"] == pytest.approx(1.0, abs=2 * slow["sigma"])
    assert slow["sigma"] < 0.2
    for one in (slow, middle, *fast[:2]):
        assert abs(one["value"] - one["expected"]) < 3 * one["sigma"]
    assert all(abs(one["value"]) < 0.2 for one in fast)
    last = fast[1]["range_um"]  # 40 to 80 mHz: the correction as measured makes the range worse
    assert last["smoothed"] < 0.96 * last["as_measured"]


@pytest.mark.long
@pytest.mark.measured
def test_discovery_on_the_measured_day_names_noise_of_the_star_cameras():
    """Contract: first of all and alone, nothing of the correction at 5 to 10 mHz, all above 20."""
    noise, *others = run(MEASURED, discovery=True)["findings"]
    assert (noise["cause"], noise["tied_with"], noise["adopted"]) == ("attitude.star_camera_noise", [], True)
    share = {name: one["value"] for name, one in noise["parameters"].items()}
    assert abs(share["share_5_10_mhz"]) < 0.4 < 0.9 < share["share_20_40_mhz"] < 1.2
    assert share["share_40_80_mhz"] == pytest.approx(1.0, abs=0.1)
    assert {one["cause"] for one in others} <= {"ranging.thermal", "ranging.once_per_revolution", "unknown:excess"}
    assert noise["heldout_gain"]["chi2"] > 1000
