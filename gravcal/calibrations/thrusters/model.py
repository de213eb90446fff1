"""Records of a day of thrusters, linear model of the attitude by firings, smooth torque and cameras, and its noise."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.interpolate import BSpline, CubicSpline
from scipy.linalg import expm
from scipy.ndimage import uniform_filter1d

from gravcal.calibrations import checks, schemas
from gravcal.calibrations.align import QUATERNION, STATE, off_orbit, own_tags, sorted_samples, usable
from gravcal.calibrations.schemas import build
from gravcal.errors import EstimationError, refuse
from gravcal.estimation import least_squares, timing
from gravcal.estimation.noise import NoiseModel, fit_noise, whiten
from gravcal.physics import earth, frames, magnetic

SCHEMAS = schemas.of("thrusters.toml")

LOW_RATE = 0b11000000  # quality bits of SCA1B: made from low-rate data
THRUSTERS = 12  # the two orbit thrusters are left out
ORBIT_STEP_S = 60.0  # s, of positions and field
DEGREE = 5  # of the attitude: two integrations of a torque that is a cubic spline
DELAY_STEP_S = 0.5  # s, half the step of the derivative by the delay of the firings
MARGIN_S = 1.0  # s, of a quiet stretch to the firings at its ends
QUIET_LEAST = 500  # least number of epochs that measure the noise
LONGEST_S = 600  # s, largest lag of tags that is searched
SLOWEST_HZ = 1 / 90  # of rates in which firings are looked for; below it control answers them
ALIKE = 2001  # frequencies of the running mean that smooths the power spectrum of a rate
NEAR_S = 10  # s, distance of lags that are not independent


@dataclass(frozen=True)
class Camera:
    """Attitude as the star cameras give it."""

    time: np.ndarray  #: (n,) s
    quaternion: np.ndarray  #: (n, 4) scalar first, continuous in sign
    head: np.ndarray  #: (n,) int, sca_id: camera or combination in use
    quality: np.ndarray  #: (n,) rad, root of the sum of squares given by the product
    step_s: float  #: s

    def part(self, rows: np.ndarray) -> "Camera":
        """Camera at some of its epochs, by index or mask."""
        return Camera(self.time[rows], self.quaternion[rows], self.head[rows], self.quality[rows], self.step_s)


@dataclass(frozen=True)
class Firings:
    """Attitude thrusters: time (k,) s, middle of each firing; impulse_b (k, 3) N m s of the thruster table."""

    time: np.ndarray
    impulse_b: np.ndarray

    def late_by(self, delay_s: float) -> "Firings":
        """Firings at their true times if their tags are late by delay_s."""
        return Firings(self.time - delay_s, self.impulse_b)


@dataclass(frozen=True)
class Records:
    """Records of a day: attitude, firings, firings of the twin satellite (None without)."""

    camera: Camera
    firings: Firings
    twin: Firings | None


def align(
    observed: xr.Dataset, fired: xr.Dataset, orbit: xr.Dataset, *twin: xr.Dataset, position_b, force_b, igrf_generation
) -> xr.Dataset:
    """Product "thrusters.align": usable attitudes, firings with their nominal impulses, orbit and field of one day.

    Of "ingest" of SCA1B, THR1B, GNV1B and, as twin, THR1B of the other satellite of the pair; position_b and force_b
    are (14, 3) m and N, in the order of the columns of THR1B.
    """
    low = (observed["qualflg"].values & LOW_RATE) != 0
    time, values, flag, _ = sorted_samples(observed, own_tags(observed), (*QUATERNION, "sca_id", "qual_rss"), low)
    norm = np.linalg.norm(values[:, :4], axis=1)
    good = (flag == 0) & np.isfinite(values).all(axis=1) & (np.abs(norm - 1) < 1e-3)
    if good.sum() < QUIET_LEAST:
        count, file = f"{good.sum()} usable attitudes", observed.attrs.get("file", "SCA1B")
        refuse(file, count, f"at least {QUIET_LEAST}", "Give a longer record.", EstimationError, usable=int(good.sum()))
    aligned = {"time": time[good], "quaternion": frames.continuous(values[good, :4] / norm[good, None])}
    aligned |= {"head": values[good, 4].astype(int), "quality": values[good, 5], "step": np.median(np.diff(time[good]))}
    own = _firings(fired, position_b, force_b)
    aligned |= {"firing": own.time, "impulse_b": own.impulse_b}
    for other in twin:
        firings = _firings(other, position_b, force_b)
        aligned |= {"twin_firing": firings.time, "twin_impulse_b": firings.impulse_b}
    time, state = usable(orbit, STATE)
    if not time.size or np.ptp(time) < 3 * ORBIT_STEP_S:
        refuse("GNV1B", f"{time.size} usable positions", "minutes of them", "Give a longer record.", EstimationError)
    inertial, velocity_i = earth.state_to_inertial(time, state[:, :3], state[:, 3:])
    every = slice(None, None, max(int(round(ORBIT_STEP_S / np.median(np.diff(time)))), 1))
    field_e = magnetic.field_e(time[every], state[every, :3], igrf_generation)
    aligned |= {"time_orbit": time[every], "position_i": inertial[every]}
    aligned |= {"field_i": np.matvec(np.swapaxes(earth.R_ei(time[every]), 1, 2), field_e)}
    return build(SCHEMAS["align"], aligned | {"velocity_error": checks.velocity_error(time, inertial, velocity_i)})


def _firings(observed, position_b, force_b):
    """Attitude firings of "ingest" of THR1B; impulses are lever arm x force x time on of the thruster table."""
    names = [name for name in observed.data_vars if name.startswith("on_time")][:THRUSTERS]
    time, values = usable(observed, tuple(names))
    seconds = 1e-3 * values  # ms in the file
    torque = np.cross(np.asarray(position_b)[:THRUSTERS], np.asarray(force_b)[:THRUSTERS])
    used = seconds.sum(axis=1) > 0
    return Firings((time + seconds.max(axis=1) / 2)[used], seconds[used] @ torque)


def records(aligned: xr.Dataset) -> Records:
    """Records of an aligned day as arrays; `aligned` is "thrusters.align"."""
    arrays = {name: aligned[name].values for name in aligned.variables}
    camera = Camera(arrays["time"], arrays["quaternion"], arrays["head"], arrays["quality"], float(arrays["step"]))
    twin = Firings(arrays["twin_firing"], arrays["twin_impulse_b"]) if "twin_firing" in arrays else None
    return Records(camera, Firings(arrays["firing"], arrays["impulse_b"]), twin)


def off_the_orbit(aligned: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Once a minute time s, angle rad of body x behind the flight and orbital rate rad s-1, (n,) each; ratio: lag."""
    orbit, position, time = (aligned[name].values for name in ("time_orbit", "position_i", "time"))
    state = np.column_stack([position, np.gradient(position, orbit, axis=0)])
    near = np.searchsorted(time, orbit[1:-1])
    near = np.unique(near[(near > 0) & (near < time.size)])
    return time[near], *off_orbit(time[near], aligned["quaternion"].values[near], orbit, state)


