"""Design of the next session: of all manoeuvres that may be flown, those with most information on the result.

Where manoeuvres share only the result their information adds, and their numbers are chosen (`library`). Elsewhere
whole sessions are simulated, and that with the least errors is chosen (`sessions`).
"""

import itertools
import re
import shutil
import tempfile
from datetime import datetime
from pathlib import Path

import numpy as np

from flows import calibration as calibrations
from flows import discover, output
from flows.engine import other_store
from gravcal import catalog, toml
from gravcal.browse import store_index, timeline
from gravcal.discovery import design
from gravcal.effects import effect
from gravcal.errors import GravcalError, refuse
from gravcal.store import configurations, schemas, store
from gravcal.store.product import MEASURED
from tasks import discovery
from tasks.stage import read

FLIGHTS = 3  # simulated flights, of different orbits and times, that numbers of manoeuvres are chosen by
JUDGES = range(FLIGHTS + 1, 2 * FLIGHTS + 1)  # seeds of as many independent flights that a design is judged by
#: A session whose errors differ from flight to flight is judged by more: relative error of mean sigma, most flights.
KNOWN, MOST = 0.05, 24
#: Share of drawn orbits that have to have room for a design.
ROOM = 0.9


def constraints(name, path=None):
    """{limit: value} of the designs of a calibration: those of a TOML file (path), else of the catalogue."""
    file, limits = f"design_{name}", catalog.read_file(path)[1] if path else {}
    known = catalog.parameters(file).with_settings(limits).entries if file in catalog.names("parameters") else {}
    return {n: list(e.value) if isinstance(e.value, tuple) else e.value for n, e in known.items()}


def designed(name, satellite, date, *, causes=(), minutes=None, limits=None, verify=0, out=None, say=lambda _: None):
    """Document that compares the best session of a calibration, satellite and day "2026-03-01" with the published one.

    Causes are slugs, each pair of which is to be separable; minutes the time of manoeuvres, None for as much as the
    published session has; limits those of `constraints`; ``verify`` the number of flights, simulated and calibrated,
    that verify the design. Plan and document go into the folder `out`; `say` prints a line of progress.
    """
    one, limits = calibrations.load(name), limits or constraints(name)
    able = {n: r for n in calibrations.known() if (r := calibrations.load(n)).planning}
    if name not in able:
        refuse(f"design {name}", "no manoeuvres that it can choose from", " or ".join(able), "Name one of these.")
    for slug in causes:
        effect(slug)  # raises where there is none
    usual = sum(m.count * m.duration_s for m in catalog.design(one.design).manoeuvres) / 60
    noise = noise_of(one, satellite, configurations.chosen(name, {}))
    with tempfile.TemporaryDirectory(prefix="gravcal-design-") as folder, other_store(str(Path(folder) / "store")):
        about = one, Path(folder), satellite, date
        place = Place(*about, limits, say, noise["settings"])
        if hasattr(one.planning, "library"):
            periods = ({"period_s": period} for period in np.atleast_1d(limits["period_s"]).tolist())
            options = [Place(*about, limits | one, say, noise["settings"]) for one in periods]
            designs = [(*option.of_library(minutes or usual, causes), option) for option in options]
            _, plan, new, place = min(designs, key=lambda one: one[0])
            old = place.published(causes)
        else:
            plan, new, old = place.best(minutes or usual, causes)
        head = {"schema_version": schemas.VERSION, "status": "delivered", "origin": "simulated"}  # of every document
        document = head | {
            "calibration": name,
            "satellite": satellite,
            "date": date,
            "minutes": sum(table["count"] * table["duration_s"] for table in plan) / 60,
            "constraints": limits,
            "noise": noise,
            "manoeuvres": plan,
            "design": new,
            "published": old,
            "published_minutes": usual,
        }
        if verify:
            document["verified"] = place.verified(plan, verify, causes)
    if out:
        Path(out).mkdir(parents=True, exist_ok=True)
        (Path(out) / "plan.toml").write_text(
            plan_text(name, plan, f"gravcal design, {satellite} {date}, noise of {noise['of']}")
        )
        output.write_json(document, Path(out) / "design.json")
    return document


