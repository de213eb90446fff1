"""Discovery judged by several worlds: what is hidden there, how strong it is, what was said of it.

`python -m benchmarks worlds --calibration NAME --world open|second|own --sort clean|listed|unlisted --runs N --seed S`
makes cases with the forward models beside the project (`../shared/worlds/open`), with the simulator of the tests
(`second`), or with the project's own; searches each and prints the scores that docs/scores.md defines. Every case is a
line of `--out FILE`, and a study goes on where it stopped. `python -m benchmarks folder DIR --out OUT` runs `run` and
`discover` on every case of a folder whose truth is not at hand.
"""

import contextlib
import dataclasses
import functools
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from scipy.stats import norm

from benchmarks.shapes import OPEN, SHAPES
from benchmarks.tables import CLI, ROOT, Figure, cases, of_tests, rms, say, share, show

WORLDS = ROOT.parent / "shared" / "worlds"
STRONG = (15.0, 40.0)  # signal-to-noise ratios that are hidden, log-uniform
LARGEST = 200.0  # times the first guess of a size; what needs more is not seen by these records
ALIKE = {"roll": "swing", "second_roll": "second_swing"}  # kinds whose table is that of another
NOT_DRAWN = ("accelerometer.offset", "ranging.phase_centre", "ranging.antenna_correction", "timing.thruster_delay")
NOT_DRAWN += ("magnetometer.temperature_bias", "magnetometer.temperature_scale")  # of days
NOT_DRAWN += ("attitude.star_camera_heads", "timing.orbit_delay")  # of SCA1A, of records minutes apart
FIXED = ("time", "frequency", "phase", "damping", "period")
TABLE = tomllib.loads((ROOT / "benchmarks" / "worlds.toml").read_text())
KINDS = {kind: (world, name) for world, kinds in TABLE["kinds"].items() for kind, name in kinds.items()}


@dataclasses.dataclass(frozen=True)
class Hidden:
    """An effect that is hidden in cases; fields without a word are those of worlds.toml."""

    draw: Callable  #: rng -> value at a first guess of the size
    scaled: Callable  #: (value, factor) -> value of another size
    causes: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()
    drivers: tuple[str, ...] = ()


def effects_of(kind: str) -> dict[str, Hidden]:
    """Effects that can be hidden in a kind of case, by name."""
    if KINDS[kind][0] == "own":
        return own(kind)
    table = TABLE[ALIKE.get(kind, kind)] | TABLE["odd"].get(kind, {})
    return {name: _of_table(**entry) for name, entry in table.items()}


def _of_table(value, of_one=False, scaled=None, **words):
    """Effect of an entry of worlds.toml."""

    def draw(rng):
        return {drawn("letter", rng): drawn(value, rng)} if of_one else drawn(value, rng)

    return Hidden(draw, functools.partial(grown, places=scaled), **words)


def drawn(template, rng):
    """Value of a template of worlds.toml, its texts drawn."""
    if isinstance(template, dict):
        return {name: drawn(one, rng) for name, one in template.items()}
    if isinstance(template, list):
        values = []
        for one in template:
            value = drawn(one, rng)
            values += value if isinstance(one, str) and one.startswith("sweep") else [value]
        return values
    if not isinstance(template, str):
        return template
    word, *numbers = template.split()
    size, *rest = map(float, numbers or ["0"])
    if word == "letter":
        return "CD"[rng.integers(2)]
    if word == "sign":
        return float(size * rng.choice([-1, 1]))
    if word == "vector":
        vector = size * rng.standard_normal(3)
        return (vector if rng.integers(2) else vector * np.eye(3)[rng.integers(3)]).tolist()
    if word == "normal":
        return (size * rng.standard_normal([int(n) for n in rest])).tolist()
    if word == "pair":
        out, (i, j) = np.zeros((3, 3)), ((0, 1), (0, 2), (1, 2))[rng.integers(3)]
        out[i, j] = out[j, i] = size * rng.choice([-1, 1])
        return out.tolist()
    if word == "uniform":
        return float(rng.uniform(size, *rest))
    if word == "integer":
        return int(rng.integers(*map(int, numbers)))
    if word == "sweep":
        ends = [float(rng.uniform(size, 2 * size)), float(rng.uniform(rest[0] / 2, rest[0]))]
        return ends[:: rng.choice([-1, 1])]
    if word == "coefficient":
        degree = int(rng.integers(2, 20))
        return {f"{degree},{rng.integers(1, degree + 1)}": [size, size]}
    raise ValueError(f"worlds.toml: {template!r} is no draw")


