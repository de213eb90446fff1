"""An event handed to discovery: blocks, candidates, and how well the noise is known."""

from __future__ import annotations

import xarray as xr

from gravcal.calibrations.com_offset import discovery_noise, discovery_timing
from gravcal.calibrations.com_offset.discovery_candidates import attitude_of_torques
from gravcal.calibrations.com_offset.discovery_scene import offset_of, scenes
from gravcal.calibrations.com_offset.discovery_view import View, block_of, view_of
from gravcal.calibrations.com_offset.noise import QUIET_S
from gravcal.errors import ProductError


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
    records, offset = (aligned, field, smoothed), offset_of(solved)
    if noise:
        views, quiet = _views(records, noise, offset, settings), {}
    else:
        views, quiet = _measured(records, offset, settings)
    blocks = [block_of(v, aligned, smoothed, settings) for v in views] + [discovery_timing.block(smoothed)]
    return views, blocks, quiet


def _views(records, noise, offset, settings):
    """Views of all manoeuvres; their noise may be completed later."""
    made = scenes(*records, settings)
    return [view_of(scene, records, noise, offset, settings["mass"]) for scene in made]


def _measured(records, offset, settings):
    """Views with the noise as measured in these records, and how much of it was seen."""
    aligned, field, smoothed = records
    linear, samples = discovery_noise.linear(aligned, settings)
    if samples * settings["step_s"] < QUIET_S:
        raise ProductError(
            "discovery: found less than 300 s of quiet data outside the manoeuvres, which the noise has to be "
            "measured in. Give files that reach further before and after them."
        )
    noise, quiet = {"linear": linear}, {"linear": samples}
    noise["magnetometer"], quiet["magnetometer"] = discovery_noise.magnetometer(aligned, field, settings)
    views = _views(records, noise, offset, settings)
    wider = [attitude_of_torques(view) for view in views]
    noise["attitude"] = discovery_noise.attitude(smoothed, [view.scene for view in views], wider, settings)
    noise["angular"], quiet["angular"] = discovery_noise.angular(aligned, field, settings)
    return views, quiet
