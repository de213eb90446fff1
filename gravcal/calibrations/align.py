"""Level-1 records in order of time and on GPS time, marked where they are not usable. Shared by the calibrations."""

import numpy as np
import xarray as xr

from gravcal.errors import EstimationError, refuse
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
    order = timing.ordered(usable, [c[kept] for c in columns])
    index = kept[order.index]
    flag = (flagged[index] | order.conflicting).astype(np.uint8)
    counts = order.counts | {"undated": int((~dated).sum()), "marked": int(flag.sum())}
    values = np.stack([c[index] for c in columns], axis=1) if columns else np.zeros((index.size, 0))
    return usable.time[order.index], values, flag, counts


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
    limits = timing.Limits(clock_gap_limit_s, clock_gap_limit_s, 1e-6)
    onboard = timing.tim1b_clock(
        tim1b["obctime"].values,
        tim1b["rcvtime_intg"].values,
        1e-9 * tim1b["rcvtime_frac"].values,
        tim1b["qualflg"].values,
    )
    receiver = timing.clk1b_clock(
        clk1b["rcv_time"].values, clk1b["eps_time"].values, clk1b["eps_drift"].values, clk1b["qualflg"].values
    )
    received, _ = timing.converted(own_tags(observed), onboard, limits)
    gps, _ = timing.converted(received, receiver, limits)
    return gps


def orbit_i(orbit: xr.Dataset, spans: np.ndarray):
    """Epochs (n,) s, inertial positions (n, 3) m and velocities m s-1 of GNI1B or GNV1B in windows (w, 2) s."""
    orbit = near_windows(orbit, spans)
    time, values, flag, _ = sorted_samples(orbit, own_tags(orbit), STATE)
    usable = in_windows(time, spans, 0.0) & (flag == 0)
    states = orbit_states(time[usable], values[usable], orbit.attrs.get("product", ""))
    return time[usable], states["position_i"], states["velocity_i"]


def between(at: np.ndarray, time: np.ndarray, limit: float) -> np.ndarray:
    """True for each epoch (m,) on or between two ordered samples (n,) that are at most `limit` apart (s)."""
    index = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    inside = (at >= time[0]) & (at <= time[-1])
    return inside & (time[index] - time[index - 1] <= limit)


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
    lag, time, found = np.arange(-LONGEST_S, LONGEST_S + 1), pointed["time"].values, np.zeros(5)
    place = np.arange(LONGEST_S, time.size - LONGEST_S, EVERY_S)
    if place.size < 2:
        return found
    position = aligned["position_i"].values
    velocity = np.gradient(position, axis=1)
    read = np.interp(time[place], aligned["time_kbr"].values, aligned["reading_range_rate"].values)

    def left(first, second):
        apart = position[1, second] - position[0, first]
        rate = np.einsum("ni,ni->n", apart, velocity[1, second] - velocity[0, first])
        return np.nanmean((read - rate / np.linalg.norm(apart, axis=1)) ** 2)

    tried = {
        0: [left(place - k, place - k) for k in lag],
        3: [left(place + k, place) for k in lag],
        4: [left(place, place + k) for k in lag],
    }
    best = min(tried, key=lambda which: min(tried[which]))  # the ranging if none is late
    found[best] = _clear(lag, tried[best])
    at = [np.clip(np.arange(time.size) + int(k), 0, time.size - 1) for k in found[3:]]
    between = position[1, at[1]] - position[0, at[0]]
    between /= np.linalg.norm(between, axis=1, keepdims=True)
    spans = np.stack([pointed["start"].values, pointed["stop"].values], axis=1)
    routine = place[~in_windows(time[place], spans, MARGIN_S)]
    for k, toward in enumerate((between, -between)):
        quaternion = aligned["quaternion"].values[k]
        known = routine[np.isfinite(quaternion[routine]).all(axis=1)]
        if known.size:
            x = frames.R_bi_from_quaternion(quaternion[known])[:, 0]
            angle = 1 - np.nanmean(np.einsum("na,nla->nl", x, toward[known[:, None] - lag]), axis=0)
            found[1 + k] = _clear(lag, angle)
    return found


def _clear(lag, left):
    """Lag that leaves least, 0 unless any that is further away leaves clearly more."""
    best = lag[np.argmin(left)]
    return best if CLEARLY * np.min(left) < np.min(np.asarray(left)[np.abs(lag - best) > APART_S]) else 0


def refuse_late_orbits(late: np.ndarray, satellites: str) -> None:
    """Raise if the tags of one orbit are off, of `late_of_pair`: of such a pair nothing else can be said."""
    for letter, one in zip(satellites, late[3:], strict=True):
        if abs(one) > LATE_S:
            found, remedy = f"tags late by {one:.0f} s against ranging and the other", "Give an orbit of the same time."
            expected = f"at most {LATE_S:.0f} s, without which no cause can be looked for"
            refuse(f"orbit {letter}", found, expected, remedy, EstimationError, late=float(one))
