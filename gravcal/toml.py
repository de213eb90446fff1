"""TOML as gravcal writes it: entries of the catalogue, plans of designs and extended models."""

from collections.abc import Mapping

import tomli_w


def text(content: Mapping, comment: str = "") -> str:
    """TOML text of a mapping below comment lines; None and empty tables are left out."""
    return "".join(f"# {line}\n" for line in comment.splitlines()) + tomli_w.dumps(_known(content))


def _known(item):
    """Item without the entries of its tables, at any depth, that are None or an empty dict."""
    if isinstance(item, Mapping):
        return {name: _known(one) for name, one in item.items() if one is not None and one != {}}
    return [_known(one) for one in item] if isinstance(item, (list, tuple)) else item
