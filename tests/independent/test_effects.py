"""Hidden effects and faults of the second simulator."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from . import EFFECTS, catalogue, make_event
from .conftest import EXACT, SHORT, table


@pytest.mark.parametrize(("name", "product", "delay"), [("acc_delay_s", "ACC1A", 0.7), ("mag_delay_s", "MAG1B", 3.0)])
def test_a_positive_delay_makes_tags_late(tmp_path, name, product, delay):
    """Contract: with tags late by dt the first edge shows dt later in the file."""
    truth = make_event(tmp_path, 4, effects={name: delay}, **EXACT)
    rows, world = table(truth, product), truth["scenes"][0].world
    time = rows[:, 0] - world.day + rows[:, 1] * 1e-6
    time = world.clocks.to_gps(time) if product == "ACC1A" else time
    signal = rows[:, 9] if product == "ACC1A" else rows[:, 7] + rows[:, 10]
    first = time[np.flatnonzero(np.abs(np.diff(signal)) > 0.2 * np.ptp(signal))[0] + 1]
    late = first - world.manoeuvres[0].start
    assert delay - 1e-6 <= late <= delay + (0.11 if product == "ACC1A" else 0.51)


def test_star_camera_delay_is_a_shift_of_the_attitude(tmp_path, exact):
    """Contract: with tags late by 2 s a row holds the quaternion that belongs two rows earlier."""
    late = table(make_event(tmp_path, 11, effects={"sca_delay_s": 2.0}, **EXACT), "SCA1B")
    right = table(exact, "SCA1B")
    _, a, b = np.intersect1d(late[:, 0], right[:, 0] + 2, return_indices=True)
    assert len(a) > 200
    assert_allclose(late[a, 3:7], right[b, 3:7], atol=1e-9)  # grids differ


def test_an_effect_does_not_move_the_noise(tmp_path, event):
    """Contract: with an effect switched on the readings change by the effect alone."""
    leak = {"acc_current_leak": {"xz": 1e-9, "yx": 2e-11}}
    changed = make_event(tmp_path, 11, effects=leak, **SHORT)
    difference = table(changed, "ACC1A")[:, 6] - table(event, "ACC1A")[:, 6]
    scene = event["scenes"][0]
    current = np.abs(scene.current[:, 0]).max()
    assert np.abs(difference).max() == pytest.approx(2e-11 * current, rel=0.1)


AMPLITUDE = {"s": 0.3, "1": 0.05, "A m2": 0.5, "m s-2": 1e-8, "nT/mA": 5.0, "kg m2": 3.0}
AMPLITUDE |= {"m": 1e-3}


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_every_effect_changes_what_it_should(tmp_path, exact, name):
    """Contract: each effect changes the files, and by no more than a sane amount."""
    effect = EFFECTS[name]
    size = AMPLITUDE.get(effect.unit, 1e-10)
    value = size * (1 - np.eye(3)) if effect.shape == "matrix" else size
    truth = make_event(tmp_path, 11, effects={name: value}, **EXACT)
    files = [[Path(one["files"][p]).read_bytes() for p in ("ACC1A", "SCA1B", "MAG1B")] for one in (truth, exact)]
    assert files[0] != files[1]
    assert np.isfinite(table(truth, "ACC1A")[:, 6:12]).all()
    assert np.abs(truth["scenes"][0].pointing).max() < 0.1


def test_a_wrong_effect_or_setting_is_refused(tmp_path):
    """Contract: typing errors do not pass for clean data."""
    for wrong in ({"acc_dely_s": 0.1}, {"acc_tone": {"value": 1e-9, "frequency": 0.1}}):
        with pytest.raises(ValueError, match="known|settings"):
            catalogue.parse(wrong)
    with pytest.raises(TypeError):
        make_event(tmp_path, 1, noise=0.0)
