"""What the store hands out: small frozen records that say where a product is and what it holds."""

from dataclasses import dataclass
from pathlib import Path


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


@dataclass(frozen=True)
class Damaged:
    """A product that is not what its record says; it has been set aside."""

    ref: ProductRef
    reason: str
    folder: Path | None
