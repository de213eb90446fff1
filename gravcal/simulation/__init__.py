"""Simulators, one for each calibration: `simulate(satellite, chosen, day, seed, effects)` gives columns and truth.

satellite : numbers of the catalogue, of a pair its letters
chosen : parameters of the simulation; day : GPS s of midnight; seed : int
effects : {slug: {parameter: value}}, hidden in the data
columns : {product: {column: array}}, as Level-1 files hold them
truth : plain dict, SI, um or mm where named so
"""

from collections.abc import Mapping

from gravcal.effects import Context, catalogue, effect
from gravcal.errors import CatalogError, refuse


def by_slug(strengths: Mapping[str, float] | None) -> dict[str, dict[str, float]]:
    """Values {slug: {parameter: value}} of effects, from {"slug.parameter": value}, SI, or None."""
    values: dict[str, dict[str, float]] = {}
    for name, value in (strengths or {}).items():
        slug, _, parameter = name.rpartition(".")
        known = [p.name for p in effect(slug).parameters]
        if parameter not in known:
            expected = f"one of {', '.join(known)}"
            refuse(f"effect {slug}", f"parameter {parameter!r}", expected, "Correct the name.", CatalogError)
        if not abs(value) < float("inf"):
            refuse(f"effect {name}", f"{value}", "a finite number", "Give its size in SI.", CatalogError)
        values.setdefault(slug, {})[parameter] = float(value)
    return values


def of_channels(*channels: str) -> tuple[str, ...]:
    """Slugs of the effects that act on one of these channels, keys of CHANNELS."""
    return tuple(slug for slug, entry in catalogue().items() if entry.channel in channels)


def within(effects: Mapping[str, Mapping[str, float]], slugs: tuple[str, ...]) -> Mapping:
    """The effects {slug: {parameter: value}}, if all of them are among those that a simulation can hide."""
    for slug in effects:
        if slug not in slugs:
            expected = f"one of {', '.join(sorted(slugs))}"
            refuse(f"effect {slug}", "that this simulation has no channel for it", expected, "Leave it.", CatalogError)
    return effects


def added(effects: Mapping[str, Mapping[str, float]], channel: str, context: Context):
    """Sum of the contributions of the effects to a channel of CHANNELS, 0.0 if there is none."""
    total = 0.0
    for slug, values in effects.items():
        entry = effect(slug)
        if entry.channel != channel:
            continue
        try:
            total = total + entry.contribution(context, entry.values(values))
        except KeyError as missing:
            remedy = "It belongs to another calibration; see gravcal effects."
            refuse(f"effect {slug}", f"no {missing} in this simulation", "what it needs", remedy, CatalogError)
    return total
