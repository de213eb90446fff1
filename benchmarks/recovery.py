"""Recovery of an invented centre-of-mass offset over many events, against its error and the Cramer-Rao bound."""

import multiprocessing

import numpy as np
from scipy import stats

from benchmarks import events
from benchmarks.tables import Figure, grid, say, show, title
from gravcal.calibrations.com_offset.estimate import adopted as adopted_variant

VARIANTS = ("mtq", "acc_calibrated", "acc", "sca")
HELD_TO_BOUND = VARIANTS[:3]
DELAYS = ("acc", "sca")
DELAY_SIGMA_S = 0.1  # of the delays that are drawn for each event, the prior of the effects
FAMILY = 12 + 12 + 2 + 5 + 4  # rms, scatter, delays, consistency, residuals
FALSE_ALARM = 0.01  # chance that any statistic of a study leaves its interval though all is right


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


def adopted(options) -> list[Figure]:
    """What is handed on, where inertia and dipole per current are drawn from their priors: error and total error."""
    count = options.runs or (12 if options.quick else 40)
    seeds = range(options.seed, options.seed + count)
    title(f"adopted: com_offset, {count} simulated events with divisors drawn, seeds {seeds[0]} to {seeds[-1]}")
    with multiprocessing.get_context("spawn").Pool(options.workers) as pool:
        names, error, total = (np.array(one) for one in zip(*pool.map(one_adopted, seeds), strict=True))
    rows = [("um", "rms error x, y, z", "mean total error", "adopted")]
    for k, name in enumerate(VARIANTS):
        rms, mean = (1e6 * np.sqrt(np.mean(one[:, k] ** 2, axis=0)) for one in (error, total))
        rows.append((name, *(" ".join(f"{v:6.2f}" for v in one) for one in (rms, mean)), str(np.sum(names == k))))
    grid(rows)
    ratio = error[np.arange(count), names] / total[np.arange(count), names]
    say()
    return show([rms_figure(f"error/total {a}, rms", ratio[:, i], 3) for i, a in enumerate("xyz")], "std. error")


def one_adopted(seed: int) -> tuple[int, np.ndarray, np.ndarray]:
    """Adopted variant of an event, errors (4, 3) m and total errors (4, 3) m of all."""
    event = events.simulated(seed, {}, divisor_scatter=1.0)
    combined = events.calibrated(event)["com_offset.combine"]
    total = np.sqrt(np.diagonal(combined["covariance_total"].values, axis1=1, axis2=2))
    error = combined["offset"].values - 1e-6 * np.asarray(event.truth["offset_um"])
    return combined.attrs["variants"].split().index(adopted_variant(combined)), error, total


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
        rms_figure(f"error/sigma {v} {a}, rms", ratio[:, i, j], FAMILY, judged=v in HELD_TO_BOUND)
        for i, v in enumerate(VARIANTS)
        for j, a in enumerate("xyz")
    ]
    late = table["delay"][..., 0] / table["delay"][..., 1]
    figures += [rms_figure(f"error/sigma delay {k}, rms", late[:, i], FAMILY) for i, k in enumerate(DELAYS)]
    return figures


def _scatter(table):
    """Scatter over the bound of each event."""
    ratio = table["error"] / table["bound"][:, None, :]
    return [
        scatter_figure(f"scatter/Cramer-Rao {v} {a}", ratio[:, i, j], FAMILY, judged=v in HELD_TO_BOUND)
        for i, v in enumerate(VARIANTS)
        for j, a in enumerate("xyz")
    ]


def _bias(table):
    """Mean error in sigma."""
    ratio = table["error"] / table["sigma"]
    figures = [
        bias_figure(f"bias/sigma {v} {a}", ratio[:, i, j]) for i, v in enumerate(VARIANTS) for j, a in enumerate("xyz")
    ]
    late = table["delay"][..., 0] / table["delay"][..., 1]
    return figures + [bias_figure(f"bias/sigma delay {k}", late[:, i]) for i, k in enumerate(DELAYS)]


