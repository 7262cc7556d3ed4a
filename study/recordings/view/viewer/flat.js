// Drawing without WebGL: the same scene on a plain canvas, for browsers that render in software and offer no WebGL.
// Balls become ellipses, rods become lines, far things are drawn first. No light, and no order within one thing.

const THICK = 0.02; // metres by which a rod is put farther, so that a joint at its farther end covers it, too

function isRod(thing) {
    return thing.geometry.type === "CylinderGeometry";
}

class FlatRenderer {
    constructor(canvas) {
        this.canvas = canvas;
        this.context = canvas.getContext("2d");
        if (!this.context) throw new Error("no canvas");
    }

    setClearColor() {}

    setPixelRatio(ratio) {
        this.ratio = ratio;
    }

    setSize(width, height) {
        [this.width, this.height] = [width * this.ratio, height * this.ratio];
        [this.canvas.width, this.canvas.height] = [this.width, this.height];
    }

    render(scene, camera) {
        camera.updateMatrixWorld();
        scene.updateMatrixWorld();
        this.inverse = camera.matrixWorld.clone().invert();
        this.near = camera.near;
        this.focal = (0.5 * this.height) / Math.tan((camera.fov * Math.PI) / 360);
        this.context.clearRect(0, 0, this.width, this.height);
        const things = [];
        scene.traverseVisible((thing) => {
            if (thing.isInstancedMesh) {
                const matrix = new THREE.Matrix4();
                for (let i = 0; i < thing.count; i++) {
                    thing.getMatrixAt(i, matrix);
                    things.push([this.inverse.clone().multiply(thing.matrixWorld).multiply(matrix), thing]);
                }
            } else if (thing.isMesh) things.push([this.inverse.clone().multiply(thing.matrixWorld), thing]);
            else if (thing.isLineSegments) this.lines(thing);
        });
        // a rod counts as far as its farther end, so that the joints at its ends cover it
        const depth = ([{ elements: m }, thing]) => m[14] - (isRod(thing) ? 0.5 * Math.abs(m[10]) + THICK : 0);
        things.sort((a, b) => depth(a) - depth(b));
        for (const [matrix, thing] of things) this.paint(matrix.elements, thing);
        this.context.globalAlpha = 1;
    }

    // Place on the canvas of a point in the camera's axes, which look along -z.
    at(x, y, z) {
        const scale = this.focal / -z;
        return [0.5 * this.width + x * scale, 0.5 * this.height - y * scale, scale];
    }

    paint(m, thing) {
        const z = m[14];
        if (!(z < -this.near)) return;
        const { context } = this;
        const color = `#${thing.material.color.getHexString()}`;
        context.globalAlpha = thing.material.opacity;
        const [x, y, scale] = this.at(m[12], m[13], z);
        if (isRod(thing)) {
            const ends = [-0.5, 0.5].map((half) => [m[12] + half * m[8], m[13] + half * m[9], z + half * m[10]]);
            if (ends.some((end) => !(end[2] < -this.near))) return;
            this.line(...ends, color, 2 * Math.hypot(m[0], m[1], m[2]) * scale);
            return;
        }
        // the outline of an ellipsoid A is that of A Aᵀ, seen along the line of sight
        const a = scale * scale * (m[0] * m[0] + m[4] * m[4] + m[8] * m[8]);
        const b = -scale * scale * (m[0] * m[1] + m[4] * m[5] + m[8] * m[9]); // y points down on a canvas
        const c = scale * scale * (m[1] * m[1] + m[5] * m[5] + m[9] * m[9]);
        const [middle, apart] = [0.5 * (a + c), Math.hypot(0.5 * (a - c), b)];
        context.beginPath();
        context.ellipse(x, y, Math.sqrt(middle + apart), Math.sqrt(Math.max(middle - apart, 0)), 0.5 * Math.atan2(2 * b, a - c), 0, 2 * Math.PI);
        context.fillStyle = color;
        context.fill();
    }

    line(from, to, color, width) {
        const { context } = this;
        context.beginPath();
        context.moveTo(...this.at(...from).slice(0, 2));
        context.lineTo(...this.at(...to).slice(0, 2));
        context.strokeStyle = color;
        context.lineWidth = Math.max(width, 1);
        context.lineCap = "round";
        context.stroke();
    }

    // Lines of the floor, cut where they pass behind the camera.
    lines(thing) {
        const places = thing.geometry.getAttribute("position");
        const color = `#${thing.material.color.getHexString()}`;
        const behind = -2 * this.near;
        this.context.globalAlpha = 1;
        for (let i = 0; i < places.count; i += 2) {
            const ends = [i, i + 1].map((k) => new THREE.Vector3().fromBufferAttribute(places, k).applyMatrix4(thing.matrixWorld).applyMatrix4(this.inverse));
            if (ends.every((end) => end.z > behind)) continue;
            for (const [one, other] of [ends, [...ends].reverse()]) if (one.z > behind) one.lerp(other, (one.z - behind) / (one.z - other.z));
            this.line(...ends.map((end) => end.toArray()), color, this.ratio);
        }
    }
}
