"""Effects to inject, as the command line names them."""

from __future__ import annotations

from collections.abc import Mapping

from gravcal.effects import Context, effect
from gravcal.errors import CatalogError


def by_slug(strengths: Mapping[str, float] | None) -> dict[str, dict[str, float]]:
    """Values by effect, {slug: {parameter: value}}, from {"slug.parameter": value}, SI, or None."""
    found: dict[str, dict[str, float]] = {}
    for name, value in (strengths or {}).items():
        slug, _, parameter = name.rpartition(".")
        known = [p.name for p in effect(slug).parameters]
        if parameter not in known:
            raise CatalogError(
                f"effect {slug}: found parameter {parameter!r}, expected one of {', '.join(known)}.", effect=slug
            )
        found.setdefault(slug, {})[parameter] = float(value)
    return found


def within(effects: Mapping[str, Mapping[str, float]], slugs: tuple[str, ...]) -> Mapping:
    """The effects {slug: {parameter: value}}, if all of them are among those that a simulation can hide."""
    for slug in effects:
        if slug not in slugs:
            raise CatalogError(
                f"effect {slug}: this simulation has no channel for it, expected one of {', '.join(sorted(slugs))}.",
                effect=slug,
            )
    return effects


def added(effects: Mapping[str, Mapping[str, float]], channel: str, context: Context):
    """Sum of the contributions of the effects to a channel of CHANNELS, 0.0 if there is none."""
    total = 0.0
    for slug, given in effects.items():
        entry = effect(slug)
        if entry.channel != channel:
            continue
        try:
            total = total + entry.contribution(context, entry.values(given))
        except KeyError as missing:
            raise CatalogError(
                f"effect {slug}: found no {missing} in this simulation, which it needs. It belongs to another "
                "calibration; see gravcal effects.",
                effect=slug,
            ) from missing
    return total
