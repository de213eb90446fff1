"""Search over many events: pairs of causes that it separates, false alarms, offsets at dates left out, time.

`python -m benchmarks joint --runs N --seed S --out FOLDER` simulates ten days into the folder, keeps what each of them
tells (`com_offset.evidence`), and draws observed rows for 20 events (`--events`) of these days anew: one cause of the
catalogue that is the same in all of them, at a signal-to-noise ratio of 2 to 6 in one event, beside offsets that walk.

A pair of causes counts where no single event tells them apart (expected chi-square below `TIE` in each). Its predicted
separation is the root of the chi-square expected between them in all events, the best form of the other fitted. It is
separated if the set that is named, with what is tied with it, holds the true cause and not the other; falsely if it
holds the other and not the true one.

`--sort family` counts what is named in `--runs` series without an effect, and how often an event is named that has
another value of a cause than all others, by how far it is off. `--sort motion` takes no days: offsets of `--runs`
series of 6 and of 20 events that walk or stand, with a trim and without, one event left out of each.

With `--world open` or `second` the days are those of the forward models beside the project, or of the simulator of the
tests: `--events` (20) in five years, one effect that is the same in all of them at a signal-to-noise ratio near 5 in
one event, an offset with slope, walk and a trim. The series of `--sort NAME,NAME` (of `HIDDEN`, or all) are flown by C
and D in turn. Every third event is then left out once.
"""

import datetime
import resource
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy import stats

from benchmarks import worlds
from benchmarks.tables import Figure, grid, rms_figure, say, show, title
from flows import calibration, campaign, command
from gravcal.discovery import attribution, design
from gravcal.discovery import joint as science
from gravcal.discovery.evidence import Event, events_of
from gravcal.estimation import chi2_tail
from gravcal.estimation.moving import YEAR_S, moving
from gravcal.report import joint as report
from gravcal.store import configurations, store
from tasks.stage import read

DAYS = 10
LEVEL, TIE, ROUNDS = 0.005, 9.0, 4
BANDS = ((3.0, 4.0), (4.0, 5.0), (5.0, 7.0), (7.0, 10.0), (10.0, np.inf))  # of the predicted separation
ALIKE = 0.5  # of the chi-square of a cause that another explains, above which the pair is a hard one
PLAUSIBLE = 5.0  # times the prior of the catalogue, largest size that is drawn
OF_Y = ("y_from_x", "y_from_y", "y_from_z")
#: Effects of other worlds at a signal-to-noise ratio near 5 in one event, with the cause and values of the catalogue.
HIDDEN = {
    "open": {
        "mtq_gain": ([7e-3, 0, 0], "torque.dipole_gain", {"rod_x": 7e-3}),
        "sca_delay": (0.09, "timing.star_camera_delay", {"delay": 0.09}),
        "current_to_acc": ([0, 4e-10, 0], "accelerometer.current_leak", dict.fromkeys(OF_Y, 1.6e-12)),
        "mtq_misalign": ([1.2e-3, 0, 0], "torque.dipole_misalignment", {"angle_x": 1.2e-3}),
        "inertia_products": ([0, 0.13, 0], "torque.inertia_products", {"xz": 0.13}),
        "latitude_force": (1e-9, "", {}),
        "clean": (None, "", {}),
    },
    "second": {
        "dipole_gain": ({"value": [7e-3, 0, 0]}, "torque.dipole_gain", {"rod_x": 7e-3}),
        "acc_current_leak": ({"value": {"yx": 4e-13}}, "accelerometer.current_leak", {"y_from_x": 1.6e-12}),
        "sca_delay_s": ({"value": 0.09}, "timing.star_camera_delay", {"delay": 0.09}),
        "clean": (None, "", {}),
    },
}
#: What else a world is told: the main field of the catalogue, for of an older one the years after it differ by 9 nT.
MORE = {"open": {}, "second": {"field_generation": 14}}


