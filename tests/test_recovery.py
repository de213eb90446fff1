"""Invented truth in, estimate out: a small study in memory, and events of the second simulator through the flow."""

import com_offset_chain as tools
import commands
import numpy as np
import pytest
import seeds
from independent import make_event
from scipy import stats

from gravcal import catalog
from gravcal.calibrations.com_offset.estimate import combine

COUNT = 12
LEVEL = 2.5e-4  # chance that a correct code fails one of the four tests of the study
VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")
pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def study():
    """Errors over sigma (n, 4, 3) and consistency of events with inertia and dipole as in the catalogue."""
    seed, rows, chi2, dof, between = seeds.seed("study", 1e-3), [], 0.0, 0, []
    for k in range(COUNT):
        observed, truth = tools.event(seed + k)
        made = tools.chain(observed)
        combined = made["combine"]
        rows.append(tools.errors(combined, truth)[0])
        chi2, dof = chi2 + combined["chi2"].values, dof + combined["dof"].values
        free = [one.isel(mode_index=[]) if name == "acc" else one for name, one in made["solve"].items()]
        alone = combine(*free, **catalog.parameters("com_offset").for_stage("combine"))
        between.append([float(alone["variants_chi2"]), int(alone["variants_dof"])])
    return {"seed": seed, "errors": np.array(rows), "chi2": chi2, "dof": dof, "between": np.array(between)}


def test_errors_scatter_as_their_sigma_says_without_bias(study):
    """Recovery: seven manoeuvres leave nothing open; errors over sigma are those of chance.

    Sum of (error/sigma)^2 per variant and axis in its chi-square interval, level shared by twelve; mean within its
    interval plus the 0.2 sigma that the contract allows.
    """
    said = f"GRAVCAL_TEST_SEED={study['seed']}"
    assert np.isfinite(study["errors"]).all(), said
    low, high = stats.chi2.interval(1 - LEVEL / 24, COUNT)
    total = np.sum(study["errors"] ** 2, axis=0)
    assert ((low < total) & (total < high)).all(), f"{said}: {total}"
    mean = np.abs(study["errors"].mean(axis=0))
    assert np.all(mean < 0.2 + stats.norm.ppf(1 - LEVEL / 48) / np.sqrt(COUNT)), f"{said}: {mean}"


def test_manoeuvres_and_measured_angular_accelerations_of_one_event_agree(study):
    """Recovery: chi-square of the manoeuvres over all events; true divisors lie at the centre of their prior.

    The three modes of a prior are then fitted to noise, which takes up to three degrees of freedom an event. Of acc
    against sca is without the prior; 3 degrees of freedom an event.
    """
    for name, chi2, dof in zip(VARIANTS, study["chi2"], study["dof"], strict=True):
        fitted = 3 * COUNT if name != "sca" else 0
        low, high = stats.chi2.ppf(LEVEL / 8, dof - fitted), stats.chi2.ppf(1 - LEVEL / 8, dof)
        assert low < chi2 < high, f"{name}, GRAVCAL_TEST_SEED={study['seed']}"
    chi2, dof = study["between"].sum(axis=0)
    low, high = stats.chi2.interval(1 - LEVEL, dof)
    assert low < chi2 < high, f"GRAVCAL_TEST_SEED={study['seed']}"
    assert dof == 3 * COUNT


def check(document, truth, limit=5.0):
    """Every determined component of every variant within `limit` total sigma of the truth; how many there are."""
    count = 0
    for name, variant in document["variants"].items():
        for axis in range(3):
            if variant["offset_um"][axis] is None:
                continue
            wrong = variant["offset_um"][axis] - truth["offset_um"][axis]
            assert abs(wrong) < limit * variant["sigma_total_um"][axis], f"{name} {'xyz'[axis]}, seed {truth['seed']}"
            count += 1
    return count


SMALL = {"manoeuvres": [("pitch", "high"), ("roll", "high"), ("yaw", "low")], "field_generation": 14}
CASES = {
    "late accelerometer, flips": {"effects": {"acc_delay_s": 0.8, "sca_delay_s": -0.3}, "sca_flips": 30},
    "late star camera, satellite D": {
        "effects": {"acc_delay_s": -0.25, "sca_delay_s": 0.3},
        "satellite": "D",
        "date": "2018-06-06",
    },
    "another inertia, control on": {"inertia": (118.0, 560.0, 690.0), "control": "on", "control_phase_s": 0.2},
    "other field, edges on samples": {"field_generation": 13, "start_fraction": 0.0833},
}


@pytest.mark.parametrize("case", sorted(CASES))
def test_events_of_the_second_simulator_come_back(tmp_path, case):
    """Recovery: random offset to 0.5 mm; every variant within five sigma of the truth, in total error; delays too."""
    seed = seeds.seed("events of the second simulator", 1e-4)
    offset = tuple(np.random.default_rng(seed).uniform(-500, 500, 3))
    truth = make_event(tmp_path / "files", seed, offset_um=offset, **(SMALL | CASES[case]))
    document, _ = commands.run("com_offset", tmp_path / "files")
    assert document["status"] == "delivered"
    assert sorted(m["kind"] for m in document["manoeuvres"]) == ["pitch", "roll", "yaw"]
    assert check(document, truth) >= 12, f"seed {seed}"
    # both delays within five sigma, positive where tags are late; a uniform posterior has a half width of 1.7 sigma
    delays, effects = document["delays_s"], CASES[case].get("effects", {})
    true = {name: effects.get(f"{name}_delay_s", 0.0) for name in ("acc", "sca")}
    for name, found in delays.items():
        assert abs(found["value"] - true[name]) < max(5 * found["sigma"], 0.1), f"{name}, seed {seed}"
        assert found["sigma"] < 0.2
    assert abs((delays["acc"]["value"] - delays["sca"]["value"]) - (true["acc"] - true["sca"])) < 0.3, f"seed {seed}"
