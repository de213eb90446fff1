"""Records that a calibration and discovery share, and `Observations`, all that discovery sees of a calibration."""

import itertools
import math
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from gravcal.estimation import quantities

if TYPE_CHECKING:  # the command line reads this module
    from gravcal.estimation.noise import Spectrum

Numbers = Sequence[float | None]  # None where the data determine none


@dataclass(frozen=True)
class Block:
    """Whitened observations that share nothing but the global parameters with other blocks."""

    label: str  #: what it is
    observed: np.ndarray  #: (n,) 1, residual of the baseline, noise of unit variance
    global_columns: np.ndarray  #: (n, p) of parameters common to all blocks, those of the calibration first
    local_columns: np.ndarray  #: (n, k) of parameters of this block alone
    channel: np.ndarray  #: (n,) name of the channel of each row
    axis: np.ndarray  #: (n,) 0 x, 1 y, 2 z
    time: np.ndarray  #: (n,) s
    #: {epoch s: (n, q)} columns of something that happens once in this block, at an epoch
    steps: dict[float, np.ndarray] = field(default_factory=dict)
    #: {(channel, axis): relative error of the amplitude of the noise in this block alone}
    level_error: Mapping[tuple[str, int], float] = field(default_factory=dict)

    @classmethod
    def of(cls, label: str, observed, channel, axis, time, *, shared=None, local=None, **more) -> "Block":
        """Block whose channel, axis and time s are of each row (n,) or of all; global, local columns if any."""
        rows = (np.broadcast_to(one, observed.size) for one in (channel, axis, time))
        matrices = (np.zeros((observed.size, 0)) if one is None else one for one in (shared, local))
        return cls(label, observed, *matrices, *rows, **more)


@dataclass(frozen=True)
class Shape:
    """What a cause depends on otherwise than linearly: s values, all positive, such as a frequency or a delay."""

    names: tuple[str, ...]  #: (s,)
    units: tuple[str, ...]  #: (s,)
    value: np.ndarray  #: (s,) at which the columns were made
    #: function of (s,) values -> one (n, q) or None a block; with `inside`, of these numbers as well
    columns: Callable[..., list[np.ndarray | None]]
    tried: np.ndarray  #: (t, s) values to begin a refinement from
    lower: np.ndarray  #: (s,) bounds
    upper: np.ndarray  #: (s,)
    #: function of (s,) values, residual and basis of the local columns of each block -> (b,) best fit of a value that
    #: each block has by itself; None without such a value
    inside: Callable[..., np.ndarray] | None = None
    sized: bool = False  #: True if the first of the values is the size of the cause itself
    covariance: np.ndarray | None = None  #: (s, s) once it is refined, None before
    chosen: np.ndarray | None = None  #: (b,) values of `inside` then
    slopes: list[np.ndarray] | None = None  #: (n, s) a block, derivatives of the signal by these once refined
    words: str = ""  #: of the form, before the values

    @property
    def parameters(self) -> "dict[str, Parameter]":
        """{name: Parameter} of the values, sigma NaN before it is refined."""
        sigma = self.value * np.nan if self.covariance is None else np.sqrt(np.diag(self.covariance))
        rows = zip(self.names, self.value.tolist(), sigma.tolist(), self.units, strict=True)
        return {name: Parameter(value, error, unit) for name, value, error, unit in rows}


@dataclass(frozen=True)
class Wider:
    """Further candidates made of one series: a key of the series, and the function that makes them."""

    key: tuple[str, ...]
    made: "Callable[[], list[Candidate]]"


