"""Findings in measured data, and every figure of the days at hand beside the one that was first said of it.

--data holds the days by name, --out draws the figure of docs/discoveries.md.
"""

from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np

from benchmarks.tables import Figure, grid, numbers, say, title
from flows import discover, engine, ranging, thrusters
from flows import kbr_phase_centre as wiggles
from flows.calibration import load
from gravcal import catalog
from gravcal.calibrations.published_table import observations as published
from gravcal.calibrations.ranging import model as routine
from gravcal.calibrations.thrusters import estimate, model
from gravcal.discovery import design, driver
from gravcal.errors import GravcalError
from gravcal.estimation import least_squares, noise, robust
from tasks import common, stage
from tasks import kbr_phase_centre as of_pair

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


#: Of the table: one offset alone, the least that a coupling of yaw leaves, a current of the y rod, one of the x rod.
CAUSES = (
    ("one offset alone", "", "", (858, 1584, 2284, 713)),
    ("and yaw acceleration into a_y", "accelerometer.angular_leak", "y_from_z", (35, 51, 78, 27)),
    ("and the current of the y rod into a_y", "accelerometer.current_leak", "y_from_y", (106, 167, 250, 78)),
    ("and the current of the x rod into a_z", "accelerometer.current_leak", "z_from_x", None),
)
VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")
#: Two more manoeuvres: kind and area of those of the table that they are like, latitude in deg, where x points.
MORE = {
    "none": (),
    "yaws at 0 and 45 deg": (("yaw", "low", 0.0, 1), ("yaw", "low", 45.0, 1)),
    "yaws at 15 deg, one with the heading reversed": (("yaw", "low", 15.0, 1), ("yaw", "low", 15.0, -1)),
    "rolls at 40 and 70 deg": (("roll", "high", 40.0, 1), ("roll", "high", 70.0, 1)),
    "pitches with the x rod at 45 and 80 deg": (("pitch", "high", 45.0, 1), ("pitch", "high", 80.0, 1)),
    "pitches with the x rod at 30 and 80 deg": (("pitch", "high", 30.0, 1), ("pitch", "high", 80.0, 1)),
}
#: Shares of the correction by band, and its 10 to 40 mHz, where nearly all of it is noise.
SHARES = {5: "0.95 +- 0.09", 10: "0.41 +- 0.18", 20: "0.14 +- 0.12", 40: "-0.03 +- 0.06"}
TRAP_HZ = (0.01, 0.04)
TRAP_SAID = ("-0.06 +- 0.65, 3.4 +- 0.8", "0.25 +- 0.55, 2.5 +- 0.4")
BEHIND_SAID = ("1444.5 -0.42 2.28", "1445.0 0.57 3.30")
X_SAID = "-170 +- 111, 180 +- 76"
MISSING = "not run, inputs missing"


def measured(options) -> list[Figure]:
    """Print what every run finds, and every figure beside what was said of it; or draw the picture."""
    if options.out:
        draw(options.data, Path(options.out))
        return []
    found = {}
    for name, folder, letters in RUNS:
        try:
            source = load(name).source(data=options.data / folder, satellite=letters)
            found[name, folder, letters] = searched(name, source)
        except GravcalError as error:
            say(f"{name} {folder} {letters}: {MISSING}: {error}")
    searched(TABLE.name, TABLE)
    rows = [*_thrusters(found), *_magnetometer(found), *of_table()]
    rows += of_day(options.data / RUNS[-1][1]) if RUNS[-1] in found else [("routine ranging", MISSING, "")]
    title("figures, and what was said of them")
    grid([("", "here", "said"), *rows])
    return []


def searched(name, source) -> dict:
    """Document of a search, printed."""
    ref = engine.run(discover.flow_of(name), source, catalog.parameters(name), engine="inline")
    document = discover.document(ref)
    say(f"{document['calibration']} {document['event']}")
    for one in document["findings"]:
        values = {k: f"{v['value']:.3g} +- {v['sigma']:.2g}" for k, v in one["parameters"].items() if v["sigma"]}
        say(f"  {one['cause']} {one['form']} tied with {one['tied_with']}: {values}")
        gains = one["heldout_gain"]
        say(f"     gain {gains['in_sample_chi2']:.1f}, held out {gains['chi2']:.1f}")
    say(f"  adequate before {document['adequate_before']}, after {document['adequate_after']}")
    return document


def _named(found, key, cause):
    """Parameters of a cause of a run as printed, {name: text}; none where it did not run or did not name it."""
    causes = {one["cause"]: one for one in found.get(key, {"findings": []})["findings"]}
    own = causes.get(cause, {"parameters": {}})["parameters"]
    unit = {name: "" if one["unit"] == "1" else f" {one['unit']}" for name, one in own.items()}
    return {name: f"{one['value']:.3g} +- {one['sigma'] or 0:.2g}{unit[name]}" for name, one in own.items()}


