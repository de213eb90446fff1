"""Level-1 records in order of time and on GPS time, marked where they are not usable. Shared by the calibrations."""

import functools

import numpy as np
import xarray as xr
from numba import njit

from gravcal.estimation import timing
from gravcal.physics import earth, frames

#: Bits of a reader's flag that make a sample unusable; order and repetition are settled here.
UNUSABLE = 1 | 2 | 16 | 32 | 64 | 128
#: Quality bits of the products that make a sample unusable.
QUALITY = {"ACC1A": 0b1001010, "ACT1A": 0b1001010, "SCA1B": 0b1, "MAG1B": 0b11000010, "THR1B": 0b11000001}
STATE = ("xpos", "ypos", "zpos", "xvel", "yvel", "zvel")
QUATERNION = ("quatangle", "quaticoeff", "quatjcoeff", "quatkcoeff")
#: s, of tags of a pair of satellites: longest lag searched, step of the epochs compared, distance of independent lags,
#: distance from a manoeuvre, least lag of tags that are off; pointing off by milliradians looks like a few seconds.
LONGEST_S, EVERY_S, APART_S, MARGIN_S, LATE_S = 600, 60, 60, 300.0, 10.0
BRIDGED_S = 180.0  # s, longest gap of orbits and attitudes that is interpolated over
CLEARLY = 4.0  # least ratio of the misfit at any independent lag to that at the best lag
JUMP_S = 1e-6  # s, of a clock
WHOLE_S = 0.5  # s, error of lags that are searched in whole seconds
POINTING_S, OFF_S = 15.0, 60.0  # s, error of a lag by pointing 0.017 rad off the flight; a lag no pointing explains


def sorted_samples(observed: xr.Dataset, tags: timing.Tags, names: tuple[str, ...], bad=None):
    """Samples of an "ingest" in order of GPS tags, repeated ones dropped, unusable and `bad` (n,) ones marked.

    Returned are time (m,) s, values (m, k) of the named variables, columns side by side, flag (m,) uint8 (0 usable) and
    numbers of records {"out_of_order", "repeated", "conflicting", "marked", "undated"}.
    """
    columns = [column for n in names for column in np.atleast_2d(np.asarray(observed[n].values, dtype=float).T)]
    flagged = (observed["flag"].values & UNUSABLE) != 0
    if "qualflg" in observed:
        mask = QUALITY.get(observed.attrs.get("product", ""), 0)
        flagged = flagged | ((observed["qualflg"].values & mask) != 0)
    if bad is not None:
        flagged = flagged | bad
    dated = np.isfinite(tags.fraction)
    kept = np.flatnonzero(dated)
    usable = timing.Tags(tags.second[kept], tags.fraction[kept])
    order, conflicting, counts = timing.ordered(usable, [c[kept] for c in columns])
    index = kept[order]
    flag = (flagged[index] | conflicting).astype(np.uint8)
    counts |= {"undated": int((~dated).sum()), "marked": int(flag.sum())}
    values = np.stack([c[index] for c in columns], axis=1) if columns else np.zeros((index.size, 0))
    return usable.time[order], values, flag, counts


def own_tags(observed: xr.Dataset) -> timing.Tags:
    """Tags of an "ingest" as they stand in its file."""
    return timing.normalised(observed["time_second"].values, observed["time_fraction"].values)


