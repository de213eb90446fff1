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
    band: int  #: quarter of the spectrum, 0 the lowest
    p: float  #: probability of more power by chance
    ratio: float  #: power over its expectation for noise


@dataclass(frozen=True)
class Peak:
    """Best line or step in what the extended model leaves of a channel."""

    kind: str  #: "line" or "step"
    channel: str
    chi2: float  #: reduction by it
    parameters: int  #: their number
    frequency_hz: float | None = None  #: of a line
    time: float | None = None  #: s, of a step


@dataclass(frozen=True)
class Unexplained:
    """What is left where the extended model is not adequate."""

    p: float | None = None  #: p-value of the extended model
    bands: Sequence[Band] = ()  #: the least likely
    scans: Sequence[Peak] = ()  #: best of each channel and kind


@dataclass(frozen=True)
class Outlier:
    """Isolated sample left out before the search."""

    block: str
    channel: str
    axis: str  #: "x", "y" or "z"
    time: float  #: s
    sigma: float  #: residual over its error


@dataclass(frozen=True)
class Separation:
    """How well the data separate a cause from one that is tied with it."""

    cause: str  #: the tied one
    expected_chi2: float  #: left if the cause is true and the tied one is fitted
    best_block: str | None  #: label of the block with most of it
    events_needed: int | None  #: like this one to separate them, None if none can


@dataclass(frozen=True)
class Imitator:
    """Driver that describes the data as well as a cause of the catalogue."""

    cause: str
    form: str
    expected_chi2: float  #: left if the cause is true and this driver is fitted


@dataclass(frozen=True)
class HeldoutGain:
    """Chi-square that a cause gains, by so many parameters, on held-out data and on those it is fitted to."""

    chi2: float  #: on held-out data
    in_sample_chi2: float
    parameters: int  #: their number


@dataclass(frozen=True, kw_only=True)
class NamedCause(Entry):
    """A cause that was named."""

    tied_with: Sequence[str]  #: slugs
    adopted: bool  #: into the calibration that is delivered
    in_catalogue: bool
    model: Mapping[str, Parameter]  #: parameters as a model takes it out
    significance: float  #: probability corrected for everything that was tried
    level: float  #: family-wise level of the search
    heldout: str  #: "manoeuvres" or "blocks", which were left out
    heldout_gain: HeldoutGain
    separation: Sequence[Separation]
    imitators: Sequence[Imitator]

    @property
    def entries(self) -> list[Entry]:
        """Its Entry of a model in a list, empty where no model takes it out."""
        return [Entry(self.cause, self.form, self.model, self.waves, self.leads)] if self.model else []


@dataclass(frozen=True)
class Change:
    """Parameters of the calibration before and after the search, in their reported unit."""

    names: Sequence[str]
    unit: str
    variant: str  #: of the calibration, such as "joint fit"
    before: Numbers  #: (p,)
    sigma_before: Numbers
    after: Numbers  #: (p,)
    sigma_after: Numbers
    change: Numbers  #: (p,) after less before
    change_in_old_sigma: Numbers
    covariance_of_findings: Sequence[Numbers]  #: (p, p) after less before
    correction: Numbers  #: (p,) after less the calibration of the records with the model removed
    epoch: float | None = None  #: GPS s, at which a moving parameter is stated


@dataclass(frozen=True)
class Gain:
    """Chi-square, log likelihood and Bayesian information criterion; {channel: rms} of the whitened residual."""

    chi2_before: float
    chi2_after: float
    dof_before: int
    dof_after: int
    heldout_chi2: float  #: gained on held-out data, sum over findings
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
    chi2: float  #: reduction by it
    parameters: int  #: their number
    significance: float  #: p-value corrected for everything that was tried


@dataclass(frozen=True)
class Limit:
    """Least size of a parameter of a cause at which it would have been named, None at no size that was tried."""

    cause: str
    form: str
    parameter: str
    unit: str
    prior: float | None  #: plausible size
    size: float | None  #: limit, in unit
    signal_to_noise: float | None  #: of that size
    confirmed: bool | None  #: by the search itself
    alone_from: float | None  #: size from which it is tied with nothing
    confused_with: Sequence[str]  #: slugs of causes named near the limit
    bias: Numbers | None  #: (p,) of the result by a size just below, or by the plausible size if it is not observable
    bias_in_sigma: float | None


@dataclass(frozen=True)
class Shown:
    """Where a finding is shown: the reading that it helps most."""

    finding: int  #: index, -1 where none was named
    channel: str
    block: str  #: label
    axis: int  #: 0 x, 1 y, 2 z


@dataclass(frozen=True)
class Readings:
    """Readings that are shown, and periods s over which they may be folded."""

    shown: Sequence[Shown]
    periods: Numbers


@dataclass(frozen=True)
class Outcome:
    """Outcome of a search, all that a report reads."""

    adequate_before: bool  #: whether the baseline leaves noise only
    adequate_after: bool  #: whether the extended model does
    p_before: float  #: p-value of the residual
    p_after: float
    p_quiet_before: float  #: p-value of so little power
    p_quiet_after: float
    level: float  #: family-wise
    outliers: Sequence[Outlier]
    findings: Sequence[NamedCause]
    indistinguishable_from_calibration: Sequence[Unobservable]
    unexplained: Unexplained
    calibration_change: Change
    gain: Gain
    tried: Sequence[Tried]  #: best form of each cause in the first round
    expected: Mapping[str, Numbers]  #: {parameter: value, largest distance from it}
    weighed: Sequence[Weighed] = ()  #: evidence of each cause alone, where few numbers stand for many
    limits: Sequence[Limit] | None = None  #: None where they were not looked for
    readings: Readings | None = None


def outcome_of(search: Any) -> Outcome | None:
    """Outcome in the product of a search, None where the event had no manoeuvre to search."""
    return record_of(Outcome, tables) if "findings" in (tables := result_of(search)) else None
