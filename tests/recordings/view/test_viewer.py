"""The viewer in a real browser: playing, scrubbing, rotating, switches, files and refusals, without any error.

The viewer's page as a file: it needs no other file, has equal bytes each time, and escapes names.
"""

import base64
import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from study.files import RunError
from study.recordings import api
from study.recordings.skeleton.draw import draw_skeleton
from study.recordings.skeleton.scene import skeleton_scene
from study.recordings.synthetic.make import Recipe, synthesize
from study.recordings.view import webpage
from study.recordings.view.figure import half_axes

JOINT = """name => viewer.stage.joints[viewer.motion.joints.findIndex(j => j.name === name)].position.toArray()"""

OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"

# labels that cover one another, by their boxes; one pixel is none
COVERED = """[...document.querySelectorAll('#labels span')].filter(e => !e.hidden).map(e => [e.textContent,
    e.getBoundingClientRect()]).filter(([, a], i, all) => all.some(([, b], j) => j > i && a.left < b.right - 1
    && b.left < a.right - 1 && a.top < b.bottom - 4 && b.top < a.bottom - 4)).map(([name]) => name)"""

# keeps what waits for the screen's next refresh, which then comes when a test says so
HOLD_SCREEN = """() => { let [now, waiting] = [0, []]; window.browser_refreshes = window.requestAnimationFrame;
    window.requestAnimationFrame = f => waiting.push(f);
    window.screen_refreshes = milliseconds => { const due = waiting; waiting = []; now += milliseconds;
    for (const f of due) f(now); }; }"""

COLORS = """() => { viewer.stage.draw(); const r = viewer.stage.renderer, gl = r.getContext ? r.getContext() : null;
    const [w, h] = gl ? [gl.drawingBufferWidth, gl.drawingBufferHeight] : [r.width, r.height];
    const p = gl ? new Uint8Array(4 * w * h) : r.context.getImageData(0, 0, w, h).data;
    if (gl) gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p); let blue = 0, green = 0;
    for (let i = 0; i < p.length; i += 4) { if (p[i + 3] < 40) continue;
    if (p[i + 2] > p[i] + 60) blue++; if (p[i + 1] > p[i] + 25 && p[i + 1] > p[i + 2] + 8) green++; }
    return [blue, green]; }"""

# colour of a plain canvas at the neck
NECK = """() => { const r = viewer.stage.renderer; viewer.stage.draw();
    const x = viewer.stage.point(viewer.motion.joints.findIndex(j => j.name === 'neck'));
    const at = viewer.stage.seen(x, r.width, r.height);
    return [...r.context.getImageData(Math.round(at.x), Math.round(at.y), 1, 1).data]; }"""


@pytest.fixture(scope="module")
def show(new_tab):
    """Open a page in a tab, after a script if one is given; the tab, and the messages of the browser."""

    def make(file, first="", **size):
        tab, said = new_tab(viewport={"width": 1000, "height": 700} | size), []
        tab.on("console", lambda message: said.append(f"{message.type}: {message.text}"))
        tab.on("pageerror", lambda error: said.append(f"error: {error}"))
        tab.on("request", lambda asked: said.append(asked.url) if not asked.url.startswith(("file:", "data:")) else 0)
        tab.add_init_script(first)
        tab.goto(file.as_uri())
        return tab, said

    return make


@pytest.fixture(scope="module")
def opened(show, scene, tmp_path_factory):
    """A tab with the page, and the messages of the browser."""
    return show(webpage.write_viewer(scene, tmp_path_factory.mktemp("viewer") / "viewer.html"))


@pytest.fixture
def tab(opened):
    """The tab at its start; it must have stayed silent."""
    page, said = opened
    said.clear()
    page.evaluate("viewer.playing = false; viewer.frame = 0; say('')")
    yield page
    assert said == []


@pytest.fixture
def another(tab, until, scene, tmp_path):
    """Open another motion in place of the first, which comes back at the end."""

    def replaced(motion):
        tab.set_input_files("#file", webpage.write_motion(motion, tmp_path / "other.json"))
        until(tab, f"viewer.motion.name === {json.dumps(motion.name)}")

    yield replaced
    replaced(scene)


@pytest.fixture
def refresh(tab, until):
    """Refresh the screen, in place of the browser: a function of the milliseconds since the last time."""
    until(tab, "!viewer.waiting")
    tab.evaluate(HOLD_SCREEN)
    yield lambda milliseconds: tab.evaluate("milliseconds => screen_refreshes(milliseconds)", milliseconds)
    tab.evaluate("window.requestAnimationFrame = browser_refreshes; viewer.waiting = false; viewer.redraw()")


