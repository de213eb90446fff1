"""Records less the effects of a model; lag of the rods beside edges that are free, and edge times."""

from dataclasses import replace
from itertools import pairwise

import com_offset_chain as tools
import numpy as np
import pytest
import xarray as xr
from scipy.integrate import quad, solve_ivp

from gravcal.calibrations.com_offset import lag, responses
from gravcal.calibrations.com_offset.observations import observe
from gravcal.effects import torque
from gravcal.estimation.least_squares import project_out
from gravcal.estimation.records import Candidate, Entry, Fitted, Parameter


def test_a_field_that_is_written_twice_is_changed_and_turned_as_one():
    """Analytic: whichever of a pair is looked at, both lose the contribution; records that differ only theirs."""
    rng, time = np.random.default_rng(1), np.arange(12) * 0.5 + 0.083
    values, added = np.repeat(rng.normal(0, 2e-5, (6, 3)), 2, axis=0), rng.normal(0, 1e-8, (6, 3))
    for first, twice in ((0, True), (1, True), (0, False)):
        before = values if twice else values + np.arange(12)[:, None] * 1e-9
        extended = xr.Dataset({"field_measured_b": (("time_mag", "axis"), before.copy())}, {"time_mag": time})
        responses.subtract_field(extended, time[first::2], added)
        expected = np.repeat(added, 2, axis=0) * (twice | (np.arange(12) % 2 == first))[:, None]
        np.testing.assert_allclose(before - extended["field_measured_b"].values, expected, atol=1e-20)
    angle = np.arange(12)[:, None] * np.array([0.0, 0.0, 1e-4])  # grows from record to record
    turned = responses.rotated(angle, values)
    np.testing.assert_array_equal(turned[1::2], turned[::2])
    expected = values[::2] + np.cross(angle[::2], values[::2])
    np.testing.assert_allclose(turned[::2], expected, atol=2e-6 * np.abs(values).max())


TORQUERS = {name: tools.SATELLITE[name] for name in ("inertia", "dipole_per_current")}


def offset_of(made, chosen, aligned):
    """Offset with the torquers from other records."""
    solved = tools.solved(made | {"align": aligned}, chosen, ("mtq",))["solve"]["mtq"]
    return np.linalg.solve(*(np.nansum(solved[name].values, axis=0) for name in ("normal", "right")))


def seen(observed):
    """What discovery sees of ingested records, and the products and parameters behind it."""
    made, chosen = tools.smoothed(observed)
    made = tools.solved(made, chosen, ("mtq",))
    made |= {"solve": made["solve"]["mtq"]}
    settings = TORQUERS | {"mass": float(tools.SATELLITE["mass_at_launch"])}
    for stage in ("attitude", "quiet", "equations", "noise", "solve", "discovery", "combine"):
        settings |= chosen.for_stage(stage)
    return observe(made, **settings), made, chosen


@pytest.fixture(scope="module")
def moving():
    """What is seen of an event of little noise whose offset moves by 180 um in a manoeuvre, and its truth."""
    kinds = {"manoeuvres": ("pitch_high", "roll_high"), "quiet_s": 220.0, "noise_scale": 0.05}
    observed, truth = tools.event(41, {"accelerometer.moving_offset": {"speed_x": 1e-6}}, **kinds)
    return *seen(observed), truth


def test_an_offset_that_moves_is_that_at_the_middle_of_the_manoeuvres_and_a_slow_wave_moves_none(moving):
    """Recovery: with the motion taken out the offset is met to 8 um; at the first edge it is 90 um from there.

    Twelve waves of 1.3e-6 m s-2 in the latitude are seen to a thousandth beside a free drift. A star camera sees
    edges to 0.1 s, in which the field changes by 7 nT: not what the readings follow.
    """
    found, made, chosen, _ = moving
    entry = Entry("accelerometer.moving_offset", "", {"speed_x": Parameter(1e-6, 0.0, "m s-1")})
    offset = offset_of(made, chosen, found.without([entry]))
    np.testing.assert_allclose(1e6 * offset, moving[3]["offset_um"], atol=8.0)
    sizes = {"linear_z_0": Parameter(-1.3e-6, 1e-7, "m s-2"), "cycles": Parameter(12.0, 0.1, "")}
    entry = Entry("unknown:latitude", "linear reading, waves in the latitude, cycles 12", sizes)
    assert 1e-13 < np.abs(responses.contribution(found.views[0], entry)["linear"][:, 2]).max() < 1e-8
    before, after = (offset_of(made, chosen, one) for one in (made["align"], found.without([entry])))
    np.testing.assert_allclose(1e6 * after, 1e6 * before, atol=1.0)
    edges = made["attitude"]["sca_shift"]
    other = observe(made | {"attitude": made["attitude"].assign(sca_shift=edges + 0.1)}, **found.settings)
    for one, two in zip(found.views, other.views, strict=True):
        np.testing.assert_array_equal(one.context.rate_dot_b, two.context.rate_dot_b)