def _thrusters(found):
    for key, late in zip(RUNS[:2], (1.59, 1.46), strict=True):
        firings, delay, steps = (
            _named(found, key, cause)
            for cause in ("torque.thruster_firings", "timing.thruster_delay", "unknown:star_camera_in_use")
        )
        other = "not named" if key in found else MISSING
        yield f"GRACE-{key[2]}: roll impulse over nominal", firings.get("share_x", other), "1.5"
        yield "  tags late", delay.get("delay", other), f"{late} s"
        yield "  steps with the camera in use", ", ".join(steps.values()) or other, "there are steps"


def _magnetometer(found):
    for key in RUNS[2:4]:
        own = _named(found, key, "magnetometer.current_leak")
        other = "not named" if key in found else MISSING
        yield f"GRACE-{key[2]}: leak of the torquers", "" if own else other, "a leak"
        yield from ((f"  {name}", value, "") for name, value in own.items())


def of_table():
    """Chi-square of 13 degrees of freedom, evidence, and odds of two more manoeuvres."""
    settings = [catalog.parameters(TABLE.name).with_settings({"variant": one}) for one in VARIANTS]
    tables = [published.observe({}, **TABLE.discovery.settings(TABLE, one)) for one in settings]
    yield "Table 7, chi-square", ", ".join(VARIANTS), ""
    for name, cause, form, said in CAUSES:
        yield (
            f"  {name}",
            numbers([left(one, cause, form) for one in tables], ".0f"),
            numbers(said, ".0f") if said else "",
        )
    odds = []
    for one in tables:
        weighed = {row["cause"]: row["log_odds"] for row in one.weighed()}
        odds.append(np.exp(weighed["accelerometer.angular_leak"] - weighed["accelerometer.current_leak"]))
    yield "  odds of the coupling against a current", numbers(odds, ".0f"), "not weighed"
    for name, more in MORE.items():
        chi2 = apart(tables[0], more)
        yield f"  two more, {name}", f"{chi2:.0f}, {design.odds(chi2, 2 * np.log(driver.TIED_ODDS)):.2f}", ""


def left(table, cause="", form=""):
    """Chi-square of the printed numbers beside one offset, and the best of the forms of a cause that begin so."""
    (value, sigma, known), beside = table.printed, [np.zeros((len(table.rows), 3, 0))]
    if cause:
        beside = [one.columns for one in table.causes if one.cause == cause and one.form.startswith(form)]
    return min(_misfit((value / sigma)[known], *_whitened(columns, sigma, known)) for columns in beside)


def apart(table, more=()):
    """Least chi-square expected of a current that leaks where yaw acceleration in a_y acts, as large as fitted.

    Manoeuvres of MORE are flown beside the table, with errors as those of their kind in it.
    """
    value, sigma, known = table.printed
    kinds = [(row["kind"], row["latitude_class"]) for row in table.rows]
    alike = [[k for k, one in enumerate(kinds) if one == (kind, area)] for kind, area, *_ in more]
    arcs = [published.arc(*one, 1, table.about) for one in kinds]
    arcs += [published.arc(kind, area, heading, table.about, latitude) for kind, area, latitude, heading in more]
    sigma = np.stack([*sigma, *(np.sqrt(np.mean(sigma[own] ** 2, axis=0)) for own in alike)])
    known = np.stack([*known, *(known[own[0]] for own in alike)])
    causes = {one.cause: one for one in published.of_readings("", arcs, table.mean)}
    angular, current = (causes[f"accelerometer.{name}_leak"] for name in ("angular", "current"))
    offset, columns = _whitened(angular.columns, sigma, known)
    y = (value / sigma[: len(value)])[known[: len(value)]]
    both = np.column_stack([offset, columns[:, angular.names.index("y_from_z")]])
    true = both[:, 3] * np.linalg.lstsq(both[: y.size], y)[0][3]
    return min(_misfit(true, offset, one[:, None]) for one in _whitened(current.columns, sigma, known)[1].T)


def _whitened(columns, sigma, known):
    """Rows of the offset (n, 3), and of columns (3, q) m of each manoeuvre (n, q), over their errors."""
    parts = zip([np.eye(3)] * len(columns), columns, strict=True)
    rows = [np.column_stack(part) / s[:, None] for part, s in zip(parts, sigma, strict=True)]
    return np.split(np.stack(rows)[known], [3], axis=1)


def _misfit(observed, *columns):
    """Chi-square that columns leave."""
    beside = np.column_stack(columns)
    return float(np.sum((observed - beside @ np.linalg.lstsq(beside, observed)[0]) ** 2))


def records(folder):
    """Source of a routine day; what is aligned, pointing, equations of the range and rows of routine pointing."""
    pair, chosen = catalog.parameters("kbr_phase_centre"), catalog.parameters("ranging")
    source = load("ranging").source(data=folder)
    aligned = wiggles.aligned_records(source, pair)
    pointed, (equations,) = wiggles.with_equations(source, pair, aligned, ("range",))
    rows, _ = ranging.quiet_rows(source, chosen)
    return source, *map(stage.read, (aligned, pointed, equations, rows))


