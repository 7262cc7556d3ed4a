"""The nearest known name, and the words that offer it."""

from study.text.nearest import did_you_mean, nearest

KNOWN = ("mle", "lls", "ugdk", "gdke")


def test_nearest():
    """A misspelt name finds its own; one that is like none finds none."""
    assert nearest("ugdkk", KNOWN) == "ugdk"
    assert nearest("lsl", iter(KNOWN)) == "lls"
    assert nearest("zzz", KNOWN) is None
    assert nearest("x", []) is None


def test_capitals():
    """A name that differs in capitals alone is the nearest, whatever else is like it."""
    assert nearest("Als", ["lls", "als"]) == "als"
    assert nearest("FIG2", ["fig2_error", "fig_map"]) == "fig2_error"
    assert nearest("cmu", ["CMU41", "other"]) == "CMU41"


def test_the_beginning_of_a_name():
    """It finds the only name that begins so."""
    known = ["fig2_error", "fig5_methods", "fig_map", "fig_posterior"]
    assert nearest("fig2", known) == "fig2_error"
    assert nearest("f", known) is None
    assert nearest("", ["a"]) is None


def test_did_you_mean():
    """The nearest is offered first; all are listed, in their order."""
    assert did_you_mean("lsl", KNOWN) == "did you mean 'lls'? Known are mle, lls, ugdk, gdke"
    assert did_you_mean("zzz", iter(KNOWN)) == "known are mle, lls, ugdk, gdke"


def test_several_names():
    """Each unknown name that is like a known one is answered, and the list comes once."""
    assert did_you_mean(["lsl", "zzz", "gdkee"], KNOWN) == (
        "did you mean 'lls' and 'gdke'? Known are mle, lls, ugdk, gdke"
    )
