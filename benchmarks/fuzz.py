"""Mutated file sets of small invented events through the command line: an error, no result, questionable, or right.

Every case is a fork, with folder and store of its own, of a process that has calibrated the clean event from its
ingested products once (a fork after the threads of the text readers have begun would wait for ever). Figures of the
page are built in every case and written as SVG, half of a run's time, in every `DRAWN`-th. `SEED:NUMBER` names a case:
`python -m benchmarks fuzz --calibration NAME --seed SEED --first NUMBER --runs 1` makes it again.
"""

import collections
import contextlib
import gzip
import importlib
import io
import json
import os
import pkgutil
import resource
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import h5py
import matplotlib.figure
import numpy as np

from benchmarks.tables import say
from flows import calibration as calibrations

MEMORY, SECONDS, LARGEST = 1e9, 60, 4.0  # bytes above a clean run, of processor time, total sigma
DRAWN = 5
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
#: What no other record contradicts: one channel of a sensor with another scale over the whole file (`_scaled`).
UNCONTRADICTED = (
    ("com_offset", "ACC1A", ("scaled",)),
    ("inertial_sensor", "IS1_2", ("scaled",)),
    ("gradient_torque", "SGRS", ("scaled",)),
)
END = b"# End of YAML header\n"
NOT_TEXT = (".nc",)


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


def load(path) -> Table:
    """Records of a file."""
    if path.suffix in NOT_TEXT:
        names, columns = [], []
        with h5py.File(path) as file:
            count = file["time"].shape[0]
            for name in sorted(file, key=lambda name: name != "time"):
                if file[name].shape[:1] == (count,) and file[name].dtype.kind == "f":
                    flat = file[name][...].reshape(count, -1)
                    names += [(name, k) for k in range(flat.shape[1])]
                    columns += list(flat.T.copy())
        return Table(path, names, columns)
    rows = [line.split() for line in path.read_bytes().split(END)[1].splitlines()]
    width = collections.Counter(map(len, rows)).most_common(1)[0][0]
    columns = [np.array(column, dtype=object) for column in zip(*(r for r in rows if len(r) == width), strict=True)]
    return Table(path, list(range(width)), columns)


def save(table):
    """Write the records back."""
    path = table.path
    if path.suffix not in NOT_TEXT:
        head = path.read_bytes().split(END)[0] + END
        write(path, head + b"".join(b" ".join(row) + b"\n" for row in zip(*table.columns, strict=True)))
        return
    write(path, path.read_bytes())
    with h5py.File(path, "r+") as file:
        for name in dict.fromkeys(name for name, _ in table.names):
            own = [c for (n, _), c in zip(table.names, table.columns, strict=True) if n == name]
            values = np.stack(own, axis=1).reshape(-1, *file[name].shape[1:])
            if values.shape == file[name].shape:
                file[name][...] = values
            else:
                attrs = {k: v for k, v in file[name].attrs.items() if k in ("units", "long_name")}
                del file[name]
                file[name] = values
                file[name].attrs.update(attrs)


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


def _numeric(table, rng):
    """A column of numbers that is not the time."""
    for k in rng.permutation(np.arange(1, len(table.columns))):
        values = table.numbers(k)
        if values is not None:
            return int(k), values
    return 0, table.numbers(0)


def in_column(change):
    """Mutation of a stretch of one column of numbers."""

    def mutate(table, rng):
        (k, values), where = _numeric(table, rng), _stretch(table, rng)
        said = change(values, where, rng)
        table.put(k, values)
        return f"{table.names[k]} {where.start}:{where.stop} {said or ''}"

    return mutate


def _number(values, where, rng):
    values[where.start] *= (factor := rng.choice([-1.0, 0.1, 1.1, 10.0, 1e6]))
    return f"first times {factor:g}"


def _bad(values, where, rng):
    values[where] = (to := rng.choice([np.nan, np.inf, -np.inf, 1e300, -1e30, 9999.0]))
    return f"to {to:g}"


def _frozen(values, where, _):
    values[where] = values[where.start]


def _zeroed(values, where, _):
    values[where] = 0.0


def _reversed_sign(values, where, _):
    values[where] *= -1


def _noisy(values, where, rng):
    values[where] += 3 * (np.std(values) or 1.0) * rng.standard_normal(where.stop - where.start)


def _scaled(values, _, rng):
    values *= (factor := 1 + rng.choice([-1, 1]) * 10 ** -rng.uniform(0.3, 4))
    return f"all times {factor:g}"


def _moved(values, where, rng):
    values[where] += (step := rng.choice([-1, 1]) * (np.std(values) or 1.0) * 10 ** rng.uniform(-2, 2))
    return f"plus {step:g}"


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


