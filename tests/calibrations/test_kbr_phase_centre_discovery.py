"""What discovery sees of a ranging campaign."""

import numpy as np
import pytest
from kbr_campaign import DAY, NOMINAL, process, simulated, true_mm
from scipy.stats import chi2

from gravcal import catalog
from gravcal.calibrations.align import LATE_S, QUATERNION, late_of_pair
from gravcal.calibrations.kbr_phase_centre import noise
from gravcal.calibrations.kbr_phase_centre.observations import Ranging, observe
from gravcal.discovery import attribution, driver
from gravcal.discovery.problem import baseline_of, inverse_of, prepare
from gravcal.estimation.quantities import result_of
from gravcal.estimation.records import Entry, Parameter
from tasks import kbr_phase_centre as stages

MEASURED = (("noise", "measured"),)
GIVEN = {"nominal_m": NOMINAL, "given": ()}
#: Only the first satellite turns: x of the second is all but a bias.
ONE = (("manoeuvres", "+pitch_a,,,-pitch_a,+yaw_a,,,-yaw_a"), ("amplitude_deg", 0.5))


def without(columns, own):
    """Columns less their part along own ones, in 80 bits and twice, own ones made orthonormal one by one."""
    columns, basis = np.asarray(columns, np.longdouble), []
    for column in np.asarray(own, np.longdouble).T:
        for _ in range(3):
            for done in basis:
                column = column - done * (done @ column)
        basis.append(column / np.sqrt(column @ column))
    for _ in range(3):
        for done in basis:
            columns = columns - np.outer(done, done @ columns)
    return columns


def seen(columns):
    """Observations of a campaign."""
    products, parameters = process(columns, names=("range",)), catalog.parameters("kbr_phase_centre")
    names = ("orbit_degree", "crn_window_s", "crn_bandwidth_hz", "band_hz")
    given = {name: parameters.entries[name].value for name in names} | {"of_noise": parameters.for_stage("noise")}
    given |= {"of_observable": parameters.for_stage("observable")}
    given |= {"of_pointing": parameters.for_stage("pointing") | GIVEN}
    parts = (products.aligned, products.pointed, products.equations[0], products.noise, products.solved[0])
    named = dict(zip(("align", "pointing", "observable", "noise", "solve"), parts, strict=True))
    return observe(named, nominal_m=NOMINAL, plausible_mm=(100.0, 5.0, 5.0), **given)


def best(observed):
    """Candidate of the largest gain less what its parameters cost."""
    problem = prepare(observed.blocks, observed.candidates)
    gram = attribution.projected(problem.total, baseline_of(problem, ()))
    gains = [attribution.gained(gram, place, problem.size) for place in problem.places]
    return observed.candidates[int(np.argmax([gain - 2 * dof for gain, dof, _ in gains]))]


