"""Tasks: items are put together until they are heavy enough, the heaviest in sight first, and none is lost."""

import itertools

import pytest

from study.simulation.runs import workers
from study.simulation.runs.workers import cut


def weigh(item):
    """The weight of an item is the item."""
    return item


def test_the_heaviest_goes_first():
    """Each task has one item where one is heavy enough; of equal weights the first goes first."""
    assert list(cut([3, 9, 5, 7], weigh, 1)) == [(9,), (7,), (5,), (3,)]
    assert list(cut([(1, "a"), (1, "b")], lambda item: item[0], 0)) == [((1, "a"),), ((1, "b"),)]


def test_small_items_go_together():
    """Items are added until the task weighs enough; the last task may weigh less."""
    assert list(cut([1] * 7, weigh, 3)) == [(1, 1, 1), (1, 1, 1), (1,)]
    assert [sum(items) for items in cut([5, 1, 1, 1, 2], weigh, 3)] == [5, 3, 2]


@pytest.mark.parametrize("enough", [0, 10, 1e9])
def test_every_item_is_in_one_task(enough):
    """Whatever the weights, and however many items there are, each is in one task."""
    items = [(number * 7919) % 101 for number in range(3000)]
    found = list(itertools.chain.from_iterable(cut(items, weigh, enough)))
    assert sorted(found) == sorted(items)


def test_items_are_taken_as_needed(monkeypatch):
    """Only a window of the items is taken before the first task is made."""
    monkeypatch.setattr(workers, "_WINDOW", 4)
    taken = []
    source = (taken.append(number) or number for number in itertools.count())
    assert next(cut(source, weigh, 1)) == (3,)
    assert taken == [0, 1, 2, 3]
