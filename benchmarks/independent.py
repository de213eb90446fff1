"""Recovery from events of the second simulator of the tests, which shares no code with gravcal: files, store, flow."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np

from benchmarks import recovery
from benchmarks.tables import Figure, say, title

EFFECT = {"acc": "acc_delay_s", "sca": "sca_delay_s"}


def run(options) -> list[Figure]:
    """Study of the second simulator through files and the inline flow."""
    count = options.runs or (4 if options.quick else 40)
    seeds = range(options.seed, options.seed + count)
    title(f"independent: com_offset, {count} events of the second simulator, seeds {seeds[0]} to {seeds[-1]}")
    say("Level-1 files of seven windows, read and run through the flow; its own orbit, field, attitude and noise")
    return recovery.report(list(recovery.spread(one, seeds, options.workers)), bound=False)


def one(seed: int) -> dict:
    """Errors of one event of the second simulator.

    Parameters
    ----------
    seed : of the simulator; offset and delays are drawn from it too
    """
    from tests.independent import make_event

    rng = np.random.default_rng([seed, 11])
    offset = np.array([107.0, -40.0, 12.0]) + 60.0 * rng.standard_normal(3)
    delay = dict(zip(EFFECT, recovery.DELAY_SIGMA_S * rng.standard_normal(2), strict=True))
    effects = {EFFECT[name]: float(value) for name, value in delay.items()}
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder) / "level1"
        make_event(files, seed, offset_um=tuple(offset), effects=effects, window_s=(420.0, 420.0))
        os.environ["GRAVCAL_PRODUCTS"] = str(Path(folder) / "products")
        made = calibrated(files, {"igrf_generation": 13})
        row = recovery.measured(made["com_offset.combine"], made["com_offset.attitude"], offset, delay)
    return row | {"seed": seed}


def calibrated(folder: Path, settings: dict) -> dict:
    """Products of the flow that are wanted here, by stage.

    Parameters
    ----------
    folder : of the Level-1 files
    settings : parameters of the calibration that differ from the catalogue
    """
    from flows import com_offset, engine
    from gravcal import catalog
    from gravcal.store import memory, store
    from tasks import common, stage

    memory.clear()
    chosen = catalog.parameters("com_offset").with_settings(settings)
    ref = engine.run(com_offset.calibrate, com_offset.CALIBRATION.source(data=folder), chosen, engine="inline")
    keys = common.product_keys(ref)
    return {name: stage.read(store.find(keys[name])) for name in ("com_offset.combine", "com_offset.attitude")}
