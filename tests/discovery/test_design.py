"""Design of a session: the best of all by brute force, causes told apart, limits, and a flown library."""

import itertools
import json
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flows import calibration
from flows import design as flow
from flows.engine import other_store
from gravcal import catalog
from gravcal.discovery import design
from gravcal.errors import GravcalError
from gravcal.estimation.records import Block, Candidate
from gravcal.simulation import com_offset, kbr_phase_centre
from gravcal.simulation import flight as flight_of
from gravcal.store import configurations


def flight(information, columns=None, prior=1.0):
    """Flight of manoeuvres with given information (k, 3, 3) and whitened columns (k, n, 2) of two causes."""
    k = len(information)
    gram = np.zeros((k, 5, 5))
    gram[:, :3, :3] = information
    if columns is not None:
        gram[:, 3:, 3:] = np.swapaxes(columns, 1, 2) @ columns
    causes, sizes = {"a": slice(3, 4), "b": slice(4, 5)}, {"a": np.array([prior]), "b": np.array([prior])}
    size = np.sqrt(np.diag(gram.sum(axis=0)))
    return design.Flown(np.array(information), gram, np.arange(k), "xyz", "um", np.ones(3), causes, sizes, size)


def test_exchanges_find_the_design_of_least_trace():
    """Against all designs of a small library; covariance by least squares; the best that has room, or a refusal."""
    rng = np.random.default_rng(5)
    columns = rng.standard_normal((2, 40, 3))
    whole = np.concatenate([columns[0], columns[0], columns[1]])  # the first manoeuvre twice
    found = design.covariance(flight(np.swapaxes(columns, 1, 2) @ columns), np.array([2, 1]))
    assert np.allclose(found, np.linalg.inv(whole.T @ whole), rtol=1e-6)
    one = flight([4 * np.eye(3), np.eye(3)])
    assert design.chosen(one, 3, np.full(2, 9), fits=lambda counts: counts[0] <= 2).tolist() == [2, 1]
    with pytest.raises(GravcalError, match="room for 2 manoeuvres"):
        design.chosen(one, 3, np.full(2, 9), fits=lambda counts: counts.sum() <= 2)
    for _ in range(10):
        roots = rng.standard_normal((6, 3, 2)) * rng.uniform(0.3, 3, (6, 3, 1))
        one = flight([root @ root.T for root in roots])
        found = design.chosen(one, 4, np.full(6, 3))
        every = [np.bincount(c, minlength=6) for c in itertools.combinations_with_replacement(range(6), 4)]
        traces = [np.trace(design.covariance(one, counts)) for counts in every if counts.max() <= 3]
    assert np.trace(design.covariance(one, found)) == pytest.approx(min(traces), rel=0.02)


def test_a_design_by_several_draws_is_near_the_best_in_the_worst_of_them():
    """What is not known is drawn: against the design of least trace in the worst draw, and those by one draw alone."""
    rng = np.random.default_rng(6)
    shares = rng.uniform(0.7, 1.4, (3, 6, 1, 1))
    roots = rng.standard_normal((6, 3, 2)) * rng.uniform(0.3, 3, (6, 3, 1)) * shares
    flights = [flight([root @ root.T for root in one]) for one in roots]
    every = [np.bincount(c, minlength=6) for c in itertools.combinations_with_replacement(range(6), 4)]
    trace = lambda one, counts: np.trace(design.covariance(one, counts))  # noqa: E731
    worst = lambda counts: max(trace(one, counts) for one in flights)  # noqa: E731
    whole = design.pooled(flights)
    by_one = [design.chosen(one, 4, np.full(6, 4)) for one in flights]
    counts = design.chosen(whole, 4, np.full(6, 4))
    assert worst(counts) < 1.1 * min(map(worst, every))
    assert all(trace(whole, counts) <= 1.02 * trace(whole, other) for other in by_one)