def test_a_body_that_spins_up_is_followed_beyond_the_manoeuvre():
    """Recovery: under 0.7 mN m the linear reading with its pads is at its noise (at 7 times it before)."""
    kinds = {"manoeuvres": ("pitch_high", "roll_high"), "quiet_s": 220.0, "noise_scale": 0.1}
    found, *_ = seen(tools.event(41, {"torque.constant": {"x": 5e-4, "z": -5e-4}}, **kinds)[0])
    for block in found.blocks[:2]:
        rows = project_out(np.column_stack([block.global_columns, block.local_columns]), block.observed)
        linear = rows[block.channel == "linear"]
        assert linear @ linear < 1.1 * linear.size


def test_late_tags_show_in_the_readings_what_their_column_says():
    """Recovery: tags late by 0.3 s add 0.3 of their column to the angular reading of the same noise, within 5 %."""
    slug, kinds = "timing.accelerometer_delay", {"manoeuvres": ("yaw_low",), "quiet_s": 220.0, "noise_scale": 0.02}
    both = [seen(tools.event(41, effects, **kinds)[0])[0] for effects in ({slug: {"delay": 0.3}}, {})]
    views = [found.views[0] for found in both]
    rows, *at = np.intersect1d(*(one.rows for one in views), return_indices=True)
    late, plain = (
        found.aligned["angular_b"].values[rows] - one.context.rate_dot_b[k]
        for found, one, k in zip(both, views, at, strict=True)
    )
    edges = views[1].arc.edges + views[1].acc_shift
    away = np.abs(views[1].time[at[1], None] - edges).min(axis=1) > 0.5  # s
    column = responses.of_delay(views[1], slug)["angular"][at[1], 0, 0]
    slope, _ = np.polyfit(column[away], (late - plain)[away, 0], 1)
    assert slope == pytest.approx(0.3, rel=0.05)


def test_a_step_of_every_manoeuvre_is_in_the_model_as_it_was_in_the_search(moving):
    """Analytic: rows of its entry are the columns that were fitted; a manoeuvre that it does not know has none."""
    found = moving[0]
    first, second = (list(block.steps) for block in found.blocks[:2])
    columns = [block.steps[epochs[9]] for block, epochs in zip(found.blocks[:2], (first, second), strict=True)]
    about = ["x", "y", "z"], ["m s-2"] * 3, [*columns, None]
    candidate = Candidate("accelerometer.bias_step", "every manoeuvre", *about, at=first[9], apart=True)
    sizes = {axis: Parameter(size, 1e-12, "m s-2") for axis, size in zip("xyz", (1e-9, -2e-9, 3e-9), strict=True)}
    entry = Entry(candidate.cause, candidate.form, sizes | {"time": Parameter(first[9], 0.3, "s")})
    entry = found.physical(entry, Fitted(candidate, np.array([1e-9, -2e-9, 3e-9]), np.full(3, 1e-12), [], []))
    for rows, part in zip(found.response(entry), columns, strict=False):
        np.testing.assert_allclose(rows, part @ [1e-9, -2e-9, 3e-9], atol=1e-9)
    assert not found.response(replace(entry, leads=entry.leads[:1]))[1].any()
    moved = found.aligned["linear_b"].values - found.without([entry])["linear_b"].values  # each step stays
    np.testing.assert_allclose(moved[[0, -1]], np.outer([0, len(entry.leads)], [1e-9, -2e-9, 3e-9]), atol=1e-20)
    moved = found.aligned["linear_b"].values - found.without([replace(entry, leads=())])["linear_b"].values
    later = found.aligned["time_acc"].values >= first[9]
    np.testing.assert_allclose(moved, np.outer(later, [1e-9, -2e-9, 3e-9]), atol=1e-20)


RNG_LEVEL = 1e-5  # a mean square of 1000 draws 0.9 +- 0.04 below 1.1
EDGES = np.array([2.0, 8.0, 14.0, 20.0])
DIPOLE = np.array([[0.0, 3.0, 1.0], [0.5, -3.0, 1.0], [0.0, 3.0, 0.0]])


def commanded(t):
    """Dipole at an epoch, zero outside the edges."""
    k = np.searchsorted(EDGES, t, side="right") - 1
    return DIPOLE[k] if 0 <= k < len(DIPOLE) else np.zeros(3)


@pytest.mark.parametrize("tau", [0.05, 0.3, 1.6])
def test_a_lagging_rod_follows_its_equation(tau):
    """Analytic: tau dm/dt = m_commanded - m, integrated between the edges; edges a lead before the fitted ones."""
    lead, time = 0.4 * tau, np.arange(0.05, 25.0, 0.1)
    missing, _ = torque.lag_missing(EDGES, DIPOLE, tau)
    found = torque.lagging(time, EDGES + lead, DIPOLE, missing, tau, np.array([0.0, lead]))[:, :, 1]
    state, begin, expected = np.zeros(3), 0.0, []
    for end in [*EDGES, 26.0]:
        inside = time[(time >= begin) & (time < end)]
        held = commanded((begin + end) / 2)
        run = solve_ivp(lambda _, m: (held - m) / tau, (begin, end), state, dense_output=True, rtol=1e-11, atol=1e-13)  # noqa: B023
        expected += [run.sol(t) for t in inside]
        state, begin = run.y[:, -1], end
    np.testing.assert_allclose(found, expected, atol=1e-8)


