"""Magnetometer minus reference field as blocks and candidates: parts of the record that are left out in turn."""

from __future__ import annotations

import numpy as np

from gravcal.calibrations.magnetometer.series import Field
from gravcal.effects import Context, catalogue
from gravcal.estimation import least_squares

#: Effects that a comparison of two fields can show.
EFFECTS = (
    "magnetometer.bias",
    "magnetometer.scale",
    "magnetometer.misalignment",
    "magnetometer.current_leak",
    "magnetometer.external_field",
    "attitude.star_camera_misalignment",
    "timing.magnetometer_delay",
)


def view(field: Field, **settings) -> tuple[list[dict], list[dict], dict]:
    """Blocks and candidates of one satellite.

    The noise has no quiet part of its own in minutes of data: its level is that of the residual of the widest model,
    all candidates in it, so that it is the same under every hypothesis; never below a floor.

    Parameters
    ----------
    field : Field
    settings : magnetometer_blocks, field_noise_nt, igrf_generation

    Returns
    -------
    blocks, candidates : fields of `gravcal.discovery.blocks.Block` and `Candidate`
    facts : what the record holds
    """
    difference = field.measured_b - field.model_b
    found = [_effect(field, slug) for slug in EFFECTS] + [_drift(field)]
    sigma = noise_level(difference, [c["columns"] for c in found], 1e-9 * settings["field_noise_nt"])
    parts = np.array_split(np.arange(field.time.size), settings["magnetometer_blocks"])
    blocks = [_block(field, difference, rows, sigma) for rows in parts]
    for candidate in found:
        candidate["columns"] = [_rows(candidate["columns"][rows], sigma) for rows in parts]
    facts = {
        "records": field.time.size,
        "seconds": float(np.ptp(field.time)),
        "noise_nt": (1e9 * sigma).tolist(),
        "mean_nt": (1e9 * difference.mean(axis=0)).tolist(),
        "field_range_nt": (1e9 * np.ptp(field.model_b, axis=0)).tolist(),
        "dipole_sigma_a_m2": field.dipole_b.std(axis=0).tolist(),
    }
    return blocks, found, facts


def noise_level(difference: np.ndarray, columns: list[np.ndarray], floor: float) -> np.ndarray:
    """Standard deviation (3,) T of each axis about everything that any candidate could do there.

    Parameters
    ----------
    difference : (n, 3) T
    columns : (n, 3, q) of each candidate
    floor : T
    """
    sigma = np.zeros(3)
    for axis in range(3):
        basis = least_squares.orthonormal(np.concatenate([c[:, axis] for c in columns], axis=1))
        rest = least_squares.without(basis, difference[:, axis])
        sigma[axis] = np.sqrt(rest @ rest / max(rest.size - basis.shape[1], 1))
    return np.maximum(sigma, floor)


def _rows(values, sigma):
    """Whitened rows (3 n, q) of (n, 3, q) T, axis after axis."""
    return np.concatenate([values[:, a] / sigma[a] for a in range(3)])


def _block(field, difference, rows, sigma):
    observed = _rows(difference[rows][..., None], sigma)[:, 0]
    return {
        "label": f"{field.time[rows[0]] - field.time[0]:.0f} to {field.time[rows[-1]] - field.time[0]:.0f} s",
        "observed": observed,
        "shared": np.zeros((observed.size, 0)),
        "own": np.zeros((observed.size, 0)),
        "channel": np.array(["magnetometer"] * observed.size),
        "axis": np.repeat([0, 1, 2], rows.size),
        "time": np.tile(field.time[rows], 3),
    }


def _effect(field, slug):
    """Candidate of the catalogue with columns (n, 3, q) T."""
    entry = catalogue()[slug]
    extra = {"axis_b": field.axis_b}
    context = Context(time=field.time, field_b=field.model_b, dipole_b=field.dipole_b, extra=extra)
    if slug == "timing.magnetometer_delay":
        columns = -field.slope_b[..., None]  # a late tag belongs to an earlier field
    elif slug == "attitude.star_camera_misalignment":
        columns = -catalogue()["magnetometer.misalignment"].columns(context)  # the modelled field turns instead
    else:
        columns = entry.columns(context)
    names, units = [p.name for p in entry.parameters], [p.unit for p in entry.parameters]
    return {"cause": slug, "form": "", "names": names, "units": units, "columns": columns}


def _drift(field):
    middle = (field.time[0] + field.time[-1]) / 2
    columns = (field.time - middle)[:, None, None] * np.eye(3)
    units = ["T s-1"] * 3
    return {"cause": "unknown:time", "form": "drift", "names": list("xyz"), "units": units, "columns": columns}