@dataclass(frozen=True)
class Candidate:
    """A cause with its columns in every block."""

    cause: str  #: slug, or "unknown:<driver channel>"; while an epoch is searched for "slug@epoch", see `at_epoch`
    form: str  #: which of several shapes of the cause
    names: list[str]  #: (q,) parameters
    units: list[str]  #: (q,)
    columns: list[np.ndarray | None]  #: one (n, q) or None a block
    prior: list[float] = field(default_factory=list)  #: (q,) plausible sizes, none if empty
    at: float = np.nan  #: epoch s of a step, frequency Hz of a line
    at_sigma: float = np.nan  #: its error
    shape: Shape | None = None  #: what it depends on otherwise than linearly, None for most
    spread: np.ndarray | None = None  #: (q, q) covariance of the parameters by the error of the shape, None without
    apart: bool = False  #: True if several forms may act at once, as lines of several frequencies do
    wider: Wider | None = None  #: Wider, candidates that are tried where this one comes near; None without
    #: indices of the calibration's parameters that an unknown mean of each of its own parameters would change
    means: tuple[int, ...] = ()
    of_frame: bool = False  #: True if it rotates the frame of the result, whose error it does not add to
    choice: float = 0.0  #: chi-square that choosing its parameters among more of the cause is worth by chance

    @property
    def listed(self) -> bool:
        """True if the cause is in the catalogue."""
        return not self.cause.startswith("unknown:")

    @property
    def local(self) -> bool:
        """True if it acts in one block only, so that no other block can test it."""
        return sum(c is not None for c in self.columns) == 1

    def added(self, entry: "Entry") -> list[np.ndarray | None]:
        """Signal (n, ...) that an entry of this form adds in each block, None where it adds nothing."""
        sizes = np.array([entry.values.get(name, 0.0) for name in self.names])
        return [None if c is None else c @ sizes for c in self.columns]

    def each_alone(self) -> "list[Candidate]":
        """The candidate with all its parameters, then with each alone."""
        return [self, *(self.part([k], name) for k, name in enumerate(self.names if len(self.names) > 1 else ()))]

    def part(self, kept: Sequence[int], name: str) -> "Candidate":
        """The candidate with the parameters at indices kept only, its form "<name> alone"."""
        columns = [c if c is None else c[:, kept] for c in self.columns]
        names, units, prior = ([values[k] for k in kept] for values in (self.names, self.units, self.prior))
        return replace(self, form=f"{name} alone", names=names, units=units, prior=prior, columns=columns)


def at_epoch(slug: str, epoch: float) -> str:
    """Cause "slug@epoch" of something at an epoch s: each epoch is a cause of its own while it is searched for."""
    return f"{slug}@{epoch:.1f}"


def slug_of(cause: str) -> str:
    """Cause without its "@epoch"."""
    return cause.partition("@")[0]


