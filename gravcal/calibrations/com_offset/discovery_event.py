"""An event handed to discovery: blocks, candidates, and how well the noise is known."""

from __future__ import annotations

import xarray as xr

from gravcal.calibrations.com_offset import discovery_noise, discovery_timing
from gravcal.calibrations.com_offset.discovery_candidates import attitude_of_torques
from gravcal.calibrations.com_offset.discovery_scene import offset_of, scenes
from gravcal.calibrations.com_offset.discovery_view import View, block_of, view_of
from gravcal.calibrations.com_offset.noise import QUIET_S
from gravcal.errors import ProductError
from gravcal.methods.beside import beside


def event(
    aligned: xr.Dataset,
    field: xr.Dataset,
    smoothed: xr.Dataset,
    solved: xr.Dataset,
    noise: dict | None = None,
    **settings,
) -> tuple[list[View], list[dict], dict]:
    """Blocks of an event.

    Parameters
    ----------
    aligned, field, smoothed, solved : products of com_offset, solved with variant mtq
    noise : {channel: noise model of each axis}, where it is not to be measured in these records
    settings : of the stages attitude, noise and solve, with inertia, dipole_per_current, linear_drift_degree,
        angular_drift_degree, mass

    Returns
    -------
    views : one a manoeuvre
    blocks : fields of `gravcal.discovery.blocks.Block`, one a view and one of edge times
    quiet : {channel: samples an axis that its noise was measured from}
    """
    offset = offset_of(solved)
    measured, quiet = ({}, {}) if noise else _quiet(aligned, field, settings)
    made = scenes(aligned, field, smoothed, settings)
    views = [view_of(s, (aligned, field, smoothed), noise or measured, offset, settings["mass"]) for s in made]
    if not noise:
        wider = [attitude_of_torques(v) for v in views]
        measured["attitude"] = discovery_noise.attitude(smoothed, made, wider, settings)
    blocks = [block_of(v, aligned, smoothed, settings) for v in views] + [discovery_timing.block(smoothed)]
    return views, blocks, quiet


def _quiet(aligned, field, settings):
    """Noise of the instruments outside the manoeuvres, and how much of it was seen."""
    with beside(discovery_noise.angular, aligned, field, settings) as of_angular:
        linear, linear_samples = discovery_noise.linear(aligned, settings)
        if linear_samples * settings["step_s"] < QUIET_S:
            raise ProductError(
                "discovery: found less than 300 s of quiet data outside the manoeuvres, which the noise has to be "
                "measured in. Give files that reach further before and after them."
            )
        magnetometer, field_samples = discovery_noise.magnetometer(aligned, field, settings)
        angular, angular_samples = of_angular()
    noise = {"linear": linear, "angular": angular, "magnetometer": magnetometer}
    seen = {"linear": linear_samples, "angular": angular_samples}
    return noise, seen | {"magnetometer": field_samples}
