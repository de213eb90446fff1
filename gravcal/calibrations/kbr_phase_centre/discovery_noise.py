"""Noise of the star cameras in the sub-manoeuvres, with everything taken out that a candidate could explain.

Quiet data hold the noise of ranging and orbit but not that of the star cameras, which needs the lever arm of a tilted
antenna. It is estimated from the manoeuvres by restricted maximum likelihood: slow orbit error, phase centres and all
candidates are free in every manoeuvre, so that what any of them could name does not count as noise.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.kbr_phase_centre import noise as noises
from gravcal.calibrations.kbr_phase_centre.discovery_view import View, factors, white
from gravcal.estimation import least_squares

ITERATIONS = 4
#: Share of its size that a candidate keeps beside the baseline, and singular values of what is kept, that count.
SEEN, DEPENDENT = 1e-4, 1e-2


def with_pointing(view: View, measured: xr.Dataset, columns: np.ndarray) -> xr.Dataset:
    """Noise product with the star camera noise that is left beside all candidates.

    Parameters
    ----------
    view : View
    measured : Dataset, "kbr_phase_centre.noise"
    columns : (m, q) m, of every candidate

    Returns
    -------
    measured : Dataset, "kbr_phase_centre.noise"

    Notes
    -----
    Fisher scoring of l(s) = -1/2 (log|V| + log|X' V^-1 X| + y' P y), V = R + sum_c s_c K_c: score
    (y' P K_c P y - tr P K_c) / 2, information tr(P K_c P K_d) / 2; Patterson and Thompson, Biometrika 58 (1971).
    """
    if measured.attrs["source_data"] != "quiet" or not view.arcs:
        return measured
    parts = [_parts(view, arc, columns) for arc in view.arcs]
    for _ in range(ITERATIONS):
        moved = _scored(measured["pointing_power"].values, zip(parts, factors(view, measured), strict=True))
        measured = measured.assign(pointing_power=measured["pointing_power"].copy(data=moved))
    return measured


def _parts(view, arc, columns):
    """Residual, baseline and candidates of a sub-manoeuvre, and covariances of unit noise below each corner."""
    shapes = noises.shapes(view.step_s)
    nothing = np.zeros(shapes.shape[-1])
    kinds = []
    for shape in shapes:
        lags = noises.lags_of_densities(nothing, shape, view.step_s, 0, int(arc.place[-1]) + 1)
        lower = noises.covariance_matrix(lags, arc.place, arc.lever)
        kinds.append(lower + np.tril(lower, -1).T)
    fixed = np.column_stack([arc.own, view.column[arc.rows]])
    return (view.residual[arc.rows], fixed, columns[arc.rows]), kinds


def _scored(power, parts):
    """Densities after one step, none negative."""
    from scipy.optimize import nnls

    score, information = np.zeros(power.size), np.zeros((power.size, power.size))
    for (free, kinds), factor in parts:
        observed, fixed, tried = (white(factor, part) for part in free)
        basis = _basis(fixed, tried)
        left = observed - basis @ (basis.T @ observed)
        inner = [_between(basis, white(factor, white(factor, k).T)) for k in kinds]
        score += [(left @ k @ left - np.trace(k)) / 2 for k in inner]
        information += [[np.sum(a * b) / 2 for b in inner] for a in inner]
    size = np.sqrt(np.diag(information))
    scaled = np.linalg.cholesky(information / np.outer(size, size) + 1e-9 * np.eye(size.size))
    aim = np.linalg.solve(scaled, (information @ power + score) / size)
    return nnls(scaled.T, aim)[0] / size


def _between(basis, matrix):
    """P K P with P the projection beside the basis."""
    part = matrix @ basis
    return matrix - basis @ part.T - part @ basis.T + basis @ (basis.T @ part) @ basis.T


def _basis(fixed, tried):
    """Orthonormal basis of the baseline and of what the candidates add to it."""
    first = least_squares.orthonormal(fixed)
    left = tried - first @ (first.T @ tried)
    size = np.linalg.norm(left, axis=0)
    left = left[:, size > SEEN * np.linalg.norm(tried, axis=0)]
    second, values, _ = np.linalg.svd(left / np.linalg.norm(left, axis=0), full_matrices=False)
    return least_squares.orthonormal(np.column_stack([first, second[:, values > DEPENDENT * values[0]]]))
