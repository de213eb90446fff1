"""The stages of com_offset driven in memory, with the settings of the catalogue, for tests of many events."""

import numpy as np
import xarray as xr

from gravcal import catalog
from gravcal.calibrations.com_offset.align import align, detect
from gravcal.calibrations.com_offset.attitude import attitude
from gravcal.calibrations.com_offset.estimate import combine, noise, published_solve, quiet, solve
from gravcal.calibrations.com_offset.model import VARIANTS, angular_acceleration, equations, field
from gravcal.simulation.com_offset import simulate

DAY = 633787200.0  # s, a midnight
SATELLITE = catalog.satellite("C").settings()
FRACTIONS = {"ACC1A": "rcvtime_frac", "MAG1B": "time_frac"}
WHOLE = {"ACC1A": "rcvtime_intg", "MAG1B": "time_intg", "CLK1B": "rcv_time", "TIM1B": "obctime"}
ORDER = ("ACC1A", "SCA1B", "MAG1B", "GNI1B", "TIM1B", "CLK1B")


def event(seed, effects=None, **settings):
    """Ingested records and truth of a simulated day with effects {slug: {parameter: value}} and settings."""
    chosen = catalog.parameters("simulate_com_offset").with_settings(settings)
    columns, truth = simulate(SATELLITE, chosen, DAY, seed, effects or {})
    return {name: ingested(name, columns[name]) for name in ORDER}, truth


def ingested(product, columns):
    """Dataset as the reader returns it, from simulated columns."""
    whole = np.asarray(columns[WHOLE.get(product, "gps_time")]).astype(np.int64)
    fraction = 1e-6 * np.asarray(columns[FRACTIONS[product]]) if product in FRACTIONS else np.zeros(whole.size)
    values = dict(columns) | {"time_second": whole, "time_fraction": fraction, "time_tag": whole + fraction}
    values |= {"flag": np.zeros(whole.size, np.uint8), "qualflg": np.zeros(whole.size, np.uint8)}
    if product == "TIM1B":
        values |= {"receiver_second": columns["rcvtime_intg"], "receiver_fraction": 1e-9 * columns["rcvtime_frac"]}
    data = {name: ("record", value) for name, value in values.items()}
    if product == "MAG1B":
        current = np.stack([columns[f"torque{i}A"] + columns[f"torque{i}B"] for i in (1, 2, 3)], axis=1)
        data["current_b"] = (("record", "axis"), current)
    return xr.Dataset(data, attrs={"product": product, "satellite": "C", "file": product})


def smoothed(observed, satellite=SATELLITE, **settings):
    """Products up to the attitude, by name, and the chosen parameters."""
    chosen = catalog.parameters("com_offset").with_settings(settings)
    found = detect(observed["MAG1B"], **chosen.for_stage("detect"))
    aligned = align(found, *(observed[name] for name in ORDER), **chosen.for_stage("align"))
    checked = field(aligned, **chosen.for_stage("field"))
    torquers = {name: satellite[name] for name in ("inertia", "dipole_per_current")}
    followed = attitude(aligned, checked, **chosen.for_stage("attitude"), **torquers)
    return {"detect": found, "align": aligned, "field": checked, "attitude": followed}, chosen


def chain(observed, satellite=SATELLITE, **settings):
    """All products of an event, by stage name; solve and angular_acceleration by variant."""
    made, chosen = smoothed(observed, satellite, **settings)
    made = solved(made, chosen, VARIANTS, satellite)
    made["combine"] = combine(*made["solve"].values(), **chosen.for_stage("combine"))
    return made


def solved(made, chosen, variants, satellite=SATELLITE):
    """Products up to the attitude, with noise, and with angular acceleration and solution of some variants."""
    names = ("inertia", "inertia_sigma", "dipole_per_current", "dipole_per_current_sigma")
    with_sigma = {name: satellite[name] for name in names}
    measured = noise(quiet(made["align"], **chosen.for_stage("quiet")), **chosen.for_stage("noise"))
    made = made | {"noise": measured, "angular_acceleration": {}, "solve": {}}
    for variant in variants:
        stage = chosen.for_stage("angular_acceleration") | with_sigma | {"variant": variant}
        angular = angular_acceleration(made["attitude"], made["align"], **stage)
        made["angular_acceleration"][variant] = angular
        made["solve"][variant] = solution(made["align"], made["attitude"], angular, measured, chosen)
    return made


def solution(aligned, smoothed, angular, measured, chosen):
    """Offset of every manoeuvre for one angular acceleration, with the chosen parameters."""
    if chosen.method == "published":
        return published_solve(aligned, smoothed, angular)
    resampled = equations(aligned, smoothed, angular, **chosen.for_stage("equations"))
    return solve(resampled, measured, **chosen.for_stage("solve"))


def errors(combined, truth):
    """Error over sigma of every variant and axis (4, 3), and the error in metres."""
    wrong = combined["offset"].values - 1e-6 * np.array(truth["offset_um"])
    sigma = np.sqrt(np.diagonal(combined["covariance"].values, axis1=1, axis2=2))
    return wrong / sigma, wrong
