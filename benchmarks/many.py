"""`python -m benchmarks many --events 20000`: what a campaign keeps of each of many small events.

An event is one number in one file, and one product: memory and database do not depend on what is computed.
"""

import datetime
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import psutil

from benchmarks import stopwatch as watch
from benchmarks.tables import CLI, ROOT, Figure, grid, say, title
from flows.calibration import Calibration
from flows.engine import flow
from gravcal.store import product
from gravcal.store.results import Value
from tasks.stage import read, stage

FEW = 1000
MARKS = (200, 1000, 2000, 5000, 10_000, 20_000, 50_000)  # events done at which a line is printed
FIRST = datetime.date(1900, 1, 1)
HEAD = ("events", "s", "ms an event", "campaign MB", "worker MB", "server MB", "database MB", "delivered")
KINDS = product.registered("many", report=product.ANY)
SETTINGS = '[gain]\nvalue = 2.0\nunit = "1"\nstage = "weigh"\nreason = "invented"\n'


@stage(reads=["file"], writes="many.report", version=1)
def weigh(file, *, gain: float):
    """One number."""
    import xarray as xr

    return xr.Dataset({"value": ((), gain * float(file.path.read_text()), {"units": "1"})})


@flow(name="many")
def calibrate(source, chosen):
    """The report of one day."""
    return weigh(source.file("MAG1B"), event=source.event, variant="", **chosen.for_stage("weigh"))


def _document(ref):
    value = float(read(ref)["value"])
    return {"schema_version": "1.0", "status": "delivered", "calibration": "many", "event": ref.event, "value": value}


CALIBRATION = Calibration(
    name="many",
    title="Many",
    quantity="A number",
    begins=("MAG1B",),
    satellites=("C",),
    inputs={"number": ("MAG1B",)},
    flow=calibrate,
    products=KINDS,
    result=lambda document: [Value("", "number", "1", document["value"], 1.0, None)],
    simulation=None,
    document=_document,
)


def many(options) -> list[Figure]:
    """A campaign of a thousand events and one of as many as asked for, through Prefect and Dask."""
    steps = [20] if options.quick else sorted({FEW, options.events or FEW})
    title(f"many: campaigns of small events, {options.workers} workers; largest resident memory, size of the database")
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        environment = _installed(root)
        _campaign(root, 2, options, environment)  # migrates Prefect's database
        rows = [_campaign(root, step, options, environment) for step in steps]
        say()
        grid([HEAD, *rows])
    return []


def _installed(root):
    """Environment in which the command line knows this calibration, with a Prefect home of its own."""
    about = root / "site" / "many-1.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: many\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[gravcal.calibrations]\nmany = benchmarks.many:CALIBRATION\n")
    parameters = root / "catalog" / "parameters"
    parameters.mkdir(parents=True)
    (parameters / "many.toml").write_text(SETTINGS)
    path = os.pathsep.join([str(root / "site"), str(ROOT), os.environ.get("PYTHONPATH", "")])
    own = {"PYTHONPATH": path, "PREFECT_HOME": str(root / "prefect"), "GRAVCAL_CATALOG": str(root / "catalog")}
    return os.environ | own | {"GRAVCAL_PRODUCTS": str(root / "products")}


def _campaign(root, count, options, environment):
    """Cells of one campaign; its files and its store are removed."""
    data, said = root / "data", root / "summary.json"
    for number in range(count):
        date = FIRST + datetime.timedelta(days=number)
        (data / str(date.year)).mkdir(parents=True, exist_ok=True)
        (data / str(date.year) / f"MAG1B_{date}_C_04.txt").write_text(f"{number}")
    command = [*CLI, "campaign", "many", "--data", str(data), "--workers", str(options.workers), "--json", str(said)]
    start = time.perf_counter()
    with (root / "log").open("w") as log:
        largest = _watched(subprocess.Popen(command, env=environment, stdout=log, stderr=log), root, start)
    spent = time.perf_counter() - start
    delivered = said.read_text().count('"status": "delivered"') - 1  # and that of all
    shutil.rmtree(data)
    shutil.rmtree(root / "products")
    return _cells(count, spent, largest, root) + (f"{delivered}",)


def _cells(count, spent, sizes, root):
    """Cells of a line: events, seconds, memory and database in MB."""
    database = sum(path.stat().st_size for path in (root / "prefect").glob("prefect.db*")) / 1e6
    memory = [f"{sizes[name] / 1e6:.0f}" for name in ("campaign", "worker", "server")]
    return (f"{count}", f"{spent:.0f}", f"{1e3 * spent / count:.0f}", *memory, f"{database:.1f}")


def _watched(child, root, start):
    """Largest resident memory in bytes of the campaign's process, of a worker and of the server, until it ends."""
    largest, marks = {"campaign": 0, "worker": 0, "server": 0}, iter(MARKS)
    own, mark = psutil.Process(child.pid), next(marks)
    while child.poll() is None:
        for process, size in watch.memory(own).items():
            other = "server" if any("engine.server" in word for word in process.cmdline()) else "worker"
            name = "campaign" if process == own else other
            largest[name] = max(largest[name], size)
        runs = root / "products" / "runs"
        done = len(list(runs.iterdir())) if runs.exists() else 0
        if done >= mark:
            say("  after " + "  ".join(_cells(done, time.perf_counter() - start, largest, root)))
            mark = next(marks)
        time.sleep(2.0)
    return largest
