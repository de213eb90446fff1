"""A routine day: every instrument that has records, measured beside simulated; what is missing is said."""

import commands
import numpy as np
import pytest
import seeds

from gravcal import catalog
from gravcal.calibrations.routine import accelerometer, observations
from gravcal.discovery import driver
from gravcal.errors import NoDataError
from gravcal.estimation.quantities import result_of
from gravcal.io import archive, readers, writers
from gravcal.simulation import com_offset, sensors

CHOSEN = catalog.parameters("routine")
DAY = "2020-03-02"
FILES = ("ACC1A", "SCA1B", "GNV1B", "TIM1B", "CLK1B", "MAG1B", "THR1B")


def aligned(folder, letter="C", day=DAY, files=FILES, **settings):
    """Aligned records of an accelerometer in a folder."""
    observed = [readers.read(archive.find(folder, name, letter, day)) for name in files]
    satellite = catalog.satellite(letter).settings()
    known = {name: satellite[name] for name in ("inertia", "dipole_per_current")}
    known |= {"position_b": satellite["thruster_position"], "force_b": satellite["thruster_force"]}
    return accelerometer.align(*observed, **known, **CHOSEN.for_stage("align") | settings)


def firings(rng, columns, satellite):
    """Columns of THR1B, and ACC1A that has read firings, a leak of currents and twangs; with the true values."""
    time = columns["ACC1A"]["rcvtime_intg"] + 1e-6 * columns["ACC1A"]["rcvtime_frac"]
    start = np.round(time[0] + 60 + np.cumsum(rng.uniform(20, 50, 200)), 3)
    start = start[start < time[-1] - 60]
    pair, on, delay = rng.integers(0, 6, start.size), rng.integers(60, 400, start.size), -1.303
    lever = np.cross(satellite["thruster_position"][:12], satellite["thruster_force"][:12])
    torque = 1.5 * np.linalg.solve(satellite["inertia"], (lever[:6] + lever[6:]).T).T
    force = 3e-8 * rng.standard_normal((6, 3))
    ends = np.stack([time - 0.05, time + 0.05])
    share = np.zeros((time.size, 6))
    for one, k, seconds in zip(start, pair, 1e-3 * on, strict=True):
        inside = np.clip(ends, one, one + seconds)
        share[:, k] += (inside[1] - inside[0]) / 0.1
    added = {"lin": share @ force, "ang": share @ torque}
    twangs = np.sort(rng.uniform(time[100], time[-200], 4))
    for epoch in twangs:
        since = np.maximum(time - epoch, 0.0)
        added["lin"][:, 2] += 1e-7 * np.exp(-since / 3) * np.sin(np.pi * since)
    read = {
        f"{kind}_accl_{a}": columns["ACC1A"][f"{kind}_accl_{a}"] + added[kind][:, i]
        for kind in added
        for i, a in enumerate("xyz")
    }
    fired = sensors.split_time(start + delay)
    fired |= {f"on_time_att_ctrl_{1 + k // 6}_{1 + k % 6}": np.where(pair == k % 6, on, 0) for k in range(12)}
    names = [f"{one}_{axis}" for one in accelerometer.PAIRS for axis in "xyz"]
    true = {f"force_{n}": v for n, v in zip(names, force.ravel(), strict=True)}
    true |= {f"torque_{n}": v for n, v in zip(names, torque.ravel(), strict=True)} | {"delay": delay}
    return {"ACC1A": columns["ACC1A"] | read, "THR1B": fired}, true, twangs


@pytest.fixture(scope="module")
def day(tmp_path_factory):
    """Folder, true values and twangs of 1.5 h of an invented day with firings."""
    return invented(tmp_path_factory.mktemp("routine"), seeds.seed("routine", 1e-4))


def invented(folder, seed):
    """Folder with the files of such a day, true values and twangs."""
    satellite = catalog.satellite("C").settings()
    settings = catalog.parameters("simulate_routine").with_settings({"clock_offset_s": 0.0, "clock_drift": 0.0})
    begin = (np.datetime64(DAY) - np.datetime64("2000-01-01T12:00")) / np.timedelta64(1, "s")
    columns, truth = com_offset.simulate(satellite, settings, begin, seed, {})
    more, true, twangs = firings(np.random.default_rng(seed), columns, satellite)
    for product, values in (columns | more).items():
        writers.write(values, folder / writers.file_name(product, DAY, "C"))
    true |= {f"offset_{a}": 1e-6 * v for a, v in zip("xyz", truth["offset_um"], strict=True)}
    return folder, true, twangs


