"""Stage combine: errors, spectra and identifiability of all methods in one product."""

from __future__ import annotations

import numpy as np
import xarray as xr

from gravcal.calibrations.building import build
from gravcal.calibrations.gradient_torque import identifiability, laws
from gravcal.calibrations.gradient_torque.gradient import cube_side
from gravcal.calibrations.gradient_torque.schemas import COMBINE
from gravcal.calibrations.gradient_torque.torque import amplitude_spectrum
from gravcal.errors import EstimationError

CLEAN = ".clean"


def combine(
    *products: xr.Dataset,
    methods: tuple,
    identifiability_epochs: int,
    identifiability_step_s: float,
    single_sensor: int,
    elongation: float,
    satellite: dict,
) -> xr.Dataset:
    """Comparison of the methods.

    Parameters
    ----------
    products : Dataset, "gradient_torque.gradient", then "gradient_torque.drag" of each of `methods`, then, if there is
        one, "gradient_torque.truth" and the drags from readings without noise in the order of `methods`
    methods : names
    identifiability_epochs, identifiability_step_s : size of the joint system shown
    single_sensor, elongation, satellite : as for the other stages

    Returns
    -------
    combined : Dataset, "gradient_torque.combine"
    """
    modelled, drags = products[0], products[1 : 1 + len(methods)]
    rest = products[1 + len(methods) :]
    truth = rest[0]["drag_b"].values if rest else np.full(drags[0]["drag_b"].shape, np.nan)
    if rest and not np.array_equal(rest[0]["time"].values, drags[0]["time"].values):
        raise EstimationError(
            f"truth: found {len(truth)} epochs, expected the {drags[0].sizes['time']} of the readings. "
            f"Give the truth of this record.",
        )
    step = float(np.median(np.diff(modelled["time"].values)))
    values = {"method": np.array(methods)} | _errors(drags, truth, step)
    values |= _clean(rest[1:], truth, step, values)
    choices = (identifiability_epochs, identifiability_step_s, single_sensor, elongation)
    values |= _identifiability(modelled, drags[list(methods).index("one_sensor")], choices, satellite)
    return build(COMBINE, values, title="Drag by all methods")


def _errors(drags, truth, step):
    """Errors and their spectra, method by method."""
    error = np.stack([drag["drag_b"].values - truth for drag in drags])
    bare = np.stack([drag["bare_b"].values - drag["drag_b"].values for drag in drags])
    held, total = (
        np.stack([np.diagonal(drag[name].values, axis1=1, axis2=2) for drag in drags])
        for name in ("covariance", "covariance_total")
    )
    frequency, drag_amplitude = amplitude_spectrum(drags[0]["drag_b"].values, step)
    return {
        "error_rms": _rms(error, (1, 2)),
        "error_rms_axis": _rms(error, 1),
        "bare_error_rms": _rms(bare + error, (1, 2)),
        "correction_rms": _rms(bare, (1, 2)),
        "sigma_rms": np.sqrt(held.mean(axis=(1, 2))),
        "sigma_total_rms": np.sqrt(total.mean(axis=(1, 2))),
        "error_over_sigma": _rms(error / np.sqrt(held), (1, 2)),
        "frequency": frequency,
        "drag_amplitude": drag_amplitude.T,
        "error_amplitude": np.moveaxis(amplitude_spectrum(error, step)[1], 1, 2),
        "bare_amplitude": np.moveaxis(amplitude_spectrum(bare, step)[1], 1, 2),
    }


def _clean(drags, truth, step, values):
    """The same from readings without noise; NaN where there are none."""
    if not drags:
        blank = np.nan * values["error_amplitude"]
        return {"clean_error_rms": np.nan * values["error_rms"], "clean_error_amplitude": blank}
    error = np.stack([drag["drag_b"].values - truth for drag in drags])
    amplitude = np.moveaxis(amplitude_spectrum(error, step)[1], 1, 2)
    return {"clean_error_rms": _rms(error, (1, 2)), "clean_error_amplitude": amplitude}


def _rms(values, axis):
    """Root mean square of what is there, NaN where nothing is."""
    there = np.isfinite(values)
    count = there.sum(axis=axis)
    total = np.where(there, values, 0.0) ** 2
    return np.sqrt(np.where(count > 0, total.sum(axis=axis), np.nan) / np.maximum(count, 1))


def _identifiability(modelled, found, choices, satellite):
    """Rank, null space and what each piece of knowledge adds."""
    epochs, spacing, single_sensor, elongation = choices
    place = modelled["sensor_position_b"].values[single_sensor - 1]
    test_mass = laws.box_inertia(satellite["test_mass"], cube_side(satellite), elongation)
    pressure = np.array(satellite["centre_of_pressure"])
    sensor = identifiability.Sensor(np.array(satellite["inertia"]), test_mass, satellite["mass"], place, pressure)
    rank, null = identifiability.single_epoch(sensor)
    shifted = np.where(np.abs(place) < 1e-9, 1e-3, place)  # the printed form cannot have zeros
    vectors = laws.printed_vectors(sensor.inertia, test_mass, sensor.mass, pressure, shifted)
    printed_rank, printed_null = identifiability.printed_pair(*vectors)
    steps = identifiability.joint(sensor, *_arc(modelled, found, (epochs, spacing), satellite))
    return {
        "step": np.array([step[0] for step in steps]),
        "step_rank": [step[1] for step in steps],
        "step_unknowns": [step[2] for step in steps],
        "step_sigma": [step[3] for step in steps],
        "unknown": np.array(identifiability.UNKNOWNS),
        "null_space": null,
        "single_rank": rank,
        "printed_rank": printed_rank,
        "printed_null": printed_null,
    }


def _arc(modelled, found, choices, satellite):
    """Motion and standard deviations at a few epochs in the middle of the record."""
    time = modelled["time"].values
    step = float(np.median(np.diff(time)))
    every = max(1, min(round(choices[1] / step), time.size // (2 * choices[0])))
    at = time.size // 4 + every * np.arange(choices[0])
    motion = {name: modelled[name].values[at] for name in ("gradient_b",)}
    motion |= {name: modelled[name].values[0][at] for name in ("rate_b", "rate_dot_b")}
    drag = found["drag_b"].values
    motion["drag_b"] = np.where(np.isfinite(drag[at]), drag[at], np.nanmean(drag, axis=0))
    band = 1 / np.sqrt(2 * step)
    place = modelled["sensor_position_b"].values[0]
    spread = np.sqrt(np.mean(np.diagonal(modelled["motion_covariance"].values[0], axis1=1, axis2=2)))
    rest = found["torque_residual"].values.max() if "torque_residual" in found else 1e-6
    sigmas = {
        "linear": np.array(satellite["linear_noise_density"]) * band,
        "angular": np.array(satellite["angular_noise_density"]) * band,
        "place": np.array(satellite["sensor_position_sigma"])[0],
        "gradient": float(np.sqrt(modelled["gradient_variance"].values.max())),
        "pressure": np.array(satellite["centre_of_pressure_sigma"]),
        "torque": float(rest),
        "motion": np.full(3, max(spread / np.linalg.norm(place), 1e-13)),
    }
    return motion, sigmas
