"""Mutated file sets of small invented events through the command line: an error, no result, questionable, or right.

Every case is a run with folder and store of its own, where the products of the clean event are. `SEED:NUMBER` names a
case: `python -m benchmarks fuzz --calibration NAME --seed SEED --first NUMBER --runs 1` makes it again.
"""

import collections
import functools
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import threading
import traceback
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from benchmarks.tables import cases, say
from flows import calibration as calibrations
from flows import cli

MEMORY, SECONDS, LARGEST = 1e9, 60, 4.0  # bytes above a clean run, of processor time, total sigma
WALL = 600  # s, after which a case that waits is ended
#: Simulation of each calibration's event, and how its run is called beside --data.
EVENTS = {
    "com_offset": ({"manoeuvres": "pitch_high,roll_high,yaw_low"}, []),
    "kbr_phase_centre": (
        {"manoeuvres": "+pitch_a,-yaw_a,+pitch_b,-yaw_b", "quiet_s": 900.0, "phase_step_s": 1.0, "noise": "benign"},
        [],
    ),
    "inertial_sensor": ({"roll_s": "13000", "swing_at_s": "900"}, []),
    "gradient_torque": ({"duration_s": "3000", "field_degree": "8"}, ["--set", "truth={truth}"]),
}
#: What no other record contradicts: one channel of a sensor with another scale over the whole file.
UNCONTRADICTED = (
    ("com_offset", "ACC1A", ("scaled",)),
    ("inertial_sensor", "IS1_2", ("scaled",)),
    ("gradient_torque", "SGRS", ("scaled",)),
)
BAD = ("WRONG", "TRACEBACK", "CRASH", "MEMORY", "TIME")
END = b"# End of YAML header\n"
NETCDF = ".nc"


def of_record(path):
    """Dataset of a netCDF file as it is there, and its variables along the time, time first."""
    record = xr.load_dataset(path, decode_times=False, mask_and_scale=False)
    return record, ["time", *sorted(n for n, one in record.data_vars.items() if one.dims[:1] == ("time",))]


def load(path) -> pd.DataFrame:
    """Records of a file, a row each: bytes of text, or numbers of netCDF by variable and place."""
    if path.suffix == NETCDF:
        record, names = of_record(path)
        parts = {name: record[name].values.reshape(record.sizes["time"], -1) for name in names}
        return pd.DataFrame({(name, k): column for name, part in parts.items() for k, column in enumerate(part.T)})
    rows = [line.split() for line in path.read_bytes().split(END)[1].splitlines()]
    width = collections.Counter(map(len, rows)).most_common(1)[0][0]
    return pd.DataFrame([row for row in rows if len(row) == width])


def save(path, table):
    """Write the records back."""
    if path.suffix != NETCDF:
        head = path.read_bytes().split(END)[0] + END
        write(path, head + b"".join(b" ".join(row) + b"\n" for row in table.to_numpy()))
        return
    record, names = of_record(path)
    made = record.drop_vars(names)
    for name in names:
        values = table.loc[:, [column for column in table if column[0] == name]].to_numpy()
        made[name] = record[name].dims, values.reshape(-1, *record[name].shape[1:]), record[name].attrs
        made[name].encoding["_FillValue"] = None
    path.unlink()
    made.to_netcdf(path)


def numbers(table, k):
    """One column (n,) as floats, None where it is none."""
    try:
        return table.iloc[:, k].to_numpy().astype(float)
    except ValueError:
        return None


def put(table, k, values):
    """Replace a column by numbers; whole ones stay whole."""
    if isinstance(table.iloc[0, k], bytes):
        whole = not any(b"." in token or b"e" in token for token in table.iloc[:3, k])
        texts = [b"%d" % int(v) if whole and np.isfinite(v) else repr(float(v)).encode() for v in values]
        values = np.array(texts, dtype=object)
    table.isetitem(k, values)


def write(path, content):
    """Put a file of its own where a link to the clean one was."""
    path.unlink()
    path.write_bytes(content)


def _stretch(table, rng):
    """Some records one after the other, from one to all."""
    length = int(np.ceil(len(table) ** rng.uniform(0, 1)))
    begin = int(rng.integers(0, len(table) - length + 1))
    return slice(begin, begin + length)


