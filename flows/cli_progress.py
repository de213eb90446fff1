"""Progress on a terminal: what is done, and how long it may still take, judged by the last time.

Nothing is shown where standard error is no terminal. How long each part took is remembered in the store; what was never
done there is judged by a first run elsewhere (catalog/usual/seconds.toml), scaled by the speed seen so far.
"""

import contextlib
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

KNOWN_PART = 0.2  # of the usual time: after that the speed of this machine is known well enough to scale by

START = "start"  # of an engine: the part before the first stage
LATE_S = 2.0  # after the time announced


@dataclass(frozen=True)
class Left:
    """Time left as text, up to date whenever it is printed.

    Attributes
    ----------
    known : seconds that each part took the last time, here or, where ``usual``, elsewhere
    usual : whether the times come from elsewhere
    done : parts that are done, with the seconds they took; ``since`` holds when the last of them was, s
    """

    known: Mapping[str, float]
    usual: bool = False
    done: dict = field(default_factory=dict)
    since: dict = field(default_factory=lambda: {"at": time.monotonic()})

    def __str__(self):
        """About so long; perhaps so long where only the usual time is known."""
        if not self.known:
            return "no time known yet"
        spent = time.monotonic() - self.since["at"]
        rest = sum(seconds for name, seconds in self.known.items() if name not in self.done) * self.pace() - spent
        if rest < -LATE_S:
            return "takes longer than usual" if self.usual else "takes longer than last time"
        return f"{'perhaps' if self.usual else 'about'} {rest:.0f} s left" if rest >= 1 else "done in a moment"

    def pace(self):
        """Seconds here for each usual second; 1 until enough is done. The start of an engine says nothing of it."""
        made = {name: one for name, one in self.done.items() if name in self.known and name != START and one}
        usual = sum(self.known[name] for name in made)
        whole = sum(seconds for name, seconds in self.known.items() if name != START)
        return sum(made.values()) / usual if self.usual and usual > KNOWN_PART * whole else 1.0

    def begin(self, seconds):
        """The first part is done, and took so long itself; what passed before was the start."""
        now = time.monotonic()
        self.done[START], self.since["at"] = max(now - self.since["at"] - seconds, 0.0), now - seconds
        return self.done[START]

    def note(self, name, made=True):
        """One part is done; the seconds it took, zero where it was only reused."""
        now = time.monotonic()
        self.done[name], self.since["at"] = (now - self.since["at"] if made else 0.0), now
        return self.done[name]


@contextlib.contextmanager
def progress(title):
    """Listener that shows the stages done and the time left, if standard error is a terminal; otherwise None."""
    if not sys.stderr.isatty():
        yield None
        return
    from gravcal.store import store

    left, counts = _left(title), {"cached": 0, "made": 0}
    took = {} if left.usual else dict(left.known)
    with _bar(title, left) as tell:

        def listener(call, state, ref):
            counts[state] += 1
            stage = call.unmade.stage
            if START not in left.done:
                own = (store.read_record(ref.folder) or {}).get("seconds", 0.0) if state == "made" else 0.0
                took[START] = left.begin(own)
            seconds = left.note(_part(stage) if left.usual else stage, state == "made")
            took.update({stage: seconds} if state == "made" else {})
            tell(f"{counts['made']} made, {counts['cached']} reused, last {stage}")

        yield listener
    _remember(title, took)


@contextlib.contextmanager
def waiting(title, usual_s=None):
    """Time that passes and time left of work that has no parts, if standard error is a terminal.

    Parameters
    ----------
    title : str
    usual_s : float or None, s, where something better than the last time is known
    """
    if not sys.stderr.isatty():
        yield
        return
    begin = time.monotonic()
    with _bar(title, _left(title) if usual_s is None else Left({title: usual_s}, usual=True)):
        yield
    _remember(title, {title: time.monotonic() - begin})


def _left(title):
    """Time left from the last time here, else from the usual ones."""
    from gravcal.catalog import files as catalog_files
    from gravcal.store import memory

    known = memory.recall(f"seconds-{title}")
    return Left(known) if known else Left(catalog_files.read("usual", "seconds")[1].get(title, {}), usual=True)


def _part(stage):
    """Name of a stage in the table of usual times: the same for all satellites."""
    return stage.rpartition("_")[0] if stage.startswith("ingest.") else stage


def _remember(title, took):
    """Keep the seconds of each part for the next time."""
    from gravcal.store import memory

    if took:
        memory.remember(f"seconds-{title}", took)


@contextlib.contextmanager
def events_progress(total):
    """Listener that shows events done, failed and left, if standard error is a terminal; otherwise None."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.fields[said]}"), BarColumn(), TimeRemainingColumn())
    with Progress(
        *columns, console=Console(stderr=True), transient=True, auto_refresh=False
    ) as bar:  # forks: no thread
        row, counts = bar.add_task("", total=total, said=""), {"done": 0, "failed": 0}

        def listener(event):
            counts["failed" if event["status"] == "failed" else "done"] += 1
            left = total - counts["done"] - counts["failed"]
            said = f"{counts['done']} done, {counts['failed']} failed, {left} left"
            bar.update(row, advance=1, said=said, refresh=True)

        yield listener


@contextlib.contextmanager
def _bar(title, left):
    """Function that says what was done last, beside a clock and the time left."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    texts = (TextColumn("{task.description}"), TextColumn("{task.fields[said]}"))
    columns = (SpinnerColumn(), *texts, TimeElapsedColumn(), TextColumn("{task.fields[left]}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        row = bar.add_task(title, total=None, said="", left=left)
        yield lambda said: bar.update(row, said=said)
