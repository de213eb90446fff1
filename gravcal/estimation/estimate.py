"""Generalised least squares with the noise as measured: the one result that the scientific interface returns."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from gravcal.errors import EstimationError
from gravcal.estimation.least_squares import orthonormal, project_out, rank, solution, stable_inverse
from gravcal.estimation.noise import NoiseModel, whiten

ROUNDING = 1e-9  # of a column's norm, below which what the nuisance columns leave of it is zero


@dataclass(frozen=True)
class Estimate:
    """Values with their covariance, and how well they describe the observations."""

    names: tuple[str, ...]  #: of the parameters
    unit: str  #: of all of them, or one each, separated by commas
    value: np.ndarray  #: (p,), NaN where the observations do not determine it
    covariance: np.ndarray  #: (p, p) unit squared, NaN there
    chi2: float  #: of the residual, noise as measured
    dof: int  #: degrees of freedom
    information: np.ndarray  #: (p, p) of the normal equations, nuisance parameters eliminated; they add up
    right: np.ndarray  #: (p,) of these
    residual: np.ndarray  #: (n, m) 1, whitened residual of each series, zero where no sample was used

    @property
    def sigma(self) -> np.ndarray:
        """(p,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def probability(self) -> float:
        """Probability of a chi-square as large as this one, or larger, if model and noise are right."""
        return float(chdtrc(self.dof, self.chi2))

    def scaled(self, factor: float, unit: str) -> "Estimate":
        """The estimate in another unit, values times a factor, negative for the other sign."""
        moved = {"value": factor * self.value, "covariance": factor**2 * self.covariance}
        return replace(self, unit=unit, **moved, information=self.information / factor**2, right=self.right / factor)

    def __str__(self):
        """One line a parameter."""
        units = [*self.unit.split(","), *[self.unit] * len(self.names)]
        rows = zip(self.names, self.value, self.sigma, units, strict=False)
        lines = [f"{n:>12} {_digits(v, *of) if np.isfinite(v) else 'not determined'}" for n, v, *of in rows]
        fit = f"chi2 {self.chi2:.1f} of {self.dof} degrees of freedom (p = {self.probability:.2g})"
        return "\n".join([*lines, fit])


def _digits(value, sigma, unit):
    """Text of value, sigma with two digits, and unit."""
    places = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 12)) if sigma > 0 else 4
    text = f"{value:+.{places}f} +- {sigma:.{places}f}" if places <= 6 else f"{value:+.4g} +- {sigma:.2g}"
    return f"{text} {unit.strip()}"


def estimate(
    observed: np.ndarray,
    columns: np.ndarray,
    noise: Sequence[NoiseModel],
    nuisance: np.ndarray,
    names: Sequence[str],
    unit: str,
) -> Estimate:
    """Least squares of several series at the same epochs, each with its own noise and nuisance parameters.

    Parameters
    ----------
    observed : (n, m), evenly spaced, NaN where missing
    columns : (n, m, p) of the parameters, unit of the observations per unit of the parameter
    noise : m NoiseModel, in the unit of the observations
    nuisance : (n, k) columns that are free in every series, such as `gravcal.estimation.least_squares.polynomial`
    names, unit : of the parameters

    Raises
    ------
    EstimationError : shapes that do not fit, fewer samples than parameters

    Notes
    -----
    x = (A' W A)^-1 A' W y with W the inverse covariance of the noise; nuisance columns are projected out of both sides
    after whitening, which is the same as estimating them.
    """
    observed, columns = np.asarray(observed, dtype=float), np.asarray(columns, dtype=float)
    count, series = observed.shape
    if columns.shape != (count, series, len(names)) or len(noise) != series or len(nuisance) != count:
        raise EstimationError(
            f"observations {observed.shape}: found columns {columns.shape}, {len(noise)} noise models, "
            f"{len(nuisance)} nuisance rows, expected ({count}, {series}, {len(names)}), {series}, {count}."
        )
    information, right, samples, rows = 0.0, 0.0, 0, []
    for axis in range(series):
        valid = np.isfinite(observed[:, axis]) & np.isfinite(columns[:, axis]).all(axis=1)
        white = whiten(noise[axis], np.column_stack([observed[:, axis], columns[:, axis], nuisance]), valid)
        clean = project_out(white[:, 1 + len(names) :], white[:, : 1 + len(names)])
        rounding = ROUNDING * np.linalg.norm(white[:, 1 : 1 + len(names)], axis=0)
        clean[:, 1:][:, np.linalg.norm(clean[:, 1:], axis=0) < rounding] = 0.0  # a column that nuisance columns hold
        rows.append(clean)
        information = information + clean[:, 1:].T @ clean[:, 1:]
        right = right + clean[:, 1:].T @ clean[:, 0]
        samples += int(valid.sum()) - orthonormal(white[:, 1 + len(names) :]).shape[1]
    if (dof := samples - rank(information)) < 1:
        raise EstimationError(
            f"found {samples} samples beyond the nuisance parameters, expected more than the {samples - dof} "
            f"parameters. Give a longer record."
        )
    least = stable_inverse(information) @ right
    residual = np.column_stack([part[:, 0] - part[:, 1:] @ least for part in rows])
    chi2 = float(np.sum(residual**2))
    return Estimate(tuple(names), unit, *solution(information, right), chi2, dof, information, right, residual)


def together(*estimates: Estimate) -> Estimate:
    """One Estimate from several independent ones of the same parameters, such as those of several manoeuvres.

    The chi-square is that of all residuals about the common values, so that it includes their disagreement.
    """
    first = estimates[0]
    if any((one.names, one.unit) != (first.names, first.unit) for one in estimates):
        raise EstimationError("found estimates of different parameters or units, expected the same.")
    information, right = (sum(getattr(one, name) for one in estimates) for name in ("information", "right"))
    chi2, least = 0.0, stable_inverse(information) @ right
    for one in estimates:
        moved = least - stable_inverse(one.information) @ one.right
        chi2 += one.chi2 + float(moved @ one.information @ moved)
    dof = sum(one.dof + rank(one.information) for one in estimates) - rank(information)
    residual = np.concatenate([one.residual for one in estimates])
    return Estimate(first.names, first.unit, *solution(information, right), chi2, dof, information, right, residual)
