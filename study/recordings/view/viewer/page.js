// The page: its controls, its clock, and the opening of files.

const FACTORS = [1, 2, 3, 5, 10, 20, 30, 50, 100];
const UNKNOWN = 2;

const $ = (id) => document.getElementById(id);

function say(words) {
    $("words").textContent = words;
    $("message").hidden = words === "";
}

class Player {
    constructor(stage, labels) {
        this.stage = stage;
        this.labels = labels;
        this.ghost = new Ghost(stage);
        this.playing = false;
        this.time = 0; // seconds from the start of the motion
        this.waiting = false;
        stage.orbit.addEventListener("change", () => this.redraw());
        // a rotation by hand ends the chosen view
        stage.orbit.addEventListener("start", () => { $("view").value = ""; });
        new ResizeObserver(() => this.resize()).observe($("stage"));
    }

    load(motion) {
        this.motion = motion;
        this.playing = false;
        this.time = firstShown(motion) / motion.rate;
        this.resize();
        this.labels.load(motion);
        this.stage.follows = $("follow").checked;
        this.stage.load(motion);
        $("frame").max = motion.frames - 1;
        $("view").value = "";
        document.title = motion.name;
        describe(motion);
        this.update();
    }

    get frame() {
        return Math.min(Math.floor(this.time * this.motion.rate + 1e-6), this.motion.frames - 1);
    }

    set frame(value) {
        this.time = Math.min(Math.max(value, 0), this.motion.frames - 1) / this.motion.rate;
        this.update();
    }

    toggle(playing = !this.playing) {
        this.playing = playing;
        if (playing && this.frame === this.motion.frames - 1) this.time = 0;
        this.last = null;
        this.update();
    }

    // Draws once at the next refresh of the screen; while playing, at each.
    redraw() {
        if (this.waiting) return;
        this.waiting = true;
        requestAnimationFrame((now) => {
            this.waiting = false;
            if (this.playing) this.advance(now);
            const box = $("stage").getBoundingClientRect();
            this.stage.draw();
            this.labels.place(this.stage, box.width, box.height);
            if (this.playing) this.redraw();
        });
    }

    advance(now) {
        const speed = Number($("speed").value);
        if (this.last !== null) this.time += (speed * Math.min(now - this.last, 250)) / 1000;
        this.last = now;
        if (this.time >= (this.motion.frames - 1) / this.motion.rate) {
            this.time = (this.motion.frames - 1) / this.motion.rate;
            this.playing = false;
        }
        this.update();
    }

    // Shows the current frame, and the state of the controls.
    update() {
        const { motion, stage } = this;
        const frame = this.frame;
        stage.show(frame);
        this.ghost.show(this.time);
        const apart = this.ghost.distances(this.time).slice(0, 3);
        $("other").textContent = apart.length ? `from the other: ${apart.map(([name, d]) => `${name.replaceAll("_", " ")} ${(1000 * d).toFixed(0)} mm`).join(", ")}` : "";
        $("frame").value = frame;
        $("frame").setAttribute("aria-valuetext", `${(frame / motion.rate).toFixed(2)} seconds`);
        $("clock").textContent = `${(frame / motion.rate).toFixed(2)} of ${((motion.frames - 1) / motion.rate).toFixed(2)} s`;
        $("play").textContent = this.playing ? "Pause" : "Play";
        $("play").setAttribute("aria-pressed", String(this.playing));
        const flags = motion.joints.map((joint, i) => [joint.name.replaceAll("_", " "), motion.flags[frame * motion.joints.length + i]]);
        const state = flags.filter(([, flag]) => flag).map(([name, flag]) => `${name} ${flag === UNKNOWN ? "unknown" : "bridged"}`).join(", ");
        if ($("state").textContent !== state) $("state").textContent = state;
        this.redraw();
    }

    resize() {
        const box = $("stage").getBoundingClientRect();
        if (!box.width || !box.height) return;
        this.stage.resize(box.width, box.height);
        if (this.motion) this.redraw();
    }
}

// The first frame in which the most joints are seen; of such frames the first with the most that are bridged.
function firstShown(motion) {
    const count = motion.joints.length;
    let [best, most] = [0, -1];
    for (let t = 0; t < motion.frames && most < count * (count + 1); t++) {
        let shown = 0;
        for (let i = 0; i < count; i++) shown += { 0: count + 1, [UNKNOWN]: 0 }[motion.flags[t * count + i]] ?? 1;
        if (shown > most) [best, most] = [t, shown];
    }
    return best;
}

