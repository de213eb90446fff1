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
QUALITY = {"ACC1A": 0b1101010, "ACT1A": 0b1101010, "SCA1B": 0b1, "MAG1B": 0b11000010, "GNV1B": 0, "GNI1B": 0}
STATE = ("xpos", "ypos", "zpos", "xvel", "yvel", "zvel")
QUATERNION = ("quatangle", "quaticoeff", "quatjcoeff", "quatkcoeff")
#: Of tags of a pair: longest lag that is looked for, step of the epochs compared, distance of lags that differ clearly,
#: from a manoeuvre, and least lag of tags that are off, s; pointing off by milliradians looks like a few seconds.
LONGEST_S, EVERY_S, APART_S, MARGIN_S, LATE_S = 600, 60, 60, 300.0, 10.0
CLEARLY = 4.0  # times what any lag further away leaves
JUMP_S = 1e-6  # s, of a clock
WHOLE_S = 0.5  # s, of lags that are looked for in whole seconds
POINTING_S, OFF_S = 15.0, 60.0  # s, error of lags by the pointing, off the flight by 0.017 rad, and what is no pointing


def sorted_samples(observed: xr.Dataset, tags: timing.Tags, names: tuple[str, ...], bad=None):
    """Samples of an "ingest" in order of their GPS tags, repeated ones dropped, doubtful and bad (n,) ones marked.

    Time (m,) s, values (m, k) of the variables wanted, each of one column or more, flag (m,) uint8 (0 usable), and
    counts of records: out_of_order, repeated, conflicting, marked and undated.
    """
    columns = [one for n in names for one in np.atleast_2d(np.asarray(observed[n].values, dtype=float).T)]
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
    """Time (m,) s and values (m, k) of the usable samples of an "ingest", all of them known, by its own tags."""
    time, values, flag, _ = sorted_samples(observed, own_tags(observed), names)
    good = (flag == 0) & np.isfinite(values).all(axis=1)
    return time[good], values[good]


def gps_tags(observed: xr.Dataset, tim1b: xr.Dataset, clk1b: xr.Dataset, clock_gap_limit_s: float):
    """GPS time of on-board tags: TIM1B to receiver time, CLK1B to GPS time."""
    limits = clock_gap_limit_s, clock_gap_limit_s, JUMP_S
    names = ("obctime", "rcvtime_intg", "rcvtime_frac", "qualflg")
    second, received, nano, flag = (tim1b[name].values for name in names)
    onboard = timing.tim1b_clock(second, received, 1e-9 * nano, flag)
    receiver = timing.clk1b_clock(*(clk1b[n].values for n in ("rcv_time", "eps_time", "eps_drift", "qualflg")))
    received, _ = timing.converted(own_tags(observed), onboard, *limits)
    gps, _ = timing.converted(received, receiver, *limits)
    return gps


def between(at: np.ndarray, time: np.ndarray, limit: float) -> np.ndarray:
    """True for each epoch (m,) on or between two ordered samples (n,) that are at most `limit` apart (s)."""
    index = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    return (at >= time[0]) & (at <= time[-1]) & (time[index] - time[index - 1] <= limit)


def near_windows(observed: xr.Dataset, spans: np.ndarray) -> xr.Dataset:
    """Records whose own tags are within a minute of the windows (w, 2) s; a clock is never off by more."""
    near = in_windows(observed["time_tag"].values, spans, 60.0)
    return observed if near.all() else observed.isel(record=np.flatnonzero(near))


def in_windows(time: np.ndarray, spans: np.ndarray, margin: float) -> np.ndarray:
    """True for epochs (n,) s in one of the windows (w, 2) s, which are wider by the margin s on either side."""
    inside = np.zeros(time.size, dtype=bool)
    for start, stop in spans:
        inside |= (time >= start - margin) & (time <= stop + margin)
    return inside


def orbit_states(time: np.ndarray, values: np.ndarray, product: str) -> dict[str, np.ndarray]:
    """Inertial position and velocity and Earth-fixed position of states (n, 6) of GNI1B or GNV1B."""
    position, velocity = values[:, :3], values[:, 3:]
    if product == "GNI1B":
        fixed = earth.state_to_fixed(time, position, velocity)
        return {"position_i": position, "velocity_i": velocity, "position_e": fixed[0]}
    inertial = earth.state_to_inertial(time, position, velocity)
    return {"position_i": inertial[0], "velocity_i": inertial[1], "position_e": position}


