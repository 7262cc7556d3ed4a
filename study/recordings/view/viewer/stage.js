// The scene in three.js: bones, joints, markers, ellipsoids and floor of one motion, moved frame by frame.

const ROD = 0.06; // distance from a hinge to either end of the line along its axis, metres
const AXIS = 0.12; // length of an anatomical axis, metres
const TRIAD = ["#c0392b", "#2e8b57", "#2f5fa8"]; // x forward, y up, z to the right
const SQUARE = 0.5; // distance between the lines on the floor, metres

// Places a rod between two points; it is hidden if either is unknown.
function placeRod(drawn, a, b, radius) {
    const along = b.clone().sub(a);
    const length = along.length();
    drawn.visible = length > 0;
    if (!drawn.visible) return;
    drawn.position.addVectors(a, b).multiplyScalar(0.5);
    drawn.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), along.divideScalar(length));
    drawn.scale.set(radius, radius, length);
}

class Stage {
    constructor(canvas) {
        try {
            if (!document.createElement("canvas").getContext("webgl2")) throw new Error("no WebGL");
            // the buffer is kept, for a browser that paints the page again without asking
            this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
        } catch {
            this.renderer = new FlatRenderer(canvas);
            this.isFlat = true;
        }
        this.renderer.setClearColor(0xffffff);
        this.scene = new THREE.Scene();
        this.camera = new THREE.PerspectiveCamera(30, 1, 0.05, 200);
        this.camera.up.set(0, 0, 1);
        this.orbit = new THREE.OrbitControls(this.camera, canvas);
        this.orbit.minDistance = 0.3;
        this.orbit.maxDistance = 60;
        this.scene.add(new THREE.HemisphereLight(0xffffff, 0xb0b4b8, 2.4));
        const sun = new THREE.DirectionalLight(0xffffff, 1.3);
        sun.position.set(2, -3, 5);
        this.scene.add(sun);
        this.ball = new THREE.SphereGeometry(1, 24, 16);
        this.rod = new THREE.CylinderGeometry(1, 1, 1, 14).rotateX(Math.PI / 2); // along z
        const solid = this.solid = (color, opacity = 1) => new THREE.MeshLambertMaterial({ color, transparent: opacity < 1, opacity, depthWrite: opacity === 1 });
        this.materials = {
            bones: Object.fromEntries(Object.entries(COLORS.sides).map(([side, color]) => [side, solid(color)])),
            bridged: Object.fromEntries(Object.entries(COLORS.sides).map(([side, color]) => [side, solid(color, 0.35)])),
            joint: solid(COLORS.sides[""]),
            flagged: solid(COLORS.flagged),
            marker: solid(COLORS.marker),
            ellipsoid: solid(COLORS.ellipsoid, 0.42),
            axis: solid(COLORS.ellipsoid),
        };
        this.body = null;
        this.factor = 1;
        this.shows = { markers: true, ellipsoids: true };
        this.frame = 0;
    }

    // Replaces the motion.
    load(motion) {
        if (this.body) {
            this.scene.remove(this.body);
            this.markers?.dispose();
            this.floor.geometry.dispose();
        }
        this.motion = motion;
        this.factor = motion.exaggeration;
        this.body = new THREE.Group();
        const mesh = (geometry, material) => {
            const made = new THREE.Mesh(geometry, material);
            this.body.add(made);
            return made;
        };
        this.bones = motion.bones.map(() => mesh(this.rod, this.materials.joint));
        this.joints = motion.joints.map(() => mesh(this.ball, this.materials.joint));
        this.tips = motion.tips.map(() => mesh(this.ball, this.materials.joint));
        this.ellipsoids = motion.joints.map((joint) => (joint.half.some((x) => x > 0) ? mesh(this.ball, this.materials.ellipsoid) : null));
        const triads = (owners, axes) => owners.map(() => (axes ? TRIAD.map((color) => mesh(this.rod, this.solid(color))) : []));
        this.triads = triads(motion.joints, motion.axes);
        this.rootTriads = triads(motion.roots, motion.rootAxes);
        this.axes = motion.joints.map((joint) => (this.isHinge(joint) ? mesh(this.rod, this.materials.axis) : null));
        this.markers = null;
        if (motion.markers.length) {
            this.markers = new THREE.InstancedMesh(this.ball, this.materials.marker, motion.markers.length);
            this.markers.frustumCulled = false;
            this.body.add(this.markers);
        }
        this.floor = this.grid();
        this.body.add(this.floor);
        this.scene.add(this.body);
        this.size = this.reach();
        this.show(0);
        this.look("");
    }