def test_what_is_drawn_is_the_scene(tab, scene):
    """Joints are where the scene has them, in colours of left and right, with their ellipsoids."""
    shown = scene.at_most(60.0)
    for frame in (0, 22):
        tab.evaluate(f"viewer.frame = {frame}")
        for name in ("left_knee", "right_ankle", "neck"):
            x = tab.evaluate(JOINT, name)
            assert np.allclose(x, shown.centers[shown.joints.index(name), :, frame], atol=2e-4)
    blue, green = tab.evaluate(COLORS)
    assert blue > 300
    assert green > 100


def test_play_and_pause(tab, refresh):
    """Play moves the joints and the slider; pause stops them; at the end it stops by itself."""
    before = tab.evaluate(JOINT, "left_wrist")
    tab.locator("#play").click()
    assert tab.locator("#play").text_content() == "Pause"
    refresh(0)  # from which it counts
    refresh(100)
    assert tab.evaluate("viewer.frame") == 4  # of 45 in a second
    assert tab.locator("#frame").input_value() == "4"
    assert tab.evaluate(JOINT, "left_wrist") != before
    tab.locator("#play").click()
    assert tab.locator("#play").text_content() == "Play"
    refresh(100)
    assert tab.evaluate("viewer.frame") == 4
    tab.select_option("#speed", "4")
    tab.locator("#play").click()
    refresh(0)
    refresh(200)
    assert tab.evaluate("viewer.frame") == 40
    refresh(100)
    assert not tab.evaluate("viewer.playing")
    assert tab.evaluate("viewer.frame") == 44
    assert tab.locator("#play").text_content() == "Play"
    tab.select_option("#speed", "1")


def test_scrub(tab, refresh):
    """The slider shows its frame, with the time; so do the arrow keys."""
    tab.locator("#frame").fill("30")
    assert tab.evaluate("viewer.frame") == 30
    assert tab.locator("#clock").text_content() == "0.67 of 0.98 s"
    tab.locator("#canvas").focus()
    tab.keyboard.press("ArrowLeft")
    assert tab.evaluate("viewer.frame") == 29
    tab.keyboard.press(" ")
    assert tab.evaluate("viewer.playing")
    refresh(100)
    tab.keyboard.press(" ")
    assert not tab.evaluate("viewer.playing")


def test_orbit(tab, until, scene):
    """Dragging rotates the view; the wheel zooms; a side can be chosen, from the front with the left on the right."""
    where = "viewer.stage.camera.position.toArray()"
    distance = "viewer.stage.camera.position.distanceTo(viewer.stage.orbit.target)"
    before, far = tab.evaluate(where), tab.evaluate(distance)
    tab.mouse.move(500, 300)
    tab.mouse.down()
    tab.mouse.move(620, 300, steps=3)
    tab.mouse.up()
    assert np.linalg.norm(np.subtract(tab.evaluate(where), before)) > 0.5
    assert tab.evaluate(distance) == pytest.approx(far)
    tab.mouse.wheel(0, -300)
    until(tab, f"{distance} < {0.95 * far}")
    tab.select_option("#view", "top")
    x, y, z = np.subtract(tab.evaluate(where), tab.evaluate("viewer.stage.orbit.target.toArray()"))
    assert z > 20 * np.hypot(x, y)
    tab.select_option("#view", "front")
    hips = [scene.joints.index(name) for name in ("left_hip", "right_hip")]
    left, right = (tab.evaluate(f"viewer.stage.seen(viewer.stage.point({i}), 100, 100).x") for i in hips)
    assert left > right


def test_switches(tab, until):
    """Markers, ellipsoids and names go and come back, by mouse and by key; ellipsoids grow by their factor."""
    tab.evaluate("viewer.frame = 1")
    tab.uncheck("#markers")
    assert not tab.evaluate("viewer.stage.markers.visible")
    tab.uncheck("#ellipsoids")
    blue, green = tab.evaluate(COLORS)
    assert blue > 300
    assert green < 30
    tab.uncheck("#labelled")
    until(tab, "[...document.querySelectorAll('#labels span')].every(e => e.hidden)")
    tab.locator("#canvas").focus()
    for key in "men":
        tab.keyboard.press(key)
    assert tab.evaluate("viewer.stage.markers.visible")
    until(tab, "[...document.querySelectorAll('#labels span')].some(e => !e.hidden)")
    before = tab.evaluate("viewer.stage.ellipsoids[0].scale.x / viewer.stage.factor")
    tab.select_option("#factor", "10")
    assert tab.evaluate("viewer.stage.ellipsoids[0].scale.x") == pytest.approx(10 * before)


