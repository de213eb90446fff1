"""The published processing on invented truth and what it gets wrong; days of the papers from a loopback archive."""

import datetime
import functools
import os
import tarfile
import tempfile
import time
from http.server import SimpleHTTPRequestHandler
from pathlib import Path

import numpy as np

from benchmarks import gradient_torque as gradient
from benchmarks import inertial_sensor as inertial
from benchmarks import kbr_phase_centre as kbr
from benchmarks import recovery
from benchmarks.tables import Figure, numbers, of_tests, parts, rms, say, show, title
from flows import reproduce
from gravcal import catalog
from gravcal.calibrations.kbr_phase_centre.model import ESTIMATORS, OBSERVABLES
from gravcal.io import archive, fetch
from gravcal.simulation import kbr_phase_centre as simulation

DELAY_S = 0.3  # of the accelerometer's tags, a plausible one
METHODS = ("published", "gravcal")
SUBSETS = ("all", "positive", "mirror")
PAPERS = ("com_offset", "kbr_phase_centre")
SERVER = "http://server/"


def published_methods(options) -> list[Figure]:
    """A table of each calibration, or of one."""
    parts = {one.__name__: one for one in (com_offset, kbr_phase_centre, inertial_sensor, gradient_torque)}
    for name in [options.calibration] if options.calibration else parts:
        parts[name](options.runs or 4)
    return []


def com_offset(runs) -> dict:
    """C-7, C-9, C-10, C-12: row selection, errors, orbital period, a delay that is not estimated."""
    title(f"com_offset, {runs} events, accelerometer tags {DELAY_S} s late: rms error um, rms error/sigma; x y z")
    summary = {}
    for method in METHODS:
        ratio, error = parts(functools.partial(_event, method), range(1, runs + 1), 1)
        for k, variant in enumerate(recovery.VARIANTS):
            summary[method, variant] = 1e6 * rms(error[:, k]), rms(ratio[:, k])
    return table(summary)


def _event(method, seed):
    observed, truth, _ = recovery.simulated(seed, {"timing.accelerometer_delay": {"delay": DELAY_S}})
    settings = {"method": method} | ({"dynamics": "published"} if method == "published" else {})
    return recovery.chain.errors(recovery.chain.chain(observed, **settings)["combine"], truth)


def table(summary: dict) -> dict:
    """Print values by their names, and return them."""
    show([Figure(" ".join(names), *(numbers(one, ".4g") for one in values)) for names, values in summary.items()])
    return summary


def kbr_phase_centre(runs) -> dict:
    """K-2, K-3, K-9: one-sided sets, columns not detrended, formal errors of robust weights."""
    summary = {}
    for noise in ("measured", "benign"):
        title(f"kbr_phase_centre, {noise} noise, {runs} campaigns: rms error mm, rms error/sigma; x y z of C and D")
        made = {}
        for method in METHODS:
            error, sigma = parts(functools.partial(_campaign, method, noise), range(20_000, 20_000 + runs), 1)
            for i, s, k in np.ndindex(len(OBSERVABLES), len(SUBSETS), len(ESTIMATORS)):
                name = noise, method, OBSERVABLES[i], ESTIMATORS[k], SUBSETS[s]
                made[name] = rms(error[:, i, s, k]), rms(error[:, i, s, k] / sigma[:, i, s, k])
        summary |= table(made)
    return summary


def _campaign(method, noise, seed):
    invented = catalog.parameters("simulate_kbr_phase_centre").with_settings({"phase_step_s": 1.0, "noise": noise})
    columns, truth = simulation.simulate("CD", invented, kbr.DAY, seed, {})
    combined = kbr.chain.process(columns, method=method).combined
    sigma = 1e3 * np.sqrt(np.diagonal(combined["covariance"].values, axis1=-2, axis2=-1))
    return 1e3 * combined["centre"].values - kbr.chain.true_mm(truth), sigma


def inertial_sensor(runs) -> dict:
    """T-4: scale factors of the linear axes from angular ones with the factor one half."""
    title(f"inertial_sensor, {runs} swings: k x y z over truth, mean; rms error of the offset um x y z")
    summary = {}
    for method in METHODS:
        k, error = parts(functools.partial(_swing, method), range(3000, 3000 + runs), 1)
        summary[(method,)] = k.mean(axis=0), 1e6 * rms(error)
    return table(summary)


def _swing(method, seed):
    settings = catalog.parameters("inertial_sensor").with_settings({"method": method})
    truth, _, scaled, moved = inertial.swing(seed, inertial.invented("swing"), settings)
    return scaled["k"].values[1] / np.asarray(truth.k), moved["offset"].values[1] - truth.offset  # arm 10.45 mm


def gradient_torque(runs) -> dict:
    """S-6, S-8: drag with one sensor by quaternions is the plain reading; places exact, or off by their error."""
    title(f"gradient_torque, {runs} days: rms error of the drag m s-2; x y z")
    found = {}
    for scatter, places in ((0.0, "places exact"), (1.0, "places with their error")):
        for seed in range(runs):
            modelled, truth = gradient.simulated(seed, position_scatter=scatter)
            for name in gradient.VARIANTS:
                error = gradient.dragged(modelled, name)["drag_b"].values - truth["drag"]
                found.setdefault((name, places), []).append(rms(error))
    return table({name: (rms(kept),) for name, kept in found.items()})


def papers(options) -> list[Figure]:
    """Simulate, serve, fetch and reproduce; what was made."""
    figures = []
    for name in [options.calibration] if options.calibration else PAPERS:
        title(f"{name}: days simulated, served and fetched")
        with tempfile.TemporaryDirectory() as folder:
            begin = time.perf_counter()
            os.environ["NO_PROXY"] = "127.0.0.1"
            handler = functools.partial(SimpleHTTPRequestHandler, directory=served(name, Path(folder)))
            with of_tests("commands").serving(handler) as address:
                out = Path(options.out) / name if options.out else Path(folder) / "out"
                document = reproduce.reproduce(name, out, place=address, tell=say)
            fetched = len(list((out / "data").glob("*.tgz")))
            seconds = time.perf_counter() - begin
        figures.append(Figure(f"{name}: archives fetched", f"{fetched}", f"{seconds / 60:.0f} min"))
        made = [row["corrected"][0] is not None for item in document["items"] for row in item["rows"]]
        figures.append(Figure("  rows, of them corrected", f"{len(made)}, {sum(made)}"))
    return show(figures)


def served(name: str, folder: Path) -> Path:
    """Folder with archives of the Level-1 files of all days of a paper, each where the official servers have it."""
    raw, root = folder / "raw", folder / "served"
    reproduce.invent(name, raw, raw / "dates", folder)
    days = {}
    for file in archive.inventory(raw):
        for one in fetch.of_day(file.satellite, datetime.date.fromisoformat(file.date)):
            days.setdefault(one, [])
            days[one] += [file.path] if one.level == file.product[3:] else []
    for one, paths in days.items():
        path = root / fetch.addresses(one, SERVER)[0].removeprefix(SERVER)
        path.parent.mkdir(parents=True, exist_ok=True)
        with tarfile.open(path, "w:gz", compresslevel=1) as tar:
            for own in paths:
                tar.add(own, own.name)
    return root
