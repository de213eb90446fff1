"""Discovery judged by several worlds: what is hidden there, how strong it is, what was said of it.

`python -m benchmarks worlds --calibration NAME --world open|second|own --sort clean|listed|unlisted --runs N --seed S`
makes cases with the forward models beside the project (`../shared/worlds/open`), with the simulator of the tests
(`second`), or with the project's own; searches each and prints the scores that docs/scores.md defines. Every case is a
line of `--out FILE`, and a study goes on where it stopped. `python -m benchmarks folder DIR --out OUT` runs `run` and
`discover` on every case of a folder whose truth is not at hand.
"""

import contextlib
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from scipy import stats

from benchmarks.tables import Figure, say, show

OPEN = Path(__file__).parents[2] / "shared" / "worlds" / "open" / "make_case.py"
FIELD = Path(__file__).parents[2] / "shared" / "worlds" / "fields" / "gravcal-60.gfc"
CALIBRATIONS = {
    "com": "com_offset",
    "second": "com_offset",
    "kbr": "kbr_phase_centre",
    "taiji": "inertial_sensor",
    "swing": "inertial_sensor",
    "roll": "inertial_sensor",
    "sgrs": "gradient_torque",
    "second_kbr": "kbr_phase_centre",
    "second_swing": "inertial_sensor",
    "second_roll": "inertial_sensor",
    "second_sgrs": "gradient_torque",
}
KINDS = {
    ("open", "com_offset"): ("com",),
    ("open", "kbr_phase_centre"): ("kbr",),
    ("open", "inertial_sensor"): ("swing", "roll"),
    ("open", "gradient_torque"): ("sgrs",),
    ("second", "com_offset"): ("second",),
    ("second", "kbr_phase_centre"): ("second_kbr",),
    ("second", "inertial_sensor"): ("second_swing", "second_roll"),
    ("second", "gradient_torque"): ("second_sgrs",),
} | {("own", name): (name,) for name in ("com_offset", "kbr_phase_centre", "inertial_sensor", "gradient_torque")}
#: What an operator of these kinds of cases knows and gives to every command.
KNOWN = dict.fromkeys(("swing", "roll"), ("arm_x_mm=8", "k_y=3e-4"))
KNOWN |= {"sgrs": (f"field={FIELD}",), "second_sgrs": ("field={data}/../field.gfc",)}
STRONG = (15.0, 40.0)  # signal-to-noise ratios that are hidden, log-uniform
LARGEST = 200.0  # times the first guess of a size; what needs more is not seen by these records


@dataclasses.dataclass(frozen=True)
class Hidden:
    """An effect of the open world."""

    causes: tuple[str, ...]  #: slugs of the catalogue that are right; none where the catalogue has none
    draw: object  #: rng -> value at a first guess of the size
    scaled: object = None  #: (value, factor) -> value; by default everything is multiplied
    #: channels, drivers: words of which one has to stand in the cause, form or driver of what was found, for an effect
    #: in no list
    channels: tuple[str, ...] = ()
    drivers: tuple[str, ...] = ()


def axis_of(size):
    """Draw of a vector along one axis or along all."""

    def draw(rng):
        vector = size * rng.standard_normal(3)
        return (vector if rng.integers(2) else vector * np.eye(3)[rng.integers(3)]).tolist()

    return draw


def number(size):
    """Draw of a number of either sign."""
    return lambda rng: float(size * rng.choice([-1, 1]))


def matrix(size, symmetric):
    """Draw of a matrix with one pair off the diagonal."""

    def draw(rng):
        out, (i, j) = np.zeros((3, 3)), ((0, 1), (0, 2), (1, 2))[rng.integers(3)]
        out[i, j] = size * rng.choice([-1, 1])
        out[j, i] = out[i, j] if symmetric else -out[i, j]
        return out.tolist()

    return draw


def of_one(draw):
    """Draw for one of both satellites."""
    return lambda rng: {"CD"[rng.integers(2)]: draw(rng)}


def only(*places):
    """Scaling of some entries of a tuple."""
    return lambda value, factor: [v * factor if k in places else v for k, v in enumerate(value)]