def test_a_pair_that_one_manoeuvre_leaves_tied_is_told_apart_by_another():
    """The best errors alone would never fly it."""
    alike, different = np.array([[3.0, 3.0], [0.0, 0.0]]), np.array([[1.5, 0.0], [0.0, 1.5]])
    one = flight([4 * np.eye(3), np.eye(3)], np.array([alike, different]))
    assert design.chosen(one, 3, np.full(2, 9)).tolist() == [3, 0]
    needed = design.needed(0.9, 2.0)
    counts = design.chosen(one, 6, np.full(2, 9), [("a", "b")], needed)
    apart = design.judged(one, counts, [("a", "b")])[1][("a", "b")]
    assert counts[1] > 0
    assert apart >= needed
    # fitted by hand: what is left of one cause beside the other
    rows = np.concatenate([alike] * counts[0] + [different] * counts[1])
    left = rows[:, 0] - rows[:, 1] * (rows[:, 0] @ rows[:, 1]) / (rows[:, 1] @ rows[:, 1])
    assert apart == pytest.approx(left @ left)


def test_odds_are_those_of_drawn_likelihood_ratios():
    """At, below and above the limit."""
    rng, tied = np.random.default_rng(7), 9.0
    for chi2 in (6.0, 20.0, 40.0):
        ratios = chi2 + 2 * np.sqrt(chi2) * rng.standard_normal(40000)
        assert design.odds(chi2, tied) == pytest.approx(np.mean(ratios > tied), abs=0.01)
    assert design.odds(design.needed(0.9, tied), tied) == pytest.approx(0.9)
    assert design.odds(0.0, tied) == 0.0


def test_constraints_are_named_and_a_calibration_without_library_is_refused(tmp_path):
    """Both say what there is."""
    path = tmp_path / "limits.toml"
    path.write_text("rod = ['x']\n")
    with pytest.raises(GravcalError, match="rods"):
        flow.constraints("com_offset", path)
    path.write_text("duration_s = 'long'\n")
    with pytest.raises(GravcalError, match="duration_s: found 'long'; expected a number"):
        flow.constraints("com_offset", path)
    with pytest.raises(GravcalError, match="com_offset or inertial_sensor or kbr_phase_centre"):
        flow.designed("gradient_torque", "S", "2026-03-01")
    with pytest.raises(GravcalError, match="an end after each begin"):
        flight_of.windows("02:10-04:00, 07:15-05:40")
    with pytest.raises(GravcalError, match="times of the day"):
        flight_of.windows("two to four")
    path.write_text("parameters = ['x']\n")
    ranging = calibration.load("kbr_phase_centre")
    place = flow.Place(ranging, None, "CD", "", flow.constraints(ranging.name, path), print)
    place.errors = lambda *_, **__: ({"C x": (1.0, 1.0, "mm"), "C y": (1.0, 1.0, "mm")}, {})
    with pytest.raises(GravcalError, match="of C x, C y"):
        place.best(1.0, ())
    place.limits["parameters"], plans = ["C x"], ranging.planning.sessions(place.limits, 6e3)
    known = lambda plan: (float(plans.index(plan)) or None) if plan in plans else None  # noqa: E731
    place.errors = lambda plan, *_, **__: ({"C x": (known(plan), 1.0, "mm"), "C y": (1.0, 1.0, "mm")}, {})
    assert place.best(100.0, ())[0] == plans[1]  # the least error of those that tell what the published one does not
    place.errors = lambda *_, **__: ({"C x": (None, None, "mm"), "C y": (1.0, 1.0, "mm")}, {})
    with pytest.raises(GravcalError, match="none of which tells all"):
        place.best(100.0, ())
    assert not ranging.planning.sessions(place.limits, 4 * 100.0)  # none is longer than the time there is


