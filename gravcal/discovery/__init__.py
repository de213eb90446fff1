"""What a model gets wrong, and why: noise check, search, attribution, extension.

Names that every module uses alike: `problem` holds all columns of all blocks and their products, the observed rows
first; a `baseline` (p,) gives the indices of the columns that are fitted; `gram` (m, m) are products with some columns
projected out, `place` the slice of a candidate in them, `size` (m,) the norms less local columns, a `gain` a reduction
of chi-square; `rest` (n, d) of a block are residuals; `rows` trials of a round, `chosen` the (index, trial) of names.
"""

import tomllib
from pathlib import Path

from gravcal.estimation import quantities

#: Schema of the products of discovery, as `gravcal.store.product` has them.
DISCOVERY = tomllib.loads(Path(__file__).with_name("discovery.toml").read_text(encoding="utf-8")) | quantities.SCHEMA