def evidence(folder: Path) -> list:
    """What simulated days of three years tell."""
    one, first = calibration.load("com_offset"), datetime.date(2019, 8, 10)
    for k in range(DAYS):
        day = str(first + datetime.timedelta(100 * k))
        if not (folder / day).exists():
            one.simulate(folder / day, seed=100 + k, settings={"date": day, "satellite": "C"})
    return told_by(folder, "C")


def told_by(folder: Path, satellite: str) -> list:
    """Events of a satellite in a folder of days."""
    chosen = configurations.chosen("com_offset", {})
    told = campaign.Campaign("com_offset", chosen, "inline", workers=0, search="joint")
    rows = campaign.run(told, command.many_sources("com_offset", satellite, folder), lambda _: None)["events"]
    found = [read(store.find(Path(row["report"]).name)) for row in rows]
    return events_of(found, [row["event"] for row in rows])


class World:
    """Events whose products are those of simulated days, observed rows drawn anew."""

    def __init__(self, days, count):
        self.events, self.count = [days[k % len(days)] for k in range(count)], count
        self.causes, self.own = days[0].causes, days[0].start.size
        ends = 1 + self.own + np.cumsum([0, *(len(one.names) for one in self.causes)])
        self.places = [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]
        self.grams = [attribution.projected(one.gram, np.arange(1, 1 + self.own)) for one in self.events]
        self.total, self.size = sum(self.grams), np.sqrt(sum(one.size**2 for one in self.events))
        self.roots = {one.name: _root(one.gram[1:, 1:]) for one in self.events}

    def cause(self, rng):
        """A cause (its number) and its values, as strong as is wanted and plausible."""
        slugs = sorted({one.slug for one in self.causes})
        while True:
            slug = slugs[rng.integers(len(slugs))]
            k = rng.choice([j for j, one in enumerate(self.causes) if one.slug == slug])
            place, prior = self.places[k], self.causes[k].prior
            value = prior * rng.standard_normal(prior.size)
            known = value @ self.total[place, place] @ value / self.count
            value = value * rng.uniform(2, 6) / np.sqrt(known) if known > 0 else np.inf * value
            if np.all(np.abs(value) <= PLAUSIBLE * prior):
                return int(k), value

    def drawn(self, rng, offset, cause=None, value=None, times=None):
        """Events with offsets (n, p) and a cause in all of them, alike (q,) or not (n, q)."""
        times, found = np.arange(self.count) * YEAR_S / 6 if times is None else times, []
        for k, one in enumerate(self.events):
            truth = np.zeros(one.gram.shape[0] - 1)
            truth[: self.own] = offset[k]
            if cause is not None:
                own = value if np.ndim(value) == 1 else value[k]
                truth[self.places[cause].start - 1 : self.places[cause].stop - 1] = own
            root, gram = self.roots[one.name], one.gram.copy()
            right = gram[1:, 1:] @ truth + root @ rng.standard_normal(root.shape[1])
            gram[1:, 0] = gram[0, 1:] = right
            gram[0, 0] = truth @ right + 1e4
            measured = dict(one.measured, year=times[k] / YEAR_S, beta_deg=float(rng.uniform(-70, 70)))
            about = (f"event {k + 1:03d}", float(times[k]), np.zeros(self.own), gram, one.size, one.causes, measured)
            found.append(Event(*about))
        return found

    def pairs(self, cause, value):
        """{slug: (sigma that all events and that the best single one tell, share that the other explains)}."""
        mine, found = self.places[cause], {}
        whole = float(value @ self.total[mine, mine] @ value)
        for slug in {one.slug for one in self.causes} - {self.causes[cause].slug}:
            forms = [p for p, one in zip(self.places, self.causes, strict=True) if one.slug == slug]
            apart = [
                min(max(attribution.misfit(gram, mine, value, place, size), 0.0) for place in forms)
                for gram, size in ((self.total, self.size), *((g, self.size) for g in self.grams))
            ]
            found[slug] = np.sqrt(apart[0]), np.sqrt(max(apart[1:])), 1 - apart[0] / whole
        return found


