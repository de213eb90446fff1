"""Reading a full day of ACC1A, against polars alone on the same bytes in the same run."""

import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import polars

from gravcal.estimation import timing
from gravcal.io.readers import read
from gravcal.io.writers import write

RECORDS = 864_000
START = 738849600
LIMITS = timing.Limits(max_gap_s=20.0, max_extrapolation_s=20.0, jump_s=1e-3)


def full_day(folder, records=RECORDS) -> Path:
    """A day of ACC1A in the layout, step and noise of the real files, as `path` in the folder."""
    rng = np.random.default_rng(20230601)
    ticks = 7739 + np.rint(np.arange(records) * 99991.03654).astype(np.int64)
    means = {"x": (-2.8e-7, 1.3e-4), "y": (-1.06e-5, -7.8e-4), "z": (-1.8e-7, 1.2e-5)}
    columns = {"rcvtime_intg": START + ticks // 10**6, "rcvtime_frac": ticks % 10**6}
    for axis, (linear, angular) in means.items():
        columns[f"lin_accl_{axis}"] = linear + rng.normal(scale=1e-9, size=records)
        columns[f"ang_accl_{axis}"] = angular + rng.normal(scale=3e-8, size=records)
    columns["icu_blk_nr"] = (ticks // 10**6).astype(float)
    return write(columns, Path(folder) / "ACC1A_2023-06-01_C_04.txt")


def to_gps(path):
    """What the project needs of the file: arrays with flags, checks and GPS time."""
    observed = read(path)
    seconds = START + 10 * np.arange(-1, 8642)
    none = np.zeros(len(seconds))
    on_board = timing.tim1b_clock(seconds, seconds, none, none.astype(int))
    receiver = timing.clk1b_clock(seconds, none - 0.016671, none, none.astype(int))
    tags = timing.Tags(observed.time_second.values, observed.time_fraction.values)
    tags, lost = timing.converted(tags, on_board, LIMITS)
    tags, lost_too = timing.converted(tags, receiver, LIMITS)
    return observed, tags.time, lost | lost_too


def bare(path, header_lines):
    """Polars alone: bytes to numbers, nothing else."""
    return polars.read_csv(path, separator=" ", has_header=False, skip_lines=header_lines)


def compare(folder=None, repeats=5, records=RECORDS) -> dict:
    """Seconds of both, interleaved, and their ratio; medians over the repeats."""
    with tempfile.TemporaryDirectory() as own:
        start = time.perf_counter()
        path = full_day(folder or own, records)
        written = time.perf_counter() - start
        header_lines = path.read_bytes().partition(b"# End of YAML header\n")[0].count(b"\n") + 1
        spent = {"polars_s": [], "read_s": [], "with_gps_time_s": []}
        for _ in range(repeats):
            for name, run in (
                ("polars_s", lambda: bare(path, header_lines)),
                ("read_s", lambda: read(path)),
                ("with_gps_time_s", lambda: to_gps(path)),
            ):
                start = time.perf_counter()
                run()
                spent[name].append(time.perf_counter() - start)
        found = {name: statistics.median(values) for name, values in spent.items()}
        found["megabytes"] = path.stat().st_size / 1e6
    found["write_s"] = written
    found["ratio_read"] = found["read_s"] / found["polars_s"]
    found["ratio_with_gps_time"] = found["with_gps_time_s"] / found["polars_s"]
    return found


if __name__ == "__main__":
    for name, value in compare(repeats=int(sys.argv[1]) if len(sys.argv) > 1 else 5).items():
        print(f"{name:22s} {value:9.3f}")
