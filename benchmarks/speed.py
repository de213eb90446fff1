"""Parts of the work against the best public peer, both timed in turn in the same run."""

import tempfile
import warnings
from pathlib import Path

import numpy as np

from benchmarks import stopwatch as watch
from benchmarks.gradient_torque import orbit_points
from benchmarks.tables import Figure, at_least, at_most, of_tests, show, title

EPOCHS = 172_800  # two a second for a day
RECORDS, START = 864_000, 738849600  # of a day of ACC1A at 10 Hz, 2023-06-01


def readers(options) -> list[Figure]:
    """A full day of ACC1A to arrays with GPS time, flags and checks, against polars reading the bytes as numbers."""
    import polars

    from gravcal.io.readers import read

    title(f"readers: ACC1A of a day, {RECORDS:,} records")
    with tempfile.TemporaryDirectory() as folder:
        path = _full_day(folder)
        head = path.read_bytes().partition(b"# End of YAML header\n")[0].count(b"\n") + 1
        work = {
            "polars": lambda: polars.read_csv(path, separator=" ", has_header=False, skip_lines=head),
            "read": lambda: read(path),
            "GPS time": lambda: _to_gps(path),
        }
        spent, size = watch.interleaved(work, options.rounds), path.stat().st_size / 1e6
    ratio = watch.ratios(spent["GPS time"], spent["polars"])
    return show(
        [
            Figure("size of the file", f"{size:.0f} MB"),
            watch.seconds("polars alone", spent["polars"]),
            watch.seconds("read: arrays, flags, checks", spent["read"]),
            watch.seconds("the same with GPS time", spent["GPS time"]),
            at_most("read with GPS time / polars", watch.middle(ratio), 2.0, "", watch.span(ratio)),
        ],
        "min .. max",
    )


def _full_day(folder):
    """A day of ACC1A in the layout, step and noise of the real files."""
    from gravcal.io.writers import write

    rng = np.random.default_rng(20230601)
    ticks = 7739 + np.rint(np.arange(RECORDS) * 99991.03654).astype(np.int64)
    means = {"x": (-2.8e-7, 1.3e-4), "y": (-1.06e-5, -7.8e-4), "z": (-1.8e-7, 1.2e-5)}
    columns = {"rcvtime_intg": START + ticks // 10**6, "rcvtime_frac": ticks % 10**6}
    for axis, (linear, angular) in means.items():
        columns[f"lin_accl_{axis}"] = linear + rng.normal(scale=1e-9, size=RECORDS)
        columns[f"ang_accl_{axis}"] = angular + rng.normal(scale=3e-8, size=RECORDS)
    columns["icu_blk_nr"] = (ticks // 10**6).astype(float)
    return write(columns, Path(folder) / "ACC1A_2023-06-01_C_04.txt")


def _to_gps(path):
    """What the project needs of the file: arrays with flags, checks and GPS time."""
    from gravcal.estimation import timing
    from gravcal.io.readers import read

    observed, limits = read(path), (20.0, 20.0, 1e-3)
    seconds = START + 10 * np.arange(-1, 8642)
    none = np.zeros(len(seconds))
    on_board = timing.tim1b_clock(seconds, seconds, none, none.astype(int))
    receiver = timing.clk1b_clock(seconds, none - 0.016671, none, none.astype(int))
    tags = timing.Tags(observed.time_second.values, observed.time_fraction.values)
    tags, lost = timing.converted(tags, on_board, *limits)
    tags, lost_too = timing.converted(tags, receiver, *limits)
    return observed, tags.time, lost | lost_too


def attitude(options) -> list[Figure]:
    """Attitude and state transition of one manoeuvre, against scipy's DOP853 restarted at every edge."""
    from gravcal.physics import dynamics, frames

    title("attitude: 180 s of square wave, attitude and 6 x 6 state transition at 1 Hz")
    peer = of_tests("physics.physics_references")
    state, torque, at = peer.manoeuvre()

    def ours():
        return dynamics.integrate_with_sensitivity(at, state, torque)

    def scipys():
        return peer.attitude_by_scipy(at, state, torque)

    spent = watch.interleaved({"ours": lambda: [ours() for _ in range(20)], "scipy": scipys}, options.rounds)
    spent["ours"] = [s / 20 for s in spent["ours"]]
    (quaternion, rate, _, sensitivity), (states, transition) = ours(), scipys()
    angle = np.abs(frames.attitude_error(quaternion, states[:, :4])).max()
    return show(
        [
            watch.seconds("gravcal", spent["ours"]),
            watch.seconds("scipy DOP853", spent["scipy"]),
            _faster("scipy / gravcal", spent["scipy"], spent["ours"], 50),
            at_most("difference of attitude", float(angle), 1e-11, " rad"),
            at_most("difference of rate", float(np.abs(rate - states[:, 4:]).max()), 1e-13, " rad/s"),
            at_most("difference of the transition", float(np.abs(sensitivity[..., :6] - transition).max()), 1e-8),
        ],
        "min .. max",
    )


def _faster(name, peer, ours, wanted):
    """Ratio peer over ours, round by round."""
    ratio = watch.ratios(peer, ours)
    return at_least(name, watch.middle(ratio), wanted, "", watch.span(ratio))


def field(options) -> list[Figure]:
    """IGRF-14 at epochs of their own, against ChaosMagPy with the same fraction of each interval."""
    from gravcal.physics import magnetic

    title(f"field: IGRF-14 at {EPOCHS:,} epochs with their own times, along an orbit")
    peer = of_tests("physics.physics_references")
    time, position = 633787200.0 + 0.5 * np.arange(EPOCHS), orbit_points(EPOCHS, 0.5)

    def chaos():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return peer.field_by_chaosmagpy(time, position)

    work = {"ours": lambda: magnetic.field_e(time, position, 14), "chaos": chaos}
    spent = watch.interleaved(work, max(options.rounds // 2, 2))
    difference = float(np.abs(work["ours"]() - chaos()).max() * 1e9)
    return show(
        [
            watch.seconds("gravcal", spent["ours"]),
            watch.seconds("ChaosMagPy", spent["chaos"]),
            _faster("ChaosMagPy / gravcal", spent["chaos"], spent["ours"], 10),
            at_most("largest difference, calendar apart", difference, 0.01, " nT"),
        ],
        "min .. max",
    )
