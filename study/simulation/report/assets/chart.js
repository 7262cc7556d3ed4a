// The chart: Observable Plot draws points, lines and Monte-Carlo errors, in panels.

const MOST_POINTS = 6000, MOST_PANELS = 12;
const PALETTE = n => n > 1 ? Plot.quantize(t => Plot.interpolateViridis(0.85 * t), n) : ["#0a558c"];

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

// Powers of ten for an axis over many decades; other axes have the library's ticks.
function decades(values, most) {
    const low = Math.ceil(Math.log10(Math.min(...values)) - 1e-9), high = Math.floor(Math.log10(Math.max(...values)) + 1e-9);
    if (high - low < 2) return { tickFormat: v => short(v) };
    const step = Math.ceil((high - low) / most), ticks = [];
    for (let n = low; n <= high; n += step) ticks.push(+`1e${n}`);
    return { ticks, tickFormat: v => short(v) };
}

function chart(run, view, rows, width, describe) {
    const { points: data, left, panels, facet, x, colour } = points(run, view, rows);
    const lines = Math.ceil(panels.length / (width >= 880 ? 3 : width >= 520 ? 2 : 1));
    const columns = Math.ceil(panels.length / Math.max(lines, 1)) || 1, inner = width / columns;
    const ys = data.map(d => d.y), xs = data.map(d => d.x);
    const low = Math.min(...ys), high = Math.max(...ys.map((y, k) => Math.min(y + data[k].error, view.ylog ? 3 * y : Infinity)));
    const pad = 0.04 * (high - low || 1);
    const domain = view.ylog ? [low / 1.3, high * 1.3] : [Math.min(low - pad, ...data.map(d => d.y - d.error)), high + pad];
    const at = facet ? { fx: d => d.panel % columns, fy: d => Math.floor(d.panel / columns) } : {};
    const names = colour ? colour.words.filter((_, code) => rows.some(i => colour.codes[i] === code)) : [];
    const colours = view.colour === "estimator"
        ? names.map(n => run.estimators.find(e => e.label === n).color) : PALETTE(names.length || 1);
    const bars = data.filter(d => d.error > 0);
    const legend = legends(run.measure[view.y].title, names, width), common = { x: "x", y: "y", ...at };
    const svg = Plot.plot({
        width, height: (lines === 1 ? Math.min(440, Math.max(300, 0.7 * inner)) : (columns < 3 && width >= 880 ? 290 : 230) * lines) + legend.height + 45,
        marginTop: legend.height + (facet ? 22 : 8), marginLeft: 62, marginBottom: 42, marginRight: 14,
        style: { fontSize: "12px", fontFamily: "inherit", background: "white", overflow: "visible" },
        ariaLabel: `${run.measure[view.y].meaning}, against ${x.symbol}`,
        x: x.number ? { type: view.xlog ? "log" : "linear", label: axis(x), ...(view.xlog && xs.length ? decades(xs, inner / 65) : {}) }
            : { type: "point", label: x.symbol, domain: x.words.filter(w => xs.includes(w)) },
        y: { type: view.ylog ? "log" : "linear", domain, label: null, grid: true, ...(view.ylog ? decades(domain, 8) : {}) },
        fx: { axis: null, padding: 0.06 }, fy: { axis: null, padding: 0.16 },
        color: { type: "categorical", domain: names, range: colours },
        symbol: { domain: names },
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
            Plot.dot(data, Plot.pointer({ ...common, r: 7, stroke: "#1c1c1c", maxRadius: 60 })),
            Plot.tip(data, Plot.pointer({ ...common, title: d => describe(d.i), maxRadius: 60, lineWidth: Math.min(60, width / 14), fontSize: 12 })),
        ] : [Plot.text(["No number to draw."], { frameAnchor: "middle" })],
    });
    legend.draw(svg, names.map((_, k) => colours[k]), svg.scale("symbol")?.range ?? []);
    return { svg, data, left };
}

const axis = d => d.name === "noise_over_radius" ? "σ/r, noise over radius" : d.unit ? `${d.symbol}, ${d.unit}` : d.symbol;

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
            const symbol = symbols[k % symbols.length];
            const shape = symbol?.draw ? Plot.symbol(symbol, 50)() : Plot.symbol().size(50)();
            make("path", entry, { d: shape, fill: colours[k], transform: "translate(6,0)" });
            make("text", entry, { x: 17, dy: "0.33em", fill: "currentColor" }, name);
        });
    };
    return { height: 20 * (line + 1) + 6, draw };
}
