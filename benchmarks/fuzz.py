"""Mutated file sets of small invented events through the command line: an error, no result, questionable, or right.

Every case is a run with folder and store of its own, where the products of the clean event are. `SEED:NUMBER` names a
case: `python -m benchmarks fuzz --calibration NAME --seed SEED --first NUMBER --runs 1` makes it again.
"""

import collections
import functools
import gzip
import json
import os
import resource
import shutil
import signal
import subprocess
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from benchmarks.tables import CLI, cases, say
from flows import calibration as calibrations

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


@dataclass
class Table:
    """Records of a file as columns, (n,) each: bytes for text, numbers for netCDF."""

    path: Path
    names: list
    columns: list

    def numbers(self, k):
        """One column as floats, None where it is none."""
        try:
            return self.columns[k].astype(float)
        except ValueError:
            return None

    def put(self, k, values):
        """Replace a column by numbers; whole ones stay whole."""
        if self.columns[k].dtype == object:
            whole = not any(b"." in token or b"e" in token for token in self.columns[k][:3])
            texts = [b"%d" % int(v) if whole and np.isfinite(v) else repr(float(v)).encode() for v in values]
            values = np.array(texts, dtype=object)
        self.columns[k] = values


def of_record(path):
    """Dataset of a netCDF file as it is there, and its variables along the time, time first."""
    record = xr.load_dataset(path, decode_times=False, mask_and_scale=False)
    return record, ["time", *sorted(n for n, one in record.data_vars.items() if one.dims[:1] == ("time",))]


def load(path) -> Table:
    """Records of a file."""
    if path.suffix == NETCDF:
        record, names = of_record(path)
        flat = {name: record[name].values.reshape(record.sizes["time"], -1) for name in names}
        places = [(name, k) for name in names for k in range(flat[name].shape[1])]
        return Table(path, places, [flat[name][:, k].copy() for name, k in places])
    rows = [line.split() for line in path.read_bytes().split(END)[1].splitlines()]
    width = collections.Counter(map(len, rows)).most_common(1)[0][0]
    columns = [np.array(column, dtype=object) for column in zip(*(r for r in rows if len(r) == width), strict=True)]
    return Table(path, list(range(width)), columns)


def save(table):
    """Write the records back."""
    path = table.path
    if path.suffix != NETCDF:
        head = path.read_bytes().split(END)[0] + END
        write(path, head + b"".join(b" ".join(row) + b"\n" for row in zip(*table.columns, strict=True)))
        return
    record, names = of_record(path)
    made = record.drop_vars(names)
    for name in names:
        own = [c for (n, _), c in zip(table.names, table.columns, strict=True) if n == name]
        values = np.stack(own, axis=1).reshape(-1, *record[name].shape[1:])
        made[name] = record[name].dims, values, record[name].attrs
        made[name].encoding["_FillValue"] = None
    path.unlink()
    made.to_netcdf(path)


def write(path, content):
    """Put a file of its own where a link to the clean one was."""
    path.unlink()
    path.write_bytes(content)


def _stretch(table, rng):
    """Some records one after the other, from one to all."""
    count = len(table.columns[0])
    length = int(np.ceil(count ** rng.uniform(0, 1)))
    begin = int(rng.integers(0, count - length + 1))
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
    order = rng.permutation(np.arange(1, len(table.columns)))
    k = next((int(k) for k in order if table.numbers(k) is not None), 0)
    values, where = table.numbers(k), _stretch(table, rng)
    where, before = where if kind != "scaled" else slice(0, values.size), values[where.start]
    values[where] = IN_COLUMN[kind](values[where], np.std(values) or 1.0, rng)
    table.put(k, values)
    return f"{table.names[k]} {where.start}:{where.stop}, {before:g} to {values[where.start]:g}"


def _exchanged(table, rng):
    numeric = [k for k in range(1, len(table.columns)) if table.numbers(k) is not None]
    a, b = rng.choice(numeric, 2, replace=False) if len(numeric) > 1 else (0, 0)
    where = _stretch(table, rng) if rng.random() < 0.5 else slice(0, len(table.columns[0]))
    first, second = table.columns[a].copy(), table.columns[b].copy()
    first[where], second[where] = table.columns[b][where], table.columns[a][where]
    table.columns[a], table.columns[b] = first, second
    return f"{table.names[a]} with {table.names[b]} {where.start}:{where.stop}"


