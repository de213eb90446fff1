"""Mutated file sets of small invented events through the command line: an error, no result, questionable, or right.

Every case is a run with folder and store of its own, where the products of the clean event are. `SEED:NUMBER` names a
case: `python -m benchmarks fuzz --calibration NAME --seed SEED --first NUMBER --runs 1` makes it again.
"""

import collections
import functools
import json
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from benchmarks.tables import STUDIES, cases, say
from flows import calibration as calibrations
from flows import cli

MEMORY, SECONDS, LARGEST = 1e9, 60, 4.0  # bytes above a clean run, of processor time, total sigma
WALL = 600  # s, after which a case that waits is ended
EVENTS = STUDIES["fuzz"]  # settings of each calibration's simulated event
#: Sensors of which no other record contradicts one channel with another scale over the whole file.
UNCONTRADICTED = {("com_offset", "ACC1A"), ("inertial_sensor", "IS1_2"), ("gradient_torque", "SGRS")}
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
        values = table[name].to_numpy().reshape(-1, *record[name].shape[1:])
        made[name] = record[name].dims, values, record[name].attrs
        made[name].encoding["_FillValue"] = None
    path.unlink()
    made.to_netcdf(path)


def write(path, content):
    """Put a file of its own, or none, where a link to the clean one was."""
    path.unlink()
    if content is not None:
        path.write_bytes(content)


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
    return table, where, f"{table.columns[k]} {before:g} to {values[where.start]:g}"


def _exchanged(table, rng):
    numeric = [k for k in range(1, table.shape[1]) if numbers(table, k) is not None]
    a, b = rng.choice(numeric, 2, replace=False) if len(numeric) > 1 else (0, 0)
    where = _stretch(table, rng) if rng.random() < 0.5 else slice(0, len(table))
    table.iloc[where, [a, b]] = table.iloc[where, [b, a]].to_numpy()
    return table, where, f"{table.columns[a]} with {table.columns[b]}"


def _records_frozen(table, rng):
    where = _stretch(table, rng)
    table.iloc[where, 1:] = table.iloc[where.start, 1:].to_numpy()
    return table, where, ""


def _late(table, rng):
    where, values = _stretch(table, rng) if rng.random() < 0.3 else slice(0, len(table)), numbers(table, 0)
    values[where] += (step := rng.choice([-86400, -3600, -60, -10, -2, -1, 1, 2, 10, 60, 3600, 86400]))
    put(table, 0, values)
    return table, where, f"by {step} s"


def reordered(kind, table, rng):
    """Change the order of the records."""
    where = _stretch(table, rng)
    return table.iloc[ORDER[kind](np.arange(len(table)), where, rng)], where, ""


#: What becomes of the places (n,) of all records where a stretch of them is dropped, repeated ...
ORDER = {
    "records dropped": lambda i, w, _: np.delete(i, w),
    "records repeated": lambda i, w, _: np.insert(i, w.stop, i[w]),
    "records reversed": lambda i, w, _: np.concatenate([i[: w.start], i[w][::-1], i[w.stop :]]),
    "records shuffled": lambda i, w, rng: np.concatenate([i[: w.start], rng.permutation(i[w]), i[w.stop :]]),
}
IN_RECORDS = {kind: functools.partial(in_column, kind) for kind in IN_COLUMN}
IN_RECORDS |= {"columns exchanged": _exchanged, "records frozen": _records_frozen, "time": _late}
IN_RECORDS |= {kind: functools.partial(reordered, kind) for kind in ORDER}


def _bits(content, rng, _):
    flipped = np.frombuffer(content, np.uint8).copy()
    for place in rng.integers(0, flipped.size, count := int(10 ** rng.uniform(0, 2))):
        flipped[place] ^= 1 << rng.integers(8)
    return flipped.tobytes(), f"{count} bits"


def _head(content, rng, path):
    size = content.find(END) if path.suffix != NETCDF else 2000
    lines = content[:size].split(b"\n")
    k, how = int(rng.integers(len(lines))), rng.choice(["dropped", "repeated", "spoiled"])
    spoiled = bytes(rng.integers(32, 127, len(lines[k]), dtype=np.uint8))
    lines[k : k + 1] = {"dropped": [], "repeated": [lines[k]] * 2, "spoiled": [spoiled]}[how]
    return b"\n".join(lines) + content[size:], f"line {k} {how}"


def _inserted(content, rng, _):
    place, junk = int(rng.integers(len(content))), rng.bytes(int(10 ** rng.uniform(0, 3)))
    return content[:place] + junk + content[place:], f"{len(junk)} bytes at {place}"


def _other_file(content, rng, path):
    other = rng.choice(sorted(p for p in path.parent.iterdir() if p != path))
    taken = other.read_bytes()
    write(other, content)
    return taken, f"with {other.name}"


