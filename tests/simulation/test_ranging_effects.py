"""Effects hidden in simulated ranging: every one of the family can be injected, and adds what its law says."""

import numpy as np
import pytest

from gravcal import catalog
from gravcal.effects.ranging import EFFECTS
from gravcal.simulation import kbr_phase_centre as simulation

DAY = 653011200.0 - 43200.0
#: What is hidden, a statistic of what it adds, and its value with a tolerance; the arms are of the truth.
ASKED = {
    "ranging.antenna_correction": ({"share": 1.0}, np.median, lambda arms: -arms, 2e-3),
    "attitude.star_camera_noise": ({"share_5_10_mhz": 100.0}, None, None, None),
    "ranging.phase_centre": ({"x_a": 1e-3}, np.median, lambda _: -1e-3, 1e-5),
    "ranging.star_camera_misalignment": ({"pitch_a": 1e-3}, None, None, None),
    "ranging.once_per_revolution": ({"sine": 1e-3}, np.std, lambda _: 1e-3 / np.sqrt(2), 3.5e-5),
    "ranging.thermal": ({"swing": 1e-4}, np.max, lambda _: 1e-4, 1e-6),
    "ranging.slow_orbit_error": ({"cosine": 1e-3}, np.std, lambda _: 1e-3 / np.sqrt(2), 3.5e-5),
    "ranging.phase_centre_drift": ({"x_a": 1e-8}, np.ptp, lambda _: 8.64e-4, 8.64e-7),
    "ranging.phase_centre_curvature": ({"pitch_a": 1e-3}, np.max, lambda _: 1e-3 * np.radians(3) ** 2, 2.7e-7),
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


@pytest.mark.parametrize("slug", sorted(ASKED))
def test_an_effect_changes_the_range_by_what_it_is(plain, slug):
    """Analytic: antenna correction 2.89 m, an arm longer by 1 mm, waves of 1 mm, warmth from 0 to 1, a day, 3 deg."""
    before, truth = plain
    hidden, statistic, expected, tolerance = ASKED[slug]
    added = ranges({slug: hidden})[0] - before
    assert np.ptp(added) > 0
    if statistic:
        arms = sum(truth["phase_centre_mm"][letter][0] for letter in "CD") / 1e3
        assert statistic(added) == pytest.approx(expected(arms), abs=tolerance)


def test_every_effect_of_the_family_is_asked_here_or_elsewhere():
    """Contract: no effect of ranging is listed that a simulation cannot hide."""
    known = {"ranging.multipath", "ranging.phase_break", "ranging.delay", "ranging.scale"}
    assert {entry.slug for entry in EFFECTS} == known | set(ASKED)
