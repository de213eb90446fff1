"""Findings in measured data, and the figures of docs/discoveries.md.

python -m benchmarks.discovery_measured --data FOLDER [--figures docs/images]; FOLDER holds grace-2014-01-15 and others
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

from flows.engine import single_threaded

single_threaded()

import numpy as np  # noqa: E402

from flows import discover, engine, thrusters  # noqa: E402
from flows.calibration import load  # noqa: E402
from gravcal import catalog  # noqa: E402
from gravcal.calibrations.published_table import observations as published  # noqa: E402
from gravcal.calibrations.thrusters import estimate, model  # noqa: E402
from gravcal.discovery import driver  # noqa: E402
from tasks import discovery, stage  # noqa: E402

RUNS = (
    ("thrusters", "grace-2014-01-15", "A"),
    ("thrusters", "grace-2014-01-15", "B"),
    ("magnetometer", "grace-2003-09-14/binary", "A"),
    ("magnetometer", "grace-2003-09-14/binary", "B"),
    ("magnetometer", "gracefo-2023-06-01", "C"),
    ("magnetometer", "gracefo-2023-06-01", "D"),
    ("ranging", "grace-2014-01-15", "AB"),
)
SHIFTS_S = (*np.arange(-60.0, 61.0, 5.0), *np.arange(-4.0, 1.5, 0.5))
LAGS_S = np.arange(-17.5, 18.0, 5.0)


def documents(root: Path) -> list[dict]:
    """Document of every run, printed as lines, from a folder of measured data."""
    found, study = [], discover.STUDIES["published_table"]
    runs = [(name, load(name).source(data=root / folder, satellite=letters)) for name, folder, letters in RUNS]
    for name, source in [*runs, (study.name, study)]:
        ref = engine.run(discover.flow_of(name), source, catalog.parameters(name), engine="inline")
        found.append(discover.document(ref))
    for document in found:
        print(document["calibration"], document["event"])
        for one in document["findings"]:
            values = {k: f"{v['value']:.3g} +- {v['sigma']:.2g}" for k, v in one["parameters"].items() if v["sigma"]}
            print(f"  {one['cause']} {one['form']} tied with {one['tied_with']}: {values}")
            gains = one["heldout_gain"]
            print(f"     gain {gains['in_sample_chi2']:.1f}, held out {gains['chi2']:.1f}")
        print(f"  adequate before {document['adequate_before']}, after {document['adequate_after']}")
    return found


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
    rows = estimate.rows_of(records.camera, noise, **thrusters.settings(source, chosen))
    return Attitude(records.firings, rows)


def draw(root: Path, folder: Path) -> None:
    """Figures of the page, from a folder of measured data into another."""
    import matplotlib as mpl

    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "gravcal"
    from matplotlib import pyplot as plt

    folder.mkdir(parents=True, exist_ok=True)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    for letter, color in (("A", "#1f77b4"), ("B", "#d55e00")):
        day = attitude(root, letter)
        shifts = np.sort(SHIFTS_S)
        left.plot(shifts, [day.gain_at(s) for s in shifts], color=color, marker=".", lw=1, label=f"GRACE-{letter}")
        value, sigma = day.around_a_firing(0)
        right.errorbar(LAGS_S + (letter == "B"), value, 3 * sigma, color=color, marker="o", ls="", capsize=3)
    left.set(xlabel="all firings moved by (s)", ylabel="gain in chi-square", yscale="log")
    left.legend(frameon=False)
    right.axhline(0, color="0.6", lw=0.8)
    right.set(xlabel="time from the tag of a firing (s)", ylabel="roll impulse / nominal")
    figure.savefig(folder / "discovery_firings.svg", metadata={"Date": None})
    plt.close(figure)
    table(folder, plt)


def table(folder: Path, plt) -> None:
    """Published offsets by manoeuvre, and what one offset with a current leak gives."""
    study = discover.STUDIES["published_table"]
    chosen = catalog.parameters(study.name)
    observed = published.observe({}, **study.discovery.settings(study, chosen))
    limits = driver.Limits(*(getattr(chosen, name) for name in discovery.LIMITS))
    found = driver.discover(observed, limits)
    block, axis = found["block"].values, found["component"].values
    fitted = (found["observed"] - found["residual_after"]).values
    value, sigma, known = observed.printed
    figure, axes = plt.subplots(1, 3, figsize=(9, 3.0), layout="constrained")
    for k, panel in enumerate(axes):
        number, place = np.flatnonzero(known[:, k]), np.flatnonzero(axis == k)
        scale = 1e6 * sigma[number, k]
        panel.errorbar(number + 1, 1e6 * value[number, k], scale, color="k", marker="o", ls="", capsize=3)
        panel.plot(block[place] + 1.2, fitted[place] * scale, color="#d55e00", marker="x", ls="")
        panel.set(title=f"d{'xyz'[k]}", xlabel="manoeuvre", ylabel="um" if k == 0 else "", xlim=(0.5, 7.7))
    figure.savefig(folder / "discovery_table.svg", metadata={"Date": None})
    plt.close(figure)


def main():
    """Print the findings and draw the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--figures", type=Path)
    parser.add_argument("--json", type=Path, help="write all documents")
    given = parser.parse_args()
    if given.figures:
        draw(given.data, given.figures)
    else:
        found = documents(given.data)
        if given.json:
            given.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
