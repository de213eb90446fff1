"""Effects hidden in the files of a roll of an inertial sensor, alone and beside a swing; files only are seen."""

import netCDF4
import numpy as np
import pytest
import seeds
from draws import enough
from test_swing import calibrated, discovered, extended

#: Begin of a roll without a swing the day before, s GPS; eleven segments take 27500 s.
BEGIN = 706104000.0
BIAS = "inertial_sensor.bias/product.nc"


@pytest.fixture(scope="module")
def rng():
    """Generator of this module, the same in every run unless GRAVCAL_TEST_SEED says otherwise."""
    return seeds.generator("test_roll")


def far(finding, hidden):
    """Parameters of a finding that are more than five sigma from what was hidden."""
    known = finding["parameters"]
    return [n for n in set(hidden) & set(known) if abs(known[n]["value"] - hidden[n]) > 5 * known[n]["sigma"]]


def test_nothing_is_named_in_a_clean_roll(rng, tmp_path):
    """Recovery: one roll at a chance of false names of two in ten thousand, and a probability that is not tiny."""
    seed = int(rng.integers(1_000_000))
    code, document = discovered(tmp_path, seed, {}, "--set", "discovery_level=0.0002", manoeuvre="roll")
    assert code == 0
    assert document["findings"] == [], seed
    assert document["p_before"] > 1e-4, seed
    assert document["calibration_change"]["names"][:3] == ["bias_x", "bias_y", "bias_z"]
    hidden = {one["cause"] for one in document["indistinguishable_from_calibration"]}
    assert "inertial_sensor.quadratic" in hidden  # a constant voltage squared is a bias


@pytest.mark.parametrize("slug", ["accelerometer.bias_step", "accelerometer.stray_tone"])
def test_an_effect_hidden_in_a_roll_is_named_with_its_size(rng, tmp_path, slug):
    """Recovery: a step of 10 nm s-2 in one segment or a tone of 1 nm s-2 in all, named alone, within 5 sigma."""

    def draw(seed, folder):
        own = np.random.default_rng(seed)
        step = {"z": 1e-8, "time": BEGIN + 2500.0 * own.integers(1, 10) + own.uniform(600, 1900)}
        tone = {"z": 1e-9, "frequency": own.uniform(0.012, 0.03)}
        given = step if slug == "accelerometer.bias_step" else tone
        _, document = discovered(folder, seed, {slug: given}, manoeuvre="roll")
        found = document["findings"]
        if [f["cause"] for f in found] != [slug] or found[0]["heldout_gain"]["chi2"] <= 0:
            return f"seed {seed}: {[f['cause'] for f in found]}"
        wrong = far(found[0], given)
        return f"seed {seed}: {wrong} of {given}" if wrong else None

    good, wrong = enough(draw, rng, tmp_path)
    assert good, wrong


def test_a_drift_beside_a_swing_is_told_from_wander_and_taken_out(rng, tmp_path, monkeypatch):
    """Recovery: 1e-12 m s-3 alone is named; with its model the segments scatter less than a quarter of before."""
    hidden = {"inertial_sensor.bias_drift": {"z": 1e-12}}

    def draw(seed, folder):
        monkeypatch.setenv("GRAVCAL_PRODUCTS", str(folder / "products"))
        _, document = discovered(folder, seed, hidden, manoeuvre="both")
        found = document["findings"]
        if [f["cause"] for f in found] != ["inertial_sensor.bias_drift"]:
            return f"seed {seed}: {[f['cause'] for f in found]}"
        (folder / "model.toml").write_bytes(extended(folder)[1].read_bytes())
        scatter = []
        for options in ((), ("--model", folder / "model.toml")):
            monkeypatch.setenv("GRAVCAL_PRODUCTS", str(folder / f"run-{len(options)}"))
            calibrated(folder, *options)
            with netCDF4.Dataset(next((folder / f"run-{len(options)}" / "latest").rglob(BIAS))) as made:
                scatter.append(float(np.std(made["segment_bias"][:][:, 2])))
        wrong = far(found[0], hidden["inertial_sensor.bias_drift"])
        return f"seed {seed}: {wrong}, {scatter}" if wrong or scatter[1] > scatter[0] / 4 else None

    good, wrong = enough(draw, rng, tmp_path)
    assert good, wrong


def test_the_model_of_a_step_brings_the_bias_back(rng, tmp_path, monkeypatch):
    """Recovery: a step of 30 nm s-2 in mid roll moves the bias by half of it; with its model by less than a tenth."""

    def draw(seed, folder):
        step = {"accelerometer.bias_step": {"z": 3e-8, "time": BEGIN + 5 * 2500.0 + 1300.0}}
        _, document = discovered(folder, seed, step, manoeuvre="roll")
        named = [f["cause"] for f in document["findings"]]
        if named != ["accelerometer.bias_step"]:
            return f"seed {seed}: {named}"
        bias = [calibrated(folder, *options, part="roll")["bias"]["value"][2] for options in ((), extended(tmp_path))]
        (folder / "clean").mkdir()
        discovered(folder / "clean", seed, {}, manoeuvre="roll")
        error = np.array(bias) - calibrated(folder / "clean", part="roll")["bias"]["value"][2]
        return None if abs(error[0]) > 1e-8 and abs(error[1]) < 0.1 * abs(error[0]) else f"seed {seed}: {error}"

    monkeypatch.setenv("GRAVCAL_PRODUCTS", str(tmp_path / "products"))
    good, wrong = enough(draw, rng, tmp_path)
    assert good, wrong