def epoch_of(cause: str) -> float:
    """Epoch s of a cause, NaN if it has none."""
    return float(cause.partition("@")[2] or "nan")


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect: value, sigma (None where it is not known), unit, correlation {other name: 1}."""

    value: float | None
    sigma: float | None
    unit: str
    correlation: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Wave:
    """Line in one manoeuvre: its start s, channel, and cosine and sine on each axis, phase zero at the start."""

    start: float
    channel: str
    x: tuple[float, float] | None = None
    y: tuple[float, float] | None = None
    z: tuple[float, float] | None = None


@dataclass(frozen=True)
class Lead:
    """Time s of one manoeuvre, that begins at `start` s, by which its commanded edges lead the observed ones.

    Of a step that every manoeuvre has: after the start of the manoeuvre.
    """

    start: float
    lead: float


@dataclass(frozen=True)
class Entry:
    """One effect of an extended model: cause, form, parameters, and what differs between manoeuvres."""

    cause: str
    form: str
    parameters: Mapping[str, Parameter]  #: by name
    waves: tuple[Wave, ...] = ()  #: one a manoeuvre
    leads: tuple[Lead, ...] = ()  #: one a manoeuvre

    @property
    def listed(self) -> bool:
        """True if the cause is in the catalogue."""
        return not self.cause.startswith("unknown:")

    @property
    def values(self) -> dict[str, float]:
        """{name: value} of the parameters that are determined."""
        valued = {n: p.value for n, p in self.parameters.items() if p.value is not None}
        return {n: v for n, v in valued.items() if math.isfinite(v)}


def entries(model: Sequence[Mapping]) -> list[Entry]:
    """Entries of a model as a model file has it: {"cause", "form", "parameters", "waves", "leads"} each."""
    known = {"sigma": None, "unit": ""}
    rows = [one | {"parameters": {n: known | p for n, p in one["parameters"].items()}} for one in model]
    return [entry for entry in quantities.record_of(list[Entry], rows) if entry.parameters]


@dataclass(frozen=True)
class LineSearch:
    """Where lines are searched for after the rounds: channel, axis (-1: all), their cause, unit of the channel."""

    channel: str
    axis: int
    cause: str
    unit: str


@dataclass(frozen=True)
class Unobservable:
    """Direction of a cause, at its plausible size, that biases the result without being observable."""

    cause: str
    direction: Mapping[str, float]  #: {parameter: share of its plausible size}
    signal_to_noise: float
    bias: Numbers  #: of the result
    bias_in_sigma: float
    bias_in_error: Numbers = ()  #: of the result, the part that its error holds already
    drag_bias_m_s2: Numbers = ()


@dataclass(frozen=True)
class Weighed:
    """Evidence of a cause alone against none, in its best form."""

    cause: str
    form: str
    log_odds: float


@dataclass(frozen=True)
class Fitted:
    """A cause with its fitted parameters, and the residual of the model that it is part of."""

    candidate: Candidate  #: Candidate, with its shape as refined
    value: np.ndarray  #: (q,) of its parameters, NaN where not determined
    sigma: np.ndarray  #: (q,)
    rest: list[np.ndarray]  #: (n,) a block, residual of the extended model
    bases: list[np.ndarray]  #: (n, r) a block, orthonormal basis of the local columns


@dataclass(frozen=True)
class Reported:
    """How a calibration reports its result and readings beside a discovery: `REPORT` of the module of `observe`."""

    #: combined product, variant (None: the adopted) -> variant, parameters (p,) and covariance (p, p), reported unit
    result: Callable[..., tuple[str, np.ndarray, np.ndarray]] | None = None
    note: str = ""  #: how the records are looked at, for the page
    #: {channel: what its reading is}, for the caption of the figure
    readings: Mapping[str, str] = field(default_factory=dict)


def reported(module: str, name: str, result: Callable | None = None) -> Reported:
    """Reported with a result, its words those of the TOML file ``name`` next to a module file."""
    return Reported(result, **tomllib.loads(Path(module).with_name(name).read_text(encoding="utf-8")))


class Observations(Protocol):
    """All that discovery sees of a calibration; subclasses state the attributes, and the methods where they differ."""

    name: str  #: of the calibration
    channels: tuple[str, ...]  #: in the order of the page
    parameters: tuple[str, ...]  #: names of the calibration's parameters, the first of the global ones
    unit: str  #: of these, as reported
    scale: np.ndarray  #: (p,) factor from SI to that unit
    start: np.ndarray  #: (p,) SI, what the residuals were formed with
    blocks: list[Block]
    candidates: list[Candidate]  #: every effect of the catalogue in every channel, and the drivers
    #: {channel: quiet samples an axis that its noise was measured from}, none where it was measured in the rows
    quiet: Mapping[str, float] = {}
    noise_order: Mapping[str, int] = {}  #: {channel: coefficients of its noise model}
    spectra: Mapping[str, Sequence["Spectrum"]] = {}  #: {channel: of its axes}, where errors change with frequency
    step: str = "unknown:step"  #: cause of a step at the epochs of `Block.steps`
    tones: Mapping[str, str] = {}  #: {channel: cause of a line} of lines in the rounds
    lines: tuple[LineSearch, ...] = ()  #: lines looked for in what the rounds leave
    groups: Sequence[int] = ()  #: number of the manoeuvre of each block, for the phases of lines
    #: {s: highest harmonic} of the manoeuvre and of the orbit: no line is looked for near them
    periods: Mapping[float, int] = {}
    whole_manoeuvres: bool = False  #: True if a block is a manoeuvre, else what is left out is called "blocks"
    contiguous: bool = False  #: True if noise goes on from block to block, so that `reading` takes the rows of all
    floored: bool = False  #: True if the noise is held above what the record shows: less power is no alarm
    readable: tuple[str, ...] = ()  #: channels whose reading the page can show, all if empty
    epoch: float | None = None  #: s, GPS, at which a parameter that moves is given, None where there is none
    #: {parameter: (value, largest distance from it)} in the reported unit; what is further off is questionable
    expected: Mapping[str, tuple[float, float]] = {}
    circumstances: Mapping[str, float] = {}  #: quantities of the event that a cause may follow, as the angle of the Sun
    common: np.ndarray | float = 0.0  #: (p,) SI, error of the parameters that all events share and no data show
    shared: Mapping[str, float] = {}  #: {slug: SI}, largest error of a cause of one parameter that all events share
    shifted: bool = False  #: True of records whose tags are minutes off, of which nothing but that is said
    delays: Mapping[
        str, Parameter
    ] = {}  #: {slug: delay of tags that are minutes off}, as the records themselves show it

    def response(self, entry: Entry) -> list[np.ndarray]:
        """Whitened rows (n,) of each block that an entry at its values adds; linear in the candidate of its form."""
        total = [np.zeros(block.observed.size) for block in self.blocks]
        for one in self.forms_of(entry):
            total = [t if c is None else t + c for t, c in zip(total, one.added(entry), strict=True)]
        return total

    def forms_of(self, entry: Entry) -> Iterable[Candidate]:
        """Candidates that an entry is a size of, empty where its form is no candidate's.

        A form of a few parameters that a search has combined of a listed cause is represented by the whole form.
        """
        forms = [one for one in self.candidates if (one.cause, one.form) == (entry.cause, entry.form)]
        wider = (one for one in self.candidates if one.cause == entry.cause and set(entry.values) <= set(one.names))
        return forms or (itertools.islice(wider, 1) if entry.listed else ())

    def without(self, model: Sequence[Entry]) -> Any:
        """Dataset with the records of the calibration less what the effects of a model add to them."""
        ...

    def reading(self, channel: str, number: int, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Time (m,) s, reading (m, a) that the baseline predicts, whitened rows (n, q) of a block in its unit.

        The last are (q, m, a); `number` is that of the block.
        """
        ...

    def wave(self, search: LineSearch) -> Callable[[int, float], np.ndarray]:
        """Function (block number, Hz) -> whitened cosine and sine (n, 2) of a line."""
        ...

    def near(self, fitted: Fitted) -> list[Candidate]:  # noqa: ARG002
        """Candidates at epochs near that of a fitted cause, for a second search; none by default."""
        return []

    def spacing(self, epoch: float) -> float | None:  # noqa: ARG002
        """Spacing s of the epochs searched near one, over which its likelihood is averaged; None: `physical` does."""
        return None

    def physical(self, entry: Entry, fitted: Fitted) -> Entry:
        """Entry with the parameters of the catalogue's effect, from those of the candidate and of its shape."""
        if entry.cause in self.delays:
            return replace(entry, parameters={"delay": self.delays[entry.cause]})
        shape = fitted.candidate.shape
        return entry if shape is None else replace(entry, parameters=dict(entry.parameters) | shape.parameters)

    def worth_another(self, gains: Sequence[tuple[str, float]], adequate: bool) -> bool:  # noqa: ARG002
        """True if the search is worth repeating without these (cause, chi-square gain) in the records."""
        return bool(gains)

    def weighed(self) -> list[Weighed]:
        """Evidence of each cause alone, best first, where few numbers stand for many; empty by default."""
        return []

    def biased(self) -> list[Unobservable]:
        """Effects that bias the drag but not the parameters, their S/N still open; empty by default."""
        return []