def test_a_wiggle_turns_as_its_plan_says_and_within_the_limits(tmp_path):
    """Offset, amplitude and period of every sub-manoeuvre; sums and rates of all plans; a day has an end."""
    limits = flow.constraints("kbr_phase_centre") | {"angle_deg": 2.4}
    plans = kbr_phase_centre.sessions(limits, 4 * 1000.0)
    chosen = catalog.parameters("simulate_kbr_phase_centre")
    short = kbr_phase_centre.sessions(limits | {"period_s": [150.0, 250.0]}, 4 * 1000.0)
    assert [flow.period_of(plan) for plan in short] == [150.0] * 6 + [250.0] * 6
    place = flow.Place(calibration.load("kbr_phase_centre"), None, "CD", "", limits, print)
    assert place.chosen(short[0]).period_s == 150.0
    for plan in (plans[0], plans[2]):
        path = tmp_path / "plan.toml"
        path.write_text(flow.plan_text("kbr_phase_centre", plan, "a test"))
        pair = kbr_phase_centre.draw_pair(chosen.with_settings({"design": str(path)}), 0.0, np.random.default_rng(1))
        assert len(pair.wiggles) == 8
        for one, table in zip(pair.wiggles, 2 * [t for t in plan for _ in range(t["count"])], strict=True):
            assert one.kind == table["kind"]
            time = one.start + one.slew + np.arange(table["duration_s"])
            turned = np.degrees(kbr_phase_centre.profile(one, time - one.start))
            assert np.abs(turned).max() <= 2.4 + 1e-9
            assert np.degrees(np.abs(np.diff(np.radians(turned))).max()) <= limits["rate_deg_s"]
            wave = 2 * np.mean(turned * np.sin(2 * np.pi * np.arange(time.size) / 250))
            assert (turned.mean(), abs(wave)) == pytest.approx((table["offset_deg"], table["amplitude_deg"]), abs=0.01)
    printed = chosen.with_settings({"design": "kbr_wiggle_grace"})
    pitch, _, yaw, _ = kbr_phase_centre.draw_pair(printed, 0.0, np.random.default_rng(1)).wiggles[:4]
    assert np.degrees([abs(pitch.amplitude), abs(yaw.amplitude)]) == pytest.approx([1.5, 1.7])
    path.write_text(flow.plan_text("kbr_phase_centre", kbr_phase_centre.sessions(limits, 4 * 5000.0)[0], "a test"))
    with pytest.raises(GravcalError, match="before midnight"):
        kbr_phase_centre.draw_pair(chosen.with_settings({"design": str(path)}), 0.0, np.random.default_rng(1))
    path.write_text(flow.plan_text("kbr_phase_centre", plans[0], "a test"))
    allowed = {"design": str(path), "quiet_s": 600.0, "manoeuvre_windows": "02:00-04:00, 07:00-07:15, 09:00-23:00"}
    pair = kbr_phase_centre.draw_pair(chosen.with_settings(allowed), 0.0, np.random.default_rng(1))
    hours = np.array([[one.start, one.stop] for one in pair.wiggles]) / 3600
    assert np.all((hours[:4] >= 2) & (hours[:4] <= 4))
    assert np.all(hours[4:] >= 9)  # a quarter of an hour is too short for a piece
    assert np.all(hours[1:, 0] - hours[:-1, 1] > 599 / 3600)


def test_manoeuvres_are_between_the_passes_and_apart():
    """All of each in a window, starts as far apart as is asked; numbers that find no time in a day have no room."""
    satellite, table = catalog.satellite("C").settings(), {"kind": "pitch", "period_s": 12.0, "duration_s": 180.0}
    design_of = {"rod": "x", "latitude_deg": [60.0, 80.0], "count": 1}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.toml"
        path.write_text(flow.plan_text("com_offset", [table | design_of], "a test"))
        given = {"design": str(path), "manoeuvre_windows": "02:10-06:00", "manoeuvre_spacing_s": 1800.0}
        chosen = catalog.parameters("simulate_com_offset").with_settings(given)
        share = com_offset.room(satellite, chosen, 0.0)
        path.write_text(flow.plan_text("com_offset", [table | design_of | {"count": 2}], "a test"))
        scene = com_offset.draw_scene(satellite, chosen, 0.0, np.random.default_rng(3))
    assert (share([2]), share([9])) == (1.0, 0.0)  # four hours hold two orbits
    assert np.all((scene.start >= 7800 - 0.5) & (scene.stop <= 21600 + 0.5))  # a start has half a second
    assert np.all(np.diff(scene.start) >= 1800 - 1)


