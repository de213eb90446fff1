"""A calibration of five products that costs almost nothing: what is left of a campaign is its orchestration."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flows.calibration import Calibration
from flows.engine import flow
from gravcal.io import archive
from gravcal.store import product
from tasks.stage import read, stage

VARIANTS = ("one", "two", "three")
SCHEMA = {"time": {"dims": "time"}, "value": {"dims": "time", "units": "m", "long_name": "a random walk"}}
for _kind in ("start", "scale", "report"):
    product.register(f"small.{_kind}", SCHEMA)


@dataclass(frozen=True)
class Source:
    """Where the one file of an event is."""

    event: str
    date: str
    folder: Path


@stage(reads=["file"], writes="small.start", version=1)
def start(file, *, count: int):
    """Random walk from the seed that the file names."""
    import xarray as xr

    walk = np.cumsum(np.random.default_rng(int(file.path.read_text())).standard_normal(count))
    return xr.Dataset({"value": ("time", walk)}, {"time": np.arange(count, dtype=float)})


@stage(reads=["small.start"], writes="small.scale", version=1)
def scale(started, *, gain: float):
    """Scaled walk."""
    return started.assign(value=gain * started["value"])


@stage(reads=["small.scale"], writes="small.report", version=1)
def report(*scaled):
    """Mean of all, and a result document."""
    mean = sum(one["value"] for one in scaled) / len(scaled)
    return scaled[0].assign(value=mean), {"result.json": json.dumps({"status": "delivered"})}


@flow(name="small")
def calibrate(source, chosen):
    """Five products."""
    file = archive.find(source.folder, "MAG1B", "C", source.date)
    started = start(file, event=source.event, variant="", count=chosen.count)
    return report(*(scale(started, variant=name, gain=chosen.gain) for name in VARIANTS))


def source(*, event=None, data=None, satellite=None, date=None):  # noqa: ARG001 - as for all calibrations
    """Source of one day."""
    return Source(f"small-{date}", date, data)


def document(ref):
    """Result document; reads the product as a report does."""
    found = json.loads((ref.folder / "result.json").read_text())
    return found | {"calibration": "small", "event": ref.event, "mean": float(read(ref)["value"].mean())}


CALIBRATION = Calibration(
    name="small",
    title="Small",
    quantity="Mean of a random walk",
    begins=("MAG1B",),
    satellites=("C",),
    inputs={"walk": ("MAG1B",)},
    flow=calibrate,
    products={},
    result=lambda _: (),
    simulation=None,
    source=source,
    document=document,
)