#: Effects of the open world and what the catalogue calls them; settled before the first run. What a calibration
#: itself estimates is not here: `cp` of sgrs (its centre of pressure), `loop_delay` of Taiji (its delay).
EFFECTS = {
    "com": {
        "acc_delay": Hidden(("timing.accelerometer_delay",), number(0.05)),
        "sca_delay": Hidden(("timing.star_camera_delay",), number(0.05)),
        "mtq_gain": Hidden(("torque.dipole_gain",), axis_of(0.01)),
        "mtq_misalign": Hidden(("torque.dipole_misalignment",), axis_of(5e-3)),
        "mtq_lag": Hidden(("torque.dipole_lag",), lambda rng: float(rng.uniform(0.1, 0.6))),
        # cubic in the current, whose size is one: a weaker dipole at full current
        "mtq_saturation": Hidden(
            ("torque.saturation", "torque.dipole_gain"), lambda rng: float(rng.uniform(0.01, 0.05))
        ),
        "inertia": Hidden(("torque.inertia",), axis_of(0.01)),
        "inertia_products": Hidden(("torque.inertia_products",), axis_of(1.0)),
        "angular_scale": Hidden(("accelerometer.angular_scale",), axis_of(0.02)),
        "residual_dipole": Hidden(("torque.residual_dipole",), axis_of(0.2)),
        "drag_torque": Hidden(("torque.constant",), axis_of(1e-5)),
        "eddy": Hidden(("torque.eddy_current",), lambda rng: float(rng.uniform(1e3, 1e4))),
        "current_to_acc": Hidden(("accelerometer.current_leak",), axis_of(1e-8)),
        "acc_cross": Hidden(("accelerometer.cross_talk",), matrix(1e-3, True)),
        "acc_lin_scale": Hidden(("accelerometer.scale",), axis_of(0.01)),
        "acc_quadratic": Hidden(("accelerometer.quadratic",), number(1e4)),
        "flex": Hidden(
            ("accelerometer.flexible_mode",), lambda rng: [float(rng.uniform(0.1, 0.7)), 0.02, 1e-5], only(2)
        ),
        "d_drift": Hidden(("accelerometer.moving_offset",), axis_of(1e-7)),
        "acc_bias_step": Hidden(
            ("accelerometer.bias_step",), lambda rng: [int(rng.integers(3)), 1e-9, float(rng.uniform(30, 150))], only(1)
        ),
        "tone": Hidden(
            ("accelerometer.stray_tone",),
            lambda rng: [float(rng.uniform(0.02, 0.7)), 1e-9, int(rng.integers(3))],
            only(1),
        ),
        # quadratic in the time from the begin of each manoeuvre: a drift of the bias that the catalogue has as a slope
        "temp_ramp": Hidden(("accelerometer.bias_drift", "accelerometer.temperature"), axis_of(1e-13)),
        "mag_leak": Hidden(("magnetometer.current_leak",), lambda rng: (rng.standard_normal((3, 3))).tolist()),
        "mag_bias": Hidden(("magnetometer.bias",), axis_of(300.0)),
        "mag_misalign": Hidden(("magnetometer.misalignment",), axis_of(5e-3)),
        "latitude_force": Hidden((), number(1e-9), None, ("linear",), ("latitude", "argument", "orbit")),
        "current_memory": Hidden((), number(1e-9), None, ("linear",), ("current", "torquer")),
    },
    "kbr": {
        "multipath": Hidden(
            ("ranging.multipath",),
            of_one(
                lambda rng: [
                    *rng.uniform(2e-6, 1e-5, 2).tolist(),
                    float(rng.uniform(150, 600)),
                    float(rng.uniform(0, 6)),
                ]
            ),
            lambda value, factor: {k: [v[0] * factor, v[1] * factor, *v[2:]] for k, v in value.items()},
        ),
        "sca_delay": Hidden(("timing.star_camera_delay",), of_one(number(0.1))),
        "kbr_delay": Hidden(("ranging.delay",), number(1e-4)),
        "sca_misalign": Hidden(
            ("ranging.star_camera_misalignment", "attitude.star_camera_misalignment"), of_one(axis_of(1e-3))
        ),
        "phase_jump": Hidden(
            ("ranging.phase_break",), lambda rng: [int(rng.integers(8)), float(rng.uniform(300, 3400)), 2e-5], only(2)
        ),
        "apc_curvature": Hidden(("ranging.phase_centre_curvature",), of_one(number(0.02))),
        "apc_drift": Hidden(("ranging.phase_centre_drift",), of_one(axis_of(1e-2))),
        "range_scale": Hidden(("ranging.scale",), number(1e-9)),
        "thermal_range": Hidden(
            ("ranging.once_per_revolution", "ranging.thermal", "ranging.slow_orbit_error"),
            lambda rng: [1e-4, float(rng.uniform(0, 6))],
            only(0),
        ),
    },
    "swing": {
        "tracker_misalign": Hidden(("inertial_sensor.tracker_misalignment",), axis_of(5e-3)),
        "quadratic": Hidden(("inertial_sensor.quadratic",), number(0.1)),
        "cross": Hidden(("inertial_sensor.cross_coupling",), matrix(1e-2, True)),
        "bias_drift": Hidden(("inertial_sensor.bias_drift",), number(1e-10)),
        "stiffness": Hidden(("inertial_sensor.stiffness", "accelerometer.stray_tone"), number(1.0)),
        "wheel": Hidden(("accelerometer.stray_tone",), lambda rng: [float(rng.uniform(0.1, 3)), 1e-8], only(1)),
    },
    "sgrs": {
        "misalign": Hidden(("accelerometer.misalignment",), axis_of(1e-4)),
        "dipole": Hidden(("torque.residual_dipole",), axis_of(0.05)),
        "ang_scale": Hidden(("accelerometer.angular_scale",), axis_of(1e-2)),
        "thermal": Hidden(("accelerometer.temperature",), number(1e-11)),
        "field": Hidden(
            ("gradient.tesseral", "gradient.field_scale"),
            lambda rng: {f"{n},{rng.integers(1, n + 1)}": [1e-9, 1e-9] for n in [int(rng.integers(2, 20))]},
            lambda value, factor: {k: [factor * x for x in v] for k, v in value.items()},
        ),
        "lin_scale": Hidden(("accelerometer.scale",), number(1e-4)),
        "drift": Hidden(("accelerometer.bias_drift",), number(1e-14)),
        "tracker": Hidden(("attitude.star_camera_misalignment",), axis_of(1e-4)),
        "place": Hidden(("gradient.mounting",), lambda rng: (1e-5 * rng.standard_normal((2, 3))).tolist()),
        "em_couple": Hidden((), number(1e-4), None, ("linear",), ("linear", "reading")),
    },
}
EFFECTS["roll"] = EFFECTS["swing"].copy()


