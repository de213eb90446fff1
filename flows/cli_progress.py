"""Progress on a terminal: what is done, and how long it may still take, judged by the last time.

Nothing is shown where standard error is no terminal. How long each stage took is remembered in the store.
"""

import contextlib
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Left:
    """Time left as text, up to date whenever it is printed.

    Attributes
    ----------
    known : seconds that each part took the last time
    done : parts that are done; ``since`` holds when the last of them was, s
    """

    known: Mapping[str, float]
    done: set = field(default_factory=set)
    since: dict = field(default_factory=lambda: {"at": time.monotonic()})

    def __str__(self):
        """About so long, or nothing where the last time is not known."""
        rest = sum(seconds for name, seconds in self.known.items() if name not in self.done)
        if not self.known:
            return ""
        rest -= time.monotonic() - self.since["at"]
        return f"about {rest:.0f} s left" if rest >= 1 else "done in a moment"

    def note(self, name):
        """One part is done."""
        self.done.add(name)
        self.since["at"] = time.monotonic()


@contextlib.contextmanager
def progress(title):
    """Listener that shows the stages done and the time left, if standard error is a terminal; otherwise None."""
    if not sys.stderr.isatty():
        yield None
        return
    from gravcal.data import memo, store

    name = f"seconds-{title}"
    known = memo.recall(name) or {}
    left, counts = Left(known), {"cached": 0, "made": 0}
    with _bar(title, left) as tell:

        def listener(call, state, ref):
            counts[state] += 1
            stage = call.unmade.stage
            if state == "made":
                known[stage] = (store.read_record(ref.folder) or {}).get("seconds", 0.0)
            left.note(stage)
            tell(f"{counts['made']} made, {counts['cached']} reused, last {stage}")

        yield listener
    memo.remember(name, known)


@contextlib.contextmanager
def waiting(title):
    """Time that passes and time left of work that has no parts, if standard error is a terminal."""
    if not sys.stderr.isatty():
        yield
        return
    from gravcal.data import memo

    name, begin = f"seconds-{title}", time.monotonic()
    with _bar(title, Left(memo.recall(name) or {})):
        yield
    memo.remember(name, {title: time.monotonic() - begin})


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
