"""What a model gets wrong, and why: noise check, search, attribution, extension.

Names that every module uses alike: `problem` holds all columns of all blocks and their products, the observed rows
first; a `baseline` (p,) gives the indices of the columns that are fitted; `gram` (m, m) are products with some columns
projected out, `place` the slice of a candidate in them and `size` (m,) the norms beside local columns; `rest` (n, d) a
block are residuals; `rows` the trials of a round and `chosen` the (index, trial) of every name.
"""

import tomllib
from pathlib import Path

from gravcal.estimation import quantities

#: Schema of the products of discovery, as `gravcal.store.product` has them.
DISCOVERY = tomllib.loads(Path(__file__).with_name("discovery.toml").read_text(encoding="utf-8")) | quantities.SCHEMA