def grown(value, factor, places=None):
    """Value with its numbers multiplied: of a table those of its "value" if it has one, of a list those at places."""
    if isinstance(value, dict):
        return {
            n: grown(one, factor, places) if n == "value" or "value" not in value else one for n, one in value.items()
        }
    if isinstance(value, list):
        return [grown(one, factor) if places is None or k in places else one for k, one in enumerate(value)]
    return value * factor


def own(calibration: str) -> dict[str, Hidden]:
    """Effects of the catalogue that act on the records of a calibration, with plausible sizes, by slug.

    What is no effect of a simulated event is not drawn: its own parameters, and what another record holds.
    """
    from gravcal.effects import catalogue

    families = TABLE["families"][calibration]
    known = {slug: one for slug, one in catalogue().items() if slug.partition(".")[0] in families}
    return {slug: _own(one) for slug, one in known.items() if slug not in NOT_DRAWN}


def _own(entry):
    """A plausible size of one parameter or of all, the whole strength scaled."""

    def draw(rng):
        values = entry.plausible(rng.standard_normal)
        sizes = sorted(set(values) - {*FIXED, "tau", "limit"})
        kept = sizes if rng.integers(2) or not sizes else [sizes[rng.integers(len(sizes))]]
        values = {n: v for n, v in values.items() if n in kept or n not in sizes}
        values |= {"frequency": float(rng.uniform(0.02, 0.7))} if "frequency" in values else {}
        return {f"{entry.slug}.{name}": value for name, value in values.items()}

    def scaled(values, factor):
        return {n: v if n.rpartition(".")[2] in (*FIXED, "limit") else factor * v for n, v in values.items()}

    return Hidden(draw, scaled, (entry.slug,))


def make_open(folder: Path, seed: int, effects: dict, kind: str = "com", shape: str = "", **given) -> None:
    """Files of a case of the open world in `folder`/data, truth beside them; of com: satellite, date, offset_um.

    With a shape of `benchmarks.shapes` for its noise.
    """
    words = [word for name, value in effects.items() for word in ("--effect", f"{name}={json.dumps(value)}")]
    for name, value in given.items():
        words += [f"--{name.removesuffix('_um')}", *map(str, value if isinstance(value, list) else [value])]
    maker = ["-m", "benchmarks.shapes", shape] if shape else [str(OPEN)]
    command = [sys.executable, *maker, kind, "--seed", str(seed), *words, "--out", str(folder)]
    subprocess.run(command, check=True, capture_output=True)


def make_second(folder: Path, seed: int, effects: dict, kind: str = "second", **given) -> dict:
    """Files of a case of the second world in `folder`/data; its truth."""
    of_tests("independent")
    from independent import gradient, make_event, ranging, taiji

    maker, lengths = {
        "second": (make_event, {"window_s": (420.0, 420.0)}),
        "second_kbr": (ranging.make_campaign, {}),
        "second_swing": (taiji.make_event, {"roll_s": 0.0}),
        "second_roll": (taiji.make_event, {"roll_s": 27500.0}),
        "second_sgrs": (gradient.make_day, {"duration_s": 20000.0}),
    }[kind]
    return maker(folder / "data", seed, effects=effects, **lengths, **given)


MAKERS = {"open": make_open, "second": make_second}


def make(kind: str, seed: int, effects: dict, folder: Path, shape: str = "") -> dict:
    """Files of a case of a kind in `folder`/data, with effects {name: value} and a shape of its noise; its truth."""
    world, calibration = KINDS[kind]
    if world == "second":
        return make_second(folder, seed, effects, kind)
    odd = TABLE["odd"].get(kind, {})
    if world == "own":
        values = [f"{name}={value}" for entries in effects.values() for name, value in entries.items()]
        words = [word for value in values for word in ("--effect", value)]
        command = [*CLI, "simulate", calibration, "--out", f"{folder}/data", "--seed", str(seed)]
        subprocess.run([*command, "--truth", f"{folder}/truth.json", *words], check=True, capture_output=True)
    else:
        make_open(folder, seed, {name: value for name, value in effects.items() if name not in odd}, kind, shape)
    truth = json.loads((folder / "truth.json").read_text())
    for name, value in effects.items():
        if name in odd:
            put_in(kind, folder / "data", name, value, truth)
    return truth


def put_in(kind: str, data: Path, name: str, value, truth: dict) -> None:
    """Add an effect of the table `odd` to the last day of files: to range, or an axis of linear readings (sensor 1)."""
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
    """What an effect of the table `odd` adds to a reading, (n,) m s-2, or m to a range."""
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
    """Settings that an operator of a kind of cases gives to every command, paths as seen from the present folder."""
    places = {"data": data, "worlds": os.path.relpath(WORLDS)}
    return {name: value.format_map(places) for name, value in TABLE["known"].get(kind, {}).items()}