def jumps(seconds):
    """Draw of axis, size, mean time s between jumps, and number of the series of a random telegraph signal."""
    return lambda rng: [int(rng.integers(3)), 1e-9, seconds, int(rng.integers(2**31))]


def sweep(low, high):
    """Draw of axis, size, first and last frequency Hz of a chirp, which no part of the record takes for a tone."""
    ends = lambda rng: [float(rng.uniform(low, 2 * low)), float(rng.uniform(high / 2, high))]  # noqa: E731
    return lambda rng: [int(rng.integers(3)), 1e-9, *ends(rng)[:: rng.choice([-1, 1])]]


#: Effects in no list that the models of the open world do not have: `put_in` adds them to readings in their files.
ODD = {
    "kbr": {
        "telegraph": Hidden((), jumps(900.0), only(1), ("range",), ("excess",)),
        "chirp": Hidden((), sweep(4e-3, 4e-2), only(1), ("range",), ("excess",)),
        "speed_memory": Hidden((), number(1e-5), None, ("range",), ("rate",)),
    },
    "swing": {
        "telegraph": Hidden((), jumps(15.0), only(1), ("linear",), ("excess",)),
        "chirp": Hidden((), sweep(0.02, 0.4), only(1), ("linear",), ("excess",)),
        "voltage_product": Hidden((), number(1e-8), None, ("linear",), ("angular_acceleration", "voltage")),
        "rate_memory": Hidden((), number(1e-8), None, ("linear",), ("rate",)),
    },
    "roll": {
        "telegraph": Hidden((), jumps(1500.0), only(1), ("roll",), ("excess",)),
        "chirp": Hidden((), sweep(2e-3, 4e-2), only(1), ("roll",), ("excess",)),
        "latitude_force": Hidden((), number(1e-8), None, ("roll",), ("latitude", "argument", "orbit")),
        "reading_squared": Hidden((), number(1e-8), None, ("roll",), ("unknown:reading", "twice the roll angle")),
    },
    "sgrs": {
        "telegraph": Hidden((), jumps(1200.0), only(1), ("linear",), ("excess",)),
        "chirp": Hidden((), sweep(1e-3, 1e-2), only(1), ("linear",), ("excess",)),
        "latitude_force": Hidden((), number(1e-11), None, ("linear",), ("latitude", "argument", "orbit")),
        "drag_memory": Hidden((), number(1e-11), None, ("linear",), ("drag",)),
    },
}
for _kind, _more in ODD.items():
    EFFECTS[_kind] |= _more


def odd(value, *drivers, **settings):
    """Effect of the second world in no list, on the linear accelerometer along y."""
    draw = lambda rng: {"value": {"y": value * float(rng.choice([-1, 1]))}} | settings  # noqa: E731
    return Hidden((), draw, lambda v, factor: v | {"value": {"y": factor * v["value"]["y"]}}, ("linear",), drivers)


EFFECTS["second"] = {
    "odd_field_current": odd(2e-7, "current", "field"),
    "odd_current_squared": odd(1e-13, "current", lag_s=2.0),
    "odd_edge_spike": odd(3e-9, "current", decay_s=0.7, signed=True),
    "odd_hysteresis": odd(1e-11, "current", width_ma=60.0),
    "odd_latitude": odd(1e-9, "latitude", "orbit"),
    "odd_telegraph": odd(1e-9, "time", "excess"),
    "odd_second_hand": odd(1e-9, "time", "frequency", "line"),
    "odd_rate_product": odd(1e-2, "rate", "attitude"),
    "odd_chirp": odd(1e-9, "time", "excess"),
}


def sized(draw, causes=(), *seen):
    """Effect of the second world that is a mapping with its size under "value"; words of channel and driver."""
    sizes = lambda value, factor: value | {"value": _scaled(value["value"], factor)}  # noqa: E731
    return Hidden(causes, draw, sizes, *seen)


def of_angle(size, low, high, name):
    """Draw for what depends on pitch or yaw of one satellite, with a width or period in rad."""
    return lambda rng: {
        "value": size * float(rng.choice([-1, 1])),
        "satellite": "CD"[rng.integers(2)],
        "axis": int(rng.integers(1, 3)),
        "phase": float(rng.uniform(0, 6)),
        name: float(rng.uniform(low, high)),
    }


