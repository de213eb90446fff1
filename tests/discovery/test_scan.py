"""The search along the time and the frequency axis on invented linear algebra."""

from dataclasses import replace

import numpy as np
import pytest

from gravcal.discovery import scan
from gravcal.discovery.problem import observed_rows, prepare, residuals_of
from gravcal.discovery.rounds import Choice, search
from gravcal.estimation.records import Block


def blocks_of(rng):
    """Two blocks of 3 axes x 80 rows: a drift of each axis, one shared column, a step at each of four epochs."""
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
    """Analytic: on all axes and on each, chi-square that a step takes beside drifts and the shared column."""
    blocks = blocks_of(np.random.default_rng(3))
    problem = prepare(blocks, [])
    baseline = np.array([1])
    rest = residuals_of(problem, baseline, observed_rows(problem))
    found = scan.steps(problem, baseline, rest)
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
        steps = {
            at + 100.0 * k: (axis[:, None] == np.arange(3)) * (time[:, None] > at) * 1.0 for at in range(20, 60, 4)
        }
        means = (axis[:, None] == np.arange(3)) * 1.0
        seen = rng.standard_normal(240) + 4 / np.sqrt(20) * steps[40 + 100.0 * k][:, 1]
        about = rng.standard_normal((240, 1)), means, np.array(["linear"] * 240), axis, time + 100.0 * k
        blocks.append(Block(f"block {k}", seen, *about, steps=steps))
    found = search(blocks, [], CHOICE, np.random.default_rng(1))
    assert [(one.cause, one.form) for one in found.findings] == [
        ("case.step", "every manoeuvre, in the first at time 40 s")
    ]
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


@pytest.mark.parametrize("shake", [0.0, 0.3])
def test_waves_of_a_record_are_products_with_cosine_and_sine(shake):
    """Analytic: of even records with a gap by a transform, of others one by one; both are the sums that they stand for.

    A day has as many frequencies as records: columns of 43,200 by 38,880 would be 13 GB, and none are kept.
    """
    rng = np.random.default_rng(5)
    time = np.delete(1e5 + 0.5 * np.arange(400.0), [7, 120, 121])
    time = time + shake * 0.5 * rng.uniform(0, 1, time.size)
    block = Block("one", *[np.zeros((time.size, 0))] * 3, np.array(["a"] * time.size), np.zeros(time.size), time)
    grid, signals = scan.frequencies([block], "a"), rng.standard_normal((time.size, 2))
    phase = 2 * np.pi * np.outer(time - time[0], grid)
    waves = np.stack([np.cos(phase), np.sin(phase)], axis=2)
    made = scan.waves_at(time, grid)
    assert made.func is (scan._multiplied if shake else scan._transformed)
    assert made(signals) == pytest.approx(np.einsum("nfk,nq->fkq", waves, signals), abs=1e-8)
    assert scan._squares(time, grid) == pytest.approx(np.einsum("nfk,nfl->fkl", waves, waves), abs=1e-8)
