"""Simulated days: what each effect of com_offset and of ranging changes, and what is refused.

Signs, clocks and edges are right where the truth comes back by estimators that the second simulator judges.
"""

import json

import numpy as np
import pytest

from flows.calibration import known, load
from gravcal import catalog
from gravcal.effects import catalogue, effect
from gravcal.effects.ranging import EFFECTS
from gravcal.errors import CatalogError
from gravcal.simulation import kbr_phase_centre as simulation
from gravcal.simulation.com_offset import simulate

DAY = 633787200.0  # GPS s, 2020-02-01 12:00:00 before the epoch of a day file; any midnight will do
LINEAR = {f"ACC1A.lin_accl_{a}" for a in "xyz"}
ANGULAR = {f"ACC1A.ang_accl_{a}" for a in "xyz"}
ATTITUDE = {f"SCA1B.{q}" for q in ("quatangle", "quaticoeff", "quatjcoeff", "quatkcoeff")}
FIELD = {f"MAG1B.Mfv{a}_RAW" for a in "XYZ"}
CURRENT = {f"MAG1B.torque{i}{s}" for i in (1, 2, 3) for s in "AB"}
#: What an effect of a channel may change, and what it has to change.
TOUCHES = {
    "linear_b": (LINEAR, LINEAR),
    "angular_b": (ANGULAR, ANGULAR),
    "pointing_b": (ATTITUDE, ATTITUDE),
    "field_b": (FIELD, FIELD),
    "acc_delay": (LINEAR | ANGULAR, LINEAR | ANGULAR),
    "sca_delay": (ATTITUDE, ATTITUDE),
    "mag_delay": (FIELD | CURRENT, FIELD),
    "dipole_b": (LINEAR | ANGULAR | ATTITUDE | FIELD | CURRENT, ATTITUDE),
    "torque_b": (LINEAR | ANGULAR | ATTITUDE | FIELD | CURRENT, ATTITUDE),
}
OTHERS = ("inertial_sensor.", "gradient.", "accelerometer.offset")
SLUGS = sorted(s for s, e in catalogue().items() if e.channel in TOUCHES and not s.startswith(OTHERS))


def event(seed=5, effects=None, **settings):
    """Columns and truth of a small event, one pitch manoeuvre with a minute on either side."""
    chosen = {"manoeuvres": ("pitch_high",), "quiet_s": 60.0} | settings
    parameters = catalog.parameters("simulate_com_offset").with_settings(chosen)
    return simulate(catalog.satellite("C").settings(), parameters, DAY, seed, effects or {})


@pytest.fixture(scope="module")
def plain():
    """The event without effect."""
    return event()


def flat(columns):
    """Columns by "product.column"."""
    return {f"{p}.{n}": v for p, part in columns.items() for n, v in part.items()}


def strengths(slug, start):
    """Values that show: three priors; times inside the manoeuvre, a limit below the full scale."""
    given = {p.name: 3 * p.prior_sigma for p in effect(slug).parameters}
    return given | ({"time": start + 50.0} if "time" in given else {}) | ({"limit": 20.0} if "limit" in given else {})


def differs(one, other, rounding):
    """Not the same; with rounding, more than a reading here and there that went to the next step."""
    if one.shape != other.shape or not rounding:
        return not np.array_equal(one, other)
    return bool(np.abs(other.astype(float) - one).mean() > 1e-3 * np.ptp(one))


@pytest.mark.parametrize("slug", SLUGS)
def test_an_effect_changes_the_channel_it_claims_and_no_other(plain, slug):
    """Contract: all other columns stay bit by bit; beside a delay, which moves integration steps, but for rounding."""
    columns, truth = plain
    start = truth["manoeuvres"][0]["start"]
    changed, told = event(effects={slug: strengths(slug, start)})
    before, after = flat(columns), flat(changed)
    may, must = TOUCHES[effect(slug).channel]
    moved = {n for n in before if differs(before[n], after[n], n not in must and slug.startswith("timing"))}
    assert moved <= may
    assert moved & must
    assert told["effects"][slug] == strengths(slug, start)
    assert all(np.isfinite(v).all() for v in after.values())


def test_the_same_seed_gives_the_same_columns_and_another_seed_another_truth(plain):
    """Contract: everything random comes from the seed."""
    again, other = event(), event(seed=6)
    assert all(np.array_equal(v, flat(again[0])[n]) for n, v in flat(plain[0]).items())
    assert json.loads(json.dumps(plain[1])) == again[1]
    assert not np.allclose(plain[1]["offset_um"], other[1]["offset_um"])


def test_an_unknown_effect_is_refused_and_every_one_of_ranging_is_asked_here_or_elsewhere():
    """Contract: a typing error does not give clean data; no effect is listed that a simulation cannot hide."""
    from gravcal.simulation import by_slug

    for wrong in ({"torque.dipole_gian.rod_x": 0.1}, {"torque.dipole_gain.rod_q": 0.1}, {"dipole_gain": 1.0}):
        with pytest.raises(CatalogError):
            by_slug(wrong)
    known = {"ranging.multipath", "ranging.phase_break", "ranging.delay", "ranging.scale"}
    assert {entry.slug for entry in EFFECTS} == known | set(ASKED)


@pytest.mark.parametrize("name", known())
def test_an_effect_of_another_instrument_is_refused(name, tmp_path):
    """Contract: in every simulation; nothing is left out without a word, and nothing is written."""
    foreign = "ranging.delay.delay" if name == "thrusters" else "timing.thruster_delay.delay"
    with pytest.raises(CatalogError, match="no channel for it"):
        load(name).simulate(tmp_path, seed=1, effects={foreign: 1e-3})
    assert not any(tmp_path.iterdir())


MIDNIGHT = 653011200.0 - 43200.0
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
    columns, truth = simulation.simulate("CD", chosen, MIDNIGHT, 3, effects)
    return columns["KBR1B", "Y"]["biased_range"], truth


@pytest.fixture(scope="module")
def unhidden():
    """The day without effect."""
    return ranges({})


@pytest.mark.parametrize("slug", sorted(ASKED))
def test_an_effect_changes_the_range_by_what_it_is(unhidden, slug):
    """Analytic: antenna correction 2.89 m, an arm longer by 1 mm, waves of 1 mm, warmth from 0 to 1, a day, 3 deg."""
    before, truth = unhidden
    hidden, statistic, expected, tolerance = ASKED[slug]
    added = ranges({slug: hidden})[0] - before
    assert np.ptp(added) > 0
    if statistic:
        arms = sum(truth["phase_centre_mm"][letter][0] for letter in "CD") / 1e3
        assert statistic(added) == pytest.approx(expected(arms), abs=tolerance)