def _records_frozen(table, rng):
    where = _stretch(table, rng)
    for column in table.columns[1:]:
        column[where] = column[where.start]
    return f"{where.start}:{where.stop}"


def _late(table, rng):
    where = _stretch(table, rng) if rng.random() < 0.3 else slice(0, len(table.columns[0]))
    values = table.numbers(0)
    values[where] += (step := rng.choice([-86400, -3600, -60, -10, -2, -1, 1, 2, 10, 60, 3600, 86400]))
    table.put(0, values)
    return f"{where.start}:{where.stop} by {step} s"


def _reorder(order):
    """Mutation of the order of the records."""

    def mutate(table, rng):
        where = _stretch(table, rng)
        index = order(np.arange(len(table.columns[0])), where, rng)
        table.columns = [column[index] for column in table.columns]
        return f"{where.start}:{where.stop}"

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


def _packed(path, content, rng):
    packed = bytearray(gzip.compress(content, 1))
    for place in rng.integers(10, len(packed), 3):
        packed[place] ^= 1 << rng.integers(8)
    path.unlink()
    path.with_name(f"{path.name}.gz").write_bytes(packed[: len(packed) - int(rng.integers(0, 20))])
    return ""


def _other_file(path, content, rng):
    other = rng.choice(sorted(p for p in path.parent.iterdir() if p != path))
    write(path, other.read_bytes())
    write(other, content)
    return f"with {other.name}"


def _other_satellite(path, content, rng):
    own = path.name.split("_")[2]
    foreign = "D" if own == "C" else "C"
    other = path.with_name(path.name.replace(f"_{own}_", f"_{foreign}_"))
    if own not in "CD" or not other.is_file():
        return _other_file(path, content, rng)
    for target, text, was, now in ((path, other.read_bytes(), foreign, own), (other, content, own, foreign)):
        for words in ("GRACE {}", " {} "):
            text = text.replace(words.format(was).encode(), words.format(now).encode())
        write(target, text)
    return f"with {other.name}, names rewritten"


IN_BYTES = {
    "bits flipped": _bits,
    "truncated": _truncated,
    "empty": lambda path, *_: write(path, b""),
    "missing": lambda path, *_: path.unlink(),
    "header": _head,
    "bytes inserted": _inserted,
    "damaged gz": _packed,
    "files exchanged": _other_file,
    "satellites exchanged": _other_satellite,
}


def mutated(folder: Path, rng) -> tuple[str, str, str]:
    """Spoil one file of a folder of links; product, kind and what was done."""
    path = rng.choice(sorted(folder.iterdir()))
    kind = rng.choice([*IN_RECORDS] * 2 + [*IN_BYTES])
    if "exchanged" in kind and len(list(folder.iterdir())) == 1:
        kind = "columns exchanged"
    if kind in IN_BYTES:
        return path.name[:5].rstrip("_"), kind, IN_BYTES[kind](path, path.read_bytes(), rng) or ""
    table = load(path)
    said = IN_RECORDS[kind](table, rng)
    save(table)
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


def run(calibration, place, data, options) -> tuple[int, int]:
    """Exit code and largest memory of `gravcal run` with a store below a folder, where its words go too."""
    words = ["run", calibration, "--data", data, *options, "--engine", "inline", "--json", place / "result.json"]
    environment = os.environ | {"GRAVCAL_PRODUCTS": str(place / "store")}
    with (place / "said").open("w") as out:
        child = subprocess.Popen([*CLI, *map(str, words)], env=environment, stdout=out, stderr=out)
    resource.prlimit(child.pid, resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
    late = threading.Timer(WALL, child.kill)
    late.start()
    _, status, usage = os.wait4(child.pid, 0)
    late.cancel()
    child.returncode = os.waitstatus_to_exitcode(status)
    return child.returncode, usage.ru_maxrss * 1024


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
        calibrations.load(calibration).simulate(root / "data", seed=1, truth=truth, effects={}, settings=settings)
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
