"""The worker's entry point: results and exceptions come back as values, and a differing worker refuses to compute."""

import pickle

import pytest

from study.simulation.runs import workers
from study.simulation.runs.workers import Death, DisagreementError, attempt, enter, introduction, seal


@pytest.fixture(autouse=True)
def _fresh(monkeypatch):
    """Let this process stand for a worker that has not had a task yet."""
    monkeypatch.setattr(workers, "_agreed", [])


def starve():
    """Want more memory than there is."""
    raise MemoryError("cannot allocate")


def fail(words):
    """Raise an exception."""
    raise ZeroDivisionError(words)


def test_a_result_comes_back_with_its_number():
    """A worker that is as its parent calls the function."""
    assert enter(7, introduction(), seal(divmod, 17, 5)) == (7, (3, 2))


def test_want_of_memory_is_a_death():
    """The task is to be tried alone, as after the death of a worker."""
    assert attempt(1, starve) == (1, Death(f"out of memory (cannot allocate): {workers.NEEDS_LESS}"))


def test_an_exception_comes_back_with_its_traceback():
    """It is a value, because joblib gives up all tasks for one that raises; its notes survive pickling."""
    number, error = pickle.loads(pickle.dumps(enter(3, introduction(), seal(fail, "my own mistake"))))
    assert number == 3
    assert isinstance(error, ZeroDivisionError)
    assert str(error) == "my own mistake"
    assert "in fail" in error.__notes__[0]


@pytest.mark.parametrize("name", ["numpy", "code generated for", "sources"])
def test_a_worker_that_differs_refuses(name):
    """It says what differs, and calls nothing; a later task from a parent that agrees is computed."""
    parent = introduction()
    other = parent._replace(fingerprint=parent.fingerprint | {name: "another"})
    number, error = enter(1, other, b"this cannot be unpickled")
    assert number == 1
    assert isinstance(error, DisagreementError)
    assert f"{name} {parent.fingerprint[name]} instead of another" in str(error)
    assert enter(2, parent, seal(divmod, 17, 5)) == (2, (3, 2))
