"""The rounds on invented linear algebra: no satellite."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from gravcal.discovery.attribution import beside_calibration
from gravcal.discovery.driver import Limits, discover, discover_again, summary
from gravcal.discovery.evidence import evidence
from gravcal.discovery.limits import detection_limits
from gravcal.discovery.model_average import _evidence, _held, delivered, left_open
from gravcal.discovery.problem import baseline_of, drawn_noise, prepare
from gravcal.discovery.rounds import Choice, merged, pruned, search
from gravcal.discovery.scan import level_error
from gravcal.errors import EstimationError
from gravcal.estimation.noise import Spectrum
from gravcal.estimation.outcome import outcome_of
from gravcal.estimation.records import Block, Candidate, Observations, Shape, Wider
from gravcal.report.discovery import WORDS, tied_table, unobservable_table
from gravcal.report.discovery_words import verdict
from tasks.discovery import _model

CHOICE = Choice(0.005, 9.0, 4, "case.step", {})


class Invented(Observations):
    """Blocks and candidates of one calibration parameter."""

    name, channels, parameters, unit = "case", ("a",), ("offset",), "m"
    scale, start = np.ones(1), np.zeros(1)

    def __init__(self, blocks, candidates):
        self.blocks, self.candidates = blocks, candidates

    def reading(self, _, number, rows):
        """Whitened rows as they are."""
        return self.blocks[number].time, np.zeros((rows.shape[0], 1)), rows.T[:, :, None]


OFFSET = Invented([], [])


def made(rng, signal=0.0):
    """Four blocks of 300 rows with one shared and two local columns; candidate a acts with the given S/N."""
    blocks, a, b = [], [], []
    for k in range(4):
        own = np.stack([np.ones(300), np.linspace(-1, 1, 300)], axis=1)
        shared, first, second = (rng.standard_normal((300, 1)) for _ in range(3))
        observed = rng.standard_normal(300) + shared[:, 0] + signal * first[:, 0] / np.sqrt(1200)
        rows = np.array(["a"] * 300), np.zeros(300, dtype=int), np.arange(300.0)
        blocks.append(Block(f"block {k}", observed, shared, own, *rows))
        a.append(first)
        b.append(second)
    named = [Candidate(f"case.{n}", "", ["size"], ["1"], c) for n, c in (("a", a), ("b", b))]
    twin = Candidate("case.twin", "", ["size"], ["1"], [2 * c for c in a])
    return blocks, [*named, twin]


def hiding(blocks, columns, size):
    """Blocks with so much of a column in what they observe."""
    return [replace(b, observed=b.observed + size * c[:, 0]) for b, c in zip(blocks, columns, strict=True)]


def test_an_effect_is_named_with_the_one_that_looks_the_same_and_beside_a_drift():
    """Recovery: S/N 12, its double is tied, an unrelated column not; in a thirty-thousandth that is no drift, too."""
    blocks, candidates = made(np.random.default_rng(5), signal=12.0)
    found = search(blocks, candidates, CHOICE, np.random.default_rng(1)).findings
    assert len(found) == 1
    assert {found[0].cause, *found[0].tied} == {"case.a", "case.twin"}
    assert found[0].heldout > 0
    blocks, candidates = made(np.random.default_rng(5), signal=12.0)
    steep = [c + 3e4 * b.local_columns[:, 1:] for c, b in zip(candidates[0].columns, blocks, strict=True)]
    found = search(blocks, [replace(candidates[0], columns=steep)], CHOICE, np.random.default_rng(1)).findings
    assert [one.cause for one in found] == ["case.a"]


def test_two_of_six_parameters_are_named_before_a_cause_whose_nine_describe_as_much():
    """Recovery: a coupling acts along two of six directions, a leak reaches both with nine; one of either does not."""
    rng = np.random.default_rng(8)
    blocks, _ = made(rng)
    coupling = [rng.standard_normal((300, 6)) for _ in blocks]
    leak = [np.concatenate([c[:, [1]] + c[:, [4]], rng.standard_normal((300, 7)), c[:, [4]]], axis=1) for c in coupling]
    size = np.array([0, 15, 0, 0, 12, 0]) / np.sqrt(1200)
    hidden = [replace(b, observed=b.observed + c @ size) for b, c in zip(blocks, coupling, strict=True)]
    causes = (("case.coupling", coupling), ("case.leak", leak))
    wide = [(n, c, c[0].shape[1]) for n, c in causes]
    wide = [Candidate(n, "", [f"p{k}" for k in range(w)], ["1"] * w, c, [1.0] * w) for n, c, w in wide]
    (one,) = search(hidden, [f for c in wide for f in c.each_alone()], CHOICE, rng).findings
    assert {one.cause, *one.tied} == {"case.coupling", "case.leak"}
    few = {"case.coupling": (("p1", "p4"), size[[1, 4]]), "case.leak": (("p0", "p8"), [size[1], size[4] - size[1]])}
    names, true = few[one.cause]
    assert set(names) <= (told := set(one.form.removesuffix(" alone").split(", ")))
    assert len(told) <= 3
    assert np.all(np.abs(one.value[np.isin(one.names, names)] - true) < 4 / np.sqrt(1200))


def test_a_listed_cause_is_tied_with_what_no_list_holds_if_it_looks_the_same():
    """Recovery: the double is a regressor in no list; the listed cause is named, and the document says of the other."""
    blocks, candidates = made(np.random.default_rng(5), signal=12.0)
    far = replace(candidates[1], cause="unknown:time", form="once")
    near = replace(candidates[2], cause="unknown:field", form="twice")
    result = search(blocks, [candidates[0], far, near], CHOICE, np.random.default_rng(1))
    (found,) = result.findings
    assert (found.cause, found.tied) == ("case.a", [])
    assert [(one.cause, one.form) for one in found.imitators] == [("unknown:field", "twice")]
    assert found.imitators[0].expected_chi2 == pytest.approx(0.0, abs=1e-6)
    outcome = summary(result, CHOICE, OFFSET)
    assert outcome.findings[0].tied_with == ["unknown:field"]
    assert "This data cannot tell that from an effect in no list that follows field." in verdict(outcome)
    assert "twice" in str(tied_table(outcome.findings).rows)


@pytest.mark.parametrize("more", [0, 6])
def test_a_listed_cause_is_tied_with_a_driver_that_chance_lets_describe_the_data_as_well(more):
    """Recovery: 20 apart in expectation, yet of the same gain or 6 more (3 sigma are 6.8); with less none is told."""
    rng = np.random.default_rng(5)
    blocks, (first, *_) = made(rng, signal=12.0)
    known = np.concatenate(first.columns)[:, 0]
    fixed = np.column_stack(
        [np.kron(np.eye(4), blocks[0].local_columns), np.concatenate([b.global_columns for b in blocks])[:, 0], known]
    )
    observed = np.concatenate([b.observed for b in blocks])
    rest, other = (without(values, fixed) for values in (observed, rng.normal(size=1200)))
    other = without(other, rest[:, None])
    size = without(known, fixed[:, :-1]) @ observed / np.linalg.norm(known)  # 12 and its noise
    turn = np.arcsin(np.sqrt(20) / size)

    def driver(name, of_rest):
        """Column turned away from the cause, with so much of the noise in it."""
        away = of_rest * rest / np.linalg.norm(rest) ** 2 + other / np.linalg.norm(other)
        column = np.cos(turn) * known / np.linalg.norm(known) + np.sin(turn) * away / np.linalg.norm(away)
        return replace(first, cause=f"unknown:{name}", columns=list(column.reshape(4, 300, 1)))

    lucky = (np.sqrt(size**2 + more) - size * np.cos(turn)) / np.sin(turn)
    candidates = [first, driver("field", lucky), driver("time", -lucky)]
    (found,) = search(blocks, candidates, CHOICE, np.random.default_rng(1)).findings
    assert (found.cause, [one.cause for one in found.imitators]) == ("case.a", ["unknown:field"])
    assert found.imitators[0].expected_chi2 > CHOICE.tie


@pytest.mark.parametrize(("further", "named"), [(28.0, "case.a"), (60.0, "unknown:pairs")])
def test_a_driver_that_holds_a_listed_cause_is_named_by_what_it_gains_beside_it(further, named):
    """Recovery: 15 parameters more gain 28 (p = 2 %) or 60 (4e-7) where power is left; the driver is no tie."""
    rng = np.random.default_rng(5)
    blocks, (first, *_) = made(rng, signal=60.0)
    blocks = [replace(b, observed=b.observed * (1 + 2.0 * (k == 3) * (b.time < 100))) for k, b in enumerate(blocks)]
    fixed = np.zeros((1200, 10))
    for k, (block, column) in enumerate(zip(blocks, first.columns, strict=True)):
        here = slice(300 * k, 300 * k + 300)
        fixed[here, 2 * k : 2 * k + 2], fixed[here, 8:] = block.local_columns, np.hstack([block.global_columns, column])
    rest, more = without(np.concatenate([b.observed for b in blocks]), fixed), rng.standard_normal((1200, 15))
    more = np.linalg.qr(without(more, np.column_stack([fixed, rest])))[0]
    more[:, 0] += np.sqrt(further / (rest @ rest) / (rest @ rest - further)) * rest
    columns = [np.hstack([c, m]) for c, m in zip(first.columns, np.split(more, 4), strict=True)]
    wide = Candidate("unknown:pairs", "", [f"p{k}" for k in range(16)], ["1"] * 16, columns)
    (found,) = search(blocks, [first, wide], replace(CHOICE, excess=False), rng).findings
    assert (found.cause, found.imitators) == (named, [])


@pytest.mark.parametrize(("sizes", "steps"), [((9.0, 9.3, -9.1), 0), ((9.0, 18.0, -27.0), 3)])
def test_steps_of_one_size_are_one_signal_between_two_levels(sizes, steps):
    """Recovery: three breaks in blocks with origins of their own; of one size one excess, else three breaks."""
    rng = np.random.default_rng(3)
    blocks, candidates = made(rng)[0], []
    for k, size in enumerate(sizes):
        columns = [None] * len(blocks)
        columns[k] = (np.arange(300) >= 120 + 40 * k).astype(float)[:, None]
        left = without(columns[k], np.column_stack([blocks[k].local_columns, blocks[k].global_columns]))
        observed = blocks[k].observed + size / np.linalg.norm(left) * columns[k][:, 0]
        blocks[k] = replace(blocks[k], observed=observed)
        about = {"at": 120.0 + 40 * k, "at_sigma": 1.0}
        candidates.append(Candidate(f"case.step@{about['at']}", f"block {k}", ["size"], ["m"], columns, [1.0], **about))
    found = [one.cause for one in search(blocks, candidates, CHOICE, np.random.default_rng(1)).findings]
    assert sum(cause.startswith("case.step") for cause in found) == steps
    assert found.count("unknown:excess") == (not steps)


def test_a_telegraph_signal_is_one_name_where_some_of_its_jumps_were_named_as_steps():
    """Recovery: 18 jumps in 800 rows, of 4 standard deviations; a step is offered every 20 rows."""
    rng = np.random.default_rng(0)
    level = 2 * np.cumprod(np.where(rng.random(800) < 0.02, -1, 1))
    time, at, observed = np.arange(800.0), np.arange(20.0, 780.0, 20.0), rng.standard_normal(800) + level
    block = Block.of("one", observed, "linear", 0, time, shared=np.zeros((800, 1)), local=np.ones((800, 1)))
    after = [(time >= one).astype(float)[:, None] for one in at]
    steps = [Candidate(f"case.step@{t}", "", ["size"], ["m"], [c], [9.0], at=t) for t, c in zip(at, after, strict=True)]
    (found,) = search([block], steps, CHOICE, np.random.default_rng(1)).findings
    assert found.form == f"linear reading x, {np.count_nonzero(np.diff(level))} jumps between two levels"


def without(values, columns):
    """Values without columns."""
    return values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]


def test_noise_names_nothing_and_its_probability_is_uniform():
    """Recovery: 60 draws at 0.5 %, two named have probability 0.04; Kolmogorov-Smirnov at 0.1 %; none is too quiet."""
    rng = np.random.default_rng(12)
    found = [search(*made(rng), CHOICE, rng) for _ in range(60)]
    assert sum(bool(one.findings) for one in found) <= 1
    assert min(one.before.quiet for one in found) > 1e-3
    p = np.sort([one.before.p for one in found])
    assert (np.max(np.abs(p - (np.arange(60) + 0.5) / 60)) + 0.5 / 60) < 1.95 / np.sqrt(60)


def test_less_power_than_noise_has_is_an_alarm_too():
    """Recovery: noise that is overrated by a tenth in 1200 rows."""
    rng = np.random.default_rng(14)
    blocks, candidates = made(rng)
    result = search([replace(b, observed=0.9 * b.observed) for b in blocks], candidates, CHOICE, rng)
    assert result.before.p > 0.05
    assert result.before.quiet < 1e-3
    assert not result.before.adequate(CHOICE.level)
    assert "less than its noise" in verdict(summary(result, CHOICE, OFFSET))


def test_an_isolated_outlier_is_left_out_and_reported_and_hides_no_cause():
    """Recovery: S/N 12 beside a sample 40 sigma off on a steep place of the global column; what a step does stays."""
    rng = np.random.default_rng(15)
    blocks, candidates = made(rng, signal=12.0)
    worst = int(np.argmax(np.abs(blocks[2].global_columns[:, 0])))
    blocks[2].observed[worst] += 40
    result = search(blocks, candidates, CHOICE, rng)
    ((where, sigma),) = [((one.block, one.time), one.sigma) for one in result.outliers]
    assert where == ("block 2", float(worst))
    assert 35 < sigma < 45
    assert [f.cause for f in result.findings] == ["case.a"]
    assert result.after.p > CHOICE.level
    assert abs(result.shared[1][0] - 1.0) < 4 * result.sigma[1][0]
    assert "39" in str(WORDS.table("outliers", vars(summary(result, CHOICE, OFFSET))).rows)
    spike = np.eye(300)[:, 100:103] * [1, 0, 0]
    blocks, candidates = made(rng)
    stepped = replace(blocks[0], observed=blocks[0].observed + 12 * spike[:, 0], steps={100.0: spike})
    assert not search([stepped, *blocks[1:]], candidates, CHOICE, rng).outliers


def waves(rng, frequency, size):
    """Four blocks with a wave between two frequencies of a grid, and a candidate for each of the grid."""
    blocks, _ = made(rng)
    time = np.arange(300.0)
    column = lambda f: [np.sin(2 * np.pi * f * time + k)[:, None] for k in range(4)]  # noqa: E731
    for block, one in zip(blocks, column(frequency), strict=True):
        block.observed[:] += size * one[:, 0]
    found = []
    for f in np.arange(0.05, 0.30, 0.002):
        tried, limits = f + np.linspace(-0.002, 0.002, 5), (np.array([f - 0.004]), np.array([f + 0.004]))
        shape = Shape(("frequency",), ("Hz",), np.array([f]), lambda v: column(v[0]), tried[:, None], *limits)
        found.append(Candidate("case.wave", f"{f:.3f} Hz", ["size"], ["1"], column(f), shape=shape))
    return blocks, found


def test_a_shape_is_fitted_between_the_grid_and_a_strong_wave_is_one_name():
    """Recovery: frequency and size, squared errors over variance of 20 draws to 0.01 %; at 40 sigma one name alone.

    The calibration has the error of a fit with a free frequency where it looks like a change of that.
    """
    rng, errors = np.random.default_rng(21), []
    for _ in range(20):
        frequency = rng.uniform(0.1, 0.2)
        result = search(*waves(rng, frequency, 1.0), CHOICE, rng)
        (found,) = result.findings
        shape = result.problem.candidates[found.index].shape
        errors.append([(shape.value[0] - frequency) / np.sqrt(shape.covariance[0, 0])])
        errors[-1].append((found.value[0] - 1.0) / found.sigma[0])
    total = np.sum(np.square(errors), axis=0)
    assert np.all(total < 52.4)
    assert np.all(total > 4.4)
    blocks, forms = waves(np.random.default_rng(5), 0.1511, 3.0)
    (found,) = (result := search(blocks, forms, CHOICE, np.random.default_rng(1))).findings
    assert abs(result.problem.candidates[found.index].shape.value[0] - 0.1511) < 1e-4
    slope = [np.arange(300.0) * np.cos(2 * np.pi * 0.1511 * np.arange(300.0) + k) / 100 for k in range(4)]
    pairs = zip(blocks, slope, strict=True)
    blocks = [replace(b, global_columns=b.global_columns + s[:, None], observed=b.observed + s) for b, s in pairs]
    sigma = delivered(search(blocks, forms, CHOICE, np.random.default_rng(1)), CHOICE, 1).sigma[1][0]
    rows = zip((b.global_columns for b in blocks), forms[50].columns, slope, strict=True)
    whole = [np.column_stack(row) for row in rows]
    free, held = (np.linalg.inv(sum(w[:, :k].T @ w[:, :k] for w in whole))[0, 0] ** 0.5 for k in (3, 2))
    assert sigma == pytest.approx(free, rel=0.05)
    assert free > 1.2 * held


def test_forms_that_the_data_leave_open_are_in_the_error_of_the_calibration():
    """Recovery: of two parameters only the sum is seen, their difference is a shared one; 24 draws of either alone."""
    rng, errors = np.random.default_rng(23), []
    for _ in range(24):
        blocks, _ = made(rng)
        seen = [rng.standard_normal((300, 1)) for _ in blocks]
        both = [(v + b.global_columns, v - b.global_columns) for v, b in zip(seen, blocks, strict=True)]
        true = int(rng.integers(2))
        for block, pair in zip(blocks, both, strict=True):
            block.observed[:] += 20 / np.sqrt(1200) * pair[true][:, 0]
        alone = [[pair[k] for pair in both] for k in (0, 1)]
        forms = [Candidate("case.leak", f"{n} alone", [n], ["1"], c, [0.5]) for n, c in zip("ab", alone, strict=True)]
        whole = [np.concatenate(pair, axis=1) for pair in both]
        forms.append(Candidate("case.leak", "", ["a", "b"], ["1", "1"], whole, [0.5, 0.5]))
        result = delivered(search(blocks, forms, CHOICE, rng), CHOICE, 1)
        assert [f.cause for f in result.findings] == ["case.leak"]
        errors.append((result.shared[1][0] - 1.0) / result.sigma[1][0])
    assert np.max(np.abs(errors)) < 4
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 1.4


def test_what_the_data_do_not_see_of_any_form_is_in_the_error_of_the_calibration():
    """Recovery: the form that is there hides a direction of the calibration, the other none; 30 draws, either last."""
    rng, errors = np.random.default_rng(24), []
    for last in [0, 1] * 15:
        blocks, _ = made(rng)
        seen, other, again = ([rng.standard_normal((300, 1)) for _ in blocks] for _ in range(3))
        leak = rng.choice([-0.5, 0.5])
        for block, column in zip(blocks, seen, strict=True):
            block.observed[:] += 0.5 * column[:, 0] + leak * block.global_columns[:, 0]
        there = [np.concatenate([v, b.global_columns], axis=1) for v, b in zip(seen, blocks, strict=True)]
        absent = [np.concatenate(pair, axis=1) for pair in zip(other, again, strict=True)]
        forms = [Candidate("case.mode", f, ["a", "b"], ["1", "1"], c, [0.5, 0.5])
                 for f, c in (("1.00 Hz", there), ("2.00 Hz", absent))]  # fmt: skip
        result = delivered(search(blocks, forms if last else forms[::-1], CHOICE, rng), CHOICE, 1)
        assert [f.form for f in result.findings] == ["1.00 Hz"]
        errors.append((result.shared[1][0] - 1.0) / result.sigma[1][0])
    assert np.max(np.abs(errors)) < 4
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.4


class Kept(Invented):
    """The same of records that no model changes."""

    def response(self, _):
        """Nothing."""
        return [np.zeros(block.observed.size) for block in self.blocks]


@pytest.mark.parametrize("kind", [Invented, Kept])
def test_the_correction_is_what_the_records_without_the_model_lack(kind):
    """Analytic: nothing where the model takes out all of a cause, all of the move where it takes out none."""
    blocks, (first, *_) = made(np.random.default_rng(5), signal=20.0)
    columns = [c + 0.5 * b.global_columns for c, b in zip(first.columns, blocks, strict=True)]
    hidden = hiding(blocks, [b.global_columns for b in blocks], 10 / np.sqrt(1200))
    found = discover(kind(hidden, [replace(first, columns=columns)]), Limits(0.005, 9.0, 4, 15.0, 1))
    outcome = outcome_of(found)
    assert [one.adopted for one in outcome.findings] == [True]
    assert "/findings/0/heldout" in found["quantity"].values
    assert not {"/findings/0/waves", "/findings/0/parameters/size/correlation"} & {*found["quantity"].values}  # empty
    change = outcome.calibration_change
    assert abs(change.change[0]) > 0.1
    assert change.correction[0] == pytest.approx(0.0 if kind is Invented else change.change[0], abs=1e-9)


def test_readings_that_leave_nothing_to_test_are_refused():
    """Bad input: twelve readings, a model that takes up the only candidate."""
    rows = np.array(["a"] * 12), np.zeros(12, dtype=int), np.arange(12.0)
    line = np.linspace(-1, 1, 12)[:, None]
    short = Block("block 0", np.ones(12), np.zeros((12, 1)), line, *rows)
    taken = Candidate("case.a", "", ["size"], ["1"], [line])
    with pytest.raises(EstimationError, match="12 readings in 1 blocks leave nothing to test"):
        search([short], [taken], CHOICE, np.random.default_rng(1))


def test_a_cause_of_a_few_numbers_is_tested_on_every_second_of_them():
    """Recovery: a delay seen in eight edge times of one block, twenty sigma in all, is held out row by row."""
    rng = np.random.default_rng(9)
    rows = np.array(["timing"] * 8), np.zeros(8, dtype=int), np.arange(8.0)
    observed = rng.standard_normal(8) + 20 / np.sqrt(8)
    block = Block("timing", observed, np.zeros((8, 1)), np.zeros((8, 0)), *rows)
    other, _ = made(rng)
    delay = Candidate("case.delay", "", ["delay"], ["s"], [np.ones((8, 1)), *([None] * len(other))])
    found = search([block, *other], [delay], CHOICE, rng).findings
    assert [f.cause for f in found] == ["case.delay"]
    assert abs(found[0].value[0] - 20 / np.sqrt(8)) < 4 * found[0].sigma[0]


@pytest.mark.parametrize("true", [0.2113, 0.9713])  # Hz, of 1 Hz that the samples could tell
def test_a_line_is_found_between_the_frequencies_of_the_search(true):
    """Recovery: a sine of S/N 60 in two blocks, a third of the spacing off the grid; frequency within 4 sigma."""
    rng, time = np.random.default_rng(21), np.arange(0, 150, 0.5)
    blocks = []
    for k in range(2):
        observed = rng.standard_normal(time.size) + 4.9 * np.sin(2 * np.pi * true * time + k)
        rows = np.array(["linear"] * time.size), np.zeros(time.size, dtype=int), time
        blocks.append(Block(f"block {k}", observed, np.zeros((time.size, 1)), np.ones((time.size, 1)), *rows))
    choice = Choice(0.005, 9.0, 4, "case.step", {"linear": "case.tone"})
    (found,) = search(blocks, [], choice, rng).findings
    assert found.cause == "case.tone"
    for highest, named in ((1, True), (3, False)):  # 0.7 mHz from the third harmonic of a period
        near = replace(choice, periods={3 / (true - 7e-4): highest})
        result = search(blocks, [], near, np.random.default_rng(21))
        assert [one.cause for one in result.findings] == ["case.tone" if named else "unknown:excess"]
        assert result.before.p < choice.level
    assert abs(found.at - true) < 4 * found.at_sigma < 4e-4


def test_what_an_unknown_cause_leaves_gets_no_name():
    """Recovery: a driver follows an effect to a tenth; the rest, like a listed cause at S/N 12, stays unnamed."""
    rng = np.random.default_rng(31)
    blocks, candidates = made(rng)
    driver = [rng.standard_normal((300, 1)) for _ in blocks]
    hidden = hiding(hiding(blocks, driver, 120 / np.sqrt(1200)), candidates[0].columns, 12 / np.sqrt(1200))
    unknown = Candidate("unknown:driver", "itself", ["size"], ["1"], driver)
    found = search(hidden, [*candidates, unknown], CHOICE, rng)
    assert [f.cause for f in found.findings] == ["unknown:driver"]
    assert found.after.p < CHOICE.level


@pytest.mark.parametrize("plausible", [(), (1.0, 1 / 150)])
def test_the_error_of_the_calibration_holds_what_tied_causes_would_make_of_it(plausible):
    """Recovery: twins differ by five times the global column; S/N 15 of the second is named as one of the two.

    What is plausible of the second 150 times less makes it ten times less likely, and excludes it not: 3 sigma.
    """
    rng = np.random.default_rng(41)
    blocks, candidates = made(rng)
    first, size = candidates[0], 15 / np.sqrt(1200)
    first = replace(first, prior=[size * one for one in plausible[:1]])
    columns = [c + 5 * b.global_columns for c, b in zip(first.columns, blocks, strict=True)]
    second = Candidate("case.b", "", ["size"], ["1"], columns, [size * one for one in plausible[1:]])
    plain = search(hiding(blocks, second.columns, size), [first, second], CHOICE, rng)
    assert {"case.a", "case.b"} == {plain.findings[0].cause, *plain.findings[0].tied}
    error = plain.shared[1][0] - 1.0
    assert abs(error - (5 * size * (plain.findings[0].cause == "case.a"))) < 5 * plain.sigma[1][0] + 0.1 * 5 * size
    average = delivered(plain, CHOICE, 1)
    share, limit = (0.25, 4) if plausible else (0.4, 2)
    assert share * 5 * size < average.sigma[1][0] < 5 * size
    assert average.adopted == [False]  # for one would move it by as much as the other would not
    assert abs(average.shared[1][0] - 1.0) < limit * average.sigma[1][0]


@pytest.mark.parametrize(("prior", "held"), [(1.0, (0.0, 0.1)), (1e-4, (1e-5, 1e-4))])
def test_an_unseen_direction_costs_what_the_seen_ones_leave_possible(prior, held):
    """Analytic: beside a silent direction seen to 0.03, or not seen at the size of its prior; other causes as many."""
    blocks, (first, second, _) = made(np.random.default_rng(43))
    leak = [np.concatenate([c, b.global_columns], axis=1) for c, b in zip(first.columns, blocks, strict=True)]
    forms = [Candidate("case.leak", "", ["a", "b"], ["1", "1"], leak, [prior] * 2), replace(second, prior=[prior])]
    result = delivered(search(blocks, forms, CHOICE, np.random.default_rng(1)), CHOICE, 1)
    outcome = summary(result, CHOICE, OFFSET)
    for hidden in outcome.indistinguishable_from_calibration:  # where half a sigma is plausible
        assert np.allclose(np.abs(hidden.bias), prior, rtol=0.1)
        assert unobservable_table(outcome).rows[0][-1] == f"{result.unseen['case.leak'][0]:.2g} m"
    assert held[0] < result.unseen["case.leak"][0] < held[1]
    assert result.unseen["case.b"][0] < 0.1 * held[1]
    added = result.covariance[1][0, 0] - result.covariance[0][0, 0]
    assert np.isclose(added, sum(one[0] ** 2 for one in result.unseen.values()), rtol=1e-6, atol=1e-15)


def test_what_an_extension_leaves_open_keeps_its_value_and_what_the_prior_knows_better_stays_plausible():
    """Analytic: the second of two with correlation -0.93 moves by five of its sigma given the first, which stays.

    Data of 10 and of 0.1 sigma a unit, priors of one: the second shrinks to a hundredth of itself.
    """
    covariance = np.array([[165.0**2, -0.93 * 165 * 13], [-0.93 * 165 * 13, 13.0**2]])
    rest = np.array([10.0, -24.0]) - left_open(np.array([10.0, -24.0]), covariance, np.array([7.0, 3.0]))
    np.testing.assert_allclose(rest, [0.0, -24.0 + 0.93 * 13 / 165 * 10], rtol=1e-9)
    for move, sigma in (([600.0, -60.0], [7.0, 3.0]), ([10.0, -24.0], [100.0, 7.0])):  # seen, and not wider
        assert not left_open(np.array(move), covariance, np.array(sigma)).any()
    normal, true = np.diag([100.0, 0.01]), np.array([30.0, 7.0])
    value, covariance = _held(normal, normal @ true, np.ones(2))
    assert np.allclose(value, [30.0, 7.0 * 0.01 / 1.01])
    assert np.allclose(np.diag(covariance), [0.01, 1 / 1.01])
    assert np.allclose(_held(normal, normal @ [30.0, 70.0], np.ones(2))[0], [30.0, 70.0])  # seen at seven sigma
    turned = np.array([[0.6, -0.8], [0.8, 0.6]])
    other, _ = _held(turned @ normal @ turned.T, turned @ normal @ true, np.ones(2))
    assert np.allclose(other, turned @ value)


def test_rounding_is_no_evidence_whatever_size_a_cause_may_have():
    """Analytic: a direction that the calibration takes up, with a millionth left by rounding, adds nothing."""
    gram, total = np.array([[0, 30, 1e-4], [30, 4, 0], [1e-4, 0, -1e-9]]), np.diag([1.0, 4.0, 1e3])
    evidence = []
    for count in (1, 2):
        one = SimpleNamespace(prior=[1.0] * count)
        problem = SimpleNamespace(places=[slice(1, 1 + count)], candidates=[one], total=total)
        evidence.append(_evidence(problem, gram, 0))
    assert evidence[1] == pytest.approx(evidence[0])
    assert 900 / 4 - 20 < evidence[0][0] < 900 / 4


@pytest.mark.parametrize(("size", "named"), [(-5.0, False), (-0.5, True)])
def test_no_scale_is_negative(size, named):
    """Recovery: at S/N 17 and more; of less than one reversed and twice as strong something else is the cause."""
    blocks, (first, *_) = made(np.random.default_rng(5))
    one = replace(first, cause="accelerometer.scale", names=["x"])
    assert bool(search(hiding(blocks, one.columns, size), [one], CHOICE, np.random.default_rng(1)).findings) == named


def test_noise_is_known_as_well_as_its_spectrum_is_where_a_cause_has_its_power():
    """Analytic: a wave on a knot, 0.2 in the logarithm; a step of five sigma is no cause beside an error of one."""
    time, nothing = np.arange(300.0), np.zeros((300, 1))
    plain = Block.of("swing", np.random.default_rng(3).standard_normal(300), "linear", 0, time, shared=nothing)
    spectra = {"linear": [Spectrum(np.array([0.005, 0.1, 0.5]), np.zeros(3), np.diag([1.5, 0.04, 0.01]))]}
    wave = np.sin(2 * np.pi * 0.1 * time)[:, None]
    assert level_error(prepare([plain], []), np.array([1]), [wave], spectra) == pytest.approx(0.2, rel=0.05)
    step = Candidate("case.step", "", ["size"], ["1"], [np.where(time > 150, 0.5, -0.5)[:, None]])
    blocks = hiding([plain], step.columns, 4.5 * 2 / np.sqrt(300))
    for known in ({}, spectra):
        choice = replace(CHOICE, spectra=known, excess=False)
        assert bool(search(blocks, [step], choice, np.random.default_rng(1)).findings) == (not known)


def test_names_that_describe_the_record_worse_once_taken_out_are_believed_one_at_a_time():
    """Invariant: the next search takes out the first of them alone; what was found stays."""
    blocks, (first, second, _) = made(np.random.default_rng(5))
    hidden, limits = hiding(hiding(blocks, first.columns, 2.0), second.columns, 1.0), Limits(0.005, 9.0, 4, 15.0, 1)
    found = discover(Invented(hidden, [first, second]), limits)
    worse = [np.random.default_rng(k).standard_normal((300, 1)) for k in range(4)]
    again = discover_again(Invented(hiding(blocks, worse, 3.0), [first, second]), limits, found, _model(found))
    assert outcome_of(again) == outcome_of(found)
    assert [one.cause for one in _model(again)] == [one.cause for one in _model(found)][:1] == ["case.a"]
    assert "believed" not in discover_again(Invented(blocks, [first, second]), limits, found, _model(found)).attrs


def test_what_a_first_search_told_apart_stays_so_in_records_without_what_it_found():
    """Invariant: there a second cause looks the same, and is tied in a search that begins with such records."""
    blocks, (first, second, twin) = made(np.random.default_rng(5))
    hidden, limits = hiding(blocks, first.columns, 1.0), Limits(0.005, 9.0, 4, 15.0, 1)
    alike = Invented(blocks, [first, replace(second, columns=twin.columns)])
    alike.worth_another = lambda *_: True
    found = discover(Invented(hidden, [first, second]), limits)
    again = discover_again(alike, limits, found, _model(found))
    alike.blocks = hidden
    for search_, tied in ((again, []), (discover(alike, limits), ["case.b"])):
        assert [(one.cause, one.tied_with) for one in outcome_of(search_).findings] == [("case.a", tied)]


def _drawn(rng, count, draws, quiet, **spectra):
    """Draws of one block of one channel with three coefficients of its noise model."""
    time = np.tile(np.arange(float(count)), 3)
    nothing = np.zeros((time.size, 1))
    words = np.array(["linear"] * time.size), np.repeat([0, 1, 2], count)
    block = Block("one", np.ones(time.size), nothing, nothing, *words, time)
    return drawn_noise(prepare([block], []), draws, quiet, rng, {"linear": 3}, spectra)[0]


def test_noise_measured_in_the_rows_is_whiter_than_noise():
    """Analytic: every draw has variance one and nothing of three neighbours, but as much of the fourth as noise has.

    Of a model of 400 quiet samples each of three coefficients is off by a twentieth, in draw after draw; a spectrum by
    its own error, large at the slow end.
    """
    first = _drawn(np.random.default_rng(6), 400, 200, {})[:400].astype(float)
    assert np.allclose(np.mean(first**2, axis=0), 1, atol=0.03)
    spread = [np.std(np.mean(first[k:] * first[:-k], axis=0)) for k in (1, 2, 3, 4)]
    assert max(spread[:3]) < 0.005 < 0.035 < spread[3] < 0.065
    first = _drawn(np.random.default_rng(5), 4000, 300, {"linear": 400.0})[:4000].astype(float)
    first /= first.std(axis=0)
    spread = [np.sqrt(np.mean(np.mean(first[k:] * first[:-k], axis=0) ** 2)) for k in (1, 2, 3, 4)]
    assert np.allclose(spread[:3], np.hypot(1 / 20, 1 / np.sqrt(4000)), rtol=0.2)
    assert np.allclose(spread[3], 1 / np.sqrt(4000), rtol=0.3)
    known = Spectrum(np.array([0.01, 0.4]), np.zeros(2), np.diag([0.8, 1e-4]))
    first = _drawn(np.random.default_rng(4), 4000, 300, {"linear": 400.0}, linear=[known] * 3)[:4000]
    power = np.abs(np.fft.rfft(first, axis=0)) ** 2 / 4000
    spread = [np.std(np.log(power[part].mean(axis=0))) for part in (slice(1, 40), slice(1601, 2000))]
    assert np.allclose(spread, [np.sqrt(0.8 + 1 / 39), np.sqrt(1e-4 + 1 / 399)], rtol=0.15)


def test_rounding_of_what_looks_like_the_calibration_is_no_sign_of_it():
    """Analytic: a signature of 2e6 sigma within parameters that are nearly alike is not seen, whatever is rounded."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        blocks, columns = [], []
        for k in range(2):
            one, other = rng.standard_normal((2, 300))
            shared = np.stack([one, one + 1e-3 * other], axis=1)
            rows = np.array(["a"] * 300), np.zeros(300, dtype=int), np.arange(300.0)
            blocks.append(Block(f"block {k}", one, shared, np.zeros((300, 0)), *rows))
            columns.append(1e5 * (0.3 * one + 0.7 * other)[:, None])
        alike = Candidate("case.alike", "", ["size"], ["1"], columns, prior=[1.0])
        problem = prepare(blocks, [alike])
        (row,) = beside_calibration(problem, baseline_of(problem, ()), np.ones(2))
        assert row.signal_to_noise == 0.0
        assert row.bias_in_sigma == pytest.approx(np.linalg.norm(np.concatenate(columns)), rel=1e-3)


