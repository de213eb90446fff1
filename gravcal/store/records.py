"""What the store hands out and believes: references to products, and the record beside each of them, meta.json.

A record is written with a checksum of its own. It counts when its bytes are those that were written, every part has its
type, its key is that of its recipe and the name of its folder, and nothing of the folder is a link. Whether the product
file fits it, `store` says.
"""

import functools
import hashlib
import json
import re
from dataclasses import dataclass
from pathlib import Path

from gravcal.store import keys, schemas

KEY = re.compile(r"[0-9a-f]{64}")
SEAL = b', "sha256_of_record": "'
SHOWN = 60  # characters of a wrong value that a message shows


@dataclass(frozen=True)
class ProductRef:
    """One product: ``key`` names all it depends on, ``digest`` its content; None where a plan cannot know them."""

    event: str
    kind: str
    variant: str = ""
    key: str | None = None
    digest: str | None = None
    path: Path | None = None

    @property
    def stage(self) -> str:
        """Kind and variant, as the readable link is called: ``com_offset.solve.mtq``."""
        return f"{self.kind}.{self.variant}" if self.variant else self.kind

    @property
    def name(self) -> str:
        """Event and stage, as people say it: ``grace-c-2020-02-01/com_offset.solve.mtq``."""
        return f"{self.event}/{self.stage}"

    @property
    def folder(self) -> Path | None:
        """Folder with ``product.nc``, ``meta.json`` and the files that belong to it, such as ``report.html``."""
        return self.path.parent if self.path else None


def sealed(record):
    """Text of a record of plain values with its checksum, bytes."""
    text = json.dumps(record, allow_nan=False).encode()
    return text[:-1] + SEAL + hashlib.sha256(text).hexdigest().encode() + b'"}'


def read(folder):
    """Record (a dict, shared) of a product folder, whose name is the key, and None; or None and why not."""
    parts = (folder.parent, folder, folder / "meta.json", folder / "product.nc")
    link = next((path for path in parts if path.is_symlink()), None)
    if link:
        return None, f"{link.name} is a link, which is not followed"
    try:
        image = (folder / "meta.json").read_bytes()
    except OSError:
        return None, "no readable record"
    return _believed(image, folder.name)


@functools.lru_cache(maxsize=64)  # found, then asked how it was made
def _believed(image, key):
    """Record of the bytes of a file and None, or None and why not."""
    head, seal, tail = image.rpartition(SEAL)
    if not seal:
        return None, "the record has no checksum: written by an earlier gravcal, or by others"
    if tail != hashlib.sha256(head + b"}").hexdigest().encode() + b'"}':
        return None, "the record is not as it was written (its checksum differs)"
    try:
        record = json.loads(head + b"}")
        for error in schemas.validator("_record").iter_errors(record):
            where = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in error.instance_path)
            return None, f"record{where}: {error.message[:SHOWN]}"
        if ["file" in one for one in record["recipe"]["inputs"]] != ["path" in one for one in record["from"]]:
            return None, "the record names other inputs than places where they were"
        if keys.key(record["recipe"]) != record["key"]:
            return None, "the key in the record is not that of its recipe (settings, inputs, code, event)"
    except (ValueError, OverflowError, RecursionError) as error:
        return None, f"the record cannot be read ({type(error).__name__})"
    if record["key"] != key:
        return None, f"the record names another key, {record['key']}"
    return record, None
