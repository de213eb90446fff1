"""How discovery does on hidden effects: named, silent, tied, unknown; resumable, one line a case in a file."""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks import discovery_cases as cases
from benchmarks.discovery_cases import Case
from benchmarks.tables import Figure, say, title

COUNTS = {"clean": 200, "one": 200, "two": 60, "unlisted": 100, "weak": 60}
TARGET = dict.fromkeys(COUNTS, 10.0) | {"weak": 6.0}
LARGE = (30.0, 600.0)  # ratio at which the strength is measured, far above the rounding of the readings
BENT = ("torque.dipole_lag",)  # whose trace is not proportional to their size


def run(options) -> list[Figure]:
    """Study of hidden effects; `--runs` cases of each kind, or the numbers that are asked for."""
    counts = {k: options.runs or (3 if options.quick else n) for k, n in COUNTS.items()}
    title(f"discovery: {', '.join(f'{n} {k}' for k, n in counts.items())}, master seed {options.seed}")
    kept = Path(
        os.environ.get("GRAVCAL_STUDY", Path(tempfile.gettempdir()) / f"gravcal-discovery-{options.seed}.jsonl")
    )
    say(f"one line a case in {kept}; begun studies go on where they stopped")
    done = {}
    if kept.exists():
        done = {(r["kind"], r["index"]): r for r in map(json.loads, kept.read_text().splitlines())}
    jobs = [(options.seed, k, i) for k, n in counts.items() for i in range(n) if (k, i) not in done]
    with kept.open("a") as lines:
        for number, row in enumerate(_outcomes(jobs, options), 1):
            done[row["kind"], row["index"]] = row
            lines.write(json.dumps(row) + "\n")
            lines.flush()
            if number % 20 == 0:
                say(f"  {number} of {len(jobs)}")
    rows = [r for (k, i), r in done.items() if i < counts[k]]
    return report(rows)


def _outcomes(jobs, options):
    """Outcomes as they come, from worker processes of this machine or of the Dask cluster named."""
    from distributed import as_completed

    from flows.campaign import cluster

    with cluster(options, options.workers) as client:
        futures = client.map(one, jobs, pure=False)
        for future in as_completed(futures):
            yield future.result()
            future.release()


def one(job: tuple) -> dict:
    """Outcome of one case: what was hidden, what was found.

    Parameters
    ----------
    job : (master seed, kind, index)
    """
    master, kind, index = job
    rng = np.random.default_rng([master, list(COUNTS).index(kind), index])
    seed = int(rng.integers(1, 2**31))
    row = {"kind": kind, "index": index, "seed": seed}
    try:
        return row | _hidden(kind, seed, rng)
    except Exception as error:  # noqa: BLE001 - a case that fails is a result
        return row | {"error": f"{type(error).__name__}: {error}"[:300]}


def _hidden(kind, seed, rng):
    """Draw, scale, write, discover."""
    with _folder() as folder:
        if kind == "clean":
            return _outcome(folder, Case(seed, kind, {})) | {"hidden": []}
        plain = Case(seed, kind, {})
        truth = cases.written(folder / "plain", plain)
        before = _blocks(folder / "plain", listed=kind == "unlisted")
        effects, names, left, forms = {}, [], 0.0, []
        for _ in range(2 if kind == "two" else 1):
            added, left, form, name = _scaled_to(folder, (plain, truth, before), rng, names)
            effects, names, forms = effects | added, [*names, name], [*forms, form]
        hidden = {"hidden": names, "effects": effects, "left_by_listed": left}
        outcome = _outcome(folder, Case(seed, kind, effects))
        blocks, _, _, start = _blocks(folder / "final", before[1])
        return outcome | hidden | cases.known(blocks, forms, start)


def _scaled_to(folder, clean, rng, taken):
    """An effect at the wanted ratio."""
    plain, truth, before = clean
    for attempt in range(40):
        if plain.kind == "unlisted":
            name = list(cases.UNLISTED)[rng.integers(len(cases.UNLISTED))]
            effects = {name: cases.UNLISTED[name][0]}
        else:
            effects = cases.listed(rng, truth)
            name = next(iter(effects)).rpartition(".")[0]
        if name in taken:
            continue
        found = _large(folder / f"try-{attempt}-{len(taken)}", plain, before, effects)
        if found is not None:
            return *found, name
    raise ValueError("no effect reached the ratio in forty draws")