EFFECTS["second_kbr"] = {
    "multipath": sized(of_angle(1e-6, 0.01, 0.05, "period"), ("ranging.multipath",)),
    "phase_break": sized(
        lambda rng: {"value": 1e-5, "wiggle": int(rng.integers(8)), "after": float(rng.uniform(300, 3400))},
        ("ranging.phase_break",),
    ),
    "star_camera_delay": Hidden(("timing.star_camera_delay",), of_one(number(0.01))),
    "odd_play": sized(of_angle(1e-4, 2e-3, 2e-2, "width"), (), ("range",), ("pitch", "yaw", "angle")),
}
EFFECTS["second_swing"] = EFFECTS["second_roll"] = {
    "quadratic": Hidden(("inertial_sensor.quadratic",), axis_of(0.1)),
    "cross": Hidden(("inertial_sensor.cross_coupling",), matrix(1e-2, True)),
    "tracker_misalignment": Hidden(("inertial_sensor.tracker_misalignment",), axis_of(5e-3)),
    "odd_telegraph": sized(
        lambda rng: {"value": axis_of(3e-9)(rng), "rate_hz": float(rng.uniform(0.02, 0.1))},
        (), ("linear",), ("time", "excess"),
    ),
}  # fmt: skip
EFFECTS["second_sgrs"] = {
    "misalignment": Hidden(("accelerometer.misalignment",), axis_of(1e-3)),
    "residual_dipole": Hidden(("torque.residual_dipole",), axis_of(0.1)),
    "mounting": Hidden(("gradient.mounting",), lambda rng: (1e-3 * rng.standard_normal((2, 3))).tolist()),
    "odd_rectified": Hidden((), axis_of(1e-3), None, ("linear",), ("linear", "reading", "drag")),
}
#: Families of the catalogue that act on the records of a calibration; what is no effect of a simulated event is not
#: drawn: the calibration's own parameters, and what another record holds.
OWN = {
    "com_offset": ("timing", "torque", "accelerometer", "magnetometer"),
    "kbr_phase_centre": ("ranging", "timing"),
    "inertial_sensor": ("inertial_sensor",),
    "gradient_torque": ("gradient",),
}
NOT_DRAWN = ("accelerometer.offset", "ranging.phase_centre", "ranging.antenna_correction", "timing.thruster_delay")
FIXED = ("time", "frequency", "phase", "damping", "period")
FIRST = {"tau": 0.3, "damping": 0.02, "phase": 1.0, "limit": 27.0, "period": 0.021}


def own(calibration: str) -> dict[str, Hidden]:
    """Effects of the catalogue with plausible sizes, by slug.

    Parameters
    ----------
    calibration : name
    """
    from gravcal.effects import catalogue

    known = {s: e for s, e in catalogue().items() if s.partition(".")[0] in OWN[calibration] and s not in NOT_DRAWN}
    return {slug: _own(entry) for slug, entry in known.items()}


def _own(entry):
    """A plausible size of one parameter or of all, the whole strength scaled."""

    def draw(rng):
        values = {p.name: FIRST.get(p.name, float(p.prior_sigma * rng.standard_normal())) for p in entry.parameters}
        sizes = sorted(set(values) - {*FIXED, "tau", "limit"})
        kept = sizes if rng.integers(2) or not sizes else [sizes[rng.integers(len(sizes))]]
        values = {n: v for n, v in values.items() if n in kept or n not in sizes}
        values |= {"frequency": float(rng.uniform(0.02, 0.7))} if "frequency" in values else {}
        return {f"{entry.slug}.{name}": value for name, value in values.items()}

    def scaled(values, factor):
        return {n: v if n.rpartition(".")[2] in (*FIXED, "limit") else factor * v for n, v in values.items()}

    return Hidden((entry.slug,), draw, scaled)


def effects_of(kind: str) -> dict[str, Hidden]:
    """Effects that can be hidden in a kind of case, by name."""
    return EFFECTS[kind] if kind in EFFECTS else own(kind)


def make(kind: str, seed: int, effects: dict, folder: Path) -> dict:
    """Files of a case in `folder`/data; its truth.

    Parameters
    ----------
    kind : one of `KINDS`: of the open world, of the second, or a calibration for the project's own
    seed : int
    effects : {name: value}
    folder : where the case is made
    """
    if kind.startswith("second"):
        tests = str(Path(__file__).parents[1] / "tests")
        sys.path[:0] = [] if tests in sys.path else [tests]
        from independent import gradient, make_event, ranging, taiji

        maker, lengths = {
            "second": (make_event, {"window_s": (420.0, 420.0)}),
            "second_kbr": (ranging.make_campaign, {}),
            "second_swing": (taiji.make_event, {"roll_s": 0.0}),
            "second_roll": (taiji.make_event, {"roll_s": 27500.0}),
            "second_sgrs": (gradient.make_day, {"duration_s": 20000.0}),
        }[kind]
        return maker(folder / "data", seed, effects=effects, **lengths)
    if kind in OWN:
        values = {name: value for entries in effects.values() for name, value in entries.items()}
        words = [word for name, value in values.items() for word in ("--effect", f"{name}={value}")]
        target = folder / "truth.json"
        command = [
            sys.executable,
            "-m",
            "flows.cli",
            "simulate",
            kind,
            "--out",
            str(folder / "data"),
            "--seed",
            str(seed),
        ]
        subprocess.run([*command, "--truth", str(target), *words], check=True, capture_output=True)
        return json.loads(target.read_text())
    more = {name: value for name, value in effects.items() if name in ODD.get(kind, ())}
    words = [w for n, v in effects.items() if n not in more for w in ("--effect", f"{n}={json.dumps(v)}")]
    command = [sys.executable, str(OPEN), kind, "--seed", str(seed), *words, "--out", str(folder)]
    subprocess.run(command, check=True, capture_output=True)
    truth = json.loads((folder / "truth.json").read_text())
    for name, value in more.items():
        put_in(kind, folder / "data", name, value, truth)
    return truth


