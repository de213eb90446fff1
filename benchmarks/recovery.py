"""Recovery of an invented centre-of-mass offset over many events, against its error and the Cramer-Rao bound."""

from __future__ import annotations

import multiprocessing
import os
import tempfile
from pathlib import Path

import numpy as np

from benchmarks import events, scores
from benchmarks.tables import Figure, grid, say, show, title
from flows import com_offset, engine
from gravcal import catalog
from gravcal.calibrations.com_offset import solve
from gravcal.store import memory, store
from tasks import common, stage

VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")
HELD_TO_BOUND = VARIANTS[:3]
DELAYS = ("acc", "sca")
DELAY_SIGMA_S = 0.1  # of the delays that are drawn for each event, the prior of the effects
FAMILY = 12 + 12 + 2 + 5 + 4  # rms, scatter, delays, consistency, residuals


def run(options) -> list[Figure]:
    """Study of the first simulator, in memory."""
    count = options.runs or (12 if options.quick else 200)
    seeds = range(options.seed, options.seed + count)
    title(f"recovery: com_offset, {count} simulated events, seeds {seeds[0]} to {seeds[-1]}")
    say(f"seven manoeuvres, offset 60 um and delays {DELAY_SIGMA_S} s (sigma) drawn for each event, divisors exact")
    return report(list(spread(one, seeds, options.workers)))


def adopted(options) -> list[Figure]:
    """What is handed on, where inertia and dipole per current are drawn from their priors: error and total error."""
    count = options.runs or (12 if options.quick else 40)
    seeds = range(options.seed, options.seed + count)
    title(f"adopted: com_offset, {count} simulated events with divisors drawn, seeds {seeds[0]} to {seeds[-1]}")
    names, error, total = (np.array(one) for one in zip(*spread(one_adopted, seeds, options.workers), strict=True))
    rows = [("um", "rms error x, y, z", "mean total error", "adopted")]
    for k, name in enumerate(VARIANTS):
        rms, mean = (1e6 * np.sqrt(np.mean(one[:, k] ** 2, axis=0)) for one in (error, total))
        rows.append((name, *(" ".join(f"{v:6.2f}" for v in one) for one in (rms, mean)), str(np.sum(names == k))))
    grid(rows)
    ratio = error[np.arange(count), names] / total[np.arange(count), names]
    say()
    return show([scores.rms_figure(f"error/total {a}, rms", ratio[:, i], 3) for i, a in enumerate("xyz")], "std. error")


def one_adopted(seed: int) -> tuple[int, np.ndarray, np.ndarray]:
    """Adopted variant of an event, errors (4, 3) m and total errors (4, 3) m of all."""
    event = events.simulated(seed, {}, divisor_scatter=1.0)
    combined = events.calibrated(event)["com_offset.combine"]
    total = np.sqrt(np.diagonal(combined["covariance_total"].values, axis1=1, axis2=2))
    error = combined["offset"].values - 1e-6 * np.asarray(event.truth["offset_um"])
    return combined.attrs["variants"].split().index(solve.adopted(combined)), error, total


def independent(options) -> list[Figure]:
    """Study of the second simulator, that of the tests, which shares no code with gravcal: files, store, flow."""
    count = options.runs or (4 if options.quick else 40)
    seeds = range(options.seed, options.seed + count)
    title(f"independent: com_offset, {count} events of the second simulator, seeds {seeds[0]} to {seeds[-1]}")
    say("Level-1 files of seven windows, read and run through the flow; its own orbit, field, attitude and noise")
    return report(list(spread(one_of_second, seeds, options.workers)), bounded=False)


def one_of_second(seed: int) -> dict:
    """Errors of one event of the second simulator; offset and delays are drawn from its seed too."""
    from tests.independent import make_event

    rng = np.random.default_rng([seed, 11])
    offset = np.array([107.0, -40.0, 12.0]) + 60.0 * rng.standard_normal(3)
    delay = dict(zip(DELAYS, DELAY_SIGMA_S * rng.standard_normal(2), strict=True))
    effects = {f"{name}_delay_s": float(value) for name, value in delay.items()}
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder) / "level1"
        make_event(files, seed, offset_um=tuple(offset), effects=effects, window_s=(420.0, 420.0))
        os.environ["GRAVCAL_PRODUCTS"] = str(Path(folder) / "products")
        memory.clear()
        chosen = catalog.parameters("com_offset").with_settings({"igrf_generation": 13})
        ref = engine.run(com_offset.calibrate, com_offset.CALIBRATION.source(data=files), chosen, engine="inline")
        keys = common.product_keys(ref)
        made = [stage.read(store.find(keys[f"com_offset.{name}"])) for name in ("combine", "attitude")]
        return measured(*made, offset, delay) | {"seed": seed}


def spread(work, seeds, workers):
    """Results of work, a function of a seed at the top of a module, in order of the seeds, from so many processes."""
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        for number, row in enumerate(pool.imap(work, seeds), 1):
            if number % 20 == 0:
                say(f"  {number} of {len(seeds)}")
            yield row