def _large(place, plain, before, effects):
    """Effects at the wanted ratio, by proportion from a size that stands far above rounding; None out of reach.

    With it the share of its square that listed causes leave, and what it adds to the rows of each block.
    """
    bent = next(iter(effects)).rpartition(".")[0] in BENT
    low, high = (0.9 * TARGET[plain.kind], 1.1 * TARGET[plain.kind]) if bent else LARGE
    for repeat in range(8 if bent else 4):
        cases.written(place / str(repeat), Case(plain.seed, plain.kind, effects))
        blocks = _blocks(place / str(repeat), before[1])[0]
        seen, left = cases.ratio(before[0], blocks, before[2])
        if not np.isfinite(seen) or seen < 1e-3:
            return None
        if low < seen < high:
            factor = TARGET[plain.kind] / seen
            form = [factor * (b.observed - a.observed) for a, b in zip(before[0], blocks, strict=True)]
            scaled = effects if bent else cases.scaled(effects, factor)
            if not cases.plausible(scaled):
                return None
            return scaled, left * TARGET[plain.kind] ** 2, form
        factor = float(np.clip((TARGET[plain.kind] if bent else LARGE[0] * 5) / seen, 1e-4, 30.0))
        if repeat and factor == 30.0:
            return None
        effects = cases.scaled(effects, factor**0.7 if bent else factor)
    return None


@contextlib.contextmanager
def _folder():
    """Temporary folder with a product store of its own."""
    from gravcal.store import memory

    memory.clear()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["GRAVCAL_PRODUCTS"] = str(Path(folder) / "products")
        yield Path(folder)


def _products(folder):
    """Products that discovery looks at, and the settings of its observations."""
    from flows import com_offset
    from gravcal import catalog
    from gravcal.store import memory
    from tasks.stage import read

    memory.clear()
    source, chosen = com_offset.CALIBRATION.source(data=folder), catalog.parameters("com_offset")
    products = {name: read(ref) for name, ref in com_offset.baseline(source, chosen).items()}
    return products, com_offset.scene_settings(source, chosen) | chosen.for_stage("discovery")


def _blocks(folder, noise=None, *, listed=False):
    """Blocks of the files of a folder, their noise, candidates if wanted, and the offset they start from (m)."""
    from gravcal.calibrations.com_offset.observations import observe

    products, settings = _products(folder)
    observed = observe(products, **settings)
    observed.noise.update(noise or {})
    blocks = observed.blocks
    return blocks, observed.noise, observed.candidates if listed else [], observed.start


def _outcome(folder, case):
    """What discovery says of a case."""
    from flows import com_offset
    from flows import discover as flow
    from gravcal import catalog

    truth = cases.written(folder / "final", case)
    _products(folder / "final")
    begun = time.process_time()
    source, chosen = com_offset.CALIBRATION.source(data=folder / "final"), catalog.parameters("com_offset")
    numbers = flow.document(flow.flow_of("com_offset")(source, chosen))
    spent = time.process_time() - begun
    change = numbers["calibration_change"]["joint_fit"]
    error = (np.array(change["after"]) - truth["offset_um"]) / np.array(change["sigma_after"])
    found = [{k: f[k] for k in ("cause", "form", "tied_with", "imitators", "parameters")} for f in numbers["findings"]]
    kept = {k: numbers[k] for k in ("p_before", "p_after")} | {"after": change["after"], "true": truth["offset_um"]}
    return kept | {"found": found, "error_in_sigma": error.tolist(), "seconds": spent}


def report(rows: list[dict]) -> list[Figure]:
    """Table of the study beside its targets, and who was taken for whom.

    Parameters
    ----------
    rows : of `one`
    """
    from benchmarks.discovery_scores import confusion, figures

    confusion(rows)
    return figures(rows)
