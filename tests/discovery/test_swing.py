"""Effects hidden in the files of a swing of an inertial sensor; the code under test sees files only."""

import json

import numpy as np
import pytest
import seeds
from draws import document_of, enough
from typer.testing import CliRunner

from flows import cli, inertial_sensor
from gravcal.store.schemas import validate

#: A time within the swing of the simulated day, s GPS.
MIDDLE = 706111700.0
#: At a signal-to-noise ratio of about 20, twice that of the study.
LISTED = {
    "accelerometer.bias_step": {"z": 2e-8, "time": MIDDLE + 3.0},
    "accelerometer.stray_tone": {"z": 6e-9, "frequency": 0.27, "phase": 1.0},
}


@pytest.fixture(scope="module")
def rng():
    """Generator of this module, the same in every run unless GRAVCAL_TEST_SEED says otherwise."""
    return seeds.generator("test_swing")


def discovered(folder, seed, effects, *options, manoeuvre="swing"):
    """Exit code and document of `gravcal discover` on the files of a simulated event."""
    flat = {f"{slug}.{name}": value for slug, given in effects.items() for name, value in given.items()}
    target, settings = folder / "document.json", {"manoeuvre": manoeuvre}
    inertial_sensor.CALIBRATION.simulate(
        folder / "level1", seed=seed, truth=folder / "truth.json", effects=flat, settings=settings
    )
    arguments = ["discover", "inertial_sensor", "--data", str(folder / "level1"), "--engine", "inline"]
    result = CliRunner().invoke(cli.app, [*arguments, "--json", str(target), *options])
    document = document_of(result, target)
    validate(document, "discovery")
    assert document["origin"] == "simulated"
    return result.exit_code, document


def test_nothing_is_named_on_a_clean_swing(rng, tmp_path):
    """Recovery: one swing at a chance of false names of two in ten thousand, and a probability that is not tiny."""
    seed = int(rng.integers(1_000_000))
    code, document = discovered(tmp_path, seed, {}, "--set", "discovery_level=0.0002")
    assert code == 0
    assert document["findings"] == [], seed
    assert document["p_before"] > 1e-4, seed
    hidden = {one["cause"] for one in document["indistinguishable_from_calibration"]}
    assert {"timing.accelerometer_delay", "timing.star_camera_delay", "accelerometer.angular_leak"} <= hidden


@pytest.mark.parametrize("slug", sorted(LISTED))
def test_a_hidden_effect_is_named_with_its_size(rng, tmp_path, slug):
    """Recovery: one effect, alone or in its tied set; its parameters within 5 sigma."""

    def draw(seed, folder):
        code, document = discovered(folder, seed, {slug: LISTED[slug]})
        assert code == 0
        found = document["findings"]
        good = [slug in (f["cause"], *f["tied_with"]) for f in found] == [True] and found[0]["heldout_gain"]["chi2"] > 0
        known = found[0]["parameters"] if good and found[0]["cause"] == slug else {}
        far = [
            n
            for n in set(LISTED[slug]) & set(known)
            if abs(known[n]["value"] - LISTED[slug][n]) > 5 * known[n]["sigma"]
        ]
        return None if good and not far else f"seed {seed}: {[f['cause'] for f in found]}, {far}"

    good, wrong = enough(draw, rng, tmp_path)
    assert good, wrong


def test_a_record_without_swing_has_nothing_to_discover(rng, tmp_path):
    """Contract: exit code 3, status no_manoeuvre."""
    code, document = discovered(tmp_path, int(rng.integers(1_000_000)), {}, manoeuvre="none")
    assert (code, document["status"]) == (3, "no_manoeuvre")


def calibrated(folder, *options, part="swing"):
    """Part of the document of `gravcal run` on the files of a simulated event."""
    target = folder / "run.json"
    arguments = ["run", "inertial_sensor", "--data", str(folder / "level1"), "--engine", "inline"]
    result = CliRunner().invoke(cli.app, [*arguments, "--json", str(target), *map(str, options)])
    document = document_of(result, target)
    assert result.exit_code in (0, 4), result.output  # a hidden effect makes it questionable until it is taken out
    return document[part]


def extended(folder):
    """Options of a run with the model that was found last."""
    return "--model", max((folder / "products").rglob("model.toml"), key=lambda path: path.stat().st_mtime)


def test_the_model_of_a_step_brings_the_offset_back(rng, tmp_path, monkeypatch):
    """Recovery: a step of 60 and 40 nm s-2 moves the offset by several sigma; its model leaves it within four."""
    step = {"accelerometer.bias_step": {"z": 6e-8, "y": 4e-8, "time": MIDDLE + 3.4}}

    def draw(seed, folder):
        monkeypatch.setenv("GRAVCAL_PRODUCTS", str(folder / "products"))
        code, document = discovered(folder, seed, step)
        assert code == 0
        named = [f["cause"] for f in document["findings"]]
        if named != ["accelerometer.bias_step"]:
            return f"seed {seed}: {named}"
        true, error = np.array(json.loads((folder / "truth.json").read_text())["com_to_test_mass_um"]), []
        for options in ((), extended(folder)):
            found = calibrated(folder, *options)["com_to_test_mass_um"]
            error.append((np.array(found["value"]) - true) / found["sigma_total"])
        good = np.linalg.norm(error[1]) < np.linalg.norm(error[0]) and np.abs(error[1]).max() < 4
        return None if good else f"seed {seed}: {error}"

    good, wrong = enough(draw, rng, tmp_path)
    assert good, wrong


def test_a_turned_tracker_is_turned_back(rng, tmp_path, monkeypatch):
    """Recovery: 50 mrad about z; the factors with the model agree with the truth, and nothing is left to name."""

    def draw(seed, folder):
        monkeypatch.setenv("GRAVCAL_PRODUCTS", str(folder / "products"))
        code, document = discovered(folder, seed, {"inertial_sensor.tracker_misalignment": {"angle_z": 0.05}})
        assert code == 0
        named = [f["cause"] for f in document["findings"]]
        if named != ["inertial_sensor.tracker_misalignment"]:
            return f"seed {seed}: {named}"
        angle, beta = document["findings"][0]["parameters"]["angle_z"], calibrated(folder, *extended(folder))["beta"]
        true = json.loads((folder / "truth.json").read_text())["beta"]
        error = [(beta[a]["value"] - value) / beta[a]["sigma"] for a, value in zip("xyz", true, strict=True)]
        error.append((angle["value"] - 0.05) / angle["sigma"])
        return None if np.abs(error).max() < 5 else f"seed {seed}: {error}"

    good, wrong = enough(draw, rng, tmp_path)
    assert good, wrong
