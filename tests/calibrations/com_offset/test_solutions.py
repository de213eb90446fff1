"""Offsets of single manoeuvres and their combination: what is not determined, how sizes scale, what agrees."""

import com_offset_chain as tools
import numpy as np
import pytest
import seeds
import xarray as xr
from numpy.testing import assert_allclose
from scipy import stats

from gravcal import catalog
from gravcal.calibrations.com_offset.estimate import combine, noise, quiet
from gravcal.calibrations.com_offset.manoeuvre import at_one_hertz
from gravcal.physics.sensing import offset_tensor
from gravcal.simulation.sensors import table_density

KINDS = {0: "roll", 1: "pitch", 2: "yaw"}


@pytest.fixture(scope="module")
def made():
    """Products of an event with one manoeuvre of each kind, at a seed of its own in every run."""
    seed = seeds.seed("made", 1e-6)
    observed, truth = tools.event(seed, manoeuvres=("pitch_high", "roll_high", "yaw_low"), manoeuvre_spacing_s=1500.0)
    return tools.chain(observed), truth | {"seed": seed}


def test_a_lost_record_of_the_magnetometer_makes_no_other_value_late():
    """Analytic: each second's value stands twice, the second copy half a second late, whatever was lost before."""
    time, value = np.delete(0.5 * np.arange(120.0), 41), np.delete(np.repeat(np.arange(60.0), 2), 41)
    field = {name: (("time_mag", "axis"), value[:, None] * np.ones(3)) for name in ("measured_b", "difference_b")}
    field |= {"used": ("time_mag", np.ones(time.size))}
    at, difference, _ = at_one_hertz(xr.Dataset(field, {"time_mag": time}), -1.0, 60.0)
    assert_allclose(difference[:, 0], at)


def test_each_manoeuvre_determines_what_it_turns_and_quiet_noise_is_that_of_the_simulation(made):
    """Analytic: pitch gives x, roll y, yaw y, what has no lever no value; density at 0.2-0.6 Hz to a quarter."""
    combined = made[0]["combine"]
    seen = {KINDS[int(k)]: d for k, d in zip(combined["kind"], combined["manoeuvre_determined"].values[0], strict=True)}
    assert seen["pitch"].tolist()[:2] == [1, 0]
    assert seen["roll"].tolist() == [0, 1, 1]
    assert seen["yaw"][1] == 1
    assert combined["determined"].values.all()
    measured, chosen = made[0]["noise"], catalog.parameters("simulate_com_offset")
    frequency = measured["frequency"].values
    band = (frequency > 0.2) & (frequency < 0.6)
    for axis, letter in enumerate("xyz"):
        table = getattr(chosen, f"linear_noise_{letter}")
        expected = table_density(chosen.noise_frequency_hz, np.array(table))(frequency[band])
        ratio = np.mean(measured["density"].values[axis, band] / expected)
        assert ratio == pytest.approx(1.0, abs=0.25)  # the operator weakens the upper end


def test_the_offset_follows_the_reading_and_no_bias_or_trend(made):
    """Analytic: a reading larger by the model of an offset moves the torquer's estimate by it, drift does not."""
    made, _ = made
    smoothed, aligned = made["attitude"], made["align"]
    time = aligned["time_acc"].values
    drift = 1e-5 * np.array([1.0, -2.0, 0.5]) + 1e-12 * (time - time[0])[:, None] * np.array([1.0, 1.0, -1.0])
    added = np.array([3e-5, -2e-5, 5e-5])
    tensor = offset_tensor(*(smoothed[n].values for n in ("rate_b", "rate_dot_mtq_b", "gradient_b")))
    linear = aligned["linear_b"].values.copy()
    linear[np.searchsorted(time, smoothed["time_acc"].values)] -= tensor @ added
    moved, drifting = (
        aligned.assign(linear_b=(("time_acc", "axis"), v)) for v in (linear, aligned["linear_b"].values + drift)
    )
    others = (smoothed, made["angular_acceleration"]["mtq"], made["noise"], catalog.parameters("com_offset"))
    one, other, same = (tools.solution(a, *others) for a in (aligned, moved, drifting))
    assert_allclose(other["right"].values - one["right"].values, np.matvec(one["normal"].values, added), rtol=1e-6)
    assert_allclose(one["information"].values, other["information"].values, rtol=1e-9)
    size = np.abs(one["right"].values).max()
    assert_allclose(same["right"].values, one["right"].values, atol=1e-6 * size)  # rounding of the bias


