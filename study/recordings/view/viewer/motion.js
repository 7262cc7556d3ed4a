// Reads a motion from JSON into plain arrays. Each part is checked, and a message says which is wrong.

const FORMAT = "sphere-fit-study motion";
const VERSION = 1;
const MISSING = -32768;
const LARGEST = 32767;

class MotionError extends Error {}

function demand(holds, words) {
    if (!holds) throw new MotionError(words);
}

function isCount(value) {
    return Number.isInteger(value) && value >= 0;
}

function isTexts(value) {
    return Array.isArray(value) && value.every((text) => typeof text === "string");
}

// Numbers in a base64 text: `count` of them, of `bytes` bytes each.
function unpacked(arrays, name, bytes, count) {
    const text = arrays && arrays[name];
    demand(typeof text === "string", `its array "${name}" is missing`);
    let raw;
    try {
        raw = atob(text);
    } catch {
        throw new MotionError(`its array "${name}" is not base64; the file is damaged`);
    }
    demand(raw.length === bytes * count, `its array "${name}" has ${raw.length} bytes instead of ${bytes * count}; the file is cut short or damaged`);
    const view = new DataView(Uint8Array.from(raw, (c) => c.charCodeAt(0)).buffer);
    return bytes === 1 ? new Uint8Array(view.buffer) : Int16Array.from({ length: count }, (_, i) => view.getInt16(2 * i, true));
}

// Counts of a step as metres; NaN if unknown.
function metres(counts, step, origin) {
    return Float32Array.from(counts, (n, i) => (n === MISSING ? NaN : origin[i % 3] + step * n));
}

const ratio = (n) => (n === MISSING ? NaN : n / LARGEST);

// Quaternions of axes that a file may have; null without.
function turns(arrays, name, count) {
    return arrays && name in arrays ? Float32Array.from(unpacked(arrays, name, 2, 4 * count), ratio) : null;
}

// Reads a motion. Throws a MotionError, whose message follows the name of the file.
function readMotion(text) {
    let d;
    try {
        d = JSON.parse(text);
    } catch {
        throw new MotionError("it is not JSON; open a motion.json that `study skeleton` wrote");
    }
    demand(d !== null && typeof d === "object" && d.format === FORMAT, `it is JSON, but not a motion (its "format" is not "${FORMAT}"); open a motion.json that \`study skeleton\` wrote`);
    demand(d.version === VERSION, `its version is ${d.version}, but this page reads version ${VERSION}; write the older of page and file again with \`study skeleton\``);
    demand(isCount(d.frames) && d.frames > 0, `its number of frames is ${d.frames}`);
    demand(Number.isFinite(d.rate) && d.rate > 0, `its rate is ${d.rate} frames per second`);
    demand(isTexts(d.markers) && isTexts(d.tips) && Array.isArray(d.joints) && d.joints.length > 0, "its markers, joints or tips are missing");
    demand(d.joints.every((joint) => joint && typeof joint.name === "string" && Array.isArray(joint.half_axes) && joint.half_axes.length === 3), "a joint has no name or no half axes");
    const points = d.joints.length + d.tips.length;
    demand(Array.isArray(d.bones) && d.bones.every((pair) => Array.isArray(pair) && pair.length === 2 && pair.every((i) => isCount(i) && i < points)), `a bone is not between two of its ${points} points`);
    demand(Number.isFinite(d.step) && Array.isArray(d.origin) && d.origin.length === 3 && d.origin.every(Number.isFinite), "its step or origin is missing");
    const joints = d.joints.length;
    const roots = d.roots ?? []; // older files have none
    demand(Array.isArray(roots) && roots.every((ends) => Array.isArray(ends) && ends.length && ends.every((i) => isCount(i) && i < joints)), `a root is not between its ${joints} joints`);
    const motion = {
        name: String(d.name ?? "motion"),
        source: String(d.source ?? ""),
        notes: isTexts(d.notes) ? d.notes : [],
        rate: d.rate,
        frames: d.frames,
        floor: Number.isFinite(d.floor) ? d.floor : 0,
        level: Number.isFinite(d.level) ? d.level : 0.95,
        exaggeration: Number.isFinite(d.exaggeration) && d.exaggeration > 0 ? d.exaggeration : 1,
        markers: d.markers,
        joints: d.joints.map((joint) => ({
            name: joint.name,
            doubt: String(joint.doubt ?? ""),
            half: joint.half_axes.map((x) => (Number.isFinite(x) ? x : NaN)),
            errors: Array.isArray(joint.errors) ? joint.errors : [],
        })),
        tips: d.tips,
        sides: isTexts(d.sides) && d.sides.length === points ? d.sides : Array(points).fill(""),
        bones: d.bones,
        places: metres(unpacked(d.arrays, "markers", 2, 3 * d.frames * d.markers.length), d.step, d.origin),
        points: metres(unpacked(d.arrays, "points", 2, 3 * d.frames * points), d.step, d.origin),
        turns: Float32Array.from(unpacked(d.arrays, "turns", 2, 4 * d.frames * joints), ratio),
        axes: turns(d.arrays, "axes", d.frames * joints),
        roots,
        rootAxes: turns(d.arrays, "root_axes", d.frames * roots.length),
        flags: unpacked(d.arrays, "flags", 1, d.frames * joints),
    };
    motion.count = points;
    motion.middle = smoothMiddle(motion);
    return motion;
}

// The middle of the skeleton, averaged over a second and a half (frames × 3); the view follows it.
function smoothMiddle(motion) {
    const { frames, count, points } = motion;
    const sums = new Float64Array(3 * (frames + 1));
    let last = [0, 0, 0.9];
    for (let t = 0; t < frames; t++) {
        const sum = [0, 0, 0];
        let known = 0;
        for (let i = 0; i < count; i++) {
            const at = 3 * (t * count + i);
            if (Number.isNaN(points[at])) continue;
            known++;
            for (let k = 0; k < 3; k++) sum[k] += points[at + k];
        }
        if (known) last = sum.map((x) => x / known);
        for (let k = 0; k < 3; k++) sums[3 * (t + 1) + k] = sums[3 * t + k] + last[k];
    }
    const half = Math.max(Math.round(0.75 * motion.rate), 1);
    const middle = new Float32Array(3 * frames);
    for (let t = 0; t < frames; t++) {
        const from = Math.max(t - half, 0);
        const to = Math.min(t + half + 1, frames);
        for (let k = 0; k < 3; k++) middle[3 * t + k] = (sums[3 * to + k] - sums[3 * from + k]) / (to - from);
    }
    return middle;
}