IN_BYTES = {
    "bits flipped": _bits,
    "truncated": lambda content, rng, _: (content[: rng.integers(len(content))], ""),
    "empty": lambda *_: (b"", ""),
    "missing": lambda *_: (None, ""),
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
        content, said = IN_BYTES[kind](path.read_bytes(), rng, path)
        write(path, content)
    else:
        table, where, said = IN_RECORDS[kind](load(path), rng)
        save(path, table)
        said = f"{where.start}:{where.stop} {said}"
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


def judged(about, place, data) -> tuple[str, str, int]:
    """Outcome of a run of files with a store in a folder in one word, more words, and its memory in bytes."""
    calibration, options, truth, memory = about
    where = "--data", data, "--engine", "inline", "--json", place / "result.json"
    code, used = gravcal(place, "run", calibration, *where, *options)
    said = (place / "said").read_text(errors="replace")
    if code < 0:
        ran_out = -code in (signal.SIGXCPU, signal.SIGKILL)
        return ("TIME" if ran_out else "CRASH"), signal.Signals(-code).name, used
    if used > (memory or used) + MEMORY:
        return "MEMORY", f"{used / 1e9:.1f} GB", used
    if code not in (0, 1, 3, 4) or "report it" in said or "Traceback" in said:
        trace = place / "store" / "last-error.txt"
        lines = (trace.read_text() if trace.exists() else said).splitlines()
        return "TRACEBACK", " | ".join([line.strip() for line in lines if line.strip()][-3:])[:300], used
    if code in (1, 3):
        return ("error" if code == 1 else "no result"), " ".join(said.split())[:160], used
    document = json.loads((place / "result.json").read_text())
    far = score(calibration, document, truth)
    failed = [one["name"] for one in document["checks"] if not one["passed"]]
    if code == 4:
        return "questionable", f"{far:.1f} sigma; {', '.join(failed)}"[:160], used
    return ("delivered" if far <= LARGEST else "WRONG"), f"{far:.1f} sigma", used


def gravcal(place, *words) -> tuple[int, int]:
    """Exit code and memory of a command, store and words below a folder, in a copy of this process without threads."""
    child = multiprocessing.get_context("fork").Process(target=_child, args=(place, ["gravcal", *map(str, words)]))
    child.start()
    child.join(WALL)
    child.kill()
    child.join()
    return child.exitcode, int((place / "memory").read_text()) if child.exitcode >= 0 else 0


def _child(place, words):
    os.environ["GRAVCAL_PRODUCTS"] = str(place / "store")
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
    with (place / "said").open("wb") as out:
        os.dup2(out.fileno(), 1)
        os.dup2(out.fileno(), 2)
    sys.argv = words
    try:
        cli.main()
    finally:
        (place / "memory").write_text(str(1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss))


def one(about: tuple, number: int) -> tuple[str, ...]:
    """Outcome of a mutated file set: outcome, name, product, kind, what was done, words."""
    root, seed, about = about
    place = root / str(number)
    shutil.copytree(root / "clean" / "store", place / "store", copy_function=os.link)
    (place / "data").mkdir()
    for path in sorted((root / "data").iterdir()):
        (place / "data" / path.name).symlink_to(path)
    product, kind, what = mutated(place / "data", np.random.default_rng([seed, number]))
    outcome, words, _ = judged(about, place, place / "data")
    shutil.rmtree(place)
    if (outcome, kind) == ("WRONG", "scaled") and (about[0], product) in UNCONTRADICTED:
        outcome = "uncontradicted"
    return outcome, f"{seed}:{number}", product, kind, what, words


def fuzz(options) -> list:
    """Counts of outcomes of mutated file sets of each calibration, or of one, and every case that ought not to be."""
    runs = options.runs or (12 if options.quick else 1000)
    for name in [options.calibration] if options.calibration else EVENTS:
        found = collections.Counter()
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            about = Path(folder), options.seed, clean(name, Path(folder))
            numbers = range(options.first, options.first + runs)
            for outcome, *words in cases(functools.partial(one, about), numbers, options.workers):
                found[outcome] += 1
                if outcome in (*BAD, "uncontradicted"):
                    say(f"  {outcome} " + "; ".join(words))
        say(f"{name}: " + ", ".join(f"{count} {outcome}" for outcome, count in sorted(found.items())))
    return []


def clean(calibration: str, root: Path) -> tuple:
    """Calibration, options of a run, truth and memory of its event, whose files and products are in a folder."""
    truth, place = root / "truth.json", root / "clean"
    more = ["--set", f"truth={truth.with_suffix('.nc')}"] if calibration == "gradient_torque" else []
    place.mkdir()
    given = [word for name, value in EVENTS[calibration].items() for word in ("--set", f"{name}={value}")]
    gravcal(place, "simulate", calibration, "--out", root / "data", "--seed", 1, "--truth", truth, *given)
    known = json.loads(truth.read_text())
    outcome, words, used = judged((calibration, more, known, None), place, root / "data")
    say(f"{calibration}, clean: {outcome} {words}")
    if outcome not in ("delivered", "questionable"):
        raise RuntimeError(f"the clean event of {calibration} failed: {words}")
    return calibration, more, known, used
