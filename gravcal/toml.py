"""TOML as gravcal writes it: entries of the catalogue, plans of designs and extended models."""

from collections.abc import Mapping

import tomli_w


def text(content: Mapping, comment: str = "") -> str:
    """File of values, tables and lists of tables below comments; what is None or empty is left out."""
    return "".join(f"# {line}\n" for line in comment.splitlines()) + tomli_w.dumps(_known(content))


def _known(item):
    """Value or table without what is None or empty in its tables."""
    if isinstance(item, Mapping):
        return {name: _known(one) for name, one in item.items() if one is not None and one != {}}
    return [_known(one) for one in item] if isinstance(item, (list, tuple)) else item