def test_an_accelerometer_gives_back_what_firings_do(day):
    """Recovery: linear and angular acceleration of six pairs, the delay of their tags, the offset, every twang."""
    folder, true, twangs = day
    found = accelerometer.estimate(aligned(folder), **CHOSEN.for_stage("estimate"))
    known = {
        str(n): k
        for k, n in enumerate(found["parameter"].values)
        if str(n) in true and np.isfinite(found["value"].values[k])
    }
    assert len(known) > 36
    score = np.array([(found["value"].values[k] - true[n]) / found["sigma"].values[k] for n, k in known.items()])
    assert np.sqrt(np.mean(score**2)) < 1.5  # 40 squares of unit mean scatter by 22 %; currents are known once a second
    assert np.abs(score).max() < 6
    for epoch in twangs:
        assert np.abs(found["transient"].values - epoch).min() < 8
    gain = dict(zip(map(str, found["cause"].values), found["gain"].values, strict=True))
    assert gain["unknown:thruster_torque"] > 1e4
    assert gain["accelerometer.current_leak"] < 40  # nine parameters of nothing


@pytest.mark.parametrize(("product", "late"), [("THR1B", 137), ("ACC1A", 137), ("MAG1B", 137)])
def test_records_shifted_against_each_other_name_their_delay(day, tmp_path, product, late):
    """Recovery: tags 137 s late: the delay within its error, the impulses as before; the result is questionable."""
    for path in day[0].iterdir():
        (tmp_path / path.name).symlink_to(path)
    name = writers.file_name(product, DAY, "C")
    columns = {k: v.values for k, v in readers.read(archive.find(tmp_path, product, "C", DAY)).items()}
    (tmp_path / name).unlink()
    tags = next(one for one in ("rcvtime_intg", "time_intg") if one in columns)
    writers.write(columns | {tags: columns[tags] + late}, tmp_path / name)
    if product == "MAG1B":  # whose currents the accelerometer is held against
        found, _ = commands.run("routine", tmp_path, discovery=True)
        assert {one["cause"] for one in found["findings"]} <= {"timing.magnetometer_delay", "unknown:excess"}
        assert "of different times (timing: magnetometer delay 1" in found["parts"]["accelerometer"]["said"]
        return
    found, _ = commands.run("routine", tmp_path, search=0)
    failed = {one["name"] for one in found["checks"] if not one["passed"]}
    assert "accelerometer: tags of firings against readings" in failed
    true = day[1]["delay"] + (late if product == "THR1B" else -late)
    assert found["parameters"]["accelerometer_delay"]["value"] == pytest.approx(true, abs=0.01)


def test_a_day_without_an_instrument_says_what_is_missing(day, tmp_path):
    """Contract: valid document; ranging and thrusters of the day are missing by name, the other two are fitted."""
    for path in day[0].iterdir():
        if not path.name.startswith("THR1B"):
            (tmp_path / path.name).symlink_to(path)
    found, _ = commands.run("routine", tmp_path, search=0)
    status = {name: one["status"] for name, one in found["instruments"].items()}
    assert status == dict(accelerometer="fitted", magnetometer="fitted", thrusters="missing", ranging="missing")
    assert found["instruments"]["thrusters"]["said"] == "no THR1B"
    assert found["instruments"]["ranging"]["said"] == "no KBR1B or LRI1B"
    assert found["instruments"]["magnetometer"]["statistics"][0]["residual_rms"] < 5e-8
    for path in (one for one in tmp_path.iterdir() if one.is_symlink() and not one.name.startswith("SCA1B")):
        path.unlink()
    with pytest.raises(NoDataError, match="no ACC1A or ACT1A; no MAG1B; no THR1B"):
        commands.run("routine", tmp_path, search=0)