def test_causes_of_a_whole_session_are_told_apart_beside_all_that_is_fitted():
    """By least squares: what is left of one beside the other, the parameter and the drift of each piece."""
    rows = np.random.default_rng(8).standard_normal((2, 60, 4))  # two pieces: parameter, drift, two causes
    rows[:, :, 3] = rows[:, :, 2] + 0.3 * rows[:, :, 3]
    zeros = np.zeros(60, dtype=int)
    blocks = [Block(str(k), rows[k, :, 0], rows[k, :, :1], rows[k, :, 1:2], zeros, zeros, zeros) for k in range(2)]
    causes = [Candidate(n, "", ["a"], ["1"], [*rows[:, :, [2 + k]]], [2.0]) for k, n in enumerate(("one", "other"))]
    observed = SimpleNamespace(name="a test", blocks=blocks, candidates=causes)
    whole = np.zeros((120, 5))
    for k in range(2):
        whole[60 * k : 60 * k + 60, [0, 1 + k, 3, 4]] = rows[k]
    left = [whole[:, t] - whole[:, f] @ np.linalg.lstsq(whole[:, f], whole[:, t])[0]
            for t, f in ((3, [0, 1, 2, 4]), (4, [0, 1, 2, 3]))]  # fmt: skip
    expected = 4 * min(float(one @ one) for one in left)
    assert design.apart(observed, ("one", "other")) == {("one", "other"): pytest.approx(expected)}
    with pytest.raises(GravcalError, match="one of one, other"):
        design.apart(observed, ("none",))


@pytest.mark.long
def test_the_best_of_whole_sessions_is_flown(tmp_path):
    """Of two swings; predicted errors are those that flights achieve."""
    limits = flow.constraints("inertial_sensor") | {"period_s": [27.5], "parameters": ["k y"]}
    one, chosen = calibration.load("inertial_sensor"), configurations.chosen("inertial_sensor", {})
    usual = catalog.parameters("simulate_inertial_sensor")
    louder = {
        n: 1.5 * getattr(usual, n)
        for n in ("voltage_noise_v_rthz", "acceleration_noise_m_s2_rthz", "tracker_noise_rad")
    }
    for day, settings in (("2022-05-17", {}), ("2022-05-18", louder)):
        one.simulate(tmp_path / day, seed=5, settings=settings | {"date": day, "design": one.design})
        one.flow(one.source(event=None, data=tmp_path / day, satellite="T", date=day), chosen)
    made = flow.designed("inertial_sensor", "T", "2026-03-01", limits=limits, verify=2, out=tmp_path)
    assert made["noise"]["of"] == "taiji-t-2022-05-18 (simulated)"
    assert {n: v / louder[n] for n, v in made["noise"]["settings"].items()} == pytest.approx(
        dict.fromkeys(louder, 1), abs=0.1
    )
    assert "noise of taiji-t-2022-05-18" in (tmp_path / "plan.toml").read_text()
    (swing,) = catalog.design(str(tmp_path / "plan.toml")).manoeuvres
    driven = np.array(swing.facts["axes_rate_rad_s"])
    assert (driven > 0).tolist() == [True, True, False]  # a_x = w'_y p_z gives p_z, a_y = -w'_x p_z then k_y
    assert driven.max() <= limits["rate_rad_s"]
    place = list(made["design"]["sigma"]).index("k y")
    assert made["verified"]["sigma"][place] == pytest.approx(made["design"]["sigma"]["k y"], rel=0.25)
    assert made["verified"]["error_rms"][place] < 4 * made["verified"]["sigma"][place]