def test_a_driver_that_moves_the_calibration_further_than_its_error_is_not_adopted():
    """Recovery: S/N 40 along a column that is mostly the shared one; the value stays, the move is in its error."""
    rng = np.random.default_rng(51)
    blocks, (first, *_) = made(rng)
    columns = [c + 2 * b.global_columns for c, b in zip(first.columns, blocks, strict=True)]
    hidden = hiding(blocks, columns, 40 / np.sqrt(1200))
    for cause, adopted in (("unknown:field", False), ("case.a", True)):
        result = search(hidden, [replace(first, cause=cause, columns=columns)], CHOICE, np.random.default_rng(1))
        assert [f.cause for f in result.findings] == [cause]
        found = delivered(result, CHOICE, 1)
        assert found.adopted == [adopted]
        assert abs(((found.shared[1] - 1.0) / found.sigma[1])[0]) < 3
        assert (found.shared[1][0] == found.shared[0][0]) != adopted
        assert (found.sigma[1][0] > 10 * found.sigma[0][0]) != adopted
        waves = [replace(c, means=(0,)) for c in result.problem.candidates]  # of which any mean would be the first
        wide = delivered(replace(result, problem=replace(result.problem, candidates=waves)), CHOICE, 1).covariance[1]
        assert wide[0, 0] - found.covariance[1][0, 0] == pytest.approx(result.findings[0].value[0] ** 2)
        other = result.shared[0] + 0.5 * result.sigma[0]  # of records that a first search has left as they are
        found = delivered(replace(result, shared=(other, result.shared[1])), CHOICE, 1)
        assert (found.shared[1][0] == other[0]) != adopted


