"""Recovery of an invented centre-of-mass offset over many events, against its error and the Cramer-Rao bound."""

import multiprocessing

import numpy as np

from benchmarks import events, scores
from benchmarks.tables import Figure, grid, say, show, title

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
    rows = []
    with multiprocessing.get_context("spawn").Pool(options.workers) as pool:
        for row in pool.imap(one, seeds):
            rows.append(row)
            if len(rows) % 20 == 0:
                say(f"  {len(rows)} of {count}")
    return report(rows)


def one(seed: int) -> dict:
    """Errors of one event of the simulator; the delays are drawn from its seed too."""
    delay = dict(zip(DELAYS, DELAY_SIGMA_S * np.random.default_rng([seed, 7]).standard_normal(2), strict=True))
    names = {"acc": "timing.accelerometer_delay", "sca": "timing.star_camera_delay"}
    event = events.simulated(seed, {names[k]: {"delay": float(v)} for k, v in delay.items()})
    made = events.calibrated(event)
    degree = made["com_offset.align"].attrs.get("drift_degree", 2)
    combined, smoothed = made["com_offset.combine"], made["com_offset.attitude"]
    sigma = np.sqrt(np.diagonal(combined["covariance"].values, axis1=1, axis2=2))
    late = [[float(smoothed[f"{k}_delay"]) - delay[k], float(smoothed[f"{k}_delay_sigma"])] for k in DELAYS]
    residual = [np.nansum(combined[f"manoeuvre_{name}"].values, axis=1) for name in ("chi2", "dof")]
    return {
        "bound": np.sqrt(np.diag(events.bound(event, degree))),
        "error": combined["offset"].values - 1e-6 * np.asarray(event.truth["offset_um"]),
        "sigma": sigma,
        "delay": np.array(late),
        "chi2": np.stack([combined["chi2"].values, combined["dof"].values]),
        "variants": np.array([float(combined["variants_chi2"]), float(combined["variants_dof"])]),
        "residual": np.array(residual),
    }


def report(rows: list[dict]) -> list[Figure]:
    """Tables of a study from rows of `one`, one an event."""
    table = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    _sizes(table)
    figures = show(_errors(table), "std. error")
    say()
    figures += show(_scatter(table), "std. error")
    say()
    figures += show(_bias(table), "3 std. errors")
    say()
    return figures + show(_consistency(table), "")


def _sizes(table):
    """What the numbers are in micrometres."""
    rows = [("um", *(f"{v} {a}" for v in VARIANTS for a in "xyz"))]
    scatter = 1e6 * np.nanstd(table["error"], axis=0)
    rows.append(("scatter", *(f"{v:.3f}" for v in scatter.ravel())))
    rows.append(("sigma", *(f"{v:.3f}" for v in 1e6 * np.nanmean(table["sigma"], axis=0).ravel())))
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
