"""Design of the next session: the manoeuvres that tell most, from the information of all that may be flown."""

import json
import tempfile
from pathlib import Path

import numpy as np

from flows import calibration as calibrations
from flows import output
from flows.engine.remake import other_store
from gravcal import catalog
from gravcal.discovery import design
from gravcal.effects import effect
from gravcal.errors import refuse
from gravcal.store import configurations
from tasks import discovery
from tasks.stage import read

#: Limits of a design where the file of constraints says nothing, and what they are.
LIMITS = {
    "rods": (["x", "y", "z"], "rods that may be driven"),
    "latitude_deg": ([-85.0, 85.0], "south and north end of where manoeuvres may be"),
    "duration_s": (180.0, "length of a manoeuvre"),
    "period_s": (12.0, "of the square wave; detection looks for this one"),
    "current_ma": (110.0, "amplitude of the square wave"),
    "spacing_s": (1100.0, "shortest time between two starts; the quiet pieces on both sides need 1020"),
    "most": (99, "manoeuvres with one rod in one belt of latitude"),
    "probability": (0.9, "with which a pair of causes is to be told apart"),
}
FLIGHTS = 3  # of the library that a design is chosen by, with other orbits and times, and as many that it is judged by


def constraints(path=None):
    """Limits of a design {name: value}, those of a TOML file before the usual ones."""
    given = catalog.read_file(path)[1] if path else {}
    for name in given:
        if name not in LIMITS:
            refuse(path, f"the constraint {name!r}", f"one of {', '.join(LIMITS)}", "Correct the name.")
    return {name: given.get(name, usual) for name, (usual, _) in LIMITS.items()}


def designed(name, satellite, date, *, causes=(), minutes=None, limits=None, verify=0, out=None, say=lambda _: None):
    """Document with the best session of a calibration for a satellite and day, beside the published one.

    Parameters
    ----------
    name : calibration; satellite : letter; date : "2026-03-01"
    causes : slugs that are to be told apart, each from each
    minutes : of manoeuvres, None for those of the published session
    limits : of `constraints`
    verify : flights of the design that are simulated and calibrated
    out : folder for the plan and the document, or None
    say : is told what is being done
    """
    one, limits = calibrations.load(name), limits or constraints()
    if one.library is None:
        able = [n for n in calibrations.known() if calibrations.load(n).library]
        refuse(f"design {name}", "no manoeuvres that it can choose from", " or ".join(able), "Name one of these.")
    for slug in causes:
        effect(slug)  # raises where there is none
    session = catalog.design(one.design)
    usual = sum(m.count * m.duration_s for m in session.manoeuvres) / 60
    count = round((minutes or usual) * 60 / limits["duration_s"])
    if count < 1:
        refuse("--budget", f"{minutes} minutes", f"at least one manoeuvre of {limits['duration_s']} s", "Give more.")
    tables = [table | {"count": 1} for table in one.library(limits)]
    pairs = [(a, b) for i, a in enumerate(causes) for b in causes[i + 1 :]]
    chosen = configurations.chosen(name, {})
    tied = chosen.for_stage("discovery")["tie_chi2"]
    with tempfile.TemporaryDirectory(prefix="gravcal-design-") as folder, other_store(str(Path(folder) / "store")):
        place = Place(one, Path(folder), satellite, date, limits, chosen)
        flights, published = [], []
        for seed in range(1, 2 * FLIGHTS + 1):
            say(f"flight {seed} of {2 * FLIGHTS}: {len(tables)} manoeuvres to choose from")
            flights.append(place.flown(f"library-{seed}", tables, seed, causes))
            if seed > FLIGHTS:
                published.append(place.flown(f"session-{seed}", one.design, seed, causes))
        allowed = np.full(len(tables), int(limits["most"]))
        wanted = design.needed(limits["probability"], tied)
        counts = design.chosen(design.pooled(flights[:FLIGHTS]), count, allowed, pairs, wanted)
        found = design.judged(design.pooled(flights[FLIGHTS:]), counts, pairs)
        before = design.judged(design.pooled(published), np.array([m.count for m in session.manoeuvres]), pairs)
        plan = [t | {"count": int(n)} for t, n in zip(tables, counts, strict=True) if n]
        document = {
            "calibration": name,
            "satellite": satellite,
            "date": date,
            "minutes": count * limits["duration_s"] / 60,
            "constraints": limits,
            "manoeuvres": plan,
            "design": _judged(flights[-1], found, tied),
            "published": _judged(flights[-1], before, tied),
            "published_minutes": usual,
        }
        if verify:
            document["verified"] = place.verified(plan, verify, say)
    if out:
        Path(out).mkdir(parents=True, exist_ok=True)
        (Path(out) / "plan.toml").write_text(plan_text(name, plan, f"gravcal design, {satellite} {date}"))
        output.write_json(document, Path(out) / "design.json")
    return document


