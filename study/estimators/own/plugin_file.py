"""Files of one's own estimators: read, executed, tried out, and refused with one line.

What such a file prints goes to standard error, so that it never mixes with results.
"""

import contextlib
import hashlib
import linecache
import signal
import sys
import threading
import traceback
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from study.estimators.estimates import Estimates, blank
from study.estimators.own.register import Origin, registering, remove
from study.estimators.own.simple_form import SimpleForm, one_line
from study.estimators.registry import ESTIMATORS
from study.estimators.samples import Samples


class PluginError(Exception):
    """A file of estimators that cannot be used; the message says why, in one line."""


LIMIT = 60.0
"""Seconds in which a file, or a call of its estimators on a small data set, should be done."""


class OvertimeError(BaseException):
    """A call has not returned in time. An estimator that catches every `Exception` does not catch it."""


@contextlib.contextmanager
def in_time(seconds: float) -> Iterator[None]:
    """Raise `OvertimeError` where the calls within take longer: in the main thread, on systems that have alarms."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def ring(number: int, frame: object) -> None:
        raise OvertimeError(f"has not returned after {seconds:g} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


class PluginFile(NamedTuple):
    """A file of estimators, with its text: worker processes need not find the file.

    Attributes:
        path: of the file.
        text: its content.
    """

    path: str
    text: str

    @property
    def origin(self) -> Origin:
        """The file's name and digest, as manifests have them."""
        return Origin(Path(self.path).name, hashlib.sha256(self.text.encode()).hexdigest())


_loaded: dict[str, tuple[PluginFile, tuple[str, ...]]] = {}


def load(path: Path) -> tuple[str, ...]:
    """Load a file of estimators; once is enough, and a file that has changed replaces what it registered before.

    Args:
        path: a Python file that calls `study.register`.

    Returns:
        The names that it registered.

    Raises:
        PluginError: if it cannot be read, raises, registers nothing, or registers an estimator that answers in the
            wrong shape. Then nothing of it is registered.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise PluginError(f"{path}: cannot be read: {reason}") from None
    return load_text(PluginFile(str(path.resolve()), text), str(path))


def load_text(plugin: PluginFile, shown: str = "") -> tuple[str, ...]:
    """Load a file of estimators whose text is known; see `load`.

    Args:
        plugin: the file.
        shown: its name in messages; its path, if empty.
    """
    shown = shown or plugin.path
    before, names = _loaded.get(plugin.path, (None, ()))
    if before == plugin:
        return names
    unload(plugin.path)
    with registering(plugin.origin) as found:
        _execute(plugin, shown)
        if not found():
            raise PluginError(f"{shown}: registers no estimator; it should call study.register(name, function)")
        for name in found():
            try:
                with in_time(LIMIT), contextlib.redirect_stdout(sys.stderr):
                    faults = faults_of(name)
            except OvertimeError as error:
                raise PluginError(f"{shown}: {name}: {error} on 20 sound points") from None
            if len(faults) == 2:
                raise PluginError(f"{shown}: {name}: fails on 20 sound points: {faults[3]}")
        _loaded[plugin.path] = plugin, found()
    return found()


def unload(path: str) -> None:
    """Forget a file, and take the estimators that it registered out of the registry."""
    remove(_loaded.pop(path, (None, ()))[1])


def loaded() -> tuple[tuple[str, str], ...]:
    """Paths and texts of the loaded files, as plain text: a worker must read them before it may import anything."""
    return tuple((plugin.path, plugin.text) for plugin, _ in _loaded.values())


def faults_of(name: str) -> dict[int, str]:
    """Call an estimator on sound points in the plane and in space; what went wrong, by the dimension."""
    return {d: fault for d in (2, 3) if (fault := fault_on(name, sound_samples(d)))}


def sound_samples(d: int, sets: int = 2, n: int = 20) -> Samples:
    """Some sets of points about the unit sphere, with their noise."""
    rng = np.random.default_rng(7)
    u = rng.standard_normal((sets, n, d))
    points = u / np.linalg.norm(u, axis=2, keepdims=True) + 0.01 * rng.standard_normal(u.shape)
    return Samples(points.swapaxes(1, 2), 0.01)


def fault_on(name: str, samples: Samples) -> str:
    """Words for an estimator that raises or answers in the wrong shape; empty if it does neither."""
    function = ESTIMATORS[name].function
    try:
        if isinstance(function, SimpleForm):
            return next(iter(function.attempt(samples)[1].values()), "")
        answer = function(samples)
    except (Exception, SystemExit) as error:
        return one_line(error)
    return shape_fault(answer, samples)


def shape_fault(answer: object, samples: Samples) -> str:
    """Words for what is no answer to these samples; empty if it is one."""
    b, d, _ = samples.shape
    model = blank(b, d)
    if not isinstance(answer, tuple) or getattr(answer, "_fields", None) != model._fields:
        return f"returned {type(answer).__name__}, expected a {type(model).__name__}"
    for field, value, expected in zip(Estimates._fields, answer, model, strict=True):
        if np.shape(value) != expected.shape:
            return f"{field} has shape {np.shape(value)}, expected {expected.shape}"
    return ""


def _execute(plugin: PluginFile, shown: str) -> None:
    """Execute a file as a module of its own; PluginError with the line that raised."""
    module = types.ModuleType(f"study_own_{Path(plugin.path).stem}")
    module.__file__ = plugin.path
    vars(module)["print"] = _print
    sys.modules[module.__name__] = module  # where dataclasses and pickles look for it
    linecache.cache.setdefault(plugin.path, (len(plugin.text), None, plugin.text.splitlines(True), plugin.path))
    try:
        with in_time(LIMIT), contextlib.redirect_stdout(sys.stderr):
            exec(compile(plugin.text, plugin.path, "exec"), module.__dict__)
    except (Exception, SystemExit, OvertimeError) as error:
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == plugin.path]
        line = error.lineno if isinstance(error, SyntaxError) and error.filename == plugin.path else (lines or [1])[-1]
        raise PluginError(f"{shown}: line {line}: {one_line(error)}") from None


def _print(*words: object, **options: Any) -> None:
    """Print to standard error; a run's threads share the standard output, which cannot be changed for one of them."""
    print(*words, **{"file": sys.stderr, **options})