def test_of_causes_that_cancel_each_other_one_goes_and_two_lines_stay():
    """Analytic: two columns nearly opposite, a hundred sigma each, five beside each other; lines keep their names."""
    rng = np.random.default_rng(53)
    blocks, (first, second, _) = made(rng)
    near = [c + 0.05 * d for c, d in zip(first.columns, second.columns, strict=True)]
    hidden = hiding(hiding(blocks, first.columns, 100 / np.sqrt(1200)), near, -100 / np.sqrt(1200))
    problem = prepare(hidden, [first, replace(first, cause="case.near", columns=near), second])
    chosen = [(0, None), (1, None)]
    assert len(pruned(problem, chosen)) == 1
    assert pruned(problem, [(0, None), (2, None)]) == [(0, None), (2, None)]
    line = Candidate("accelerometer.stray_tone", "0.1 Hz", ["cosine_0"], ["m s-2"], [np.ones((2, 1))] * 2, apart=True)
    chosen = [(0, None), (1, None)]
    assert merged(SimpleNamespace(candidates=[line, replace(line, form="0.2 Hz")]), chosen, None) == chosen


def test_what_was_known_before_counts_once_and_not_in_every_event():
    """Contract: the evidence of an event for a joint search holds its data alone, and the epochs of its readings."""
    blocks, (first, *_) = made(np.random.default_rng(5))
    first = replace(first, cause="accelerometer.scale", names=["x"], prior=[1.0], form="")
    known = Block.of("known", np.ones(1), "prior", 0, np.full(1, 9e9), shared=np.full((1, 1), 30.0))
    cases = (blocks, first), ([*blocks, known], replace(first, columns=[*first.columns, None]))
    plain, held = (evidence(Invented(rows, [one])) for rows, one in cases)
    assert np.allclose(held["gram"][1:, 1:], plain["gram"][1:, 1:], atol=1e-3)  # less other residuals


