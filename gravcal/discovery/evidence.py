"""Evidence of an event for a search over many: Gram of its whitened columns, quantities that causes may follow.

Kept apart from the search, so that a change of the search does not make the evidence again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from gravcal.discovery import attribution
from gravcal.discovery.problem import less_calibration, prepare
from gravcal.effects import effect
from gravcal.errors import refuse
from gravcal.estimation.moving import YEAR_S
from gravcal.estimation.quantities import result_of, tabled
from gravcal.estimation.records import Observations, slug_of

#: Quantities that causes may follow from event to event, where every event has them.
QUANTITIES = ("year", "beta_deg", "latitude_deg", "fuel_kg", "fuel_difference_kg", "temperature_c")
THERMOMETERS = ("TSU_Y_plus", "TSU_Y_minus", "TSU_Z_plus", "TSU_Z_minus")


@dataclass(frozen=True)
class Cause:
    """A cause of the catalogue with all its parameters."""

    slug: str  #: of the catalogue
    form: str  #: of the candidate that its columns are of
    names: Sequence[str]  #: (q,)
    units: Sequence[str]  #: (q,)
    prior: np.ndarray  #: (q,) plausible sizes
    shared: float = 0.0  #: largest error of its value that all events share


@dataclass(frozen=True)
class Event:
    """Gram matrix of one event and quantities that causes may follow."""

    name: str
    time: float  #: s, GPS, middle of its manoeuvres
    start: np.ndarray  #: (p,) SI, parameters of the calibration that the observed rows were formed with
    gram: np.ndarray  #: (1 + p + q, ...) products of the observed rows, parameters and causes
    size: np.ndarray  #: (1 + p + q,) norm of the columns, the scale of what a fit leaves of them
    causes: Sequence[Cause]
    measured: Mapping[str, float] = field(default_factory=dict)  #: quantities of the event that a cause may follow
    parameters: Sequence[str] = ()  #: (p,) of the calibration
    unit: str = ""  #: in which these are reported
    scale: Sequence[float] = ()  #: (p,) factor from SI to that unit
    common: Sequence[float] = ()  #: (p,) SI, error that all events share and that no event can detect


def evidence(observed: Observations | None, *housekeeping: xr.Dataset) -> xr.Dataset:
    """Dataset of an event's Gram matrix: observed rows, parameters, listed causes with all parameters, every form.

    `housekeeping` is MAS1B and AHK1B of the event, where available: causes may follow fuel and temperature. An
    event whose tags are minutes off has an empty matrix.
    """
    if observed is None or observed.shifted:
        return tabled(xr.Dataset({"gram": (("column", "other"), np.zeros((0, 0)))}), {})
    listed = [one for one in observed.candidates if one.listed and slug_of(one.cause) == one.cause]
    listed = [replace(one, prior=_prior(one)) for one in listed if not one.form.endswith("alone")]
    listed = [one for one in listed if len(one.prior) == len(one.names)]
    blocks, explained = less_calibration(observed.blocks)
    problem, count = prepare(blocks, listed), len(observed.parameters)
    nuisance = np.arange(1 + count, problem.shared.stop)
    kept = np.setdiff1d(np.arange(problem.total.shape[0]), nuisance)
    data = [one.channel[0] != "prior" for one in problem.blocks]  # known before: once, not once an event
    gram = attribution.projected(problem.gram[data].sum(axis=0), nuisance)[np.ix_(kept, kept)]
    time = np.concatenate([one.time for one in observed.blocks if one.channel[0] not in ("timing", "prior")])
    measured = {"year": float(np.median(time)) / YEAR_S} | observed.circumstances
    sized = [(one, [*map(float, one.prior)], observed.shared.get(one.cause, 0.0)) for one in listed]
    numbers = {
        "time": float(np.median(time)),
        "parameters": list(observed.parameters),
        "unit": observed.unit,
        "scale": np.broadcast_to(observed.scale, count).tolist(),
        "start": (observed.start + explained[:count]).tolist(),
        "measured": measured | fuel(housekeeping, np.median(time)) | temperature(housekeeping, time.min(), time.max()),
        "common": np.broadcast_to(observed.common, count).tolist(),
        "causes": [[one.cause, one.form, one.names, one.units, *sizes] for one, *sizes in sized],
    }
    about = {"gram": ("column other", "products of whitened columns"), "size": ("column", "norm of the columns")}
    values = {"gram": gram, "size": problem.size[kept]}
    variables = {n: (d.split(), values[n], {"units": "1", "long_name": label}) for n, (d, label) in about.items()}
    return tabled(xr.Dataset(variables), numbers)


def _prior(candidate):
    """Plausible sizes (q,) of a candidate: its own, or those of the catalogue where a search of one event has none."""
    sigmas = {} if candidate.prior else {p.name: p.prior_sigma for p in effect(candidate.cause).parameters}
    return candidate.prior or [sigmas[name] for name in candidate.names if name in sigmas]


def fuel(masses: Sequence[xr.Dataset], time: float) -> dict[str, float]:
    """Gas kg of both tanks, and of the first less the second, of MAS1B at a time GPS s; {} where there is none."""
    for product in masses:
        tanks = [product[name].values for name in ("gas_mass_tnk1", "gas_mass_tnk2") if name in product]
        valid = np.all(np.isfinite(tanks), axis=0) if len(tanks) == 2 else np.zeros(1, dtype=bool)
        if valid.any():
            first, second = (float(np.interp(time, product["time_tag"].values[valid], tank[valid])) for tank in tanks)
            return {"fuel_kg": first + second, "fuel_difference_kg": first - second}
    return {}


def temperature(housekeeping: Sequence[xr.Dataset], begin: float, end: float) -> dict[str, float]:
    """Sensor unit temperature deg C, mean over thermometers of AHK1B of their medians; {} if one has no value."""
    for product in housekeeping:
        if set(THERMOMETERS) <= set(product):
            inside = (product["time_tag"].values >= begin) & (product["time_tag"].values <= end)
            readings = [product[name].values[inside] for name in THERMOMETERS]
            readings = [values[np.isfinite(values)] for values in readings]
            if all(values.size for values in readings):
                return {"temperature_c": float(np.mean([np.median(values) for values in readings]))}
    return {}


def events_of(products: Sequence[xr.Dataset], names: Sequence[str]) -> list[Event]:
    """Events of products in order of time, with the causes that all of them have; none without manoeuvre."""
    read = [(result_of(one), one, name) for one, name in zip(products, names, strict=True)]
    read = sorted((row for row in read if row[0]), key=lambda row: row[0]["time"])
    if len(read) < 2:
        refuse("joint search", f"{len(read)} events with manoeuvres", "two at least", "Name more events.")
    shared = set.intersection(*({(slug, form, *names) for slug, form, names, *_ in one["causes"]} for one, *_ in read))
    events = []
    for numbers, product, name in read:
        place, index, causes = 1 + len(numbers["start"]), [*range(1 + len(numbers["start"]))], []
        for slug, form, names, units, prior, shared_error in numbers["causes"]:
            if (slug, form, *names) in shared:
                index += range(place, place + len(names))
                causes.append(Cause(slug, form, names, units, np.array(prior), shared_error))
            place += len(names)
        order = np.array(index)
        start, gram = np.array(numbers["start"]), product["gram"].values[np.ix_(order, order)]
        size = product["size"].values[order]
        of_result = (numbers[word] for word in ("measured", "parameters", "unit", "scale", "common"))
        events.append(Event(name, numbers["time"], start, gram, size, causes, *of_result))
    first = events[0].causes
    if any([(c.slug, c.form) for c in one.causes] != [(c.slug, c.form) for c in first] for one in events):
        refuse("joint search", "causes in different orders", "one order", "Make the evidence of all events again.")
    return events
