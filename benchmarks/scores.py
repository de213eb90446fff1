"""Statistics of many recoveries, each with the interval that chance leaves it."""

import numpy as np
from scipy import stats

from benchmarks.tables import Figure

FAMILY = 0.01  # chance that any statistic of a study leaves its interval though all is right


def level(count: int) -> float:
    """Two-sided level of one of `count` statistics, family-wise 1 % (Bonferroni)."""
    return FAMILY / count


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
    low = float(np.mean(probability < FAMILY))
    return Figure(name, f"p {p:.3f}", f"{100 * low:.1f} % below 1 %", f"p >= {level(family):.1g}", p >= level(family))
