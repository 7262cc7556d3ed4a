// The explorer: controls, chart, table and detail, which follow one view.

const get = id => document.getElementById(`explorer-${id}`);
const texts = [...document.querySelectorAll("script.run-table")];
const runs = new Map();
let run, view, drawn, table, picked = null, place = -1, width = 0;

async function load(name) {
    const found = texts.find(text => text.dataset.run === name) ?? texts[0];
    if (!runs.has(found.dataset.run)) runs.set(found.dataset.run, new Run(await unpack(found.textContent)));
    run = runs.get(found.dataset.run);
}

function options(select, entries, chosen) {
    select.replaceChildren(...entries.map(([key, words]) => new Option(words, key)));
    select.value = chosen;
}

function fill() {
    const dimensions = run.dimensions.map(d => [d.name, d.symbol]), none = ["", "none"];
    options(get("run"), texts.map(t => [t.dataset.run, t.dataset.run]), run.run);
    options(get("y"), run.measures.map(m => [m.name, m.title]), view.y);
    options(get("x"), dimensions, view.x);
    options(get("colour"), [none, ...dimensions], view.colour);
    options(get("facet"), [none, ...dimensions], view.facet);
    get("xlog").checked = view.xlog;
    get("ylog").checked = view.ylog;
    get("xlog").disabled = !run.dimension[view.x].number;
    get("search").value = view.q;
    get("filters").replaceChildren(...run.dimensions.map(filter));
}

function filter(dimension) {
    const { name, symbol, words } = dimension, box = element("details", { class: "filter" });
    const summary = element("summary"), list = element("div", { class: "choices", tabindex: "0", role: "group", "aria-label": `Values of ${symbol}` });
    const say = () => {
        const set = view.only[name], count = set ? set.size : words.length;
        summary.textContent = `${symbol}: ${!set || count === words.length ? `all ${words.length}` : count === 1 ? words[[...set][0]] : `${count} of ${words.length}`}`;
    };
    const boxes = words.map((word, code) => {
        const input = element("input", { type: "checkbox" });
        input.checked = !view.only[name] || view.only[name].has(code);
        input.addEventListener("change", () => choose(boxes.flatMap((b, c) => b.checked ? [c] : [])));
        const label = element("label");
        label.append(input, ` ${word}`);
        list.append(label);
        return input;
    });
    const choose = codes => {
        if (codes.length === words.length) delete view.only[name];
        else view.only[name] = new Set(codes);
        boxes.forEach((b, c) => b.checked = codes.includes(c));
        say();
        change();
    };
    for (const [word, codes] of [["all", words.map((_, c) => c)], ["none", []]]) {
        const button = element("button", { type: "button" }, word);
        button.addEventListener("click", () => choose(codes));
        list.prepend(button);
    }
    say();
    box.append(summary, list);
    return box;
}

function tell(text) {
    const { head, lines, worst, command } = text, parts = [element("strong", {}, head), ...lines.map(line => element("div", {}, line))];
    if (command) {
        const last = element("div", {}, `${worst}: `);
        last.append(element("code", {}, command));
        parts.push(last);
    }
    get("detail").replaceChildren(...parts);
}

function pick(i) {
    picked = i;
    tell(run.about(i, view.y));
}

const tooltip = i => {
    const { head, lines, worst, command } = run.about(i, view.y);
    return [head, ...lines, ...(command ? [`${worst}:`, command] : [])].join("\n");
};

function redraw() {
    const rows = run.rows(view.only);
    width = get("chart").clientWidth;
    drawn = chart(run, view, rows, width, tooltip);
    drawn.svg.addEventListener("input", () => {
        if (drawn.svg.value) pick(drawn.svg.value.i);
    });
    get("chart").replaceChildren(drawn.svg);
    place = -1;
    get("left").textContent = drawn.left ? `${many(drawn.left)} of ${many(rows.length)} rows are not drawn: no finite number, too many for one chart, or off a logarithmic axis. The table has them.` : "";
    list(rows);
    if (picked === null || !rows.includes(picked)) get("detail").textContent = "Point at the chart, step through it with the arrow keys, or choose a row of the table: its cell is told here.";
    else pick(picked);
}