def _root(gram):
    """Matrix R with R R' = gram (m, m), noise of the products."""
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    known, vectors = np.linalg.eigh(gram / np.outer(size, size))
    return vectors * np.sqrt(np.clip(known, 0, None)) * size[:, None]


def search(events):
    """Result of a search with the settings of the catalogue, and the sets of causes that it names."""
    looked = science.Search(events, LEVEL, TIE, ROUNDS)
    found = looked.run()
    sets = [{looked.slugs[one.law.cause], *(t["cause"] for t in one.ties if t["tied"])} for one in found.named]
    return found, sets


def walked(rng, count, own):
    """Offsets (n, p) m that walk by 3 um from event to event."""
    return 3e-6 * np.cumsum(rng.standard_normal((count, own)), axis=0)


def ties(world, rng, runs) -> list[Figure]:
    """Pairs of causes that no single event tells apart."""
    said, rows, started = {"right": 0, "alone": 0, "wrong": 0, "missed": 0}, [], time.process_time()
    for _ in range(runs):
        cause, value = world.cause(rng)
        slug = world.causes[cause].slug
        _, sets = search(world.drawn(rng, walked(rng, world.count, world.own), cause, value))
        said["right"] += any(slug in one for one in sets)
        said["alone"] += {slug} in sets
        said["wrong"] += any(slug not in one for one in sets)
        said["missed"] += not sets
        rows += tied(world, cause, value, sets)
    say(f"{runs} draws: {', '.join(f'{k} {n}' for k, n in said.items())}")
    return [*shares(rows), _spent(started, runs)]


def separations(events, slug, truth, sets):
    """Rows of `tied` of a series with a known cause."""
    world, values = World(events, len(events)), []
    for k, one in enumerate(world.causes):
        if one.slug == slug and set(truth) <= set(one.names):
            value = np.array([truth.get(name, 0.0) for name in one.names])
            values.append((float(value @ world.total[world.places[k], world.places[k]] @ value), k, value))
    strength, cause, value = max(values, key=lambda row: row[0])
    say(f"    signal-to-noise ratio in one event {np.sqrt(strength / world.count):.1f}")
    return tied(world, cause, value, sets)


def tied(world, cause, value, sets):
    """(predicted separation, share explained, separated, falsely) of each cause that no single event tells apart."""
    slug, rows = world.causes[cause].slug, []
    named, right = set().union(*sets), any(slug in one for one in sets)
    if sets and not right:
        say(f"wrong: {slug} was {', '.join(' = '.join(sorted(one)) for one in sets)}")
    for other, (sigma, single, share) in world.pairs(cause, value).items():
        if single**2 < TIE:
            apart = right and other not in named
            rows.append((sigma, share, apart, other in named and not right))
            if sigma >= np.sqrt(design.needed(0.9, TIE)) and not apart:
                say(f"not separated: {slug} from {other}, predicted {sigma:.1f} sigma")
    return rows


def shares(rows) -> list[Figure]:
    """Table of pairs by their predicted separation, and the shares that are asked."""
    table = [("predicted separation", "pairs", "separated", "falsely", "hard pairs", "separated", "falsely")]
    hard = [row for row in rows if row[1] > ALIKE]
    count = lambda some: (str(len(some)), str(sum(r[2] for r in some)), str(sum(r[3] for r in some)))  # noqa: E731
    for low, high in ((0.0, BANDS[0][0]), *BANDS):
        inside = [[row for row in some if low <= row[0] < high] for some in (rows, hard)]
        table.append((f"{low:g} to {high:g} sigma", *count(inside[0]), *count(inside[1])))
    grid(table)
    return [
        _share(f"{words} separated, at {low:.2g} sigma or more", [r[2] for r in some if r[0] >= low], 0.9)
        for words, some in (("pairs", rows), ("hard pairs", hard))
        for low in (np.sqrt(design.needed(0.9, TIE)), 5.0)
    ] + [_share("pairs falsely separated", [r[3] for r in rows], 0.02, least=False)]


