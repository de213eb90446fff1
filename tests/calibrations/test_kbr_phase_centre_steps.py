"""The steps before the solution: records on a grid, wiggles, equations, noise."""

import numpy as np
import pytest
from kbr_campaign import campaign, process, simulated
from numpy.testing import assert_allclose

from gravcal.calibrations.kbr_phase_centre import align, model, noise
from gravcal.calibrations.kbr_phase_centre.model import arcs
from gravcal.errors import EstimationError
from gravcal.simulation import kbr_phase_centre as simulation


def test_samples_off_the_grid_are_interpolated_and_gaps_stay_open():
    """Analytic: a wave of 250 s every 5 s comes back at whole seconds to 1e-9 of its size; a gap does not."""
    time = np.arange(0.0, 1000.0, 5.0)
    kept = (time < 400) | (time > 460)
    wave = lambda t: np.column_stack([np.sin(2 * np.pi * t / 250), t])  # noqa: E731
    at = np.arange(50.0, 950.0)
    found = align.interpolated(time[kept], wave(time[kept]), at, 10.0)
    missing = (at > 395) & (at < 465)
    assert np.isnan(found[missing]).all()
    near = (at > 300) & (at < 560) & ~missing  # ends of a stretch: the spline has one side only
    assert_allclose(found[~missing & ~near], wave(at[~missing & ~near]), atol=1e-9)
    assert_allclose(found[near], wave(at[near]), atol=1e-6)


def test_a_step_of_the_range_and_a_long_gap_begin_a_segment():
    """Analytic: 1 mm against the rate is seen, the curvature of an orbit is not; nor is a gap of 20 s."""
    time = np.delete(np.arange(0.0, 1000.0, 5.0), [*range(60, 63), *range(120, 140)])
    w = 2.2e-3  # rad s-1, twice per revolution
    values = [1e3 * np.sin(w * time), 1e3 * w * np.cos(w * time), -1e3 * w**2 * np.sin(w * time)]
    values[0] = values[0] + np.where(time > 200, 1e-3, 0.0)
    begins = align.breaks(time, *values, 1e-4)
    assert time[begins].tolist() == [205.0, 700.0]


def test_wiggles_are_found_with_sign_slews_and_size():
    """Recovery: all eight of the campaign, starts and stops within 10 s, angles within 0.1 deg."""
    _, products = campaign()
    truth, pointed = simulated()[1], products.pointed
    letters = [pointed.attrs["satellites"][k] for k in pointed["satellite_index"].values]
    axes = [("pitch", "yaw")[k] for k in pointed["axis_index"].values]
    kinds = [("+" if s > 0 else "-") + a for s, a in zip(pointed["sign"].values, axes, strict=True)]
    assert list(zip(letters, kinds, strict=True)) == [(m["satellite"], m["kind"]) for m in truth["manoeuvres"]]
    for name in ("start", "stop"):
        assert_allclose(pointed[name].values, [m[name] for m in truth["manoeuvres"]], atol=10)
    assert_allclose(np.degrees(pointed["amplitude"].values), 1.0, atol=0.02)
    assert_allclose(np.abs(np.degrees(pointed["offset"].values)), 2.0, atol=0.15)  # mean pointing 0.03 deg, drawn


@pytest.mark.parametrize("amplitude", [1.0, 1.5, 1.7])
def test_wiggles_of_grace_are_found_too(amplitude):
    """Recovery: amplitudes of 1.5 and 1.7 deg about 2 deg come close to zero; the wiggle stays one."""
    time = np.arange(0.0, 8000.0)
    inside = (time >= 2000) & (time < 5750)
    angle = np.where(inside, -2 - amplitude * np.sin(2 * np.pi * (time - 2000) / 250), 0.02 * np.sin(time / 300))
    found = model.wiggles(time, np.radians(angle), 1, 0, 250.0, *np.radians([0.5, 0.4]))
    assert len(found) == 1
    assert (found[0].satellite_index, found[0].axis_index, found[0].sign) == (1, 0, -1)
    assert_allclose([found[0].start, found[0].stop], [2000, 5750], atol=60)  # a quarter of a period


def test_routine_pointing_has_no_wiggle():
    """Analytic: milliradians of slow motion are none, nor is a record shorter than three periods."""
    time = np.arange(0.0, 8000.0)
    angle = 2e-3 * np.sin(2 * np.pi * time / 250) + 1e-3 * np.sin(time / 900)
    assert model.wiggles(time, angle, 0, 0, 250.0, *np.radians([0.5, 0.4])) == []
    assert model.wiggles(time[:500], angle[:500], 0, 0, 250.0, *np.radians([0.5, 0.4])) == []


