"""An event as discovery sees it: whitened residuals, baseline columns, columns of every candidate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gravcal.calibrations.com_offset import discovery_drivers as drivers
from gravcal.calibrations.com_offset import discovery_noise, discovery_timing, motion
from gravcal.calibrations.com_offset.discovery_scene import Scene, field_b, scenes, turned
from gravcal.calibrations.com_offset.noise import models_of
from gravcal.effects import Context, catalogue
from gravcal.effects.base import Effect
from gravcal.methods import estimation
from gravcal.methods.noise import NoiseModel, whiten

CHANNELS = ("linear", "angular", "attitude", "magnetometer")
LAGS_S = (0.05, 0.2, 1.0)  # where the lag is differentiated
FAMILIES = ("timing", "torque", "accelerometer", "attitude", "magnetometer")
#: Baseline parameters, or searched for along the time axis by the engine.
NOT_HERE = ("accelerometer.offset", "accelerometer.bias_step", "accelerometer.stray_tone")


@dataclass(frozen=True)
class View:
    """Manoeuvre as arrays, with what turns a signal into whitened rows.

    Attributes
    ----------
    scene : Scene
    noise : {channel: noise model of each axis}
    context : Context at the accelerometer epochs
    offset : (3,) m, present estimate
    magnetometer : (time, difference, valid) at 1 Hz
    """

    scene: Scene
    noise: dict[str, list[NoiseModel]]
    context: Context
    offset: np.ndarray
    magnetometer: tuple

    def rows(self, signal: dict[str, np.ndarray]) -> np.ndarray:
        """Whitened rows (n, q) of a signal {channel: (samples, 3, q)}, zero where a channel has none."""
        width = next(iter(signal.values())).shape[2]
        parts = []
        for channel, valid in self.valid().items():
            values = signal.get(channel)
            if values is None:
                parts.append(np.zeros((3 * valid.size, width)))
                continue
            parts += [whiten(self.noise[channel][a], values[:, a], valid) for a in range(3)]
        return np.concatenate(parts)

    def valid(self) -> dict[str, np.ndarray]:
        """Usable samples of each channel."""
        operator = self.scene.operator
        valid = (operator.valid, operator.valid, self.scene.sca_good, self.magnetometer[2])
        return dict(zip(CHANNELS, valid, strict=True))


def view(aligned, field, smoothed, measured, solved, **settings) -> tuple[list[dict], list[dict]]:
    """Blocks and candidates of an event.

    Parameters
    ----------
    aligned, field, smoothed, measured, solved : Dataset, products of com_offset, solved with variant mtq
    settings : of the calibration's stages, with inertia, dipole_per_current, angular_drift_degree

    Returns
    -------
    blocks : fields of `gravcal.discovery.blocks.Block`
    candidates : fields of `gravcal.discovery.blocks.Candidate`
    """
    normal, right = (np.nansum(solved[n].values, axis=0) for n in ("normal", "right"))
    offset = estimation.stable_inverse(normal) @ right
    noise = {
        "linear": models_of(measured),
        "angular": discovery_noise.angular(aligned, field, settings),
        "attitude": discovery_noise.attitude(smoothed, settings),
        "magnetometer": discovery_noise.magnetometer(aligned, field, settings),
    }
    views = [_view(s, aligned, field, smoothed, noise, offset) for s in scenes(aligned, field, smoothed, settings)]
    blocks = [_block(v, aligned, smoothed, settings) for v in views]
    blocks.append(discovery_timing.block(smoothed))
    found = _candidates(views, aligned, smoothed)
    return blocks, found


def _view(scene, aligned, field, smoothed, noise, offset):
    true = scene.true
    rate, gradient = (smoothed[n].values[scene.smooth] for n in ("rate_b", "gradient_b"))
    dipole = motion.dipole_at(scene.window.arc, true, scene.shift)
    field_now = field_b(aligned, scene, true)
    torque = np.cross(dipole, field_now)
    rate_dot = smoothed["smooth_b"].values[scene.smooth] + np.linalg.solve(scene.window.arc.inertia, torque.T).T
    context = Context(
        time=true,
        rate_b=rate,
        rate_dot_b=rate_dot,
        gradient_b=gradient,
        dipole_b=dipole,
        field_b=field_now,
        angular_b=rate_dot,
        inertia_b=scene.window.arc.inertia,
        start=aligned["start"].values,
        stop=aligned["stop"].values,
        extra={"mass": 580.0, "non_gravitational_b": np.tile([6e-8, 0.0, 0.0], (true.size, 1))},
    )
    linear = catalogue()["accelerometer.offset"].contribution(context, offset)
    context = Context(**(context.__dict__ | {"linear_b": linear}))
    ends = scene.window.arc.edges[[0, -1]]
    sampled = discovery_noise.at_one_hertz(field, *ends)
    return View(scene, noise, context, offset, sampled)


def _block(view, aligned, smoothed, settings):
    """Observed rows, shared columns of the offset and own columns of one manoeuvre."""
    scene, context = view.scene, view.context
    op = scene.operator
    linear = aligned["linear_b"].values[scene.rows]
    angular = aligned["angular_b"].values[scene.rows]
    manoeuvre = smoothed["sca_manoeuvre"].values == scene.index
    residual = np.zeros((scene.sca_time.size, 3))
    residual[scene.sca_good] = smoothed["sca_residual_b"].values[manoeuvre]
    scale = np.nan_to_num(smoothed["torque_scale"].values[scene.index], nan=1.0)
    observed = {
        "linear": op(np.nan_to_num(linear - linear[len(linear) // 2]) - context.linear_b)[..., None],
        "angular": op(np.nan_to_num(angular - angular[len(angular) // 2]) - context.rate_dot_b)[..., None],
        "attitude": (residual + scene.scale_attitude @ (scale - 1))[..., None],
        "magnetometer": view.magnetometer[1][..., None],
    }
    offset = catalogue()["accelerometer.offset"].columns(context)
    return {
        "label": f"manoeuvre {scene.index}",
        "observed": view.rows(observed)[:, 0],
        "shared": view.rows({"linear": op(offset)}),
        "own": view.rows(_own(view, settings)),
        "channel": np.repeat(CHANNELS, [3 * v.size for v in view.valid().values()]),
        "axis": np.concatenate([np.repeat([0, 1, 2], v.size) for v in view.valid().values()]),
        "time": np.concatenate([np.tile(t, 3) for t in _times(view)]),
        "local": _steps(view),
    }


def _steps(view):
    """Steps of the linear reading, {epoch: whitened rows (n, 3)}."""
    grid = view.scene.operator.time
    epochs = np.arange(grid[0] + 6, grid[-1] - 6, 6.0)
    acc = view.scene.time
    shapes = view.scene.operator((acc[:, None] >= epochs).astype(float))
    rows = view.rows({"linear": np.einsum("nk,ac->nakc", shapes, np.eye(3)).reshape(grid.size, 3, -1)})
    return {float(t): rows[:, 3 * k : 3 * k + 3] for k, t in enumerate(epochs)}


def _times(view):
    grid = view.scene.operator.time
    return grid, grid, view.scene.sca_time, view.magnetometer[0]


def _own(view, settings):
    """Drift of each channel, start, slow torque and edges of the attitude, edges of the accelerometer."""
    scene = view.scene
    grid, _, sca, mag = _times(view)
    eye = np.eye(3)
    columns = []
    for channel, time, degree in (
        ("linear", grid, settings["drift_degree"]),
        ("angular", grid, settings["angular_drift_degree"]),
        ("magnetometer", mag, 0),
    ):
        if time.size:
            shape = estimation.polynomial(time, degree, time[0], max(time[-1], time[0] + 1))
            columns.append({channel: np.einsum("nk,ac->nakc", shape, eye).reshape(time.size, 3, -1)})
    columns += [{"attitude": scene.own_attitude}, {"linear": scene.operator(_swung_drag(view.context))}]
    width = float(np.median(np.diff(scene.time)))
    rest = scene.true, view.context.field_b, width
    ends = [motion.magnetic_acceleration(scene.window.arc, scene.shift + d, *rest) for d in (-0.02, 0.02)]
    slope = (ends[1] - ends[0]) / 0.04
    columns.append(_felt(view, _edge_by_edge(scene, slope)))
    return _merged(columns)


def _swung_drag(context):
    """Reading (n, 3, 3) of a unit force that stays in place while the body swings about its mean rotation."""
    step = np.diff(context.time, prepend=context.time[0])[:, None]
    angle = np.cumsum((context.rate_b - context.rate_b.mean(axis=0)) * step, axis=0)
    return np.stack([np.cross(unit, angle) for unit in np.eye(3)], axis=2)


def _edge_by_edge(scene, slope):
    """Slope (n, 3, edges), one column an edge: where between two samples an edge falls is known to neither model."""
    arc = scene.window.arc
    change = np.abs(np.diff(arc.dipole_b.sum(axis=1), prepend=0.0, append=0.0))
    edges = arc.edges[change > 0.5 * change.max()] + scene.shift
    nearest = np.argmin(np.abs(scene.true[:, None] - edges), axis=1)
    return slope[:, :, None] * (nearest[:, None] == np.arange(edges.size))[:, None, :]


def _felt(view, alpha):
    """What angular accelerations (n, 3, q) rad s-2 do to the accelerometer."""
    moved = np.moveaxis(alpha, 2, 1)
    linear = -np.moveaxis(np.cross(moved, view.offset), 1, 2)
    return {"linear": view.scene.operator(linear), "angular": view.scene.operator(alpha)}


def _merged(columns):
    """One signal from several, their columns side by side."""
    widths = [next(iter(c.values())).shape[2] for c in columns]
    total, merged, begin = sum(widths), {}, 0
    for column, width in zip(columns, widths, strict=True):
        for channel, values in column.items():
            merged.setdefault(channel, np.zeros((values.shape[0], 3, total)))
            merged[channel][:, :, begin : begin + width] = values
        begin += width
    return merged


def _candidates(views, aligned, smoothed):
    """Every effect of the catalogue that a channel here can show, then the drivers."""
    found = []
    for slug, entry in catalogue().items():
        if slug in NOT_HERE or slug.partition(".")[0] not in FAMILIES:
            continue
        for at in LAGS_S if slug == "torque.dipole_lag" else (None,):
            columns = [_columns(v, entry, aligned, at) for v in views]
            timing = discovery_timing.columns(slug, smoothed, aligned["start"].values)
            if all(c is None for c in columns) and timing is None:
                continue
            units = [p.unit for p in entry.parameters]
            found.append(_named(slug, "" if at is None else f"tau {at:g} s", entry, [*columns, timing], units))
    found += drivers.candidates(views, aligned, _felt)
    return found


def _named(slug, form, entry, columns, units):
    names = [p.name for p in entry.parameters]
    return {"cause": slug, "form": form, "names": names, "units": units, "columns": columns}


def _columns(view, entry: Effect, aligned, at):
    """Whitened rows (n, q) of an effect in one manoeuvre, None where its channel is not observed."""
    context = view.context
    if entry.channel == "linear_b":
        return view.rows({"linear": view.scene.operator(entry.columns(context))})
    if entry.channel == "angular_b":
        return view.rows({"angular": view.scene.operator(entry.columns(context))})
    if entry.channel == "pointing_b":
        return view.rows({"attitude": entry.columns(Context(time=view.scene.sca_time))})
    if entry.channel == "field_b" and view.magnetometer[0].size:
        time = view.magnetometer[0]
        dipole = motion.dipole_at(view.scene.window.arc, time, view.scene.shift)
        return view.rows(
            {
                "magnetometer": entry.columns(
                    Context(time=time, field_b=field_b(aligned, view.scene, time), dipole_b=dipole)
                )
            }
        )
    if entry.channel in ("dipole_b", "torque_b"):
        return _turning(view, entry, aligned, at)
    return None


def _turning(view, entry, aligned, at):
    """Effects that turn the satellite: angular acceleration in the accelerometer, attitude in the star camera."""
    inverse = np.linalg.inv(view.scene.window.arc.inertia)

    def alpha(context):
        values = _derivative(entry, context, at)
        moved = np.moveaxis(values, 2, 1)
        if entry.channel == "dipole_b":
            moved = np.cross(moved, context.field_b[:, None, :])
        return moved @ inverse.T

    signal = _felt(view, np.moveaxis(alpha(view.context), 1, 2))
    attitude = turned(view.scene, lambda time: alpha(_context_at(view, aligned, time)))
    return view.rows(signal | {"attitude": attitude})


def _derivative(entry, context, at):
    """Columns (n, 3, q) of an effect; the lag by its secant at `at`, saturation by what it takes from full dipole."""
    if entry.slug == "torque.dipole_lag":
        return (entry.contribution(context, np.array([at])) / at)[..., None]
    if entry.slug == "torque.saturation":
        largest = np.abs(context.dipole_b).max()
        return np.where(np.abs(context.dipole_b) > 0.5 * largest, np.sign(context.dipole_b), 0.0)[..., None]
    return entry.columns(context)


def _context_at(view, aligned, time):
    """Context at any epochs of the arc."""
    base = view.context
    rate = np.stack([np.interp(time, base.time, c) for c in base.rate_b.T], axis=1)
    dipole = motion.dipole_at(view.scene.window.arc, time, view.scene.shift)
    extra = {"mass": 580.0, "non_gravitational_b": np.tile([6e-8, 0.0, 0.0], (time.size, 1))}
    field = field_b(aligned, view.scene, time)
    return Context(time=time, rate_b=rate, dipole_b=dipole, field_b=field, inertia_b=base.inertia_b, extra=extra)
