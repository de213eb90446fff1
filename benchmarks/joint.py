"""Search over many events: pairs of causes that it separates, false alarms, offsets at dates left out, time.

Ten days are simulated into `--out FOLDER`, and observed rows for 20 events (`--events`) of these days drawn anew: one
cause that is the same in all of them, at a signal-to-noise ratio of 2 to 6 in one event, beside offsets that walk. A
pair of causes counts where no single event tells them apart (expected chi-square below `TIE` in each). It is separated
if the set that is named, with what is tied with it, holds the true cause and not the other; falsely if it holds the
other alone. `--sort family` counts what is named without an effect, and events that are named for another value of a
cause; `--sort motion` is of drawn offsets. `--world open` or `second`: days of other hands, one effect of studies.toml
(`--sort NAME,NAME` or all) in all of them, flown by C and D in turn, every third event left out once.
"""

import datetime
import itertools
import resource
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy import stats

from benchmarks import worlds
from benchmarks.tables import STUDIES, Figure, grid, numbers, rms, rms_figure, say, show, title
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
BANDS = (0.0, 3.0, 4.0, 5.0, 7.0, 10.0, np.inf)  # of the predicted separation
ALIKE = 0.5  # of the chi-square of a cause that another explains, above which the pair is a hard one
PLAUSIBLE = 5.0  # times the prior of the catalogue, largest size that is drawn
HIDDEN = STUDIES["joint"]


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

    def drawn(self, rng, cause=None, value=None):
        """Events with a cause in all of them, alike (q,) or not (n, q), and offsets (n, p) m that walk by 3 um."""
        found, offset = [], 3e-6 * np.cumsum(rng.standard_normal((self.count, self.own)), axis=0)
        for k, one in enumerate(self.events):
            truth = np.zeros(one.gram.shape[0])
            truth[1 : 1 + self.own] = offset[k]
            if cause is not None:
                truth[self.places[cause]] = value if np.ndim(value) == 1 else value[k]
            root, gram, truth = self.roots[one.name], one.gram.copy(), truth[1:]
            gram[1:, 0] = gram[0, 1:] = right = gram[1:, 1:] @ truth + root @ rng.standard_normal(root.shape[1])
            gram[0, 0] = truth @ right + 1e4
            measured = dict(one.measured, year=k / 6, beta_deg=float(rng.uniform(-70, 70)))
            about = (f"event {k + 1:03d}", k * YEAR_S / 6, np.zeros(self.own), gram, one.size, one.causes, measured)
            found.append(Event(*about))
        return found, offset

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


def ties(world, rng, runs) -> list[Figure]:
    """Pairs of causes that no single event tells apart."""
    said, rows, started = {"right": 0, "alone": 0, "wrong": 0, "missed": 0}, [], time.process_time()
    for _ in range(runs):
        cause, value = world.cause(rng)
        slug = world.causes[cause].slug
        _, sets = search(world.drawn(rng, cause, value)[0])
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
    for other, (sigma, single, share) in world.pairs(cause, value).items():
        if single**2 < TIE:
            rows.append((sigma, share, right and other not in named, other in named and not right))
    return rows


def shares(rows) -> list[Figure]:
    """Table of pairs by their predicted separation, and the shares that are asked."""
    table = [("predicted separation", "pairs", "separated", "falsely", "hard pairs", "separated", "falsely")]
    hard = [row for row in rows if row[1] > ALIKE]
    for low, high in zip(BANDS, BANDS[1:], strict=False):
        inside = [[row for row in some if low <= row[0] < high] for some in (rows, hard)]
        counts = (n for some in inside for n in (len(some), *(sum(r[k] for r in some) for k in (2, 3))))
        table.append((f"{low:g} to {high:g} sigma", *map(str, counts)))
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
    named, strange, scores = [], [], []
    for _ in range(runs):
        events, offset = world.drawn(rng)
        found, sets = search(events)
        named.append(sets)
        strange.append(found.contradicting)
        away = (found.offset - offset).ravel()
        scores.append(away @ np.linalg.solve(found.spread.reshape(away.size, -1), away) / away.size)
    return [
        _counted("clean series in which something is named", named),
        _counted("clean series in which an event contradicts", strange),
        Figure("chi-square of offsets over their number", f"{np.mean(scores):.3f}"),
    ]