#: What becomes of a stretch of one column of numbers (n,), with the standard deviation of the column.
IN_COLUMN = {
    "number": lambda v, _, rng: np.append(v[0] * rng.choice([-1.0, 0.1, 1.1, 10.0, 1e6]), v[1:]),
    "bad values": lambda v, _, rng: np.full(v.size, rng.choice([np.nan, np.inf, -np.inf, 1e300, -1e30, 9999.0])),
    "frozen": lambda v, *_: np.full(v.size, v[0]),
    "zeroed": lambda v, *_: np.zeros(v.size),
    "sign": lambda v, *_: -v,
    "noise": lambda v, spread, rng: v + 3 * spread * rng.standard_normal(v.size),
    "scaled": lambda v, _, rng: v * (1 + rng.choice([-1, 1]) * 10 ** -rng.uniform(0.3, 4)),  # all of it
    "moved": lambda v, spread, rng: v + rng.choice([-1, 1]) * spread * 10 ** rng.uniform(-2, 2),
}


def in_column(kind, table, rng):
    """Change a stretch of one column of numbers that is not the time, if there is one."""
    order = rng.permutation(np.arange(1, table.shape[1]))
    k = next((int(k) for k in order if numbers(table, k) is not None), 0)
    values, where = numbers(table, k), _stretch(table, rng)
    where, before = where if kind != "scaled" else slice(0, values.size), values[where.start]
    values[where] = IN_COLUMN[kind](values[where], np.std(values) or 1.0, rng)
    put(table, k, values)
    return table, f"{table.columns[k]} {where.start}:{where.stop}, {before:g} to {values[where.start]:g}"


def _exchanged(table, rng):
    numeric = [k for k in range(1, table.shape[1]) if numbers(table, k) is not None]
    a, b = rng.choice(numeric, 2, replace=False) if len(numeric) > 1 else (0, 0)
    where = _stretch(table, rng) if rng.random() < 0.5 else slice(0, len(table))
    table.iloc[where, [a, b]] = table.iloc[where, [b, a]].to_numpy()
    return table, f"{table.columns[a]} with {table.columns[b]} {where.start}:{where.stop}"


def _records_frozen(table, rng):
    where = _stretch(table, rng)
    table.iloc[where, 1:] = table.iloc[where.start, 1:].to_numpy()
    return table, f"{where.start}:{where.stop}"


def _late(table, rng):
    where = _stretch(table, rng) if rng.random() < 0.3 else slice(0, len(table))
    values = numbers(table, 0)
    values[where] += (step := rng.choice([-86400, -3600, -60, -10, -2, -1, 1, 2, 10, 60, 3600, 86400]))
    put(table, 0, values)
    return table, f"{where.start}:{where.stop} by {step} s"


def _reorder(order):
    """Mutation of the order of the records."""

    def mutate(table, rng):
        where = _stretch(table, rng)
        return table.iloc[order(np.arange(len(table)), where, rng)], f"{where.start}:{where.stop}"

    return mutate


IN_RECORDS = {kind: functools.partial(in_column, kind) for kind in IN_COLUMN} | {
    "columns exchanged": _exchanged,
    "records frozen": _records_frozen,
    "time": _late,
    "records dropped": _reorder(lambda i, w, _: np.delete(i, w)),
    "records repeated": _reorder(lambda i, w, _: np.insert(i, w.stop, i[w])),
    "records reversed": _reorder(lambda i, w, _: np.concatenate([i[: w.start], i[w][::-1], i[w.stop :]])),
    "records shuffled": _reorder(lambda i, w, rng: np.concatenate([i[: w.start], rng.permutation(i[w]), i[w.stop :]])),
}


def _bits(path, content, rng):
    flipped = np.frombuffer(content, np.uint8).copy()
    for place in rng.integers(0, flipped.size, count := int(10 ** rng.uniform(0, 2))):
        flipped[place] ^= 1 << rng.integers(8)
    write(path, flipped.tobytes())
    return f"{count} bits"