IN_RECORDS = {
    "number": in_column(_number),
    "bad values": in_column(_bad),
    "frozen": in_column(_frozen),
    "zeroed": in_column(_zeroed),
    "sign": in_column(_reversed_sign),
    "noise": in_column(_noisy),
    "scaled": in_column(_scaled),
    "moved": in_column(_moved),
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


def _empty(path, content, rng):  # noqa: ARG001 - all have these
    write(path, b"")
    return ""


def _missing(path, content, rng):  # noqa: ARG001
    path.unlink()
    return ""


def _head(path, content, rng):
    size = content.find(END) if path.suffix not in NOT_TEXT else 2000
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


def _other_satellite(path, content, rng):  # noqa: ARG001
    letters = path.name.split("_")[2]
    other = path.with_name(path.name.replace(f"_{letters}_", "_D_" if letters == "C" else "_C_"))
    if letters not in "CD" or not other.is_file():
        return _other_file(path, content, rng)
    foreign = other.read_bytes()
    for a, b in ((letters, other.name.split("_")[2]), (other.name.split("_")[2], letters)):
        source = foreign if a == letters else content
        write(
            path if a == letters else other,
            source.replace(f"GRACE {b}".encode(), f"GRACE {a}".encode()).replace(f" {b} ".encode(), f" {a} ".encode()),
        )
    return f"with {other.name}, names rewritten"


IN_BYTES = {
    "bits flipped": _bits,
    "truncated": _truncated,
    "empty": _empty,
    "missing": _missing,
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
        return path.name[:5].rstrip("_"), kind, IN_BYTES[kind](path, path.read_bytes(), rng)
    table = load(path)
    said = IN_RECORDS[kind](table, rng)
    save(table)
    return path.name[:5].rstrip("_"), kind, said


def score(calibration: str, document: dict, truth: dict) -> float:
    """Largest error of a result over its total sigma; what is null does not count."""
    pairs = []  # value, sigma, truth
    if calibration == "com_offset":
        one = document["variants"][document["adopted"]["variant"]]
        pairs = zip(one["offset_um"], one["sigma_total_um"], truth["offset_um"], strict=True)
    elif calibration == "kbr_phase_centre":
        for letter, one in document["adopted"]["satellites"].items():
            pairs += zip(one["phase_centre_mm"], one["sigma_mm"], truth["phase_centre_mm"][letter], strict=True)
    elif calibration == "inertial_sensor":
        swing, roll = document.get("swing") or {}, document.get("roll") or {}
        for k, axis in enumerate("xyz"):
            for name in ("k", "beta"):
                one = (swing.get(name) or {}).get(axis)
                pairs += [(one["value"], one.get("sigma_total", one["sigma"]), truth[name][k])] if one else []
        for one, name in ((swing.get("com_to_test_mass_um"), "com_to_test_mass_um"), (roll.get("bias"), "bias")):
            pairs += zip(one["value"], one["sigma_total"], truth[name], strict=True) if one else []
    else:
        names = ("two_sensor", "one_sensor")
        pairs = [(one["rms_error"], one["sigma_total_rms"], 0.0) for n in names if (one := document["drag"].get(n))]
    return max((abs(v - t) / s for v, s, t in pairs if v is not None and s is not None), default=0.0)


def _preload(calibration):
    """Load what a run loads, so that a fork need not."""
    import flows.cli
    import gravcal

    for name in (f"flows.{calibration}", "matplotlib.figure", "polars", "xarray", "scipy.signal", "scipy.linalg"):
        importlib.import_module(name)
    for found in pkgutil.walk_packages(gravcal.__path__, "gravcal."):
        if any(part in found.name for part in (f"calibrations.{calibration}", "report", "data", "physics", "methods")):
            importlib.import_module(found.name)
    return flows.cli.main


def _forked(body):
    """Number of a child process that runs a function."""
    sys.stdout.flush()
    child = os.fork()
    if child:
        return child
    code = 99
    try:
        code = body()
    except BaseException as reason:  # noqa: BLE001 - whatever it is, the child ends here
        print(type(reason).__name__, reason, file=sys.stderr)
    finally:
        sys.stderr.flush()
        os._exit(code)


def _warm(main, base, arguments):
    """Compile, import and fingerprint in this process: the clean event again, its ingested products kept."""
    place = base.with_name("warm")
    shutil.copytree(base / "store", place / "store", symlinks=True)
    for record in (place / "store" / "objects").glob("*/*/meta.json"):
        if "tasks.common:ingest" not in record.read_text():
            shutil.rmtree(record.parent)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        _command(main, place, arguments)


def _gravcal(main, place, arguments, *, drawn=True):
    """Exit code of the command line, its words in a file."""
    out = os.open(place / "said", os.O_WRONLY | os.O_CREAT)
    os.dup2(out, 1)
    os.dup2(out, 2)
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if not drawn:
        matplotlib.figure.Figure.savefig = lambda self, out, **_: out.write(b"<svg/>")  # noqa: ARG005
    return _command(main, place, arguments)


def _command(main, place, arguments):
    """Exit code of `gravcal run` with a store of its own."""
    os.environ["GRAVCAL_PRODUCTS"] = str(place / "store")
    sys.argv = ["gravcal", "run", *map(str, arguments), "--engine", "inline", "--json", str(place / "result.json")]
    try:
        main()
    except SystemExit as ended:
        return int(ended.code or 0)
    return 0


def _judged(place, ended, truth, clean):
    """Outcome of a case in one word, and more words."""
    calibration, status, usage, killed = *ended, clean.get("killed")
    said = (place / "said").read_text(errors="replace") if (place / "said").exists() else ""
    if os.WIFSIGNALED(status):
        ran_out = os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL) or killed
        return ("TIME" if ran_out else "CRASH"), signal.Signals(os.WTERMSIG(status)).name
    code = os.WEXITSTATUS(status)
    if usage.ru_maxrss * 1024 > clean["memory"] + MEMORY:
        return "MEMORY", f"{usage.ru_maxrss / 1e6:.1f} GB"
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


def study(calibration: str, runs: int, seed: int, first: int = 0, workers: int = 2) -> dict:
    """Outcomes of mutated file sets of one calibration, {outcome: [(seed, product, kind, what, words)]}.

    There are so many cases from the first number on, each a fork, so many workers at a time.
    """
    settings, options = EVENTS[calibration]
    main, found = _preload(calibration), collections.defaultdict(list)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as root:
        root = Path(root)
        base, data, truth_file = root / "clean", root / "data", root / "truth.json"
        options = [one.format(truth=truth_file.with_suffix(".nc")) for one in options]
        base.mkdir()

        def prepare():
            flow = calibrations.load(calibration)
            flow.simulate(data, seed=1, truth=truth_file, effects={}, settings=settings)
            return _gravcal(main, base, [calibration, "--data", data, *options])

        _, status, usage = os.wait4(_forked(prepare), 0)
        clean = {"memory": usage.ru_maxrss * 1024}
        _warm(main, base, [calibration, "--data", data, *options])
        truth = json.loads(truth_file.read_text())
        said = _judged(base, (calibration, status, usage), truth, clean)
        say(f"{calibration}, clean: {' '.join(said)}, {usage.ru_utime + usage.ru_stime:.0f} s of processor")
        if said[0] not in ("delivered", "questionable"):
            raise RuntimeError(f"the clean event of {calibration} failed: {said}")
        waiting, running = list(range(first, first + runs)), {}
        while waiting or running:
            while waiting and len(running) < workers:
                number = waiting.pop(0)
                place = root / f"{number}"
                case = place / "data"
                shutil.copytree(base / "store", place / "store", copy_function=os.link)
                case.mkdir()
                for path in sorted(data.iterdir()):
                    (case / path.name).symlink_to(path)

                def run(place=place, case=case, number=number):
                    done = mutated(case, np.random.default_rng([seed, number]))
                    (place / "mutation").write_text(json.dumps(done))
                    return _gravcal(main, place, [calibration, "--data", case, *options], drawn=number % DRAWN == 0)

                running[_forked(run)] = number, place, time.monotonic()
            child, status, usage = os.wait4(-1, os.WNOHANG)
            if not child:
                for pid, (_, _, begun) in running.items():
                    if time.monotonic() - begun > WALL:
                        os.kill(pid, signal.SIGKILL)
                time.sleep(0.05)
                continue
            number, place, _ = running.pop(child)
            mutation = place / "mutation"
            product, kind, what = json.loads(mutation.read_text()) if mutation.exists() else ("?", "not made", "")
            outcome, words = _judged(place, (calibration, status, usage), truth, clean)
            if outcome == "WRONG" and any(
                (c, p) == (calibration, product) and kind in kinds for c, p, kinds in UNCONTRADICTED
            ):
                outcome = "uncontradicted"
            outcome = outcome if mutation.exists() else "FUZZER"
            found[outcome].append((f"{seed}:{number}", product, kind, what, words))
            if outcome in BAD:
                say(f"  {outcome} {seed}:{number}; {product}; {kind}; {what}; {words}")
            shutil.rmtree(place)
    return dict(found)


BAD = ("WRONG", "TRACEBACK", "CRASH", "MEMORY", "TIME", "FUZZER")


def run(options) -> list:
    """Counts of outcomes, and every case that ought not to be."""
    names = [options.calibration] if options.calibration else list(EVENTS)
    for name in names:
        found = study(
            name, options.runs or (12 if options.quick else 1000), options.seed, options.first, options.workers
        )
        say(f"{name}: " + ", ".join(f"{len(cases)} {outcome}" for outcome, cases in sorted(found.items())))
        for case in found.get("uncontradicted", ()):
            say("  uncontradicted " + "; ".join(case))
    return []
