// The table of a view: searched by words, sorted by a column, some rows at a time.

const PAGE = 50;

class Table {
    constructor(place, search, on) {
        Object.assign(this, { place, search, on, shown: PAGE, rows: [] });
    }

    columns(run, measure) {
        const { title, values, errors } = run.measure[measure];
        return [
            ...run.dimensions.map(d => ({ name: d.name, title: d.symbol, text: i => d.words[d.codes[i]], key: i => d.codes[i], number: d.number })),
            { name: "trials", title: "trials", text: i => many(run.trials[i]), key: i => run.trials[i], number: true },
            { name: "failed", title: "not ok", text: i => `${short(100 * (1 - run.ok[i] / run.trials[i]), 2)} %`, key: i => 1 - run.ok[i] / run.trials[i], number: true },
            { name: "value", title, text: i => short(values[i], 4), key: i => values[i] ?? -Infinity, number: true },
            { name: "error", title: "±", text: i => short(errors[i], 2), key: i => errors[i] ?? -Infinity, number: true },
            { name: "group", title: run.by, text: i => run.groups[run.group[i]], key: i => run.group[i] },
        ];
    }

    // Rows of a view that have every word of the search, in the order asked for.
    found(run, view, rows) {
        const columns = this.columns(run, view.y), words = view.q.toLowerCase().split(/\s+/).filter(Boolean);
        const spoken = i => `${run.setting(i)} ${columns.map(c => c.text(i)).join(" ")}`.toLowerCase();
        const matching = words.length ? rows.filter(i => { const text = spoken(i); return words.every(w => text.includes(w)); }) : [...rows];
        const by = columns.find(c => c.name === view.sort);
        if (by) matching.sort((a, b) => (by.key(a) - by.key(b)) * (view.down ? -1 : 1) || a - b);
        return { columns, matching };
    }

    draw(run, view, rows) {
        const { columns, matching } = this.found(run, view, rows);
        const head = element("tr");
        for (const column of columns) {
            const button = element("button", { type: "button" }, column.title);
            button.dataset.sort = column.name;
            const sorted = view.sort === column.name ? (view.down ? "descending" : "ascending") : "none";
            const cell = element("th", { scope: "col", "aria-sort": sorted, class: column.number ? "number" : "" });
            button.addEventListener("click", () => this.on.sort(column.name));
            cell.append(button);
            head.append(cell);
        }
        const body = element("tbody");
        for (const i of matching.slice(0, this.shown)) {
            const row = element("tr");
            columns.forEach((column, k) => {
                const cell = element(k ? "td" : "th", { class: column.number ? "number" : "", ...(k ? {} : { scope: "row" }) });
                if (k) cell.textContent = column.text(i);
                else {
                    const button = element("button", { type: "button", "aria-label": `${column.text(i)}: show its cell` }, column.text(i));
                    button.addEventListener("click", () => this.on.pick(i));
                    cell.append(button);
                }
                row.append(cell);
            });
            body.append(row);
        }
        const table = element("table", { class: "plain" });
        const top = element("thead");
        top.append(head);
        table.append(top, body);
        const focused = this.place.contains(document.activeElement) ? document.activeElement.dataset.sort : null;
        this.place.replaceChildren(table);
        if (focused) this.place.querySelector(`[data-sort="${focused}"]`)?.focus();
        this.rows = matching;
        return matching.length;
    }
}

function element(name, settings = {}, text = "") {
    const made = document.createElement(name);
    for (const [key, setting] of Object.entries(settings)) if (setting !== "") made.setAttribute(key, setting);
    if (text) made.textContent = text;
    return made;
}
