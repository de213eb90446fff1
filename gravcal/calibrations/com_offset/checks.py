"""Checks of the records of a day against each other, before anything is solved; the report judges the result."""

import numpy as np
import xarray as xr

from gravcal.calibrations import checks as checking
from gravcal.calibrations.align import STATE, between, in_windows, near_windows, orbit_states, own_tags, sorted_samples
from gravcal.calibrations.checks import at_least, at_most, largest
from gravcal.calibrations.com_offset.align import OUTLIER, REACH
from gravcal.estimation import timing
from gravcal.estimation.resampling import bin_means
from gravcal.physics import frames, gravity
from gravcal.physics.constants import EARTH_RADIUS

#: Quantile of the samples of a piece that must keep to a limit: single outliers do not count, a tenth of a piece does.
SHARE = 0.9
#: s, longest step between samples over which a mean velocity stands for the derivative of the position.
STEP_LIMIT_S = 30.0
#: Channels that never read the same for long.
CHANNELS = {"acc": ("linear_b", "angular_b"), "sca": ("quaternion",), "mag": ("field_measured_b",)}
#: Of tags that are far off: longest lag s, length s of a manoeuvre, within which lags are not independent, least lag s;
#: band of the square waves, Hz.
APART_S, NEAR_S, LATE_S, BAND_HZ = 600, 180, 10, (1 / 30, 1 / 6)


def inputs(aligned: xr.Dataset, checked: xr.Dataset, smoothed: xr.Dataset, *others: xr.Dataset, **limits) -> xr.Dataset:
    """Checks of the records round the manoeuvres against each other; what is not there is not checked.

    A misfit is the 90 % quantile of the samples of a piece of `check_piece_s`, the largest of all pieces. Products are
    "align", "field" and "attitude"; others are the orbit product that was not taken, if there is one.
    """
    piece = limits["check_piece_s"]
    usable = aligned["orbit_flag"].values == 0
    time, position, velocity = (aligned[n].values[usable] for n in ("time_orbit", "position_i", "velocity_i"))
    against_velocity, against_gravity = _orbit(time, position, velocity)
    height = 1e-3 * (np.linalg.norm(position, axis=1) - EARTH_RADIUS)
    pointing = _pointing(aligned, time, position, velocity)
    distance = _misfit(*_apart(others, aligned, time, position), piece)
    used = checked["used"].values.astype(bool)
    field = checked["time_mag"].values[used], 1e9 * np.linalg.norm(checked["difference_b"].values[used], axis=1)
    outliers = [float(np.mean(aligned[f"{name}_flag"].values == OUTLIER)) for name in REACH]
    longest = [np.nan]
    for sensor, names in CHANNELS.items():
        usable = aligned[f"{sensor}_flag"].values == 0
        values = np.concatenate([aligned[n].values[usable] for n in names], axis=1)
        values, tags = values[:, np.isfinite(values).any(axis=0)], aligned[f"time_{sensor}"].values[usable]
        longest += [checking.longest_constant(tags, values, STEP_LIMIT_S)] if values.size else []
    checks = [
        at_most("position against velocity", _misfit(*against_velocity, piece), limits["velocity_limit_m_s"], "m s-1"),
        at_most("velocity against gravity", _misfit(*against_gravity, piece), limits["gravity_limit_m_s2"], "m s-2"),
        at_most("orbit products", distance, limits["orbit_limit_m"], "m"),
        at_least("lowest height", -_misfit(time, -height, piece), limits["height_lowest_km"], "km"),
        at_most("greatest height", _misfit(time, height, piece), limits["height_greatest_km"], "km"),
        at_most("attitude against orbit", _misfit(*pointing, piece), limits["pointing_limit_deg"], "deg"),
        at_most("magnetometer against IGRF", _misfit(*field, piece), limits["field_limit_nt"], "nT"),
        at_most("isolated outliers, share", max(outliers), limits["outlier_limit"], "1"),
        at_most("unchanged readings", np.fmax.reduce(longest), limits["unchanged_limit_s"], "s"),
        *_motion(smoothed, late(aligned), limits),
    ]
    return checking.product([one for one in checks if not np.isnan(one.value)])


