"""Effects hidden in Level-1 files by the second simulator; the code under test sees files only."""

import commands
import numpy as np
import pytest
from commands import causes
from independent import make_event
from seeds import ALARM, MISSED, clean, enough

RNG_LEVEL = 2 * ALARM + 3 * MISSED  # of all its draws, see seeds.py

#: One manoeuvre of each kind in place of the seven of a session: sizes are larger by the root of 7/3.
THREE = [("pitch", "high"), ("roll", "high"), ("yaw", "low")]
#: Slug, and what the second simulator calls it; at twice the signal-to-noise ratio of the study or more.
LISTED = {
    "current leak": ("accelerometer.current_leak", {"acc_current_leak": {"yx": 6.1e-12}}),
    "magnetometer scale": ("magnetometer.scale", {"mag_scale": {"x": 0.015}}),
    "magnetometer leak": ("magnetometer.current_leak", {"mag_current_leak": {"yz": 0.15}}),
    # also turns the field that the attitude predicts
    "late star camera": ("timing.star_camera_delay", {"sca_delay_s": 0.3}),
    "tone": ("accelerometer.stray_tone", {"acc_tone": {"value": {"y": 4.6e-10}, "frequency_hz": 0.21}}),
}
#: In no list: what the second simulator calls it, and the driver channel that has to be named.
UNLISTED = {
    "warming": ({"odd_current_squared": {"value": {"y": 2.3e-13}, "lag_s": 2.0}}, "torquer_current"),
    # within the manoeuvres a drift takes up all but a thousandth of it
    "slow warming": ({"odd_current_squared": {"value": {"z": 2.3e-13}, "lag_s": 40.0}}, "torquer_current"),
    "spikes": ({"odd_edge_spike": {"value": {"y": 1.2e-8}, "decay_s": 0.7, "signed": False}}, "torquer_current"),
}


def discovered(folder, seed, effects, *options, **settings):
    """Document of `gravcal discover` on the files of an event, whose headers say nothing of their origin."""
    make_event(folder / "level1", seed, effects=effects, manoeuvres=THREE, window_s=(420.0, 420.0), **settings)
    return commands.discovered("com_offset", folder, *options, origin="measured")


@pytest.mark.parametrize("apart", [0.0, pytest.param(0.35, marks=pytest.mark.long)])
def test_nothing_is_named_on_clean_data(rng, tmp_path, apart):
    """Recovery: at the delivered level, also of amplitudes a third apart in each manoeuvre (three excesses once)."""
    clean(lambda seed, at: discovered(at, seed, {}, noise_change=apart), rng, tmp_path, adequate=apart > 0)


@pytest.mark.long
def test_a_hidden_effect_is_named(rng, tmp_path):
    """Recovery: one of five effects; alone or in its tied set, with a gain on data left out, less left than before."""

    def draw(seed, folder):
        name = list(LISTED)[rng.integers(len(LISTED))]
        slug, effects = LISTED[name]
        whole = discovered(folder, seed, effects)
        found = whole["findings"]
        good = [slug in (f["cause"], *f["tied_with"]) for f in found] == [True] and not whole["adequate_before"]
        good = good and found[0]["heldout_gain"]["chi2"] > 0 and whole["p_after"] > whole["p_before"]
        return None if good else f"{name}, seed {seed}: {causes(whole)}"

    enough(draw, rng, tmp_path)


def test_a_lag_of_the_rods_is_named_alone_with_its_size(rng, tmp_path):
    """Recovery: 0.08 to 0.4 s behind edges that are free; within four sigma."""

    def draw(seed, folder):
        tau = float(np.exp(rng.uniform(np.log(0.08), np.log(0.4))))
        found = discovered(folder, seed, {"torque_lag_s": tau})
        good = causes(found) == ["torque.dipole_lag"]
        size = found["findings"][0]["parameters"].get("tau") if good else None
        good = good and abs(size["value"] - tau) < 4 * size["sigma"] < 0.3 * tau
        return None if good else f"lag {tau:.3f} s, seed {seed}: {causes(found)}, {size}"

    enough(draw, rng, tmp_path)


@pytest.mark.long
def test_an_effect_in_no_list_follows_its_driver(rng, tmp_path):
    """Recovery: one of three; noticed, not given a catalogue name, its driver named first."""

    def draw(seed, folder):
        name = list(UNLISTED)[rng.integers(len(UNLISTED))]
        effects, driver = UNLISTED[name]
        first = next(iter(causes(discovered(folder, seed, effects))), "nothing")
        return None if first.startswith("unknown:") and driver in first else f"{name}, seed {seed}: {first}"

    enough(draw, rng, tmp_path)