def noise_of(one, satellite, chosen):
    """{"of": event, "settings": {setting of the simulation: value}}: noise of a satellite's last event in the store.

    Measured events come before simulated ones; where no event has quiet data settings are {}, "of" "the catalogue".
    """
    events, letters = [], one.pairs.get(satellite, satellite)
    for link, folder in store.links(f"*/{one.noise[0]}") if one.noise else ():
        event = link.parent.name
        if set(timeline.letters_of(event)) & set(letters):
            origin = store_index.origin(folder / "product.nc")
            events.append((origin == MEASURED, re.search(r"\d{4}-.*|$", event).group(), event, origin))
    simulated = catalog.parameters(f"simulate_{one.name}")
    for *_, event, origin in sorted(events, reverse=True):
        records = [store.newest_record(event, stage) for stage in one.noise]
        settings = all(records) and one.planning.measured_noise(
            simulated, chosen, *(read(store.find(r["key"])) for r in records)
        )
        if settings:
            return {"of": f"{event} ({origin})", "settings": settings}
    return {"of": "the catalogue", "settings": {}}


def plan_text(calibration, plan, source):
    """TOML text of a plan (list of tables, one a kind of manoeuvre), in the format of catalog/designs."""
    return toml.text({"calibration": calibration, "source": source, "manoeuvre": plan})


def period_of(plan):
    """Period s of the manoeuvres of a plan, tables or the name of a design."""
    return catalog.design(plan).manoeuvres[0].period_s if isinstance(plan, str) else plan[0]["period_s"]


