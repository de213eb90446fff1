"""Findings in measured data, and with --out the figures of docs/discoveries.md; --data holds the days by name."""

from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np

from benchmarks.tables import Figure, say
from flows import discover, engine, thrusters
from flows.calibration import load
from gravcal import catalog
from gravcal.calibrations.published_table import observations as published
from gravcal.calibrations.thrusters import estimate, model
from gravcal.discovery import driver
from tasks import discovery, stage

RUNS = (
    ("thrusters", "grace-2014-01-15", "A"),
    ("thrusters", "grace-2014-01-15", "B"),
    ("magnetometer", "grace-2003-09-14/binary", "A"),
    ("magnetometer", "grace-2003-09-14/binary", "B"),
    ("magnetometer", "gracefo-2023-06-01", "C"),
    ("magnetometer", "gracefo-2023-06-01", "D"),
    ("ranging", "grace-2014-01-15", "AB"),
)
TABLE = discover.STUDIES["published_table"]
SHIFTS_S = np.sort((*np.arange(-60.0, 61.0, 5.0), *np.arange(-4.0, 1.5, 0.5)))
LAGS_S = np.arange(-17.5, 18.0, 5.0)


def measured(options) -> list[Figure]:
    """Print what every run finds, or draw the figures."""
    if options.out:
        draw(options.data, Path(options.out))
        return []
    runs = [(name, load(name).source(data=options.data / folder, satellite=letters)) for name, folder, letters in RUNS]
    for name, source in [*runs, (TABLE.name, TABLE)]:
        ref = engine.run(discover.flow_of(name), source, catalog.parameters(name), engine="inline")
        document = discover.document(ref)
        say(f"{document['calibration']} {document['event']}")
        for one in document["findings"]:
            values = {k: f"{v['value']:.3g} +- {v['sigma']:.2g}" for k, v in one["parameters"].items() if v["sigma"]}
            say(f"  {one['cause']} {one['form']} tied with {one['tied_with']}: {values}")
            gains = one["heldout_gain"]
            say(f"     gain {gains['in_sample_chi2']:.1f}, held out {gains['chi2']:.1f}")
        say(f"  adequate before {document['adequate_before']}, after {document['adequate_after']}")
    return []


@dataclass(frozen=True)
class Attitude:
    """Attitude of one satellite with everything but the firings removed."""

    firings: model.Firings
    rows: list  #: whitened rows of every block

    def fitted(self, columns):
        """Value, sigma and gain of columns (n, 3, q) rad by block."""
        each = [row.less(row.whiten(row.segment.sharp(c))) for row, c in zip(self.rows, columns, strict=True)]
        normal = sum(one.T @ one for one in each)
        right = sum(one.T @ row.less(row.observed) for row, one in zip(self.rows, each, strict=True))
        value = np.linalg.solve(normal, right)
        return value, np.sqrt(np.diag(np.linalg.inv(normal))), float(right @ value)

    def gain_at(self, shift):
        """Gain in chi-square of all firings moved in time."""
        return self.fitted([row.segment.gains(self.firings.late_by(-shift)) for row in self.rows])[2]

    def around_a_firing(self, axis):
        """Torque about an axis at lags from the tag of a firing, as shares of its nominal impulse."""
        impulse, time = (self.firings.impulse_b * np.eye(3)[axis])[:, :, None], self.firings.time
        columns = [
            np.concatenate([row.segment.after(time + lag, impulse) for lag in LAGS_S], axis=2) for row in self.rows
        ]
        return self.fitted(columns)[:2]


def attitude(root: Path, letter: str) -> Attitude:
    """Attitude of a satellite on 2014-01-15."""
    chosen = catalog.parameters("thrusters")
    source = load("thrusters").source(data=root / "grace-2014-01-15", satellite=letter)
    products = {name: stage.read(ref) for name, ref in thrusters.DISCOVERY.baseline(source, chosen).items()}
    records, noise = model.records(products["align"]), model.noise_of(products["noise"])
    return Attitude(records.firings, estimate.rows_of(records.camera, noise, **thrusters.settings(source, chosen)))


def draw(root: Path, folder: Path) -> None:
    """Figures of the page, from a folder of measured data into another."""
    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "gravcal"
    from matplotlib import pyplot as plt

    folder.mkdir(parents=True, exist_ok=True)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    for letter, color in (("A", "#1f77b4"), ("B", "#d55e00")):
        day = attitude(root, letter)
        gains = [day.gain_at(s) for s in SHIFTS_S]
        left.plot(SHIFTS_S, gains, color=color, marker=".", lw=1, label=f"GRACE-{letter}")
        value, sigma = day.around_a_firing(0)
        right.errorbar(LAGS_S + (letter == "B"), value, 3 * sigma, color=color, marker="o", ls="", capsize=3)
    left.set(xlabel="all firings moved by (s)", ylabel="gain in chi-square", yscale="log")
    left.legend(frameon=False)
    right.axhline(0, color="0.6", lw=0.8)
    right.set(xlabel="time from the tag of a firing (s)", ylabel="roll impulse / nominal")
    figure.savefig(folder / "discovery_firings.svg", metadata={"Date": None})
    figure, axes = plt.subplots(1, 3, figsize=(9, 3.0), layout="constrained")
    table(axes)
    figure.savefig(folder / "discovery_table.svg", metadata={"Date": None})


def table(axes) -> None:
    """Published offsets by manoeuvre, and what one offset with a current leak gives, a panel for each component."""
    chosen = catalog.parameters(TABLE.name)
    observed = published.observe({}, **TABLE.discovery.settings(TABLE, chosen))
    limits = driver.Limits(*(getattr(chosen, name) for name in discovery.LIMITS))
    found = driver.discover(observed, limits)
    block, axis = found["block"].values, found["component"].values
    fitted = (found["observed"] - found["residual_after"]).values
    value, sigma, known = observed.printed
    for k, panel in enumerate(axes):
        number, place = np.flatnonzero(known[:, k]), np.flatnonzero(axis == k)
        scale = 1e6 * sigma[number, k]
        panel.errorbar(number + 1, 1e6 * value[number, k], scale, color="k", marker="o", ls="", capsize=3)
        panel.plot(block[place] + 1.2, fitted[place] * scale, color="#d55e00", marker="x", ls="")
        panel.set(title=f"d{'xyz'[k]}", xlabel="manoeuvre", ylabel="um" if k == 0 else "", xlim=(0.5, 7.7))
