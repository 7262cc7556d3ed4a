"""The viewer's page as a file: it needs no other file, has equal bytes each time, and escapes names."""

import base64
import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.mocap.view.ellipsoids import half_axes
from study.mocap.view.motion_json import FORMAT, MISSING, motion_document, write_motion
from study.mocap.view.webpage import THREE, viewer_page, write_viewer
from study.runs.storage.run_folder import RunError


@pytest.fixture(scope="module")
def page(scene):
    """The page of the synthetic scene."""
    return viewer_page(scene)


def embedded(page):
    """The motion in a page."""
    return json.loads(re.search(r'<script type="application/json" id="motion">(.*?)</script>', page, re.S)[1])


def numbers(document, name, kind="<i2"):
    """An array of a motion."""
    return np.frombuffer(base64.b64decode(document["arrays"][name]), dtype=kind)


def test_one_file(page):
    """Nothing is loaded from elsewhere, and the policy forbids it; of scripts it allows the page's own two."""
    policy = re.search(r'http-equiv="Content-Security-Policy" content="(.*?)">', page)[1]
    own = re.findall(r"<script>(.*?)</script>", page, re.S)
    hashed = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in own]
    assert policy.endswith("; script-src " + " ".join(f"'sha256-{text}'" for text in hashed))
    assert not re.search(r"<[^>]* on\w+=", re.sub(r"<script.*?</script>", "", page, flags=re.S))
    markup = re.sub(r"<script.*?</script>", "", page, flags=re.S)
    assert not re.findall(r'(?:src|href)="(?!data:)', markup)
    assert "default-src 'none'" in markup
    assert "import(" not in page
    assert page.count("<script") == page.count("</script>") == 3


def test_the_library_is_said(page):
    """The page has three.js, its release as the library itself says it, and its licence."""
    assert f'revision:"{THREE.split(".")[1]}"' in page
    assert f"three.js {THREE}, MIT licence" in page
    assert "Copyright © 2010-2026 three.js authors" in page
    assert "The above copyright notice and this permission notice shall be included" in page


def test_same_bytes(scene, page):
    """The same scene gives the same page."""
    assert viewer_page(scene) == page


def test_names_are_text(scene):
    """Names that look like markup stay names, in the title and in the motion."""
    name = "</script><img src=x onerror=alert(1)> & <!-- {{ 7 * 7 }}"
    page = viewer_page(replace(scene, name=name))
    assert "<img" not in page
    assert page.count("</script>") == 3
    assert "<title>&lt;/script&gt;&lt;img" in page
    assert embedded(page)["name"] == name


def test_the_motion(scene, page):
    """The page holds the scene, to a step of a tenth of a millimetre, at sixty frames per second at most."""
    document, shown = embedded(page), scene.at_most(60.0)
    assert (document["format"], document["frames"], document["rate"]) == (FORMAT, 45, 45.0)
    assert document["step"] < 1e-4
    for name, places in (("markers", shown.places), ("points", shown.points)):
        counts = numbers(document, name).reshape(45, -1, 3).transpose(1, 2, 0)
        assert np.array_equal(counts == MISSING, np.isnan(places))
        found = np.where(counts == MISSING, np.nan, np.array(document["origin"])[:, None] + document["step"] * counts)
        assert np.nanmax(abs(found - places)) <= 0.5 * document["step"] + 1e-6
    flags = numbers(document, "flags", "u1").reshape(45, -1)
    assert np.array_equal(flags.T, shown.flags)
    turns = numbers(document, "turns").reshape(45, -1, 4)[7, 2] / 32767
    between = Rotation.from_quat(turns) * Rotation.from_quat(shown.orientations[2, 7]).inv()
    assert between.magnitude() < 1e-4
    half = np.array([joint["half_axes"] for joint in document["joints"]], dtype=float)
    assert np.allclose(np.nan_to_num(half), half_axes(shown), atol=1e-6)
    assert np.array_equal(np.isnan(half), np.isnan(shown.errors))


def test_slower(scene):
    """A page of fewer frames per second is the same motion at the same speed."""
    assert embedded(viewer_page(scene, rate=30.0))["frames"] == 30


def test_no_number_that_json_has_not(scene):
    """A scene with frames without samples is still strict JSON."""
    places = scene.places.copy()
    places[:, :, 5:9] = np.nan
    json.dumps(
        motion_document(replace(scene, places=places, errors=np.full_like(scene.errors, np.nan))), allow_nan=False
    )


def test_writing(scene, tmp_path):
    """Page and motion are written whole, into a folder that is made; a failure gives one line."""
    path = write_viewer(scene, tmp_path / "new" / "viewer.html")
    assert embedded(path.read_text(encoding="utf-8")) == json.loads(
        write_motion(scene, tmp_path / "new" / "motion.json").read_text(encoding="utf-8")
    )
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == ["motion.json", "viewer.html"]
    with pytest.raises(RunError, match=r"viewer\.html: cannot be written: "):
        write_viewer(scene, path / "viewer.html")
