"""The calibration of a session as lines for a reader, and its joints as a table."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from study.mocap.joints.estimates import USABLE
from study.mocap.joints.joint_table import SHORT_TEXTS, joint_table
from study.mocap.session.pool_places import PooledPlace, TrialPlace, difference
from study.mocap.session.session import Session
from study.text.columns import columns
from study.text.numbers import number


def session_lines(session: Session) -> Iterator[str]:
    """Lay out the merged joints, a line each in millimetres, with the trials that each comes from."""
    yield from session.overruled
    titles = ["joint", "status", *(f"{axis} / mm" for axis in "xyz"), "error", "apart", "from"]
    yield from columns(map(_row, session.merged.joints), titles, "<<>>>>><")
    yield "x, y, z: centre in its parent; error: largest standard error; apart: farthest reliable trial; all in mm"
    for joint in session.merged.joints:
        place = joint.place
        if place.status not in USABLE:
            yield f"{place.joint.name}: {place.reason}"
        left = [part for part in joint.parts if part.trial not in place.trials]
        if left and place.status in USABLE:
            yield f"{place.joint.name}: not from {', '.join(map(_left_out, left))}"


def session_table(session: Session) -> pd.DataFrame:
    """Tabulate joints, a row for each trial and joint.

    Returns:
        The columns of `joint_table`, in the axes of each trial; ``recording``, its name; ``merged``, True if the merged
        place rests on this row.
    """
    tables = []
    for found in session.found:
        table = joint_table(found)
        table.insert(0, "recording", found.recording)
        table["merged"] = [found.recording in joint.place.trials for joint in session.merged.joints]
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def _row(joint: PooledPlace) -> list[str]:
    place = joint.place
    apart = [difference(place, part.place).distance for part in joint.parts if part.usable]
    return [
        place.joint.name,
        SHORT_TEXTS[place.status],
        *(_millimetres(float(x)) for x in place.in_parent),
        _millimetres(place.standard_error),
        _millimetres(max(apart)) if len(apart) > 1 else "-",
        ", ".join(place.trials) if not np.isnan(place.in_parent).all() else "-",
    ]


def _left_out(part: TrialPlace) -> str:
    error = part.place.standard_error
    size = "" if np.isnan(error) else f", ± {1000 * error:.1f} mm"
    return f"{part.trial} ({SHORT_TEXTS[part.place.status]}{size})"


def _millimetres(metres: float) -> str:
    return number(1000 * metres, ".1f")
