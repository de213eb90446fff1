"""Records of a magnetometer with the reference field, and the derivatives by the parameters of the instrument."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from gravcal.calibrations import checks, schemas
from gravcal.calibrations.align import BRIDGED_S, QUATERNION, STATE, between, off_orbit, usable
from gravcal.calibrations.schemas import build
from gravcal.effects import Context, effect
from gravcal.effects.sensors import OF_MAGNETOMETER, OF_WARMTH
from gravcal.errors import EstimationError, refuse
from gravcal.estimation import least_squares
from gravcal.estimation.noise import NoiseModel, fit_noise, whiten
from gravcal.estimation.resampling import on_even_grid
from gravcal.physics import earth, frames, magnetic, orbit_environment

SCHEMAS = schemas.of("magnetometer.toml")

LEAST = 20  # least number of records
DENSE_S = 10.0  # s, longest spacing of an orbit of which velocity and change of position can be compared to 1 mm s-1
#: Effects that a comparison of two fields can show.
EFFECTS = (*OF_MAGNETOMETER[:-1], "attitude.star_camera_misalignment", OF_MAGNETOMETER[-1])
VARIES, TURNS = 0.1, 0.02  # rms of warmth and of the field's direction about a line, below which all is a drift
#: s: longest lag that is looked for; shortest record in which a field has no other like it, longest with white noise.
APART_S, LONG_S, SHORT_S = 600, 3600.0, 600.0
CLEARLY = 4.0  # least ratio of the variance left without a lag to that left with it
SAMPLES_PER_COEFFICIENT = 100  # of the noise model; fewer give none


@dataclass(frozen=True)
class Field:
    """Measured and modelled field at the magnetometer's epochs."""

    time: np.ndarray  #: (n,) s
    measured_b: np.ndarray  #: (n, 3) T
    model_b: np.ndarray  #: (n, 3) T
    slope_b: np.ndarray  #: (n, 3) T s-1, rate of the modelled field in the body
    dipole_b: np.ndarray  #: (n, 3) A m2, of the torquers
    axis_b: np.ndarray  #: (n, 3) unit vector along the moment of the main field
    warmth: np.ndarray  #: (n,) 1, sunlight with a lag

    @property
    def difference(self) -> np.ndarray:
        """(n, 3) T, measured less modelled."""
        return self.measured_b - self.model_b


def align(
    mag: xr.Dataset, camera: xr.Dataset, orbit: xr.Dataset, *, dipole_per_current, igrf_generation: int
) -> xr.Dataset:
    """Product "magnetometer.align": MAG1B, reference field in b by SCA1B, GNV1B; dipole_per_current (3,) A m2 mA-1."""
    columns = tuple(f"Mfv{a}_RAW" for a in "XYZ")
    time, values = usable(mag, (*columns, "current_b"))
    sca_time, quaternion = usable(camera, QUATERNION)
    orbit_time, state = usable(orbit, STATE)
    stale = np.append(False, np.all(np.diff(values[:, :3], axis=0) == 0, axis=1))  # MAG1B has each value twice
    inside = between(time, sca_time, BRIDGED_S) & between(time, orbit_time, BRIDGED_S)
    inside &= ~stale | np.append(False, stale[:-1])  # what stands still is looked at
    if inside.sum() < LEAST:
        records, remedy = f"{inside.sum()} records with attitude and orbit", "Give files of the same minutes."
        file, count = mag.attrs.get("file", "MAG1B"), int(inside.sum())
        refuse(file, records, f"at least {LEAST}", remedy, EstimationError, records=count)
    time, values = time[inside], values[inside]
    quaternion = frames.continuous(quaternion)
    field_at = magnetic.body_field(orbit_time, state[:, :3], sca_time, quaternion, igrf_generation)
    model, axis = field_at(time)
    before, after = np.maximum(time - 0.5, sca_time[0]), np.minimum(time + 0.5, sca_time[-1])
    slope = (field_at(after)[0] - field_at(before)[0]) / (after - before)[:, None]
    scale = 1e-6 if mag[columns[0]].attrs.get("units") != "T" else 1.0
    inertial = earth.state_to_inertial(orbit_time, state[:, :3], state[:, 3:])
    at_tags = frames.interpolate(sca_time, quaternion, time)
    turn = frames.attitude_error(quaternion[1:], quaternion[:-1]) / np.diff(sca_time)[:, None]
    dense = np.median(np.diff(orbit_time)) <= DENSE_S
    aligned = {
        "time": time,
        "measured_b": values[:, :3] * scale,
        "model_b": model,
        "slope_b": slope,
        "dipole_b": values[:, 3:] * np.asarray(dipole_per_current),
        "axis_b": axis,
        "warmth": orbit_environment.warmth(time, orbit_time, inertial[0]),
        "rate_b": turn[np.clip(np.searchsorted(sca_time, time, side="right") - 1, 0, len(turn) - 1)],
        "camera_late": np.median(np.divide(*off_orbit(time, at_tags, orbit_time, np.concatenate(inertial, axis=1)))),
        "step": np.median(np.diff(time)),
        "attitude_jump": checks.attitude_jump(sca_time, quaternion),
        "velocity_error": checks.velocity_error(orbit_time, *inertial) if dense else 0.0,
    }
    return build(SCHEMAS["align"], aligned)


