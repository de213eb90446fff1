"""Findings of a discovery in sentences: cause and size; laws outside the catalogue in words and symbols."""

import re

from gravcal import effects
from gravcal.estimation.outcome import NamedCause, Outcome
from gravcal.report import pages
from gravcal.report.plain import decimals, gps_text, prefixed, probability, quantity, signed
from gravcal.store.results import units

STATED = 3  # parameters of a finding that a sentence states
CLEAR = 2.0  # of its error, from which a parameter is stated
MOVED = 0.5  # errors before, from which a change of the result is stated
OPEN_MEAN = "; any mean of it is a bias, whose error holds one as large"
QUIET = 1e-3  # probability of so little power, below which the noise is overrated


def title(cause: str) -> str:
    """Cause as readable text, "torque: dipole gain"; for one outside the catalogue the driver that it follows."""
    if cause == "unknown:excess":
        return "power beyond noise"
    slug, _, name = cause.partition(":")
    return f"an effect in no list that follows {_plain(name)}" if name else _plain(slug.replace(".", ": "))


def _plain(words):  # text of a slug: blanks for "_", " times " for "*"
    return words.replace("_", " ").replace("*", " times ")


def sentence(one: NamedCause) -> str:
    """Sentence on a finding with its numbers."""
    if one.cause == "unknown:excess":
        return f"Power beyond noise that follows nothing: {one.form.removeprefix('excess in the ')}."
    known = {n: p for n, p in one.parameters.items() if p.value is not None}
    if not one.in_catalogue and one.form and not one.form.endswith(" alone"):  # a law
        tail = OPEN_MEAN * any(n.startswith("mean_") for n in known)
        return f"{_upper(title(one.cause))}: {_law(one.form, known)}{tail}."
    listed, own = effects.catalogue().get(one.cause), one.model if set(one.model) < set(known) else {}
    law = [p.name for p in listed.parameters if p.neutral != 0 or p.name in ("time", "frequency")] if listed else []
    stated = _stated({n: p for n, p in (own or known).items() if n not in law}) + [n for n in law if n in known]
    said = [_phrase(one.cause, name, (known | own)[name]) for name in stated]
    tail = ", in every manoeuvre as long after its start" if one.form.startswith("every manoeuvre") else ""
    more = len(known) - len(said)
    tail += f"; {'alone, with ' * bool(own)}{more} more in the table" if more else ""
    return f"{_upper('; '.join(said) or 'no size is determined')} ({title(one.cause)}{tail})."


def _upper(text):  # text with a capital first letter
    return text[:1].upper() + text[1:]


def _stated(known):
    """Names of the parameters that are clear of zero, the clearest first; the clearest where none is."""
    size = {n: abs(p.value) / p.sigma if p.sigma else float("inf") for n, p in known.items()}
    order = sorted(size, key=size.get, reverse=True)
    return [n for n in order if size[n] > CLEAR][:STATED] or order[:1]


def _phrase(cause, name, parameter):
    """Clause on a parameter (name, Parameter) of a catalogued cause with its value, in the words of the catalogue."""
    value, sigma, effect = parameter.value, parameter.sigma, effects.catalogue().get(cause)
    known = {one.name: one.meaning for one in effect.parameters} if effect else {}
    of_sensor = f"{known[name[:-2]]} of sensor {name[-1]}" if name[-2:] in ("_1", "_2") and name[:-2] in known else ""
    meaning = known.get(name, of_sensor) or (f"share in {name}" if len(name) == 1 else _plain(name))
    if name == "time":
        return f"at {gps_text(value)} GPS" + (f" ± {sigma:.2g} s" if sigma else "")
    if meaning.startswith("relative excess of "):
        more = "larger" if value > 0 else "smaller"
        size = quantity(abs(value), sigma, "1")
        return f"{meaning.removeprefix('relative excess of ')} is {size} {more} than the catalogue says"
    text = quantity(value, sigma, parameter.unit)
    if meaning.endswith((" by", " at")):
        return f"{meaning} {text}"
    return f"{meaning} by {text}" if " turned " in meaning else f"the {meaning} is {text}"