def _consistency(table):
    """Agreement of manoeuvres and variants, and size of the residuals."""
    chi2, dof = table["chi2"][:, 0], table["chi2"][:, 1]
    figures = []
    for i, v in enumerate(VARIANTS):
        figures.append(chi2_figure(f"manoeuvres agree, chi2/dof {v}", chi2[:, i], dof[:, i], FAMILY))
        figures.append(uniform_figure(f"  its probabilities {v}", chi2[:, i], dof[:, i], FAMILY))
    between = table["variants"].T
    figures.append(chi2_figure("variants agree, chi2/dof", *between, FAMILY, held=True))
    residual = table["residual"]
    for i, v in enumerate(VARIANTS):
        name = f"residuals, chi2/dof {v}"
        figures.append(chi2_figure(name, residual[:, 0, i], residual[:, 1, i], FAMILY, tolerance=0.05))
    return figures


def level(count: int) -> float:
    """Two-sided level of one of `count` statistics, family-wise 1 % (Bonferroni)."""
    return FALSE_ALARM / count


def rms_figure(name: str, ratio: np.ndarray, family: int, *, judged: bool = True) -> Figure:
    """Root mean square of errors over their sigma (n,): 0.9 .. 1.1, or what chance allows with so few.

    Here and below the family is the number of statistics of the study, and what is not judged has no target.
    """
    ratio = ratio[np.isfinite(ratio)]
    value = float(np.sqrt(np.mean(ratio**2)))
    error = f"+- {value / np.sqrt(2 * ratio.size):.3f}"
    low, high = np.sqrt(stats.chi2.ppf([level(family) / 2, 1 - level(family) / 2], ratio.size) / ratio.size)
    if not judged:
        return Figure(name, f"{value:.3f}", error)
    return Figure(name, f"{value:.3f}", error, f"0.9 .. 1.1 ({low:.2f} .. {high:.2f})", low <= value <= high)


def scatter_figure(name: str, ratio: np.ndarray, family: int, *, judged: bool = True) -> Figure:
    """Scatter of errors over their lower bound (n,): at most 1.1, chance allowed for."""
    ratio = ratio[np.isfinite(ratio)]
    dof = ratio.size - 1
    value = float(ratio.std(ddof=1))
    limit = 1.1 * np.sqrt(stats.chi2.ppf(1 - level(family), dof) / dof)
    error = f"+- {value / np.sqrt(2 * dof):.3f}"
    if not judged:
        return Figure(name, f"{value:.3f}", error)
    return Figure(name, f"{value:.3f}", error, f"<= 1.10 ({limit:.2f})", value <= limit)


def bias_figure(name: str, ratio: np.ndarray) -> Figure:
    """Mean of errors over their sigma (n,): below 0.2 plus three standard errors."""
    ratio = ratio[np.isfinite(ratio)]
    error = float(ratio.std(ddof=1) / np.sqrt(ratio.size))
    mean, limit = float(ratio.mean()), 0.2 + 3 * error
    return Figure(name, f"{mean:+.3f}", f"+- {3 * error:.3f}", f"|.| <= {limit:.2f}", abs(mean) <= limit)


def chi2_figure(
    name: str, chi2: np.ndarray, dof: np.ndarray, family: int, *, tolerance: float = 0.0, held: bool = False
) -> Figure:
    """Sum of chi-squares (n,) over the sum of their degrees of freedom (n,).

    The tolerance widens the interval, for a noise that is itself measured; errors that hold a prior that was not drawn
    (``held``) let the chi-squares be as small as they like.
    """
    total, count = float(np.sum(chi2)), float(np.sum(dof))
    low, high = stats.chi2.ppf([level(family) / 2, 1 - level(family) / 2], count) / count
    low, high = 0.0 if held else low - tolerance, high + tolerance
    value = total / count
    return Figure(name, f"{value:.3f}", f"{count:.0f} dof", f"{low:.3f} .. {high:.3f}", low <= value <= high)


def uniform_figure(name: str, chi2: np.ndarray, dof: np.ndarray, family: int) -> Figure:
    """Whether probabilities of chi-squares (n,), (n,) are spread evenly, by the Kolmogorov-Smirnov test."""
    probability = stats.chi2.sf(chi2, dof)
    p = float(stats.kstest(probability, "uniform").pvalue)
    low = float(np.mean(probability < FALSE_ALARM))
    return Figure(name, f"p {p:.3f}", f"{100 * low:.1f} % below 1 %", f"p >= {level(family):.1g}", p >= level(family))