// Shows the name, source, legend and notes of a motion in the panel.
function describe(motion) {
    $("name").textContent = motion.name;
    $("source").textContent = motion.source;
    const percent = Math.round(100 * motion.level);
    const legend = [
        [COLORS.sides.left, "left"], [COLORS.sides.right, "right"],
        [COLORS.ellipsoid, `${percent} % error ellipsoid of a joint; for a hinge a disc, and its axis`],
        [COLORS.marker, "marker"], [COLORS.flagged, "joint that is not reliable, or bridged in this frame"],
    ];
    if (motion.axes || motion.rootAxes) ["x, forward", "y, up", "z, to the right"].forEach((words, k) => legend.push([TRIAD[k], `anatomical axis ${words}`]));
    $("legend").replaceChildren(...legend.map(([color, words]) => {
        const item = document.createElement("li");
        const dot = document.createElement("i");
        dot.style.background = color;
        item.append(dot, words);
        return item;
    }));
    const doubts = motion.joints.filter((joint) => joint.doubt).map((joint) => `* ${joint.name.replaceAll("_", " ")}: ${joint.doubt}`);
    $("notes").replaceChildren(...[...doubts, ...motion.notes].map((words) => {
        const item = document.createElement("li");
        item.textContent = words;
        return item;
    }));
    const doubted = motion.joints.filter((joint) => joint.doubt).map((joint) => joint.name.replaceAll("_", " "));
    $("doubts").hidden = doubted.length === 0;
    $("doubts").textContent = `${doubted.length} of ${motion.joints.length} joints doubtful: ${doubted.slice(0, 4).join(", ")}${doubted.length > 4 ? ", …" : ""}`;
    $("doubts").title = doubts.join("\n");
    const factors = [...new Set([...FACTORS, motion.exaggeration])].sort((a, b) => a - b);
    $("factor").replaceChildren(...factors.map((factor) => new Option(`size ×${factor}`, factor, false, factor === motion.exaggeration)));
}

async function readFile(file) {
    try {
        const motion = readMotion(await file.text());
        say("");
        return motion;
    } catch (error) {
        const words = error instanceof MotionError ? error.message : "it cannot be read";
        say(`${file.name} cannot be opened: ${words}.`);
        return null;
    }
}

async function openFile(player, file) {
    const motion = await readFile(file);
    if (motion) player.load(motion);
}

// Opens a second motion over the first one.
async function compareFile(player, file) {
    const motion = await readFile(file);
    if (motion) compare(player, motion);
}

function compare(player, motion) {
    player.ghost.load(motion);
    player.ghost.beside = false;
    $("where").value = "over";
    $("against").hidden = motion === null;
    player.update();
}

function wire(player) {
    const { stage, labels } = player;
    const shows = {
        markers: (on) => { stage.shows.markers = on; },
        ellipsoids: (on) => { stage.shows.ellipsoids = on; },
        labelled: (on) => { labels.shown = on; },
        follow: (on) => { stage.follows = on; },
    };
    for (const [id, set] of Object.entries(shows)) {
        $(id).addEventListener("change", (event) => {
            set(event.target.checked);
            player.update();
        });
        set($(id).checked); // a browser may keep the state of the controls when it reloads the page
    }
    $("controls").addEventListener("submit", (event) => event.preventDefault());
    $("play").addEventListener("click", () => player.toggle());
    $("frame").addEventListener("input", (event) => {
        player.playing = false;
        player.frame = Number(event.target.value);
    });
    $("factor").addEventListener("change", (event) => {
        stage.factor = Number(event.target.value);
        player.update();
    });
    $("view").addEventListener("change", (event) => {
        stage.look(event.target.value);
        player.redraw();
    });
    $("open").addEventListener("click", () => $("file").click());
    $("file").addEventListener("change", async (event) => {
        const [file] = event.target.files;
        if (file) await openFile(player, file);
        event.target.value = ""; // else the same file could not be opened again
    });
    $("compare").addEventListener("click", () => $("second").click());
    $("second").addEventListener("change", async (event) => {
        const [file] = event.target.files;
        if (file) await compareFile(player, file);
        event.target.value = "";
    });
    $("where").addEventListener("change", (event) => {
        if (event.target.value === "none") return compare(player, null);
        player.ghost.beside = event.target.value === "beside";
        player.update();
    });
    document.addEventListener("dragover", (event) => event.preventDefault());
    document.addEventListener("drop", (event) => {
        event.preventDefault();
        const [file] = event.dataTransfer.files;
        if (file) openFile(player, file);
    });
    $("dismiss").addEventListener("click", () => say(""));
    document.addEventListener("keydown", (event) => onKey(player, event));
}

function onKey(player, event) {
    if (event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|SELECT|BUTTON|SUMMARY)$/.test(event.target.tagName)) return;
    const switches = { m: "markers", e: "ellipsoids", n: "labelled", f: "follow" };
    if (event.key === " ") player.toggle();
    else if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
        player.playing = false;
        player.frame = player.frame + (event.key === "ArrowLeft" ? -1 : 1);
    } else if (event.key.toLowerCase() in switches) $(switches[event.key.toLowerCase()]).click();
    else return;
    event.preventDefault();
}

function start() {
    let stage;
    try {
        stage = new Stage($("canvas"));
    } catch {
        say("This browser cannot draw: neither WebGL nor a plain canvas is there. Use another browser.");
        return;
    }
    const player = new Player(stage, new Labels($("labels"), $("leaders")));
    wire(player);
    try {
        player.load(readMotion($("motion").textContent));
    } catch (error) {
        if (!(error instanceof MotionError)) throw error;
        say(`The motion in this page cannot be shown: ${error.message}.`);
    }
    if (stage.isFlat) say("This browser offers no WebGL: bones and joints are drawn flat, and slowly.");
    window.viewer = player; // for the tests of this page, and for the console
}

start();
