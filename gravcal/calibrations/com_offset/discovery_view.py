"""An event as discovery sees it: whitened residuals, baseline columns, and what any signal does to them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from gravcal.calibrations.com_offset import discovery_noise, motion
from gravcal.calibrations.com_offset.discovery_scene import Scene, attitude_at, field_at, turned
from gravcal.effects import Context, catalogue
from gravcal.estimation import least_squares
from gravcal.estimation.noise import NoiseModel, whiten
from gravcal.estimation.records import Block
from gravcal.physics import frames, orbit_environment

CHANNELS = ("linear", "angular", "attitude", "magnetometer")
#: Between epochs at which a step is looked for; beside a free drift one 1.5 s off loses a third of its gain.
STEP_S = 1.0


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
    orbit : (time, position_i) s, m, of the whole record
    memory : contexts at other epochs, made once
    """

    scene: Scene
    noise: dict[str, list[NoiseModel]]
    context: Context
    offset: np.ndarray
    magnetometer: tuple
    orbit: tuple
    memory: dict = field(default_factory=dict)

    def rows(self, signal: dict[str, np.ndarray]) -> np.ndarray:
        """Whitened rows (n, q) of a signal {channel: (samples, 3, q)}, zero where a channel has none.

        The readings of the accelerometer are given at its own epochs and go through the low-pass of the solution.
        """
        width = next(iter(signal.values())).shape[2]
        rows = np.zeros((self.size, width))
        for channel, values in signal.items():
            rows[self.place(channel)] = self.rows_of(channel, values)
        return rows

    @property
    def size(self) -> int:
        """Number of rows of all channels."""
        return 3 * sum(valid.size for valid in self.valid().values())

    def rows_of(self, channel: str, values: np.ndarray) -> np.ndarray:
        """Those rows (3 m, q) of one channel, from its values (samples, 3, q)."""
        if channel in ("linear", "angular"):
            values = self.scene.operator(values)
        valid = self.valid()[channel]
        return np.concatenate([whiten(self.noise[channel][a], values[:, a], valid) for a in range(3)])

    def place(self, channel: str) -> slice:
        """Place of the rows of one channel."""
        sizes = [3 * valid.size for valid in self.valid().values()]
        first = sum(sizes[: CHANNELS.index(channel)])
        return slice(first, first + sizes[CHANNELS.index(channel)])

    def valid(self) -> dict[str, np.ndarray]:
        """Usable samples of each channel."""
        operator = self.scene.operator
        valid = (operator.valid, operator.valid, self.scene.sca_good, self.magnetometer[2])
        return dict(zip(CHANNELS, valid, strict=True))

    def at(self, time: np.ndarray) -> Context:
        """Context at any epochs of the manoeuvre."""
        key = (time.size, float(time[0]), float(time[-1]))
        if key not in self.memory:
            self.memory[key] = _context(self.scene, self.context, self.orbit, time)
        return self.memory[key]


def view_of(scene: Scene, products: tuple, noise: dict, offset: np.ndarray, mass: float) -> View:
    """View of a manoeuvre.

    Parameters
    ----------
    scene : Scene
    products : aligned, field, smoothed, Dataset
    noise : {channel: noise model of each axis}, may be completed later
    offset : (3,) m, present estimate
    mass : kg
    """
    aligned, checked, smoothed = products
    true = scene.true
    rate, gradient = (smoothed[n].values[scene.smooth] for n in ("rate_b", "gradient_b"))
    orbit = aligned["time_orbit"].values, aligned["position_i"].values
    bare = Context(
        time=true,
        rate_b=rate,
        gradient_b=gradient,
        inertia_b=scene.window.arc.inertia,
        start=aligned["start"].values,
        stop=aligned["stop"].values,
        extra={"mass": mass},
    )
    context = _context(scene, bare, orbit, true)
    torque = np.cross(context.dipole_b, context.field_b)
    rate_dot = smoothed["smooth_b"].values[scene.smooth] + np.linalg.solve(context.inertia_b, torque.T).T
    context = replace(context, rate_dot_b=rate_dot, angular_b=rate_dot)
    linear = catalogue()["accelerometer.offset"].contribution(context, offset)
    sampled = discovery_noise.at_one_hertz(checked, *scene.window.arc.edges[[0, -1]])
    return View(scene, noise, replace(context, linear_b=linear), offset, sampled, orbit)


