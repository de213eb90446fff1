"""Line of sight in both satellites: pointing angles, wiggles, the antenna correction, observation equations."""

import itertools
from dataclasses import astuple, dataclass, fields

import numpy as np
import xarray as xr
from scipy.signal import savgol_filter

from gravcal.calibrations import schemas
from gravcal.calibrations.schemas import build
from gravcal.estimation import crn
from gravcal.estimation.noise import runs
from gravcal.physics import frames
from gravcal.physics.constants import DAY

SCHEMAS = schemas.of("kbr_phase_centre.toml")
#: Names along the dimensions of the products.
PARAMETERS = ("x_a", "y_a", "z_a", "x_b", "y_b", "z_b")
OBSERVABLES = ("range", "range_rate", "range_acceleration")
UNITS = ("m", "m s-1", "m s-2")
ESTIMATORS = ("ls", "robust")
SUBSETS = ("all", "positive", "mirror", "all_x_fixed", "positive_x_fixed", "mirror_x_fixed")
MANOEUVRE = ("satellite_index", "axis_index", "sign", "start", "stop")  # variables of each


def schema_of(stage: str, observable: str) -> dict:
    """Schema of the product of a stage with the units of one observable."""
    number = OBSERVABLES.index(observable)
    return {
        name: stated | {"units": stated["units"][number]} if isinstance(stated.get("units"), tuple) else stated
        for name, stated in SCHEMAS[stage].items()
    }


@dataclass(frozen=True)
class Wiggle:
    """One sub-manoeuvre."""

    satellite_index: int  #: 0 or 1
    axis_index: int  #: 0 pitch, 1 yaw
    sign: int  #: of the offset angle, 0 without one
    start: float  #: s, first slew
    stop: float  #: s, last slew
    offset: float  #: rad, mean angle
    amplitude: float  #: rad, of the wave


def pointing(
    aligned: xr.Dataset, *, nominal_m, given, period_s: float, offset_limit_deg: float, amplitude_limit_deg: float
) -> xr.Dataset:
    """Product "kbr_phase_centre.pointing": geometry on whole seconds, and sub-manoeuvres from the pointing angles.

    nominal_m (2, 3) m is for the second order in the phase centres; given (k, 5) are satellite, axis, sign, start and
    stop of the catalogue's manoeuvres, which are looked for if it has none.
    """
    time, position, quaternion = (aligned[n].values for n in ("time", "position_i", "quaternion"))
    line = lines_of_sight(position, quaternion)
    angle = angles(line)
    limits = (np.radians(offset_limit_deg), np.radians(amplitude_limit_deg))
    if given:
        manoeuvres = [measured(time, angle, *one, period_s) for one in given]
    else:
        detections = (wiggles(time, angle[k, :, axis], k, axis, period_s, *limits) for k in (0, 1) for axis in (0, 1))
        manoeuvres = list(itertools.chain.from_iterable(detections))
    manoeuvres.sort(key=lambda one: one.start)
    names = [field.name for field in fields(Wiggle)]
    values = dict(zip(names, np.array([astuple(one) for one in manoeuvres]).reshape(-1, len(names)).T, strict=True))
    values |= {
        "time": time,
        "range_com": np.linalg.norm(position[1] - position[0], axis=1),
        "second_order": second_order(position, quaternion, np.asarray(nominal_m, dtype=float).reshape(2, 3)),
        "line_of_sight_b": line,
        "angle": angle,
        "usable": np.isfinite(line).all(axis=(0, 2)),
    }
    attrs = {n: aligned.attrs[n] for n in ("satellites", "ranging", "orbit")}
    title = "Pointing against the line of sight, and the wiggles in it"
    return build(SCHEMAS["pointing"], values, title=title, **attrs)


