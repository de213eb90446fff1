"""The second simulator judged by itself: conservation, signs, time tags, files."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.signal import welch
from scipy.spatial.transform import Rotation

from . import attitude, earth, make_event, noise, orbit, plan, sensors
from .clocks import Clocks
from .conftest import EXACT, SHORT, table
from .event import World
from .field import field_earth
from .settings import Settings


def body_on_grid(seconds, step, body, q, w, env):
    """Rows of `propagate` with control left alone and a constant environment."""
    t = np.arange(0.0, seconds + step / 2, step)
    n = len(t)
    envs = np.tile(env, (n, 1, 1)), np.tile(env, (n - 1, 1, 1))
    zero, none = np.zeros((n, 3)), (0.0, 0.0, 0.0)
    start = (tuple(q), tuple(w), none, none, none)
    modes, reference, dither = np.zeros(n, int), np.zeros((n, 7)), np.zeros((n, 3))
    rows, _ = attitude.propagate(t, envs, modes, zero, reference, dither, start, body.parts(), (0.25, 0.05))
    return t, rows


def test_dynamics_agree_with_plain_euler_equations():
    """Analytic: field, gravity gradient and torque, against Euler's equations integrated by DOP853."""
    inertia, moment = np.diag([110.49, 580.67, 649.69]), np.array([0.0, 27.0, 0.3])
    gradient = orbit.oblate_gradient(np.array([[4e6, 1e6, 5.4e6]]))[0]
    env = np.concatenate([[[1e-5, -2e-5, 3.5e-5]], gradient, [[1e-6, -2e-6, 3e-6]]])
    q, w = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_quat(scalar_first=True), np.array([1e-4, -1.1e-3, 5e-5])
    t, rows = body_on_grid(60.0, 0.1, attitude.Body(inertia, np.zeros((3, 3)), residual_dipole=moment), q, w, env)

    def flow(_, y):
        turn = Rotation.from_quat(y[:4], scalar_first=True).as_matrix().T
        s = inertia @ turn @ gradient @ turn.T
        s = s - s.T
        torque = np.cross(moment, turn @ env[0]) + [s[2, 1], s[0, 2], s[1, 0]] + env[4]
        spin = np.array([[0, *-y[4:]], [y[4], 0, y[6], -y[5]], [y[5], -y[6], 0, y[4]], [y[6], y[5], -y[4], 0]])
        return np.concatenate([spin @ y[:4] / 2, np.linalg.solve(inertia, torque - np.cross(y[4:], inertia @ y[4:]))])

    other = solve_ivp(flow, (0, 60.0), np.concatenate([q, w]), method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    assert t[-1] == pytest.approx(60.0)
    assert_allclose(rows[-1, :7], other, atol=1e-11)  # rad, rad/s


def test_the_orbit_keeps_its_energy_and_its_gradient_is_a_derivative():
    """Analytic: J2 energy and polar momentum constant; Hessian against differences of the acceleration; trace 0."""
    day = earth.day_start("2020-02-01")
    shape = {"height_m": 490e3, "inclination_deg": 89.0, "eccentricity": 0.0015, "spacing_s": -28.9}
    made = orbit.make_orbit(np.random.default_rng(1), day + 43200, **shape)
    x, y, z, vx, vy, vz = made.solution(np.linspace(0, 86400, 500))
    r = np.sqrt(x**2 + y**2 + z**2)
    bulge = earth.MU * earth.J2 * earth.EQUATOR**2 * (3 * z**2 - r**2) / (2 * r**5)
    energy, polar = (vx**2 + vy**2 + vz**2) / 2 - earth.MU / r + bulge, x * vy - y * vx
    assert_allclose(energy, energy[0], rtol=1e-10)
    assert_allclose(polar, polar[0], rtol=1e-8)  # 1.7 % of the whole momentum
    place, step = np.array([3e6, -2e6, 5.8e6]), 10.0
    up, down = ([orbit.oblate_gravity(place + k * step * e) for e in np.eye(3)] for k in (1, -1))
    gradient = orbit.oblate_gradient(place[None])[0]
    assert_allclose(gradient, (np.array(up) - np.array(down)) / (2 * step), atol=1e-15)  # of 1e-6 s-2
    assert abs(np.trace(gradient)) < 1e-20


def test_the_reading_is_the_force_that_holds_the_proof_mass(exact):
    """Analytic: (M1) against second differences of the inertial path of the proof mass."""
    scene, h = exact["scenes"][0], 0.01
    k = np.flatnonzero((np.diff(scene.t) > 0.02) & (np.abs(scene.current[1:]).max(axis=1) > 100))[50:400:50]
    p = -np.array(exact["offset_um"]) * 1e-6
    w, wd, turn = scene.rate[k], scene.rate_dot[k], scene.rotation[k]
    ahead, behind = (turn * Rotation.from_rotvec(s * h * w + h * h / 2 * wd) for s in (1, -1))
    path = (ahead.apply(p) - 2 * turn.apply(p) + behind.apply(p)) / h**2
    place = scene.world.orbit.solution(scene.t[k])[:3].T
    to = scene.world.orbit.to_gcrs
    pull = [to @ orbit.oblate_gradient(r[None])[0] @ to.T @ x for r, x in zip(place, turn.apply(p), strict=True)]
    extra = turn.inv().apply(path - np.array(pull))
    reading = sensors.truth_at_proof_mass(scene)[k] - scene.world.force(scene.t[k])
    assert np.abs(reading).max() > 1e-10
    assert_allclose(reading, extra, atol=1e-13)  # rounding of second differences


def test_axes_and_signs_of_the_files(event):
    """Contract: SCA1B turns inertial to SRF with z to nadir; GNV1B is GNI1B in the turning frame; axes of ACC1A."""
    sca, inertial, fixed = (table(event, product) for product in ("SCA1B", "GNI1B", "GNV1B"))
    assert_allclose(np.linalg.norm(sca[:, 3:7], axis=1), 1, atol=1e-14)
    turn = Rotation.from_quat(sca[:, 3:7], scalar_first=True).inv()
    down = turn.apply(-inertial[:, 3:6]) / np.linalg.norm(inertial[:, 3:6], axis=1)[:, None]
    assert down[:, 2].min() > 0.999
    assert_allclose(turn.apply(inertial[:, 9:12])[:, 0], -7600, atol=100)  # C leads, m/s
    assert_allclose(*(np.linalg.norm(x[:, 3:6], axis=1) for x in (inertial, fixed)), rtol=1e-14)
    slope = (fixed[2:, 3:6] - fixed[:-2, 3:6]) / 2
    assert_allclose(slope, fixed[1:-1, 9:12], atol=0.01)  # third derivative, 9e-3 m/s
    acc = table(event, "ACC1A")
    assert_allclose(acc[:, 6:9].mean(axis=0), [-1.06e-5, -1.8e-7, -2.8e-7], atol=2e-7)
    assert_allclose(acc[:, 9:12].mean(axis=0), [1.3e-5, 1.19e-4, -7.8e-4], atol=2e-7)


def test_files_have_the_tags_of_the_real_ones(event):
    """Contract: 0.0999910 s rows, torquers at .1 and .6 on board, clocks of the whole day, counts in the header."""
    acc, mag, clk, tim = (table(event, product) for product in ("ACC1A", "MAG1B", "CLK1B", "TIM1B"))
    tags = acc[:, 0] + acc[:, 1] * 1e-6
    steps = np.rint(np.diff(tags) * 1e6)
    assert set(steps) <= {99967, 99968, 99969, 99993, 99994}
    assert steps.mean() == pytest.approx(99991.0, abs=0.2)
    board = (mag[:, 1] * 1e-6 - 0.1) % 1.0
    assert_allclose(np.minimum(abs(board - 0.1), abs(board - 0.6)), 0, atol=2e-3)  # clock drift of a day
    assert len(clk) == 8702
    assert len(tim) == 10800
    assert_allclose(np.abs(tim[:, 3] - tim[:, 0] + tim[:, 4] * 1e-9) % 119e-9, 0, atol=1e-6)
    for product in event["files"]:
        head = Path(event["files"][product]).read_text().split("# End of YAML header")[0]
        assert f"num_records: {len(table(event, product))}\n" in head


def test_currents_and_field_in_the_file(event):
    """Contract: whole steps of current, A positive and B negative, field renewed once a second and near the model."""
    mag = table(event, "MAG1B")
    a, b = mag[:, 7:10], mag[:, 10:13]
    assert a.min() == 0
    assert b.max() == 0
    assert not np.any((a != 0) & (b != 0))
    counts = (a + b) / (220.11 / 4096)
    assert_allclose(counts, np.rint(counts), atol=1e-3)  # float32
    assert 109.9 < a.max() < 110.1
    assert np.mean(np.any(np.diff(mag[:, 4:7], axis=0) != 0, axis=1)) == pytest.approx(0.5, abs=0.02)
    scene = event["scenes"][0]
    model = scene.field[scene.at(mag[:, 0] - scene.world.day + mag[:, 1] * 1e-6 - 1e-6)] * 1e6
    off = mag[:, 4:7] - model - np.array(event["mag_bias_nt"]) * 1e-3
    assert np.abs(off).max() < 0.08  # uT: 1 s of orbital change, noise


def test_edges_are_where_the_truth_says(tmp_path):
    """Contract: period exactly 12 s, the fraction asked for, and each jump of the angular reading at its edge."""
    truth = make_event(tmp_path, 4, start_fraction=0.37, **EXACT)
    wave = truth["manoeuvres"][0]
    edges = np.array(wave["edges"]) - truth["scenes"][0].world.day
    assert len(edges) == 31
    assert_allclose(np.diff(edges), 6.0, atol=1e-9)
    assert_allclose(edges % 1.0, 0.37, atol=1e-9)
    acc, world = table(truth, "ACC1A"), truth["scenes"][0].world
    time = world.clocks.to_gps(acc[:, 0] - world.day + acc[:, 1] * 1e-6)
    jump = np.flatnonzero(np.abs(np.diff(acc[:, 9])) > 1e-6)  # about SRF y
    assert len(jump) == 31
    assert np.all((time[jump] < edges) & (edges <= time[jump + 1] + 1e-6))


def test_clocks_round_trip():
    """Analytic: on-board time of GPS time of a tag is the tag."""
    clocks = Clocks(np.random.default_rng(0), 0.1, -1.5e-8)
    board = np.linspace(10.0, 86000.0, 1000)
    assert_allclose(clocks.to_board(clocks.to_gps(board)), board, atol=1e-9)
    assert_allclose(clocks.to_gps(0.0), 0.1, atol=3e-7)


def test_noise_has_its_density():
    """Recovery: the spectrum of generated noise is the table."""
    series = noise.coloured(np.random.default_rng(0), 2**18, noise.LINEAR)
    for axis, column in zip("xyz", series.T, strict=True):
        f, power = welch(column, 10.0, nperseg=1024)
        band = (f > 0.05) & (f < 4.9)
        ratio = power[band] / noise.density(noise.LINEAR[axis], f[band]) ** 2
        assert ratio.mean() == pytest.approx(1.0, abs=0.03)  # 256 averages, 500 lines


def test_a_seed_gives_the_same_bytes_and_another_seed_others(tmp_path, event):
    """Contract: bytes depend on seed and settings only, and the truth is not among the files."""
    again = make_event(tmp_path / "a", 11, truth_file=str(tmp_path / "truth.json"), **SHORT)
    other = make_event(tmp_path / "b", 12, **SHORT)
    for product, path in event["files"].items():
        assert Path(path).read_bytes() == Path(again["files"][product]).read_bytes()
        assert Path(path).read_bytes() != Path(other["files"][product]).read_bytes()
    assert len(list((tmp_path / "a").iterdir())) == 7
    assert json.loads((tmp_path / "truth.json").read_text())["offset_um"] == [107.0, 4.0, 13.0]


def test_the_seven_manoeuvres_are_in_their_areas():
    """Published: kinds, latitudes and longitudes of the areas; windows apart."""
    for seed in range(3):
        world = World(seed, Settings(satellite="D"))
        waves = world.manoeuvres
        assert sorted(m.kind for m in waves) == ["pitch"] * 3 + ["roll"] * 2 + ["yaw"] * 2
        assert np.diff([m.start for m in waves]).min() > 780
        for m in waves:
            t = np.array([m.start, m.stop])
            x, y, z = world.orbit.solution(t)[:3]
            latitude = np.degrees(np.arctan2(z, np.hypot(x, y)))
            low, high = (60, 80) if m.area == "high" else (8, 22)
            assert np.all((latitude > low) & (latitude < high))
            turn = earth.gcrs_to_earth("2020-02-01", [t.mean()])[0]
            fixed = turn @ world.orbit.position([t.mean()])[0]
            longitude = np.degrees(np.arctan2(fixed[1], fixed[0]))
            off = (longitude - m.longitude_deg + 180) % 360 - 180
            assert abs(off) < 0.5


def test_a_whole_day_is_one_stretch(tmp_path, monkeypatch):
    """Contract: blocks join without lost or double rows, with the attitude held."""
    monkeypatch.setattr(plan, "windows", lambda *_: [(50000.0, 50090.0), (50090.0, 50200.0)])
    truth = make_event(tmp_path, 5, manoeuvres=[], whole_day=True, keep_scenes=True)
    assert_allclose(np.diff(table(truth, "SCA1B")[:, 0]), 1)
    rows = table(truth, "ACC1A")
    assert_allclose(np.diff(rows[:, 0] + 1e-6 * rows[:, 1]), 0.09999, atol=5e-5)
    first, second = truth["scenes"]
    assert_allclose(first.quaternion[-1], second.quaternion[0], atol=1e-15)


@pytest.mark.measured
def test_field_and_frames_give_the_measured_place():
    """Published: IGRF in SRF of C and D at 2023-06-01 00:00:00, from the real orbit and attitude."""
    folder = Path(__file__).parents[3] / "shared" / "data" / "gracefo-2023-06-01"
    for letter, printed in (("C", [12849, 7110, -32103]), ("D", [-13913, -6919, -30971])):
        files = {p: folder / f"{p}_2023-06-01_{letter}_04.txt" for p in ("GNV1B", "GNI1B", "SCA1B")}
        fixed, inertial, sca = (table({"files": files}, p)[0] for p in files)
        turn = earth.gcrs_to_earth("2023-06-01", [0.0])[0]
        assert_allclose(turn @ inertial[3:6], fixed[3:6], atol=0.5)  # m
        field = turn.T @ field_earth("2023-06-01", [0.0], fixed[None, 3:6], generation=14)[0]
        body = Rotation.from_quat(sca[3:7], scalar_first=True).inv().apply(field)
        assert_allclose(body * 1e9, printed, atol=1.0)  # nT, printed to 1; generation 13 is 10 nT off