def usable(observed: xr.Dataset, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Time (m,) s, by its own tags, and values (m, k) of the usable samples of an "ingest", all of them finite."""
    time, values, flag, _ = sorted_samples(observed, own_tags(observed), names)
    good = (flag == 0) & np.isfinite(values).all(axis=1)
    return time[good], values[good]


def gps_tags(observed: xr.Dataset, tim1b: xr.Dataset, clk1b: xr.Dataset, clock_gap_limit_s: float):
    """GPS Tags (s, flags) of an "ingest" with on-board tags: by TIM1B to receiver time, by CLK1B to GPS time."""
    limits = clock_gap_limit_s, clock_gap_limit_s, JUMP_S  # between clock records, beyond them, of a step of the clock
    names = ("obctime", "receiver_second", "receiver_fraction", "qualflg")
    onboard = timing.tim1b_clock(*(tim1b[name].values for name in names))
    receiver = timing.clk1b_clock(*(clk1b[n].values for n in ("rcv_time", "eps_time", "eps_drift", "qualflg")))
    received, _ = timing.converted(own_tags(observed), onboard, *limits)
    gps, _ = timing.converted(received, receiver, *limits)
    return gps


def between(at: np.ndarray, time: np.ndarray, limit: float) -> np.ndarray:
    """True for each epoch (m,) on or between two ordered samples (n,) that are at most `limit` apart (s)."""
    if time.size < 2:
        return np.zeros(at.shape, dtype=bool)
    index = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    return (at >= time[0]) & (at <= time[-1]) & (time[index] - time[index - 1] <= limit)


def near_windows(observed: xr.Dataset, spans: np.ndarray) -> xr.Dataset:
    """Records whose tags as in the file are within a minute of windows (w, 2) s; a clock is never off by more."""
    near = in_windows(observed["time_tag"].values, spans, 60.0)
    return observed if near.all() else observed.isel(record=np.flatnonzero(near))


def in_windows(time: np.ndarray, spans: np.ndarray, margin: float) -> np.ndarray:
    """True for epochs (n,) s in one of the windows (w, 2) s, which are wider by the margin s on either side."""
    inside = np.zeros(time.size, dtype=bool)
    for start, stop in spans:
        inside |= (time >= start - margin) & (time <= stop + margin)
    return inside


def orbit_states(time: np.ndarray, values: np.ndarray, product: str) -> dict[str, np.ndarray]:
    """{"position_i", "velocity_i", "position_e"}, (n, 3) m and m s-1 each, of states (n, 6) of GNI1B or GNV1B."""
    position, velocity = values[:, :3], values[:, 3:]
    if product == "GNI1B":
        state_e = earth.state_to_fixed(time, position, velocity)
        return {"position_i": position, "velocity_i": velocity, "position_e": state_e[0]}
    state_i = earth.state_to_inertial(time, position, velocity)
    return {"position_i": state_i[0], "velocity_i": state_i[1], "position_e": position}


def late_of_pair(aligned: xr.Dataset, pointed: xr.Dataset) -> np.ndarray:
    """Whole seconds (5,) by which tags are late: of ranging, star cameras 1 and 2, orbits 1 and 2.

    If both orbits are late alike, all other tags appear early. A lag is 0 where none stands out; star cameras are
    compared in routine pointing. Products are "align" and "pointing" of kbr_phase_centre.
    """
    lag, time, delays = np.arange(-LONGEST_S, LONGEST_S + 1), pointed["time"].values, np.zeros(5)
    place = np.arange(LONGEST_S + 1, time.size - LONGEST_S - 1, EVERY_S)
    if place.size < 2:
        return delays
    moved = moved_orbits(aligned)
    residual = _rates_left(aligned, moved, place)
    misfits = {w: functools.cache(lambda k, w=w: np.nanmean(residual(w, k) ** 2)) for w in (0, 3, 4)}
    best = min(misfits, key=lambda which: misfits[which](_least(lag, misfits[which])))  # the ranging if none is late
    delays[best] = _clear(lag, misfits[best])
    first, second = (moved(k, np.arange(time.size), int(late)) for k, late in enumerate(delays[3:]))
    between = (second - first) / np.linalg.norm(second - first, axis=1, keepdims=True)
    routine = place[~in_windows(time[place], _spans(pointed), MARGIN_S)]
    for k, toward in enumerate((between, -between)):
        quaternion = aligned["quaternion"].values[k]
        known = routine[np.isfinite(quaternion[routine]).all(axis=1)]
        if known.size:
            x_axis = frames.R_bi_from_quaternion(quaternion[known])[:, 0]
            angle = 1 - np.nanmean(np.einsum("na,nla->nl", x_axis, toward[known[:, None] - lag]), axis=0)
            delays[1 + k] = _clear(lag, dict(zip(lag, angle, strict=True)).get)
    return delays


def moved_orbits(aligned: xr.Dataset):
    """Function (satellite, indices (n,), lag s) -> inertial positions (n, 3) m, were the tags of the orbit late by it.

    An Earth-fixed orbit is turned with the Earth by the lag. Beyond its ends the record is held.
    """
    time, position = aligned["time"].values, np.array(aligned["position_i"].values)
    fixed = aligned.attrs.get("orbit") == "GNV1B"
    R_ei = earth.R_ei(time) if fixed else np.zeros((0, 3, 3))
    position_e = np.matvec(R_ei, position) if fixed else position
    return lambda satellite, place, late: _moved(position[satellite], position_e[satellite], R_ei, place, late)


@njit(cache=True)
def _moved(position, position_e, R_ei, place, late):
    """Inertial positions (m, 3) m at indices (m,) plus a lag, from Earth-fixed ones (n, 3) unless R_ei is empty."""
    turned, last = np.empty((place.size, 3)), len(position) - 1
    for m in range(place.size):
        epoch, source = min(max(place[m], 0), last), min(max(place[m] + late, 0), last)
        for i in range(3):
            turned[m, i] = position[source, i]
            if late and len(R_ei):
                x, y, z = position_e[source, 0], position_e[source, 1], position_e[source, 2]
                turned[m, i] = R_ei[epoch, 0, i] * x + R_ei[epoch, 1, i] * y + R_ei[epoch, 2, i] * z
    return turned


def _rates_left(aligned, moved, place):
    """Function (stream of `late_of_pair`, lag s) -> (n,) m s-1, range rate minus that of the orbits, lag removed."""
    read = np.interp(aligned["time"].values[place], aligned["time_kbr"].values, aligned["reading_range_rate"].values)

    def left(stream, late):  # stream 0 ranging, 3 and 4 orbits; central difference of the range over two seconds
        ranging_lag, *orbit_lag = (late * (stream == k) for k in (0, 3, 4))
        epochs = (place + s - ranging_lag for s in (-1, 0, 1))
        before, baseline, after = (moved(1, at, orbit_lag[1]) - moved(0, at, orbit_lag[0]) for at in epochs)
        along = np.einsum("ni,ni->n", baseline, after - before)
        return read - along / np.sqrt(4 * np.einsum("ni,ni->n", baseline, baseline))

    return left


def late_orbit(aligned: xr.Dataset, pointed: xr.Dataset, late: np.ndarray) -> dict | None:
    """Effect of the wrong tags of one orbit on the range rate in routine pointing; None if none of `late` is off.

    {"late": s, "satellite": 0 or 1, "time": (n,) s, "left": (n,) m s-1, range rate minus that of the orbits as tagged,
    "change": (n,) m s-2, its derivative by the delay}
    """
    if not np.any(np.abs(late[3:]) > LATE_S):
        return None
    number = int(np.argmax(np.abs(late[3:])))
    delay, time = int(late[3 + number]), aligned["time"].values
    place = np.arange(LONGEST_S + 1, time.size - LONGEST_S - 1, EVERY_S)
    routine = place[~in_windows(time[place], _spans(pointed), MARGIN_S)]
    place = routine if 2 * routine.size > place.size else place  # by such an orbit all may look like manoeuvres
    left = _rates_left(aligned, moved_orbits(aligned), place)
    known = left(3 + number, 0)
    change = (known - left(3 + number, delay)) / delay
    return {"late": delay, "satellite": number, "time": time[place], "left": known, "change": change}


def off_orbit(time, quaternion, orbit_time, state_i, axis: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Angle (n,) rad by which a body axis lags the flight direction in the orbital plane, and its rate (n,) rad s-1.

    Attitudes (n, 4) at (n,) s, states (m, 6) at (m,) s; an axis against the flight counts as along it, and if it is
    near neither the angle is zero. Angle over rate is the time by which the tags of the attitudes are late.
    """
    state = np.stack([np.interp(time, orbit_time, column) for column in state_i.T], axis=1)
    rate = np.linalg.norm(np.cross(state[:, :3], state[:, 3:]), axis=1) / np.sum(state[:, :3] ** 2, axis=1)
    above, _, along = np.matvec(frames.flight_frame(state), frames.R_bi_from_quaternion(quaternion)[:, axis]).T
    sign, parallel = np.sign(np.median(along)), abs(np.median(along)) > 0.5
    return np.arctan2(sign * above, sign * along) * parallel, rate


def _spans(pointed):
    """Begin and end (w, 2) s of the manoeuvres of a "pointing"."""
    return np.stack([pointed["start"].values, pointed["stop"].values], axis=1)


def _least(lag, misfit):
    """Lag (of lags (n,) s, a second apart) that minimises a function `misfit` of it, smooth over ten seconds."""
    return min(lag[np.abs(lag - min(lag[::10], key=misfit)) <= 10], key=misfit)


def _clear(lag, misfit):
    """Lag s that minimises a function `misfit`, or 0 unless at all independent lags it is `CLEARLY` times larger."""
    best = _least(lag, misfit)
    return best if CLEARLY * misfit(best) < misfit(_least(lag[np.abs(lag - best) > APART_S], misfit)) else 0
