"""Effects hidden in simulated ranging: every one of the family can be injected, and adds what its law says."""

import numpy as np
import pytest

from gravcal import catalog
from gravcal.effects.ranging import EFFECTS
from gravcal.simulation import kbr_phase_centre as simulation

DAY = 653011200.0 - 43200.0
SIZE = {
    "ranging.antenna_correction": {"share": 1.0},
    "attitude.star_camera_noise": {"share_5_10_mhz": 100.0},
    "ranging.phase_centre": {"x_a": 1e-3},
    "ranging.star_camera_misalignment": {"pitch_a": 1e-3},
    "ranging.once_per_revolution": {"sine": 1e-3},
    "ranging.thermal": {"swing": 1e-4},
    "ranging.slow_orbit_error": {"cosine": 1e-3},
    "ranging.phase_centre_drift": {"x_a": 1e-8},
    "ranging.phase_centre_curvature": {"pitch_a": 1e-3},
}


def ranges(effects):
    """Biased range of a simulated day, and truth."""
    chosen = catalog.parameters("simulate_kbr_phase_centre").with_settings({"phase_step_s": 1.0, "noise": "benign"})
    columns, truth = simulation.simulate("CD", chosen, DAY, 3, effects)
    return columns["KBR1B", "Y"]["biased_range"], truth


@pytest.fixture(scope="module")
def plain():
    """The day without effect."""
    return ranges({})


@pytest.mark.parametrize("slug", sorted(SIZE))
def test_an_effect_changes_the_range_by_what_it_is(plain, slug):
    """Analytic: antenna correction 2.89 m, an arm longer by 1 mm, waves of 1 mm, warmth from 0 to 1, a day, 3 deg."""
    before, truth = plain
    added = ranges({slug: SIZE[slug]})[0] - before
    if slug == "ranging.antenna_correction":
        arms = sum(truth["phase_centre_mm"][letter][0] for letter in "CD") / 1e3
        assert np.median(added) == pytest.approx(-arms, abs=2e-3)
    if slug == "ranging.phase_centre":
        assert np.median(added) == pytest.approx(-1e-3, abs=1e-5)
    if slug == "ranging.phase_centre_drift":
        assert np.ptp(added) == pytest.approx(8.64e-4, rel=1e-3)
    if slug == "ranging.phase_centre_curvature":
        assert added.max() == pytest.approx(1e-3 * np.radians(3) ** 2, rel=0.1)  # and the motion of the control loop
    if slug in ("ranging.once_per_revolution", "ranging.slow_orbit_error"):
        assert np.std(added) == pytest.approx(1e-3 / np.sqrt(2), rel=0.05)
    if slug == "ranging.thermal":
        assert 0 <= added.min() < added.max() <= 1.01e-4
    assert np.ptp(added) > 0


def test_every_effect_of_the_family_is_asked_here_or_elsewhere():
    """Contract: no effect of ranging is listed that a simulation cannot hide."""
    known = {"ranging.multipath", "ranging.phase_break", "ranging.delay", "ranging.scale"}
    assert {entry.slug for entry in EFFECTS} == known | set(SIZE)
