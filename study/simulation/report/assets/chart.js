// The chart: Observable Plot draws points, lines and Monte-Carlo errors, in panels.

const MOST_POINTS = 6000, MOST_PANELS = 12;
const DARK = matchMedia("(prefers-color-scheme: dark)");
const PALETTE = (n, dark) => n > 1 ? Plot.quantize(t => Plot.interpolateViridis((dark ? 0.25 : 0) + (dark ? 0.75 : 0.85) * t), n) : [dark ? "#7cb8ec" : "#0a558c"];

// The figures' marks, by Matplotlib's letters: outlines about zero, as radii in equal steps of angle from the top.
const ORDERED = ["o", "s", "^", "D", "v", "p", "*", "P", "X"];
const star = (n, inner) => Array.from({ length: 2 * n }, (_, k) => k % 2 ? inner : 1);
const OUTLINES = {
    s: [[1, 1, 1, 1], 45], D: [[1, 1, 1, 1], 0], d: [[1.15, 0.6, 1.15, 0.6], 0], "^": [[1.2, 1.2, 1.2], 0], v: [[1.2, 1.2, 1.2], 180],
    "<": [[1.2, 1.2, 1.2], -90], ">": [[1.2, 1.2, 1.2], 90], p: [[1, 1, 1, 1, 1], 0], h: [[1, 1, 1, 1, 1, 1], 0], H: [[1, 1, 1, 1, 1, 1], 30],
    "*": [star(5, 0.45), 0], P: [star(4, 0.5), 0], X: [star(4, 0.5), 45],
};
const CIRCLE = { draw: (path, size) => { const r = Math.sqrt(size / Math.PI); path.moveTo(r, 0); path.arc(0, 0, r, 0, 2 * Math.PI); } };

function mark(letter) {
    if (!OUTLINES[letter]) return CIRCLE;
    const [radii, turn] = OUTLINES[letter];
    return {
        draw(path, size) {
            radii.forEach((radius, k) => {
                const angle = 2 * Math.PI * (k / radii.length + turn / 360), r = radius * Math.sqrt(size / 2);
                path[k ? "lineTo" : "moveTo"](r * Math.sin(angle), -r * Math.cos(angle));
            });
            path.closePath();
        },
    };
}

// The figures' colours are made for white paper; on black, dark ones are mixed with white until they are seen.
function seen(colour, dark) {
    const parts = [1, 3, 5].map(k => parseInt(colour.slice(k, k + 2), 16));
    const light = 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2], share = Math.max(0, (140 - light) / (255 - light));
    return dark ? `rgb(${parts.map(part => Math.round(part + share * (255 - part)))})` : colour;
}

// Points of a view, sorted along each curve; `left` counts rows that the axes cannot show.
function points(run, view, rows) {
    const x = run.dimension[view.x], colour = run.dimension[view.colour], facet = run.dimension[view.facet];
    const { values, errors } = run.measure[view.y], numeric = x.number === true;
    const panels = facet ? [...new Set(rows.map(i => facet.codes[i]))].sort((a, b) => a - b) : [0];
    const rest = run.dimensions.filter(d => d !== x), found = [];
    for (const i of rows) {
        const y = values[i], at = x.raw[x.codes[i]], panel = facet ? panels.indexOf(facet.codes[i]) : 0;
        if (y === null || !Number.isFinite(y) || (view.ylog && y <= 0) || (numeric && view.xlog && at <= 0)) continue;
        if (panel >= MOST_PANELS || found.length >= MOST_POINTS) continue;
        const error = Number.isFinite(errors[i]) ? errors[i] : 0;
        const z = rest.map(d => d.codes[i]).join(" ");
        found.push({ i, x: numeric ? at : x.words[x.codes[i]], y, error, panel, z, colour: colour?.words[colour.codes[i]] ?? "" });
    }
    if (numeric) found.sort((a, b) => a.x - b.x);
    return { points: found, left: rows.length - found.length, panels: panels.slice(0, MOST_PANELS), facet, x, colour };
}

// Ticks of an axis, in one notation. Over many decades they are powers of ten, otherwise the library's.
function ticks(values, log, most) {
    const least = Math.min(...values), largest = Math.max(...values.map(Math.abs));
    const plain = largest < 1e5 && (log ? least : (Math.max(...values) - least) / 10) >= 1e-3;
    const tickFormat = v => plain || v === 0 ? String(+v.toPrecision(6)).replace("-", "−") : power(v);
    const low = Math.ceil(Math.log10(least) - 1e-9), high = Math.floor(Math.log10(largest) + 1e-9);
    if (!log || high - low < 2) return { tickFormat };
    const step = Math.ceil((high - low) / most), ticks = [];
    for (let n = low; n <= high; n += step) ticks.push(+`1e${n}`);
    return { ticks, tickFormat };
}

