// A second motion, over the first one or beside it, at the same time from the start: bones and joints in one colour.

const BESIDE = 1.2; // distance to the motion beside, metres

class Ghost {
    constructor(stage) {
        this.stage = stage;
        this.motion = null;
        this.beside = false;
        this.group = new THREE.Group();
        this.material = new THREE.MeshLambertMaterial({ color: COLORS.ghost, transparent: true, opacity: 0.7 });
        stage.scene.add(this.group);
    }

    // Shows another motion; null for none.
    load(motion) {
        this.motion = motion;
        this.group.clear();
        if (!motion) return;
        const mesh = (geometry) => {
            const made = new THREE.Mesh(geometry, this.material);
            this.group.add(made);
            return made;
        };
        this.bones = motion.bones.map(() => mesh(this.stage.rod));
        this.joints = motion.joints.map(() => mesh(this.stage.ball));
    }

    frame(time) {
        return Math.min(Math.floor(time * this.motion.rate + 1e-6), this.motion.frames - 1);
    }

    point(i, frame) {
        const at = 3 * (frame * this.motion.count + i);
        return new THREE.Vector3(...this.motion.points.subarray(at, at + 3));
    }

    show(time) {
        if (!this.motion) return;
        const frame = this.frame(time);
        const points = Array.from({ length: this.motion.count }, (_, i) => this.point(i, frame));
        this.group.position.set(0, 0, 0);
        if (this.beside) { // to the right of the view
            const right = new THREE.Vector3().setFromMatrixColumn(this.stage.camera.matrixWorld, 0).setZ(0);
            this.group.position.copy(right.normalize().multiplyScalar(BESIDE));
        }
        this.motion.bones.forEach(([i, j], n) => placeRod(this.bones[n], points[i], points[j], 0.008));
        this.joints.forEach((drawn, i) => {
            drawn.visible = !Number.isNaN(points[i].x);
            drawn.position.copy(points[i]);
            drawn.scale.setScalar(0.014);
        });
    }

    // Distances of joints from those of the same name in the first motion, metres, the largest first.
    distances(time) {
        if (!this.motion) return [];
        const { stage } = this;
        const found = this.motion.joints.map(({ name }, i) => {
            const k = stage.motion.joints.findIndex((joint) => joint.name === name);
            return [name, k < 0 ? NaN : this.point(i, this.frame(time)).distanceTo(stage.point(k))];
        });
        return found.filter(([, distance]) => !Number.isNaN(distance)).sort(([, a], [, b]) => b - a);
    }
}