@pytest.mark.measured
def test_seconds_of_a_measured_accelerometer_are_fitted():
    """Contract: ten seconds of GRACE-C: noise of a sample as it was measured elsewhere; no firing, so none is named."""
    records = aligned(commands.MEASURED / "gracefo-2023-06-01", day="2023-06-01", step_s=0.1)
    found = accelerometer.estimate(records, **CHOSEN.for_stage("estimate"))
    left = np.nanstd(found["measured"].values - found["fitted"].values, axis=0)
    assert (left[:3] < [1e-8, 1e-8, 1e-8]).all()
    assert (left[3:] < [3e-7, 5e-7, 3e-7]).all()
    force = [str(name).startswith("force") for name in found["parameter"].values]
    assert np.isnan(found["value"].values[force]).all()


def test_a_search_names_in_each_part_what_is_wrong_there(day, tmp_path):
    """Recovery: late tags, 1.5 times the nominal impulse and forces of an accelerometer; ranging is not there."""
    found, _ = commands.run("routine", day[0], discovery=True)
    assert found["parts"]["ranging"] == {"status": "no_data", "said": "no KBR1B or LRI1B"}
    own = {one["cause"]: one["parameters"] for one in found["findings"] if one["part"] == "accelerometer"}
    assert set(own) == {"timing.thruster_delay", observations.FIRINGS, accelerometer.FORCE}
    true = {"delay": day[1]["delay"]} | {f"share_{axis}": 1.5 for axis in "xyz"}
    for name, known in (own["timing.thruster_delay"] | own[observations.FIRINGS]).items():
        assert known["value"] == pytest.approx(true[name], abs=5 * known["sigma"])
    for one in found["parts"]["accelerometer"]["findings"]:
        assert one["heldout_gain"]["chi2"] > 1e4
    page = next(tmp_path.glob("products/latest/*/routine.discovery_report/discovery.html")).read_text()
    assert "Not searched: no KBR1B or LRI1B" in page


@pytest.mark.parametrize("seed", [4, 16])
def test_a_share_of_the_impulse_is_named_before_the_pairs_that_hold_it(tmp_path, seed):
    """Recovery: two days; in one the torque of the pairs was named before, in the other the delay was off by 0.9 ms."""
    folder, true, twangs = invented(tmp_path, seed)
    records = aligned(folder)
    found = accelerometer.estimate(records, **CHOSEN.for_stage("estimate"))
    at = list(map(str, found["parameter"].values)).index("delay")
    assert abs(found["value"].values[at] - true["delay"]) < 4 * found["sigma"].values[at]
    assert found.sizes["transient"] <= len(twangs)
    seen = observations.observe({"align": records, "estimate": found}, **CHOSEN.for_stage("observe"))
    numbers = result_of(driver.discover(seen, driver.Limits(0.005, 9.0, 8, 900.0, 1)))
    named = {one["cause"]: one["tied_with"] for one in numbers["findings"]}
    assert named == {"timing.thruster_delay": [], observations.FIRINGS: [], accelerometer.FORCE: []}


@pytest.mark.parametrize("measured", [False, pytest.param(True, marks=pytest.mark.measured)])
def test_a_transplant_has_a_linear_reading_only(day, tmp_path, measured):
    """Contract: ACT1A, whose angular columns are zero, gives forces (or noise) and no torque."""
    folder, when = (commands.MEASURED / "gracefo-2023-06-01", "2023-06-01") if measured else (tmp_path, DAY)
    if not measured:
        for path in day[0].iterdir():
            (tmp_path / path.name).symlink_to(path)
        read = readers.read(archive.find(day[0], "ACC1A", "C", DAY))
        columns = {name: one.values for name, one in read.data_vars.items()}
        writers.write(
            columns | {f"ang_accl_{a}": 0 * columns["ang_accl_x"] for a in "xyz"}, tmp_path / f"ACT1A_{DAY}_C_04.txt"
        )
    records = aligned(folder, day=when, files=("ACT1A", *FILES[1:]), step_s=0.1 if measured else 1.0)
    found = accelerometer.estimate(records, **CHOSEN.for_stage("estimate"))
    value = dict(zip(map(str, found["parameter"].values), found["value"].values, strict=True))
    assert all(np.isnan(value[name]) for name in value if name.startswith(("torque", "torquer")))
    seen = observations.observe({"align": records, "estimate": found}, **CHOSEN.for_stage("observe"))
    assert {str(block.channel[0]) for block in seen.blocks} == {"linear"}
    if not measured:
        assert value["delay"] == pytest.approx(day[1]["delay"], abs=1e-2)