def lines_of_sight(position_i: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Unit vector (2, n, 3) from each satellite to the other in its own body frame.

    The range of the phase centres is |u| - l_A . c_A - l_B . c_B to first order, so the observation columns are minus
    these vectors for both satellites: rho_KBR - rho_COM = [-e^T R_ib,A, +e^T R_ib,B] (c_A; c_B); Remote Sens. 2022, 14,
    3395, eq. 13 (erratum K-1: printed with the opposite sign). l_A = R_bi,A e, l_B = -R_bi,B e.
    """
    u = position_i[1] - position_i[0]
    e = u / np.linalg.norm(u, axis=1, keepdims=True)
    result = np.full((2, *e.shape), np.nan)
    for k, line in enumerate((e, -e)):
        valid = np.isfinite(quaternion[k]).all(axis=1)
        result[k, valid] = np.matvec(frames.R_bi_from_quaternion(quaternion[k, valid]), line[valid])
    return result


def angles(line_of_sight_b: np.ndarray) -> np.ndarray:
    """Pitch and yaw (..., 2) rad of the line of sight (..., 3) in the body.

    A positive offset has the columns (-cos, +sin) for pitch (x, z) and (-cos, -sin) for yaw (x, y).
    """
    x, y, z = np.moveaxis(line_of_sight_b, -1, 0)
    return np.stack([np.arctan2(-z, x), np.arctan2(y, x)], axis=-1)


def second_order(position_i: np.ndarray, quaternion: np.ndarray, nominal: np.ndarray) -> np.ndarray:
    """Second order (n,) m of the range in the phase centres, at their nominal place (2, 3) m in b.

    |u + v| - |u| - e.v = |v_perp|^2 / (2 |u|), 13 nm at 3 deg and 220 km; equations.md M3. u = |u| e lies between the
    centres of mass, from position_i (2, n, 3) m; v is what the phase centres add, by quaternion (2, n, 4).
    """
    u = position_i[1] - position_i[0]
    rho = np.linalg.norm(u, axis=1)
    v = np.full_like(u, np.nan)
    valid = np.isfinite(quaternion).all(axis=(0, 2))
    R = [frames.R_bi_from_quaternion(q[valid]) for q in quaternion]
    v[valid] = np.einsum("nji,j->ni", R[1], nominal[1]) - np.einsum("nji,j->ni", R[0], nominal[0])
    across = v - u * (np.einsum("ni,ni->n", u, v) / rho**2)[:, None]
    return np.einsum("ni,ni->n", across, across) / (2 * rho)


def antenna_correction(line_of_sight_b: np.ndarray, centre_b: np.ndarray) -> np.ndarray:
    """Correction (n,) m that turns the range of the phase centres (2, 3) m into that of the centres of mass when added.

    rho_AOC = e^T R_ib,A c_A - e^T R_ib,B c_B; Remote Sens. 2022, 14, 3395, eq. 11 (erratum K-1).
    """
    return np.einsum("kni,ki->n", line_of_sight_b, centre_b)


def measured(time, angle, satellite, axis, sign, start, stop, period: float) -> Wiggle:
    """Wiggle of a catalogued manoeuvre, its offset and amplitude measured in the pointing angles (2, n, 2) rad."""
    signal = angle[int(satellite), :, int(axis)]
    inside = (time > start + period / 2) & (time < stop - period / 2) & np.isfinite(signal)
    if not inside.any():
        return Wiggle(satellite, axis, sign, start, stop, np.nan, np.nan)
    carrier = np.exp(-2j * np.pi * (time[inside] - start) / period)
    offset = float(signal[inside].mean())
    amplitude = float(2 * abs(np.mean((signal[inside] - offset) * carrier)))
    return Wiggle(satellite, axis, sign, start, stop, offset, amplitude)


def wiggles(time, angle, satellite, axis, period, offset_limit, amplitude_limit) -> list[Wiggle]:
    """Sub-manoeuvres about one axis of one satellite, in an angle (n,) rad every second, NaN where unknown.

    The angle is split over one period into its mean and its amplitude; where the amplitude stays above its limit there
    is a wiggle, and the slews are where the mean passes half its offset.
    """
    valid = np.isfinite(angle)
    if time.size < 3 * period or not valid.any():
        return []
    filled = np.interp(time, time[valid], angle[valid])
    count = int(round(period))
    phase = np.exp(-2j * np.pi * (time - time[0]) / period)
    mean = _running_mean(filled, count)
    amplitude = 2 * np.abs(_running_mean((filled - np.median(filled)) * phase, count))
    manoeuvres = []
    for begin, end in zip(*runs(amplitude > amplitude_limit), strict=True):
        if end - begin <= 2 * count:
            continue
        last = end - 1
        margin = (last - begin) // 8
        inside = slice(begin + margin, last - margin)
        before, after = filled[max(begin - 1000, 0) : max(begin - 200, 1)], filled[last + 200 : last + 1000]  # s
        rest_angle = np.median(np.concatenate([before, after]))
        offset, wave_amplitude = float(mean[inside].mean()), float(np.median(amplitude[inside]))
        sign = int(np.sign(offset)) if abs(offset) > offset_limit else 0
        start, stop = time[begin], time[last]
        if sign:
            level = rest_angle + (offset - sign * wave_amplitude - rest_angle) / 2
            outside = sign * (filled - level) < 0
            middle = (begin + last) // 2
            early, late = np.flatnonzero(outside[:middle]), np.flatnonzero(outside[middle:])
            start = time[early[-1] + 1] if early.size else time[0]
            stop = time[middle + late[0] - 1] if late.size else time[-1]
        manoeuvres.append(Wiggle(satellite, axis, sign, start, stop, offset, wave_amplitude))
    return manoeuvres


def middle(pointed: xr.Dataset) -> float:
    """Mean of the middles of all wiggles, GPS s: the epoch of phase centres that move; noon of a record without one."""
    if pointed.sizes["manoeuvre"]:
        return float((pointed["start"].values + pointed["stop"].values).mean() / 2)
    return float(DAY * np.round(pointed["time"].values.mean() / DAY))


def _running_mean(values, count):
    """Mean (n,) over `count` samples, one period, centred on each of the values (n,), shorter at the ends."""
    window, ones = np.ones(count), np.ones(values.size)
    return np.convolve(values, window, "same") / np.convolve(ones, window, "same")


def observable(
    aligned: xr.Dataset,
    pointed: xr.Dataset,
    *,
    variant: str,
    trim_s: float,
    quiet_margin_s: float,
    crn_window_s: float,
    crn_bandwidth_hz: float,
    nominal_m,
    published_half_width: int,
) -> xr.Dataset:
    """Product "kbr_phase_centre.observable": ranging minus orbit, columns, levers at the ranging epochs.

    The range of the centres of mass, the columns and the second order in the offsets pass through the CRN filter that
    made range, rate and acceleration of the ranging product; nothing is differentiated in another way. nominal_m (2, 3)
    m is for the lever arm of pointing errors.
    """
    derivative = OBSERVABLES.index(variant)
    time, at = pointed["time"].values, aligned["time_kbr"].values
    good = pointed["usable"].values != 0
    filter_ = crn.Crn(window_s=crn_window_s, bandwidth_hz=crn_bandwidth_hz)
    operators = [crn.operator(filter_, order, good, (time[0], 1.0), at) for order in range(derivative + 1)]
    line = np.concatenate(list(pointed["line_of_sight_b"].values), axis=1)
    modelled = operators[-1](np.column_stack([pointed["range_com"].values + pointed["second_order"].values, -line]))
    levers = line[:, [2, 1, 5, 4]] * np.repeat(np.asarray(nominal_m, dtype=float).reshape(2, 3)[:, 0], 2)
    valid = operators[-1].valid & (aligned["kbr_flag"].values == 0)
    spans = np.stack([pointed["start"].values, pointed["stop"].values], axis=1)
    epochs = np.clip(np.rint(at - time[0]).astype(int), 0, time.size - 1)
    published, step = -line[epochs], float(np.median(np.diff(at))) if at.size > 1 else 1.0
    for _ in range(derivative):  # D, D D of Remote Sens. 2022, 14, 3395, eqs. 17, 19; no window printed (erratum K-4)
        options = {"deriv": 1, "delta": step, "axis": 0, "mode": "nearest"}
        published = savgol_filter(published, 2 * published_half_width + 1, 3, **options)
    values = {
        "time_kbr": at,
        "observed": aligned[f"reading_{variant}"].values - modelled[:, 0],
        "column": modelled[:, 1:],
        "lever": np.stack([filtered(levers) for filtered in operators], axis=1),
        "published_column": published,
        "arc": arcs(at, spans, trim_s, quiet_margin_s),
        "segment": aligned["segment"].values,
    }
    values = {name: column[valid] for name, column in values.items()}
    values |= {name: pointed[name].values for name in MANOEUVRE}
    attrs = {"title": f"Observation equations of {variant}", "observable": variant, "unit": UNITS[derivative]}
    attrs |= {n: pointed.attrs[n] for n in ("satellites", "ranging", "orbit")}
    return build(schema_of("observable", variant), values, **attrs)


def arcs(time: np.ndarray, spans: np.ndarray, trim: float, margin: float) -> np.ndarray:
    """Number of the manoeuvre of every epoch (m,); -1 in quiet data, -2 near or at the ends of a span (k, 2) s."""
    result = np.full(time.size, -1)
    for start, stop in spans:
        result[(time > start - margin) & (time < stop + margin) & (result == -1)] = -2
    for index, (start, stop) in enumerate(spans):
        result[(time >= start + trim) & (time <= stop - trim)] = index
    return result
