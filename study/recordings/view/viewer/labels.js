// Names beside the joints, on the side away from the body's middle, and moved apart so that none covers another.

const GAP = 17; // least vertical distance between two labels, pixels

class Labels {
    constructor(box, leaders) {
        this.box = box;
        this.leaders = leaders;
        this.shown = true;
    }

    load(motion) {
        this.motion = motion;
        this.box.replaceChildren(...motion.joints.map((joint) => {
            const span = document.createElement("span");
            span.textContent = joint.name.replaceAll("_", " ") + (joint.doubt ? " *" : "");
            return span;
        }));
        this.leaders.replaceChildren(...motion.joints.map(() => document.createElementNS("http://www.w3.org/2000/svg", "line")));
        this.widths = [...this.box.children].map((span) => span.offsetWidth);
    }

    // Places the names for the current frame and view.
    place(stage, width, height) {
        const spans = [...this.box.children];
        const lines = [...this.leaders.children];
        const spots = spans.map((_, i) => stage.seen(stage.point(i), width, height));
        const across = spots.map((at) => at.x).filter(Number.isFinite);
        const middle = across.reduce((sum, x) => sum + x, 0) / across.length;
        const wanted = spans.map((span, i) => {
            const at = spots[i];
            const known = this.shown && at.front && Number.isFinite(at.x) && at.x > 0 && at.x < width && at.y > 0 && at.y < height;
            span.hidden = !known;
            lines[i].style.display = known ? "" : "none";
            span.classList.toggle("flagged", stage.isFlagged(i));
            const room = this.widths[i] + 24; // without room here, the name goes to the other side of the joint
            const right = at.x >= middle ? at.x + room < width || at.x < room : at.x < room;
            const left = right ? at.x + 22 : at.x - 22 - this.widths[i];
            return { i, at, right, y: at.y, left: Math.min(Math.max(left, 2), width - this.widths[i] - 2), known };
        });
        this.spread(wanted.filter((label) => label.known), height);
        for (const { i, at, left, right, y, known } of wanted) {
            if (!known) continue;
            spans[i].style.transform = `translate(${left.toFixed(1)}px, ${(y - 8).toFixed(1)}px)`;
            const end = right ? left : left + this.widths[i];
            for (const [key, value] of Object.entries({ x1: at.x, y1: at.y, x2: end, y2: y })) lines[i].setAttribute(key, value.toFixed(1));
        }
    }

    // Moves labels apart vertically if they overlap horizontally, in several small steps.
    spread(labels, height) {
        const beside = (a, b) => a.left < b.left + this.widths[b.i] + 4 && b.left < a.left + this.widths[a.i] + 4;
        for (let step = 0; step < 12; step++) {
            labels.sort((a, b) => a.y - b.y);
            for (let k = 0; k < labels.length; k++) {
                for (let j = 0; j < k; j++) {
                    const lack = GAP - (labels[k].y - labels[j].y);
                    if (lack > 0 && beside(labels[j], labels[k])) {
                        labels[j].y -= lack / 2;
                        labels[k].y += lack / 2;
                    }
                }
            }
        }
        for (const label of labels) label.y = Math.min(Math.max(label.y, 10), height - 10);
    }
}
