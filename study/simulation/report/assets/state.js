// The state of the explorer: what is shown, as it stands in the address.

const MARK = "#explorer?";

// The view of a run that nobody has changed: error over bound against noise, a panel for each angle.
function first(run) {
    const varying = run.dimensions.slice(1), numeric = varying.filter(d => d.number);
    const by = names => names.map(n => varying.find(d => d.name === n)).find(Boolean);
    const x = by(["noise_over_radius", "decade"]) ?? [...numeric].sort((a, b) => b.words.length - a.words.length)[0] ?? run.dimensions[0];
    const facet = [by(["angle"]), ...varying].find(d => d && d !== x && d.words.length <= MOST_PANELS);
    const only = {};
    for (const d of varying) if (d !== x && d !== facet) only[d.name] = new Set([Math.floor(d.words.length / 2)]);
    const y = ["ratio_median", "relative_median"].find(name => run.measure[name]) ?? run.measures[0].name;
    return { y, x: x.name, colour: "estimator", facet: facet?.name ?? "", only, q: "", sort: "", down: false, ...scales(run, y, x) };
}

function scales(run, y, x) {
    const finite = run.measure[y].values.filter(v => v !== null && Number.isFinite(v));
    const positive = finite.length && finite.every(v => v > 0), at = x.number ? x.raw : [];
    return {
        ylog: Boolean(positive && Math.max(...finite) / Math.min(...finite) > 20),
        xlog: Boolean(x.number && Math.min(...at) > 0 && Math.max(...at) / Math.min(...at) > 20),
    };
}

function written(run, view) {
    const said = new URLSearchParams({ run: run.run, y: view.y, x: view.x, colour: view.colour, facet: view.facet });
    said.set("log", `${view.xlog ? "x" : ""}${view.ylog ? "y" : ""}`);
    for (const d of run.dimensions)
        if (view.only[d.name]) said.set(`is.${d.name}`, [...view.only[d.name]].sort((a, b) => a - b).map(c => d.raw[c]).join("|"));
    if (view.q) said.set("q", view.q);
    if (view.sort) said.set("sort", (view.down ? "-" : "") + view.sort);
    return MARK + said;
}

// A view from the address; what it names and the run lacks is as in the first view.
function read(run, said) {
    const view = first(run), named = (key, known) => known.includes(said.get(key)) ? said.get(key) : view[key];
    const dimensions = run.dimensions.map(d => d.name);
    view.y = named("y", run.measures.map(m => m.name));
    view.x = named("x", dimensions);
    view.colour = named("colour", ["", ...dimensions]);
    view.facet = named("facet", ["", ...dimensions]);
    Object.assign(view, scales(run, view.y, run.dimension[view.x]));
    if (said.has("log")) Object.assign(view, { xlog: said.get("log").includes("x"), ylog: said.get("log").includes("y") });
    if ([...said.keys()].length > 1) view.only = {};
    for (const d of run.dimensions) {
        const words = said.get(`is.${d.name}`);
        if (words === null) continue;
        view.only[d.name] = new Set(words.split("|").map(w => d.raw.findIndex(v => String(v) === w)).filter(c => c >= 0));
    }
    view.q = said.get("q") ?? "";
    view.sort = (said.get("sort") ?? "").replace("-", "");
    view.down = (said.get("sort") ?? "").startsWith("-");
    return view;
}
