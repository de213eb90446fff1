"""Simulated events through the flow of the project, in memory: no files, no store; and the bound of their offset."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from unittest import mock

import numpy as np
import xarray as xr
from scipy.linalg import cholesky, solve_triangular, toeplitz

from flows import com_offset
from gravcal import catalog
from gravcal.io.readers import TICKS, records
from gravcal.simulation import com_offset as simulation
from gravcal.simulation import sensors
from gravcal.store.store import ProductRef
from tasks import stage

LAGS = 2**17  # samples of the circle on which the spectrum is summed, long against any memory of the noise


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
    table = records.product(product, records.mission_of(satellite))
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


def bound(event, drift_degree: int) -> np.ndarray:
    """Smallest covariance (3, 3) m2 that an unbiased estimate of the offset of a Simulated event can have.

    From true motion and true noise; nothing of the estimator is used. Known: rates, angular accelerations and gravity
    gradient as the simulator flew them, at the true epochs of the readings, inertia and dipole with them, the noise
    densities of the simulator and the quantisation. Every sample of the square wave counts (10 Hz, 180 s). Unknown
    beside the offset: a polynomial of time per axis and manoeuvre, of the degree that the estimator takes for the
    non-gravitational acceleration.
    """
    factors = _factors(*_noise_of(event))
    information = np.zeros((3, 3))
    for wave in event.truth["manoeuvres"]:
        time, design = _during(event.motion, wave["start"], wave["stop"])
        drift = np.polynomial.legendre.legvander(np.linspace(-1, 1, time.size), drift_degree)
        for axis in range(3):
            root = factors[axis][: time.size, : time.size]
            columns = np.concatenate([drift, design[:, axis]], axis=1)
            white = solve_triangular(root, columns, lower=True, check_finite=False)
            information += _without(white[:, : drift_degree + 1], white[:, drift_degree + 1 :])
    return np.linalg.inv(information)


def _during(motion, start, stop):
    """Epochs of the readings between the first and the last edge, and the reading per metre of offset (n, 3, 3)."""
    inside = [(epochs.acc >= start) & (epochs.acc < stop) for epochs, _ in motion]
    (epochs, true), inside = max(zip(motion, inside, strict=True), key=lambda part: part[1].sum())
    w, wd, G = true.rate_b[inside], true.rate_dot_b[inside], true.gradient_b[inside]
    columns = []
    for unit in np.eye(3):  # p = -offset; felt is w' x p + w x (w x p) - G p
        columns.append(-(np.cross(wd, unit) + np.cross(w, np.cross(w, unit)) - G @ unit))
    return epochs.acc[inside], np.stack(columns, axis=-1)


def _without(nuisance, columns):
    """Information (3, 3) that is left when the nuisance is free."""
    basis, _ = np.linalg.qr(nuisance)
    clean = columns - basis @ (basis.T @ columns)
    return clean.T @ clean


def _noise_of(event):
    """Hashable description of the noise: nodes in Hz, amplitudes of each axis, variance of rounding, step in s."""
    chosen, satellite = event.chosen, event.satellite
    tables = tuple(tuple(chosen.noise_scale * a for a in getattr(chosen, f"linear_noise_{x}")) for x in "xyz")
    rounding = tuple(step**2 / 12 for step in satellite["accelerometer_step"])
    return tuple(chosen.noise_frequency_hz), tables, rounding, satellite["accelerometer_interval"]


@functools.cache
def _factors(nodes, tables, rounding, step, count=1850):
    """Cholesky factor of the covariance of `count` samples, one an axis; its leading part serves fewer samples."""
    frequency = np.fft.rfftfreq(LAGS, step)
    factors = []
    for amplitude, variance in zip(tables, rounding, strict=True):
        log = np.interp(np.log(np.maximum(frequency, nodes[0])), np.log(nodes), np.log(amplitude))
        correlation = np.fft.irfft(np.exp(2 * log))[:count] / (2 * step)
        correlation[0] += variance
        factors.append(cholesky(toeplitz(correlation), lower=True))
    return factors