def test_a_late_star_camera_of_one_satellite_is_a_delay_of_that_one():
    """Recovery: attitudes of B tagged 20 ms late: a delay of B alone, not of both."""
    columns = dict(simulated(7)[0])
    time, late = columns["SCA1B", "D"]["gps_time"], dict(columns["SCA1B", "D"])
    quaternion = np.stack([late[name] for name in QUATERNION], axis=1)
    quaternion = quaternion - 0.02 * np.gradient(quaternion, time, axis=0)
    columns["SCA1B", "D"] = late | dict(zip(QUATERNION, quaternion.T, strict=True))
    found = best(observed := seen(columns))
    assert (found.cause, found.form) == ("timing.star_camera_delay", "b alone")
    records = observed.view.records  # a phase break is taken out of the range; near it no reading is left, nor moved
    at = float(records["time_kbr"].values[records.sizes["time_kbr"] // 2])
    size = {"size": Parameter(1e-5, None, "m"), "time": Parameter(at, None, "s")}
    back = observed.without([Entry("ranging.phase_break", "", size)])
    kept = back["time_kbr"].values[20:-20]  # where the filter is whole
    assert 36 < np.abs(kept - at).min() < 45
    moved = [(back[n] - records[n]).sel(time_kbr=kept).values for n in ("reading_range", "reading_range_rate")]
    assert np.allclose(moved, [np.where(kept > at, -1e-5, 0.0), 0 * kept], atol=1e-9)
    (broken,) = observed.view.breaks(np.array([at]))  # in a second search it stands in the rows as in the first
    ripple = next(one for one in observed.candidates if one.cause == "ranging.multipath")
    sizes = {name: Parameter(1e-5, None, "m") for name in ripple.names}
    sizes["period"] = Parameter(ripple.shape.value[0], None, "rad")
    for whole, known in ((broken, size), (ripple, sizes)):
        rows = observed.response(Entry(whole.cause.partition("@")[0], "", known))
        for row, part in ((r, p) for r, p in zip(rows, whole.columns, strict=True) if p is not None):
            np.testing.assert_allclose(row, 1e-5 * part.sum(axis=1), atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize(
    ("late", "cause"),
    [("SCA1BC", "timing.star_camera_delay"), ("KBR1B", "ranging.delay"), ("GNI1BD", "timing.orbit_delay")],
)
def test_records_shifted_against_each_other_name_no_cause_but_timing(late, cause):
    """Recovery: tags 137 s late: the delay within 4 sigma, which are below a second or two, and noise is left.

    Star cameras as measured: their noise in the turning of the satellites would hide four fifths of a second.
    """
    columns = {key: dict(one) for key, one in simulated(7, MEASURED)[0].items()}
    for key in (one for one in columns if "".join(one).startswith(late)):
        columns[key]["gps_time"] = columns[key]["gps_time"] + 137
    observed = seen(columns)
    told = result_of(driver.discover(observed, driver.Limits(0.005, 9.0, 4, 1800.0, 1)))
    (one,) = told["findings"]
    assert (one["cause"], one["tied_with"], told["adequate_after"]) == (cause, [], True)
    delay = Parameter(**one["parameters"]["delay"])
    assert abs(delay.value - 137) < 4 * delay.sigma < (3 if "orbit" in cause else 1)
    back = observed.without([Entry(cause, one["form"], {"delay": delay})])
    pointed = stages.pointing(back, **catalog.parameters("kbr_phase_centre").for_stage("pointing"), **GIVEN)
    assert np.all(np.abs(late_of_pair(back, pointed)) < LATE_S)


@pytest.mark.long
@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="long doubles have no more digits here")
def test_x_of_a_satellite_that_does_not_turn_keeps_its_information():
    """Independent evaluation: local columns taken off in 80 bits; the part of x that is no bias is 1e-8 of it."""
    observed = seen(simulated(7, ONE)[0])
    found = prepare(observed.blocks, []).total
    assert observed.view.column[:, 3].std() < 1e-6
    clean = [without(np.column_stack([b.observed, b.global_columns]), b.local_columns) for b in observed.blocks]
    expected = sum(one.T @ one for one in clean).astype(float)
    scale = np.sqrt(np.diag(expected))
    assert found / np.outer(scale, scale) == pytest.approx(expected / np.outer(scale, scale), abs=1e-6)
    view, nothing = observed.view, np.zeros((observed.view.residual.size, 0))
    free = [np.column_stack([half.slow, view.column[half.rows]]) for half in view.parts]  # and no candidate beside it
    left = [(view.residual[h.rows], own, nothing[h.rows]) for h, own in zip(view.parts, free, strict=True)]
    assert np.all(noise.with_restricted(view.measured, view.parts, left)["pointing_power"].values >= 0)


@pytest.mark.long
def test_a_phase_centre_that_moves_is_given_at_the_middle_of_the_wiggles():
    """Recovery: y of A moves by 2e-8 m/s; beside the drift the calibration has its place at the stated epoch."""
    drift = "ranging.phase_centre_drift"
    columns, truth = simulated(7, effects=((drift, (("y_a", 2e-8),)),))
    observed = seen(columns)
    problem = prepare(observed.blocks, observed.candidates)
    moving = next(k for k, one in enumerate(problem.candidates) if (one.cause, one.names) == (drift, ["y_a"]))
    fixed = baseline_of(problem, [moving])
    inverse = inverse_of(problem.total[np.ix_(fixed, fixed)])
    found = observed.start[1] + (inverse @ problem.total[fixed, 0])[1]
    wiggles = [(one["start"] + one["stop"]) / 2 for one in truth["manoeuvres"]]
    assert observed.epoch == pytest.approx(np.mean(wiggles), abs=30)  # the slews
    moved = 2e-8 * (np.mean(wiggles) - DAY - 43200)  # noon is the epoch of the simulator
    assert found == pytest.approx(1e-3 * true_mm(truth)[1] + moved, abs=5 * np.sqrt(inverse[1, 1]))
    assert abs(moved) > 10 * np.sqrt(inverse[1, 1])


@pytest.mark.long
def test_noise_of_star_cameras_in_the_columns_is_no_effect():
    """Recovery: noise as measured: rows without colour at high frequency, nothing gains what chance does not."""
    observed = seen(simulated(7, (("noise", "measured"),))[0])
    assert observed.view.measured.attrs["smoothed_hz"] == 0.012
    own = [np.linalg.qr(block.local_columns)[0] for block in observed.blocks[:-1]]  # the last is known beforehand
    rest = [block.observed - q @ (q.T @ block.observed) for block, q in zip(observed.blocks, own, strict=False)]
    power = np.mean([np.mean(np.abs(np.fft.rfft(r)[r.size // 5 :]) ** 2) / r.size for r in rest])
    assert power == pytest.approx(1, abs=0.1)  # 2,500 waves; 0.6 with noise in the columns of quiet data
    problem = prepare(observed.blocks, observed.candidates)
    gram = attribution.projected(problem.total, baseline_of(problem, ()))
    gains = [attribution.gained(gram, place, problem.size)[:2] for place in problem.places]
    chance = [chi2.sf(gain, dof) for gain, dof in gains if dof]
    assert min(chance) * len(chance) > 1e-3


def test_a_phase_break_alone_is_searched_once():
    """Contract: it has no second order, and with readings about it left out a break of S/N 16 had no name."""
    alone, both = [("ranging.phase_break", 246.0)], [("ranging.phase_break", 246.0), ("ranging.delay", 90.0)]
    assert [Ranging.worth_another(None, gains, True) for gains in ([], alone, both)] == [False, False, True]


def test_a_break_that_came_after_the_filter_is_one_break():
    """Recovery: 6 um in the filtered range, half way between epochs of the search; one name, within 4 sigma."""
    columns = dict(simulated(7)[0])
    record, wiggle = columns["KBR1B", "Y"], seen(columns).view.parts[4]
    at = wiggle.time[0] + 60.0 + 30.0 * (wiggle.time.size * 5 // 60) + 15.0
    columns["KBR1B", "Y"] = record | {"biased_range": record["biased_range"] + 6e-6 * (record["gps_time"] > at)}
    (found,) = result_of(driver.discover(seen(columns), driver.Limits(0.005, 9.0, 8, 30.0, 1)))["findings"]
    assert found["cause"] == "ranging.phase_break"
    size = found["parameters"]["size"]
    assert abs(size["value"] - 6e-6) < 4 * size["sigma"] < 2e-6