def test_what_is_bridged_or_doubtful(tab, scene):
    """Frames that are bridged say so, bones to such a joint are faint; doubts are in the panel and at a glance.

    A banner counts the joints in doubt, with their reasons behind it; their balls are larger.
    """
    name = scene.joints[3]
    assert tab.locator("#state").text_content() == ""
    tab.evaluate("viewer.frame = 22")
    assert tab.locator("#state").text_content() == f"{name.replace('_', ' ')} bridged"
    pairs = [n for n, bone in enumerate(scene.bones) if 3 in bone]
    assert tab.evaluate(f"viewer.stage.bones[{pairs[0]}].material.opacity") < 1
    assert "neck: moved too little" in tab.locator("#notes").text_content()
    assert "true joints" in tab.locator("#source").text_content()
    banner = tab.locator("#doubts")
    assert banner.is_visible()
    assert re.fullmatch(r"1 of \d+ joints doubtful: neck", banner.text_content())
    assert banner.get_attribute("title") == "* neck: moved too little"
    sizes = dict(tab.evaluate("viewer.motion.joints.map((j, i) => [j.name, viewer.stage.joints[i].scale.x])"))
    assert sizes["neck"] > 1.5 * sizes["left_knee"]


def test_the_close_button_does_not_wrap(tab):
    """Its one word stays on one line beside a message that fills the box."""
    tab.evaluate("say('many words '.repeat(40))")
    lines = "(r => { r.selectNodeContents($('dismiss')); return r.getClientRects().length; })(document.createRange())"
    assert tab.evaluate(lines) == 1
    assert tab.evaluate("$('dismiss').scrollWidth <= $('dismiss').clientWidth")
    tab.evaluate("say('')")


def test_two_motions(tab, until, scene, tmp_path):
    """A second motion is drawn over the first, with distances between joints of one name, or beside it, or removed."""
    shift = np.array([0.03, 0.0, 0.04])[:, None]
    other = replace(scene, centers=scene.centers + shift, ends=scene.ends + shift, places=scene.places + shift)
    tab.set_input_files("#second", webpage.write_motion(other, tmp_path / "second.json"))
    until(tab, "viewer.ghost.motion !== null")
    tab.evaluate("viewer.frame = 7")
    assert re.match(r"from the other: [a-z ]+ 50 mm, [a-z ]+ 50 mm, ", tab.locator("#other").text_content())
    there = "viewer.ghost.joints[0].getWorldPosition(new THREE.Vector3()).toArray()"
    tab.evaluate("viewer.stage.scene.updateMatrixWorld()")
    assert np.allclose(tab.evaluate(there), other.at_most(60.0).centers[0, :, 7], atol=2e-4)
    tab.select_option("#where", "beside")
    tab.evaluate("viewer.stage.scene.updateMatrixWorld()")
    away = np.subtract(tab.evaluate(there), other.at_most(60.0).centers[0, :, 7])
    assert np.linalg.norm(away) == pytest.approx(1.2, abs=1e-3)
    assert tab.evaluate("viewer.motion.frames") == 45
    tab.select_option("#where", "none")
    assert tab.locator("#other").text_content() == ""
    assert not tab.locator("#where").is_visible()


def test_a_motion_starts_where_its_joints_are_known(tab, scene, another):
    """The first frames show nothing, and the next are bridged: the page starts after them."""
    flags = scene.flags.copy()
    flags[:, :20], flags[:, 20:30] = 2, 1
    another(replace(scene, flags=flags, name="later"))
    assert tab.evaluate("viewer.frame") == 15  # of every second frame


WITHOUT_WEBGL = """const get = HTMLCanvasElement.prototype.getContext; HTMLCanvasElement.prototype.getContext =
    function (kind, ...rest) { return kind.startsWith('webgl') ? null : get.call(this, kind, ...rest); }"""


def test_without_webgl(show, scene, tmp_path):
    """A browser without WebGL draws the same on a plain canvas: as much of each colour, and the neck at its place."""
    file, found = webpage.write_viewer(scene, tmp_path / "viewer.html"), []
    for first in ("", WITHOUT_WEBGL):
        tab, said = show(file, first)
        assert tab.evaluate("viewer.stage.renderer instanceof FlatRenderer") or not first
        found.append(tab.evaluate(COLORS))
        if first:
            tab.uncheck("#ellipsoids")
            assert tab.evaluate(NECK) == [194, 24, 126, 255]  # of a joint in doubt
        # the test itself reads the canvas more than once, on which the browser remarks
        assert [words for words in said if "getImageData" not in words] == []
        tab.close()
    assert np.all(np.abs(np.log(np.divide(*found))) < np.log(1.6)), found  # there is no light, so more counts as blue