def contradicted(world, rng, runs) -> list[Figure]:
    """Searches of events one in twenty of which has another value of the cause, off by so many of its errors."""
    runs, started = max(1, runs // 6), time.process_time()
    table, wrong = [("off by, sigma", "cause named", "events named", "others")], []
    for away in (4, 6, 8, 12):
        hits = np.zeros(3, int)
        for _ in range(runs):
            cause, value = world.cause(rng)
            odd, place = rng.choice(world.count, max(1, world.count // 20), False), world.places[cause]
            values = np.tile(value, (world.count, 1))
            for k in odd:
                values[k] += away * value / np.sqrt(value @ world.grams[k][place, place] @ value)
            found, sets = search(world.drawn(rng, cause, values)[0])
            told_of = {one["event"] for one in found.contradicting}
            names = {f"event {k + 1:03d}" for k in odd}
            wrong.append(told_of - names)
            hits += [any(world.causes[cause].slug in one for one in sets), names <= told_of, bool(wrong[-1])]
        table.append((f"{away:g}", *(f"{n} of {runs}" for n in hits)))
    grid(table)
    return [_counted("series in which another event is named", wrong), _spent(started, len(wrong))]


def _spent(started, runs):
    """Processor time of a search, and memory of the process."""
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3  # kB on Linux
    spent = f"{(time.process_time() - started) / runs:.1f} s"
    return Figure("processor time of a search", spent, f"largest memory {memory:.0f} MB")


def _counted(name, cases):
    """Share of series with its bounds of 95 % beside the level that is delivered; missed if it is above for certain."""
    hits, runs = sum(map(bool, cases)), len(cases)
    low, high = stats.binomtest(hits, runs).proportion_ci(0.9, method="exact")
    return Figure(name, f"{hits} of {runs}", f"{low:.1%} to {high:.1%}", f"level {LEVEL:.1%}", bool(low <= LEVEL))


def motion(options) -> list[Figure]:
    """Offset at a date left out of drawn series: error over sigma with walks of every size, and with none."""
    rng, runs, pooled, named = np.random.default_rng(options.seed), options.runs or 200, {}, []
    heads = [f"{trims} trim, {words}" for trims in ("no", "a") for words in ("rms", "within sigma")]
    table = [("events", "walk, um in a root of a year", *heads)]
    for count, walk in itertools.product((6, 20), (0, 1, 3, 6, 20)):
        cells = [str(count), str(walk)]
        for trim in (False, True):
            score, strange = np.transpose([_left_out(rng, count, walk, trim) for _ in range(runs)])
            cells += [f"{rms(score):.2f}", f"{np.mean(np.abs(score) < 1):.0%}"]
            named += strange.tolist()
            for name in (f"{'with a' if walk else 'without'} walk", *["with a trim"] * trim):
                pooled.setdefault((count, name), []).extend(score)
        table.append(cells)
    grid(table)
    return [
        Figure(f"error over sigma, {n} events {name}", f"{v:.2f}", "", "0.90 to 1.10", bool(0.9 <= v <= 1.1))
        for (n, name), v in ((key, rms(score)) for key, score in pooled.items())
    ] + [_counted("series in which an offset contradicts", named)]


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
    chance = np.exp(chi2_tail.log_tail(np.max(one.left_out() ** 2), 1)) * (count - 1)
    return foretold(one, times[out], offset[out]), chance < LEVEL


def foretold(one, at, true):
    """Error over sigma of an offset at a time."""
    mean, sigma = one.predicted(np.array([at]))
    return (mean[0] - true) / sigma[0]


def left_out(events, offset, trims, out):
    """Error over sigma (3,) of the offset um of one event (its number) by all others; trims along x are known."""
    kept = np.arange(len(events)) != out
    found, _ = search([one for one, k in zip(events, kept, strict=True) if k])
    times, value, spread = np.array([one.time for one in events]), 1e6 * found.offset, 1e12 * found.spread
    moved = (moving(times[kept], value[:, k], spread[:, k, :, k], [] if k else trims) for k in range(3))
    return [foretold(one, times[out], true) for one, true in zip(moved, offset[out], strict=True)]


def flown(folder: Path, rng, count: int, world: str, name: str, satellite: str) -> tuple[list, np.ndarray, list]:
    """Events of another world, their offsets (n, 3) um, and epochs of trims along x."""
    first = datetime.date(2018, 8, 10) + datetime.timedelta(7 * "CD".index(satellite))
    days = [first + datetime.timedelta(int(d)) for d in np.sort(rng.choice(np.arange(0, 1700, 15), count, False))]
    times = np.array([report.seconds(str(one)) for one in days])
    trim, years = float(times[0] + rng.uniform(1, 4) * YEAR_S), (times[:, None] - times[0]) / YEAR_S
    walk = np.sqrt(np.diff(times, prepend=times[0]) / YEAR_S)[:, None] * [6, 3, 1] * rng.standard_normal((count, 3))
    offset = rng.uniform(-120, 120, 3) + np.cumsum(walk, axis=0) + years * rng.normal(0, 10, 3)
    offset[times > trim, 0] -= 113
    seeds, value = rng.integers(2**31, size=count).tolist(), HIDDEN[world][name].get("value")
    for day, seed, place in zip(map(str, days), seeds, offset.tolist(), strict=True):
        if not (folder / day / "made").exists():
            effects = {} if value is None else {name: value}
            given = {"satellite": satellite, "date": day, "offset_um": place}
            if world == "second":  # of a main field older than the catalogue's the years after it differ by 9 nT
                given["field_generation"] = 14
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
        spent = _spent(started, 1)
        told(events, found)
        slug = HIDDEN[world][name].get("cause", "")
        right = [one for one in sets if slug in one]
        said = f"alone {sum(len(one) == 1 for one in right)}, in a set {len(right)}, wrong {len(sets) - len(right)}"
        figures += [Figure(f"{satellite}, {name}: {slug or 'nothing'} named", said), spent]
        if slug:
            pairs += separations(events, slug, HIDDEN[world][name]["true"], sets)
        away = 1e6 * found.offset - offset
        ratio = away / (1e6 * np.sqrt(np.einsum("ipip->ip", found.spread)))
        figures.append(Figure("    error over sigma of offsets, x, y, z", numbers(rms(ratio), ".2f")))
        score += sum((left_out(events, offset, trims, out) for out in range(1, count - 1, 3)), [])
    figures += shares(pairs)
    figures.append(rms_figure("error over sigma at dates left out, rms", score, more=f", n {len(score)}"))
    return [*figures, Figure("largest", f"{np.abs(score).max():.1f}")]


def told(events, found) -> None:
    """Print what a search named, ties and contradictions."""
    for one in found.named:
        say(f"{events[0].causes[one.law.cause].slug} ({one.law.scope}), gain {one.gain:.0f} of {one.dof}")
        for row in one.ties:
            chi2 = f"{row['single']:.1f} in the best event, {row['expected_chi2']:.1f} in all"
            say(f"    {row['cause']}: {chi2}, odds {row['observed']:.1f}, {'tied' if row['tied'] else 'told apart'}")
        say(f"    {np.round(one.value, 6).tolist()} +- {np.round(one.sigma, 6).tolist()}")
    for row in found.contradicting:
        say(str(row))


def run(options) -> list[Figure]:
    """Study."""
    world = options.world or "own"
    folder = Path(options.out or tempfile.mkdtemp(prefix="gravcal-joint-"))
    title(f"joint search, {world} world, seed {options.seed}")
    if world in HIDDEN:
        return show(other_hands(folder, options, world))
    if options.sort == "motion":
        return show(motion(options))
    runs, rng = options.runs or (4 if options.quick else 30), np.random.default_rng(options.seed)
    drawn = World(evidence(folder), options.events or 20)
    studies = (clean, contradicted) if options.sort == "family" else (ties,)
    return show(sum((study(drawn, rng, runs) for study in studies), []), "share")