function list(rows) {
    const count = table.draw(run, view, rows);
    get("count").textContent = `${many(count)} row${count === 1 ? "" : "s"}${count > table.shown ? `, ${table.shown} shown` : ""}`;
    get("more").hidden = count <= table.shown;
}

function change() {
    history.replaceState(null, "", written(run, view));
    redraw();
}

function save(kind, name, text) {
    const link = element("a", { href: URL.createObjectURL(new Blob([text], { type: kind })), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

function picture() {
    const copy = chart(run, view, run.rows(view.only), width, tooltip, false).svg, height = +copy.getAttribute("height");
    copy.querySelectorAll('[aria-label="tip"]').forEach(part => part.remove());
    copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
    copy.setAttribute("height", height + 20);
    copy.setAttribute("viewBox", `0 0 ${copy.getAttribute("width")} ${height + 20}`);
    Object.assign(copy.style, { fontFamily: "sans-serif", background: "white", color: "#1c1c1c" });
    copy.insertAdjacentHTML("beforeend", `<text x="8" y="${height + 12}" text-anchor="start" fill="#595959" font-size="10"></text>`);
    copy.lastElementChild.textContent = `run ${run.run}; ${run.measure[view.y].meaning}`;
    save("image/svg+xml", `${run.run}-${view.y}.svg`, new XMLSerializer().serializeToString(copy));
}

// A step of the arrow keys through the points, curve by curve; the one reached is ringed and told.
function step(event) {
    const last = drawn.data.length - 1, move = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    const next = event.key === "Home" ? 0 : event.key === "End" ? last : Math.min(Math.max(place + move, 0), last);
    if (Number.isNaN(next) || last < 0) return;
    event.preventDefault();
    place = next;
    const order = [...drawn.data.keys()].sort((a, b) => drawn.data[a].panel - drawn.data[b].panel || drawn.data[a].z.localeCompare(drawn.data[b].z) || a - b);
    const marks = drawn.svg.querySelector('[aria-label="dot"]').querySelectorAll("path, circle");
    for (const mark of marks) mark.classList.toggle("picked", mark.__data__ === order[place]);
    pick(drawn.data[order[place]].i);
}

async function show(said) {
    await load(said.get("run"));
    view = read(run, said);
    picked = null;
    table.shown = PAGE;
    fill();
    redraw();
}

const asked = () => new URLSearchParams(location.hash.startsWith(MARK) ? location.hash.slice(MARK.length) : "");

function listen() {
    get("run").addEventListener("change", async () => {
        await show(new URLSearchParams({ run: get("run").value }));
        history.replaceState(null, "", written(run, view));
    });
    for (const key of ["y", "x", "colour", "facet"])
        get(key).addEventListener("change", () => {
            view[key] = get(key).value;
            if (key === "y" || key === "x") Object.assign(view, scales(run, view.y, run.dimension[view.x]));
            fill();
            change();
        });
    for (const key of ["xlog", "ylog"]) get(key).addEventListener("change", () => { view[key] = get(key).checked; change(); });
    get("search").addEventListener("input", () => {
        view.q = get("search").value;
        history.replaceState(null, "", written(run, view));
        list(run.rows(view.only));
    });
    get("more").addEventListener("click", () => { table.shown += 10 * PAGE; list(run.rows(view.only)); });
    get("svg").addEventListener("click", picture);
    get("csv").addEventListener("click", () => save("text/csv", `${run.run}.csv`, run.csv(table.rows)));
    get("reset").addEventListener("click", async () => { await show(new URLSearchParams({ run: run.run })); change(); });
    get("chart").addEventListener("keydown", step);
    addEventListener("hashchange", () => { if (location.hash.startsWith(MARK)) show(asked()); });
    DARK.addEventListener("change", redraw);
    new ResizeObserver(() => { if (view && get("chart").clientWidth !== width) redraw(); }).observe(get("chart"));
}

async function start() {
    if (!texts.length) return;
    table = new Table(get("table"), get("search"), {
        pick, sort: name => { view.down = view.sort === name && !view.down; view.sort = name; history.replaceState(null, "", written(run, view)); list(run.rows(view.only)); },
    });
    listen();
    await show(asked());
    get("body").hidden = false;
    get("none").hidden = true;
    redraw();
    if (location.hash.startsWith(MARK)) document.getElementById("explorer").scrollIntoView();
}

const explorer = start();