def gravcal(command: str, kind: str, data: Path, out: Path) -> dict:
    """Document of `run` or `discover` on the files of a folder, also in a file; with "said" where it wrote none."""
    words = [*CLI, command, KINDS.get(kind, ("", kind))[1], "--data", str(data)]
    words += [word for pair in known(kind, data).items() for word in ("--set", "=".join(pair))]
    words += ["--engine", "inline", "--json", str(out)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if not out.exists():
        out.write_text(json.dumps({"status": "failed", "said": done.stderr.strip()[-2000:]}, indent=1) + "\n")
    return json.loads(out.read_text()) | {"exit": done.returncode}


def folder(options) -> list[Figure]:
    """Run and discover every case of a folder; documents `KIND-NN.run.json` and `KIND-NN.json`, refusals too."""
    found = sorted(path for path in Path(options.folder).iterdir() if path.is_dir())
    out = Path(options.out or "benchmarks/sealed")
    out.mkdir(parents=True, exist_ok=True)
    jobs = [(str(case), str(out), command) for case in found for command in ("run", "discover")]
    for line in cases(_of_folder, jobs, options.workers):
        say(line)
    return []


def _of_folder(job):
    """Document of one command on one case, and a line on it."""
    case, out, command = Path(job[0]), Path(job[1]), job[2]
    kind = case.name.partition("-")[0]
    target = out / f"{case.name}{'.run' if command == 'run' else ''}.json"
    target.unlink(missing_ok=True)
    with _place():
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

    The epoch, GPS s, is that which the document states for phase centres and biases that move.
    """
    calibration = KINDS.get(kind, ("", kind))[1]
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
    """Scores of the document of one case as docs/scores.md defines them; hidden is the name of its effect, or ""."""
    effect = effects_of(kind)[hidden] if hidden else None
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
    kinds = [kind for kind, one in KINDS.items() if one == (options.world, options.calibration)]
    jobs = [(kinds[n % len(kinds)], options.sort, options.seed + n) for n in range(options.runs or 40)]
    for row in cases(_case, [job for job in jobs if job not in known], options.workers):
        done.append(row | {"commit": _commit()})
        with out.open("a") as lines:
            lines.write(json.dumps(done[-1]) + "\n")
        say(_line(row))
    sorts = ("clean", *SHAPES, "listed", "unlisted")
    return sum((figures([r for r in done if r["sort"] == sort], sort) for sort in sorts), [])


def _commit():
    """Commit of the code that was judged."""
    command = ["git", "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()


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
    plain = make(kind, seed, {}, place / "plain", sort if sort in SHAPES else "")
    hidden, value, ratio, truth, data = "", None, 0.0, plain, place / "plain" / "data"
    if sort not in ("clean", *SHAPES):
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
    if document["status"] == "failed":
        raise ValueError(document.get("said") or document.get("error"))
    return {"hidden": hidden, "value": value, "ratio": ratio} | scored(kind, sort, hidden, document, truth)


def _strong(kind, seed, hidden, wanted, about):
    """Value, ratio, truth and files of an effect near the wanted ratio, None where these records do not see it."""
    rng, quiet, place = about
    effect = effects_of(kind)[hidden]
    value = start = effect.draw(rng)
    total = 1.0
    for attempt in range(4):
        truth = make(kind, seed, {hidden: value}, place / str(attempt))
        data = place / str(attempt) / "data"
        changed = observed_of(kind, data)
        campaigns = bool(quiet and changed) and not changed.shifted and quiet.name == "kbr_phase_centre"
        like, changed = of_both(quiet, changed) if campaigns else (quiet, changed)
        ratio = signal_to_noise(like.blocks if like else [], rows_of(changed, like))
        if 0.8 * wanted < ratio < 1.25 * wanted:
            return value, ratio, truth, data
        total *= wanted / max(ratio, wanted / 50)
        if not 1 / LARGEST**2 < total < LARGEST:
            return None
        value = effect.scaled(start, total)
    return None


def observed_of(kind: str, data: Path):
    """Observations that a search of the files of a folder sees; None where there is nothing to see."""
    from flows import calibration as calibrations
    from gravcal import catalog
    from tasks.stage import read

    calibration = KINDS.get(kind, ("", kind))[1]
    one = calibrations.load(calibration)
    source, chosen = one.source(data=data), catalog.parameters(calibration).with_settings(known(kind, data))
    products = {name: read(ref) for name, ref in one.discovery.baseline(source, chosen).items()}
    settings = one.discovery.settings(source, chosen) | one.discovery.chosen_for(chosen)[0]
    return importlib.import_module(one.discovery.observations).observe(products, **settings)


def of_both(*campaigns) -> Iterator:
    """Observations of two campaigns at the epochs that both have: an effect may move the ends of a manoeuvre."""
    seconds = [{half.label: np.rint(half.time) for half in one.view.parts} for one in campaigns]
    for one, others in zip(campaigns, seconds[::-1], strict=True):
        both = [(half, np.isin(np.rint(half.time), others.get(half.label, ()))) for half in one.view.parts]
        parts = [_shorter(half, kept) for half, kept in both if half.label in others]
        view = one.view if all(kept.all() for _, kept in both) else dataclasses.replace(one.view, parts=parts)
        yield dataclasses.replace(one, view=view)


def _shorter(half, kept):
    rows = np.arange(half.rows.start, half.rows.stop)[kept]
    parts = {name: getattr(half, name)[kept] for name in ("time", "slow", "place", "lever")}
    return dataclasses.replace(half, rows=rows, **parts)


def rows_of(observed, like) -> list:
    """Blocks whitened with the noise of other observations: a strong effect changes what the noise is measured as."""
    from gravcal.estimation import noise

    if not (observed and like) or observed.shifted:
        return observed.blocks if observed else []
    if like.name == "com_offset":
        observed.noise.update(like.noise)
    elif like.name == "kbr_phase_centre":
        observed.view.__dict__["factors"] = like.view.factors
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
        one, other = made[name], like.made[name]
        axes = zip(other.models, np.moveaxis(one.in_unit(one.rows), 1, 0), strict=True)
        rows = np.concatenate([noise.whiten(model, part, one.good) for model, part in axes])
        rows = rows / other.level.value.T.reshape(-1, 1)
        made[name] = dataclasses.replace(one, models=other.models, level=other.level, rows=rows)
    return dataclasses.replace(observed, made=made).blocks if made else observed.blocks


def signal_to_noise(plain: list, changed: list) -> float:
    """Norm of what an effect adds to the whitened rows, everything that the calibration leaves free projected out.

    NaN where blocks without and with it do not have the same rows.
    """
    from gravcal.estimation.least_squares import project_out, stable_inverse

    sizes = [(block.label, block.observed.shape) for block in plain]
    if sizes != [(block.label, block.observed.shape) for block in changed]:
        return float("nan")
    square, right, normal = 0.0, 0.0, 0.0
    for before, after in zip(plain, changed, strict=True):
        local = before.local_columns
        added = project_out(local, (after.observed - before.observed)[:, None])
        shared = project_out(local, before.global_columns)
        square, right = square + float(np.sum(added**2)), right + shared.T @ added[:, 0]
        normal = normal + shared.T @ shared
    return float(np.sqrt(max(square - right @ stable_inverse(normal) @ right, 0.0)))


def figures(rows: list[dict], sort: str) -> list[Figure]:
    """Table of one sort of cases; all of them count."""
    if not rows:
        return []
    good, clean = [row for row in rows if "error" not in row], sort in ("clean", *SHAPES)
    found = [Figure(f"{sort}: cases that could not be made or searched", f"{len(rows) - len(good)} of {len(rows)}")]
    scores = {
        sort: {"something named": "named"},
        "listed": {"right": "right", "alone": "alone", "noticed": "noticed", "untied wrong name": "wrong"},
        "unlisted": {"channel and driver right": "channel", "noticed": "noticed", "untied wrong name": "wrong"},
    }
    found += [share(f"{sort}: {words}", [bool(r[score]) for r in good]) for words, score in scores[sort].items()]
    if not clean:
        found.append(share(f"{sort}: missed, silent", [not r["named"] and bool(r["adequate"]) for r in good]))
    errors = np.array([e for r in good for e in r["after"].values()])
    if errors.size:
        largest = np.abs(errors).max()
        found.append(Figure(f"{sort}: error/sigma of the result, rms; largest", f"{rms(errors):.2f}; {largest:.1f}"))
        widened = np.median([w for r in good for w in r["widening"].values()])
        found.append(Figure(f"{sort}: sigma after over before, median", f"{widened:.2f}"))
    found.append(share(f"{sort}: moved away from the truth by over one sigma", [bool(r["harm"]) for r in good]))
    moved = [abs(r["after"][n] * r["widening"][n] - r["before"][n]) for r in good for n in r["after"]]
    right = f"{sum(norm.cdf(-(1 + one) / 2) for one in moved if one > 1):.1f}"  # noise that the effect had cancelled
    return show([*found, Figure(f"{sort}: parameters that do so where every extension is right", right)], "95 %")
