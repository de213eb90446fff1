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

from flows import discover_measured, measured_attitude  # noqa: E402
from gravcal import catalog  # noqa: E402
from gravcal.calibrations.attitude_thrusters import noise as noises  # noqa: E402
from gravcal.calibrations.attitude_thrusters import placebo, series, view  # noqa: E402
from tasks import common  # noqa: E402

RUNS = (
    ("attitude", "grace-2014-01-15", "AB", "2014-01-15", {}),
    ("ranging", "grace-2014-01-15", None, "2014-01-15", {}),
    ("ranging", "grace-2014-01-15", None, "2014-01-15", {"correction_left_out": "false"}),
    ("magnetometer", "grace-2003-09-14/binary", "AB", "2003-09-14", {}),
    ("magnetometer", "gracefo-2023-06-01", "CD", "2023-06-01", {}),
    ("published_table", ".", None, None, {}),
)
SHIFTS_S = (*np.arange(-60.0, 61.0, 5.0), *np.arange(-4.0, 1.5, 0.5))
LAGS_S = np.arange(-17.5, 18.0, 5.0)


def documents(root: Path) -> list[dict]:
    """Document of every run, printed as lines.

    Parameters
    ----------
    root : folder of measured data
    """
    found = []
    for name, folder, satellite, date, settings in RUNS:
        document = discover_measured.discover(name, root / folder, satellite, date, settings)
        found.append(document)
        print(f"{name} {document['event']} {settings or ''}")
        for label, facts in document["facts"].items():
            print(f"  {label}: {json.dumps({k: v for k, v in facts.items() if k != 'placebo_gains'})}")
        for one in document["findings"]:
            values = {k: f"{v['value']:.3g} +- {v['sigma']:.2g}" for k, v in one["parameters"].items() if v["sigma"]}
            print(f"  {one['in']} {one['cause']} {one['form']} tied with {one['tied_with']}: {values}")
            held = one["heldout_gain"]["chi2"]
            print(f"     gain {one['gain']['chi2']:.1f} ({one['gain']['dof']}), held out {held:.1f}")
        print(f"  adequate before {document['adequate_before']}, after {document['adequate_after']}")
    return found


@dataclass(frozen=True)
class Attitude:
    """Attitude of one satellite with everything but the firings removed.

    Attributes
    ----------
    firings : Firings; noise : Noise; scenes : list of Scene, one a block
    bases : (n, k) of the smooth torque a block; rest : (n,) what is left of each block
    """

    firings: series.Firings
    noise: noises.Noise
    scenes: list
    bases: list
    rest: list

    def fitted(self, columns):
        """Value, sigma and gain of columns (n, 3, q) rad by block."""
        rows = [self.noise.rows(s.camera.head, s.place, s.sharp(c)) for s, c in zip(self.scenes, columns, strict=True)]
        rows = [placebo.less(q, r) for q, r in zip(self.bases, rows, strict=True)]
        normal = sum(r.T @ r for r in rows)
        right = sum(r.T @ y for r, y in zip(rows, self.rest, strict=True))
        value = np.linalg.solve(normal, right)
        return value, np.sqrt(np.diag(np.linalg.inv(normal))), float(right @ value)

    def gain_at(self, shift):
        """Gain in chi-square of all firings moved in time."""
        moved = series.Firings(self.firings.time + shift, self.firings.impulse_b)
        return self.fitted(view._firings(self.scenes, moved)["columns"])[2]

    def around_a_firing(self, axis):
        """Torque about an axis at lags from the tag of a firing, as shares of its nominal impulse."""
        impulse = (self.firings.impulse_b * np.eye(3)[axis])[:, :, None]
        columns = [
            np.concatenate([s.answer(self.firings.time + lag, impulse) for lag in LAGS_S], axis=2) for s in self.scenes
        ]
        return self.fitted(columns)[:2]


def attitude(root: Path, letter: str) -> Attitude:
    """Attitude of 2014-01-15.

    Parameters
    ----------
    root : folder of measured data; letter : of the satellite
    """
    chosen = catalog.parameters("discover_measured").for_stage("attitude")
    source = common.source_of("com_offset", ("THR1B",), data=root / "grace-2014-01-15", satellite=letter)
    camera, firings, *_, inertia = measured_attitude._inputs(source, letter)[0]
    noise = noises.measured(camera, firings.time, chosen)
    usable = camera.part(np.isin(camera.head, list(noise.factor)))
    scenes = [view._scene(p, inertia, chosen) for p in view._parts(usable, chosen["block_s"])]
    blocks = [view._block(s, noise) for s in scenes]
    bases = [placebo.basis(b["own"]) for b in blocks]
    rest = [placebo.less(q, b["observed"]) for q, b in zip(bases, blocks, strict=True)]
    return Attitude(firings, noise, scenes, bases, rest)


def draw(root: Path, folder: Path) -> None:
    """Figures of the page.

    Parameters
    ----------
    root : folder of measured data; folder : of the figures
    """
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
    rows = discover_measured.measured_table.view.variants(catalog.published("com_offset")["manoeuvres"])["mtq"]
    chosen = catalog.parameters("discover_measured")
    prepared = discover_measured.measured_table.prepare(None, None, None, chosen)
    label, blocks, candidates = prepared["runs"][0]
    result = discover_measured.searched(blocks, candidates, chosen)
    baseline = result.baseline
    total = result.problem.total
    value = np.linalg.pinv(total[np.ix_(baseline, baseline)]) @ total[baseline, 0]
    figure, axes = plt.subplots(1, 3, figsize=(9, 3.0), layout="constrained")
    for axis, name in enumerate("xyz"):
        for k, row in enumerate(rows):
            if not np.isfinite(row["value"][axis]):
                continue
            place = int(np.flatnonzero(blocks[k]["axis"] == axis)[0])
            predicted = result.problem.columns[k].of(baseline)[place] @ value
            scale = row["sigma"][axis] * prepared["facts"][label]["error_factor_by_repeats"]
            axes[axis].errorbar(k + 1, 1e6 * row["value"][axis], 1e6 * scale, color="k", marker="o", capsize=3)
            axes[axis].plot(k + 1.2, 1e6 * predicted * scale, color="#d55e00", marker="x")
        axes[axis].set(title=f"d{name}", xlabel="manoeuvre", ylabel="um" if axis == 0 else "", xlim=(0.5, 7.7))
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