def test_limits_say_from_which_size_an_effect_is_named_and_what_it_is_taken_for():
    """Analytic: at a signal-to-noise ratio of 3 to 8, with its double; what looks like the calibration never."""
    blocks, candidates = made(np.random.default_rng(5))
    hidden = Candidate("case.hidden", "", ["size"], ["1"], [2 * b.global_columns for b in blocks], [1.0])
    candidates = [*(replace(one, prior=[1.0]) for one in candidates), hidden]
    observed = SimpleNamespace(blocks=blocks, candidates=candidates, scale=np.ones(1))
    left, said = search(blocks, candidates, CHOICE, np.random.default_rng(1)).after.rest, []
    left = [part[:, None] for part in left]
    rows = {one.cause: one for one in detection_limits(observed, left, CHOICE, said.append)}
    unseen = rows.pop("case.hidden")
    assert (unseen.size, unseen.bias) == (None, [pytest.approx(2.0)])
    assert all(3 <= one.signal_to_noise < 8 and one.confirmed for one in rows.values())
    assert rows["case.a"].size == pytest.approx(rows["case.a"].signal_to_noise / np.sqrt(1200), rel=0.1)
    assert rows["case.a"].confused_with == ["case.twin"]
    assert rows["case.a"].alone_from is None
    assert rows["case.b"].alone_from == pytest.approx(rows["case.b"].size)
    assert len(WORDS.table("limits", {"limits": list(rows.values())}).rows) == 3