def test_another_motion(tab, scene, another):
    """The file menu opens another motion, which replaces the first; markup in its name stays text."""
    another(replace(scene.part(slice(0, 20)), name="<b>another</b>"))
    assert tab.evaluate("viewer.motion.frames") == 10
    assert tab.locator("#name").text_content() == "<b>another</b>"
    assert tab.locator("#frame").get_attribute("max") == "9"
    assert not tab.locator("#message").is_visible()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: "not { json", "it is not JSON; open a motion.json"),
        (lambda d: "[1, 2]", "it is JSON, but not a motion"),
        (lambda d: "null", "it is JSON, but not a motion"),
        (lambda d: d | {"version": 99}, "its version is 99, but this page reads version 1"),
        (lambda d: d | {"frames": 46}, 'its array "markers" has'),
        (lambda d: d | {"frames": -1}, "its number of frames is -1"),
        (lambda d: d | {"rate": 0}, "its rate is 0"),
        (lambda d: d | {"bones": [[0, 99]]}, "a bone is not between two of its"),
        (lambda d: d | {"joints": []}, "its markers, joints or tips are missing"),
        (lambda d: d | {"arrays": d["arrays"] | {"turns": "!"}}, 'its array "turns" is not base64'),
        (lambda d: d | {"arrays": d["arrays"] | {"flags": "A" * 40}}, 'its array "flags" has 30 bytes'),
        (lambda d: {k: v for k, v in d.items() if k != "arrays"}, 'its array "markers" is missing'),
    ],
)
def test_a_file_that_is_no_motion(tab, until, scene, change, words):
    """A message gives the file and the fault; the shown motion stays."""
    changed = change(webpage.motion_document(scene))
    text = changed if isinstance(changed, str) else json.dumps(changed)
    tab.set_input_files("#file", {"name": "bad.json", "mimeType": "application/json", "buffer": text.encode()})
    until(tab, "!document.getElementById('message').hidden")
    said = tab.locator("#words").text_content()
    assert said.startswith(f"bad.json cannot be opened: {words}"), said
    assert tab.evaluate("viewer.motion.frames") == 45
    tab.locator("#dismiss").click()
    assert not tab.locator("#message").is_visible()


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (768, 900), (360, 640)])
def test_on_screens(tab, until, width, height):
    """On a desk, a tablet and a phone the page fits, its controls are reached, and no name covers another."""
    tab.set_viewport_size({"width": width, "height": height})
    tab.evaluate("viewer.resize(); viewer.stage.look(''); viewer.redraw()")
    until(tab, "!viewer.waiting")
    assert tab.evaluate(OVERFLOW) <= 0
    for control in ("play", "frame", "speed", "markers", "ellipsoids", "labelled", "open", "compare"):
        box = tab.locator(f"#{control}").bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width
        assert box["y"] + box["height"] <= height
    assert tab.locator("#stage").bounding_box()["height"] > 0.5 * height
    assert tab.evaluate(COVERED) == []


def test_no_script_but_its_own_runs(show, scene, tmp_path):
    """Scripts that were put into the page, as an element or as an attribute, are refused; the page works."""
    file = webpage.write_viewer(scene, tmp_path / "viewer.html")
    foreign = '<script>window.foreign = 1</script><img src="x" onerror="window.foreign = 2">\n</body>'
    file.write_text(file.read_text(encoding="utf-8").replace("</body>", foreign), encoding="utf-8")
    tab, said = show(file)
    assert tab.evaluate("[window.foreign === undefined, viewer.motion.frames]") == [True, 45]
    assert sum("Content Security Policy" in text for text in said) >= 2
    tab.evaluate("const s = document.createElement('script'); s.text = 'window.foreign = 3'; document.body.append(s)")
    assert tab.evaluate("window.foreign === undefined")


@pytest.fixture(scope="module")
def page(scene):
    """The page of the synthetic scene."""
    return webpage.viewer_page(scene)


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


def test_the_library_is_said(page, scene):
    """The page has three.js, its release as the library itself says it, and its licence; made twice, it is the same."""
    assert webpage.viewer_page(scene) == page
    assert f'revision:"{webpage.THREE.split(".")[1]}"' in page
    assert f"three.js {webpage.THREE}, MIT licence" in page
    assert "Copyright © 2010-2026 three.js authors" in page
    assert "The above copyright notice and this permission notice shall be included" in page