    isHinge(joint) {
        return Number.isNaN(joint.half[2]) && joint.half[0] > 0;
    }

    // A point in a frame, by its number: joints first, then tips.
    point(i, frame = this.frame) {
        const at = 3 * (frame * this.motion.count + i);
        return new THREE.Vector3(...this.motion.points.subarray(at, at + 3));
    }

    middle(frame = this.frame) {
        return new THREE.Vector3(...this.motion.middle.subarray(3 * frame, 3 * frame + 3));
    }

    isFlagged(i, frame = this.frame) {
        return this.motion.joints[i].doubt !== "" || this.motion.flags[frame * this.motion.joints.length + i] !== 0;
    }

    // Shows a frame.
    show(frame) {
        const { motion } = this;
        const before = this.middle();
        this.frame = frame;
        const points = Array.from({ length: motion.count }, (_, i) => this.point(i));
        motion.bones.forEach(([i, j], n) => this.bone(this.bones[n], i, j, points));
        points.forEach((x, i) => {
            const isJoint = i < motion.joints.length;
            const drawn = isJoint ? this.joints[i] : this.tips[i - motion.joints.length];
            // without a known joint, the end of a limb is hidden
            drawn.visible = !Number.isNaN(x.x) && (isJoint || motion.bones.some((pair, n) => pair.includes(i) && this.bones[n].visible));
            drawn.position.copy(x);
            const doubted = isJoint && motion.joints[i].doubt !== "";
            drawn.scale.setScalar(doubted ? 0.03 : isJoint ? 0.017 : 0.012);
            if (isJoint) drawn.material = this.isFlagged(i) ? this.materials.flagged : this.materials.joint;
        });
        motion.joints.forEach((joint, i) => this.ellipsoid(joint, i, points[i]));
        this.triads.forEach((rods, i) => this.triad(rods, motion.axes, frame * motion.joints.length + i, points[i]));
        this.rootTriads.forEach((rods, r) => {
            const middle = new THREE.Vector3();
            for (const i of motion.roots[r]) middle.addScaledVector(points[i], 1 / motion.roots[r].length);
            this.triad(rods, motion.rootAxes, frame * motion.roots.length + r, middle);
        });
        if (this.markers) this.placeMarkers();
        if (this.follows) {
            const moved = this.middle().sub(before);
            this.camera.position.add(moved);
            this.orbit.target.add(moved);
        }
    }

    bone(drawn, i, j, points) {
        placeRod(drawn, points[i], points[j], 0.011);
        if (!drawn.visible) return;
        const sides = [...new Set([this.motion.sides[i], this.motion.sides[j]].filter(Boolean))];
        const side = sides.length === 1 && sides[0] in COLORS.sides ? sides[0] : "";
        const count = this.motion.joints.length;
        const bridged = [i, j].some((k) => k < count && this.motion.flags[this.frame * count + k] !== 0);
        drawn.material = (bridged ? this.materials.bridged : this.materials.bones)[side];
    }

    ellipsoid(joint, i, x) {
        const at = 4 * (this.frame * this.motion.joints.length + i);
        const turn = new THREE.Quaternion(...this.motion.turns.subarray(at, at + 4));
        const known = this.shows.ellipsoids && !Number.isNaN(x.x) && !Number.isNaN(turn.x);
        for (const drawn of [this.ellipsoids[i], this.axes[i]]) {
            if (!drawn) continue;
            drawn.visible = known;
            if (!known) continue;
            drawn.position.copy(x);
            drawn.quaternion.copy(turn).normalize();
        }
        this.ellipsoids[i]?.scale.set(...joint.half.map((h) => Math.max(this.factor * (h > 0 ? h : 0), 0.0005)));
        this.axes[i]?.scale.set(0.003, 0.003, 2 * ROD);
    }

    // Anatomical axes x, y, z from a point: the n-th quaternion of a motion's.
    triad(rods, axes, n, x) {
        const turn = rods.length ? new THREE.Quaternion(...axes.subarray(4 * n, 4 * n + 4)).normalize() : null;
        rods.forEach((rod, k) => {
            const end = new THREE.Vector3().setComponent(k, AXIS).applyQuaternion(turn).add(x);
            if (Number.isNaN(end.x)) rod.visible = false;
            else placeRod(rod, x, end, 0.004);
        });
    }