def test_a_series_that_comes_near_is_widened_to_the_law_that_is_there_with_its_constant():
    """Recovery: first-order memory of a series with a constant between those tried; three sigma of it."""
    rng = np.random.default_rng(12)
    blocks, (series, *_) = made(rng)
    series = replace(series, cause="unknown:current", form="itself")

    def memory(value):
        """Series behind a memory of so many rows."""
        share = 1 - np.exp(-1 / float(value[0]))
        return [np.apply_along_axis(lambda x: lfilter([share], [1, share - 1], x), 0, c) for c in series.columns]

    def law(tau):
        """Candidate with one constant that is tried."""
        value = np.array([tau])
        shape = Shape(("tau",), ("s",), value, memory, np.array([[0.6], [1.0], [1.6]]) * tau, value / 4, value * 4)
        return replace(series, form=f"memory, tau {tau:g} s", columns=memory(value), shape=shape)

    near = replace(series, wider=Wider(("current",), lambda: [law(1.0), law(4.0), law(16.0)]))
    size = 30.0 / np.linalg.norm(np.concatenate(memory([2.3])))
    result = search(hiding(blocks, memory([2.3]), size), [near], CHOICE, np.random.default_rng(1))
    (found,) = result.findings
    shape = result.problem.candidates[found.index].shape
    assert found.form.startswith("tau 2.")
    assert abs(shape.value[0] - 2.3) < 3 * np.sqrt(shape.covariance[0, 0]) < 0.7
    assert result.after.p > 0.005
    assert sum(one.form.startswith("memory") for one in result.problem.candidates) == 3