def late(aligned: xr.Dataset, camera_limit_s: float, delay_limit_s: float) -> dict[str, tuple[float, np.ndarray]]:
    """{cause: (delay s, change (n, 3) T of the difference of the fields)} of tags that are off by more than the limits.

    Attitudes against the orbit; then the magnetometer against both, in whole seconds, with a bias free. What is within
    the limits is no lag. Late by tau, a star camera shows the body of before, B_b = exp(-[w tau]x) B_b as tagged, a
    magnetometer B_b(t - tau).
    """
    record, delays = field(aligned), {}
    model, camera = record.model_b, float(aligned["camera_late"])
    if abs(camera) > camera_limit_s:
        turn = frames.R_bi_from_quaternion(frames.from_rotation_vector(camera * aligned["rate_b"].values))
        model = np.matvec(turn, model)
        delays["timing.star_camera_delay"] = camera, model - record.model_b
    lag = np.arange(-APART_S, APART_S + 1)
    if np.ptp(record.time) > max(LONG_S, 4 * APART_S):
        inner = np.flatnonzero((record.time > record.time[0] + APART_S) & (record.time < record.time[-1] - APART_S))
        inner = inner[:: max(inner.size // 2000, 1)]
        model_at = lambda time: np.stack([np.interp(time, record.time, c) for c in model.T], axis=1)  # noqa: E731
        variance = [np.var(record.measured_b[inner] - model_at(record.time[inner] - d), axis=0).sum() for d in lag]
        lag_s = int(lag[np.argmin(variance)])
        if abs(lag_s) > delay_limit_s and CLEARLY * min(variance) < variance[APART_S]:
            delays["timing.magnetometer_delay"] = float(lag_s), model_at(record.time - lag_s) - model
    return delays


def field(aligned: xr.Dataset) -> Field:
    """Field of a product as arrays; `aligned` is "magnetometer.align"."""
    names = ("time", "measured_b", "model_b", "slope_b", "dipole_b", "axis_b", "warmth")
    return Field(*(aligned[name].values for name in names))


def causes(field: Field) -> tuple[str, ...]:
    """Those of EFFECTS that a record can separate from a bias and a drift: warmth by night and day, axes by a turn."""
    series = np.column_stack([field.warmth, field.model_b / np.linalg.norm(field.model_b, axis=1, keepdims=True)])
    line = least_squares.polynomial(field.time, 1, field.time[0], field.time[-1])
    warmth, *direction = least_squares.project_out(line, series).std(axis=0)
    share = dict.fromkeys(OF_WARMTH, warmth / VARIES) | {"magnetometer.nonorthogonality": max(direction) / TURNS}
    return tuple(slug for slug in EFFECTS if share.get(slug, np.inf) > 1)


def columns(field: Field, slug: str) -> np.ndarray:
    """Derivatives (n, 3, q) T of measured less modelled field by each parameter of one of EFFECTS."""
    extra = {"axis_b": field.axis_b, "warmth": field.warmth}
    context = Context(time=field.time, field_b=field.model_b, dipole_b=field.dipole_b, extra=extra)
    if slug == "timing.magnetometer_delay":
        return -field.slope_b[..., None]  # a late tag belongs to an earlier field
    if slug == "attitude.star_camera_misalignment":
        return -effect("magnetometer.misalignment").columns(context)  # the modelled field turns instead
    return effect(slug).columns(context)


def noise(field: Field, step: float, columns: list[np.ndarray], order: int, floor: float) -> list[NoiseModel]:
    """Noise model of each axis from its residual beside all columns, (n, 3, q) each, never below a floor T.

    Minutes of data have no quiet part of their own: the noise is that of the residual of the widest model, so that it
    is the same under every hypothesis. It has `order` coefficients, fewer for a short record; step s of its grid.
    """
    place, models = placed(field.time, step), []
    for axis in range(3):
        basis = least_squares.orthonormal(np.concatenate([c[:, axis] for c in columns], axis=1))
        residual = least_squares.project_out(basis, field.difference[:, axis])
        models.append(noise_of(residual, place, order, floor, basis.shape[1]))
    return models


def placed(time: np.ndarray, step: float) -> np.ndarray:
    """Indices (n,) of records at times (n,) s on an even grid of this step s."""
    return np.rint((time - time[0]) / step).astype(int)


def noise_of(rest: np.ndarray, place: np.ndarray, order: int, floor: float, removed: int) -> NoiseModel:
    """Noise model of a residual (n,) T at indices `place` (n,) after a fit of `removed` parameters; floor in T."""
    order = min(order, rest.size // SAMPLES_PER_COEFFICIENT)
    model = fit_noise([on_even_grid(place, 1.0, rest)], order, 1.0, removed)
    if model.variance[0] < floor**2:
        least = max(model.variance[0], 1e-6 * floor**2)
        return replace(model, variance=np.maximum(model.variance * floor**2 / least, 1e-6 * floor**2))
    return model


def whitened(noise: NoiseModel, place: np.ndarray, values: np.ndarray, turn: Callable = whiten) -> np.ndarray:
    """Whitened rows (n, q) of values (n, q) T on one axis at indices `place` (n,); by turn=`unwhiten` the inverse."""
    grid, valid = np.zeros((place[-1] + 1, values.shape[1])), np.zeros(place[-1] + 1, dtype=bool)
    grid[place], valid[place] = values, True
    return turn(noise, grid, valid)[place]