@pytest.mark.parametrize("tau", [0.1, 0.8, 9.0])  # the last is longer than edges are apart
def test_twice_integrated_a_lag_is_a_later_edge_and_half_its_square(tau):
    """Analytic: quadrature of (t - s) times lagging less late dipole over s."""
    time = np.array([1.0, 2.3, 2.9, 5.0, 8.05, 9.4, 13.9, 19.0, 24.0])
    found = torque.lag_swing(EDGES, DIPOLE, tau, time, tau)  # edges fitted later by the lag
    missing, _ = torque.lag_missing(EDGES, DIPOLE, tau)

    def weighed(s, t, axis):
        lagging = torque.lagging(np.array([s]), EDGES, DIPOLE, missing, tau, np.zeros(1))[0, axis, 0]
        return (t - s) * (lagging - commanded(s - tau)[axis])

    for t, row in zip(time, found, strict=True):
        ends = sorted([0.0, *(b for e in EDGES for b in (e, e + tau) if b < t), t])
        for axis in range(3):
            assert abs(sum(quad(weighed, a, b, args=(t, axis))[0] for a, b in pairwise(ends)) - row[axis]) < 1e-7


def test_the_part_of_a_sample_that_all_manoeuvres_share_is_in_the_error_of_a_late_star_camera(rng):
    """Commanded a whole number of samples apart, every edge falls on the same part of one; or on a part of its own."""
    sigma = {f"{name}_shift_sigma": ("manoeuvre", np.full(7, size)) for name, size in (("acc", 2e-4), ("sca", 0.012))}
    smoothed = xr.Dataset({"time_acc": np.arange(20) / 10, "acc_shift": ("manoeuvre", np.zeros(7)), **sigma})
    smoothed = smoothed.assign(acc_delay_sigma=0.07)
    column = responses.edge_column("timing.star_camera_delay", smoothed, np.arange(7.0))[:, 0]
    for part in (np.repeat(rng.uniform(-0.05, 0.05, (1000, 1)), 8, axis=1), rng.uniform(-0.05, 0.05, (1000, 8))):
        seen = part + rng.standard_normal((1000, 8)) * np.append(np.full(7, 0.012), 0.07)
        assert np.mean((lag.whitened_edges(smoothed, seen.T).T @ column) ** 2) / (column @ column) < 1.1


def test_an_edge_between_two_samples_is_no_delay_and_a_delay_moves_every_row():
    """Analytic: rows of momentary samples have the spread of their errors, 1 within 15 %; a column is a later tag."""
    rng = np.random.default_rng(3)
    shifts = {"sca_shift": ("arc", rng.normal(0, 0.01, 400)), "acc_shift": ("arc", rng.uniform(-0.05, 0.05, 400))}
    sigmas = {"acc_shift_sigma": ("arc", np.full(400, 5e-4)), "sca_shift_sigma": ("arc", np.full(400, 0.01))}
    product = xr.Dataset(shifts | sigmas | {"time_acc": ("sample", np.arange(50) * 0.1)})
    product = product.assign(acc_delay=float(shifts["acc_shift"][1].mean()), acc_delay_sigma=0.037)
    rows = responses.edge_block(product).observed
    assert abs(np.mean(rows[:-1] ** 2) - 1) < 0.15
    late = product.assign(acc_shift=product["acc_shift"] + 0.2, acc_delay=product["acc_delay"] + 0.2)
    column = responses.edge_column("timing.accelerometer_delay", product, np.zeros(400))[:, 0]
    np.testing.assert_allclose(responses.edge_block(late).observed - rows, 0.2 * column, rtol=1e-9)


def test_what_a_search_fits_of_a_listed_cause_is_what_its_model_adds(moving):
    """Analytic: columns of each whole form times its parameters, whose names are in order, are rows of its entry."""
    found, rng = moving[0], np.random.default_rng(6)
    forms = [one for one in found.candidates if one.listed and "alone" not in one.form]
    largest = max(np.abs(view.context.dipole_b).max() for view in found.views)
    for one in (one for one in forms if one.cause != lag.CAUSE):  # what is fitted is another
        sizes = 1e-3 * np.array(one.prior) * rng.uniform(0.5, 1.5, len(one.names))
        known = {name: v if name != "limit" else largest - v for name, v in zip(one.names, sizes, strict=True)}
        known |= dict(zip(one.shape.names, one.shape.value, strict=True)) if one.shape else {}
        rows = found.response(Entry(one.cause, one.form, {name: Parameter(v, None, "") for name, v in known.items()}))
        for row, part in zip(rows, one.columns, strict=True):
            expected = 0.0 * row if part is None else part @ sizes
            np.testing.assert_allclose(row, expected, atol=1e-3 * np.linalg.norm(expected), err_msg=one.cause)
