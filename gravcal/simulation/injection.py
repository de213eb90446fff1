"""Effects to inject, as the command line names them."""

from __future__ import annotations

from collections.abc import Mapping

from gravcal.effects import effect
from gravcal.errors import CatalogError


def by_slug(strengths: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Values by effect, {slug: {parameter: value}}, from {"slug.parameter": value}.

    Parameters
    ----------
    strengths : SI values
    """
    found: dict[str, dict[str, float]] = {}
    for name, value in strengths.items():
        slug, _, parameter = name.rpartition(".")
        known = [p.name for p in effect(slug).parameters]
        if parameter not in known:
            raise CatalogError(
                f"effect {slug}: found parameter {parameter!r}, expected one of {', '.join(known)}.", effect=slug
            )
        found.setdefault(slug, {})[parameter] = float(value)
    return found