def _truncated(path, content, rng):
    write(path, content[: (size := int(rng.integers(len(content))))])
    return f"to {size} bytes"


def _head(path, content, rng):
    size = content.find(END) if path.suffix != NETCDF else 2000
    lines = content[:size].split(b"\n")
    k, how = int(rng.integers(len(lines))), rng.choice(["dropped", "repeated", "spoiled"])
    spoiled = bytes(rng.integers(32, 127, len(lines[k]), dtype=np.uint8))
    lines[k : k + 1] = {"dropped": [], "repeated": [lines[k]] * 2, "spoiled": [spoiled]}[how]
    write(path, b"\n".join(lines) + content[size:])
    return f"line {k} {how}"


def _inserted(path, content, rng):
    place, junk = int(rng.integers(len(content))), rng.bytes(int(10 ** rng.uniform(0, 3)))
    write(path, content[:place] + junk + content[place:])
    return f"{len(junk)} bytes at {place}"


def _other_file(path, content, rng):
    other = rng.choice(sorted(p for p in path.parent.iterdir() if p != path))
    write(path, other.read_bytes())
    write(other, content)
    return f"with {other.name}"


IN_BYTES = {
    "bits flipped": _bits,
    "truncated": _truncated,
    "empty": lambda path, *_: write(path, b""),
    "missing": lambda path, *_: path.unlink(),
    "header": _head,
    "bytes inserted": _inserted,
    "files exchanged": _other_file,
}


def mutated(folder: Path, rng) -> tuple[str, str, str]:
    """Spoil one file of a folder of links; product, kind and what was done."""
    path = rng.choice(sorted(folder.iterdir()))
    kind = rng.choice([*IN_RECORDS] * 2 + [*IN_BYTES])
    if "exchanged" in kind and len(list(folder.iterdir())) == 1:
        kind = "columns exchanged"
    if kind in IN_BYTES:
        return path.name[:5].rstrip("_"), kind, IN_BYTES[kind](path, path.read_bytes(), rng) or ""
    table, said = IN_RECORDS[kind](load(path), rng)
    save(path, table)
    return path.name[:5].rstrip("_"), kind, said


def score(calibration: str, document: dict, truth: dict) -> float:
    """Largest error of a result over its total sigma; what is null does not count."""
    if calibration == "gradient_torque":
        drags = filter(None, (document["drag"].get(name) for name in ("two_sensor", "one_sensor")))
        return max((abs(one["rms_error"]) / one["sigma_total_rms"] for one in drags), default=0.0)
    vectors = {"": truth.get("offset_um"), "offset": truth.get("com_to_test_mass_um")}
    vectors |= {name: truth.get(name) for name in ("k", "beta", "bias")} | truth.get("phase_centre_mm", {})
    far = [0.0]
    for one in calibrations.load(calibration).result(document):
        name, _, axis = one.label.rpartition(" ")
        if one.value is not None:
            far.append(abs(one.value - vectors[name]["xyz".index(axis)]) / (one.sigma_total or one.sigma))
    return max(far)


def judged(calibration, ended, place, truth, memory) -> tuple[str, str]:
    """Outcome of a case in one word, and more words.

    Parameters
    ----------
    calibration : name
    ended : exit code, largest memory in bytes
    place : folder with what the run said and its document
    truth : of the event; memory : bytes of a clean run
    """
    (code, used), said = ended, (place / "said").read_text(errors="replace")
    if code < 0:
        ran_out = -code in (signal.SIGXCPU, signal.SIGKILL)
        return ("TIME" if ran_out else "CRASH"), signal.Signals(-code).name
    if used > memory + MEMORY:
        return "MEMORY", f"{used / 1e9:.1f} GB"
    if code not in (0, 1, 3, 4) or "report it" in said or "Traceback" in said:
        trace = place / "store" / "last-error.txt"
        lines = (trace.read_text() if trace.exists() else said).splitlines()
        return "TRACEBACK", " | ".join([line.strip() for line in lines if line.strip()][-3:])[:300]
    if code in (1, 3):
        return ("error" if code == 1 else "no result"), " ".join(said.split())[:160]
    document = json.loads((place / "result.json").read_text())
    far = score(calibration, document, truth)
    failed = [one["name"] for one in document["checks"] if not one["passed"]]
    if code == 4:
        return "questionable", f"{far:.1f} sigma; {', '.join(failed)}"[:160]
    return ("delivered" if far <= LARGEST else "WRONG"), f"{far:.1f} sigma"