@pytest.mark.long
def test_errors_of_a_design_grow_with_the_noise_of_the_last_event(tmp_path):
    """Three times as large in a processed day, three times as large the errors, in flights of another period too.

    Saturation of the rods is another dipole gain in all manoeuvres of one current, and is not where two are flown.
    """
    one, chosen = calibration.load("com_offset"), configurations.chosen("com_offset", {})
    one.simulate(tmp_path / "day", seed=5, settings={"noise_scale": 3.0, "manoeuvres": ["pitch_high", "roll_high"]})
    one.flow(one.source(event=None, data=tmp_path / "day", satellite="C", date=None), chosen)
    noise, sigma = flow.noise_of(one, "C", chosen), []
    assert noise["of"] == "grace-c-2020-03-01 (simulated)"
    assert flow.noise_of(one, "D", chosen)["of"] == "the catalogue"
    limits = flow.constraints(one.name) | {"rods": ["x", "y"], "latitude_deg": [60.0, 80.0], "period_s": 8.0}
    causes = "torque.dipole_gain", "torque.saturation"
    assert len(one.planning.library(limits)) == 2
    tables = [table | {"count": 1} for table in one.planning.library(limits, causes)]
    assert [table["current_ma"] for table in tables] == [110.0, 55.0, 110.0, 55.0]
    for settings in ({}, noise["settings"]):
        about = tmp_path, "C", "2026-03-01", limits, print, settings
        with other_store(str(tmp_path / "other")):
            flown = flow.Place(one, *about).flown("flight", tables, 7, causes)
        sigma.append(np.sqrt(np.diag(design.covariance(flown, np.ones(4, int)))))
    assert sigma[1] == pytest.approx(3 * sigma[0], rel=0.05)
    apart = lambda *counts: design.judged(flown, np.array(counts), [causes])[1][causes]  # noqa: E731
    assert apart(2, 0, 1, 0) < 1
    assert apart(1, 1, 1, 0) > 10 * design.needed(0.9, chosen.for_stage("discovery")["tie_chi2"])


@pytest.mark.long
def test_a_small_library_gives_a_plan_that_is_flown(tmp_path, monkeypatch):
    """Predicted errors, of one flight that chooses and one that judges, are those that another achieves."""
    monkeypatch.setattr(flow, "FLIGHTS", 1)
    monkeypatch.setattr(flow, "JUDGES", range(2, 3))
    limits = flow.constraints("com_offset") | {"rods": ["x", "y"], "latitude_deg": [50.0, 80.0]}
    causes = "torque.dipole_gain", "accelerometer.angular_current_leak"
    how = {"minutes": 10.6, "limits": limits, "causes": causes, "verify": 1, "out": tmp_path}
    made = flow.designed("com_offset", "C", "2026-03-01", **how)
    (odds,), (flown,) = made["design"]["separated"], made["verified"]["separated"]
    assert odds["odds"] > 0.99
    assert flown == {"causes": list(causes), "flights": 1, "separated": 1, "falsely": 0}
    plan = catalog.design(str(tmp_path / "plan.toml"))
    assert sum(one.count for one in plan.manoeuvres) == 3
    assert {one.facts["rod"] for one in plan.manoeuvres} == {"x", "y"}  # x alone leaves y open
    assert json.loads((tmp_path / "design.json").read_text()) == made
    assert made["noise"] == {"of": "the catalogue", "settings": {}}
    predicted = np.array(list(made["design"]["sigma"].values()))
    assert np.array(made["verified"]["sigma"]) == pytest.approx(predicted, rel=0.35)  # another orbit
    assert np.all(np.abs(made["verified"]["error_rms"]) < 4 * np.array(made["verified"]["sigma"]) + 10)
