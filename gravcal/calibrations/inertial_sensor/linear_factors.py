"""Linear scale factors from angular ones, for both arms about x, with the errors of geometry."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gravcal.effects import inertial_sensor as electrodes

ARMS_X = (8.00e-3, 10.45e-3)  # m, erratum T-5: Table 1 prints the first, every ratio of Table 4 follows the second

CAUSES = ("beta", "mass", "inertia", "arm")  # of the errors of k_x and k_z

COEFFICIENTS = electrodes.READOUT  # of the voltages in the six readouts
VOLTAGES = electrodes.VOLTAGES


def factor_of_axis(beta: np.ndarray, ratio: np.ndarray, k_y: float) -> np.ndarray:
    """k_x, k_y, k_z.

    Parameters
    ----------
    beta : (3,) rad s-2 V-1; ratio : (3,) m, J/(M l); k_y : m s-2 V-1, not tied to any angular factor
    """
    return np.array([ratio[1] * beta[1], k_y, ratio[0] * beta[0]])


def linear_factors(beta, beta_sigma, geometry: Mapping, k_y: tuple[float, float], published: bool) -> dict:
    """Linear factors and their errors for both arms.

    Parameters
    ----------
    beta, beta_sigma : (3,) rad s-2 V-1
    geometry : {"mass", "inertia" (3,), "arm" (3,), and each with "_sigma"}; the arm about x is replaced by both
    k_y : value and sigma, m s-2 V-1
    published : use eqs. 8-10 as printed

    Returns
    -------
    factors : {"k", "k_sigma", "k_sigma_total" (2, 3) m s-2 V-1; "ratio" (2, 3) m; "ratio_relative_sigma" (3,);
        "k_budget" (4, 3) 1, relative errors of k by CAUSES, NaN for y}
    """
    form = electrodes.published_linear_over_angular if published else electrodes.linear_over_angular
    arms = [np.array([arm, *geometry["arm"][1:]]) for arm in ARMS_X]
    ratio = np.array([form(geometry["mass"], geometry["inertia"], arm) for arm in arms])
    mass, inertia, arm = (np.array(geometry[f"{n}_sigma"]) / geometry[n] for n in ("mass", "inertia", "arm"))
    relative = electrodes.ratio_relative_sigma(mass, inertia, arm)
    k = np.array([factor_of_axis(beta, one, k_y[0]) for one in ratio])
    share = np.array([beta_sigma[1] / beta[1], k_y[1] / k_y[0], beta_sigma[0] / beta[0]])
    total = np.hypot(share, [relative[1], 0.0, relative[0]])
    return {
        "k": k,
        "k_sigma": k * share,
        "k_sigma_total": k * total,
        "ratio": ratio,
        "ratio_relative_sigma": relative,
        "k_budget": [[one[1], np.nan, one[0]] for one in (beta_sigma / beta, np.full(3, mass), inertia, arm)],
    }
