"""Results of the commands on recordings as data, for `--json`."""

from typing import TYPE_CHECKING

import numpy as np

from study.mocap.io.describe import extents, gaps

if TYPE_CHECKING:
    import pandas as pd

    from study.mocap.case_study.precision_study import CaseStudy
    from study.mocap.io.recording import Recording
    from study.mocap.markersets.marker_set import MarkerSet
    from study.mocap.markersets.match import Match


def recording_data(recording: "Recording", match: "Match | None") -> dict[str, object]:
    """Describe a recording.

    Args:
        recording: as it was read.
        match: the marker set that fits it best; None if none does.

    Returns:
        ``recording``, ``rate``, ``frames``, ``duration`` (seconds), ``missing`` (share of all samples), ``notes``;
        ``markers``, each with ``marker``, the numbers of ``missing`` frames, of ``gaps`` and of frames in the
        ``longest`` one, and ``extent`` (metres); ``markerset``, as in `match_data`, or null.
    """
    seen = recording.seen()
    markers = [
        {"marker": marker, **vars(gaps(row)), "extent": float(far)}
        for marker, row, far in zip(recording.markers, seen, extents(recording), strict=True)
    ]
    return {
        "recording": recording.name,
        "rate": recording.rate,
        "frames": recording.frames,
        "duration": recording.duration,
        "missing": float(1.0 - np.mean(seen)),
        "notes": list(recording.notes),
        "markers": markers,
        "markerset": None if match is None else match_data(match),
    }


def joints_data(match: "Match", table: "pd.DataFrame") -> dict[str, object]:
    """Describe joints that were found.

    Args:
        match: the recording and its marker set.
        table: a row per joint.

    Returns:
        ``recording``, ``notes``, ``markerset`` (as in `match_data`), and ``joints``: the rows of the table.
    """
    source = match.source
    head = {"recording": source.name, "notes": list(source.notes), "markerset": match_data(match)}
    return head | {"joints": table.to_dict("records")}


def match_data(match: "Match") -> dict[str, object]:
    """Describe how a marker set fits a recording.

    Returns:
        ``name``; ``labels``, the recording's label of each marker; ``lacking`` markers by segment; ``joints`` that can
        be found; ``lost`` joints, each with the reason; ``extra`` labels.
    """
    return {
        "name": match.whole.name,
        "labels": match.labels,
        "lacking": match.lacking,
        "joints": [joint.name for joint in match.joints],
        "lost": match.lost,
        "extra": list(match.extra),
    }


def case_study_data(case: "CaseStudy") -> dict[str, object]:
    """Describe a case study: ``recording``, ``frames``, ``subsets``, ``laws`` and ``joints`` as in its tables."""
    return {
        "recording": case.recording,
        "frames": case.frames,
        "subsets": case.subsets,
        "laws": case.laws.to_dict("records"),
        "joints": case.joints.to_dict("records"),
        "skipped": dict(case.skipped),
    }


def markerset_data(markerset: "MarkerSet") -> dict[str, object]:
    """Describe a marker set: ``name``, ``about``, ``segments``, ``joints``, ``optional`` markers and ``aliases``."""
    return markerset.model_dump()