def _share(name, hits, limit, least=True):
    value = np.mean(hits) if hits else np.nan
    met = bool(value >= limit if least else value <= limit)
    return Figure(name, f"{sum(hits)} of {len(hits)}", f"{value:.1%}", f"{'>=' if least else '<='} {limit:.0%}", met)


def clean(world, rng, runs) -> list[Figure]:
    """Searches of events without any effect, and the chi-square of their offsets."""
    named, strange, scores = 0, 0, []
    for _ in range(runs):
        offset = walked(rng, world.count, world.own)
        found, sets = search(world.drawn(rng, offset))
        named, strange = named + bool(sets), strange + bool(found.contradicting)
        for one in sets:
            say(f"false: {' = '.join(sorted(one))}")
        away = (found.offset - offset).ravel()
        scores.append(away @ np.linalg.solve(found.spread.reshape(away.size, -1), away) / away.size)
    return [
        _counted("clean series in which something is named", named, runs),
        _counted("clean series in which an event contradicts", strange, runs),
        Figure("chi-square of offsets over their number", f"{np.mean(scores):.3f}"),
    ]


def contradicted(world, rng, runs) -> list[Figure]:
    """Searches of events one in twenty of which has another value of the cause, off by so many of its errors."""
    runs, started = max(1, runs // 6), time.process_time()
    table, wrong = [("off by, sigma", "cause named", "events named", "others")], 0
    for away in (4, 6, 8, 12):
        hits = np.zeros(3, int)
        for _ in range(runs):
            cause, value = world.cause(rng)
            odd, place = rng.choice(world.count, max(1, world.count // 20), False), world.places[cause]
            values = np.tile(value, (world.count, 1))
            for k in odd:
                values[k] += away * value / np.sqrt(value @ world.grams[k][place, place] @ value)
            found, sets = search(world.drawn(rng, walked(rng, world.count, world.own), cause, values))
            told_of = {one["event"] for one in found.contradicting}
            names = {f"event {k + 1:03d}" for k in odd}
            hits += [any(world.causes[cause].slug in one for one in sets), names <= told_of, bool(told_of - names)]
        table.append((f"{away:g}", *(f"{n} of {runs}" for n in hits)))
        wrong += int(hits[2])
    grid(table)
    return [_counted("series in which another event is named", wrong, 4 * runs), _spent(started, 4 * runs)]


def _spent(started, runs):
    """Processor time of a search, and memory of the process."""
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3  # kB on Linux
    spent = f"{(time.process_time() - started) / runs:.1f} s"
    return Figure("processor time of a search", spent, f"largest memory {memory:.0f} MB")


def _counted(name, hits, runs):
    """Share of series with its bound of 95 % beside the level that is delivered; missed if it is above for certain."""
    low, high = (
        stats.beta.ppf(p, a, b) if a and b else d
        for p, a, b, d in ((0.05, hits, runs - hits + 1, 0.0), (0.95, hits + 1, runs - hits, 1.0))
    )
    return Figure(name, f"{hits} of {runs}", f"{low:.1%} to {high:.1%}", f"level {LEVEL:.1%}", bool(low <= LEVEL))


def recovery(world, rng, runs) -> list[Figure]:
    """Offset at a date left out: slope, walk, and a trim of 113 um along x."""
    score = []
    for _ in range(runs):
        times = np.sort(rng.uniform(0, 5 * YEAR_S, world.count))
        steps = np.sqrt(np.diff(times, prepend=0) / YEAR_S)[:, None] * [20, 10, 3] * rng.choice([0, 0.3, 1])
        trim, years = rng.uniform(1, 4) * YEAR_S, times[:, None] / YEAR_S
        offset = (
            [100, -40, 10] + np.cumsum(steps * rng.standard_normal(steps.shape), axis=0) + years * rng.normal(0, 10, 3)
        )
        offset[times > trim, 0] -= 113
        out = int(rng.integers(3, world.count - 3))
        kept = np.arange(world.count) != out
        events = [one for one, k in zip(world.drawn(rng, 1e-6 * offset, times=times), kept, strict=True) if k]
        score += foretold(events, times[kept], times[out], offset[out], [trim])
    return recovered(score)


def motion(options) -> list[Figure]:
    """Offset at a date left out of drawn series: error over sigma with walks of every size, and with none."""
    rng, runs, pooled = np.random.default_rng(options.seed), options.runs or 200, {}
    named = series = 0
    heads = [f"{trims} trim, {words}" for trims in ("no", "a") for words in ("rms", "within sigma")]
    table = [("events", "walk, um in a root of a year", *heads)]
    for count in (6, 20):
        for walk in (0, 1, 3, 6, 20):
            cells = []
            for trim in (False, True):
                drawn = [_left_out(rng, count, walk, trim) for _ in range(runs)]
                score = np.array([away for away, _ in drawn])
                cells += [f"{np.sqrt(np.mean(score**2)):.2f}", f"{np.mean(np.abs(score) < 1):.0%}"]
                named += int(sum(strange for _, strange in drawn))
                series += runs
                for name in (f"{'with a' if walk else 'without'} walk", *["with a trim"] * trim):
                    pooled.setdefault((count, name), []).extend(score)
            table.append((str(count), str(walk), *cells))
    grid(table)
    rms = {key: float(np.sqrt(np.mean(np.square(score)))) for key, score in pooled.items()}
    return [
        Figure(f"error over sigma, {n} events {name}", f"{v:.2f}", "", "0.90 to 1.10", bool(0.9 <= v <= 1.1))
        for (n, name), v in rms.items()
    ] + [_counted("series in which an offset contradicts", named, series)]


def _left_out(rng, count, walk, trim):
    """Error over sigma of an offset with errors of 2 um, at the date of an event left out; if any other contradicts."""
    times = np.sort(rng.uniform(0, 5 * YEAR_S, count))
    offset = 100 + rng.normal(0, 10) * times / YEAR_S
    offset += np.cumsum(walk * np.sqrt(np.diff(times, prepend=times[0]) / YEAR_S) * rng.standard_normal(count))
    trims = [rng.uniform(1, 4) * YEAR_S] if trim else []
    offset -= 113 * sum(times > at for at in trims)
    out = int(rng.integers(1, count - 1))
    kept = np.arange(count) != out
    value = (offset + 2 * rng.standard_normal(count))[kept]
    one = moving(times[kept], value, 4 * np.eye(count - 1), trims)
    mean, sigma = one.predicted(times[out : out + 1])
    chance = np.exp(chi2_tail.log_tail(np.max(one.left_out() ** 2), 1)) * (count - 1)
    return (mean[0] - offset[out]) / sigma[0], chance < LEVEL


def foretold(events, times, at, offset, trims):
    """Error over sigma (3,) of the offset um at a time, of events at others; trims along x are known."""
    found, score = science.Search(events, LEVEL, TIE, ROUNDS).run(), []
    for axis in range(3):
        spread = 1e12 * found.spread[:, axis, :, axis]
        one = moving(times, 1e6 * found.offset[:, axis], spread, trims if axis == 0 else [])
        mean, sigma = one.predicted(np.array([at]))
        score.append((mean[0] - offset[axis]) / sigma[0])
    return score


def recovered(score) -> list[Figure]:
    """Error over sigma with the interval of chi-square."""
    name = "error over sigma at dates left out, rms"
    return [rms_figure(name, score, more=f", n {len(score)}"), Figure("largest", f"{np.abs(score).max():.1f}")]


def flown(folder: Path, rng, count: int, world: str, name: str, satellite: str) -> tuple[list, np.ndarray, list]:
    """Events of another world, their offsets (n, 3) um, and epochs of trims along x."""
    first = datetime.date(2018, 8, 10) + datetime.timedelta(7 * "CD".index(satellite))
    days = [first + datetime.timedelta(int(d)) for d in np.sort(rng.choice(np.arange(0, 1700, 15), count, False))]
    times = np.array([report.seconds(str(one)) for one in days])
    trim, years = float(times[0] + rng.uniform(1, 4) * YEAR_S), (times[:, None] - times[0]) / YEAR_S
    walk = np.sqrt(np.diff(times, prepend=times[0]) / YEAR_S)[:, None] * [6, 3, 1] * rng.standard_normal((count, 3))
    offset = rng.uniform(-120, 120, 3) + np.cumsum(walk, axis=0) + years * rng.normal(0, 10, 3)
    offset[times > trim, 0] -= 113
    seeds, value = rng.integers(2**31, size=count).tolist(), HIDDEN[world][name][0]
    for day, seed, place in zip(map(str, days), seeds, offset.tolist(), strict=True):
        if not (folder / day / "made").exists():
            effects = {} if value is None else {name: value}
            given = {"satellite": satellite, "date": day, "offset_um": place} | MORE[world]
            worlds.MAKERS[world](folder / day, seed, effects, **given)
            (folder / day / "made").touch()
    return told_by(folder, satellite), offset, [trim]


def other_hands(folder: Path, options, world: str) -> list[Figure]:
    """Series of another world: what is named, which ties are broken, the offset at dates left out."""
    count, known = options.events or 20, list(HIDDEN[world])
    figures, score, pairs = [], [], []
    for number, name in enumerate(known if options.sort == "all" else options.sort.split(",")):
        satellite, rng = "CD"[number % 2], np.random.default_rng([options.seed, known.index(name), number % 2])
        events, offset, trims = flown(folder / name, rng, count, world, name, satellite)
        started = time.process_time()
        found, sets = search(events)
        took = time.process_time() - started
        told(events, found)
        _, slug, truth = HIDDEN[world][name]
        right = [one for one in sets if slug in one]
        said = f"alone {sum(len(one) == 1 for one in right)}, in a set {len(right)}, wrong {len(sets) - len(right)}"
        figures.append(Figure(f"{satellite}, {name}: {slug or 'nothing'} named", said, f"{took:.1f} s"))
        if slug:
            pairs += separations(events, slug, truth, sets)
        away = 1e6 * found.offset - offset
        rms = np.sqrt(np.mean(away**2 / (1e12 * np.einsum("ipip->ip", found.spread)), axis=0))
        figures.append(Figure("    error over sigma of offsets, x, y, z", " ".join(f"{v:.2f}" for v in rms)))
        times = np.array([one.time for one in events])
        for out in range(1, count - 1, 3):
            kept = np.arange(count) != out
            rest = [one for one, k in zip(events, kept, strict=True) if k]
            score += foretold(rest, times[kept], times[out], offset[out], trims)
    return [*figures, *shares(pairs), *recovered(score)]


def told(events, found) -> None:
    """Print what a search named, ties and contradictions."""
    for one in found.named:
        say(f"{events[0].causes[one.law.cause].slug} ({one.law.scope}), gain {one.gain:.0f} of {one.dof}")
        for row in one.ties:
            said = "tied" if row["tied"] else f"broken by {row['event']}"
            chi2 = f"{row['single']:.1f} in the best event, {row['expected_chi2']:.1f} in all"
            say(f"    {row['cause']}: {chi2}, odds {row['observed']:.1f}: {said}")
        say(f"    {np.round(one.value, 6).tolist()} +- {np.round(one.sigma, 6).tolist()}")
    for row in found.contradicting:
        say(str(row))


def run(options) -> list[Figure]:
    """Study."""
    world = options.world or "own"
    folder = Path(options.out or tempfile.mkdtemp(prefix="gravcal-joint-"))
    if world in HIDDEN:
        title(f"joint search in the {world} world, {options.sort}, seed {options.seed}")
        return show(other_hands(folder, options, world))
    if options.sort == "motion":
        title(f"offsets at dates left out, seed {options.seed}")
        return show(motion(options))
    runs, rng = options.runs or (4 if options.quick else 30), np.random.default_rng(options.seed)
    drawn = World(evidence(folder), options.events or 20)
    title(f"joint search, {drawn.count} events, seed {options.seed}")
    studies = (clean, contradicted) if options.sort == "family" else (ties, clean, recovery)
    return show(sum((study(drawn, rng, runs) for study in studies), []), "share")
