"""Parts of a search on invented algebra: columns, foreign causes, what is held out, times and frequencies."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

from gravcal.discovery import attribution, scan, trials
from gravcal.discovery import problem as problems
from gravcal.discovery.driver import check_causes
from gravcal.discovery.problem import baseline_of, columns_of, observed_rows, prepare, residuals_of, without_rounding
from gravcal.discovery.rounds import Choice, search
from gravcal.errors import CatalogError
from gravcal.estimation.least_squares import orthonormal
from gravcal.estimation.records import Block, Candidate, Entry

CHANNELS = {
    "by channel": np.repeat(["linear", "angular", "attitude"], [40, 30, 20]),
    "alternating": np.tile(["linear", "angular", "attitude"], 30),
}


@pytest.fixture(params=CHANNELS)
def made(request):
    """Columns (90, 9) of five pieces, the whole matrix less its part along local columns, and the basis of those."""
    rng = np.random.default_rng(17)
    channel = CHANNELS[request.param]
    linear, angular = (channel == name for name in ("linear", "angular"))
    pieces = [rng.standard_normal((90, q)) for q in (1, 3, 2)]
    pieces[1][~linear] = 0.0
    pieces[2][linear] = 0.0
    pieces += [None, rng.standard_normal((90, 1)) * angular[:, None]]
    widths = [1, 3, 2, 2, 1]
    basis = orthonormal(rng.standard_normal((90, 4)))
    whole = np.concatenate([np.zeros((90, 2)) if p is None else p for p in pieces], axis=1)
    return columns_of(channel, basis, pieces, widths), whole, basis


def test_products_are_those_of_the_whole_matrix(made):
    """Analytic: of all columns, of their squares, of some of them, with a signal; more stand after the others."""
    columns, whole, basis = made
    clean = whole - basis @ (basis.T @ whole)
    assert_allclose(columns.products(), clean.T @ clean, atol=1e-12)
    assert_allclose(columns.squares, np.sum(whole**2, axis=0), rtol=1e-13)
    signal = np.random.default_rng(1).standard_normal((90, 5))
    signal -= basis @ (basis.T @ signal)
    assert_allclose(columns.onto(signal), clean.T @ signal, atol=1e-12)
    for wanted in ([0], [8, 2, 6], np.arange(9), []):
        assert_allclose(columns.of(np.array(wanted, dtype=int)), clean[:, np.array(wanted, dtype=int)], atol=1e-13)
    both = np.concatenate([whole, np.random.default_rng(2).standard_normal((90, 2))], axis=1)
    clean, wider = both - basis @ (basis.T @ both), columns.wider(both[:, 9:])
    assert_allclose(wider.products(), clean.T @ clean, atol=1e-12)
    assert_allclose(wider.of(np.array([10, 1])), clean[:, [10, 1]], atol=1e-13)


def test_columns_along_own_ones_are_gone_and_not_rounding(made):
    """Analytic: products with a column of the own ones are zero, also where it comes later; others are untouched."""
    columns, _, basis = made
    assert orthonormal(np.concatenate([basis, basis[:, :1]], axis=1)).shape == (90, 4)  # what is repeated adds nothing
    wider = columns.wider(1e9 * basis @ np.ones((4, 1))).products()
    assert np.all(wider[-1] == 0)
    assert np.all(wider[:, -1] == 0)
    assert_allclose(wider[:9, :9], columns.products(), atol=0)
    assert np.count_nonzero(without_rounding(np.full((10, 10), 1e3), np.append(np.zeros(9), 1e20))) == 81


def test_a_driver_that_the_calibration_has_not_is_an_error():
    """Contract: it was ignored without a word; causes of the catalogue, drivers and lines that are searched pass."""
    searched = [SimpleNamespace(cause=cause, names=()) for cause in ("unknown:pointing", "ranging.delay")]
    lines = (SimpleNamespace(cause="unknown:time"),)
    observed = SimpleNamespace(name="kbr_phase_centre", candidates=searched, lines=lines, tones={})
    known, foreign = ("unknown:pointing", "unknown:time", "torque.eddy_current"), Entry("unknown:warmth", "", {})
    check_causes(observed, [Entry(cause, "", {}) for cause in known])
    check_causes(None, [foreign])
    with pytest.raises(CatalogError, match="found unknown:warmth, expected .* of kbr_phase_centre: unknown:pointing"):
        check_causes(observed, [Entry("unknown:pointing", "", {}), foreign])


def grams(blocks):
    """Products (b, m, m) of (observed, columns) of each block."""
    joined = [np.column_stack(one) for one in blocks]
    return np.array([one.T @ one for one in joined])


def density(blocks, left_out, count):
    """Twice the log density of one block as the first `count` columns of the others predict it."""
    observed = np.concatenate([b[0] for i, b in enumerate(blocks) if i != left_out])
    columns = np.concatenate([b[1][:, :count] for i, b in enumerate(blocks) if i != left_out])
    y, x = blocks[left_out][0], blocks[left_out][1][:, :count]
    covariance = np.linalg.inv(columns.T @ columns)
    mean = x @ covariance @ columns.T @ observed
    return 2 * multivariate_normal.logpdf(y, mean, np.eye(y.size) + x @ covariance @ x.T)


@pytest.mark.parametrize("seed", range(4))
def test_the_gain_is_that_of_densities_written_out(seed):
    """Analytic: normal densities of the blocks with the covariance of their prediction; units differ by 1e6."""
    rng = np.random.default_rng(seed)
    scale = [1.0, 1e3, 1e-3]
    blocks = [(rng.standard_normal(30) * 3, rng.standard_normal((30, 3)) * scale) for _ in range(4)]
    gain = attribution.held_out(grams(blocks), np.array([1, 2]), np.array([3]))
    assert gain == pytest.approx(sum(density(blocks, i, 3) - density(blocks, i, 2) for i in range(4)), abs=1e-8)


def test_what_only_one_block_sees_gains_nothing_and_is_fitted_in_it():
    """Analytic: of a candidate, of any size, at right angles to the baseline; of the baseline as an local column."""
    rng = np.random.default_rng(4)
    blocks = [(rng.standard_normal(50), rng.standard_normal((50, 2))) for _ in range(3)]
    for _, columns in blocks[1:]:
        columns[:, 1] = 0.0
    columns = np.linalg.qr(blocks[0][1])[0]
    blocks[0] = (blocks[0][0] + 30 * columns[:, 1], columns)
    assert attribution.held_out(grams(blocks), np.array([1]), np.array([2])) == pytest.approx(0.0, abs=1e-6)
    rng = np.random.default_rng(6)
    blocks = [(rng.standard_normal(60), rng.standard_normal((60, 3))) for _ in range(3)]
    for observed, columns in blocks:
        observed += columns @ [1.0, 5.0, 1.0]
    for _, columns in blocks[1:]:
        columns[:, 1] = 0.0
    fitted = attribution.held_out(grams(blocks), np.array([1, 2]), np.array([3]))
    basis = blocks[0][1][:, 1] / np.linalg.norm(blocks[0][1][:, 1])
    first = np.column_stack(blocks[0])
    first -= np.outer(basis, basis @ first)
    gone = [(first[:, 0], first[:, 1:]), *blocks[1:]]
    assert fitted == pytest.approx(attribution.held_out(grams(gone), np.array([1]), np.array([3])), abs=1e-6)


def test_a_frame_that_only_a_prior_tells_from_a_parameter_is_held_out_nowhere():
    """Contract: zero, "prior", whatever is measured; a cause that is no frame is held out of the manoeuvres as ever."""
    rng = np.random.default_rng(8)
    shared = [*rng.standard_normal((2, 200, 1)), np.ones((1, 1))]
    turned = [*shared[:2], np.zeros((1, 1))]  # what the parameter does, but for its prior
    about = zip(("a", "a", "prior"), shared, strict=True)
    blocks = [Block.of("", s[:, 0] + rng.standard_normal(len(s)), c, 0, np.arange(len(s)), shared=s) for c, s in about]
    one = Candidate("case.turn", "", ["p"], ["1"], turned)
    of_frame, other = (prepare(blocks, [replace(one, of_frame=of_frame)]) for of_frame in (True, False))
    assert trials.held_out(of_frame, baseline_of(of_frame, ()), 0, 10.0) == (0.0, "prior")
    assert trials.held_out(other, baseline_of(other, ()), 0, 10.0)[1] == "manoeuvres"


def test_what_is_left_beside_the_whole_motion_is_no_rounding():
    """Analytic: chi-square of a shape that a record of 1e8 sigma has but for 3e-6; 1e15 by products of the record."""
    rng = np.random.default_rng(2)
    motion, bent = rng.standard_normal((2, 4000, 1))
    columns = np.column_stack([motion, motion + 3e-6 * bent])
    block = Block.of("", 1e8 * motion[:, 0] + rng.standard_normal(4000), "a", 0, np.arange(4000.0), shared=motion)
    less, _ = problems.less_calibration([block])
    total = prepare(less, [Candidate("case.bent", "", ["q"], ["1"], [columns[:, 1:]])]).total
    left = np.linalg.lstsq(columns, block.observed)[1]
    assert attribution.projected(total, np.array([1, 2]))[0, 0] == pytest.approx(left, rel=1e-6)


def blocks_of(rng):
    """Two blocks of 3 axes x 80 rows: a drift of each axis, one global column, a step at each of four epochs."""
    blocks, time = [], np.tile(np.arange(80.0), 3)
    axis = np.repeat([0, 1, 2], 80)
    for k in range(2):
        drift = np.stack([np.where(axis == a, time**n, 0.0) for a in range(3) for n in (0, 1)], axis=1)
        shapes = {}
        for at in (20.0, 33.0, 47.0, 60.0):
            shapes[at + 100 * k] = np.stack([np.where(axis == a, time > at, False) for a in range(3)], axis=1) * 1.0
        rows = rng.standard_normal(240), rng.standard_normal((240, 1)), drift, np.array(["linear"] * 240), axis, time
        blocks.append(Block(f"block {k}", *rows, steps=shapes))
    return blocks


def test_gain_of_a_step_is_that_of_least_squares():
    """Analytic: on all axes and on each, chi-square that a step takes beside drifts and the global column."""
    blocks = blocks_of(np.random.default_rng(3))
    problem = prepare(blocks, [])
    baseline = np.array([1])
    found = scan.steps(problem, baseline, residuals_of(problem, baseline, observed_rows(problem)))
    assert found.at.size == 3 * 4 * 4  # in either block and in both
    assert sorted(set(found.dof)) == [1, 3]
    own = [np.concatenate([b.local_columns, np.zeros_like(b.local_columns)], axis=1) for b in blocks]
    own[1] = np.roll(own[1], own[1].shape[1] // 2, axis=1)
    plain = np.concatenate([np.concatenate([o, b.global_columns], axis=1) for o, b in zip(own, blocks, strict=True)])
    right = np.concatenate([b.observed for b in blocks])
    for k, (place, at, gain, dof) in enumerate(zip(found.place, found.at, found.gain[:, 0], found.dof, strict=True)):
        shape = [
            b.steps[at + 100 * i * (place < 0)] if place in (i, -1) else np.zeros((240, 3))
            for i, b in enumerate(blocks)
        ]
        columns = np.concatenate(shape)
        one = columns if dof == 3 else columns[:, [k % 16 // 4 - 1]]
        left = [np.linalg.lstsq(m, right)[1][0] for m in (plain, np.concatenate([plain, one], axis=1))]
        assert gain == pytest.approx(left[0] - left[1], rel=1e-9)


@pytest.mark.parametrize("shake", [0.0, 0.3])
def test_gain_of_a_line_is_that_of_least_squares(shake):
    """Analytic: cosine and sine on one axis or all, beside drifts and the global column; even records or not."""
    rng = np.random.default_rng(3)
    (block,) = blocks_of(rng)[:1]
    block = replace(block, time=block.time + np.tile(shake * rng.uniform(0, 1, 80), 3))
    rows = np.flatnonzero(~np.isin(block.time // 1, [7, 40, 41]))
    names = ("observed", "global_columns", "local_columns", "channel", "axis", "time")
    block = replace(block, steps={}, **{name: getattr(block, name)[rows] for name in names})
    problem, baseline = prepare([block], []), np.array([1])
    rest, grid = residuals_of(problem, baseline, observed_rows(problem)), scan.frequencies([block], "linear")
    gain, dof = scan.line_gains(problem, baseline, rest, "linear", grid)
    plain = np.concatenate([block.local_columns, block.global_columns], axis=1)
    for axis, at in itertools.product(range(3), (3, 11, 20)):
        waves = np.stack([np.cos(turn := 2 * np.pi * grid[at] * block.time), np.sin(turn)], axis=1)
        both = np.concatenate([plain, np.where(block.axis[:, None] == axis, waves, 0.0)], axis=1)
        left = [np.linalg.lstsq(m, block.observed)[1][0] for m in (plain, both)]
        assert gain[axis, at, 0] == pytest.approx(left[0] - left[1], rel=1e-6)  # of the ridge
    assert_allclose(gain[3], gain[:3].sum(axis=0))
    assert dof.tolist() == [[2] * grid.size] * 3 + [[6] * grid.size]


def three_blocks(rng, added):
    """Three blocks of 3 axes x 200 rows of noise beside a drift, and a signal on y of that size."""
    axis, time, blocks = np.repeat([0, 1, 2], 200), np.tile(np.arange(200.0), 3), []
    signal = [np.where(axis == 1, added(time, k), 0.0) for k in range(3)]
    for k, one in enumerate(signal):
        drift = np.stack([np.where(axis == a, time**n, 0.0) for a in range(3) for n in (0, 1)], axis=1)
        size = one / np.sqrt(sum(np.sum(s**2) for s in signal)) if one.any() else one
        rows = rng.standard_normal(600) + SIZE * size, rng.standard_normal((600, 1)), drift
        blocks.append(Block(f"block {k}", *rows, np.array(["linear"] * 600), axis, time + 1000.0 * k))
    return blocks


def test_a_step_that_every_block_has_is_one_name_though_none_shows_it():
    """Recovery: signal-to-noise 4 in each of eight blocks, as long after the start of each: one name in all of them."""
    rng, axis, time, blocks = np.random.default_rng(11), np.repeat([0, 1, 2], 80), np.tile(np.arange(80.0), 3), []
    for k in range(8):
        steps = {t + 100.0 * k: (axis[:, None] == np.arange(3)) * (time[:, None] > t) * 1.0 for t in range(20, 60, 4)}
        means = (axis[:, None] == np.arange(3)) * 1.0
        seen = rng.standard_normal(240) + 4 / np.sqrt(20) * steps[40 + 100.0 * k][:, 1]
        about = rng.standard_normal((240, 1)), means, np.array(["linear"] * 240), axis, time + 100.0 * k
        blocks.append(Block(f"block {k}", seen, *about, steps=steps))
    found = search(blocks, [], CHOICE, np.random.default_rng(1))
    assert [(o.cause, o.form) for o in found.findings] == [("case.step", "every manoeuvre, in the first at time 40 s")]
    assert found.findings[0].value[1] == pytest.approx(4 / np.sqrt(20), abs=4 * found.findings[0].sigma[1])


SIZE = 12.0
CHOICE = Choice(0.005, 9.0, 4, "case.step", {"linear": "case.tone"})


def jumps(time, k):
    """Sign that changes at random, once in 40 s."""
    ends = np.cumsum(np.random.default_rng(k + 3).exponential(40.0, 60))
    return 1.0 - 2.0 * (np.searchsorted(ends, time) % 2)


def chirp(time, k):
    """From 50 to 200 mHz, with a phase of its own in every block."""
    return np.sin(2 * np.pi * (0.05 * time + 0.15 / 400 * time**2) + 2.0 * k)


@pytest.mark.parametrize(
    ("signal", "words"),
    [
        (chirp, "linear reading y, chirp, begin 0.05"),
        (jumps, "linear reading"),
        (lambda time, k: (k == 1) * ((time > 60) & (time < 90)) * np.sin(1.9 * time + np.sin(0.9 * time)), "block 1"),
        (lambda time, _: 0.0 * time, ""),
    ],
)
def test_power_that_follows_nothing_is_noticed_and_is_no_tone(signal, words):
    """Recovery: a chirp, a random telegraph signal and a burst have their channel and place said; noise has nothing."""
    blocks = three_blocks(np.random.default_rng(8), signal)
    result = search(blocks, [], CHOICE, np.random.default_rng(1))
    assert [one.cause for one in result.findings] == ["unknown:excess"] * bool(words)
    assert all(words in one.form for one in result.findings)
    assert (result.before.p < 0.005) == bool(words)
    assert result.after.p > 0.005


def test_a_chirp_stands_out_of_noise_that_was_measured_with_it():
    """Recovery: half of the power of a record; noise as it was measured has none, and noise that is less has none."""
    rng, time = np.random.default_rng(5), np.arange(300.0)
    sweep = np.sin(2 * np.pi * (0.15 * time + 0.1 / 300 * time**2))
    block = Block.of("one", np.zeros(300), "linear", 0, time, shared=np.zeros((300, 1)), local=np.ones((300, 1)))
    log_p = []
    for level, size in ((0.7, 1.0), (1.0, 0.0), (0.3, 0.0)):
        rest = np.column_stack([level * rng.standard_normal(300) + size * sweep, rng.standard_normal((300, 199))])
        log_p += [e.log_p for e in scan.excess(prepare([block], []), [rest], "linear") if e.kind == "chirp"]
    assert log_p[0][0] < -30 < -8 < np.min(log_p[0][1:])
    assert min(log_p[1][0], log_p[2][0]) > -3


def test_a_line_that_drifts_from_block_to_block_is_one_excess_of_a_channel_with_one_axis():
    """Recovery: signal-to-noise 4 in each of eight stretches with pauses, 40 to 140 mHz in all; no one shows it."""
    rng, time, blocks = np.random.default_rng(4), np.arange(300.0), []
    for k in range(8):
        whole = time + 500.0 * k
        line = np.sin(2 * np.pi * (0.04 + 0.1 / 2 / 3800 * whole) * whole + k)
        about = rng.standard_normal((300, 1)), np.stack([np.ones(300), time], axis=1), np.array(["range"] * 300)
        seen = rng.standard_normal(300) + 4.0 / np.sqrt(150) * line
        blocks.append(Block(f"block {k}", seen, *about, np.zeros(300, dtype=int), whole))
    (one,) = search(blocks, [], CHOICE, np.random.default_rng(1)).findings
    assert one.cause == "unknown:excess"
    assert one.form.startswith("range reading, drifting line, begin 0.0")
    ends = [float(word) for word in one.form.replace("Hz", "").split() if word.startswith("0.")]
    assert ends == pytest.approx([0.04, 0.14], abs=2e-3)
    noise = [replace(b, observed=rng.standard_normal(300)) for b in blocks]
    assert search(noise, [], CHOICE, np.random.default_rng(1)).findings == []