def _misfit(time, size, piece_s):
    """Largest, over pieces of a record, of the `SHARE` quantile of sizes (n,) at (n,) s; NaN without a sample."""
    size = np.where(np.isfinite(size), size, np.inf)
    pieces = np.split(size, np.flatnonzero(np.diff(np.floor(time / piece_s))) + 1)
    return max((float(np.quantile(sizes, SHARE, method="lower")) for sizes in pieces if sizes.size), default=np.nan)


def _orbit(time, position, velocity):
    """Pairs (time s, misfit): position derivative minus velocity m s-1, velocity derivative minus gravity m s-2."""
    step = np.diff(time)
    short = (step > 0) & (step <= STEP_LIMIT_S)
    mean = lambda values: (values[1:] + values[:-1]) / 2  # noqa: E731
    height = np.linalg.norm(position, axis=1)
    outside = ~((height > EARTH_RADIUS / 2) & (height < 100 * EARTH_RADIUS))
    gravity_i = gravity.acceleration_i(np.where(outside[:, None], [EARTH_RADIUS, 0.0, 0.0], position))
    gravity_i[outside] = np.inf
    with np.errstate(invalid="ignore", divide="ignore"):
        velocity_misfit = np.diff(position, axis=0) / step[:, None] - mean(velocity)
        gravity_misfit = np.diff(velocity, axis=0) / step[:, None] - mean(gravity_i)
    return [(mean(time)[short], np.linalg.norm(misfit, axis=1)[short]) for misfit in (velocity_misfit, gravity_misfit)]


def _apart(others, aligned, time, position):
    """Common epochs (m,) s in the windows, and distance (m,) m of another orbit product there; empty without one."""
    if not others:
        return np.zeros(0), np.zeros(0)
    spans = np.stack([aligned["window_start"].values, aligned["window_stop"].values], axis=1)
    orbit = near_windows(others[0], spans)
    epoch, values, flag, _ = sorted_samples(orbit, own_tags(orbit), STATE)
    kept = in_windows(epoch, spans, 0.0) & (flag == 0)
    epoch, states = epoch[kept], orbit_states(epoch[kept], values[kept], orbit.attrs.get("product", ""))
    common, mine, theirs = np.intersect1d(np.round(time, 3), np.round(epoch, 3), return_indices=True)
    return common, np.linalg.norm(position[mine] - states["position_i"][theirs], axis=1)


def _pointing(aligned, time, position, velocity):
    """Star-camera epochs (m,) s, and larger of the angles (m,) deg of x to the line of velocity and of z to the nadir.

    Orbit (n,) s, (n, 3) inertial. Which way x flies depends on who leads; the field shows if the body is turned round.
    """
    quaternion = aligned["quaternion"].values
    if time.size < 2:
        return np.zeros(0), np.zeros(0)
    inside = np.isfinite(quaternion).all(axis=1) & between(aligned["time_sca"].values, time, STEP_LIMIT_S)
    epoch, R_bi = aligned["time_sca"].values[inside], frames.R_bi_from_quaternion(quaternion[inside])
    towards = [np.stack([np.interp(epoch, time, v[:, c]) for c in range(3)], axis=1) for v in (velocity, -position)]
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead, down = (np.matvec(R_bi, v / np.linalg.norm(v, axis=1, keepdims=True)) for v in towards)
        return epoch, np.degrees(np.arccos(np.clip(np.minimum(np.abs(ahead[:, 0]), down[:, 2]), -1, 1)))


