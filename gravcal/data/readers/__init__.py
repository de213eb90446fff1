"""Readers of Level-1 files: one table per product, one way to read them all."""

from gravcal.data.archive import LevelOneFile, find, inventory
from gravcal.data.readers.dataset import read

__all__ = ["LevelOneFile", "find", "inventory", "read"]