def plan_text(calibration, plan, source):
    """TOML text of a plan, in the format of catalog/designs."""
    lines = [f'calibration = "{calibration}"', f'source = "{source}"']
    for table in plan:
        lines += ["", "[[manoeuvre]]", *(f"{key} = {json.dumps(value)}" for key, value in table.items())]
    return "\n".join(lines) + "\n"


class Place:
    """Where sessions are flown: a calibration, a folder, and what all flights share."""

    def __init__(self, one, folder, satellite, date, limits, chosen):
        self.one, self.folder, self.satellite, self.date = one, folder, satellite, date
        self.limits, self.chosen = limits, chosen

    def flight(self, label, plan, seed):
        """Source and truth of a simulated flight of a plan: tables, or the name of a design."""
        files_, named = self.folder / label, plan
        if not isinstance(plan, str):
            named = self.folder / f"{label}.toml"
            named.write_text(plan_text(self.one.name, plan, label))
        settings = {"design": str(named), "satellite": self.satellite, "date": self.date}
        settings |= {"manoeuvre_spacing_s": self.limits["spacing_s"], "manoeuvre_period_s": self.limits["period_s"]}
        truth = self.one.simulate(files_, seed=seed, settings=settings)
        return self.one.source(event=None, data=files_, satellite=self.satellite, date=self.date), truth

    def flown(self, label, plan, seed, causes):
        """What each manoeuvre of a simulated flight tells."""
        source, truth = self.flight(label, plan, seed)
        looked = self.one.discovery
        products = looked.baseline(source, self.chosen)
        datasets = {name: read(ref) for name, ref in products.items()}
        settings = looked.settings(source, self.chosen) | looked.chosen_for(self.chosen)[0]
        observed = discovery.observations_of(datasets.values(), looked.observations, datasets, settings)
        times = [(m["start"], m["stop"]) for m in truth["manoeuvres"]]
        return design.flown(
            observed, self.one.information(datasets), times, [m["item"] for m in truth["manoeuvres"]], causes
        )

    def verified(self, plan, flights, say):
        """Errors that simulated flights of a plan achieve: mean sigma, rms of the error, of each parameter."""
        sigma, error, true = [], [], []
        for seed in range(101, 101 + flights):
            say(f"check {seed - 100} of {flights}")
            source, truth = self.flight(f"check-{seed}", plan, seed)
            values = list(self.one.foretold(self.one.document(self.one.flow(source, self.chosen))))
            sigma.append([v.sigma for v in values])
            error.append([v.value for v in values])
            true.append(self.one.truth(truth))
        sigma, error = np.array(sigma, dtype=float), np.array(error, dtype=float) - np.array(true)
        return {
            "flights": flights,
            "sigma": np.sqrt(np.nanmean(sigma**2, axis=0)).tolist(),
            "error_rms": np.sqrt(np.nanmean(error**2, axis=0)).tolist(),
        }


def _judged(flight, found, tied):
    """Errors and odds of a design."""
    spread, apart = found
    sigma = dict(zip(flight.parameters, np.sqrt(np.diag(spread)).tolist(), strict=True))
    odds = [{"causes": list(pair), "chi2": float(c), "odds": design.odds(c, tied)} for pair, c in apart.items()]
    return {"sigma": sigma, "unit": flight.unit, "trace": float(np.trace(spread)), "separated": odds}