def put_in(kind: str, data: Path, name: str, value, truth: dict) -> None:
    """Add an effect of `ODD` to the last day of files: to range, or one axis of linear readings, of S-GRS of sensor 1.

    Parameters
    ----------
    kind : "kbr", "swing", "roll" or "sgrs"; data : folder of the files, changed; truth : of the case
    name, value : of the effect
    """
    import xarray as xr

    if kind == "kbr":
        (path,) = data.glob("KBR1B_*")
        head, mark, body = path.read_text().partition("# End of YAML header\n")
        rows = [line.split(" ") for line in body.splitlines()]
        time, _, rate = np.array([row[:3] for row in rows], dtype=float).T
        added = _odd_reading(name, value, time, None, ({"rate": rate}, truth))
        for order in range(3):  # range, rate and acceleration
            for row, more in zip(rows, added, strict=True):
                row[1 + order] = repr(float(row[1 + order]) + float(more))
            added = np.gradient(added, time)
        path.write_text(head + mark + "".join(" ".join(row) + "\n" for row in rows))
        return
    path = sorted(data.glob("SGRS_*" if kind == "sgrs" else "IS1_*"))[-1]
    with xr.open_dataset(path) as opened:
        record = opened.load()
    time, axis = record["time"].values, value[0] if isinstance(value, list) else 2
    with xr.open_dataset(path.with_name(path.name.replace("IS1", "ORB"))) as opened:  # of S-GRS the file itself
        place = np.stack([np.interp(time, opened["time"], one) for one in opened["position"].values.T], axis=1)
    added = _odd_reading(name, value, time, place, (record, truth))
    if kind == "sgrs":
        record["linear"].values[:, 0, axis] += added
    else:
        volt = added / truth["k"][axis]
        for electrode, share in ({"V_x1": 4, "V_x2": 4, "V_x3": 4}, {"V_y": 1}, {"V_z1": 2, "V_z2": 2})[axis].items():
            record[electrode].values[:] += volt / share
    record.to_netcdf(path)


def _odd_reading(name, value, time, place, about):
    """What an effect of `ODD` adds to a reading, (n,) m s-2, or m to a range."""
    since, (record, truth) = time - time[0], about
    if name == "telegraph":
        rng = np.random.default_rng(value[3])
        edges = np.cumsum(rng.exponential(value[2], int(4 * since[-1] / value[2]) + 20))
        return value[1] * np.where(np.searchsorted(edges, since) % 2, 1.0, -1.0)
    if name == "chirp":
        return value[1] * np.sin(2 * np.pi * (value[2] + (value[3] - value[2]) * since / since[-1] / 2) * since)
    if name == "speed_memory":  # 300 s, of the square of the range rate
        return value * _remembered(record["rate"] ** 2, since, 300.0)
    if name == "latitude_force":
        sine = place[:, 2] / np.linalg.norm(place, axis=1)
        return value * 4 * sine**2 * (1 - sine**2)  # square of the sine of twice the latitude
    if name == "drag_memory":  # 400 s, of the flight direction
        return value * _remembered(-record["linear"].values.mean(axis=1)[:, 0], since, 400.0)
    angular = (record["V_z1"] - record["V_z2"]).values, (record["V_x2"] - record["V_x3"]).values
    if name == "voltage_product":
        product = (angular[0] - angular[0].mean()) * (angular[1] - angular[1].mean())
        return value * product / np.abs(product).max()
    if name == "rate_memory":  # 20 s, of the size of the rate about x
        swung = (time >= truth["start"]) & (time <= truth["start"] + 191.0)
        rate = np.cumsum(np.where(swung, angular[0] - angular[0][swung].mean(), 0.0))
        return value * _remembered(np.abs(rate), since, 20.0)
    reading = record["V_x1"].values * 2 + record["V_x2"].values + record["V_x3"].values
    reading = reading - np.median(reading)
    return value * reading**2 / np.percentile(reading**2, 99)


def _remembered(series, since, tau):
    """Running mean (n,) of a series with exponential memory, largest value one."""
    from scipy.signal import lfilter

    share = (since[1] - since[0]) / tau
    out = lfilter([share], [1, share - 1], series - series[0])
    return out / np.abs(out).max()


def known(kind: str, data: Path) -> dict[str, str]:
    """Settings that an operator of a kind of cases gives to every command."""
    return dict(word.format(data=data).split("=", 1) for word in KNOWN.get(kind, ()))


def gravcal(command: str, kind: str, data: Path, out: Path) -> dict:
    """Document of a command on the files of a folder, {"exit", "said"} where it wrote none.

    Parameters
    ----------
    command : "run" or "discover"
    kind : of the case
    data : folder of Level-1 files
    out : file for the document
    """
    words = ["-m", "flows.cli", command, CALIBRATIONS.get(kind, kind), "--data", str(data)]
    words += [word for pair in known(kind, data).items() for word in ("--set", "=".join(pair))]
    done = subprocess.run(
        [sys.executable, *words, "--engine", "inline", "--json", str(out)], capture_output=True, text=True, check=False
    )
    if not out.exists():
        out.write_text(json.dumps({"status": "failed", "said": done.stderr.strip()[-2000:]}, indent=1) + "\n")
    return json.loads(out.read_text()) | {"exit": done.returncode}


def folder(options) -> list[Figure]:
    """Run and discover every case of a folder; documents `KIND-NN.run.json` and `KIND-NN.json`, refusals too."""
    cases = sorted(path for path in Path(options.folder).iterdir() if path.is_dir())
    out = Path(options.out or "benchmarks/sealed")
    out.mkdir(parents=True, exist_ok=True)
    jobs = [(str(case), str(out), command) for case in cases for command in ("run", "discover")]
    with ProcessPoolExecutor(options.workers) as pool:
        for line in pool.map(_of_folder, jobs):
            say(line)
    return []