def _law(form, known):
    """Text on a law outside the catalogue: form in words, equation in symbols, values of {name: Parameter}."""
    first, _, rest = form.partition(", ")
    reading, words = (first, rest.split(", ")[0]) if " reading" in first or first in READINGS else ("", first)
    sizes = {n: p for n, p in known.items() if n not in SYMBOLS}
    stated = _stated(sizes)
    letter = READINGS.get(reading.split()[0], "y") if reading else "y"
    if "frequency" in known and re.fullmatch(r"[\d.]+ Hz", words):
        words, symbols, definitions = "a wave", "A sin(2πft + φ)", []
    elif words.startswith("wave of "):
        symbols, definitions = "C cos u + S sin u", [f"u = {words.removeprefix('wave of ')}"]
    else:
        base, symbols, definitions = _symbols(words)
        definitions.append(f"x = {base}, of size one")
        symbols = symbols if symbols.startswith("A₀") else f"A {symbols}"
    terms = []
    for n in stated:  # such as "linear_y" or "linear_y_0", with number and axis as its subscript
        parts, size = n.split("_"), quantity(sizes[n].value, sizes[n].sigma, sizes[n].unit)
        number = "".join("₀₁₂"[int(part)] for part in parts if part in ("0", "1", "2"))
        amplitude = "C" if "cosine" in parts else "S" if "sine" in parts else "A"
        terms.append(f"{amplitude}{number}{''.join(f'({part})' for part in parts if part in ('x', 'y', 'z'))} = {size}")
    terms += [f"{SYMBOLS[n]} = {quantity(p.value, p.sigma, p.unit)}" for n, p in known.items() if n in SYMBOLS]
    where = ", ".join([*definitions, *terms])
    return f"{f'{reading} follows ' if reading else ''}{words}; Δ{letter} = {symbols}, where {where}"


def _symbols(words):
    """(series that a law is made of, law in symbols of it, [definition of a symbol]) from its words, by `LAWS`."""
    for pattern, symbols, where in LAWS:
        match = re.fullmatch(pattern, words)
        if match:
            base, inner, definitions = _symbols(match[1])
            return base, symbols.format(inner), [*definitions, *([where.format(inner)] if where else [])]
    return words, "x", []


def verdict(outcome: Outcome | None) -> str:
    """Verdict of a discovery in sentences; None: no manoeuvre in the data."""
    return WORDS.note("verdict", quiet=QUIET, **(vars(outcome) if outcome else {}))


def _moves(change):
    """Sentence on how far the result moves by a Change, "" without parameters."""
    if not change.names:
        return ""
    rows = change.names, change.change, change.after, change.sigma_before, change.sigma_after
    moves = []
    for name, step, value, sigma_before, sigma_after, unit in zip(*rows, units(change.unit, change.names), strict=True):
        if None not in (step, sigma_before, sigma_after) and abs(step) >= MOVED * sigma_before:
            factor = 1.0
            if unit.startswith("1e-6 "):
                factor, unit = prefixed(1e-6 * max(abs(value), sigma_after), unit.removeprefix("1e-6 "))
                factor *= 1e-6
            by, to = (signed(factor * one, decimals(factor * sigma_after)) for one in (step, value))
            moves.append(f"{name} by {by} to {to} ± {factor * sigma_after:.{decimals(factor * sigma_after)}f} {unit}")
    words = f": {', '.join(moves)}" if moves else " by less than half of its error"
    return f" The result moves{words}." if set(change.change) != {None} else ""


_chance = lambda p: f"p = {probability(p)}".replace("= <", "<")  # noqa: E731
WORDS = pages.words(__file__, "discovery_words.toml", cause=title, sentence=sentence, moves=_moves, chance=_chance)
SYMBOLS, READINGS, LAWS = (WORDS.notes[name] for name in ("symbols", "readings", "laws"))
