"""What a search delivers, from the driver that makes it to the report that reads it.

Names are those of the result document and of the quantities in the product; what has a default is left out there where
it has it. A number is None where the data determine none.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gravcal.estimation.quantities import record_of, result_of
from gravcal.estimation.records import Entry, Numbers, Parameter, Unobservable, Weighed


@dataclass(frozen=True)
class Band:
    """Power of the residual in a band of a channel and block, over that of noise."""

    block: str
    channel: str
    band: int
    p: float  #: probability of as much by chance
    ratio: float


@dataclass(frozen=True)
class Peak:
    """Best line or step in what the extended model leaves of a channel."""

    kind: str
    channel: str
    chi2: float
    parameters: int
    frequency_hz: float | None = None  #: of a line
    time: float | None = None  #: s, of a step


@dataclass(frozen=True)
class Unexplained:
    """What is left where the extended model is not adequate."""

    p: float | None = None
    bands: Sequence[Band] = ()  #: the least likely
    scans: Sequence[Peak] = ()


@dataclass(frozen=True)
class Outlier:
    """Isolated sample left out before the search."""

    block: str
    channel: str
    axis: str
    time: float
    sigma: float  #: residual over its error


@dataclass(frozen=True)
class Separation:
    """How well the data tell a cause from one that is tied with it."""

    cause: str
    expected_chi2: float
    best_block: str | None  #: that tells most
    events_needed: int | None  #: like this one to tell them apart, None if none can


@dataclass(frozen=True)
class Imitator:
    """Driver that describes the data as well as a cause of the catalogue."""

    cause: str
    form: str
    expected_chi2: float


@dataclass(frozen=True)
class HeldoutGain:
    """Chi-square that a cause gains on data left out and on those it is fitted to, by so many parameters."""

    chi2: float
    in_sample_chi2: float
    parameters: int


@dataclass(frozen=True, kw_only=True)
class NamedCause(Entry):
    """A cause that was named."""

    tied_with: Sequence[str]
    adopted: bool  #: into the calibration that is delivered
    in_catalogue: bool
    model: Mapping[str, Parameter]  #: parameters as a model takes it out
    significance: float  #: probability corrected for everything that was tried
    level: float
    heldout: str  #: "manoeuvres" or "blocks"
    heldout_gain: HeldoutGain
    separation: Sequence[Separation]
    imitators: Sequence[Imitator]

    @property
    def entries(self) -> list[Entry]:
        """Its entry of a model, none of what no model takes out."""
        return [Entry(self.cause, self.form, self.model, self.waves, self.leads)] if self.model else []


@dataclass(frozen=True)
class Change:
    """Parameters of the calibration before and after the search, in their reported unit."""

    names: Sequence[str]
    unit: str
    variant: str
    before: Numbers
    sigma_before: Numbers
    after: Numbers
    sigma_after: Numbers
    change: Numbers
    change_in_old_sigma: Numbers
    covariance_of_findings: Sequence[Numbers]
    correction: Numbers  #: what the calibration of the records without the model lacks
    epoch: float | None = None  #: s, at which what moves is given


@dataclass(frozen=True)
class Gain:
    """Chi-square, likelihood and criterion; rms of the whitened residual by channel."""

    chi2_before: float
    chi2_after: float
    dof_before: int
    dof_after: int
    heldout_chi2: float
    log_likelihood_before: float
    log_likelihood_after: float
    bic_change: float
    rms_before: Mapping[str, float | None]
    rms_after: Mapping[str, float | None]


@dataclass(frozen=True)
class Tried:
    """Best form of a cause in the first round."""

    cause: str
    form: str
    chi2: float
    parameters: int
    significance: float


@dataclass(frozen=True)
class Limit:
    """Least size of a parameter of a cause at which it would have been named, None at no size that was tried."""

    cause: str
    form: str
    parameter: str
    unit: str
    prior: float | None  #: plausible size
    size: float | None
    signal_to_noise: float | None
    confirmed: bool | None  #: by the search itself
    alone_from: float | None  #: size from which it is tied with nothing
    confused_with: Sequence[str]
    bias: Numbers | None  #: of the result just below, or of the plausible size where it is not seen at all
    bias_in_sigma: float | None


@dataclass(frozen=True)
class Shown:
    """Where a finding, -1 where none was named, is shown: the reading that it helps most."""

    finding: int
    channel: str
    block: str
    axis: int


@dataclass(frozen=True)
class Readings:
    """Readings that are shown, and periods s over which they may be folded."""

    shown: Sequence[Shown]
    periods: Numbers


@dataclass(frozen=True)
class Outcome:
    """All of it."""

    adequate_before: bool
    adequate_after: bool
    p_before: float
    p_after: float
    p_quiet_before: float  #: of so little power
    p_quiet_after: float
    level: float
    outliers: Sequence[Outlier]
    findings: Sequence[NamedCause]
    indistinguishable_from_calibration: Sequence[Unobservable]
    unexplained: Unexplained
    calibration_change: Change
    gain: Gain
    tried: Sequence[Tried]
    expected: Mapping[str, Numbers]  #: {parameter: value, largest distance from it}
    weighed: Sequence[Weighed] = ()
    limits: Sequence[Limit] | None = None  #: None where they were not looked for
    readings: Readings | None = None


def outcome_of(search: Any) -> Outcome | None:
    """Outcome in the product of a search, None where the event had no manoeuvre to search."""
    return record_of(Outcome, tables) if "findings" in (tables := result_of(search)) else None