def _of_folder(job):
    """Document of one command on one case, and a line on it."""
    case, out, command = Path(job[0]), Path(job[1]), job[2]
    kind = case.name.partition("-")[0]
    target = out / f"{case.name}{'.run' if command == 'run' else ''}.json"
    target.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory() as store:
        os.environ["GRAVCAL_PRODUCTS"] = store
        begun = time.monotonic()
        document = gravcal(command, kind, case, target)
    named = ", ".join(one["cause"] for one in document.get("findings", ()))
    return f"{case.name} {command}: {document['status']} ({document['exit']}), {time.monotonic() - begun:.0f} s {named}"


#: What the open world calls a truth, and what the other two call it.
ALIASES = {
    "d_um": "offset_um",
    "c_mm": "phase_centre_mm",
    "cp": "centre_of_pressure_m",
    "p_um": "com_to_test_mass_um",
}


def truth_of(kind: str, truth: dict, epoch: float | None = None) -> dict[str, float]:
    """True values of what the document of a discovery calls its parameters, in the units of that document.

    Parameters
    ----------
    kind : of the case
    truth : its file
    epoch : s, GPS, that the document states for phase centres and biases that move
    """
    calibration = CALIBRATIONS.get(kind, kind)
    kept = {name: truth[own] for name, own in ALIASES.items() if own in truth} | truth
    if kind == "com":  # of an offset that moves there from each begin on: at the middle of the manoeuvres
        middle = (truth["manoeuvres"][0]["stop"] - truth["manoeuvres"][0]["start"]) / 2
        moved = 1e6 * middle * np.array(truth["effects"].get("d_drift", np.zeros(3)))
        return dict(zip("xyz", (kept["d_um"] + moved).tolist(), strict=True))
    if calibration == "com_offset":
        return dict(zip("xyz", kept["d_um"], strict=True))
    if calibration == "kbr_phase_centre":
        both = zip("ab", kept["c_mm"].values(), strict=True)
        found = {f"{a}_{letter}": value for letter, vector in both for a, value in zip("xyz", vector, strict=True)}
        speed, begin = _drift(kind, truth)
        return {name: value + speed.get(name, 0.0) * ((epoch or begin) - begin) for name, value in found.items()}
    if calibration == "gradient_torque":
        return {f"centre_of_pressure_{axis}": 1e3 * value for axis, value in zip("xyz", kept["cp"], strict=True)}
    since = (epoch + 43200.0) % 86400 - 3600.0 if epoch else 0.0  # a record of the open world begins at one o'clock
    rise = truth["effects"].get("bias_drift", 0.0) * since  # of the readings
    biases = np.array(kept["bias"]) - rise * np.array([1.0, 0.0, 1.0])
    vectors = {"offset": kept["p_um"], "bias": (1e9 * biases).tolist()}  # nm s-2
    found = {f"{name}_{axis}": v for name, vector in vectors.items() for axis, v in zip("xyz", vector, strict=True)}
    found["k_y"] = 1e6 * kept["k"][1]  # 1e-6 m s-2 V-1
    return found | {"beta_x": 1e6 * kept["beta"][0], "beta_yz": 1e6 * kept["beta"][1]}  # 1e-6 rad s-2 V-1


def _drift(kind, truth):
    """Speeds of phase centres, mm s-1 by name, and the epoch from which on they move, GPS s."""
    if kind == "kbr":  # from the begin of the record on, 5400 s before the first manoeuvre
        moved = zip("ab", "CD", strict=True)
        given = truth["effects"].get("apc_drift", {})
        speed = {f"{a}_{k}": 1e3 * v / 86400 for k, s in moved for a, v in zip("xyz", given.get(s, ()), strict=False)}
        return speed, truth["manoeuvres"][0]["start"] - 5400.0
    given = truth["effects"].get("ranging.phase_centre_drift", {})  # from noon on
    return {name: 1e3 * value for name, value in given.items()}, truth["day"] + 43200.0


def scored(kind: str, sort: str, hidden: str, document: dict, truth: dict) -> dict:
    """Scores of one case as the contract defines them.

    Parameters
    ----------
    kind, sort : of the case: "clean", "listed" or "unlisted"
    hidden : name of the effect, "" for none
    document : of `gravcal discover`
    truth : of the case

    Returns
    -------
    scores : "named", "right", "alone", "wrong", "noticed", "adequate", "channel"; "before", "after" error over sigma by
        parameter; "sigma" and "harm"
    """
    effect = effects_of(kind).get(hidden)
    findings = [(one["cause"], one["tied_with"], one) for one in document.get("findings", ())]
    causes = effect.causes if effect else ()
    sets = [{cause, *tied} for cause, tied, _ in findings]
    fitting = [s for s in sets if s & set(causes) and len(s) <= 3]
    untied = [cause for cause, tied, _ in findings if not tied]
    catalogue = [cause for cause in untied if not cause.startswith("unknown:")]
    row = {
        "named": [[cause, *tied] for cause, tied, _ in findings],
        "right": bool(fitting),
        "alone": any(cause in causes for cause in untied),
        "wrong": [cause for cause in (catalogue if sort == "unlisted" else untied) if cause not in causes],
        "noticed": bool(findings) or document.get("p_before", 1.0) < document.get("level", 0.005),
        "adequate": document.get("adequate_after"),
        "status": document["status"],
    }
    if sort == "unlisted":
        words = [" ".join([cause, str(one.get("form", "")), str(one.get("channel", ""))]) for cause, _, one in findings]
        row["channel"] = any(
            any(c in w for c in effect.channels) and any(d in w for d in effect.drivers) for w in words
        )
    change = document.get("calibration_change") or {}
    return row | _result(change, truth_of(kind, truth, change.get("epoch")))