function chart(run, view, rows, width, describe, dark = DARK.matches) {
    const { points: data, left, panels, facet, x, colour } = points(run, view, rows);
    const lines = Math.ceil(panels.length / (width >= 880 ? 3 : width >= 520 ? 2 : 1));
    const columns = Math.ceil(panels.length / Math.max(lines, 1)) || 1, inner = width / columns;
    const ys = data.map(d => d.y), xs = data.map(d => d.x);
    const low = Math.min(...ys), high = Math.max(...ys.map((y, k) => Math.min(y + data[k].error, view.ylog ? 3 * y : Infinity)));
    const pad = 0.04 * (high - low || 1);
    const domain = view.ylog ? [low / 1.3, high * 1.3] : [Math.min(low - pad, ...data.map(d => d.y - d.error)), high + pad];
    const at = facet ? { fx: d => d.panel % columns, fy: d => Math.floor(d.panel / columns) } : {};
    const names = colour ? colour.words.filter((_, code) => rows.some(i => colour.codes[i] === code)) : [];
    const known = view.colour === "estimator" ? names.map(n => run.estimators.find(e => e.label === n)) : null;
    const colours = known ? known.map(e => seen(e.color, dark)) : PALETTE(names.length || 1, dark);
    const marks = known ? known.map(e => mark(e.marker)) : names.map((_, k) => mark(ORDERED[k % ORDERED.length]));
    const bars = data.filter(d => d.error > 0);
    const legend = legends(run.measure[view.y].title, names, width), common = { x: "x", y: "y", ...at };
    const svg = Plot.plot({
        width, height: (lines === 1 ? Math.min(440, Math.max(300, 0.7 * inner)) : (columns < 3 && width >= 880 ? 290 : 230) * lines) + legend.height + 45,
        marginTop: legend.height + (facet ? 22 : 8), marginLeft: 62, marginBottom: 42, marginRight: 14,
        style: { fontSize: "12px", fontFamily: "inherit", background: "transparent", overflow: "visible" },
        ariaLabel: `${run.measure[view.y].meaning}, against ${x.symbol}`,
        x: x.number ? { type: view.xlog ? "log" : "linear", label: axis(x), ...(xs.length ? ticks(xs, view.xlog, inner / 65) : {}) }
            : { type: "point", label: x.symbol, domain: x.words.filter(w => xs.includes(w)) },
        y: { type: view.ylog ? "log" : "linear", domain, label: null, grid: true, ...ticks(domain, view.ylog, 8) },
        fx: { axis: null, padding: 0.06 }, fy: { axis: null, padding: 0.16 },
        color: { type: "categorical", domain: names, range: colours },
        symbol: { domain: names, range: marks },
        marks: data.length ? [
            ...(view.y.startsWith("ratio") && domain[0] < 1 && domain[1] > 1 ? [Plot.ruleY([1], { stroke: "#777", strokeDasharray: "4 3" })] : []),
            ...(x.number ? [Plot.line(data, { ...common, z: "z", stroke: colour ? "colour" : colours[0], strokeWidth: 1.3 })] : []),
            Plot.link(bars, {
                ...at, x1: "x", x2: "x", y1: d => Math.max(d.y - d.error, domain[0]), y2: d => Math.min(d.y + d.error, domain[1]),
                stroke: colour ? "colour" : colours[0], strokeWidth: 1.2,
            }),
            Plot.dot(data, { ...common, r: 3, fill: colour ? "colour" : colours[0], symbol: colour ? "colour" : "circle" }),
            ...(facet ? [Plot.text(panels, {
                fx: (_, k) => k % columns, fy: (_, k) => Math.floor(k / columns), frameAnchor: "top-left", dy: -15,
                text: code => `${facet.symbol === "estimator" ? "" : `${facet.symbol} = `}${facet.words[code]}`, fontWeight: 600,
            })] : []),
            Plot.dot(data, Plot.pointer({ ...common, r: 7, stroke: "currentColor", maxRadius: 60 })),
            Plot.tip(data, Plot.pointer({ ...common, title: d => describe(d.i), maxRadius: 60, lineWidth: Math.min(60, width / 14), fontSize: 12 })),
        ] : [Plot.text(["No number to draw."], { frameAnchor: "middle" })],
    });
    legend.draw(svg, colours, marks);
    return { svg, data, left };
}

const NAMES = { noise_over_radius: "σ/r, noise over radius", decade: "σ/r, where the decade begins" };
const axis = d => NAMES[d.name] ?? (d.unit ? `${d.symbol}, ${d.unit}` : d.symbol);

// The measure and a legend, within the picture, so that a saved picture has them too.
function legends(title, names, width) {
    const places = [];
    let left = 8, line = 1;
    for (const name of names) {
        const wide = 30 + 7.2 * name.length;
        if (left + wide > width && left > 8) [left, line] = [8, line + 1];
        places.push([left, 12 + 20 * line]);
        left += wide;
    }
    const draw = (svg, colours, symbols) => {
        const make = (kind, parent, settings, text = "") => {
            const made = document.createElementNS("http://www.w3.org/2000/svg", kind);
            for (const [key, setting] of Object.entries(settings)) made.setAttribute(key, setting);
            made.textContent = text;
            return parent.appendChild(made);
        };
        const group = make("g", svg, { "aria-label": "legend", "text-anchor": "start" });
        make("text", group, { x: 8, y: 14, fill: "currentColor" }, title);
        names.forEach((name, k) => {
            const entry = make("g", group, { transform: `translate(${places[k]})` });
            make("path", entry, { d: Plot.symbol(symbols[k], 50)(), fill: colours[k], transform: "translate(6,0)" });
            make("text", entry, { x: 17, dy: "0.33em", fill: "currentColor" }, name);
        });
    };
    return { height: 20 * (line + 1) + 6, draw };
}
