"""The calibration before and after an extension, as the calibration itself finds it."""

from __future__ import annotations

import numpy as np

#: Angular acceleration whose result stands for the calibration.
ADOPTED = "acc_calibrated"


def com_offset(combined) -> tuple[str, np.ndarray, np.ndarray]:
    """Name of the variant, offset (3,) um and covariance (3, 3) um2.

    Parameters
    ----------
    combined : Dataset, "com_offset.combine"
    """
    names = combined.attrs["variants"].split()
    index = names.index(ADOPTED) if ADOPTED in names else 0
    return names[index], 1e6 * combined["offset"].values[index], 1e12 * combined["covariance"].values[index]


def kbr_phase_centre(combined) -> tuple[str, np.ndarray, np.ndarray]:
    """Name of the observable, phase centres (6,) mm and covariance (6, 6) mm2.

    Parameters
    ----------
    combined : Dataset, "kbr_phase_centre.combine"
    """
    from gravcal.calibrations.kbr_phase_centre.schemas import ESTIMATORS

    name, estimator = (combined.attrs[f"adopted_{n}"] for n in ("observable", "estimator"))
    place = (combined.attrs["observables"].split().index(name), 0, ESTIMATORS.index(estimator))
    return name, 1e3 * combined["centre"].values[place], 1e6 * combined["covariance"].values[place]


RESULTS = {"com_offset": com_offset, "kbr_phase_centre": kbr_phase_centre}


def with_calibration(numbers: dict, calibration: str, before, after) -> dict:
    """Numbers with the change of the calibration result as the calibration itself finds it.

    Parameters
    ----------
    numbers : of `gravcal.discovery.product.summary`
    calibration : name
    before, after : Dataset, combined products of the baseline and of the records without the findings
    """
    extra = np.array(numbers["calibration_change"]["covariance_of_findings"], dtype=float)
    (name, old, covariance), (_, new, other) = (RESULTS[calibration](d) for d in (before, after))
    sigma = [np.sqrt(np.diag(c)) for c in (covariance, other + extra)]
    change = new - old
    found = {"before": old, "sigma_before": sigma[0], "after": new, "sigma_after": sigma[1]}
    found |= {"change": change, "change_in_old_sigma": change / sigma[0]}
    plain = {k: [float(v) if np.isfinite(v) else None for v in values] for k, values in found.items()}
    own = numbers["calibration_change"]
    return numbers | {"calibration_change": own | {"variant": name, "joint_fit": own} | plain}