def test_names_are_text(scene):
    """Names that look like markup stay names, in the title and in the motion."""
    name = "</script><img src=x onerror=alert(1)> & <!-- {{ 7 * 7 }}"
    page = webpage.viewer_page(replace(scene, name=name))
    assert "<img" not in page
    assert page.count("</script>") == 3
    assert "<title>&lt;/script&gt;&lt;img" in page
    assert embedded(page)["name"] == name


def test_the_motion(scene, page):
    """The page holds the scene, to a step of a tenth of a millimetre, at sixty frames per second at most."""
    document, shown = embedded(page), scene.at_most(60.0)
    assert (document["format"], document["frames"], document["rate"]) == (webpage.FORMAT, 45, 45.0)
    assert document["step"] < 1e-4
    for name, places in (("markers", shown.places), ("points", shown.points)):
        counts = numbers(document, name).reshape(45, -1, 3).transpose(1, 2, 0)
        assert np.array_equal(counts == webpage.MISSING, np.isnan(places))
        found = np.where(
            counts == webpage.MISSING, np.nan, np.array(document["origin"])[:, None] + document["step"] * counts
        )
        assert np.nanmax(abs(found - places)) <= 0.5 * document["step"] + 1e-6
    flags = numbers(document, "flags", "u1").reshape(45, -1)
    assert np.array_equal(flags.T, shown.flags)
    turns = numbers(document, "turns").reshape(45, -1, 4)[7, 2] / 32767
    between = Rotation.from_quat(turns) * Rotation.from_quat(shown.orientations[2, 7]).inv()
    assert between.magnitude() < 1e-4
    half = np.array([joint["half_axes"] for joint in document["joints"]], dtype=float)
    assert np.allclose(np.nan_to_num(half), half_axes(shown), atol=1e-6)
    assert np.array_equal(np.isnan(half), np.isnan(shown.errors))


def test_anatomical_axes_are_drawn(show, tmp_path):
    """Three rods at each joint of the legs, 12 cm along the child's axes, and between the hips along the pelvis'."""
    recording, _ = synthesize(Recipe(240, 60.0, markers="rizzoli"))
    joints = api.find_joints(recording)
    drawn = draw_skeleton(joints, recording)
    scene = skeleton_scene(drawn, recording)
    tab, said = show(webpage.write_viewer(scene, tmp_path / "viewer.html"))
    tab.evaluate("viewer.playing = false; viewer.frame = 100")
    for number, name in enumerate(scene.joints):
        places = tab.evaluate(f"viewer.stage.triads[{number}].map(rod => rod.visible ? rod.position.toArray() : null)")
        if name == "waist":
            assert places == [None] * 3
            continue
        child = joints[name].joint.child
        axes = drawn.rotation(child)[:, :, 100] @ joints.shape(child).anatomy
        assert np.allclose(places, scene.centers[number, :, 100] + 0.06 * axes.T, atol=3e-4), name
    middle = np.mean([scene.centers[scene.joints.index(f"{one}_hip"), :, 100] for one in ("left", "right")], axis=0)
    axes = drawn.rotation("pelvis")[:, :, 100] @ joints.shape("pelvis").anatomy
    (places,) = tab.evaluate("viewer.stage.rootTriads.map(rods => rods.map(rod => rod.position.toArray()))")
    assert np.allclose(places, middle + 0.06 * axes.T, atol=3e-4)
    assert "anatomical axis x, forward" in tab.text_content("#legend")
    assert said == []


def test_fewer_frames_and_strict_numbers(scene):
    """A page of fewer frames per second is the same motion at the same speed; one without samples is strict JSON."""
    assert embedded(webpage.viewer_page(scene, rate=30.0))["frames"] == 30
    places = scene.places.copy()
    places[:, :, 5:9] = np.nan
    unknown = replace(scene, places=places, errors=np.full_like(scene.errors, np.nan))
    json.dumps(webpage.motion_document(unknown), allow_nan=False)


def test_writing(scene, tmp_path):
    """Page and motion are written whole, into a folder that is made; a failure gives one line."""
    path = webpage.write_viewer(scene, tmp_path / "new" / "viewer.html")
    assert embedded(path.read_text(encoding="utf-8")) == json.loads(
        webpage.write_motion(scene, tmp_path / "new" / "motion.json").read_text(encoding="utf-8")
    )
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == ["motion.json", "viewer.html"]
    with pytest.raises(RunError, match=r"viewer\.html: cannot be written: "):
        webpage.write_viewer(scene, path / "viewer.html")