def test_noise_that_is_louder_at_one_manoeuvre_weakens_it(made):
    """Analytic: quiet data 1.5 times as large near the second manoeuvre: its equations weigh (1 / 1.5)^2 of before."""
    products, chosen = made[0], catalog.parameters("com_offset")
    pieces = quiet(products["align"], **chosen.for_stage("quiet"))
    there = pieces["near"].values[np.maximum(pieces["piece"].values, 0)] == 1
    louder = pieces.assign(reading=pieces["reading"] * np.where(there, 1.5, 1.0)[:, None])
    both = [noise(one, **chosen.for_stage("noise")) for one in (pieces, louder)]
    assert_allclose(both[0]["level"], 1.0, atol=0.1)
    level = both[1]["level"].values
    assert_allclose(level[1] / level[[0, 2]], 1.5, rtol=0.1)
    about = products["align"], products["attitude"], products["angular_acceleration"]["mtq"]
    weight = [np.trace(tools.solution(*about, one, chosen)["information"].values, 0, 1, 2) for one in both]
    ratio = weight[1] / weight[0]
    assert_allclose(ratio[1] / ratio[[0, 2]], 1 / 1.5**2, rtol=0.2)


def solved(variant, offsets, information, shift=None):
    """Dataset like that of solve, from direct estimates."""
    count, modes = len(offsets), 0 if shift is None else shift.shape[1]
    shift = np.zeros((count, 0, 3)) if shift is None else shift
    values = {
        "offset": (("manoeuvre", "axis"), offsets),
        "right": (("manoeuvre", "axis"), np.matvec(information, offsets)),
        "normal": (("manoeuvre", "axis", "axis_2"), information),
        "information": (("manoeuvre", "axis", "axis_2"), information),
        "mode_shift": (("manoeuvre", "mode_index", "axis"), shift),
        "mode_shared": ("mode_index", np.ones(modes)),
        "mode_catalogue": ("mode_index", np.ones(modes)),
        "chi2": ("manoeuvre", np.ones(count)),
        "dof": ("manoeuvre", np.ones(count, dtype=int)),
        "kind": ("manoeuvre", np.arange(count) % 3),
        "start": ("manoeuvre", 1.0 * np.arange(count)),
        "stop": ("manoeuvre", 1.0 * np.arange(count)),
        "latitude": ("manoeuvre", np.zeros(count)),
    }
    return xr.Dataset(values, attrs={"variant": variant})


def four(make):
    """Combination of the four variants made from one."""
    products = [make(v) for v in ("mtq", "acc_calibrated", "acc", "sca")]
    settings = catalog.parameters("com_offset").with_settings({"drag_sigma_m_s2": 0.0}).for_stage("combine")
    return combine(*products, **settings)