def reference(time: np.ndarray, quaternion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Small rotation (n, 3) rad from a steady turn to continuous attitudes (n, 4), and its rate (3,) rad s-1."""
    steps = frames.attitude_error(quaternion[1:], quaternion[:-1])
    rate = steps.sum(axis=0) / (time[-1] - time[0])
    middle = time.size // 2
    turn = frames.from_rotation_vector(rate * (time - time[middle])[:, None])
    return frames.attitude_error(quaternion, frames.quaternion_product(quaternion[middle], turn)), rate


def late(one: Records, inertia_b) -> int:
    """Whole seconds by which firings of records `one` are tagged late against the attitude, 0 where no lag stands out.

    Matched filter: square of the correlation, by lag, of the rate with steps J^-1 L at firings, over its power.
    """
    camera, hold = one.camera, max(int(round(one.camera.step_s)), 1)
    steps = np.diff(camera.time)
    rate = frames.attitude_error(camera.quaternion[1:], camera.quaternion[:-1]) / steps[:, None]
    count = int(camera.time[-1] - camera.time[0]) + 1 + hold
    valid, place = steps < 1.5 * camera.step_s, (camera.time[:-1] - camera.time[0]).astype(int)
    if count < 2 * LONGEST_S or not valid.any():
        return 0
    rate_b, jumps = np.zeros((count, 3)), np.zeros((count, 3))
    for k in range(hold):
        rate_b[place[valid] + k] = rate[valid] - np.median(rate[valid], axis=0)
    fired = one.firings.time - camera.time[0]
    inside = (fired > 0) & (fired < count - 1)
    np.add.at(jumps, fired[inside].astype(int), np.linalg.solve(inertia_b, one.firings.impulse_b[inside].T).T)
    frequency = np.fft.rfftfreq(2 * count, 1.0)
    response = np.sinc(hold * frequency) / np.maximum(2 * np.pi * frequency, 1e-9) / 1j
    rates, predicted = np.fft.rfft(rate_b, 2 * count, axis=0), np.fft.rfft(jumps, 2 * count, axis=0) * response[:, None]
    power = uniform_filter1d(np.abs(rates) ** 2, ALIKE, axis=0)
    weight = ((frequency > SLOWEST_HZ) & (frequency < 0.5 / hold))[:, None] / np.maximum(power, 1e-300)
    return -timing.lag(rates, predicted, LONGEST_S, NEAR_S, weight)


def smooth_torque(time: np.ndarray, knot_s: float) -> np.ndarray:
    """Columns (n, k) of the attitude under a cubic-spline torque with knots each knot_s, B-splines of degree 5."""
    start, stop = time[0], time[-1] + 1e-3
    inner = np.linspace(start, stop, max(int(np.ceil((stop - start) / knot_s)), 1) + 1)
    knots = np.concatenate([np.full(DEGREE, start), inner, np.full(DEGREE, stop)])
    return BSpline.design_matrix(time, knots, DEGREE).toarray()


def impulse_response(inertia_b: np.ndarray, rate_b: np.ndarray, span_s: float) -> Callable[[np.ndarray], np.ndarray]:
    """Attitude after a unit impulse about a steady turn: function of lag (...,) s -> (..., 3, 3) rad per N m s.

    The rate_b (3,) rad s-1 is that of the turn, span_s the longest lag.
    angle' = -w x angle + dw, J dw' = -(w x J dw) - (dw x J w): equations.md M2, first order about a constant rate.
    """
    lag_s = np.arange(0.0, span_s + 40.0, 10.0)  # nodes each 10 s: the turn is slow, 1e-3 rad s-1
    turn = frames.cross_matrix(rate_b)
    system = np.zeros((6, 6))
    system[:3, :3], system[:3, 3:] = -turn, np.eye(3)
    system[3:, 3:] = -np.linalg.solve(inertia_b, turn @ inertia_b - frames.cross_matrix(inertia_b @ rate_b))
    step, inverse = expm(system * 10.0), np.linalg.inv(inertia_b)
    response, state = np.zeros((lag_s.size, 3, 3)), np.eye(6)
    for k in range(lag_s.size):
        response[k] = state[:3, 3:] @ inverse
        state = step @ state
    return CubicSpline(lag_s, response)


@dataclass(frozen=True)
class Segment:
    """One block of time, with the columns of its linear model."""

    camera: Camera  #: its epochs
    place: np.ndarray  #: (n,) int, index of each epoch on the even grid of the block
    angle_b: np.ndarray  #: (n, 3) rad, attitude against a steady turn
    smooth: np.ndarray  #: (n, k) columns of the attitude under a smooth torque about one axis, see `smooth_torque`
    basis: np.ndarray  #: (n, r) orthonormal basis of `smooth`
    response: Callable[[np.ndarray], np.ndarray]  #: see `impulse_response`

    def after(self, epochs: np.ndarray, impulse_b: np.ndarray) -> np.ndarray:
        """Attitude (n, 3, q) rad by impulses (k, 3, q) N m s at epochs (k,) s; those outside the block are left out."""
        time = self.camera.time
        inside = (epochs > time[0]) & (epochs < time[-1])
        lag = time[:, None] - epochs[inside]
        kernel = np.where((lag > 0)[..., None, None], self.response(np.maximum(lag, 0.0)), 0.0)
        count, width = int(inside.sum()), impulse_b.shape[2]
        flat = kernel.transpose(0, 2, 1, 3).reshape(3 * time.size, 3 * count)
        return (flat @ impulse_b[inside].reshape(3 * count, width)).reshape(time.size, 3, width)

    def after_torque(self, torque_b: np.ndarray) -> np.ndarray:
        """Attitude (n, 3, q) rad under torques (n, 3, q) N m, constant from each epoch of the block to the next."""
        time = self.camera.time
        width = np.diff(time, append=time[-1] + self.camera.step_s)
        return self.after(time + width / 2 - 1e-3, torque_b * width[:, None, None])

    def sharp(self, columns: np.ndarray) -> np.ndarray:
        """Columns (n, 3, q) with the smooth torque projected out, so that the rest is not small beside it."""
        flat = columns.reshape(len(columns), -1)
        return (flat - self.basis @ (self.basis.T @ flat)).reshape(columns.shape)

    def gains(self, firings: Firings) -> np.ndarray:
        """Derivatives (n, 3, 3) rad of the attitude by the gain about each axis, smooth torque projected out."""
        return self.sharp(self.after(firings.time, firings.impulse_b[:, :, None] * np.eye(3)))

    def delay(self, firings: Firings, span_s=(DELAY_STEP_S, -DELAY_STEP_S)) -> np.ndarray:
        """Change (n, 3, 1) rad s-1 of the attitude by the delay of firings over a span, smooth torque projected out."""
        early, late = (self.after(firings.time - delay, firings.impulse_b[:, :, None]) for delay in span_s)
        return self.sharp((early - late) / (span_s[0] - span_s[1]))

    def heads(self, heads: list[int]) -> np.ndarray:
        """Derivatives (n, 3, 3 h) of the attitude by an offset rad on each axis of h cameras while in use."""
        steps = [(self.camera.head == head)[:, None, None] * np.eye(3) for head in heads]
        return np.concatenate(steps, axis=2) if steps else np.zeros((len(self.place), 3, 0))


def segments(camera: Camera, inertia_b, *, block_s: float, knot_s: float) -> list[Segment]:
    """Blocks of block_s with torque knots each knot_s, those with less than half of their epochs left out."""
    index = np.floor((camera.time - camera.time[0]) / block_s)
    kept = []
    for number in np.unique(index):
        rows = np.flatnonzero(index == number)
        if rows.size * camera.step_s > block_s / 2:
            part = camera.part(rows)
            angle, rate = reference(part.time, part.quaternion)
            place = np.rint((part.time - part.time[0]) / part.step_s).astype(int)
            response = impulse_response(np.asarray(inertia_b, dtype=float), rate, np.ptp(part.time))
            smooth = smooth_torque(part.time, knot_s)
            kept.append(Segment(part, place, angle, smooth, least_squares.orthonormal(smooth, 1e-13), response))
    return kept


def heads_of(parts: list[Segment]) -> list[int]:
    """Sorted sca_id of the cameras in use."""
    return sorted({int(head) for part in parts for head in np.unique(part.camera.head)})


@dataclass(frozen=True)
class Noise:
    """Noise model of the attitude: decorrelation of the axes by camera, then a model of each component in time."""

    factor: dict[int, np.ndarray]  #: {head: (3, 3) rad-1}, inverse Cholesky factor of the covariance of its errors
    models: list[NoiseModel]  #: noise model of each of the three decorrelated components

    def rows(self, segment: Segment, signal: np.ndarray) -> np.ndarray:
        """Whitened rows (3 m, q) of a signal (n, 3, q) rad, by component on the even grid (m,); 0 where missing."""
        count = segment.place[-1] + 1
        grid, valid = np.zeros((count, 3, signal.shape[2])), np.zeros(count, dtype=bool)
        valid[segment.place] = True
        grid[segment.place] = np.stack([self.factor[h] for h in segment.camera.head]) @ signal
        return np.concatenate([whiten(model, grid[:, a], valid) for a, model in enumerate(self.models)])


def noise_of(measured: xr.Dataset) -> Noise:
    """Noise from the arrays of a product; `measured` is "thrusters.noise"."""
    one = {name: measured[name].values for name in measured.variables}
    factor = {int(head): factor for head, factor in zip(one["head"], one["factor"], strict=True)}
    models = [NoiseModel(r, v, float(one["step"])) for r, v in zip(one["reflection"], one["variance"], strict=True)]
    return Noise(factor, models)


def quiet_noise(
    aligned: xr.Dataset, *, quiet_minimum_s: float, knot_s: float, noise_order: int, head_minimum: int
) -> xr.Dataset:
    """Product "thrusters.noise": noise of the attitude ("thrusters.align") in stretches without firings.

    The smooth torque of each is removed. A camera with fewer epochs than head_minimum is left out: no covariance.
    """
    day = records(aligned)
    pieces = list(_quiet(day.camera, day.firings.time, quiet_minimum_s, knot_s))
    samples = sum(len(residual) for residual, *_ in pieces)
    if samples < QUIET_LEAST:
        epochs, expected = f"{samples} epochs without a firing", f"{QUIET_LEAST} to measure the noise of the attitude"
        remedy = "Give a longer record or a smaller quiet_minimum_s."
        refuse("attitude", epochs, expected, remedy, EstimationError, stretches=len(pieces))
    residual, head = (np.concatenate([piece[k] for piece in pieces]) for k in (0, 1))
    removed = sum(piece[3] for piece in pieces)
    factor = {}
    for known in np.unique(head):
        of_camera = residual[head == known]
        if len(of_camera) >= head_minimum:
            covariance = of_camera.T @ of_camera / len(of_camera) * samples / (samples - removed)
            factor[int(known)] = np.linalg.inv(np.linalg.cholesky(covariance))
    if not factor:
        epochs, remedy = f"{samples} quiet epochs of {np.unique(head).size} cameras", "Give a longer record."
        refuse("attitude", epochs, f"{head_minimum} of one to measure its noise", remedy, EstimationError)
    grids = []
    for values, heads, place, _ in pieces:
        known = np.isin(heads, list(factor))
        grid = np.full((place[-1] + 1, 3), np.nan)
        if known.any():
            decorrelated = np.stack([factor[int(h)] for h in heads[known]]) @ values[known][..., None]
            grid[place[known]] = decorrelated[..., 0]
        grids.append(grid)
    step = day.camera.step_s
    models = [fit_noise([grid[:, axis] for grid in grids], noise_order, step, removed) for axis in range(3)]
    noise = {"head": list(factor), "factor": list(factor.values()), "step": step}
    noise |= {"reflection": [m.reflection for m in models], "variance": [m.variance for m in models]}
    return build(SCHEMAS["noise"], noise | {"stretches": len(pieces), "samples": samples})


def _quiet(camera, firing_times, quiet_minimum_s, knot_s) -> Iterator[tuple]:
    """Residual (n, 3) rad, camera (n,), index on the even grid (n,), coefficients an axis, of each quiet stretch."""
    ends = np.concatenate([camera.time[:1], firing_times, camera.time[-1:]])
    for start, stop in zip(ends[:-1], ends[1:], strict=True):
        rows = np.flatnonzero((camera.time > start + MARGIN_S) & (camera.time < stop - MARGIN_S))
        if stop - start >= quiet_minimum_s and rows.size * camera.step_s > 0.8 * (stop - start):
            part = camera.part(rows)
            angle, _ = reference(part.time, part.quaternion)
            basis = np.linalg.qr(smooth_torque(part.time, knot_s))[0]
            place = np.rint((part.time - part.time[0]) / part.step_s).astype(int)
            yield angle - basis @ (basis.T @ angle), part.head, place, basis.shape[1]
