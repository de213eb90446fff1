"""Simulated events through the flow of the project, in memory: no files, no store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from unittest import mock

import numpy as np
import xarray as xr

from flows import com_offset
from gravcal import catalog
from gravcal.io.readers import tables
from gravcal.io.readers.dataset import TICKS
from gravcal.simulation import com_offset as simulation
from gravcal.simulation import sensors
from gravcal.store.store import ProductRef
from tasks import stage


@dataclass(frozen=True)
class Simulated:
    """One invented event."""

    columns: dict  #: {product: {column: array}}, as the files would hold them
    truth: dict
    motion: list  #: (epochs, motion) of each span, true
    chosen: object  #: parameters of the simulation
    satellite: dict  #: numbers of the catalogue


def simulated(seed: int, effects: Mapping, **settings) -> Simulated:
    """An event of the simulator with the true motion behind its readings; effects are {slug: {parameter: value}}."""
    chosen = catalog.parameters("simulate_com_offset").with_settings(settings)
    satellite = catalog.satellite(chosen.satellite).settings()
    day = (datetime.fromisoformat(chosen.date) - datetime(2000, 1, 1, 12)).total_seconds()
    motion, read = [], sensors.read_instruments

    def tapped(epochs, moving, *rest):
        motion.append((epochs, moving.at(epochs.acc)))
        return read(epochs, moving, *rest)

    with mock.patch.object(sensors, "read_instruments", tapped):
        columns, truth = simulation.simulate(satellite, chosen, day, seed, effects)
    return Simulated(columns, truth, motion, chosen, satellite)


def observed(product: str, columns: Mapping, satellite: str) -> xr.Dataset:
    """Dataset of a product as its reader would give it, from the columns {name: (n,) array} of the simulator."""
    table = tables.product(product, tables.mission_of(satellite))
    second, *fraction = (np.asarray(columns[name]) for name in table.time)
    tick = TICKS[table.column(table.time[1]).units] if fraction else 0
    fraction = 1e-9 * tick * fraction[0] if fraction else np.zeros(second.size)
    none = np.zeros(second.size, dtype=np.uint8)
    arrays = dict(columns) | {"time_second": second.astype(np.int64), "time_fraction": fraction}
    arrays |= {"time_tag": second + fraction, "flag": none, "qualflg": none}
    values = {name: ("record", array) for name, array in arrays.items()}
    if table.current_b_sign:
        coils = [columns[f"torque{i}A"] + table.current_b_sign * columns[f"torque{i}B"] for i in (1, 2, 3)]
        values["current_b"] = (("record", "axis"), np.stack(coils, axis=1))
    if table.receiver_time:
        whole, part = table.receiver_time
        values["receiver_second"] = ("record", columns[whole])
        values["receiver_fraction"] = ("record", 1e-9 * TICKS[table.column(part).units] * columns[part])
    return xr.Dataset(values, attrs={"product": product, "satellite": satellite, "file": product})


@dataclass(frozen=True)
class _Held:
    """Stands for a Level-1 file that is in memory."""

    product: str
    satellite: str
    path: None = None


@dataclass(frozen=True)
class _Source:
    """Stands for a folder of Level-1 files."""

    columns: dict = field(repr=False)
    satellite: str
    event: str = "in-memory"

    def file(self, *products):
        """The first of these products that was simulated."""
        return _Held(next(name for name in products if name in self.columns), self.satellite)

    def files(self, *products):
        """All of these products that were simulated."""
        return [_Held(name, self.satellite) for name in products if name in self.columns]


def calibrated(event: Simulated, **settings) -> dict[str, xr.Dataset]:
    """Every product of the flow but its report, by kind and variant, with these settings."""
    held, letter = {}, event.chosen.satellite

    def compute(call):
        if call.stage.writes == "ingest":
            made = observed(call.inputs[0].product, event.columns[call.inputs[0].product], letter)
        elif call.stage.writes == "com_offset.report":
            return call.unmade
        else:
            made = call.stage.body(*(held[ref.stage] for ref in call.inputs), **call.settings)
        ref = ProductRef(call.event, call.stage.writes, call.variant)
        held[ref.stage] = made
        return ref

    chosen = catalog.parameters("com_offset").with_settings({"igrf_generation": event.chosen.igrf_generation})
    with stage.using(compute):
        com_offset.calibrate(_Source(event.columns, letter), chosen.with_settings(settings))
    return held