class Place:
    """Simulated flights of one calibration, satellite and day: folder of their files, limits, noise settings."""

    def __init__(self, one, folder, satellite, date, limits, say, noise=None):  # one: Calibration
        self.one, self.folder, self.satellite, self.date = one, folder, satellite, date
        self.limits, self.say, self.noise = limits, say, noise or {}

    def chosen(self, plan):
        """Parameters of the calibration, with the period s of a plan if it has a setting "period_s"."""
        usual = configurations.chosen(self.one.name, {})
        return usual.with_settings({"period_s": period_of(plan)} if "period_s" in usual.entries else {})

    def published(self, causes):
        """`judged` of the published session, with the orbits and times (seeds `JUDGES`) that a design is judged by."""
        flights = [self.flown(f"session-{seed}", self.one.design, seed, causes) for seed in JUDGES]
        counts = np.array([m.count for m in catalog.design(self.one.design).manoeuvres])
        return self.judged(flights, counts, causes)

    def judged(self, flights, counts, causes):
        """{"sigma", "unit" by parameter, "trace", "separated": `_odds`} of a design, counts (n,) of manoeuvres."""
        spread, apart = design.judged(design.pooled(flights), counts, list(itertools.combinations(causes, 2)))
        sigma = dict(zip(flights[-1].parameters, np.sqrt(np.diag(spread)).tolist(), strict=True))
        unit = dict.fromkeys(sigma, flights[-1].unit)
        return {"sigma": sigma, "unit": unit, "trace": float(np.trace(spread)), "separated": _odds(apart, self.tied)}

    def loss(self, judged):
        """Loss of a design: log of the trace of its covariance, plus a penalty for pairs of causes not separated."""
        wanted = design.needed(self.limits["probability"], self.tied)
        apart = {tuple(row["causes"]): row["chi2"] for row in judged["separated"]}
        return np.log(judged["trace"]) + design.short(apart, wanted)

    def of_library(self, minutes, causes):
        """(loss, plan, `judged` by the seeds `JUDGES`) of the best manoeuvres of a library, minutes in all."""
        limits = self.limits
        count = int(minutes * 60 / limits["duration_s"] + 1e-9)  # the published minutes are a quotient
        if count < 1:
            expected = f"at least one manoeuvre of {limits['duration_s']} s"
            refuse("--budget", f"{minutes} minutes", expected, "Give more.")
        tables = [table | {"count": 1} for table in self.one.planning.library(limits, causes)]
        pairs, tied = list(itertools.combinations(causes, 2)), self.tied
        flights = []
        for seed in (*range(1, 1 + FLIGHTS), *JUDGES):
            self.say(f"flight {seed} of {JUDGES[-1]}: {len(tables)} manoeuvres to choose from")
            flights.append(self.flown(f"library-{limits['period_s']}-{seed}", tables, seed, causes))
        most, wanted = np.full(len(tables), int(limits["most"])), design.needed(limits["probability"], tied)
        day = (datetime.fromisoformat(self.date) - calibrations.EPOCH).total_seconds()
        parameters = catalog.parameters(f"simulate_{self.one.name}").with_settings(self.settings("library", tables))
        share = self.one.planning.room(catalog.satellite(self.satellite).settings(), parameters, day)
        counts = design.chosen(design.pooled(flights[:FLIGHTS]), count, most, pairs, wanted, lambda n: share(n) >= ROOM)
        plan = [t | {"count": int(n)} for t, n in zip(tables, counts, strict=True) if n]
        chosen_by, verdict = (self.judged(some, counts, causes) for some in (flights[:FLIGHTS], flights[FLIGHTS:]))
        return self.loss(chosen_by), plan, verdict

    def best(self, minutes, causes):
        """(plan of the session with the least errors, its summary, that of the published one), keys as of `judged`."""
        judging_seeds, named = range(FLIGHTS + 1, FLIGHTS + 1 + MOST), set(self.limits["parameters"])
        old, old_apart = self.errors(self.one.design, judging_seeds, causes, known=named)
        plans, names = self.one.planning.sessions(self.limits, minutes * 60), named or set(old)
        if not names <= set(old):
            refuse("parameters", ", ".join(names), f"of {', '.join(old)}", "Correct the constraint.")
        size = {name: sigma for name, (sigma, *_) in old.items() if name in names and sigma}

        def loss(errors, size):  # sum of squared errors over sizes, of the values in size
            return sum(((errors[name][0] or np.inf) / size[name]) ** 2 for name in size)

        tried, wanted = [], design.needed(self.limits["probability"], self.tied)
        for number, plan in enumerate(plans, start=1):
            self.say(f"session {number} of {len(plans)}")
            try:
                tried.append((plan, *self.errors(plan, (1,), causes)))
            except GravcalError as error:  # such as one in which nothing is detected
                self.say(f"left out: {error}")
        least = {name: min((e[name][0] for _, e, _ in tried if e[name][0]), default=None) for name in names - set(size)}
        sizes = size | {name: sigma for name, sigma in least.items() if sigma}  # the published one does not say these
        losses = [np.log(loss(errors, sizes) or np.inf) + design.short(apart, wanted) for _, errors, apart in tried]
        if named - set(sizes) or not min(losses, default=np.inf) < np.inf:
            shortfall = f"{len(plans)} sessions of {minutes} minutes, none of which tells all"
            refuse(f"design {self.one.name}", shortfall, "one that does", "Give more time or loosen a constraint.")
        plan = tried[int(np.argmin(losses))][0]
        new, new_apart = self.errors(plan, judging_seeds, causes, known=named)
        summary = lambda one, apart: {  # noqa: E731
            "sigma": {name: sigma for name, (sigma, *_) in one.items()},
            "unit": {name: unit for name, (*_, unit) in one.items()},
            "trace": loss(one, size),
            "separated": _odds(apart, self.tied),
        }
        return plan, summary(new, new_apart), summary(old, old_apart)

    def errors(self, plan, seeds, causes=(), known=None):
        """({value: (rms sigma, rms error, unit)}, {pair of causes: mean chi-square}) of simulated flights, one a seed.

        (None, None): not determined. Chi-square: `design.apart`, expected, of the first `FLIGHTS` flights. Flights end
        once the sigma of the values in `known` (an empty one: of all) is settled; None flies every seed.
        """
        rows, chi2 = [], []
        for seed in seeds:
            source, truth = self.flight(f"flight-{seed}", plan, seed)
            values = list(self.one.foretold(self.one.document(self.one.flow(source, self.chosen(plan)))))
            if causes and len(chi2) < FLIGHTS:
                chi2.append(design.apart(self.observed(source, plan)[0], causes))
            shutil.rmtree(self.folder / f"flight-{seed}")
            if not values:
                refuse(f"flight {seed}", "no manoeuvre", "those of the plan", "Loosen a constraint.")
            rows.append(list(zip(values, self.one.truth(truth), strict=True)))
            if known is not None and len(rows) >= FLIGHTS and _settled(rows, known):
                break
        means = {}
        for column in zip(*rows, strict=True):
            pairs = [(v.sigma, v.value - true) for v, true in column if v.sigma is not None]
            mean = np.sqrt(np.mean(np.square(pairs), axis=0)).tolist() if len(pairs) == len(rows) else (None, None)
            means[column[0][0].label] = *mean, column[0][0].unit
        return means, {pair: float(np.mean([one[pair] for one in chi2])) for pair in itertools.combinations(causes, 2)}

    @property
    def tied(self):
        """Chi-square difference (float, a setting) below which two causes are tied."""
        return configurations.chosen(self.one.name, {}).for_stage("discovery")["tie_chi2"]

    def settings(self, label, plan, **more):
        """{setting: value} to simulate a plan (tables, or name of a design); tables go into the file ``label``.toml."""
        named = plan
        if not isinstance(plan, str):
            named = self.folder / f"{label}.toml"
            named.write_text(plan_text(self.one.name, plan, label))
        known = catalog.parameters(f"simulate_{self.one.name}").entries
        settings = {"satellite": self.satellite, "satellites": self.satellite, "quiet_s": self.limits.get("quiet_s")}
        settings |= {f"manoeuvre_{limit}": value for limit, value in self.limits.items()} | self.noise | more
        settings["manoeuvre_period_s"] = period_of(plan)
        settings = {name: value for name, value in settings.items() if name in known and value is not None}
        return settings | {"design": str(named), "date": self.date}

    def flight(self, label, plan, seed, effects=None, **more):
        """(Source, truth dict) of a simulated flight of a plan; a published one (str) may be at any time of the day."""
        files_, more = self.folder / label, more | ({"manoeuvre_windows": ""} if isinstance(plan, str) else {})
        settings = self.settings(label, plan, **more)
        truth = self.one.simulate(files_, seed=seed, settings=settings, effects=effects)
        return self.one.source(event=None, data=files_, satellite=self.satellite, date=self.date), truth

    def observed(self, source, plan):
        """(Observations or None, {name: Dataset} of the calibration) of a flight of a plan."""
        searched, chosen = self.one.discovery, self.chosen(plan)
        datasets = {name: read(ref) for name, ref in searched.baseline(source, chosen).items()}
        settings = searched.settings(source, chosen) | searched.chosen_for(chosen)[0]
        return discovery.observations_of(datasets.values(), searched.observations, datasets, settings), datasets

    def flown(self, label, plan, seed, causes):
        """`design.Flown`: information of each manoeuvre of a simulated flight, at any time of the day."""
        source, truth = self.flight(label, plan, seed, manoeuvre_windows="")
        observed, datasets = self.observed(source, plan)
        times = [(m["start"], m["stop"]) for m in truth["manoeuvres"]]
        return design.flown(
            observed, self.one.information(datasets), times, [m["item"] for m in truth["manoeuvres"]], causes
        )

    def verified(self, plan, flights, causes=()):
        """{"flights", "sigma", "error_rms"} of simulated flights of a plan: mean sigma and rms error of each value.

        With causes also "separated", of as many flights in which one acts in turn, parameters at plausible sizes with
        a random sign: for each pair the number of flights with one of them, of those whose search names it apart
        from the other ("separated"), and of those that name the other without it ("falsely").
        """
        self.say(f"{flights} flights to check")
        errors, _ = self.errors(plan, range(101, 101 + flights))
        sigma, error, _ = zip(*errors.values(), strict=True)
        achieved = {"flights": flights, "sigma": list(sigma), "error_rms": list(error)}
        if not causes:
            return achieved
        search, rng = discover.as_calibration(self.one.name), np.random.default_rng(flights)
        rows = {pair: np.zeros(3, dtype=int) for pair in itertools.combinations(causes, 2)}
        for k, slug in zip(range(flights), itertools.cycle(causes), strict=False):
            self.say(f"search {k + 1} of {flights}: {slug}")
            sizes = effect(slug).plausible(lambda: rng.choice([-1, 1]))
            strengths = {f"{slug}.{name}": value for name, value in sizes.items()}
            source, _ = self.flight(f"search-{k}", plan, 201 + k, effects=strengths)
            findings = search.document(search.flow(source, self.chosen(plan)))["findings"]
            named_sets = [{one["cause"], *one["tied_with"]} for one in findings]
            for pair, row in rows.items():
                if slug in pair:
                    (other,) = set(pair) - {slug}
                    is_right = any(slug in one and other not in one for one in named_sets)
                    row += 1, is_right, not is_right and any(other in one for one in named_sets if slug not in one)
            shutil.rmtree(self.folder / f"search-{k}")
        names = "flights", "separated", "falsely"
        counts = {pair: dict(zip(names, map(int, row), strict=True)) for pair, row in rows.items()}
        return achieved | {"separated": [{"causes": list(pair)} | one for pair, one in counts.items()]}


def _settled(rows, names):
    """True if the mean sigma of the named values (none: all) is known to KNOWN from rows (flights, values) so far."""
    for column in zip(*rows, strict=True):
        sigma = [value.sigma for value, _ in column]
        if (not names or column[0][0].label in names) and None not in sigma:
            square = np.square(sigma)
            if np.std(square, ddof=1) / np.sqrt(square.size) > 2 * KNOWN * square.mean():
                return False
    return True


def _odds(apart, tied):
    """[{"causes", "chi2", "odds"}]: probability that each pair is separated, from {pair: expected chi-square}."""
    return [{"causes": list(pair), "chi2": float(c), "odds": design.odds(c, tied)} for pair, c in apart.items()]
