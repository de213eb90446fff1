"""Search over many events: laws of causes, ties, contradictions, offsets; how a parameter moves; what is written."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from flows import calibration
from flows import discover as watching
from gravcal.discovery import evidence, joint
from gravcal.effects import effect
from gravcal.estimation import moving
from gravcal.report import joint as report

RNG_LEVEL = 1e-4
DAY_S = 86400.0
SLUGS = ("torque.dipole_gain", "torque.inertia", "accelerometer.current_leak", "torque.residual_dipole")
NAMES = {slug: [p.name for p in effect(slug).parameters][:2] for slug in SLUGS}


def events(rng, law, count=16, alike=0.05, rows=200, size=3.0):
    """Events of two-parameter causes, the second like the first; truth by law(event), prior sizes 0.05."""
    made = []
    for k in range(count):
        columns = size * rng.standard_normal((rows, 3 + 2 * len(SLUGS)))
        columns[:, 5:7] = columns[:, 3:5] + alike * size * rng.standard_normal((rows, 2))
        offset = np.array([1.0 + 0.05 * k, -0.4, 0.1])
        rows_ = columns[:, :3] @ offset + columns[:, 3:] @ law(k) + rng.standard_normal(rows)
        whole = np.column_stack([rows_, columns])
        gram = whole.T @ whole
        causes = [evidence.Cause(slug, "", NAMES[slug], ["1", "1"], np.full(2, 0.05)) for slug in SLUGS]
        day = f"2020-{1 + k // 2:02}-{1 + 14 * (k % 2):02}"
        about = (f"grace-c-{day}", report.seconds(day), np.zeros(3), gram, np.sqrt(np.diag(gram)), causes)
        made.append(evidence.Event(*about, {name: told(k) for name, told in MEASURED.items()}))
    return made


#: Quantities of event k of 16, of size one and of mean none.
MEASURED = {
    "beta_deg": lambda k: float(np.sin(3.0 * k)),
    "latitude_deg": lambda k: float(np.sin(17.0 * k + 2)),
    "fuel_kg": lambda k: float(np.cos(0.5 * k) + 0.5 * np.sin(29.0 * k)),
    "temperature_c": lambda k: float(np.sin(41.0 * k + 1)),
    "year": lambda k: k / 8 - 0.9375,
}


def theta(**values):
    """Values (8,) of all causes, those of some by their number."""
    found = np.zeros(8)
    for name, value in values.items():
        found[int(name[1:])] = value
    return found


LAWS = {
    "constant": lambda _: theta(_4=0.05),
    "epochs": lambda k: theta(_4=0.08 * (k >= 9)),
    "event": lambda k: theta(_4=0.2 * (k == 5)),
    "tied": lambda _: theta(_0=0.05),
    "each": lambda k: theta(_4=0.2 * np.sin(7.0 * k**2 + 1)),
    "contradicted": lambda k: theta(_4=0.05 if k != 6 else -0.1),
    "thrice": lambda k: theta(_4=0.05 if k not in (2, 6, 11) else 0.2),
} | {name: lambda k, told=told: theta(_4=0.06 * told(k)) for name, told in MEASURED.items()}


@pytest.mark.parametrize("scope", ["constant", "epochs", "event", "each", *MEASURED])
def test_a_cause_is_named_with_its_law(scope, rng):
    """Constant, after a change, in one event, different in each, or with what is measured of the events."""
    found = joint.Search(events(rng, LAWS[scope]), 0.005, 9.0, 4).run()
    assert [(SLUGS[one.law.cause], one.law.scope) for one in found.named] == [(SLUGS[2], scope)]
    assert not found.contradicting


def test_nothing_is_named_where_nothing_is_and_offsets_keep_their_errors(rng):
    """Chi-square of all offsets, whose errors no cause widens."""
    found = joint.Search(events(rng, lambda _: theta()), 0.005, 9.0, 4).run()
    assert not found.named
    away = (found.offset - np.array([[1.0 + 0.05 * k, -0.4, 0.1] for k in range(16)])).ravel()
    assert 20 < away @ np.linalg.solve(found.spread.reshape(48, 48), away) < 90


@pytest.mark.parametrize(("delay", "named"), [(0.04, False), (0.113, True)])
def test_an_error_that_all_events_may_share_is_no_cause_and_is_in_its_error(delay, named, rng):
    """Edges alike between two samples of 0.1 s in 16 events: 0.05 s is none, nor a cause that looks like it by half."""
    made, slug = [], "timing.star_camera_delay"
    for k in range(16):
        columns = 4.0 * rng.standard_normal((200, 5))
        columns[:, 4] += columns[:, 3]
        whole = np.column_stack([columns @ [1.0, -0.4, 0.1, delay, 0.0] + rng.standard_normal(200), columns])
        gram = whole.T @ whole
        about = f"grace-c-2020-01-{1 + k:02}", DAY_S * k, np.zeros(3), gram, np.sqrt(np.diag(gram))
        other = evidence.Cause(SLUGS[1], "", NAMES[SLUGS[1]][:1], ["1"], np.array([0.05]))
        made.append(evidence.Event(*about, [evidence.Cause(slug, "", ["delay"], ["s"], np.array([0.1]), 0.05), other]))
    found = joint.Search(made, 0.005, 9.0, 4).run().named
    assert [(one.law.cause, one.law.scope) for one in found] == [(0, "constant")] * named
    if named:
        ((value,),), ((sigma,),) = found[0].value, found[0].sigma
        assert value == pytest.approx(delay, abs=0.04)
        assert 0.05 / np.sqrt(3) < sigma < 0.032  # and 0.009 of noise


def test_events_break_a_tie_that_each_of_them_leaves(rng):
    """Two causes that no single event tells apart are told apart by all, and stay tied where nothing could."""
    (one,) = joint.Search(events(rng, LAWS["tied"], alike=1.0), 0.005, 9.0, 4).run().named
    (tie,) = [row for row in one.ties if row.cause == SLUGS[1]]
    assert (SLUGS[one.law.cause], tie.tied, tie.single < 9 < tie.expected_chi2) == (SLUGS[0], False, True)
    (hard,) = joint.Search(events(rng, LAWS["tied"], alike=0.01), 0.005, 9.0, 4).run().named
    assert [row.cause for row in hard.ties if row.tied] == [SLUGS[1 - hard.law.cause]]


@pytest.mark.parametrize(
    ("law", "days", "values"),
    [("contradicted", ("04-01",), [-0.1]), ("thrice", ("02-01", "04-01", "06-15"), [0.2, 0.2, 0.2])],
)
def test_events_that_contradict_are_named_each_and_move_no_other(law, days, values, rng):
    """They have values of their own: three of sixteen do not make a cause that is different in all."""
    found = joint.Search(events(rng, LAWS[law]), 0.005, 9.0, 4).run()
    assert sorted(row.event for row in found.contradicting) == [f"grace-c-2020-{day}" for day in days]
    (one,) = found.named
    assert one.value[:, 0] == pytest.approx([0.05, *values], abs=0.03)


@pytest.mark.parametrize(("size", "least", "most"), [(5.0, 0.75, 1.4), (0.0, 0.6, 1.1)])
def test_a_moving_parameter_is_foretold_with_its_error(size, least, most, rng):
    """Slope, known step, walk or none; the error of a date left out is that which is stated, in 60 series."""
    score = []
    for _ in range(60):
        time = np.sort(rng.uniform(0, 1000, 12)) * DAY_S
        walk = np.cumsum(rng.standard_normal(12) * size * np.sqrt(np.diff(time, prepend=0) / moving.YEAR_S))
        true = 10 * time / moving.YEAR_S - 100 * (time > 500 * DAY_S) + walk
        value, kept = true + 2 * rng.standard_normal(12), np.arange(12) != 7
        one = moving.moving(time[kept], value[kept], 4.0 * np.eye(11), [500 * DAY_S])
        mean, sigma = one.predicted(time[7:8])
        score.append(float((mean[0] - true[7]) / sigma[0]))
    assert least < np.sqrt(np.mean(np.square(score))) < most


def test_a_step_that_nobody_told_of_is_found(rng):
    """Between the events that it lies between."""
    time = np.arange(12) * 60 * DAY_S
    one = moving.moving(time, 50.0 * (time > 290 * DAY_S) + rng.standard_normal(12), np.eye(12))
    assert one.discovered == [pytest.approx(270 * DAY_S)]


def test_the_model_of_a_satellite_says_when_it_holds(rng, tmp_path):
    """Written, read as any model, with the values of the day; and what a later search changed is said."""
    offset = {"scale": [1e6] * 3, "common": [0.0] * 3, "parameters": ["x", "y", "z"], "unit": "um"}
    made = [replace(one, **offset) for one in events(rng, LAWS["epochs"])]
    products = {one.name: xr.Dataset(attrs={"origin": "simulated"}) for one in made}
    about = {"history": {"trims": [], "printed": []}, "settings": {"configuration": "operational", "left_out": {}}}
    about |= {"calibration": "com_offset", "event": "grace-c", "satellite": "C"}
    _, files = report.report(joint.Search(made, 0.005, 9.0, 4), products, **about)
    contradicted = [replace(one, **offset) for one in events(rng, lambda k: theta(_4=-0.1 if k == 15 else 0.05))]
    _, odd = report.report(joint.Search(contradicted, 0.005, 9.0, 4), products, **about)
    spans = [(one.get("from"), one.get("to")) for one in tomllib.loads(odd["satellite_model.toml"])["effect"]]
    assert spans == [(None, "2020-08-15"), ("2020-08-15", "2020-08-16"), ("2020-08-16", None)]
    path = tmp_path / "satellite_model.toml"
    path.write_text(files["satellite_model.toml"].replace('unit = "1"', 'unit = "m s-2 A-1 m-2"'))
    assert len(tomllib.loads(path.read_text())["predicted"]) > 6
    text, source = calibration.model_text(path), type("Source", (), {"date": "2020-02-01"})
    (early,) = json.loads(calibration.model_of_event(text, source))
    source.date = "2020-08-01"
    (late,) = json.loads(calibration.model_of_event(text, source))
    assert [one["parameters"]["x_from_x"]["value"] for one in (early, late)] == pytest.approx([0.0, 0.08], abs=0.03)
    after = json.loads(files["joint.json"])
    before = after | {"causes": [], "events": after["events"][:-1]}
    assert report.changes(before, after)[0] == "new: accelerometer: current leak, another value after a change"
    assert after["followed"] == sorted(MEASURED)
    assert after["not_followed"] == ["fuel_difference_kg"]
    other = json.loads(json.dumps(after | {"satellite": "D"}))
    assert "values agree (chi-square 0.0 of " in report.shared([after, other])[0]
    other["causes"][0]["values"][1]["parameters"]["x_from_x"]["value"] += 1.0
    assert "values differ" in report.shared([after, other])[0]


def test_a_parameter_follows_the_fuel_where_it_is_told(rng):
    """A coefficient with its error where fuel moves it, none where it does not; dates between have it too."""
    time = np.arange(14) * 60 * DAY_S
    fuel = 27.0 - 0.1 * np.arange(14) + np.cumsum(rng.standard_normal(14) * 0.1)
    noise = 2 * rng.standard_normal(14)
    one = moving.moving(time, 80.0 * fuel + noise, 4.0 * np.eye(14), (), {"fuel_kg": fuel})
    value, sigma = one.terms()
    assert (value[-1] - 80) / sigma[-1] == pytest.approx(0, abs=3.5)
    assert list(one.follows) == ["fuel_kg"]
    assert one.predicted(time[6:7])[0] == pytest.approx(80 * fuel[6], abs=8)
    assert not moving.moving(time, noise, 4.0 * np.eye(14), (), {"fuel_kg": fuel}).follows


def test_fuel_and_temperature_are_read_where_all_tanks_and_thermometers_are_told():
    """Contract: tanks at the time of the event, mean of four thermometers, else nothing; a pair's two letters."""
    tanks = {"gas_mass_tnk1": ("time", [13.0, 12.0, np.nan]), "gas_mass_tnk2": ("time", [11.0, 11.0, 9.0])}
    masses = xr.Dataset(tanks | {"time_tag": ("time", [0.0, 10.0, 20.0])})
    assert evidence.fuel([masses], 5.0) == {"fuel_kg": 23.5, "fuel_difference_kg": 1.5}
    assert evidence.fuel([masses.drop_vars("gas_mass_tnk1")], 5.0) == evidence.fuel([], 5.0) == {}
    read = {name: ("time", [40.0, 20.0 + k, 21.0 + k, np.nan]) for k, name in enumerate(evidence.THERMOMETERS)}
    warm = xr.Dataset(read | {"time_tag": ("time", [0.0, 10.0, 20.0, 30.0])})
    assert evidence.temperature([masses, warm], 5.0, 25.0) == {"temperature_c": 22.0}
    assert evidence.temperature([warm], 25.0, 35.0) == evidence.temperature([masses], 5.0, 25.0) == {}
    names = [watching.owner(calibration.load("kbr_phase_centre"), letters) for letters in ("CD", "C")]
    assert names == ["grace-cd", "grace-c"]