    placeMarkers() {
        const { motion } = this;
        this.markers.visible = this.shows.markers;
        const matrix = new THREE.Matrix4();
        motion.markers.forEach((_, m) => {
            const [x, y, z] = motion.places.subarray(3 * (this.frame * motion.markers.length + m), 3 * (this.frame * motion.markers.length + m) + 3);
            const size = Number.isNaN(x) ? 0 : 0.0085;
            matrix.makeScale(size, size, size);
            if (size) matrix.setPosition(x, y, z);
            this.markers.setMatrixAt(m, matrix);
        });
        this.markers.instanceMatrix.needsUpdate = true;
    }

    // Radius of the sphere about the middle that contains the skeleton in nearly all frames, metres.
    reach() {
        const far = [];
        const step = Math.max(Math.floor(this.motion.frames / 200), 1);
        for (let t = 0; t < this.motion.frames; t += step) {
            const middle = this.middle(t);
            const away = Array.from({ length: this.motion.count }, (_, i) => this.point(i, t).distanceTo(middle)).filter((d) => !Number.isNaN(d));
            if (away.length) far.push(Math.max(...away));
        }
        far.sort((a, b) => a - b);
        return (far.length ? far[Math.floor(0.9 * (far.length - 1))] : 1) + 0.15;
    }

    // Shows the whole skeleton from a side: "front", "side", "back" or "top"; "" for the default direction.
    look(view) {
        const angles = { front: [0, 6], side: [-90, 6], back: [180, 6], top: [0, 89] }[view] ?? [35, 14];
        const facing = view ? this.facing() : this.facing(0);
        const [azimuth, elevation] = [facing + (angles[0] * Math.PI) / 180, (angles[1] * Math.PI) / 180];
        // a body is usually taller than wide, and the names beside it need room
        const narrow = Math.min(1.3 * this.camera.aspect, 1);
        const distance = (0.84 * this.size) / Math.sin((this.camera.fov / 2) * (Math.PI / 180)) / narrow;
        this.orbit.target.copy(this.middle());
        const flat = Math.cos(elevation);
        const away = new THREE.Vector3(flat * Math.cos(azimuth), flat * Math.sin(azimuth), Math.sin(elevation));
        this.camera.position.copy(this.orbit.target).addScaledVector(away, distance);
        this.orbit.update();
    }

    // Heading of the body, radians from x to y: at right angles to the mean direction from right points to left ones.
    facing(frame = this.frame) {
        const across = new THREE.Vector3();
        this.motion.sides.forEach((side, i) => {
            const x = this.point(i, frame);
            if (side && !Number.isNaN(x.x)) across.addScaledVector(x, side === "left" ? 1 : -1);
        });
        return across.x || across.y ? Math.atan2(across.y, across.x) - Math.PI / 2 : 0;
    }

    grid() {
        const { motion } = this;
        let [low, high] = [[Infinity, Infinity], [-Infinity, -Infinity]];
        for (let i = 0; i < motion.points.length; i += 3) {
            for (let k = 0; k < 2; k++) {
                const x = motion.points[i + k];
                if (x < low[k]) low[k] = x;
                if (x > high[k]) high[k] = x;
            }
        }
        const cell = Math.max(SQUARE, Math.ceil(Math.max(high[0] - low[0], high[1] - low[1]) / (60 * SQUARE)) * SQUARE);
        low = low.map((x) => Math.floor(x / cell - 1) * cell);
        high = high.map((x) => Math.ceil(x / cell + 1) * cell);
        const ends = [];
        for (let x = low[0]; x <= high[0] + 1e-6; x += cell) ends.push(x, low[1], motion.floor, x, high[1], motion.floor);
        for (let y = low[1]; y <= high[1] + 1e-6; y += cell) ends.push(low[0], y, motion.floor, high[0], y, motion.floor);
        const geometry = new THREE.BufferGeometry();
        geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(ends), 3));
        this.gridMaterial ??= new THREE.LineBasicMaterial({ color: COLORS.floor });
        return new THREE.LineSegments(geometry, this.gridMaterial);
    }

    resize(width, height) {
        this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
        this.renderer.setSize(width, height, false);
        this.camera.aspect = width / height;
        this.camera.updateProjectionMatrix();
    }

    // Place of a point on the screen: pixels from the left and from the top.
    seen(x, width, height) {
        const v = x.clone().project(this.camera);
        return { x: 0.5 * (v.x + 1) * width, y: 0.5 * (1 - v.y) * height, front: v.z < 1 };
    }

    draw() {
        this.renderer.render(this.scene, this.camera);
    }
}