def _result(change, true):
    """Error over sigma of the delivered values before and after the search, and where it did harm."""
    found = {"before": {}, "after": {}, "widening": {}, "harm": []}
    columns = [change.get(name, ()) for name in ("names", "before", "sigma_before", "after", "sigma_after")]
    for name, before, sigma_before, after, sigma_after in zip(*columns, strict=True):
        if name not in true or None in (before, sigma_before, after, sigma_after) or not sigma_before * sigma_after:
            continue
        found["before"][name] = (before - true[name]) / sigma_before
        found["after"][name] = (after - true[name]) / sigma_after
        found["widening"][name] = sigma_after / sigma_before
        if abs(after - true[name]) - abs(before - true[name]) > sigma_before:
            found["harm"].append(name)
    return found


def study(options) -> list[Figure]:
    """Scores of a study, its cases added to a file of lines."""
    options.world = options.world or "open"
    if options.world == "open" and not OPEN.exists():
        say(f"{OPEN} is not at hand")
        return []
    out = Path(options.out or f"build/worlds-{options.calibration}-{options.world}.jsonl")
    out.parent.mkdir(parents=True, exist_ok=True)
    done = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    known = {(row["kind"], row["sort"], row["seed"]) for row in done}
    kinds = KINDS[options.world, options.calibration]
    cases = [(kinds[n % len(kinds)], options.sort, options.seed + n) for n in range(options.runs or 40)]
    with ProcessPoolExecutor(options.workers) as pool:
        for row in pool.map(_case, [case for case in cases if case not in known]):
            done.append(row | {"commit": _commit()})
            with out.open("a") as lines:
                lines.write(json.dumps(done[-1]) + "\n")
            say(_line(row))
    return [
        figure
        for sort in ("clean", "listed", "unlisted")
        for figure in figures([r for r in done if r["sort"] == sort], sort)
    ]


def _commit():
    """Commit of the code that was judged."""
    return subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
    ).stdout.strip()


def _line(row):
    """A case in a line."""
    if "error" in row:
        return f"  {row['kind']} {row['seed']}: {row['error']}"
    worst = max(map(abs, row["after"].values()), default=float("nan"))
    named = "; ".join(" = ".join(one) for one in row["named"]) or "nothing"
    return (
        f"  {row['kind']} {row['seed']} {row['hidden'] or 'clean'} (S/N {row['ratio']:.0f}): {named}; {worst:.1f} sigma"
    )


def _case(job):
    """One case: made, searched, scored."""
    kind, sort, seed = job
    head = {"kind": kind, "sort": sort, "seed": seed}
    with _place() as place:
        try:
            return head | _judged(kind, sort, seed, place)
        except (subprocess.CalledProcessError, ValueError) as error:
            return head | {"error": f"{type(error).__name__}: {getattr(error, 'stderr', b'') or error}"[-300:]}


@contextlib.contextmanager
def _place():
    """Folder with a product store of its own."""
    with tempfile.TemporaryDirectory(prefix="worlds-") as place:
        os.environ["GRAVCAL_PRODUCTS"] = f"{place}/store"
        yield Path(place)


def _judged(kind, sort, seed, place):
    """Scores of a case with the effect that was drawn for it."""
    plain = make(kind, seed, {}, place / "plain")
    hidden, value, ratio, truth, data = "", None, 0.0, plain, place / "plain" / "data"
    if sort != "clean":
        rng = np.random.default_rng([seed, 22])
        names = sorted(n for n, e in effects_of(kind).items() if bool(e.causes) == (sort == "listed"))
        quiet = observed_of(kind, data)
        for attempt in range(8):
            hidden = names[rng.integers(len(names))]
            wanted = float(np.exp(rng.uniform(*np.log(STRONG))))
            found = _strong(kind, seed, hidden, wanted, (rng, quiet, place / f"try-{attempt}"))
            if found:
                value, ratio, truth, data = found
                break
        else:
            raise ValueError("no effect of eight reaches the signal-to-noise ratio")
    document = gravcal("discover", kind, data, place / "found.json")
    return {"hidden": hidden, "value": value, "ratio": ratio} | scored(kind, sort, hidden, document, truth)


def _strong(kind, seed, hidden, wanted, about):
    """Value, ratio, truth and files of an effect near the wanted ratio, None where these records do not see it."""
    rng, quiet, place = about
    effect = effects_of(kind)[hidden]
    scale = effect.scaled or _scaled
    value = start = effect.draw(rng)
    total = 1.0
    for attempt in range(4):
        truth = make(kind, seed, {hidden: value}, place / str(attempt))
        data = place / str(attempt) / "data"
        changed = observed_of(kind, data)
        ratio = signal_to_noise(quiet.blocks if quiet else [], rows_of(changed, quiet))
        if 0.8 * wanted < ratio < 1.25 * wanted:
            return value, ratio, truth, data
        total *= wanted / max(ratio, wanted / 50)
        if not 1 / LARGEST**2 < total < LARGEST:
            return None
        value = scale(start, total)
    return None


def _scaled(value, factor):
    """Value with every number of it multiplied."""
    if isinstance(value, list):
        return [_scaled(one, factor) for one in value]
    if isinstance(value, dict):
        return {name: _scaled(one, factor) for name, one in value.items()}
    return value * factor