def test_a_manoeuvre_of_the_catalogue_is_measured():
    """Analytic: given times and sign stay, offset and amplitude are those of the angle."""
    time = np.arange(0.0, 6000.0)
    angle = np.zeros((2, 6000, 2))
    angle[1, :, 0] = np.radians(2 + np.sin(2 * np.pi * time / 250))
    found = model.measured(time, angle, 1, 0, 1, 1000.0, 4750.0, 250.0)
    assert found == model.Wiggle(1, 0, 1, 1000.0, 4750.0, found.offset, found.amplitude)
    assert_allclose(np.degrees([found.offset, found.amplitude]), [2, 1], rtol=1e-3)


def test_quiet_data_keep_their_distance():
    """Analytic: inside the trimmed span 0, beyond the margin -1, between them -2."""
    time = np.array([0.0, 69.0, 71.0, 99.0, 151.0, 180.0, 249.0, 251.0, 331.0])
    found = arcs(time, np.array([[100.0, 230.0]]), 50.0, 30.0)
    assert found.tolist() == [-1, -1, -2, -2, 0, 0, -2, -2, -1]


def test_star_camera_noise_is_measured_from_the_wiggles():
    """Recovery: density at 4 mHz as simulated, 20 urad/sqrt(Hz), within 30 % (excess of 8 arcs over the ranging)."""
    _, products = campaign()
    shape = 1 / (1 + (4e-3 / noise.CORNERS) ** 2)
    found = np.sqrt(products.noise["pointing_power"].values @ shape)
    keep = np.exp(-0.1)
    slow = 2 * (3e-6) ** 2 * (1 - keep**2) / (1 + keep**2 - 2 * keep * np.cos(2 * np.pi * 4e-3))
    assert_allclose(found, np.sqrt(slow + 2 * (1.5e-6) ** 2), rtol=0.3)


def test_covariance_is_that_of_drawn_noise():
    """Recovery: pointing noise times a lever, differentiated by the CRN filter; 600 draws, elements within 6 sigma."""
    from gravcal.estimation import crn

    rng, step = np.random.default_rng(5), 5.0
    fine = np.arange(0.0, 400.0)
    lever = 0.05 + 0.025 * np.sin(2 * np.pi * fine / 250)
    at = np.arange(100.0, 300.0, step)
    error = 1e-5 * rng.standard_normal((400, 600))
    through = [crn.operator(crn.Crn(), d, np.ones(400, bool), (0.0, 1.0), at) for d in range(3)]
    drawn = through[2](lever[:, None] * error)
    arms = np.stack([through[d](lever) for d in range(3)], axis=1)[:, :, None] * np.array([1.0, 0, 0, 0])
    grid = np.zeros(noise.BINS + 1)
    density = 2 * 1e-10 * noise.passed(step)
    lags = noise.lags_of_densities(grid, density, step, 2, 60)
    found = noise.covariance_matrix(lags, np.arange(at.size), arms)
    sampled = np.cov(drawn)
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    lower = np.tril_indices(at.size)
    assert np.abs((found - sampled) / scale)[lower].max() < 6 * np.sqrt(2 / 600)


def test_slow_columns_hold_a_bias_for_every_further_segment():
    """Analytic: polynomials of degree 3 and one step for the range, none for its rate."""
    time, segment = np.arange(10.0), np.repeat([4, 6], 5)
    assert noise.slow_columns(time, segment, 3, 0).shape == (10, 5)
    assert noise.slow_columns(time, segment, 3, 1).shape == (10, 4)


def test_noise_comes_from_the_wiggles_where_there_is_no_quiet():
    """Contract: the source is said, and the result stays near."""
    columns, _ = simulated()
    products = process(columns, quiet_minimum_s=86400)
    assert products.noise.attrs["source_data"] == "manoeuvres"
    assert np.all(products.noise["pointing_power"].values == 0)


def test_files_of_different_days_are_refused():
    """Contract: the message says how much they share and what to do."""
    columns, _ = simulated()
    moved = {**columns, ("SCA1B", "D"): columns["SCA1B", "D"] | {"gps_time": columns["SCA1B", "D"]["gps_time"] + 86400}}
    with pytest.raises(EstimationError, match="share 0 s, expected at least 600 s.*one pair and one day"):
        process(moved)


def test_a_file_without_a_usable_record_is_named():
    """Contract: all attitudes flagged: the file and the number of records are said."""
    observed = simulation.ingested(simulated()[0])
    camera = observed["SCA1B", "C"]
    observed["SCA1B", "C"] = camera.assign(quatangle=camera["quatangle"] * np.nan)
    names = [("KBR1B", "Y"), ("GNI1B", "C"), ("GNI1B", "D"), ("SCA1B", "C"), ("SCA1B", "D")]
    with pytest.raises(EstimationError, match="SCA1B of C: found 0 usable records"):
        align.align(*(observed[n] for n in names), gap_limit_s=10.0, break_limit_m=1e-4)