def test_steps_to_and_fro_of_one_size_are_a_signal_between_two_levels_and_others_are_steps():
    """Recovery: four jumps in two blocks, of one size and of several: one excess, four bias steps."""
    blocks, _ = made(np.random.default_rng(5))
    blocks, axis = blocks[:2], np.repeat([0, 1, 2], 100)
    time, rows = np.tile(np.arange(100.0), 3), []
    for k, block in enumerate(blocks):
        steps = {
            t + 1000.0 * k: (time[:, None] >= t) * (axis[:, None] == np.arange(3)) * 1.0
            for t in ((30.0, 60.0), (10.0, 30.0, 60.0))[k]
        }
        rows.append(replace(block, axis=axis, time=time + 1000.0 * k, steps=steps))
    several = (9.0, -9.2, 0.0, 9.1, -8.9), (9.0, 6.0, 0.0, -4.0, -12.0)
    for sizes, named in zip(several, (["unknown:excess"], ["case.step"] * 4), strict=True):
        each = iter(sizes)
        hidden = [replace(b, observed=b.observed + sum(next(each) * c[:, 0] for c in b.steps.values())) for b in rows]
        found = search(hidden, [], replace(CHOICE, rounds=6), np.random.default_rng(1)).findings
        assert [one.cause for one in found] == named