def _context(scene, base, orbit, time):
    """Context at any epochs near a manoeuvre: motion of the accelerometer epochs, dipole and field at the epochs."""
    same = time.size == base.time.size and np.array_equal(time, base.time)
    thin = lambda v: v if same else np.stack([np.interp(time, base.time, c) for c in v.T], axis=1)  # noqa: E731
    flat = base.gradient_b.reshape(-1, 9)
    R_bi = frames.R_bi_from_quaternion(attitude_at(scene, time))
    force = np.array([6e-8, 0.0, 0.0])
    extra = orbit_environment.extras(time, *orbit, R_bi, base.extra["mass"], force)
    return replace(
        base,
        time=time,
        rate_b=thin(base.rate_b),
        rate_dot_b=None if base.rate_dot_b is None else thin(base.rate_dot_b),
        gradient_b=thin(flat).reshape(-1, 3, 3),
        dipole_b=motion.dipole_at(scene.window.arc, time, scene.shift),
        field_b=field_at(scene, time, R_bi),
        linear_b=None,
        angular_b=None,
        extra=extra,
    )


def block_of(view: View, aligned, smoothed, settings: dict) -> Block:
    """Observed rows, shared columns of the offset and own columns of one manoeuvre.

    Parameters
    ----------
    view : View
    aligned, smoothed : Dataset, products of com_offset
    settings : linear_drift_degree, angular_drift_degree
    """
    scene, context = view.scene, view.context
    linear = aligned["linear_b"].values[scene.rows]
    angular = aligned["angular_b"].values[scene.rows]
    manoeuvre = smoothed["sca_manoeuvre"].values == scene.index
    residual = np.zeros((scene.sca_time.size, 3))
    residual[scene.sca_good] = smoothed["sca_residual_b"].values[manoeuvre]
    scale = np.nan_to_num(smoothed["torque_scale"].values[scene.index], nan=1.0)
    observed = {
        "linear": (np.nan_to_num(linear - linear[len(linear) // 2]) - context.linear_b)[..., None],
        "angular": (np.nan_to_num(angular - angular[len(angular) // 2]) - context.rate_dot_b)[..., None],
        "attitude": (residual + scene.scale_attitude @ (scale - 1))[..., None],
        "magnetometer": view.magnetometer[1][..., None],
    }
    offset = catalogue()["accelerometer.offset"].columns(context)
    return Block(
        label=f"manoeuvre {scene.index + 1}",
        observed=view.rows(observed)[:, 0],
        global_columns=view.rows({"linear": offset}),
        local_columns=view.rows(_own(view, settings)),
        channel=np.repeat(CHANNELS, [3 * v.size for v in view.valid().values()]),
        axis=np.concatenate([np.repeat([0, 1, 2], v.size) for v in view.valid().values()]),
        time=np.concatenate([np.tile(t, 3) for t in times(view)]),
        steps=_steps(view),
    )


def _steps(view):
    """Steps of the linear reading, {epoch: whitened rows (n, 3)}."""
    grid, time = view.scene.operator.time, view.scene.time
    epochs = np.arange(grid[0] + 6, grid[-1] - 6, STEP_S)
    shapes = view.scene.operator((time[:, None, None] >= epochs).astype(float))[:, 0]
    rows = np.zeros((view.size, epochs.size, 3))
    place, whole = view.place("linear"), view.valid()["linear"]
    for axis in range(3):
        one = slice(place.start + axis * grid.size, place.start + (axis + 1) * grid.size)
        rows[one, :, axis] = whiten(view.noise["linear"][axis], shapes, whole)
    return {float(t): rows[:, k] for k, t in enumerate(epochs)}


def times(view: View) -> tuple[np.ndarray, ...]:
    """Epochs of the rows of each channel, s.

    Parameters
    ----------
    view : View
    """
    grid = view.scene.operator.time
    return grid, grid, view.scene.sca_time, view.magnetometer[0]


def _own(view, settings):
    """Drift of each channel, start, slow torque and edges of the attitude, edges of the accelerometer."""
    scene = view.scene
    grid, _, _, mag = times(view)
    eye = np.eye(3)
    columns = []
    for channel, time, degree in (
        ("linear", scene.time, settings["linear_drift_degree"]),
        ("angular", scene.time, settings["angular_drift_degree"]),
        ("magnetometer", mag, 0),
    ):
        if time.size:
            ends = (grid[0], grid[-1]) if channel != "magnetometer" else (time[0], max(time[-1], time[0] + 1))
            shape = least_squares.polynomial(time, degree, *ends)
            columns.append({channel: np.einsum("nk,ac->nakc", shape, eye).reshape(time.size, 3, -1)})
    columns += [{"attitude": scene.own_attitude}, {"linear": _swung_drag(view.context)}]
    width = float(np.median(np.diff(scene.time)))
    rest = scene.true, view.context.field_b, width
    ends = [motion.magnetic_acceleration(scene.window.arc, scene.shift + d, *rest) for d in (-0.15, 0.15)]
    columns.append(felt(view, _edge_by_edge(scene, ends[1] - ends[0])))
    return merged(columns)


def _swung_drag(context):
    """Reading (n, 3, 3) of a unit force that stays in place while the body swings about its mean rotation."""
    step = np.diff(context.time, prepend=context.time[0])[:, None]
    angle = np.cumsum((context.rate_b - context.rate_b.mean(axis=0)) * step, axis=0)
    return np.stack([np.cross(unit, angle) for unit in np.eye(3)], axis=2)


def _edge_by_edge(scene, jump):
    """Jump (n, 3, 2 edges) at the sample before an edge and at the one after, a column each.

    Where between two samples an edge falls is known to neither model; a momentary sample near it may be on either side,
    and from one edge of the wave to the next it may change sides.
    """
    arc = scene.window.arc
    change = np.abs(np.diff(arc.dipole_b.sum(axis=1), prepend=0.0, append=0.0))
    edges = arc.edges[change > 0.25 * change.max()] + scene.shift
    near = np.searchsorted(scene.true, edges)[:, None] + np.array([-1, 0])
    near = np.clip(near, 0, scene.true.size - 1).ravel()
    columns = np.zeros((scene.true.size, 3, near.size))
    columns[near, :, np.arange(near.size)] = jump[near]
    return columns


def felt(view: View, alpha: np.ndarray) -> dict[str, np.ndarray]:
    """What angular accelerations do to the accelerometer.

    Parameters
    ----------
    view : View
    alpha : (n, 3, q) rad s-2
    """
    linear = -np.moveaxis(np.cross(np.moveaxis(alpha, 2, 1), view.offset), 1, 2)
    return {"linear": linear, "angular": alpha}


def turning(view: View, effect_of) -> dict[str, np.ndarray]:
    """Signals of torques: angular acceleration in the accelerometer, attitude in the star camera.

    Parameters
    ----------
    view : View
    effect_of : Context -> (n, 3, q) N m
    """
    inverse = np.linalg.inv(view.scene.window.arc.inertia)

    def alpha(context):
        return np.moveaxis(effect_of(context), 2, 1) @ inverse.T

    attitude = turned(view.scene, lambda time: alpha(view.at(time)))
    return felt(view, np.moveaxis(alpha(view.context), 1, 2)) | {"attitude": attitude}


def merged(columns: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """One signal from several, their columns side by side.

    Parameters
    ----------
    columns : list of {channel: (samples, 3, q)}
    """
    widths = [next(iter(c.values())).shape[2] for c in columns]
    ends = np.cumsum([0, *widths])
    joined = {}
    for column, begin, end in zip(columns, ends[:-1], ends[1:], strict=True):
        for channel, values in column.items():
            joined.setdefault(channel, np.zeros((values.shape[0], 3, ends[-1])))
            joined[channel][:, :, begin:end] = values
    return joined