def observed_of(kind: str, data: Path):
    """Observations that a search of the files of a folder sees; None where there is nothing to see.

    Parameters
    ----------
    kind : of the case
    data : folder of Level-1 files
    """
    import importlib

    from flows import calibration as calibrations
    from gravcal import catalog
    from tasks.stage import read

    calibration = CALIBRATIONS.get(kind, kind)
    one = calibrations.load(calibration)
    source, chosen = one.source(data=data), catalog.parameters(calibration).with_settings(known(kind, data))
    products = {name: read(ref) for name, ref in one.discovery.baseline(source, chosen).items()}
    limits = chosen.for_stage("discovery")
    fixed = ("discovery_level", "tie_chi2", "round_limit", "segment_s", "discovery_seed", "heldout_s")
    settings = one.discovery.settings(source, chosen) | {n: v for n, v in limits.items() if n not in fixed}
    return importlib.import_module(one.discovery.observations).observe(products, **settings)


def rows_of(observed, like) -> list:
    """Blocks of observations whitened with the noise of others: a strong effect changes what the noise is measured as.

    Parameters
    ----------
    observed, like : of `observed_of`
    """
    from gravcal.estimation import noise

    if not (observed and like):
        return observed.blocks if observed else []
    if like.name == "com_offset":
        observed.noise.update(like.noise)
    elif like.name == "kbr_phase_centre":
        observed.__dict__["factors"] = like.factors
    swing, roll = (getattr(observed, name, None) for name in ("swing", "roll"))
    if swing and like.swing:
        swing = dataclasses.replace(swing, record=dataclasses.replace(swing.record, noise=like.swing.record.noise))
    if roll and like.roll:
        roll = dataclasses.replace(roll)
        roll.__dict__.update(noise=like.roll.noise, wander=like.roll.wander)
    if swing or roll:
        return dataclasses.replace(observed, swing=swing, roll=roll).blocks
    made = dict(getattr(observed, "made", {}))
    for name in (name for name, one in made.items() if one.models and name in like.made):
        one, models = made[name], like.made[name].models
        axes = zip(one.models, models, np.split(one.rows, 3), strict=True)
        rows = [noise.whiten(new, noise.unwhiten(old, part, one.good), one.good) for old, new, part in axes]
        made[name] = dataclasses.replace(one, models=models, rows=np.concatenate(rows))
    return dataclasses.replace(observed, made=made).blocks if made else observed.blocks


def signal_to_noise(plain: list, changed: list) -> float:
    """Norm of what an effect adds to the whitened rows, everything that the calibration leaves free projected out.

    Parameters
    ----------
    plain, changed : blocks of the same noise without and with it; NaN where they do not have the same rows
    """
    from gravcal.estimation.least_squares import stable_inverse, without

    sizes = [(block.label, block.observed.shape) for block in plain]
    if sizes != [(block.label, block.observed.shape) for block in changed]:
        return float("nan")
    square, right, normal = 0.0, 0.0, 0.0
    for before, after in zip(plain, changed, strict=True):
        local = before.local_columns
        added = without(local, (after.observed - before.observed)[:, None])
        shared = without(local, before.global_columns)
        square, right = square + float(np.sum(added**2)), right + shared.T @ added[:, 0]
        normal = normal + shared.T @ shared
    return float(np.sqrt(max(square - right @ stable_inverse(normal) @ right, 0.0)))


def figures(rows: list[dict], sort: str) -> list[Figure]:
    """Table of one sort of cases; all of them count.

    Parameters
    ----------
    rows : of `scored`
    sort : "clean", "listed" or "unlisted"
    """
    if not rows:
        return []
    good = [row for row in rows if "error" not in row]
    found = [Figure(f"{sort}: cases that could not be made or searched", f"{len(rows) - len(good)} of {len(rows)}")]
    if sort == "clean":
        found.append(_share("clean: something named", [bool(r["named"]) for r in good]))
    else:
        if sort == "listed":
            found += [
                _share("listed: right", [r["right"] for r in good]),
                _share("listed: alone", [r["alone"] for r in good]),
            ]
        else:
            found.append(_share("unlisted: channel and driver right", [r["channel"] for r in good]))
        found.append(_share(f"{sort}: noticed", [r["noticed"] for r in good]))
        found.append(_share(f"{sort}: untied wrong name", [bool(r["wrong"]) for r in good]))
        found.append(
            _share(f"{sort}: missed, reported as adequate", [not r["named"] and bool(r["adequate"]) for r in good])
        )
    errors = np.array([e for r in good for e in r["after"].values()])
    if errors.size:
        name = f"{sort}: error/sigma of the result, rms; largest"
        found.append(Figure(name, f"{np.sqrt(np.mean(errors**2)):.2f}; {np.abs(errors).max():.1f}"))
        widened = np.median([w for r in good for w in r["widening"].values()])
        found.append(Figure(f"{sort}: sigma after over before, median", f"{widened:.2f}"))
    found.append(_share(f"{sort}: moved away from the truth by over one sigma", [bool(r["harm"]) for r in good]))
    return show(found, "95 %")


def _share(name, hits):
    """Share of cases with its interval."""
    if not hits:
        return Figure(name, "none")
    low, high = stats.binomtest(int(sum(hits)), len(hits)).proportion_ci(0.95, method="wilson")
    return Figure(name, f"{sum(hits)} of {len(hits)}", f"{low:.2f} to {high:.2f}")