def one(seed: int) -> dict:
    """Errors of one event of the simulator; the delays are drawn from its seed too."""
    delay = dict(zip(DELAYS, DELAY_SIGMA_S * np.random.default_rng([seed, 7]).standard_normal(2), strict=True))
    names = {"acc": "timing.accelerometer_delay", "sca": "timing.star_camera_delay"}
    event = events.simulated(seed, {names[k]: {"delay": float(v)} for k, v in delay.items()})
    made = events.calibrated(event)
    degree = made["com_offset.align"].attrs.get("drift_degree", 2)
    row = measured(made["com_offset.combine"], made["com_offset.attitude"], event.truth["offset_um"], delay)
    return row | {"seed": seed, "bound": np.sqrt(np.diag(events.bound(event, degree)))}


def measured(combined, smoothed, offset_um, delay) -> dict:
    """Errors and sigmas in the products "combine" and "attitude" of one event; true offset (3,) um and delays s."""
    sigma = np.sqrt(np.diagonal(combined["covariance"].values, axis1=1, axis2=2))
    late = [[float(smoothed[f"{k}_delay"]) - delay[k], float(smoothed[f"{k}_delay_sigma"])] for k in DELAYS]
    residual = [np.nansum(combined[f"manoeuvre_{name}"].values, axis=1) for name in ("chi2", "dof")]
    return {
        "error": combined["offset"].values - 1e-6 * np.asarray(offset_um),
        "sigma": sigma,
        "delay": np.array(late),
        "chi2": np.stack([combined["chi2"].values, combined["dof"].values]),
        "variants": np.array([float(combined["variants_chi2"]), float(combined["variants_dof"])]),
        "residual": np.array(residual),
    }


def report(rows: list[dict], bounded: bool = True) -> list[Figure]:
    """Tables of a study from rows of `one` or `measured`, one an event; bounded: they hold the Cramer-Rao bound."""
    table = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    _sizes(table, bounded)
    figures = show(_errors(table), "std. error")
    say()
    if bounded:
        figures += show(_scatter(table), "std. error")
        say()
    figures += show(_bias(table), "3 std. errors")
    say()
    return figures + show(_consistency(table), "")


def _sizes(table, bounded):
    """What the numbers are in micrometres."""
    rows = [("um", *(f"{v} {a}" for v in VARIANTS for a in "xyz"))]
    scatter = 1e6 * np.nanstd(table["error"], axis=0)
    rows.append(("scatter", *(f"{v:.3f}" for v in scatter.ravel())))
    rows.append(("sigma", *(f"{v:.3f}" for v in 1e6 * np.nanmean(table["sigma"], axis=0).ravel())))
    if bounded:
        rows.append(("Cramer-Rao", *(f"{v:.3f}" for v in np.tile(1e6 * table["bound"].mean(axis=0), 4))))
    grid(list(zip(*rows, strict=True)))
    undetermined = int(np.isnan(table["error"]).sum())
    say(f"components not determined: {undetermined} of {table['error'].size}\n")


def _errors(table):
    """Error over sigma of offsets and delays."""
    ratio = table["error"] / table["sigma"]
    figures = [
        scores.rms_figure(f"error/sigma {v} {a}, rms", ratio[:, i, j], FAMILY, judged=v in HELD_TO_BOUND)
        for i, v in enumerate(VARIANTS)
        for j, a in enumerate("xyz")
    ]
    late = table["delay"][..., 0] / table["delay"][..., 1]
    figures += [scores.rms_figure(f"error/sigma delay {k}, rms", late[:, i], FAMILY) for i, k in enumerate(DELAYS)]
    return figures


def _scatter(table):
    """Scatter over the bound of each event."""
    ratio = table["error"] / table["bound"][:, None, :]
    return [
        scores.scatter_figure(f"scatter/Cramer-Rao {v} {a}", ratio[:, i, j], FAMILY, judged=v in HELD_TO_BOUND)
        for i, v in enumerate(VARIANTS)
        for j, a in enumerate("xyz")
    ]


def _bias(table):
    """Mean error in sigma."""
    ratio = table["error"] / table["sigma"]
    figures = [
        scores.bias_figure(f"bias/sigma {v} {a}", ratio[:, i, j])
        for i, v in enumerate(VARIANTS)
        for j, a in enumerate("xyz")
    ]
    late = table["delay"][..., 0] / table["delay"][..., 1]
    return figures + [scores.bias_figure(f"bias/sigma delay {k}", late[:, i]) for i, k in enumerate(DELAYS)]


def _consistency(table):
    """Agreement of manoeuvres and variants, and size of the residuals."""
    chi2, dof = table["chi2"][:, 0], table["chi2"][:, 1]
    figures = []
    for i, v in enumerate(VARIANTS):
        figures.append(scores.chi2_figure(f"manoeuvres agree, chi2/dof {v}", chi2[:, i], dof[:, i], FAMILY))
        figures.append(scores.uniform_figure(f"  its probabilities {v}", chi2[:, i], dof[:, i], FAMILY))
    between = table["variants"].T
    figures.append(scores.chi2_figure("variants agree, chi2/dof", *between, FAMILY, held=True))
    residual = table["residual"]
    for i, v in enumerate(VARIANTS):
        name = f"residuals, chi2/dof {v}"
        figures.append(scores.chi2_figure(name, residual[:, 0, i], residual[:, 1, i], FAMILY, tolerance=0.05))
    return figures