def late_of_pair(aligned: xr.Dataset, pointed: xr.Dataset) -> np.ndarray:
    """Whole seconds (5,) by which tags of ranging, of both star cameras and of both orbits are late.

    Those of both orbits alike are those of all others early. A lag is 0 where none stands out; star cameras are looked
    at in routine pointing. Products are "align" and "pointing" of kbr_phase_centre.
    """
    lag, time, delays = np.arange(-LONGEST_S, LONGEST_S + 1), pointed["time"].values, np.zeros(5)
    place = np.arange(LONGEST_S + 1, time.size - LONGEST_S - 1, EVERY_S)
    if place.size < 2:
        return delays
    moved = moved_orbits(aligned)
    left = _rates_left(aligned, moved, place)
    tried = {w: functools.cache(lambda k, w=w: np.nanmean(left(w, k) ** 2)) for w in (0, 3, 4)}
    best = min(tried, key=lambda which: tried[which](_least(lag, tried[which])))  # the ranging if none is late
    delays[best] = _clear(lag, tried[best])
    first, second = (moved(k, np.arange(time.size), int(late)) for k, late in enumerate(delays[3:]))
    between = (second - first) / np.linalg.norm(second - first, axis=1, keepdims=True)
    routine = place[~in_windows(time[place], _spans(pointed), MARGIN_S)]
    for k, toward in enumerate((between, -between)):
        quaternion = aligned["quaternion"].values[k]
        known = routine[np.isfinite(quaternion[routine]).all(axis=1)]
        if known.size:
            x = frames.R_bi_from_quaternion(quaternion[known])[:, 0]
            angle = 1 - np.nanmean(np.einsum("na,nla->nl", x, toward[known[:, None] - lag]), axis=0)
            delays[1 + k] = _clear(lag, dict(zip(lag, angle, strict=True)).get)
    return delays


def moved_orbits(aligned: xr.Dataset):
    """Function (satellite, seconds (n,), s) -> inertial positions (n, 3) m there, were the tags of the orbit so late.

    An orbit in the frame of the Earth turns with it by what its tags are late. Beyond the record its ends stand.
    """
    time, position = aligned["time"].values, np.array(aligned["position_i"].values)
    fixed = aligned.attrs.get("orbit") == "GNV1B"
    R_ei = earth.R_ei(time) if fixed else np.zeros((0, 3, 3))
    position_e = np.matvec(R_ei, position) if fixed else position
    return lambda satellite, place, late: _moved(position[satellite], position_e[satellite], R_ei, place, late)


@njit(cache=True)
def _moved(position, position_e, R_ei, place, late):
    """Positions (m, 3) of the records (n, 3) at some places (m,), turned from that of the Earth where R_ei is given."""
    made, last = np.empty((place.size, 3)), len(position) - 1
    for m in range(place.size):
        here, then = min(max(place[m], 0), last), min(max(place[m] + late, 0), last)
        for i in range(3):
            made[m, i] = position[then, i]
            if late and len(R_ei):
                x, y, z = position_e[then, 0], position_e[then, 1], position_e[then, 2]
                made[m, i] = R_ei[here, 0, i] * x + R_ei[here, 1, i] * y + R_ei[here, 2, i] * z
    return made


def _rates_left(aligned, moved, place):
    """Function (stream, s) -> (n,) m s-1 left of the range rate by the orbits, were the tags of the stream so late."""
    read = np.interp(aligned["time"].values[place], aligned["time_kbr"].values, aligned["reading_range_rate"].values)

    def left(stream, late):
        of_all, *of_one = (late * (stream == k) for k in (0, 3, 4))
        epochs = (place + s - of_all for s in (-1, 0, 1))
        before, apart, after = (moved(1, at, of_one[1]) - moved(0, at, of_one[0]) for at in epochs)
        along = np.einsum("ni,ni->n", apart, after - before)
        return read - along / np.sqrt(4 * np.einsum("ni,ni->n", apart, apart))

    return left


def late_orbit(aligned: xr.Dataset, pointed: xr.Dataset, late: np.ndarray) -> dict | None:
    """What the tags of one orbit, off by `late_of_pair`, do to the range rate in routine pointing; None if none is off.

    {"late" s, "satellite" 0 or 1; time (n,) s; left (n,) m s-1, read less by the orbits as tagged; change (n,) of that
    by each second of delay}
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
    """Angle (n,) rad by which an axis of the body lies behind the flight in the plane of the orbit, and its rate there.

    By attitudes (n, 4) of one time against states (m, 6) of another; that against the flight counts as along it. Zero
    where the axis is not along the flight. Over the rate (n,) rad s-1 it is the time by which attitudes are late.
    """
    state = np.stack([np.interp(time, orbit_time, column) for column in state_i.T], axis=1)
    rate = np.linalg.norm(np.cross(state[:, :3], state[:, 3:]), axis=1) / np.sum(state[:, :3] ** 2, axis=1)
    above, _, along = np.matvec(frames.flight_frame(state), frames.R_bi_from_quaternion(quaternion)[:, axis]).T
    sign, parallel = np.sign(np.median(along)), abs(np.median(along)) > 0.5
    return np.arctan2(sign * above, sign * along) * parallel, rate


def _spans(pointed):
    """Begin and end (w, 2) s of the manoeuvres."""
    return np.stack([pointed["start"].values, pointed["stop"].values], axis=1)


def _least(lag, left):
    """Of some lags that at which a function, smooth over ten seconds, is least."""
    return min(lag[np.abs(lag - min(lag[::10], key=left)) <= 10], key=left)


def _clear(lag, left):
    """Lag that leaves least, 0 unless any that is further away leaves clearly more."""
    best = _least(lag, left)
    return best if CLEARLY * left(best) < left(_least(lag[np.abs(lag - best) > APART_S], left)) else 0