def test_the_combination_is_the_mean_weighted_with_full_matrices():
    """Analytic: the dense weighted mean, catalogue errors in the total alone; ten sigma in one of three; nothing."""
    rng = np.random.default_rng(1)
    A = rng.standard_normal((3, 20, 3)) * 1e5
    information, offsets = np.swapaxes(A, 1, 2) @ A, 1e-5 * rng.standard_normal((3, 3))
    shift = np.broadcast_to(np.array([[[2e-6, 0, 0], [0, 1e-6, 0]]]), (3, 2, 3)).copy()
    combined = four(lambda v: solved(v, offsets, information, shift))
    total = np.linalg.inv(information.sum(axis=0))
    expected = total @ np.matvec(information, offsets).sum(axis=0)
    assert_allclose(combined["offset"].values[0], expected, rtol=1e-4)  # prior of mm
    assert_allclose(combined["covariance"].values[0], total, rtol=1e-4, atol=1e-16)
    assert_allclose(combined["covariance_total"].values[0], total + np.diag([4e-12, 1e-12, 0]), rtol=1e-4, atol=1e-16)
    moved = np.array([[0.0, 0, 0], [1e-5, 0, 0], [0, 0, 0]])
    combined = four(lambda v: solved(v, moved, np.broadcast_to(np.eye(3) * 1e12, (3, 3, 3))))
    assert float(combined["chi2"][0]) == pytest.approx(100 * 2 / 3)
    assert stats.chi2.sf(float(combined["chi2"][0]), int(combined["dof"][0])) < 1e-9
    combined = four(lambda v: solved(v, np.full((2, 3), np.nan), np.zeros((2, 3, 3))))  # blocks without samples
    assert np.isnan(combined["offset"].values).all()
    assert not combined["determined"].values.any()


def drawn(rng, information, own):
    """Estimates of five manoeuvres: mtq and acc with the same noise, sca with errors of its own added."""
    shared = np.matvec(np.linalg.cholesky(np.linalg.inv(information)), rng.standard_normal((5, 3)))
    mine = shared + np.einsum("ikp,ik->ip", own, rng.standard_normal(own.shape[:2]))
    return {"mtq": shared, "acc_calibrated": shared, "acc": shared, "sca": mine}


def test_agreement_of_measured_variants_is_a_chi_square():
    """Recovery: 150 draws, acc and sca share noise, sca has errors of its own; p uniform (Kolmogorov-Smirnov, 1e-4)."""
    rng, found = seeds.generator("test_agreement_of_measured_variants_is_a_chi_square", 1e-4), []
    A = rng.standard_normal((5, 20, 3)) * 1e5
    information = np.swapaxes(A, 1, 2) @ A
    own, zero = 4e-6 * rng.standard_normal((5, 6, 3)), ("mode_index", np.zeros(6))
    own_modes = lambda one: one.assign(mode_shared=zero, mode_catalogue=zero)  # noqa: E731 - of single manoeuvres
    for _ in range(150):
        offsets = drawn(rng, information, own)
        combined = four(lambda v, o=offsets: own_modes(solved(v, o[v], information, own * (v == "sca"))))
        found.append(stats.chi2.sf(float(combined["variants_chi2"]), int(combined["variants_dof"])))
    assert stats.kstest(found, "uniform").pvalue > 1e-4
    assert int(combined["variants_dof"]) == 3


def test_an_error_of_the_catalogue_is_seen_by_its_own_test_alone():
    """Analytic: mtq and acc_calibrated off by 3 and by 30 prior sigma along x; acc and sca agree all the same."""
    information = np.broadcast_to(np.eye(3) * 1e16, (3, 3, 3))
    mode = np.broadcast_to(np.array([[1e-5, 0.0, 0.0]]), (3, 1, 3))

    def make(variant, by):
        held = variant in ("mtq", "acc_calibrated")
        return solved(variant, np.array([[by * held, 0.0, 0.0]] * 3), information, mode if held else None)

    some, much = (four(lambda v, b=b: make(v, b)) for b in (3e-5, 3e-4))
    for combined in (some, much):
        assert float(combined["variants_chi2"]) == pytest.approx(0.0, abs=1e-9)
    assert float(some["catalogue_chi2"]) == pytest.approx(9.0, rel=1e-3)
    assert float(much["catalogue_chi2"]) == pytest.approx(900.0, rel=1e-3)


def test_published_processing_shows_its_small_errors():
    """Published: erratum C-12, formal errors of filtered samples counted as independent are several times too small."""
    observed, _ = tools.event(43, manoeuvres=("pitch_high", "roll_high"))
    ours, printed = tools.chain(observed)["combine"], tools.chain(observed, method="published")["combine"]
    assert np.sqrt(ours["covariance"].values[0, 0, 0] / printed["covariance"].values[0, 0, 0]) > 2