def angular_accelerations(aligned: xr.Dataset) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Epochs (n,) s, a second apart, and {"mag", "acc", "sca": angular acceleration (n, 3)} there, NaN where unknown.

    Of accelerometer and star camera in rad s-2; of the torquers, current x field in mA T, which it is proportional to.
    """
    first = np.floor(aligned["window_start"].values.min())
    epoch = first + np.arange(int(aligned["window_stop"].values.max() - first) + 2)
    good = (aligned["sca_flag"].values == 0) & np.isfinite(aligned["quaternion"].values).all(axis=1)
    quaternion, time = aligned["quaternion"].values[good], aligned["time_sca"].values[good]
    steps = frames.rotation_vector(frames.quaternion_product(frames.conjugate(quaternion[:-1]), quaternion[1:]))
    sca_acceleration, step = np.full((time.size, 3), np.nan), np.diff(time)
    if time.size > 2:
        evenly = (step[1:] < 1.5 * np.median(step)) & (step[:-1] < 1.5 * np.median(step))
        sca_acceleration[1:-1][evenly] = (np.diff(steps, axis=0) / (step[1:] * step[:-1])[:, None])[evenly]
    torque = np.cross(aligned["current_b"].values, aligned["field_measured_b"].values)
    edges, means = np.append(epoch, epoch[-1] + 1) - 0.5, {}
    for name, values in (("mag", torque), ("acc", aligned["angular_b"].values)):
        usable = aligned[f"{name}_flag"].values == 0
        means[name], _ = bin_means(aligned[f"time_{name}"].values[usable], values[usable], edges)
    return epoch, means | {"sca": bin_means(time, sca_acceleration, edges)[0]}


def late(aligned: xr.Dataset) -> dict[str, int]:
    """Whole seconds by which tags of accelerometer and star camera ("acc", "sca") are late against the torquers.

    Only those that are far off, by more than `LATE_S`, in records with a manoeuvre, which a lag shows in. Where both
    are alike it is those of the torquers ("mag").
    """
    if not aligned.sizes["manoeuvre"]:
        return {}
    time, accelerations = angular_accelerations(aligned)
    known = {name: one for name, one in accelerations.items() if np.isfinite(one).any()}
    if "mag" not in known:
        return {}
    centred = {name: np.nan_to_num(one - np.nanmean(one, axis=0)) for name, one in known.items()}
    spectra = {name: np.fft.rfft(one, 2 * time.size, axis=0) for name, one in centred.items()}
    frequency = np.fft.rfftfreq(2 * time.size, 1.0)
    weight = ((frequency > BAND_HZ[0]) & (frequency < BAND_HZ[1]))[:, None]
    longest = min(APART_S, time.size - 1)
    lags = {name: timing.lag(spectra[name], spectra["mag"], longest, NEAR_S, weight) for name in known if name != "mag"}
    far = {name: lag for name, lag in lags.items() if abs(lag) > LATE_S}
    return {"mag": -far["acc"]} if len(far) == 2 and abs(far["acc"] - far["sca"]) <= 1 else far


def _motion(smoothed, far, limits):
    """Checks of star camera and angular accelerometer against the torquers; `far` are the seconds of `late`."""
    known = {name: smoothed[name].values for name in smoothed.variables}
    limit, checks = limits["scale_limit"], []
    for name, label in (("torque", "star camera over torquers"), ("angular", "angular accelerometer over torquers")):
        determined = (known[f"{name}_scale_sigma"] < limit / 5) & (known["rod"] >= 0)[:, None]
        deviation = np.abs(known[f"{name}_scale"] - 1)[determined]
        checks.append(at_most(f"{label}, from one", largest(deviation), limit, "1"))
    # scale of the angular accelerometer over that of the star camera, from one; the torque that they share drops out
    limit = limits["angular_limit"]
    size = np.maximum(np.hypot(known["torque_scale_sigma"], known["angular_scale_sigma"]), 1e-6)
    determined = (known["rod"] >= 0)[:, None] & (size < limit / 2) & (known["torque_scale"] != 0)
    deviation = np.divide(known["angular_scale"], known["torque_scale"], out=np.ones_like(size), where=determined) - 1
    weight = np.where(determined, size**-2, 0.0)
    total = np.maximum(weight.sum(axis=0), 1e-300)
    deviation = largest(np.where(total > (4 / limit) ** 2, np.abs(np.sum(weight * deviation, axis=0)) / total, np.nan))
    checks.append(at_most("angular accelerometer over star camera, from one", deviation, limits["angular_limit"], "1"))
    rms = 1e6 * largest(known["residual_rms"])
    checks.append(at_most("star camera against dynamics, rms", rms, limits["attitude_limit_urad"], "urad"))
    for name, label in (("acc", "accelerometer"), ("sca", "star camera")):
        size = np.fmax(largest(np.abs(known[f"{name}_delay"])), abs(far.get(name, far.get("mag", np.nan))))
        checks.append(at_most(f"delay of the {label}", size, limits["delay_limit_s"], "s"))
    return checks