def gravcal(place, *words) -> tuple[int, int]:
    """Exit code and largest memory of a command with a store below a folder, where what it says goes too.

    It is a copy of this process, which has loaded the libraries and used none: their threads would not be copied.
    """
    child = os.fork()
    if not child:
        os.environ["GRAVCAL_PRODUCTS"] = str(place / "store")
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
        out = os.open(place / "said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(out, 1)
        os.dup2(out, 2)
        sys.argv = ["gravcal", *map(str, words)]
        try:
            cli.main()
        except SystemExit as ended:
            sys.stdout.flush()
            os._exit(ended.code or 0)
        except BaseException:
            os.write(2, traceback.format_exc().encode())
        os._exit(1)
    late = threading.Timer(WALL, os.kill, (child, signal.SIGKILL))
    late.start()
    _, status, usage = os.wait4(child, 0)
    late.cancel()
    return os.waitstatus_to_exitcode(status), usage.ru_maxrss * 1024


def run(calibration, place, data, options) -> tuple[int, int]:
    """Exit code and largest memory of `gravcal run`."""
    json_ = place / "result.json"
    return gravcal(place, "run", calibration, "--data", data, *options, "--engine", "inline", "--json", json_)


def one(about: tuple, number: int) -> tuple[str, ...]:
    """Outcome of a mutated file set: outcome, name, product, kind, what was done, words."""
    calibration, seed, root, options, truth, memory = about
    place = root / str(number)
    shutil.copytree(root / "clean" / "store", place / "store", copy_function=os.link)
    (place / "data").mkdir()
    for path in sorted((root / "data").iterdir()):
        (place / "data" / path.name).symlink_to(path)
    product, kind, what = mutated(place / "data", np.random.default_rng([seed, number]))
    outcome, words = judged(calibration, run(calibration, place, place / "data", options), place, truth, memory)
    shutil.rmtree(place)
    told = any((c, p) == (calibration, product) and kind in kinds for c, p, kinds in UNCONTRADICTED)
    outcome = "uncontradicted" if outcome == "WRONG" and told else outcome
    return outcome, f"{seed}:{number}", product, kind, what, words


def study(calibration: str, runs: int, options) -> collections.Counter:
    """Number of outcomes of mutated file sets of one calibration; a line for each that ought not to be."""
    settings, more = EVENTS[calibration]
    found = collections.Counter()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        root = Path(folder)
        truth, clean = root / "truth.json", root / "clean"
        more = [word.format(truth=truth.with_suffix(".nc")) for word in more]
        clean.mkdir()
        given = [word for name, value in settings.items() for word in ("--set", f"{name}={value}")]
        gravcal(clean, "simulate", calibration, "--out", root / "data", "--seed", 1, "--truth", truth, *given)
        known = json.loads(truth.read_text())
        ended = run(calibration, clean, root / "data", more)
        said = judged(calibration, ended, clean, known, ended[1])
        say(f"{calibration}, clean: {' '.join(said)}")
        if said[0] not in ("delivered", "questionable"):
            raise RuntimeError(f"the clean event of {calibration} failed: {said}")
        about = calibration, options.seed, root, more, known, ended[1]
        numbers = range(options.first, options.first + runs)
        for outcome, *words in cases(functools.partial(one, about), numbers, options.workers):
            found[outcome] += 1
            if outcome in (*BAD, "uncontradicted"):
                say(f"  {outcome} " + "; ".join(words))
    return found


def fuzz(options) -> list:
    """Counts of outcomes, and every case that ought not to be."""
    for name in [options.calibration] if options.calibration else EVENTS:
        found = study(name, options.runs or (12 if options.quick else 1000), options)
        say(f"{name}: " + ", ".join(f"{count} {outcome}" for outcome, count in sorted(found.items())))
    return []
