"""The calibrated field of others beside ours: difference by axis, and what their field says of the instrument."""

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from gravcal.calibrations.align import QUATERNION, between, usable
from gravcal.calibrations.magnetometer import estimate, model
from gravcal.calibrations.magnetometer.model import SCHEMAS
from gravcal.calibrations.schemas import build
from gravcal.errors import refuse
from gravcal.physics import earth, frames

GAP_S = 2.5  # longest between two of their records; the field bends by less than 0.04 nT in it
PLACE_M = 10e3  # farthest from the orbit: a second is 7.6 km, GPS time taken for UTC 137 km


def compare(
    aligned: xr.Dataset, found: xr.Dataset, camera: xr.Dataset, orbit: xr.Dataset, theirs: xr.Dataset, **settings
) -> xr.Dataset:
    """Their calibrated field less ours at our records, and parameters with their field as the reference.

    Parameters
    ----------
    aligned, found : Dataset, "magnetometer.align" and "magnetometer.estimate"
    camera, orbit : Dataset, "ingest" of SCA1B, GNV1B
    theirs : Dataset, "magnetometer.theirs"
    settings : of `estimate`

    Notes
    -----
    Ours is the reading less what the instrument adds, with the uniform external field left in. Theirs is turned from
    north, east and centre into the body by our orbit and attitude; less the reference field there, it is interpolated.
    """
    sca_time, quaternion = usable(camera, QUATERNION)
    orbit_time, state = usable(orbit, tuple(f"{a}{k}" for k in ("pos", "vel") for a in "xyz"))
    time, field = theirs["time"].values, model.field(aligned)
    inside = (time >= max(sca_time[0], orbit_time[0])) & (time <= min(sca_time[-1], orbit_time[-1]))
    time, position_e, field_n = time[inside], *(theirs[n].values[inside] for n in ("position_e", "field_n"))
    matched = between(field.time, time, GAP_S) if time.size > 1 else np.zeros(field.time.size, dtype=bool)
    if matched.sum() < model.LEAST:
        expected = f"at least {model.LEAST} records of the same minutes"
        refuse("calibrated field of others", f"{matched.sum()}", expected, "Give the file of the day.")
    position_i, _ = earth.state_to_inertial(orbit_time, state[:, :3], state[:, 3:])
    R_ei = earth.R_ei(time)
    ours_e = np.matvec(R_ei, CubicSpline(orbit_time, position_i)(time))
    apart = float(np.median(np.linalg.norm(position_e - ours_e, axis=1)))
    if apart > PLACE_M:
        remedy = "Their tags are of another time scale, or the file is of another satellite: it is not compared."
        refuse("calibrated field of others", f"places {apart / 1e3:.0f} km from the orbit", "the same orbit", remedy)
    field_e = np.matvec(earth.R_en_from_position(ours_e, geocentric_down=True), field_n)
    quaternion = frames.continuous(quaternion)
    R_bi = frames.R_bi_from_quaternion(frames.interpolate(sca_time, quaternion, time))
    theirs_b = np.matvec(R_bi, np.matvec(np.swapaxes(R_ei, 1, 2), field_e))
    reference = model.body_field(orbit_time, state[:, :3], sca_time, quaternion, settings.pop("igrf_generation"))
    rest = theirs_b - reference(time)[0]
    rest = np.stack([np.interp(field.time, time, one) for one in rest.T], axis=1)[matched]
    known = dict(zip(found["parameter"].values.tolist(), np.nan_to_num(found["value"].values), strict=True))
    external = known.get("external_field", 0.0) * field.axis_b
    ours = (found["residual_b"].values - found["fitted_b"].values + external)[matched]
    same = aligned.isel(time=np.flatnonzero(matched))
    same = same.assign(model_b=same["model_b"] + rest)
    held = tuple({*settings.pop("held"), "external_field"})  # theirs holds it
    implied = estimate.estimate(same, held=held, **settings)
    names = implied["parameter"].values.tolist()
    our = found[["value", "sigma"]].sel(parameter=names)
    values = {name: implied[name].values for name in ("parameter", "unit", "value", "sigma")}
    values |= {"own_value": our["value"].values, "own_sigma": our["sigma"].values}
    values |= {"time": field.time[matched], "difference_b": rest - ours, "theirs_b": rest, "apart": apart}
    values["flagged"] = theirs["flagged"].values
    return build(SCHEMAS["beside"], values)