def of_day(folder):
    """What the range of a routine day says of the antennas, and what it only seems to say."""
    source, aligned, pointed, equations, rows = records(folder)
    found = engine.run(load("ranging").flow, source, catalog.parameters("ranging"), engine="inline")
    document, soe = common.document(found, "result.json"), held_mm(source)
    for band in document["share"]:
        low, high = band["band_mhz"]
        name, said = f"share of the correction, {low:g} to {high:g} mHz", SHARES.get(low, "")
        yield name, f"{band['value']:.2f} +- {band['sigma']:.2f} (expected {band['expected']:.2f})", said
    for (name, own), true in zip(document["parameters"].items(), soe, strict=True):
        value = f"{own['value']:.1f} +- {own['sigma']:.1f}" if own else "null"
        yield f"  {name}, smoothed pointing", f"{value} mm", f"{true:.1f}, or null"
    quiet = of_pair.noise(equations, **catalog.parameters("kbr_phase_centre").for_stage("noise"))
    density = [1e3 * np.sqrt(np.interp(f, quiet["frequency"], quiet["model"])) for f in (3e-3, 4e-3, 5e-3)]
    mean = 1e-3 * document["share"][0]["range_um"]["none"]
    yield "range minus orbit at 3, 4, 5 mHz", f"{numbers(density, '.2f')} mm/sqrt(Hz)", "0.32 at 4"
    yield "  mean from 2.5 to 5 mHz", f"{mean:.2f} mm/sqrt(Hz)", ""
    smooth = 1e-3 * rows["column"].values
    for name, one, said in (("as measured", of_quiet(equations), X_SAID), ("smoothed", smooth, "1445.1, 1444.4")):
        value, sigma = regressed(rows, rows["observed"].values, one)
        yield f"x by pointing {name}", ", ".join(f"{value[k]:.0f} +- {sigma[k]:.0f}" for k in (0, 3)) + " mm", said
    yield "  as measured, another day", MISSING, "-636 +- 153"
    value, sigma, share = trap(rows, equations, soe)
    behind = numbers(1e3 * behind_correction(aligned, pointed).value, ".2f").split()
    for k, letter in enumerate(source.satellite):
        text = ", ".join(f"{value[i]:.2f} +- {sigma[i]:.2f}" for i in (2 * k, 2 * k + 1))
        yield f"{letter}: y, z by 10 to 40 mHz, x held", f"{text} mm", TRAP_SAID[k]
        yield "  behind the file's correction", f"{' '.join(behind[3 * k : 3 * k + 3])} mm", BEHIND_SAID[k]
    yield "share of the correction, 10 to 40 mHz", "{:.2f} +- {:.2f}".format(*share), "about 0"


def held_mm(source):
    """Phase centres (6,) mm of the catalogue."""
    return 1e3 * np.concatenate([catalog.satellite(letter).com_to_antenna.value for letter in source.satellite])


def of_quiet(equations):
    """Columns (n, 6) of routine pointing as measured, m of range per mm."""
    return 1e-3 * equations["column"].values[equations["arc"].values == -1]


def trap(rows, equations, held):
    """y, z of both (4,) mm with x held, their sigmas, and (share, sigma) of the correction, where pointing is noise."""
    step, time, (low, high) = routine.step_of(rows), rows["time"].values, TRAP_HZ
    even = np.arange(time[0], time[-1] + step, step)
    grid = np.stack([np.interp(even, time, one - one[0]) for one in of_quiet(equations).T], axis=1)
    noisy = noise.filtered(grid, step, lambda f: (f >= low) & (f < high))[np.rint((time - time[0]) / step).astype(int)]
    observed, x = rows["observed"].values, [0, 3]
    value, sigma = regressed(rows, observed - noisy[:, x] @ held[x], np.delete(noisy, x, axis=1))
    return value, sigma, np.ravel(regressed(rows, observed, (noisy @ held)[:, None]))


def regressed(rows, observed, column):
    """Sizes and sigmas of columns (n, q) of a range (n,), by the blocks and the noise of the day."""
    settings = catalog.parameters("ranging").for_stage("estimate")
    settings.pop("determined_limit_mm")
    parts = routine.blocks(rows, **settings, beside=column)
    information, right, _ = routine.equations_of(parts, rows, observed, column)
    covariance = least_squares.covariance(information.sum(axis=0))
    return covariance @ right.sum(axis=0), np.sqrt(np.diag(covariance))


def behind_correction(aligned, pointed):
    """Phase centres (6,) m that the antenna correction of the file was made with, without a free bias."""
    second = np.rint(aligned["time_kbr"].values - pointed["time"].values[0]).astype(int)
    given = aligned["antenna_correction"].values
    inside = (second >= 0) & (second < pointed.sizes["time"]) & np.isfinite(given)
    line = np.concatenate(list(pointed["line_of_sight_b"].values[:, second[inside]]), axis=1)
    known = np.isfinite(line).all(axis=1)
    return robust.solve(given[inside][known], line[known], (2.0, 5.0), 6)


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
    """Figure of the page, from a folder of measured data into another."""
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
