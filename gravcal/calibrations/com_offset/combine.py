"""Manoeuvres joined by their full normal equations, and whether they and the angular accelerations agree."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build, replaced
from gravcal.calibrations.com_offset import published
from gravcal.calibrations.com_offset.angular_acceleration import VARIANTS
from gravcal.calibrations.com_offset.schemas import COMBINE
from gravcal.calibrations.com_offset.solve import PRIOR
from gravcal.calibrations.model_error import widened
from gravcal.estimation import least_squares


def combine(*solved: xr.Dataset, **settings) -> xr.Dataset:
    """One offset for each angular acceleration, with its covariance and three consistency tests.

    Parameters
    ----------
    solved : Dataset, "com_offset.solve", one for each angular acceleration, with its two mode labels
    settings : method, "gravcal", or "published" for the rows and errors of the source paper;
        determined_sigma_um, a component with a larger error is not determined;
        consistency_level, probability below which manoeuvres or angular accelerations do not agree;
        drag_sigma_m_s2 and period_s, a constant acceleration that turns with the swinging body looks like an offset

    Returns
    -------
    combined : Dataset, "com_offset.combine"
    """
    limit = settings["determined_sigma_um"] * 1e-6
    method = settings["method"]
    turning = (settings["drag_sigma_m_s2"] * (settings["period_s"] / (2 * np.pi)) ** 2) ** 2 * np.eye(3)
    joint = {s.attrs["variant"]: _joint(s) if method == "gravcal" else _selected(s) for s in solved}
    names = [v for v in VARIANTS if v in joint]
    single = {s.attrs["variant"]: _per_manoeuvre(s) for s in solved}
    tests = {"variants": _between_variants(joint, limit), "catalogue": _against_catalogue(joint, limit)}
    own = [s for name in names for s in solved if s.attrs["variant"] == name]
    values = {
        "offset": [np.where(_determined(joint[v]["covariance"], limit), joint[v]["offset"], np.nan) for v in names],
        "covariance": [joint[v]["covariance"] for v in names],
        "covariance_total": [joint[v]["covariance_total"] + turning for v in names],
        "determined": [_determined(joint[v]["covariance"], limit) for v in names],
        "chi2": [joint[v]["chi2"] for v in names],
        "dof": [joint[v]["dof"] for v in names],
        "manoeuvre_offset": [single[v][0] for v in names],
        "manoeuvre_covariance": [single[v][1] for v in names],
        "manoeuvre_determined": _each(names, single, limit),
        "manoeuvre_chi2": [s["chi2"].values for s in own],
        "manoeuvre_dof": [s["dof"].values for s in own],
    }
    values |= {
        f"{test}_{n}": value for test, pair in tests.items() for n, value in zip(("chi2", "dof"), pair, strict=True)
    }
    values |= {n: solved[0][n].values for n in ("kind", "start", "stop")}
    attrs = {"method": method, "consistency_level": settings["consistency_level"], "direction": "proof_mass_to_com"}
    return build(COMBINE, values, variants=" ".join(names), **attrs)


def with_model_error(combined: xr.Dataset, *moved: xr.Dataset, determined_sigma_um: float) -> xr.Dataset:
    """The same with covariances that hold the errors of the effects that were taken out of the records before.

    Single manoeuvres and the tests of consistency keep the errors of the noise alone.

    Parameters
    ----------
    combined : Dataset, "com_offset.combine"
    moved : Dataset, "com_offset.combine", one for each direction of the model's errors
    determined_sigma_um : um, a component with a larger error is not determined

    Returns
    -------
    combined : Dataset, "com_offset.combine"
    """
    before = combined["offset"].values
    new = widened(combined, moved, {"offset": ("covariance", "covariance_total")})
    known = np.array([_determined(one, determined_sigma_um * 1e-6) for one in new["covariance"]])
    return replaced(combined, new | {"determined": known.astype("u1"), "offset": np.where(known, before, np.nan)})


def _selected(solved):
    """Rows and errors that the source paper keeps."""
    covariance = np.array([least_squares.covariance(i) for i in solved["information"].values]).reshape(-1, 3, 3)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    mean, error = published.selected(solved["kind"].values, solved["latitude"].values, solved["offset"].values, sigma)
    total = np.diag(np.where(np.isfinite(error), error, np.inf) ** 2)
    return {
        "offset": mean,
        "covariance": total,
        "covariance_total": total,
        "catalogue": np.zeros((0, 3)),
        "noise": total,
        "own": np.zeros((3, 3)),
        "chi2": 0.0,
        "dof": 0,
    }


def _each(names, single, limit):
    """Which components every manoeuvre determines (variant, manoeuvre, axis)."""
    each = [[_determined(c, limit) for c in single[v][1]] for v in names]
    return np.array(each).reshape(len(names), -1, 3)


def _joint(solved):
    """Combination of the manoeuvres of one angular acceleration with its mode errors."""
    shared = solved["mode_shared"].values.astype(bool)
    catalogue = solved["mode_catalogue"].values.astype(bool)[shared]
    seen = np.flatnonzero(np.isfinite(solved["offset"].values).all(axis=1))
    if not seen.size:
        none = np.full((3, 3), np.inf)
        nothing = {"offset": np.full(3, np.nan), "catalogue": np.zeros((catalogue.sum(), 3)), "chi2": 0.0, "dof": 0}
        return nothing | {"covariance": none, "covariance_total": none, "noise": none, "own": none}
    parts = [solved[n].values[seen] for n in ("right", "normal", "information")]
    scores = [least_squares.Score(*part) for part in zip(*parts, strict=True)]
    shift = solved["mode_shift"].values[seen]
    joined = least_squares.combine(scores, list(shift[:, ~shared]), list(shift[:, shared]), PRIOR)
    measured, given = joined.shift[~catalogue], joined.shift[catalogue]
    total = joined.covariance + measured.T @ measured
    return {
        "offset": joined.value,
        "covariance": total,
        "covariance_total": total + given.T @ given,
        "catalogue": given,
        **_parts(scores, list(shift[:, ~shared])),
        "chi2": joined.chi2,
        "dof": joined.dof,
    }


def _parts(scores, own):
    """Covariance of a combination in two parts, of the noise of the linear channels and of the own modes.

    With P = (I^-1 + M M')^-1, T = sum P: of the noise T^-1 (sum P I^-1 P) T^-1, of the modes T^-1 (sum P M M' P) T^-1.
    """
    weight = [least_squares.weakening(s.information, m) for s, m in zip(scores, own, strict=True)]
    total = least_squares.stable_inverse(PRIOR + sum(w @ s.information for w, s in zip(weight, scores, strict=True)))
    noise = sum(w @ s.information @ w.T for w, s in zip(weight, scores, strict=True))
    moves = [m @ (w @ s.information).T for w, s, m in zip(weight, scores, own, strict=True)]
    return {"noise": total @ noise @ total.T, "own": total @ sum(m.T @ m for m in moves) @ total.T}


def _per_manoeuvre(solved):
    """Offset and covariance of each manoeuvre, noise and its own modes; the shared measured ones too."""
    catalogue = solved["mode_catalogue"].values.astype(bool)
    covariances = []
    for information, shift in zip(solved["information"].values, solved["mode_shift"].values, strict=True):
        own = shift[~catalogue]
        covariances.append(least_squares.covariance(information + PRIOR) + own.T @ own)
    return solved["offset"].values, np.array(covariances).reshape(-1, 3, 3)


def _determined(covariance, limit):
    """Which components are known better than the limit."""
    sigma = np.sqrt(np.clip(np.diag(covariance), 0, None))
    return np.isfinite(sigma) & (sigma < limit)


def _between_variants(joint, limit):
    """Chi-square and degrees of freedom of the angular accelerometer against the star camera, without the catalogue.

    Neither holds inertia or dipole of the catalogue; the prior of the angular accelerometer's scale is within. Both
    share the noise of the linear channels; what is left is their own modes, and the noise by which they are worse than
    the best weights (mtq). acc_calibrated is acc scaled to the torquers: it says nothing that mtq and acc do not say.
    """
    return _difference(joint, ("acc", "sca"), limit)


def _against_catalogue(joint, limit):
    """Chi-square and degrees of freedom of the torquers against a measured angular acceleration.

    The prior errors of both (inertia, dipole per current, angular scale) are in the covariance, so where the catalogue
    is better than its prior the chi-square is small: this test sees a catalogue that is worse than it says, nothing
    finer.
    """
    for name in ("acc", "sca"):
        chi2, dof = _difference(joint, ("mtq", name), limit)
        if dof:
            return chi2, dof
    return 0.0, 0


def _difference(joint, names, limit):
    """Chi-square of the difference of two variants over the directions that both determine, prior errors within.

    Directions, not components: what one manoeuvre leaves open along x leaks into z by their correlation.

    Parameters
    ----------
    joint : solutions by variant
    names : two variants
    limit : m, of a direction that is determined
    """
    if not set(names) <= set(joint):
        return 0.0, 0
    one, other = (joint[name] for name in names)
    known = [one["covariance"], other["covariance"], joint.get("mtq", one)["noise"]]
    if not np.isfinite(known).all():
        return 0.0, 0
    size, vectors = np.linalg.eigh((known[0] + known[1]) / 2)
    basis = vectors[:, size < limit**2]
    inner = [{n: basis.T @ j[n] @ basis for n in ("own", "noise")} for j in (one, other)]
    shared = basis.T @ known[2] @ basis
    moves = np.concatenate([one["catalogue"], other["catalogue"]])
    covariance = sum(j["own"] + _excess(j["noise"], shared) for j in inner) + basis.T @ moves.T @ moves @ basis
    difference = basis.T @ (one["offset"] - other["offset"])
    return float(difference @ np.linalg.solve(covariance, difference)), basis.shape[1]


def _excess(covariance, noise):
    """Noise beyond the shared one, never negative, 0.1 % of that as floor."""
    size, vectors = np.linalg.eigh(covariance - noise)
    return (vectors * np.clip(size, 0, None)) @ vectors.T + 0.001 * noise
